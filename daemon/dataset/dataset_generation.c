/*
 * The note that a manifest keeps of each generation: time, user, and what it changed (grid.h). Whoever writes a manifest with a
 * new generation adds its note here; earlier notes are copied.
 */
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "dataset_priv.h"

/* The name of the user, or "" if it is unknown. Reads the user database: workers only. */
static void user_name(uint32_t uid, char ret[GRID_USER])
{
	struct passwd entry, *found = NULL;
	char buffer[4096];

	*ret = 0;
	if (getpwuid_r(uid, &entry, buffer, sizeof buffer, &found) == 0 && found && strlen(entry.pw_name) < GRID_USER)
		memcpy(ret, entry.pw_name, strlen(entry.pw_name) + 1);
}

int dataset_note_generation(struct grid_manifest *m, const struct grid_manifest *base, const struct peer *peer,
			    enum grid_generation_kind kind, uint64_t undoes, struct err *err)
{
	size_t n = base ? base->ngenerations : 0;
	/* The name follows the list in the same allocation, so that both are freed together. */
	struct grid_generation *all = malloc((n + 1) * sizeof *all + GRID_USER);
	char *user = all ? (char *)(all + n + 1) : NULL;

	if (!all)
		return err_set(err, ERR_NOMEM, "no memory for a list of %zu generations", n + 1);
	if (n)
		memcpy(all, base->generations, n * sizeof *all);
	user_name(peer->uid, user);
	all[n] = (struct grid_generation){
		.number = m->generation,
		.time_us = clock_real_us(),
		.uid = peer->uid,
		.user = user,
		.kind = kind,
		.undoes = undoes,
	};
	grid_generations_tally(m, &all[n], 1);
	m->generations = all;
	m->ngenerations = n + 1;
	return 0;
}
