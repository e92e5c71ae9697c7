/*
 * Lines in a push: files of lines are staged, and the commit makes the line set of all lines that the dataset has then.
 *
 * The model: lines are staged as files beside the runs (breaklines.h). A commit that adds or replaces lines takes the memory for
 * its line set out of the memory of the stage: the stage is parked, and comes back smaller. If that was too little, and more may
 * be had, the commit starts again. The line vertices are a source with a segment of their own, which takes the place of the one
 * before.
 */
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"

/* ---- files ---- */

int push_lines_begin(struct push *p, struct push_request *rq, struct pipe_ingest_params *params)
{
	char name[64];
	int r = push_row_wait(p, &rq->err);

	p->lines.staged = true;
	breaklines_staged_name(p->stem, rq->source, name);
	if (!r)
		r = breakline_writer_new(p->dataset->dirfd, name, &params->lines, &rq->err);
	params->unit_xy = p->agree.unit_xy;
	return r;
}

int push_lines_end(struct push *p, struct push_request *rq, struct breakline_writer *w, int r)
{
	struct breakline_totals totals;
	char name[64];

	breaklines_staged_name(p->stem, rq->source, name);
	if (!r)
		r = breakline_writer_finish(w, &totals, &rq->err);
	breakline_writer_free(w);
	if (!r && !(rq->lines = calloc(1, sizeof *rq->lines)))
		r = err_set(&rq->err, ERR_NOMEM, "no memory for a file of lines");
	if (!r)
		r = breaklines_described(p->dataset->dirfd, name, &totals, &rq->lines->lines, &rq->err);
	return r;
}

void push_lines_source(struct push *p, struct push_request *rq, struct grid_source *s)
{
	struct push_lines_file *f = rq->lines;

	if (!f)
		return;
	rq->lines = NULL;
	f->next = p->lines.files;
	p->lines.files = f;
	s->kind = GRID_LINES;
	s->lines = &f->lines;
	s->points = 0;
}

void push_lines_free(struct push *p)
{
	struct push_lines_file *f;

	while ((f = p->lines.files)) {
		p->lines.files = f->next;
		free(f);
	}
}

/* ---- what a commit changes ---- */

static bool is_replaced(const struct push *p, const struct grid_source *s)
{
	for (size_t i = 0; i < p->nreplaced; i++)
		if (p->replaced[i] == s->id)
			return true;
	return false;
}

static void count_lines(const struct push *p, const struct grid_source *s, uint64_t *n)
{
	*n += s->kind == GRID_LINES ? 1 : 0;
}

bool push_lines_change(const struct push *p)
{
	uint64_t n = 0;

	for (size_t i = 0; i < p->nsources; i++)
		count_lines(p, &p->sources[i], &n);
	for (size_t i = 0; p->adopt && i < p->adopt->nsources; i++)
		if (p->adopt_named[i])
			count_lines(p, &p->adopt->sources[i], &n);
	for (size_t i = 0; p->nreplaced && p->base && i < p->base->nsources; i++)
		if (is_replaced(p, &p->base->sources[i]))
			count_lines(p, &p->base->sources[i], &n);
	return n > 0;
}

/* The lines that are live after the commit. `ret` has room for all sources; NULL: they are only counted. */
static size_t lines_after(const struct push *p, const struct grid_source **ret, uint64_t *ret_vertices)
{
	size_t n = 0;

	*ret_vertices = 0;
	for (unsigned of = 0; of < 3; of++) {
		const struct grid_source *s = of == 0 ? (p->base ? p->base->sources : NULL) :
					      of == 1 ? (p->adopt ? p->adopt->sources : NULL) :
							p->sources;
		size_t all = of == 0 ? (p->base ? p->base->nsources : 0) :
			     of == 1 ? (p->adopt ? p->adopt->nsources : 0) :
				       p->nsources;

		for (size_t i = 0; i < all; i++) {
			if (s[i].kind != GRID_LINES || (of == 0 && (s[i].removed || is_replaced(p, &s[i]))) ||
			    (of == 1 && !p->adopt_named[i]))
				continue;
			*ret_vertices += s[i].lines->vertices;
			if (ret)
				ret[n] = &s[i];
			n++;
		}
	}
	return n;
}

