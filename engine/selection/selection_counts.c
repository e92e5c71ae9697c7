/*
 * The identity of a selection, and its counts in a small text file: a selection that is used again reports the same
 * counts as at first.
 *
 * The file has lines of "name value" and a checksum in the last line. It is written before the manifest, so a folder
 * with a manifest has its counts. It is not fsynced: a selection can be made again.
 */
#include "selection_priv.h"

#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "io.h"

/* Change it when a view selects different points than before: then selections by the old rules are not found. */
static const char RULES[] = "selection 1";
static const char COUNTS[] = "counts";
static const char HEAD[] = "acut-selection 1\n";
/* Of a view with a metric. */
#define MAPPED "origin %" PRId64 " %" PRId64 "\nbox %" PRId32 " %" PRId32 " %" PRId32 " %" PRId32 "\n"

enum { TEXT_MAX = 1024 };

struct digest selection_key(const struct grid *grid, const struct view *view)
{
	const struct grid_manifest *m = grid_manifest(grid);
	char lattice[LATTICE_TEXT_SIZE];
	struct view selecting = view_normal(view);
	struct digest parts[7];

	selecting.duplicates = VIEW_LOWEST;
	selecting.hidden = false;
	selecting.window = VIEW_CROP_NONE;
	selecting.window_area = NULL;
	lattice_text(&m->lattice, lattice);
	parts[0] = grid_content(grid);
	parts[1] = digest_hash(lattice, strlen(lattice));
	parts[2] = view_hash(&selecting);
	parts[3] = digest_hash(RULES, sizeof RULES);
	/* The same files pushed under another coordinate system have the same content. */
	parts[4] = digest_hash(m->crs, strlen(m->crs));
	parts[5] = digest_hash(m->unit_xy, strlen(m->unit_xy));
	parts[6] = digest_hash(m->unit_z, strlen(m->unit_z));
	return digest_hash(parts, sizeof parts);
}

/* `rules`: bit set of those that have a line. */
static int counts_text(const struct selection_counts *s, unsigned rules, char text[TEXT_MAX])
{
	int at = snprintf(text, TEXT_MAX, "%spoints %" PRIu64 "\nkept %" PRIu64 "\n", HEAD, s->points, s->kept);
	char hex[DIGEST_HEX_SIZE];

	if (s->mapped)
		at += snprintf(text + at, TEXT_MAX - (size_t)at, MAPPED, s->origin[0], s->origin[1], s->box[0], s->box[1],
			       s->box[2], s->box[3]);
	for (unsigned i = VIEW_KEPT + 1; i < VIEW_RULES; i++)
		if (rules >> i & 1)
			at += snprintf(text + at, TEXT_MAX - (size_t)at, "%s %" PRIu64 "\n", view_rule_text((enum view_rule)i),
				       s->removed[i]);
	return at + snprintf(text + at, TEXT_MAX - (size_t)at, "check %s\n", digest_hex(digest_hash(text, (size_t)at), hex));
}

int selection_counts_write(int dirfd, const struct selection_counts *s, struct err *err)
{
	char text[TEXT_MAX];
	int n = counts_text(s, UINT_MAX, text), fd, r;

	r = io_open(dirfd, COUNTS, O_WRONLY | O_CREAT | O_TRUNC, 0640, &fd, err);
	if (r)
		return r;
	r = io_write_at(fd, text, (size_t)n, 0, COUNTS, err);
	io_close(fd);
	return r;
}

/* Parses without validation: the caller formats the result again and compares the texts. Returns the rules that have a line: a
 * version that did not know a rule wrote none, and its selections are as good as before. */
static unsigned counts_parse(const char *text, struct selection_counts *ret)
{
	unsigned rules = 0;
	char name[32];
	uint64_t n;

	for (const char *line = strchr(text, '\n'); line && line[1]; line = strchr(line + 1, '\n')) {
		if (sscanf(line + 1, MAPPED, &ret->origin[0], &ret->origin[1], &ret->box[0], &ret->box[1], &ret->box[2],
			   &ret->box[3]) == 6)
			ret->mapped = true;
		if (sscanf(line + 1, "%31s %" SCNu64, name, &n) != 2)
			continue;
		if (!strcmp(name, "points"))
			ret->points = n;
		else if (!strcmp(name, "kept"))
			ret->kept = n;
		for (unsigned i = VIEW_KEPT + 1; i < VIEW_RULES; i++)
			if (!strcmp(name, view_rule_text((enum view_rule)i))) {
				ret->removed[i] = n;
				rules |= 1u << i;
			}
	}
	return rules;
}

int selection_counts_read(int dirfd, struct selection_counts *ret, struct err *err)
{
	char text[TEXT_MAX] = "", again[TEXT_MAX];
	struct selection_counts s = {0};
	unsigned rules;
	size_t n = 0;
	int fd, r;

	r = io_open(dirfd, COUNTS, O_RDONLY, 0, &fd, err);
	if (r)
		return r;
	r = io_read_some(fd, text, sizeof text - 1, 0, COUNTS, &n, err);
	io_close(fd);
	if (r)
		return r;
	text[n] = 0;
	rules = counts_parse(text, &s);
	counts_text(&s, rules, again);
	if (strcmp(text, again)) {
		err_set(err, ERR_CORRUPT, "the counts of a selection are damaged");
		return err_add_file(err, COUNTS);
	}
	*ret = s;
	return 0;
}
