/*
 * --changed-since: the regions that are gone and those that are new, as GeoJSON beside the output with the new triangles.
 *
 * A region is a box of circumcentres. A triangle belongs to the region of its circumcentre; on a border its corners decide
 * (geom_cut_side; stream.md, "Changes"). Borders lie halfway between lattice numbers and are written as exact decimals; null
 * is infinite. The polygon of a feature is the part of the region in the box of the dataset, for display. New regions come
 * with the blocks, gone ones before them; facts about the job are at the end, where they are known.
 *
 * With a metric regions are boxes of the mapped plane (u = P x + Q y, v = K (P y - Q x), of coordinates), and circumcentres those
 * of mapped corners. The polygon is mapped back.
 */
#include "outputs_change.h"

#include <stdlib.h>
#include <string.h>

#include "digest.h"
#include "err.h"
#include "outputs_geojson.h"

typedef __int128 i128;

struct outputs_change {
	struct outfile *out; /* NULL: nothing is written */
	struct format_options opt;
	struct outputs_head copy;
	struct acut_mesh_head head; /* of the copy */
	struct decimal half;        /* of the lattice's xy scale */
	int64_t metric[3];          /* P, Q, K; K 0: none */
	char digest[4][DIGEST_HEX_SIZE];
	struct outputs_changes_counts counts;
	bool any;  /* a feature is written */
	bool open; /* a new region is being counted: */
	uint64_t index, triangles;
	int64_t box[4];
	struct digest sum;
};

int outputs_change_new(const struct outfile *out, const char *path, const struct format_options *opt, struct outputs_change **ret,
		       struct err *err)
{
	struct outputs_change *c = calloc(1, sizeof(*c));
	char *name = NULL;
	int r = 0;

	if (!c || (path && asprintf(&name, "%s" OUTPUTS_CHANGES, path) < 0))
		r = err_set(err, ERR_NOMEM, "no memory for changes");
	if (!r && out && !outfile_base(out)) {
		r = err_set(err, ERR_USAGE, "changes need a regular file as output: not standard output, a pipe or a device");
		err_add_file(err, outfile_name(out));
		err_add_hint(err, "give a file, as in -o new.ply");
	}
	if (!r) {
		c->opt = *opt;
		r = name ? outfile_new(name, opt->no_clobber, &c->out, err) : 0;
	}
	free(name);
	if (r) {
		outputs_change_free(c);
		return r;
	}
	*ret = c;
	return 0;
}

struct outputs_change *outputs_change_free(struct outputs_change *c)
{
	if (!c)
		return NULL;
	outfile_free(c->out);
	outputs_head_done(&c->copy);
	free(c);
	return NULL;
}

/* Of a canonical text of a view, which may have none. */
static bool metric_of(const char *view, int64_t ret[3])
{
	const char *at = strstr(view ? view : "", " metric=");
	long long n[3] = {0, 0, 0};

	if (at && (sscanf(at, " metric=%lld,%lld,%lld", &n[0], &n[1], &n[2]) != 3 || n[0] < 0 || n[0] > 10000 || n[1] < -10000 ||
		   n[1] > 10000 || n[2] < 2 || n[2] > 10000 || (!n[0] && !n[1])))
		return false;
	for (int i = 0; i < 3; i++)
		ret[i] = n[i];
	return true;
}

int outputs_change_head(struct outputs_change *c, const struct acut_mesh_head *head, struct err *err)
{
	int r = outputs_head_copy(&c->copy, head, err);

	if (r)
		return r;
	c->head = c->copy.is;
	if (!metric_of(head->view, c->metric))
		return err_set(err, ERR_PROTO, "the metric of the stream's view is none");
	if (!decimal_parse(head->scale_xy, &c->half) || c->half.mantissa <= 0 || c->half.mantissa > INT64_MAX / 5)
		return err_set(err, ERR_PROTO, "the stream's xy scale is not a number above zero");
	c->half.mantissa *= 5;
	c->half.exponent--;
	return 0;
}

/* ---- features ---- */

/* P x + Q y, or K (P y - Q x). */
static i128 mapped(const struct outputs_change *c, unsigned axis, int64_t x, int64_t y)
{
	const int64_t *m = c->metric;

	return axis ? m[2] * ((i128)m[0] * y - (i128)m[1] * x) : (i128)m[0] * x + (i128)m[1] * y;
}

