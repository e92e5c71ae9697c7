/*
 * A comparison: two mesh streams, one after the other, then their pairs; or one stream against a level, block by block.
 */
#include "volume.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_axis.h"
#include "volume_priv.h"

struct volume {
	struct volume_options opt;
	struct volume_frame frame;
	struct volume_rows *rows;
	struct volume_images *images;
	struct volume_join *join;
	struct err err;
	struct side {
		struct volume *volume;
		unsigned i;
		bool has_box;
		int32_t box[6]; /* of the vertices, in the frame */
		uint64_t other; /* the job of the other mesh, of changes */
		uint64_t kept;  /* triangles that both have, which do not come */
	} side[2];
	bool by_changes, fail;
	volume_i128 whole; /* twice the area of the second mesh, in squares of its own lattice */
	struct volume_total total;
	double unit; /* of the meshes' in those of the results */
	double range;
};

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for a comparison");
}

/* ---- units ---- */

static const struct unit {
	const char *option, *name, *area, *volume;
	double times; /* of `name` in one */
} units[] = {
	{"m", "metre", "m2", "m3", 1},
	{"ft", "foot", "ft2", "ft3", 1},
	{"ftUS", "us-survey-foot", "ftUS2", "ftUS3", 1},
	{"yd", "foot", "yd2", "yd3", 3},
};

static int choose_unit(struct volume *v, struct err *err)
{
	const char *of = v->opt.side[0].unit_xy;
	int64_t num, den;

	for (size_t i = 0; i < sizeof(units) / sizeof(*units); i++) {
		const struct unit *u = &units[i];

		if (u->times == 1 && !strcmp(of, u->name))
			v->total.unit_mesh = u->option;
		if (v->total.unit || (v->opt.unit ? strcmp(v->opt.unit, u->option) : strcmp(of, u->name)))
			continue;
		if (!format_unit_ratio(of, u->name, &num, &den))
			continue;
		v->unit = (double)num / (double)den / u->times;
		v->total.unit = u->option;
		v->total.unit_area = u->area;
		v->total.unit_volume = u->volume;
	}
	if (v->total.unit)
		return 0;
	return err_set(err, ERR_USAGE, "--unit %s is none of m, ft, ftUS and yd", v->opt.unit);
}

bool volume_length(const char *text, struct decimal *ret, const char **ret_unit)
{
	char number[DECIMAL_TEXT_SIZE];
	size_t n = strlen(text), m = n;

	while (m && ((text[m - 1] | 32) >= 'a' && (text[m - 1] | 32) <= 'z'))
		m--;
	*ret_unit = m < n ? format_unit_of_word(text + m, n - m) : NULL;
	snprintf(number, sizeof(number), "%.*s", (int)m, text);
	return m < sizeof(number) && (m == n || *ret_unit) && decimal_parse(number, ret) && ret->mantissa > 0;
}

/* ---- the stream ---- */

static int pair(void *ctx, const struct volume_triangle *a, const struct volume_triangle *b, const struct volume_polygon *p,
		struct err *err)
{
	struct volume *v = ctx;

	v->total.pairs += memcmp(a, b, sizeof(*a)) != 0;
	return volume_images_pair(v->images, a, b, p, volume_rows_add(v->rows, p), err);
}

static int begin(struct volume *v, const struct acut_mesh_head *head, struct err *err)
{
	const struct volume_call call = {pair, v};
	int32_t corner[2][3];
	int64_t box[4];
	int r = volume_rows_new(&v->frame, &v->opt, &v->rows, err);

	if (!r)
		r = volume_images_head(v->images, &v->frame, head, err);
	for (int i = 0; i < 2 && !r; i++) {
		if (!volume_frame_point(&v->frame, 0, head->box + 3 * i, corner[i]))
			r = err_set(err, ERR_LIMIT, "the mesh does not fit the lattice of both");
		for (int k = 0; k < 2 && !r; k++)
			box[2 * i + k] = corner[i][k];
	}
	if (!r && v->opt.has_level) /* the box is not tight */
		return volume_images_check(v->images, &v->frame,
					   (const int32_t[]){corner[0][0], corner[0][1], 0, corner[1][0], corner[1][1], 0}, 4,
					   err);
	if (r)
		return r;
	return volume_join_new(box, (double)v->opt.side[0].triangles + (double)v->opt.side[1].triangles,
			       volume_images_file(v->images), &call, v->opt.interrupted, v->opt.ctx, &v->join, err);
}

static int take_head(void *ctx, const struct acut_mesh_head *head)
{
	struct side *s = ctx;
	struct volume *v = s->volume;
	int r = volume_frame_head(&v->frame, s->i, head, &v->opt, &v->err);

	return r || s->i ? r : begin(v, head, &v->err);
}

