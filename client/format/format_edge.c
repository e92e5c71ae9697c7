/*
 * --max-edge, and what is known of edge lengths.
 *
 * A triangle is left out if one of its xy edges is longer than the limit: d^2 * scale^2 > limit^2 with
 * everything a decimal, so that limit^2 / scale^2, rounded down, is one whole number to compare d^2 with.
 * Lengths are counted in sixteenths of an octave of d^2: memory does not grow, and the median is right to
 * about two per cent. Each inner edge is seen from both sides; that moves no median of a large mesh.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_priv.h"

typedef unsigned __int128 u128;

static u128 gcd(u128 a, u128 b)
{
	while (b) {
		u128 t = a % b;
		a = b;
		b = t;
	}
	return a;
}

bool format_edge_ratio(struct decimal limit, int64_t num, int64_t den, struct decimal scale, uint64_t *ret_p, uint64_t *ret_q)
{
	u128 p = (u128)limit.mantissa * (u128)num, q = (u128)scale.mantissa * (u128)den, g;
	int32_t e = limit.exponent - scale.exponent;

	for (; e > 0 && p >> 96 == 0; e--)
		p *= 10;
	for (; e < 0 && q >> 96 == 0; e++)
		q *= 10;
	if (e)
		return false;
	g = gcd(p, q);
	p /= g;
	q /= g;
	if (p >> 64 || q >> 64)
		return false;
	*ret_p = (uint64_t)p;
	*ret_q = (uint64_t)q;
	return true;
}

int format_edge_init(struct format_edge *ed, const struct acut_mesh_head *head, const struct format_run_options *opt,
		     struct err *err)
{
	struct decimal scale;
	int64_t num = 1, den = 1;
	uint64_t p, q;

	memset(ed, 0, sizeof(*ed));
	if (!decimal_parse(head->scale_xy, &scale) || scale.mantissa <= 0)
		return err_set(err, ERR_PROTO, "the stream's xy scale is not a number above zero");
	ed->scale = decimal_double(scale);
	snprintf(ed->unit, sizeof(ed->unit), "%s", head->unit_xy && *head->unit_xy ? head->unit_xy : "unknown");
	ed->gather = opt->edges;
	ed->limited = opt->has_max_edge;
	if (!ed->limited)
		return 0;
	if (opt->max_edge.mantissa < 0)
		return err_set(err, ERR_USAGE, "--max-edge is less than zero");
	if (opt->max_edge_unit && !format_unit_ratio(opt->max_edge_unit, head->unit_xy, &num, &den)) {
		err_set(err, ERR_USAGE, "--max-edge is in %s, but the unit of x and y is %.30s", opt->max_edge_unit,
			head->unit_xy && *head->unit_xy ? head->unit_xy : "unknown");
		return err_add_hint(err, "give a bare number in the units of the files, or stage the inputs with "
					 "--assume-units");
	}
	/* the longest edge of all is below 2^33 lattice units */
	if (decimal_double(opt->max_edge) * (double)num / (double)den / ed->scale >= 0x1p34) {
		ed->none_longer = true;
	} else if (format_edge_ratio(opt->max_edge, num, den, scale, &p, &q)) {
		ed->limit = (u128)p * p / ((u128)q * q);
	} else {
		err_set(err, ERR_USAGE, "--max-edge has too many digits beside the scale %s", head->scale_xy);
		return err_add_hint(err, "give --max-edge with fewer decimals");
	}
	return 0;
}

static u128 edge_square(const int32_t *a, const int32_t *b)
{
	int64_t dx = (int64_t)a[0] - b[0], dy = (int64_t)a[1] - b[1];

	return (u128)((__int128)dx * dx) + (u128)((__int128)dy * dy);
}

static void edge_count(struct format_edge *ed, u128 d2)
{
	int i = d2 ? (int)(16 * log2((double)d2)) : 0;

	if (d2 > ed->longest)
		ed->longest = d2;
	ed->bucket[i < FORMAT_EDGE_BUCKETS ? i : FORMAT_EDGE_BUCKETS - 1]++;
	ed->count++;
}

static u128 area2(const int32_t *a, const int32_t *b, const int32_t *c)
{
	__int128 bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1];
	__int128 cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1], s = bx * cy - by * cx;

	return (u128)(s < 0 ? -s : s);
}

int format_edge_block(struct format_edge *ed, const struct acut_mesh_block *b, const int32_t (*pos)[3],
		      struct acut_mesh_block *ret, struct err *err)
{
	uint32_t kept = 0;

	if (b->ntriangle > ed->room) {
		void *grown = realloc(ed->triangle, b->ntriangle * sizeof(*ed->triangle));
		if (!grown)
			return err_set(err, ERR_NOMEM, "no memory for a block of %u triangles", b->ntriangle);
		ed->triangle = grown;
		ed->room = b->ntriangle;
	}
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		const uint32_t *t = b->triangle[i];
		u128 d2[3], most = 0;

		for (int j = 0; j < 3; j++) {
			d2[j] = edge_square(pos[t[j]], pos[t[j == 2 ? 0 : j + 1]]);
			if (d2[j] > most)
				most = d2[j];
		}
		if (ed->limited && !ed->none_longer && most > ed->limit) {
			ed->left_out++;
			ed->left_out_area2 += area2(pos[t[0]], pos[t[1]], pos[t[2]]);
			continue;
		}
		for (int j = 0; j < 3 && ed->gather; j++)
			edge_count(ed, d2[j]);
		memcpy(ed->triangle[kept++], t, sizeof(*ed->triangle));
	}
	*ret = *b;
	ret->triangle = (const uint32_t(*)[3])ed->triangle;
	ret->ntriangle = kept;
	return 0;
}

double format_edge_median(const struct format_edge *ed)
{
	uint64_t seen = 0;

	for (int i = 0; i < FORMAT_EDGE_BUCKETS && ed->count; i++) {
		seen += ed->bucket[i];
		if (2 * seen >= ed->count)
			return sqrt(exp2((i + 0.5) / 16)) * ed->scale;
	}
	return 0;
}

double format_edge_longest(const struct format_edge *ed)
{
	return sqrt((double)ed->longest) * ed->scale;
}

double format_edge_area(const struct format_edge *ed)
{
	int64_t num, den;

	/* Square degrees are no area, and those of an unknown unit nobody knows. */
	if (!format_unit_ratio(ed->unit, "metre", &num, &den))
		return NAN;
	return (double)ed->left_out_area2 / 2 * ed->scale * ed->scale;
}

void format_edge_done(struct format_edge *ed)
{
	free(ed->triangle);
	memset(ed, 0, sizeof(*ed));
}

static void save128(struct packer *p, u128 n)
{
	packer_u64(p, (uint64_t)(n >> 64));
	packer_u64(p, (uint64_t)n);
}

static u128 load128(struct cursor *c)
{
	u128 high = cursor_u64(c);

	return high << 64 | cursor_u64(c);
}

void format_edge_save(const struct format_edge *ed, struct packer *p)
{
	packer_u64(p, ed->left_out);
	save128(p, ed->left_out_area2);
	save128(p, ed->longest);
	packer_u64(p, ed->count);
	for (int i = 0; i < FORMAT_EDGE_BUCKETS; i++)
		packer_u64(p, ed->bucket[i]);
}

void format_edge_load(struct format_edge *ed, struct cursor *c)
{
	ed->left_out = cursor_u64(c);
	ed->left_out_area2 = load128(c);
	ed->longest = load128(c);
	ed->count = cursor_u64(c);
	for (int i = 0; i < FORMAT_EDGE_BUCKETS; i++)
		ed->bucket[i] = cursor_u64(c);
}
