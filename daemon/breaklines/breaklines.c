/*
 * Files of lines of a dataset (breaklines.h).
 *
 * Model: a push stages lines under its own name, as its runs, so that whatever sweeps or keeps those does the same with them. The
 * commit links them to their final names, makes the line set of all lines that will be live, with a segment of its vertices, and
 * then writes the manifest that names all of these. Until then no manifest does, and a sweep removes them.
 */
#include "breaklines.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_stage.h"
#include "io.h"
#include "lattice.h"
#include "lineset.h"
#include "places.h"

enum { BYTES_A_VERTEX = 240, BYTES_LEAST = 2 << 20, BATCH = 4096, SET_MEMORY = 256 << 10 };

void breaklines_staged_name(uint64_t push, uint32_t source, char ret[64])
{
	snprintf(ret, 64, "push-%llu.lines-%u", (unsigned long long)push, source);
}

int breaklines_discard(int dirfd, uint64_t push, struct err *err)
{
	char prefix[48];

	snprintf(prefix, sizeof prefix, "push-%llu.lines-", (unsigned long long)push);
	return io_folder_sweep(dirfd, prefix, err);
}

static int file_bytes(int dirfd, const char *name, uint64_t *ret, struct err *err)
{
	struct stat st;

	if (io->fstatat(dirfd, name, &st, AT_SYMLINK_NOFOLLOW) != 0) {
		err_sys(err, errno, "cannot look at");
		return err_add_file(err, name);
	}
	*ret = (uint64_t)st.st_size;
	return 0;
}

int breaklines_described(int dirfd, const char *name, const struct breakline_totals *t, struct grid_lines *ret, struct err *err)
{
	*ret = (struct grid_lines){.lines = t->lines, .vertices = t->vertices, .content = t->content};
	for (unsigned i = 0; i < GRID_LINE_KINDS; i++)
		ret->features[i] = t->features[i];
	return file_bytes(dirfd, name, &ret->bytes, err);
}

int breaklines_publish(int dirfd, uint64_t push, const struct grid_source *s, struct err *err)
{
	struct grid_named of[GRID_SOURCE_FILES];
	char staged[64];
	int r;

	breaklines_staged_name(push, s->id, staged);
	grid_source_files(s, of);
	/* A commit that was cut short may have left the name. */
	r = io_remove(dirfd, of->name, err);
	if (!r && io->linkat(dirfd, staged, dirfd, of->name, 0) < 0) {
		err_sys(err, errno, "cannot make a hard link of %s", staged);
		r = err_add_hint(err, "the file system of --state must have hard links");
	}
	return r;
}

int breaklines_remove(int dirfd, const struct grid_source *s, struct err *err)
{
	struct grid_named of[GRID_SOURCE_FILES];
	size_t n = grid_source_files(s, of);
	char segment[40];
	int r = 0;

	for (size_t i = 0; !r && i < n; i++)
		r = io_remove(dirfd, of[i].name, err);
	if (r || s->kind != GRID_LINE_VERTICES)
		return r;
	grid_line_segment(s->id, segment);
	strcat(segment, ".seg");
	return io_remove(dirfd, segment, err);
}

/* ---- the line set ---- */

uint64_t breaklines_memory(uint64_t vertices)
{
	return GRID_STAGE_MIN + BYTES_LEAST + vertices * BYTES_A_VERTEX;
}

struct build {
	const struct breaklines_params *p;
	struct grid_stage *stage;
	struct places places;
	struct point batch[BATCH];
	uint64_t points;
};

/* The stage knows the source; the mark of a reader of generations is none of its flags. */
static int take_vertices(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct build *b = ctx;
	int r = 0;

	b->points += n;
	for (size_t i = 0; !r && i < n; i += BATCH) {
		size_t k = n - i < BATCH ? n - i : BATCH;

		memcpy(b->batch, pts + i, k * sizeof *pts);
		for (size_t j = 0; j < k; j++)
			b->batch[j].tag &= POINT_FLAGS;
		r = grid_stage_add(b->stage, b->batch, k, err);
	}
	return r;
}

