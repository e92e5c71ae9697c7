/*
 * --mask and --erase: leaves out the triangles that lie elsewhere.
 *
 * A triangle is where its centroid is. Polygons are rounded to the lattice, once, as those of --crop and --polygon are. Then
 * everything is exact: the sum of three corners is compared with three times the polygons. A centroid on a border belongs to the
 * area to its right, and on a horizontal border to the one above (area.h): of areas side by side to one, as with tiles. Several
 * files of one option are one area. The same area to --mask and to --erase gives two parts that together are the mesh.
 *
 * The digest of an area is of its polygons as the files have them, in any order: whatever the files are called, and in which of
 * the formats they are.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "area.h"
#include "ctl_area.h"
#include "err.h"
#include "outputs_priv.h"

/* Of a corner from the lattice's offset: three times it is in the range of an area. */
#define FAR ((__int128)1 << 60)

struct file {
	char *name;
	struct ctl_area polygons; /* until the head has come */
};

struct cut {
	struct file *file;
	size_t n;
	struct digest digest;
	char hex[DIGEST_HEX_SIZE];
	struct area *area;
	struct outputs_left left;
};

struct outputs_mask {
	struct cut cut[OUTPUTS_CUTS];
	struct outputs_passed passed;
};

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for the areas of a mesh");
}

struct outputs_mask *outputs_mask_free(struct outputs_mask *m)
{
	for (int k = 0; m && k < OUTPUTS_CUTS; k++) {
		struct cut *c = &m->cut[k];

		for (size_t i = 0; i < c->n; i++) {
			ctl_area_done(&c->file[i].polygons);
			free(c->file[i].name);
		}
		free(c->file);
		area_free(c->area);
	}
	if (m)
		outputs_passed_free(&m->passed);
	free(m);
	return NULL;
}

/* ---- files ---- */

/* Of one polygon: for each ring the number of its corners, and these; the last one is left out if it repeats the first. */
static void add_ring(struct digest_stream *s, const struct ctl_area *a, size_t ring)
{
	size_t first = a->ring[ring].first, end = ring + 1 < a->nring ? a->ring[ring + 1].first : a->ncorner;
	int64_t n;

	if (end > first + 1 && !decimal_compare(a->corner[first][0], a->corner[end - 1][0]) &&
	    !decimal_compare(a->corner[first][1], a->corner[end - 1][1]))
		end--;
	n = (int64_t)(end - first);
	digest_stream_add(s, &n, sizeof(n));
	for (size_t i = first; i < end; i++)
		for (int k = 0; k < 2; k++) {
			const int64_t d[2] = {a->corner[i][k].mantissa, a->corner[i][k].exponent};

			digest_stream_add(s, d, sizeof(d));
		}
}

static int add_digest(struct digest *sum, const struct ctl_area *a, struct err *err)
{
	for (size_t ring = 0; ring < a->nring;) {
		struct digest_stream *s = digest_stream_new();

		if (!s)
			return no_memory(err);
		do
			add_ring(s, a, ring++);
		while (ring < a->nring && !a->ring[ring].shell);
		digest_add(sum, digest_stream_end(s));
		digest_stream_free(s);
	}
	return 0;
}

static int add_file(struct cut *c, const char *name, struct err *err)
{
	struct file *f, *more = realloc(c->file, (c->n + 1) * sizeof(*c->file));
	int r;

	if (!more)
		return no_memory(err);
	c->file = more;
	f = &c->file[c->n];
	*f = (struct file){.name = strdup(name)};
	if (!f->name)
		return no_memory(err);
	c->n++;
	r = ctl_area_read(name, &f->polygons, err);
	if (!r)
		r = add_digest(&c->digest, &f->polygons, err);
	digest_hex(c->digest, c->hex);
	return r;
}

int outputs_mask_add(struct outputs_mask **m, enum outputs_cut cut, const char *file, struct err *err)
{
	if (!*m)
		*m = calloc(1, sizeof(**m));
	return *m ? add_file(&(*m)->cut[cut], file, err) : no_memory(err);
}

const char *outputs_mask_digest(const struct outputs_mask *m, enum outputs_cut cut)
{
	return m ? m->cut[cut].hex : "";
}

struct outputs_left *outputs_mask_left(struct outputs_mask *m, enum outputs_cut cut)
{
	return &m->cut[cut].left;
}

/* ---- the lattice ---- */

