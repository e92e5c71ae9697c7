/*
 * What a simplification reports, in a small text file: numbers by name (simplify_file.h). It is written before the manifest, so a
 * folder with a manifest has it, also after a crash of the machine: both are fsynced.
 */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "simplify_file.h"
#include "simplify_priv.h"

/* Change it when other points are chosen than before: then results by the old rules are not found. */
static const char RULES[] = "simplify 4";
static const char REPORT[] = "report";
static const char HEAD[] = "acut-simplify 1";

struct digest simplify_key(const struct grid *grid, const struct view *view, int64_t max_error, uint64_t max_points)
{
	const struct grid_manifest *m = grid_manifest(grid);
	char lattice[LATTICE_TEXT_SIZE], numbers[64];
	struct view rules = view_normal(view);
	struct digest parts[8];

	rules.window = VIEW_CROP_NONE;
	rules.window_area = NULL;
	lattice_text(&m->lattice, lattice);
	snprintf(numbers, sizeof numbers, "%" PRId64 " %" PRIu64, max_points ? 0 : max_error, max_points);
	parts[0] = grid_content(grid);
	parts[1] = digest_hash(lattice, strlen(lattice));
	parts[2] = view_hash(&rules);
	parts[3] = digest_hash(RULES, sizeof RULES);
	parts[4] = digest_hash(m->crs, strlen(m->crs));
	parts[5] = digest_hash(m->unit_xy, strlen(m->unit_xy));
	parts[6] = digest_hash(m->unit_z, strlen(m->unit_z));
	parts[7] = digest_hash(numbers, strlen(numbers));
	return digest_hash(parts, sizeof parts);
}

const char *simplify_step_text(enum simplify_step step)
{
	static const char *const text[] = {"divide", "blocks", "check", "done"};

	return text[step];
}

/* ---- the report ---- */

#define ROW(name, field)                                      \
	{                                                     \
		name, offsetof(struct simplify_report, field) \
	}
/* The number of a rule is part of the file, as it is of stored domains. */
#define RULE(i)                                                                                   \
	{                                                                                         \
		"removed-" #i, offsetof(struct simplify_report, removed) + (i) * sizeof(uint64_t) \
	}
static const struct simplify_row rows[] = {
	ROW("points", points),
	ROW("kept", kept),
	ROW("lines", lines),
	ROW("hull", hull),
	ROW("seeds", seeds),
	ROW("rounds", rounds),
	ROW("tested", tested),
	ROW("attempts", attempts),
	ROW("error", max_error),
	ROW("largest", largest),
	ROW("records", records),
	RULE(1),
	RULE(2),
	RULE(3),
	RULE(4),
	RULE(5),
	RULE(6),
	RULE(7),
	RULE(8),
	RULE(9),
	RULE(10),
	RULE(11),
	RULE(12),
};
_Static_assert(VIEW_BY_ERROR == 13 && VIEW_KEPT == 0, "a row for each rule that removes points before this one");

int simplify_report_write(int dirfd, const struct simplify_report *report, struct err *err)
{
	return simplify_text_write(dirfd, REPORT, HEAD, rows, sizeof rows / sizeof *rows, report, GRID_DURABLE, err);
}

int simplify_report_read(int dirfd, struct simplify_report *ret, struct err *err)
{
	struct simplify_report report = {0};
	int r = simplify_text_read(dirfd, REPORT, HEAD, rows, sizeof rows / sizeof *rows, &report, err);

	if (!r)
		*ret = report;
	return r;
}