static int against_level(struct volume *v, const struct volume_triangle *t, struct err *err)
{
	struct volume_polygon p;
	struct volume_triangle level = *t;
	volume_i128 area;

	volume_above(t, v->frame.level, v->frame.level_part, &p);
	v->total.pairs++;
	area = volume_rows_add(v->rows, &p);
	for (int i = 0; i < 3; i++) /* images take the level off, which may be between two steps */
		level.at[i][2] = 0;
	return volume_images_pair(v->images, &level, t, &p, area, err);
}

static int outside(const struct side *s, struct err *err)
{
	err_set(err, ERR_LIMIT, "%s does not fit the lattice of both: they are too far apart, or their common step is too fine",
		s->volume->opt.side[s->i].name);
	return err_add_hint(err, "push one of the two again with the --scale of the other");
}

static int take_triangle(struct side *s, const int32_t *a, const int32_t *b, const int32_t *c, struct err *err)
{
	struct volume *v = s->volume;
	struct volume_triangle t;

	if (!volume_frame_point(&v->frame, s->i, a, t.at[0]) || !volume_frame_point(&v->frame, s->i, b, t.at[1]) ||
	    !volume_frame_point(&v->frame, s->i, c, t.at[2]))
		return outside(s, err);
	if (!volume_triangle_normal(&t))
		return 0;
	volume_rows_cover(v->rows, &t, s->i);
	if (v->opt.has_level)
		return against_level(v, &t, err);
	return volume_join_add(v->join, s->i, &t, err);
}

static int take_block(void *ctx, const struct acut_mesh_block *b)
{
	struct side *s = ctx;
	struct volume *v = s->volume;
	int r = 0;

	for (uint32_t i = 0; i < b->ntriangle && !r; i++) {
		const uint32_t *t = b->triangle[i];

		r = take_triangle(s, b->local[t[0]], b->local[t[1]], b->local[t[2]], &v->err);
		if (!(i & 0xffff) && !r && v->opt.interrupted && v->opt.interrupted(v->opt.ctx))
			r = err_set(&v->err, ERR_CANCELLED, "interrupted");
	}
	return r;
}

static void set_digests(struct volume *v, unsigned side, const char *digest, const char *vertex_digest)
{
	snprintf(v->total.digest[side], sizeof(v->total.digest[0]), "%s", digest);
	snprintf(v->total.vertex_digest[side], sizeof(v->total.vertex_digest[0]), "%s", vertex_digest);
}

static int take_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct side *s = ctx;
	struct volume *v = s->volume;

	v->total.triangles[s->i] = tail->triangles + s->kept;
	if (!v->by_changes)
		set_digests(v, s->i, tail->digest, tail->vertex_digest);
	s->has_box = tail->triangles > 0;
	for (int i = 0; i < 2 && s->has_box; i++)
		if (!volume_frame_point(&v->frame, s->i, tail->box + 3 * i, s->box + 3 * i))
			return outside(s, &v->err);
	return 0;
}

struct acut_mesh_sink volume_sink(struct volume *v, unsigned side)
{
	v->side[side].volume = v;
	v->side[side].i = side;
	return (struct acut_mesh_sink){take_head, take_block, take_tail, NULL, &v->side[side]};
}

/* ---- changes, and the area of the rest ---- */

static int take_base(void *ctx, const struct acut_mesh_base *base)
{
	struct side *s = ctx;
	struct volume *v = s->volume;

	v->fail = base->job != s->other || (s->i && base->kept_triangles != v->side[0].kept);
	s->kept = base->kept_triangles;
	set_digests(v, s->i, base->digest, base->vertex_digest);
	return v->fail;
}

static int take_gone(void *ctx, const struct acut_mesh_region *region)
{
	return 0;
}

struct acut_changes_sink volume_changes(struct volume *v, unsigned side, uint64_t job)
{
	struct acut_mesh_sink mesh = volume_sink(v, side);

	v->by_changes = true;
	v->side[side].other = job;
	return (struct acut_changes_sink){mesh, take_base, take_gone};
}

bool volume_changes_fail(const struct volume *v)
{
	return v->fail;
}

static int whole_head(void *ctx, const struct acut_mesh_head *head)
{
	return 0;
}

static int whole_block(void *ctx, const struct acut_mesh_block *b)
{
	struct volume *v = ctx;

	for (uint32_t i = 0; i < b->ntriangle; i++) {
		const uint32_t *t = b->triangle[i];
		const int32_t *p = b->local[t[0]], *q = b->local[t[1]], *o = b->local[t[2]];

		v->whole += (volume_i128)((int64_t)q[0] - p[0]) * ((int64_t)o[1] - p[1]) -
			    (volume_i128)((int64_t)q[1] - p[1]) * ((int64_t)o[0] - p[0]);
	}
	return 0;
}

