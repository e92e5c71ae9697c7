/*
 * What a simplification reports, in a small text file: lines of "name value", and a checksum in the last line. It is written
 * before the manifest, so a folder with a manifest has it. It is not fsynced: a simplification can be made again.
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "io.h"
#include "simplify_priv.h"

/* Change it when other points are chosen than before: then results by the old rules are not found. */
static const char RULES[] = "simplify 1";
static const char REPORT[] = "report";
static const char HEAD[] = "acut-simplify 1\n";

enum { TEXT_MAX = 2048 };

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

static const struct row {
	const char *name;
	size_t at;
} rows[] = {
	{"points", offsetof(struct simplify_report, points)},   {"kept", offsetof(struct simplify_report, kept)},
	{"lines", offsetof(struct simplify_report, lines)},     {"hull", offsetof(struct simplify_report, hull)},
	{"seeds", offsetof(struct simplify_report, seeds)},     {"rounds", offsetof(struct simplify_report, rounds)},
	{"tested", offsetof(struct simplify_report, tested)},   {"attempts", offsetof(struct simplify_report, attempts)},
	{"error", offsetof(struct simplify_report, max_error)}, {"records", offsetof(struct simplify_report, records)},
};
enum { ROWS = sizeof rows / sizeof *rows };

static uint64_t *value_at(struct simplify_report *report, size_t at)
{
	return (uint64_t *)(void *)((char *)report + at);
}

/* The rules that have no line are zero: those that a version did not know. */
static int report_text(const struct simplify_report *report, unsigned rules, char text[TEXT_MAX])
{
	struct simplify_report copy = *report;
	int at = snprintf(text, TEXT_MAX, "%s", HEAD);
	char hex[DIGEST_HEX_SIZE];

	for (unsigned i = 0; i < ROWS; i++)
		at += snprintf(text + at, TEXT_MAX - (size_t)at, "%s %" PRIu64 "\n", rows[i].name, *value_at(&copy, rows[i].at));
	for (unsigned i = VIEW_KEPT + 1; i < VIEW_RULES; i++)
		if (rules >> i & 1)
			at += snprintf(text + at, TEXT_MAX - (size_t)at, "%u %" PRIu64 "\n", i, report->removed[i]);
	return at + snprintf(text + at, TEXT_MAX - (size_t)at, "check %s\n", digest_hex(digest_hash(text, (size_t)at), hex));
}

int simplify_report_write(int dirfd, const struct simplify_report *report, struct err *err)
{
	char text[TEXT_MAX];
	int n = report_text(report, UINT32_MAX, text), fd, r;

	r = io_open(dirfd, REPORT, O_WRONLY | O_CREAT | O_TRUNC, 0640, &fd, err);
	if (r)
		return r;
	r = io_write_at(fd, text, (size_t)n, 0, REPORT, err);
	io_close(fd);
	return r;
}

/* Parses without validation: the caller formats the result again and compares the texts. */
static unsigned report_parse(const char *text, struct simplify_report *ret)
{
	unsigned rules = 0, rule;
	char name[32];
	uint64_t n;

	for (const char *line = strchr(text, '\n'); line && line[1]; line = strchr(line + 1, '\n')) {
		if (sscanf(line + 1, "%31s %" SCNu64, name, &n) != 2)
			continue;
		for (unsigned i = 0; i < ROWS; i++)
			if (!strcmp(name, rows[i].name))
				*value_at(ret, rows[i].at) = n;
		if (sscanf(name, "%u", &rule) == 1 && rule > VIEW_KEPT && rule < VIEW_RULES) {
			ret->removed[rule] = n;
			rules |= 1u << rule;
		}
	}
	return rules;
}

int simplify_report_read(int dirfd, struct simplify_report *ret, struct err *err)
{
	char text[TEXT_MAX] = "", again[TEXT_MAX];
	struct simplify_report report = {0};
	unsigned rules;
	size_t n = 0;
	int fd, r;

	r = io_open(dirfd, REPORT, O_RDONLY, 0, &fd, err);
	if (r)
		return r;
	r = io_read_some(fd, text, sizeof text - 1, 0, REPORT, &n, err);
	io_close(fd);
	if (r)
		return r;
	text[n] = 0;
	rules = report_parse(text, &report);
	report_text(&report, rules, again);
	if (strcmp(text, again)) {
		err_set(err, ERR_CORRUPT, "the report of a simplification is damaged");
		return err_add_file(err, REPORT);
	}
	*ret = report;
	return 0;
}
