/* The chosen points as one segment, and the result with its report. */
#include <stdlib.h>

#include "align.h"
#include "err.h"
#include "simplify_priv.h"
#include "simplify_round.h"

struct rewrite {
	struct simplify_stage to;
	struct simplify_sink sink;
};

static int add_point(void *ctx, const struct point *p, struct err *err)
{
	struct rewrite *w = ctx;

	return simplify_stage_add(&w->to, p, err);
}

static int rewrite(const struct simplify *s, const struct grid *grid, struct rewrite *w, const char *name, bool temporary,
		   struct grid_segment_info *ret, struct err *err)
{
	size_t reader_bytes = grid_reader_bytes(grid);
	struct grid_reader *reader;
	void *memory = malloc(reader_bytes);
	int r;

	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory to read the points chosen");
	simplify_sink_init(&w->sink, s, &s->rest);
	w->sink.ctx = w;
	w->sink.point = add_point;
	r = simplify_stage_begin(&w->to, s, name, temporary, s->p.memory / 2, err);
	if (!r)
		r = grid_reader_new(grid, memory, reader_bytes, &reader, err);
	if (!r) {
		r = simplify_scan(&w->sink, reader, 0, UINT64_MAX, err);
		grid_reader_free(reader);
	}
	if (!r)
		r = simplify_stage_end(&w->to, ret, err);
	simplify_stage_abort(&w->to);
	free(memory);
	return r;
}

int simplify_rewrite(const struct simplify *s, const char *manifest, const char *name, bool temporary,
		     struct grid_segment_info *ret, struct err *err)
{
	struct rewrite *w = malloc(sizeof *w);
	struct grid *grid = NULL;
	int r;

	if (!w)
		return err_set(err, ERR_NOMEM, "no memory to read the points chosen");
	r = simplify_grid(s, manifest, &grid, err);
	if (!r)
		r = rewrite(s, grid, w, name, temporary, ret, err);
	grid_close(grid);
	free(w);
	return r;
}

static int read_removed(const struct simplify *s, uint64_t ret[VIEW_RULES], struct err *err)
{
	struct simplify_in in;
	size_t n = 0;
	int r = simplify_in_begin(&in, s->p.dirfd, "removed", sizeof *ret, err);

	if (r)
		return r;
	r = simplify_in_read(&in, ret, VIEW_RULES, &n, err);
	simplify_in_end(&in);
	return !r && n != VIEW_RULES ? err_set(err, ERR_CORRUPT, "a file of a simplification is damaged") : r;
}

int simplify_finish(const struct simplify *s, const char *manifest, const struct simplify_where *where, struct err *err)
{
	struct simplify_report report = {
		.points = where->points,
		.lines = where->lines,
		.hull = where->hull,
		.seeds = where->seeds,
		.rounds = where->rounds,
		.tested = where->tested,
		.attempts = where->attempt + 1,
		.max_error = (int64_t)where->error,
		.largest = where->far,
		.records = where->records,
	};
	struct grid_segment_info segment;
	int r = read_removed(s, report.removed, err);

	if (!r)
		r = simplify_rewrite(s, manifest, "simplified", false, &segment, err);
	if (r)
		return r;
	report.kept = segment.points;
	r = simplify_report_write(s->p.dirfd, &report, err);
	return r ? r : simplify_manifest(s, SIMPLIFY_MANIFEST, &segment, 1, where->lines, err);
}