/* A number in halves of the lattice's scale. Far from all that is measured the nearest double will do. */
static const char *coordinate(const struct outputs_change *c, i128 n, char buf[DECIMAL_TEXT_SIZE])
{
	if (n >= INT64_MIN && n <= INT64_MAX)
		return decimal_scaled_text(c->half, (int64_t)n, buf);
	snprintf(buf, DECIMAL_TEXT_SIZE, "%.17g", (double)n * decimal_double(c->half));
	return buf;
}

/* A border, in doubled lattice numbers, or doubled mapped ones. */
static const char *border(const struct outputs_change *c, unsigned side, int64_t n, char buf[DECIMAL_TEXT_SIZE])
{
	const int64_t *k = c->head.k;

	return coordinate(c, n + 2 * (c->metric[2] ? mapped(c, side & 1, k[0], k[1]) : k[side & 1]), buf);
}

/* The box of the dataset, doubled; mapped, the box around it. */
static void bounds(const struct outputs_change *c, int64_t ret[4])
{
	const int32_t *box = c->head.box;

	for (unsigned i = 0; i < 4; i++)
		ret[i] = 2 * (int64_t)box[i < 2 ? i : i + 1];
	for (unsigned i = 0; i < 4 && c->metric[2]; i++)
		for (unsigned axis = 0; axis < 2; axis++) {
			int64_t v = (int64_t)(2 * mapped(c, axis, box[i & 1 ? 3 : 0], box[i & 2 ? 4 : 1]));

			ret[axis] = !i || v < ret[axis] ? v : ret[axis];
			ret[2 + axis] = !i || v > ret[2 + axis] ? v : ret[2 + axis];
		}
}

/* Corner (x, y) of a region, as it is displayed: rounded to half a lattice number if it is mapped back. */
static void corner(const struct outputs_change *c, int64_t x, int64_t y, char text[2][DECIMAL_TEXT_SIZE])
{
	const int64_t *m = c->metric;
	i128 at[2] = {x, y};

	if (m[2]) {
		i128 det = (i128)m[2] * (m[0] * m[0] + m[1] * m[1]);

		at[0] = ((i128)m[2] * m[0] * x - (i128)m[1] * y) / det;
		at[1] = ((i128)m[2] * m[1] * x + (i128)m[0] * y) / det;
	}
	for (unsigned i = 0; i < 2; i++)
		coordinate(c, at[i] + 2 * (i128)c->head.k[i], text[i]);
}

/* The part of a region in the bounds, with the lower left corner first. */
static void polygon(FILE *f, const struct outputs_change *c, const int64_t box[4])
{
	char text[4][2][DECIMAL_TEXT_SIZE];
	int64_t in[4], part[4];

	bounds(c, in);
	for (unsigned i = 0; i < 4; i++) {
		int64_t low = in[i & 1], high = in[2 + (i & 1)];

		part[i] = box[i] < low ? low : box[i] > high ? high : box[i];
	}
	for (unsigned i = 0; i < 4; i++)
		corner(c, part[i == 1 || i == 2 ? 2 : 0], part[i >= 2 ? 3 : 1], text[i]);
	fputs("{\"type\":\"Polygon\",\"coordinates\":[[", f);
	for (unsigned i = 0; i < 5; i++)
		fprintf(f, "%s[%s,%s]", i ? "," : "", text[i % 4][0], text[i % 4][1]);
	fputs("]]}", f);
}

static int feature(struct outputs_change *c, const char *change, const int64_t box[4], uint64_t triangles, const char *digest,
		   struct err *err)
{
	char text[4][DECIMAL_TEXT_SIZE];
	struct outputs_page p;
	int r = c->out ? outputs_page_start(&p, err) : 1;

	if (r)
		return r < 0 ? r : 0;
	fputs(c->any ? ",\n" : "\n", p.f);
	c->any = true;
	fputs("{\"type\":\"Feature\",\"geometry\":", p.f);
	polygon(p.f, c, box);
	fprintf(p.f, ",\"properties\":{\"change\":\"%s\",\"region\":[", change);
	for (unsigned i = 0; i < 4; i++)
		fprintf(p.f, "%s%s", i ? "," : "",
			box[i] == INT64_MIN || box[i] == INT64_MAX ? "null" : border(c, i, box[i], text[i]));
	fprintf(p.f, "],\"triangles\":%llu,\"digest\":\"%s\"}}", (unsigned long long)triangles, digest);
	return outputs_page_end(&p, c->out, err);
}

