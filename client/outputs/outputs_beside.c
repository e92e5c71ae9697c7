/*
 * Small files beside an output: those of its format, as the world file of a picture, and the sidecar, which says in JSON what the
 * output is.
 *
 * They are opened with the output, so that one that exists is refused at once where nothing may be replaced. They are written
 * when everything else is complete and get their names just before the output gets its own: where the output is new, they are its
 * own. An output that is no regular file has none.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outputs_geojson.h"
#include "outputs_priv.h"

#define SIDECAR "+.json"

/* ---- head and tail of the stream ---- */

int outputs_head_copy(struct outputs_head *to, const struct acut_mesh_head *head, struct err *err)
{
	struct acut_mesh_head *h = &to->is;
	const char **text[] = {&h->lattice, &h->scale_xy,  &h->scale_z, &h->crs,      &h->unit_xy, &h->unit_z,
			       &h->view,    &h->stream_id, &h->wkt,     &h->vertical, &h->geoid};

	*h = *head;
	for (unsigned i = 0; i < sizeof(text) / sizeof(text[0]); i++) {
		free(to->text[i]);
		to->text[i] = strdup(*text[i] ? *text[i] : "");
		if (!to->text[i])
			return err_set(err, ERR_NOMEM, "no memory for outputs");
		*text[i] = to->text[i];
	}
	return 0;
}

void outputs_head_done(struct outputs_head *h)
{
	for (unsigned i = 0; i < sizeof(h->text) / sizeof(h->text[0]); i++)
		free(h->text[i]);
	memset(h, 0, sizeof(*h));
}

void outputs_tail_copy(struct outputs_tail *to, const struct acut_mesh_tail *tail)
{
	to->is = *tail;
	snprintf(to->digest, sizeof(to->digest), "%s", tail->digest);
	snprintf(to->vertex_digest, sizeof(to->vertex_digest), "%s", tail->vertex_digest);
	to->is.digest = to->digest;
	to->is.vertex_digest = to->vertex_digest;
	to->is.report = "{}";
}

/* ---- names ---- */

void outputs_beside_name(const char *path, const char *suffix, char *ret, size_t size)
{
	const char *slash = strrchr(path, '/'), *dot = strrchr(slash ? slash : path, '.');
	size_t stem = *suffix == '+' || !dot ? strlen(path) : (size_t)(dot - path);

	snprintf(ret, size, "%.*s%s", (int)stem, path, suffix + (*suffix == '+'));
}

static int open_one(struct outputs_target *t, const char *path, const char *suffix, struct err *err)
{
	size_t size = strlen(path) + strlen(suffix) + 1;
	char *name = malloc(size);
	int r;

	if (!name)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	outputs_beside_name(path, suffix, name, size);
	r = outfile_new(name, t->opt.no_clobber, &t->beside[t->nbeside], err);
	t->nbeside += !r;
	if (!r && t->part)
		r = outfile_hold(t->beside[t->nbeside - 1], t->part, err);
	free(name);
	return r;
}

int outputs_beside_open(struct outputs_target *t, const char *path, struct err *err)
{
	const char *const *suffix = t->format->beside ? t->format->beside(&t->opt) : NULL;
	int r = 0;

	if (!outfile_base(t->out))
		return t->opt.sidecar ? err_set(err, ERR_USAGE, "--sidecar needs an output that is a file") : 0;
	for (; suffix && *suffix && !r; suffix++)
		r = open_one(t, path, *suffix, err);
	return r || !t->opt.sidecar ? r : open_one(t, path, SIDECAR, err);
}

/* ---- the sidecar ---- */

static void put_level(FILE *f, const char *name, struct decimal d, const char *unit)
{
	char number[DECIMAL_TEXT_SIZE];

	fprintf(f, ",\"%s\":%s,\"%s_unit\":", name, decimal_scaled_text(d, 1, number), name);
	outputs_geojson_text(f, unit);
}

static void put_levels(FILE *f, const struct format_options *o)
{
	if (!o->interval.mantissa) {
		fputs(",\"interval\":null,\"interval_unit\":null,\"base\":null,\"base_unit\":null,\"index\":null", f);
		return;
	}
	put_level(f, "interval", o->interval, o->interval_unit);
	put_level(f, "base", o->base, o->base_unit);
	fprintf(f, ",\"index\":%u", o->has_index ? o->index : FORMAT_INDEX_EACH);
}

static void put_simplify(FILE *f, const struct format_options *o)
{
	if (o->simplify.mantissa)
		put_level(f, "simplify", o->simplify, o->simplify_unit);
	else
		fputs(",\"simplify\":null,\"simplify_unit\":null", f);
}

static void put_simplified(FILE *f, const struct outputs_target *t)
{
	struct format_simplified s = {0};

	if (t->opt.simplify.mantissa) {
		s = t->format->simplified(t->writer);
		fprintf(f, ",\n\"simplified\":{\"vertices\":%llu,\"left_out\":%llu}", (unsigned long long)s.vertices,
			(unsigned long long)s.left_out);
	} else {
		fputs(",\n\"simplified\":null", f);
	}
}

