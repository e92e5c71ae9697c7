/*
 * --max-edge, and what is known of edge lengths.
 *
 * A triangle is left out if one of its xy edges is longer than the limit: d^2 * scale^2 > limit^2 with
 * everything a decimal, so that limit^2 / scale^2, rounded down, is one whole number to compare d^2 with.
 * Lengths are counted by d^2 as a double, sixteen buckets from each power of two to the next: memory does not grow, and the
 * median is right to about two per cent. Each inner edge is seen from both sides; that moves no median of a large mesh. The
 * area of triangles is added up by their longest edge, in the same buckets: so what long edges cover is known when the median is.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "digest_pack.h"
#include "err.h"
#include "format_axis.h"
#include "outputs_priv.h"
#include "wide.h"

typedef unsigned __int128 u128;

bool outputs_edge_ratio(struct decimal limit, int64_t num, int64_t den, struct decimal scale, uint64_t *ret_p, uint64_t *ret_q)
{
	u128 p = (u128)limit.mantissa * (u128)num, q = (u128)scale.mantissa * (u128)den, g;
	int32_t e = limit.exponent - scale.exponent;

	for (; e > 0 && p >> 96 == 0; e--)
		p *= 10;
	for (; e < 0 && q >> 96 == 0; e++)
		q *= 10;
	if (e)
		return false;
	g = (u128)wide_gcd((__int128)p, (__int128)q);
	p /= g;
	q /= g;
	if (p >> 64 || q >> 64)
		return false;
	*ret_p = (uint64_t)p;
	*ret_q = (uint64_t)q;
	return true;
}

void outputs_left_add(struct outputs_left *left, const int32_t *a, const int32_t *b, const int32_t *c)
{
	const uint64_t place[1][3] = {{digest_place(a[0], a[1]), digest_place(b[0], b[1]), digest_place(c[0], c[1])}};
	__int128 bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1];
	__int128 cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1], s = bx * cy - by * cx;

	left->triangles++;
	left->area2 += (u128)(s < 0 ? -s : s);
	digest_add_triangles(&left->digest, place, 1, left->k);
}

void outputs_left_sum(struct outputs_left *left, const struct outputs_left *more)
{
	left->triangles += more->triangles;
	left->area2 += more->area2;
	digest_add(&left->digest, more->digest);
}

void outputs_left_save(const struct outputs_left *left, struct packer *p)
{
	packer_u64(p, left->triangles);
	digest_pack(p, left->digest);
	packer_u64(p, (uint64_t)(left->area2 >> 64));
	packer_u64(p, (uint64_t)left->area2);
}

void outputs_left_load(struct outputs_left *left, struct cursor *c)
{
	left->triangles = cursor_u64(c);
	left->digest = digest_unpack(c);
	left->area2 = (u128)cursor_u64(c) << 64;
	left->area2 |= cursor_u64(c);
}

int outputs_limit_init(struct outputs_limit *limit, const struct acut_mesh_head *head, const struct outputs_length *length,
		       const char *option, struct err *err)
{
	struct decimal scale;
	int64_t num = 1, den = 1;
	uint64_t p, q;

	*limit = (struct outputs_limit){.none_longer = false};
	if (!decimal_parse(head->scale_xy, &scale) || scale.mantissa <= 0)
		return err_set(err, ERR_PROTO, "the stream's xy scale is not a number above zero");
	if (length->value.mantissa < 0)
		return err_set(err, ERR_USAGE, "--%s is less than zero", option);
	if (format_unit_xy(option, length->unit, head->unit_xy, &num, &den, err))
		return -(int)err->code;
	/* the longest edge of all is below 2^33 lattice units */
	if (decimal_double(length->value) * (double)num / (double)den / decimal_double(scale) >= 0x1p34) {
		limit->none_longer = true;
	} else if (outputs_edge_ratio(length->value, num, den, scale, &p, &q)) {
		limit->square = (u128)p * p / ((u128)q * q);
	} else {
		err_set(err, ERR_USAGE, "--%s has too many digits beside the scale %s", option, head->scale_xy);
		return err_add_hint(err, "give --%s with fewer decimals", option);
	}
	return 0;
}

int outputs_edge_init(struct outputs_edge *ed, const struct acut_mesh_head *head, const struct outputs_options *opt,
		      struct err *err)
{
	struct decimal scale;

	memset(ed, 0, sizeof(*ed));
	if (!decimal_parse(head->scale_xy, &scale) || scale.mantissa <= 0)
		return err_set(err, ERR_PROTO, "the stream's xy scale is not a number above zero");
	ed->scale = decimal_double(scale);
	snprintf(ed->unit, sizeof(ed->unit), "%s", head->unit_xy && *head->unit_xy ? head->unit_xy : "unknown");
	memcpy(ed->left.k, head->k, sizeof(ed->left.k));
	ed->gather = opt->edges;
	ed->limited = opt->max_edge.given;
	return ed->limited ? outputs_limit_init(&ed->limit, head, &opt->max_edge, "max-edge", err) : 0;
}

u128 outputs_edge_square(const int32_t *a, const int32_t *b)
{
	int64_t dx = (int64_t)a[0] - b[0], dy = (int64_t)a[1] - b[1];

	return (u128)((__int128)dx * dx) + (u128)((__int128)dy * dy);
}