int outputs_change_base(struct outputs_change *c, const struct acut_mesh_base *b, struct err *err)
{
	const char *const digest[4] = {b->old_digest, b->old_vertex_digest, b->digest, b->vertex_digest};
	struct outputs_page p;
	int r;

	for (unsigned i = 0; i < 4; i++)
		snprintf(c->digest[i], sizeof(c->digest[i]), "%s", digest[i]);
	c->counts = (struct outputs_changes_counts){.since = b->generation,
						    .old_job = b->job,
						    .gone = b->gone,
						    .gone_triangles = b->gone_triangles,
						    .kept = b->kept,
						    .kept_triangles = b->kept_triangles};
	r = c->out ? outputs_page_start(&p, err) : 1;
	if (r)
		return r < 0 ? r : 0;
	fputs("{\"type\":\"FeatureCollection\",\"name\":\"acut-changes\",\n", p.f);
	outputs_geojson_crs(p.f, c->head.crs);
	fputs("\"features\":[", p.f);
	return outputs_page_end(&p, c->out, err);
}

int outputs_change_gone(struct outputs_change *c, const struct acut_mesh_region *g, struct err *err)
{
	return feature(c, "gone", g->box, g->triangles, g->digest, err);
}

int outputs_change_tail(struct outputs_change *c, struct err *err)
{
	char digest[DIGEST_HEX_SIZE];

	if (!c->open)
		return 0;
	c->open = false;
	c->counts.new_regions++;
	c->counts.new_triangles += c->triangles;
	return feature(c, "new", c->box, c->triangles, digest_hex(c->sum, digest), err);
}

/* Pieces of one domain follow each other and are one region. */
int outputs_change_block(struct outputs_change *c, const struct format_block *block, struct err *err)
{
	const struct acut_mesh_block *b = block->mesh;
	int r = c->open && (b->index != c->index || memcmp(b->box, c->box, sizeof(c->box))) ? outputs_change_tail(c, err) : 0;

	if (!c->open) {
		c->index = b->index;
		c->triangles = 0;
		c->sum = (struct digest){0};
		memcpy(c->box, b->box, sizeof(c->box));
	}
	c->open = true;
	c->triangles += b->ntriangle;
	for (uint32_t i = 0; i < b->ntriangle && c->out; i++) {
		uint64_t place[1][3];

		for (int j = 0; j < 3; j++) {
			const int32_t *p = block->position[b->triangle[i][j]];
			place[0][j] = digest_place(p[0], p[1]);
		}
		digest_add_triangles(&c->sum, (const uint64_t(*)[3])place, 1, c->head.k);
	}
	return r;
}

static int foot(struct outputs_change *c, const struct outputs_origin *origin, struct err *err)
{
	const struct outputs_changes_counts *n = &c->counts;
	struct outputs_page p;
	int r = outputs_page_start(&p, err);

	if (r)
		return r;
	fprintf(p.f, "\n],\n\"acut\":{\"version\":1,\"job\":%llu,\"dataset\":", (unsigned long long)origin->job);
	outputs_geojson_text(p.f, origin->dataset);
	fprintf(p.f, ",\"generation\":%llu,\"since\":%llu,\"old_job\":%llu,", (unsigned long long)origin->generation,
		(unsigned long long)n->since, (unsigned long long)n->old_job);
	fprintf(p.f,
		"\"gone\":%llu,\"gone_triangles\":%llu,\"kept\":%llu,\"kept_triangles\":%llu,\"new\":%llu,"
		"\"new_triangles\":%llu,",
		(unsigned long long)n->gone, (unsigned long long)n->gone_triangles, (unsigned long long)n->kept,
		(unsigned long long)n->kept_triangles, (unsigned long long)n->new_regions, (unsigned long long)n->new_triangles);
	fprintf(p.f, "\"old_digest\":\"%s\",\"old_vertex_digest\":\"%s\",\"digest\":\"%s\",\"vertex_digest\":\"%s\",",
		c->digest[0], c->digest[1], c->digest[2], c->digest[3]);
	if (c->metric[2])
		fprintf(p.f, "\"metric\":[%lld,%lld,%lld],", (long long)c->metric[0], (long long)c->metric[1],
			(long long)c->metric[2]);
	outputs_geojson_head(p.f, &c->head, &c->opt);
	fputs("}}\n", p.f);
	return outputs_page_end(&p, c->out, err);
}

int outputs_change_publish(struct outputs_change *c, const struct outputs_origin *origin, uint64_t *bytes, struct err *err)
{
	int r = c->out ? foot(c, origin, err) : 0;

	if (!r && c->out)
		r = outfile_publish(c->out, err);
	if (!r && c->out)
		*bytes += outfile_size(c->out);
	return r;
}

const struct outputs_changes_counts *outputs_change_counts(const struct outputs_change *c)
{
	return &c->counts;
}
