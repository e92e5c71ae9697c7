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
	return sizeof(struct batch) + input_bytes();
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

static int ingest_batches(struct input *input, const struct lattice_map *map, const struct pipe_ingest_params *p,
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
		r = lattice_map_apply(map, (const int64_t (*)[3])b->raw, pts.n, b->at, &in->moved, in->max_shift, &bad,
				      err);
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
	struct lattice_map map;
	struct batch *b;
	int r;

	r = lattice_map_init(&map, p->lattice, &info->coords, err);
	if (r)
		return r;
	b = malloc(sizeof *b);
	if (!b)
		return err_set(err, ERR_NOMEM, "no memory to read %s", info->coords.name);
	r = ingest_batches(input, &map, p, b, &in, err);
	free(b);
	if (r < 0)
		return err_add_file(err, info->coords.name);
	snprintf(in.warning, sizeof in.warning, "%s", info->warning);
	*ret = in;
	return r;
}

void pipe_ingested_add(struct pipe_ingested *sum, const struct pipe_ingested *part)
{
	sum->points += part->points;
	sum->moved += part->moved;
	for (int i = 0; i < 3; i++)
		if (part->max_shift[i] > sum->max_shift[i])
			sum->max_shift[i] = part->max_shift[i];
	if (!*sum->warning)
		memcpy(sum->warning, part->warning, sizeof sum->warning);
}