static int refuse_place(const struct breaklines_params *p, enum breakline_event event, int32_t x, int32_t y, int32_t lower,
			int32_t upper, struct err *err)
{
	err_set(err, ERR_INPUT,
		event == BREAKLINE_CROSSING ? "lines cross at %.10g %.10g with heights %.10g and %.10g" :
					      "vertices of lines at %.10g %.10g have heights %.10g and %.10g",
		lattice_coordinate(p->lattice, 0, x), lattice_coordinate(p->lattice, 1, y),
		lattice_coordinate(p->lattice, 2, lower), lattice_coordinate(p->lattice, 2, upper));
	return err_add_hint(err, "mend the lines, or leave --strict out: --duplicates chooses one of the heights");
}

static int take_event(void *ctx, enum breakline_event event, int32_t x, int32_t y, int32_t lower, int32_t upper, struct err *err)
{
	struct build *b = ctx;

	if (b->p->strict && lower != upper)
		return refuse_place(b->p, event, x, y, lower, upper, err);
	return places_add(&b->places, event, x, y, lower, upper, err);
}

static int build_files(struct build *b, const char *const *names, const char *lineset, struct breaklines *ret, struct err *err)
{
	const struct breaklines_params *p = b->p;
	const struct breakline_params params = {
		.dirfd = p->dirfd,
		.file = names,
		.nfiles = p->nlines,
		.lineset = lineset,
		.memory = p->memory > GRID_STAGE_MIN ? p->memory - GRID_STAGE_MIN : 0,
		.vertices = take_vertices,
		.event = take_event,
		.ctx = b,
	};
	int r = grid_stage_source(b->stage, p->id, err);

	if (!r)
		r = breakline_build(&params, &ret->counts, err);
	if (r == -ERR_LIMIT && err->need)
		err->need += GRID_STAGE_MIN;
	if (!r && b->points)
		r = grid_stage_seal(b->stage, &ret->segment, err);
	if (!r)
		r = places_finish(&b->places, err);
	if (!r)
		r = file_bytes(p->dirfd, lineset, &ret->lines.bytes, err);
	ret->lines.places = b->places.written;
	ret->points = b->points;
	for (size_t i = 0; i < p->nlines; i++)
		digest_add(&ret->lines.content, p->lines[i]->lines->content);
	return r;
}

int breaklines_build(const struct breaklines_params *p, struct breaklines *ret, struct err *err)
{
	const struct grid_lines with_places = {.places = 1};
	const struct grid_source own = {.id = p->id, .kind = GRID_LINE_VERTICES, .lines = &with_places};
	char stem[32];
	const struct grid_stage_params stage = {.dirfd = p->dirfd, .name = stem, .memory = GRID_STAGE_MIN, .folder_later = true};
	struct grid_named of[GRID_SOURCE_FILES], (*files)[GRID_SOURCE_FILES] = calloc(p->nlines + 1, sizeof *files);
	const char **names = calloc(p->nlines + 1, sizeof *names);
	struct build *b = calloc(1, sizeof *b);
	struct err ignored = ERR_INIT;
	int r = 0;

	*ret = (struct breaklines){.points = 0};
	grid_source_files(&own, of);
	grid_line_segment(p->id, stem);
	if (!files || !names || !b)
		r = err_set(err, ERR_NOMEM, "no memory for the lines of a dataset");
	for (size_t i = 0; !r && i < p->nlines; i++) {
		grid_source_files(p->lines[i], files[i]);
		names[i] = files[i]->name;
	}
	if (!r)
		r = grid_stage_new(&stage, &b->stage, err);
	if (!r) {
		b->p = p;
		places_begin(&b->places, p->dirfd, of[1].name, err);
		r = build_files(b, names, of[0].name, ret, err);
		places_end(&b->places);
		grid_stage_free(b->stage);
	}
	if (r)
		breaklines_remove(p->dirfd, &own, &ignored);
	free(b);
	free(names);
	free(files);
	return r;
}