static void put_options(FILE *f, const struct outputs_target *t)
{
	static const char *const raster[] = {"elevation", "slope", "hillshade"};
	const struct format_options *o = &t->opt;
	char cell[DECIMAL_TEXT_SIZE];

	fprintf(f, "\"options\":{\"canonical\":%s,\"polyface\":%s,\"z_unit\":", o->canonical ? "true" : "false",
		o->polyface ? "true" : "false");
	outputs_geojson_text(f, o->z_unit);
	if (o->cell.mantissa)
		fprintf(f, ",\"cell\":%s,\"cell_unit\":", decimal_scaled_text(o->cell, 1, cell));
	else
		fputs(",\"cell\":null,\"cell_unit\":", f);
	outputs_geojson_text(f, o->cell_unit);
	fputs(",\"raster\":", f);
	outputs_geojson_text(f, !o->cell.mantissa ? NULL : t->format->kind == FORMAT_PICTURE ? "hillshade" : raster[o->raster]);
	put_levels(f, o);
	put_simplify(f, o);
	fputs("}", f);
}

static void put_mesh(FILE *f, const struct outputs *run, const struct outputs_report *report)
{
	const struct acut_mesh_tail *tail = &run->tail.is;
	char number[DECIMAL_TEXT_SIZE];

	fprintf(f, ",\n\"vertices\":%llu,\"triangles\":%llu,", (unsigned long long)tail->vertices,
		(unsigned long long)(tail->triangles - report->left_out.triangles));
	outputs_geojson_left_out(f, report);
	fputs(",\"trimmed\":", f);
	outputs_geojson_text(f, run->trimmed);
	fprintf(f, ",\n\"digest\":\"%s\",\"vertex_digest\":\"%s\",\"mesh_digest\":\"%s\",\n\"box\":", run->written,
		tail->vertex_digest, tail->digest);
	for (int k = 0; k < 6 && tail->vertices; k++)
		fprintf(f, "%s%s", k ? "," : "[", acut_coordinate_text(&run->head.is, k % 3, tail->box[k], number));
	fputs(tail->vertices ? "]" : "null", f);
}

static void put_text(FILE *f, const char *name, const char *text)
{
	fprintf(f, ",\n\"%s\":", name);
	outputs_geojson_text(f, text);
}

static int sidecar_text(const struct outputs *run, const struct outputs_target *t, char **ret, struct err *err)
{
	struct outputs_report report;
	char *text = NULL;
	size_t size;
	FILE *f = open_memstream(&text, &size);

	if (!f)
		return err_set(err, ERR_NOMEM, "no memory for a sidecar");
	outputs_report(run, &report);
	fputs("{\"acut\":", f);
	outputs_geojson_text(f, ACUT_VERSION);
	fputs(",\"version\":1,\n\"file\":", f);
	outputs_geojson_text(f, outfile_base(t->out));
	fprintf(f, ",\"format\":\"%s\",\"bytes\":%llu,\n\"dataset\":", t->format->name, (unsigned long long)outfile_size(t->out));
	outputs_geojson_text(f, run->origin.dataset);
	fprintf(f, ",\"generation\":%llu,\"job\":%llu,\"view\":", (unsigned long long)run->origin.generation,
		(unsigned long long)run->origin.job);
	outputs_geojson_text(f, run->head.is.view);
	fputs(",\n", f);
	outputs_geojson_head(f, &run->head.is, &t->opt);
	put_text(f, "vertical", run->head.is.vertical);
	put_text(f, "geoid", run->head.is.geoid);
	put_text(f, "wkt", run->head.is.wkt);
	outputs_geojson_origin(f, &run->head.is, &t->opt);
	put_mesh(f, run, &report);
	put_simplified(f, t);
	fputs(",\n", f);
	put_options(f, t);
	fputs("}\n", f);
	if (fclose(f)) {
		free(text);
		return err_set(err, ERR_NOMEM, "no memory for a sidecar");
	}
	*ret = text;
	return 0;
}

/* ---- their contents ---- */

int outputs_beside_write(struct outfile *out, const char *text, struct err *err)
{
	size_t n = strlen(text);
	int r = 0;

	for (size_t at = 0; at < n && !r; at += 65536)
		r = outfile_write(out, text + at, n - at < 65536 ? n - at : 65536, err);
	return r;
}

int outputs_beside_make(const struct outputs *run, struct outputs_target *t, struct err *err)
{
	unsigned kept = 0;

	for (unsigned i = 0, n = t->nbeside; i < n; i++) {
		struct outfile *out = t->beside[i];
		bool sidecar = t->opt.sidecar && i == n - 1;
		char *text = NULL;
		int r = sidecar ? sidecar_text(run, t, &text, err) : t->format->beside_text(t->writer, i, &text, err);

		if (!r && text)
			r = outputs_beside_write(out, text, err);
		free(text);
		if (r)
			return r;
		t->beside[i] = NULL;
		if (text)
			t->beside[kept++] = out;
		else
			outfile_free(out);
	}
	t->nbeside = kept;
	return 0;
}

int outputs_beside_publish(struct outputs_target *t, uint64_t *bytes, struct err *err)
{
	int r = 0;

	for (unsigned i = 0; i < t->nbeside && !r; i++) {
		r = outfile_publish(t->beside[i], err);
		*bytes += outfile_size(t->beside[i]);
	}
	return r;
}