/* d^2 is below 2^67. It is at least 1 in a mesh, whose corners differ; a stream may be no mesh. */
static unsigned bucket_of(double d2)
{
	uint64_t bits;

	if (d2 < 1)
		return 0;
	memcpy(&bits, &d2, sizeof(bits));
	return (unsigned)(bits >> 48) - (1023 << 4);
}

/* The least d^2 of a bucket. */
static double bucket_from(int i)
{
	return ldexp(1 + i % 16 / 16.0, i / 16);
}

static void gather(struct outputs_edge *ed, const int32_t *a, const int32_t *b, const int32_t *c)
{
	double ux = (double)b[0] - a[0], uy = (double)b[1] - a[1], vx = (double)c[0] - a[0], vy = (double)c[1] - a[1];
	double wx = vx - ux, wy = vy - uy, d2[3] = {ux * ux + uy * uy, vx * vx + vy * vy, wx * wx + wy * wy}, most = d2[0];

	for (int j = 0; j < 3; j++) {
		most = d2[j] > most ? d2[j] : most;
		ed->bucket[bucket_of(d2[j])]++;
	}
	ed->longest = most > ed->longest ? most : ed->longest;
	ed->area[bucket_of(most)] += fabs(ux * vy - uy * vx) / 2;
	ed->count += 3;
}

static void gather_all(struct outputs_edge *ed, const uint32_t (*triangle)[3], uint32_t n, const int32_t (*pos)[3])
{
	for (uint32_t i = 0; i < n; i++)
		gather(ed, pos[triangle[i][0]], pos[triangle[i][1]], pos[triangle[i][2]]);
}

/* *ret is the block without triangles that have edges longer than the limit. */
static int leave_out(struct outputs_edge *ed, const struct acut_mesh_block *b, const int32_t (*pos)[3],
		     struct acut_mesh_block *ret, struct err *err)
{
	if (outputs_passed_begin(&ed->passed, b, err))
		return -(int)err->code;
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		const uint32_t *t = b->triangle[i];
		u128 d2, most = 0;

		for (int j = 0; j < 3; j++) {
			d2 = outputs_edge_square(pos[t[j]], pos[t[j == 2 ? 0 : j + 1]]);
			if (d2 > most)
				most = d2;
		}
		if (most > ed->limit.square) {
			outputs_left_add(&ed->left, pos[t[0]], pos[t[1]], pos[t[2]]);
			continue;
		}
		outputs_passed_add(&ed->passed, b, i);
	}
	outputs_passed_end(&ed->passed, b, ret);
	return 0;
}

int outputs_edge_block(struct outputs_edge *ed, const struct acut_mesh_block *b, const int32_t (*pos)[3],
		       struct acut_mesh_block *ret, struct err *err)
{
	int r = 0;

	*ret = *b;
	if (ed->limited && !ed->limit.none_longer)
		r = leave_out(ed, b, pos, ret, err);
	if (!r && ed->gather)
		gather_all(ed, ret->triangle, ret->ntriangle, pos);
	return r;
}

double outputs_edge_median(const struct outputs_edge *ed)
{
	uint64_t seen = 0;

	for (int i = 0; i < OUTPUTS_EDGE_BUCKETS && ed->count; i++) {
		seen += ed->bucket[i];
		if (2 * seen >= ed->count)
			return sqrt((bucket_from(i) + bucket_from(i + 1)) / 2) * ed->scale;
	}
	return 0;
}

double outputs_edge_longest(const struct outputs_edge *ed)
{
	return sqrt(ed->longest) * ed->scale;
}

double outputs_edge_share(const struct outputs_edge *ed, double length)
{
	double d2 = (length / ed->scale) * (length / ed->scale), longer = 0, all = 0;

	for (int i = 0; i < OUTPUTS_EDGE_BUCKETS; i++) {
		all += ed->area[i];
		longer += bucket_from(i) >= d2 ? ed->area[i] : 0;
	}
	return all > 0 ? longer / all : 0;
}

double outputs_edge_area(const struct outputs_edge *ed, u128 area2)
{
	int64_t num, den;

	/* Square degrees are not an area, and the unit may be unknown. */
	if (!format_unit_ratio(ed->unit, "metre", &num, &den))
		return NAN;
	return (double)area2 / 2 * ed->scale * ed->scale;
}

void outputs_edge_done(struct outputs_edge *ed)
{
	outputs_passed_free(&ed->passed);
	memset(ed, 0, sizeof(*ed));
}

void outputs_edge_save(const struct outputs_edge *ed, struct packer *p)
{
	outputs_left_save(&ed->left, p);
	packer_f64(p, ed->longest);
	packer_u64(p, ed->count);
	for (int i = 0; i < OUTPUTS_EDGE_BUCKETS; i++)
		packer_u64(p, ed->bucket[i]);
	for (int i = 0; i < OUTPUTS_EDGE_BUCKETS; i++)
		packer_f64(p, ed->area[i]);
}

void outputs_edge_add(struct outputs_edge *ed, struct cursor *c)
{
	struct outputs_left left;
	double longest;

	outputs_left_load(&left, c);
	outputs_left_sum(&ed->left, &left);
	longest = cursor_f64(c);
	ed->longest = longest > ed->longest ? longest : ed->longest;
	ed->count += cursor_u64(c);
	for (int i = 0; i < OUTPUTS_EDGE_BUCKETS; i++)
		ed->bucket[i] += cursor_u64(c);
	for (int i = 0; i < OUTPUTS_EDGE_BUCKETS; i++)
		ed->area[i] += cursor_f64(c);
}