/* A file that names no system, or one without a number, is believed to be in that of the dataset. */
static int check_system(const struct file *f, const struct acut_mesh_head *head, struct err *err)
{
	unsigned long of = ctl_area_epsg(&f->polygons);
	unsigned long dataset = head->crs && !strncmp(head->crs, "EPSG:", 5) ? strtoul(head->crs + 5, NULL, 10) : 0;

	if (!of || !dataset || of == dataset)
		return 0;
	err_set(err, ERR_USAGE, "the area is in EPSG:%lu, and the mesh in EPSG:%lu", of, dataset);
	err_add_file(err, f->name);
	return err_add_hint(err, "convert it: ogr2ogr -t_srs EPSG:%lu OUT.geojson FILE", dataset);
}

/* Three times a coordinate in lattice numbers; false: it is too far out. */
static bool place(struct decimal d, struct decimal scale, int64_t k, int64_t *ret)
{
	__int128 at;

	decimal_steps(d.mantissa, d.exponent, 1, 1, scale, ret);
	at = (__int128)*ret - k;
	*ret = (int64_t)(3 * at);
	return at < FAR && at > -FAR;
}

static int add_polygons(struct area *to, const struct file *f, struct decimal scale, const int64_t k[2], struct err *err)
{
	const struct ctl_area *a = &f->polygons;

	for (size_t ring = 0; ring < a->nring; ring++) {
		size_t end = ring + 1 < a->nring ? a->ring[ring + 1].first : a->ncorner;
		int r = area_ring(to, a->ring[ring].shell, err);

		for (size_t i = a->ring[ring].first; i < end && !r; i++) {
			int64_t x, y;

			if (!place(a->corner[i][0], scale, k[0], &x) || !place(a->corner[i][1], scale, k[1], &y)) {
				err_set(err, ERR_USAGE, "the area reaches too far out for the lattice of the dataset");
				err_add_file(err, f->name);
				return err_add_hint(err, "give its corners in the coordinates of the dataset");
			}
			r = area_corner(to, x, y, err);
		}
		if (r)
			return r;
	}
	return 0;
}

static int make_area(struct cut *c, const struct acut_mesh_head *head, struct decimal scale, struct err *err)
{
	int r = 0;

	c->area = area_new(AREA_HALF_OPEN);
	if (!c->area)
		return no_memory(err);
	for (size_t i = 0; i < c->n && !r; i++) {
		r = check_system(&c->file[i], head, err);
		if (!r)
			r = add_polygons(c->area, &c->file[i], scale, head->k, err);
		ctl_area_done(&c->file[i].polygons);
	}
	return r ? r : area_end(c->area, err);
}

int outputs_mask_head(struct outputs_mask *m, const struct acut_mesh_head *head, struct err *err)
{
	struct decimal scale;
	int r = 0;

	if (!decimal_parse(head->scale_xy, &scale) || scale.mantissa <= 0)
		return err_set(err, ERR_PROTO, "the stream's xy scale is not a number above zero");
	for (int k = 0; k < OUTPUTS_CUTS && !r; k++) {
		memcpy(m->cut[k].left.k, head->k, sizeof(m->cut[k].left.k));
		r = m->cut[k].n ? make_area(&m->cut[k], head, scale, err) : 0;
	}
	return r;
}

/* ---- triangles ---- */

/* The cut that leaves the triangle out; OUTPUTS_CUTS: none does. */
static enum outputs_cut cut_of(const struct outputs_mask *m, const int32_t *a, const int32_t *b, const int32_t *c)
{
	int64_t x = (int64_t)a[0] + b[0] + c[0], y = (int64_t)a[1] + b[1] + c[1];
	const struct area *mask = m->cut[OUTPUTS_MASK].area, *erase = m->cut[OUTPUTS_ERASE].area;

	if (mask && !area_has(mask, x, y))
		return OUTPUTS_MASK;
	return erase && area_has(erase, x, y) ? OUTPUTS_ERASE : OUTPUTS_CUTS;
}

int outputs_mask_block(struct outputs_mask *m, const struct acut_mesh_block *b, const int32_t (*pos)[3],
		       struct acut_mesh_block *ret, struct err *err)
{
	if (outputs_passed_begin(&m->passed, b, err))
		return -(int)err->code;
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		const uint32_t *t = b->triangle[i];
		enum outputs_cut cut = cut_of(m, pos[t[0]], pos[t[1]], pos[t[2]]);

		if (cut == OUTPUTS_CUTS)
			outputs_passed_add(&m->passed, b, i);
		else
			outputs_left_add(&m->cut[cut].left, pos[t[0]], pos[t[1]], pos[t[2]]);
	}
	outputs_passed_end(&m->passed, b, ret);
	return 0;
}