/* ---- memory ---- */

/* As much as it most likely takes, or as can be had. What else the stage needs, for the plan of a mesh beside it, too. */
static uint64_t first_bytes(const struct push *p)
{
	uint64_t vertices, want, all = admission_alone_bytes(p->pushes->admission),
				 rest = GRID_STAGE_MIN + p->read_bytes + push_kept_bytes(p) + admission_plan_min();

	lines_after(p, NULL, &vertices);
	want = breaklines_memory(vertices);
	return want + rest <= all || all < rest + breaklines_memory(0) ? want : all - rest;
}

bool push_lines_need_memory(struct push *p)
{
	if (!push_lines_change(p))
		return false;
	if (!p->lines.want)
		p->lines.want = first_bytes(p);
	return p->stage && p->lines.have < p->lines.want;
}

bool push_lines_again(struct push *p, const struct err *why)
{
	if (!p->stage || !p->lines.want || why->code != ERR_LIMIT || why->need <= p->lines.have)
		return false;
	p->lines.want = why->need;
	return true;
}

/* ---- the commit ---- */

static int publish(struct push *p, const struct grid_source *const *lines, size_t n, struct err *err)
{
	int r = 0;

	for (size_t i = 0; !r && i < n; i++)
		if (!p->base || lines[i] < p->base->sources || lines[i] >= p->base->sources + p->base->nsources)
			r = breaklines_publish(p->dataset->dirfd, p->stem, lines[i], err);
	return r;
}

/* Worker. With the newest manifest in p->base, and what is not committed dropped from the stage. */
int push_lines_build(struct push *p, struct err *err)
{
	size_t all = p->nsources + (p->base ? p->base->nsources : 0) + (p->adopt ? p->adopt->nsources : 0);
	const struct grid_source **lines;
	struct breaklines_params params = {
		.dirfd = p->dataset->dirfd,
		.id = p->lines.id,
		.memory = p->lines.have,
		.lattice = &p->agree.lattice,
		.strict = p->strict,
	};
	uint64_t vertices;
	int r = 0;

	if (!p->lines.id)
		return 0;
	lines = calloc(all + 1, sizeof *lines);
	if (!lines)
		return err_set(err, ERR_NOMEM, "no memory for the lines of a dataset");
	params.lines = lines;
	params.nlines = lines_after(p, lines, &vertices);
	if (params.nlines && !push_space_staged(p, 3 * vertices)) {
		*err = *push_space_full(p);
		r = -(int)err->code;
	}
	p->lines.published = true;
	if (!r)
		r = publish(p, lines, params.nlines, err);
	if (!r && params.nlines)
		r = breaklines_build(&params, &p->lines.made, err);
	p->lines.built = !r && params.nlines;
	free(lines);
	return r;
}

/* Worker, in the next manifest, which has the other sources and segments. There is room for one more of each. */
void push_lines_put(struct push *p, struct grid_manifest *m)
{
	if (!p->lines.id)
		return;
	for (size_t i = 0; i < m->nsources; i++)
		if (m->sources[i].kind == GRID_LINE_VERTICES && !m->sources[i].removed)
			m->sources[i].removed = m->generation;
	if (!p->lines.built)
		return;
	breaklines_put(&p->lines.made, p->lines.id, m->generation, 0, m);
}

/* Worker: the commit failed, and the catalogue does not name these files. */
void push_lines_undo(struct push *p)
{
	const struct grid_source set = {.id = p->lines.id, .kind = GRID_LINE_VERTICES};
	struct err err = ERR_INIT;
	int r = p->lines.id ? breaklines_remove(p->dataset->dirfd, &set, &err) : 0;

	p->lines.built = false;
	for (size_t i = 0; !r && p->lines.published && i < p->nsources; i++)
		r = breaklines_remove(p->dataset->dirfd, &p->sources[i], &err);
	for (size_t i = 0; !r && p->lines.published && p->adopt && i < p->adopt->nsources; i++)
		if (p->adopt_named[i])
			r = breaklines_remove(p->dataset->dirfd, &p->adopt->sources[i], &err);
	p->lines.published = false;
	if (r)
		dataset_left(p->dataset, &err);
}