void breaklines_put(const struct breaklines *made, uint32_t id, uint64_t added, uint64_t removed, struct grid_manifest *m)
{
	if (made->segment.points)
		m->segments[m->nsegments++] = made->segment;
	m->sources[m->nsources++] = (struct grid_source){
		.id = id,
		.kind = GRID_LINE_VERTICES,
		.added = added,
		.removed = removed,
		.points = made->points,
		.lines = &made->lines,
		.name = "",
		.path = "",
	};
}

/* ---- reading ---- */

static int ignore_vertices(void *ctx, const struct breakline_vertex *v, size_t n, struct err *err)
{
	return 0;
}

static int differs(const char *name, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the file is not the one that the manifest names");
	err_add_file(err, name);
	return err_add_hint(err, "restore it, or push the lines again");
}

static int verify_lines(int dirfd, const struct grid_source *s, const char *name, struct err *err)
{
	struct breakline_totals t;
	int r = breakline_read(dirfd, name, ignore_vertices, NULL, err);

	if (!r)
		r = breakline_totals(dirfd, name, &t, err);
	if (r)
		return r;
	return digest_equal(t.content, s->lines->content) && t.lines == s->lines->lines && t.vertices == s->lines->vertices ?
		       0 :
		       differs(name, err);
}

static int ignore_piece(void *ctx, const struct lineset_piece *piece, struct err *err)
{
	++*(uint64_t *)ctx;
	return 0;
}

/* All pages are read, and so checked. */
static int verify_set(int dirfd, const char *name, struct err *err)
{
	static const int32_t all[4] = {INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX};
	struct lineset *set = NULL;
	uint64_t pieces = 0;
	void *memory;
	int r = lineset_open(dirfd, name, NULL, SET_MEMORY, &set, err);

	if (r)
		return r;
	memory = aligned_alloc(64, (lineset_reader_bytes() + 63) & ~(size_t)63);
	if (memory)
		r = lineset_find(lineset_reader_init(memory, set), all, ignore_piece, &pieces, err);
	else
		r = err_set(err, ERR_NOMEM, "no memory to check a line set");
	if (!r && pieces != lineset_info(set)->pieces)
		r = differs(name, err);
	free(memory);
	lineset_close(set);
	return r;
}

static int verify_places(int dirfd, const struct grid_source *s, struct err *err)
{
	struct breaklines_place page[64];
	uint64_t at = 0;
	size_t n = 0;
	int r = 0;

	while (!r && at < s->lines->places) {
		r = breaklines_places(dirfd, s, at, sizeof page / sizeof *page, page, &n, err);
		at += n;
	}
	return r;
}

int breaklines_verify(int dirfd, const struct grid_source *s, const char *staged, struct err *err)
{
	struct grid_named of[GRID_SOURCE_FILES];
	size_t n = grid_source_files(s, of);
	int r = 0;

	if (staged)
		snprintf(of[0].name, sizeof of[0].name, "%s", staged);
	for (size_t i = 0; !r && i < n; i++) {
		uint64_t bytes = 0;

		r = file_bytes(dirfd, of[i].name, &bytes, err);
		if (!r && bytes != of[i].bytes)
			r = differs(of[i].name, err);
	}
	if (r || !n)
		return r;
	if (s->kind == GRID_LINES)
		return verify_lines(dirfd, s, of[0].name, err);
	r = verify_set(dirfd, of[0].name, err);
	return r ? r : verify_places(dirfd, s, err);
}

int breaklines_places(int dirfd, const struct grid_source *s, uint64_t first, size_t most, struct breaklines_place *ret,
		      size_t *ret_n, struct err *err)
{
	struct grid_named of[GRID_SOURCE_FILES];

	*ret_n = 0;
	if (!s->lines || !s->lines->places)
		return 0;
	grid_source_files(s, of);
	return places_read(dirfd, of[1].name, s->lines->places, first, most, ret, ret_n, err);
}
