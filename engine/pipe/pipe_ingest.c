/*
 * Ingest: raw points of an input, on the dataset's lattice, into a stage. Reads batch after batch; keeps
 * nothing but one batch.
 */
#include "pipe.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"

enum { BATCH = 8192 };

struct batch {
	int64_t raw[BATCH][3];
	int32_t at[BATCH][3];
	struct point point[BATCH];
	uint8_t cls[BATCH], ret[BATCH], flags[BATCH];
};

size_t pipe_ingest_bytes(void)
{
	return sizeof(struct batch) + input_bytes() + crs_step_bytes();
}

static void batch_points(struct batch *b, size_t n)
{
	size_t i;

	for (i = 0; i < n; i++)
		b->point[i] = (struct point){
			.x = b->at[i][0],
			.y = b->at[i][1],
			.z = b->at[i][2],
			.cls = b->cls[i],
			.ret = b->ret[i],
			.tag = b->flags[i] & POINT_FLAGS,
		};
}

static int stage_batch(const struct pipe_ingest_params *p, const struct batch *b, size_t n, struct err *err)
{
	int r;

	if (p->lock)
		p->lock(p->guard);
	r = grid_stage_add(p->stage, b->point, n, err);
	if (p->lock)
		p->unlock(p->guard);
	return r;
}

/* From the file's numbers to the lattice's: a map, or a step where that does not do. */
struct way {
	struct lattice_map map;
	struct crs_step *step;
};

static int way_init(struct way *w, const struct input_info *info, const struct pipe_ingest_params *p,
		    struct err *err)
{
	struct crs_step_params step;

	w->step = NULL;
	if (!p->step)
		return lattice_map_init(&w->map, p->lattice, &info->coords, err);
	step = *p->step;
	step.lattice = p->lattice;
	step.coords = &info->coords;
	return crs_step_new(&step, &w->step, err);
}

static int ingest_batches(struct input *input, const struct way *w, const struct pipe_ingest_params *p,
			  struct batch *b, struct pipe_ingested *in, struct err *err)
{
	struct input_points pts = { .raw = b->raw, .cls = b->cls, .ret = b->ret, .flags = b->flags, .cap = BATCH };
	const struct input_info *info = input_info(input);
	size_t bad = 0;
	int r;

	for (;;) {
		r = input_read(input, &pts, err);
		if (r || !pts.n)
			return r ? r : input_dry(input) ? PIPE_E_DRY : 0;
		r = w->step ? crs_step_apply(w->step, (const int64_t (*)[3])b->raw, pts.n, b->at, &bad, err)
			    : lattice_map_apply(&w->map, (const int64_t (*)[3])b->raw, pts.n, b->at, &in->moved,
						in->max_shift, &bad, err);
		if (r) {
			char field[64];

			snprintf(field, sizeof field, "point %llu", (unsigned long long)(info->first_point + in->points + bad));
			return err_add_place(err, ERR_NO_OFFSET, field);
		}
		batch_points(b, pts.n);
		r = stage_batch(p, b, pts.n, err);
		if (r)
			return r;
		in->points += pts.n;
		if (p->progress && p->progress(p->ctx, in->points))
			return err_set(err, ERR_CANCELLED, "cancelled after %llu points", (unsigned long long)in->points);
	}
}

int pipe_ingest(struct input *input, const struct pipe_ingest_params *p, struct pipe_ingested *ret, struct err *err)
{
	const struct input_info *info = input_info(input);
	struct pipe_ingested in = { 0 };
	struct way w;
	struct batch *b;
	int r;

	r = way_init(&w, info, p, err);
	if (r)
		return err_add_file(err, info->coords.name);
	b = malloc(sizeof *b);
	r = b ? ingest_batches(input, &w, p, b, &in, err)
	      : err_set(err, ERR_NOMEM, "no memory to read %s", info->coords.name);
	free(b);
	if (w.step)
		in.shift = crs_step_shift(w.step);
	crs_step_free(w.step);
	if (r < 0)
		return err_add_file(err, info->coords.name);
	in.bytes_read = input_bytes_read(input);
	in.bytes = info->bytes;
	in.partial = info->partial;
	snprintf(in.warning, sizeof in.warning, "%s", info->warning);
	*ret = in;
	return r;
}

void pipe_ingested_add(struct pipe_ingested *sum, const struct pipe_ingested *part)
{
	sum->points += part->points;
	sum->moved += part->moved;
	sum->bytes_read += part->bytes_read;
	sum->bytes = part->bytes;
	sum->partial = part->partial;
	for (int i = 0; i < 3; i++)
		if (part->max_shift[i] > sum->max_shift[i])
			sum->max_shift[i] = part->max_shift[i];
	crs_shift_add(&sum->shift, &part->shift);
	if (!*sum->warning)
		memcpy(sum->warning, part->warning, sizeof sum->warning);
}