static int whole_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct volume *v = ctx;
	volume_i128 times = v->frame.times[1][0];

	volume_rows_kept(v->rows, v->whole * times * times);
	return 0;
}

struct acut_mesh_sink volume_whole(struct volume *v)
{
	return (struct acut_mesh_sink){whole_head, whole_block, whole_tail, NULL, v};
}

const struct err *volume_error(const struct volume *v)
{
	return &v->err;
}

/* ---- begin and end ---- */

int volume_new(const struct volume_options *opt, struct volume **ret, struct err *err)
{
	struct volume *v = calloc(1, sizeof(*v));
	int r;

	if (!v)
		return no_memory(err);
	v->opt = *opt;
	v->err = (struct err)ERR_INIT;
	r = volume_frame_init(&v->frame, &v->opt, err);
	if (!r)
		r = choose_unit(v, err);
	if (!r)
		r = volume_images_new(&v->opt, &v->frame, &v->images, err);
	if (r)
		volume_free(v);
	else
		*ret = v;
	return r;
}

/* Where both are. */
static bool common_box(const struct volume *v, int32_t box[6])
{
	const struct side *a = &v->side[0], *b = v->opt.has_level ? a : &v->side[1];

	for (int i = 0; i < 3; i++) {
		box[i] = a->box[i] > b->box[i] ? a->box[i] : b->box[i];
		box[3 + i] = a->box[3 + i] < b->box[3 + i] ? a->box[3 + i] : b->box[3 + i];
	}
	return a->has_box && b->has_box && box[0] <= box[3] && box[1] <= box[4];
}

int volume_finish(struct volume *v, struct err *err)
{
	int32_t box[6];
	bool any = common_box(v, box);
	int r = any ? volume_images_check(v->images, &v->frame, box, 1, err) : 0;

	if (!r && v->join)
		r = volume_join_run(v->join, v->opt.progress, err);
	v->join = volume_join_free(v->join);
	if (!r)
		r = volume_images_finish(v->images, &v->frame, any ? box : NULL, v->unit, &v->range, err);
	return r;
}

void volume_expect(struct volume *v, unsigned side, uint64_t triangles)
{
	v->opt.side[side].triangles = triangles;
}

struct volume *volume_free(struct volume *v)
{
	if (v) {
		volume_join_free(v->join);
		volume_images_free(v->images);
		volume_rows_free(v->rows);
	}
	free(v);
	return NULL;
}

/* ---- results ---- */

size_t volume_results(const struct volume *v)
{
	return v->rows ? volume_rows_count(v->rows) : 0;
}

static double squares(const struct volume *v, volume_i128 parts)
{
	return volume_frame_squares(&v->frame, parts, VOLUME_PART) * v->unit * v->unit;
}

static double cubes(const struct volume *v, volume_i128 parts)
{
	return volume_frame_cubes(&v->frame, parts, VOLUME_PART) * v->unit * v->unit * v->unit;
}

/* What may be none is none. */
static double rest(const struct volume *v, volume_i128 parts, const struct volume_sums *s)
{
	volume_u128 least = (s->area_error >> (VOLUME_ERROR_PART - VOLUME_PART)) + 1;

	return parts <= 0 || (volume_u128)parts <= least ? 0 : squares(v, parts);
}

void volume_result(const struct volume *v, size_t i, struct volume_result *ret)
{
	const struct volume_sums *s = volume_rows_sums(v->rows, i, &ret->name);
	double out = 1 + 0x1p-48; /* for the roundings of these lines */

	ret->fill = cubes(v, s->fill);
	ret->cut = cubes(v, s->cut);
	ret->net = cubes(v, s->fill - s->cut);
	ret->error = volume_frame_cubes(&v->frame, (volume_i128)s->error, VOLUME_ERROR_PART) * v->unit * v->unit * v->unit * out +
		     0x1p-50 * fmax(fabs(ret->fill), fabs(ret->cut));
	ret->area = squares(v, s->shared);
	ret->fill_area = squares(v, s->filled);
	ret->cut_area = squares(v, s->lowered);
	ret->same_area = rest(v, s->shared - s->filled - s->lowered, s);
	for (int k = 0; k < 2; k++)
		ret->only[k] = v->opt.has_level ? 0 : rest(v, s->covered[k] - s->shared, s);
	ret->area_error =
		volume_frame_squares(&v->frame, (volume_i128)s->area_error, VOLUME_ERROR_PART) * v->unit * v->unit * out +
		0x1p-50 * ret->area;
}

void volume_total(const struct volume *v, struct volume_total *ret)
{
	*ret = v->total;
	ret->range = v->range;
}
