/* Profiles as commands ask for them: by name out of the folders, or one file wherever it is. */
#include <stdlib.h>
#include <string.h>

#include "cli_guess.h"
#include "err.h"
#include "scan_profile.h"

static bool is_file(const char *which)
{
	size_t n = strlen(which);

	return strchr(which, '/') || (n > 5 && !strcmp(which + n - 5, ".conf"));
}

int scan_profile_set(struct program *args, struct profile_set **ret, struct err *err)
{
	int r = profile_set_read(args->profiles.n ? args->profiles.text : NULL, ret, err);

	if (!r && !profile_set_count(*ret) && !args->profiles.n && !(args->profile && is_file(args->profile)))
		console_warn(
			&args->console,
			"there is no profile in %s nor in %s: no scanner is known; --profiles DIR names a folder of profiles (etc/scanners.d of "
			"the source, where acut is not installed)",
			profile_folders[0], profile_folders[1]);
	return r;
}

int scan_profile_copy(const struct profile_entry *e, struct scan_profile *ret, struct err *err)
{
	char *text = malloc(e->size + 1);

	if (!text)
		return err_set(err, ERR_NOMEM, "no memory for a profile");
	if (e->size)
		memcpy(text, e->text, e->size);
	text[e->size] = 0;
	*ret = (struct scan_profile){.profile = e->profile, .text = text, .size = e->size};
	return 0;
}

void scan_profile_done(struct scan_profile *p)
{
	free(p->text);
	p->text = NULL;
}

static int unknown(const struct profile_set *set, const char *which, struct err *err)
{
	struct cli_guess g = {.given = which};
	char buf[128];

	for (size_t i = 0; i < profile_set_count(set); i++)
		cli_guess_offer(&g, profile_set_at(set, i)->profile.name);
	err_set(err, ERR_USAGE, "there is no profile %s", which);
	return err_add_hint(err, "%sacut-scan profiles lists them; a file is named with its slash or .conf",
			    cli_guess_text(&g, "", buf));
}

int scan_profile_named(const struct profile_set *set, const char *which, struct scan_profile *ret, struct err *err)
{
	const struct profile_entry *known;
	struct profile_entry *file;
	int r;

	if (is_file(which)) {
		r = profile_entry_read(which, &file, err);
		if (r)
			return r;
		r = scan_profile_copy(file, ret, err);
		profile_entry_free(file);
		return r;
	}
	known = profile_set_find(set, which);
	if (!known)
		return unknown(set, which, err);
	if (known->fault) {
		err_set(err, ERR_INPUT, "%s", known->fault);
		return err_add_file(err, known->path);
	}
	return scan_profile_copy(known, ret, err);
}
