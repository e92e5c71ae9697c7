/*
 * LandXML (1.0 to 2.0): the breaklines and boundaries of surfaces, as PntList3D; a layer is a surface. Its vertices are
 * "northing easting elevation". Contours, plan features and finished surfaces are left out and counted.
 *
 * Model: expat reads the file in pieces and is suspended at the end of each feature, so one feature is held. A document type is
 * refused, so there are no entities to expand; depth and the length of a tag are limited.
 */
#include "lines_priv.h"

#include <expat.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"

enum { PIECE = 1 << 16, DEPTH_MOST = 64, TAG_MOST = 4 << 20, TOKEN = 512 };

struct landxml {
	struct lines *l;
	XML_Parser parser;
	struct lines_crs crs;
	char *wkt;
	struct lines_layer *layer; /* of the surface that is open, */
	unsigned surface;          /* and the depth of it; 0: none is */
	unsigned depth, feature;   /* of the element; of the open feature, 0: there is none */
	bool ready;                /* a feature is complete */
	bool list;                 /* within a PntList3D */
	char token[TOKEN];
	size_t n_token;
	struct decimal vertex[3];
	unsigned n_vertex;
	uint64_t number, fed;
	uint64_t at; /* where the last token begins that was seen */
	bool ended;
	struct err *err;
	int rc;
};

static bool matches(const uint8_t *head, size_t n)
{
	size_t i = n >= 3 && !memcmp(head, "\xef\xbb\xbf", 3) ? 3 : 0;

	while (i < n && lines_is_blank((char)head[i]))
		i++;
	return i < n && head[i] == '<' && (memmem(head, n, "<LandXML", 8) || memmem(head, n, ":LandXML", 8));
}

/* ---- failures ---- */

static void stop(struct landxml *x, int rc)
{
	if (!x->rc)
		x->rc = rc;
	XML_StopParser(x->parser, XML_FALSE);
}

static void bad(struct landxml *x, const char *what)
{
	stop(x, lines_bad(x->l, x->err, XML_GetCurrentLineNumber(x->parser), "%s", what));
}

static const char *attribute(const char **attributes, const char *name)
{
	for (; *attributes; attributes += 2)
		if (!strcmp(attributes[0], name))
			return attributes[1];
	return NULL;
}

/* ---- head ---- */

static void take_system(struct landxml *x, const char **attributes)
{
	static const char *const names[] = {"name", "desc", "horizontalCoordinateSystemName"};
	const char *epsg = attribute(attributes, "epsgCode"), *wkt = attribute(attributes, "ogcWktCode"), *name = NULL;

	for (size_t i = 0; i < 3 && (!name || !*name); i++)
		name = attribute(attributes, names[i]);
	x->crs.from = "CoordinateSystem";
	if (wkt && strlen(wkt) <= LINES_WKT_MOST && strchr(wkt, '[') && !x->wkt) {
		x->wkt = strdup(wkt);
		x->crs.wkt = x->wkt ? x->wkt : "";
		lines_crs_of_wkt(x->crs.wkt, &x->crs);
	}
	if (epsg && strspn(epsg, "0123456789") == strlen(epsg) && strtoul(epsg, NULL, 10) <= 1000000)
		x->crs.epsg = (uint32_t)strtoul(epsg, NULL, 10);
	else if (epsg)
		lines_crs_of_text(epsg, &x->crs);
	if (name && *name)
		lines_utf8(name, strlen(name), x->crs.name, sizeof x->crs.name);
}

static void take_unit(struct landxml *x, const char **attributes)
{
	const char *unit = attribute(attributes, "linearUnit"), *z = attribute(attributes, "elevationUnit");

	if (unit)
		lines_unit_of(unit, x->crs.unit);
	if (z && (!unit || strcmp(z, unit) != 0))
		lines_unit_of(z, x->crs.unit_z);
}

/* ---- features ---- */

static int begin_feature(struct landxml *x, const char *geometry)
{
	struct lines_layer *layer = x->layer;
	int rc = layer ? 0 : lines_layer(x->l, "", &layer, x->err);

	if (rc)
		return rc;
	layer->crs = x->crs;
	lines_begin(x->l, layer, ++x->number, XML_GetCurrentLineNumber(x->parser));
	lines_geometry(x->l, geometry);
	return 0;
}

static void end_feature(struct landxml *x)
{
	lines_end(x->l);
	x->feature = 0;
	x->ready = true;
	XML_StopParser(x->parser, XML_TRUE);
}

static void take_other(struct landxml *x, const char *what)
{
	int rc = begin_feature(x, what);

	if (rc) {
		stop(x, rc);
		return;
	}
	lines_no_line(x->l, what);
	end_feature(x);
}

static void take_feature(struct landxml *x, const char *geometry, const char **attributes)
{
	const char *kind = x->l->has_kind_field ? attribute(attributes, x->l->kind_field) : NULL;
	int rc;

	if (x->feature) {
		bad(x, "a breakline or boundary lies in another");
		return;
	}
	rc = begin_feature(x, geometry);
	if (rc)
		stop(x, rc);
	x->feature = x->depth;
	if (kind)
		lines_kind(x->l, kind, strlen(kind));
}

static void take_surface(struct landxml *x, const char **attributes)
{
	const char *name = attribute(attributes, "name");
	int rc;

	if (x->surface) {
		bad(x, "a surface lies in another");
		return;
	}
	x->surface = x->depth;
	rc = lines_layer(x->l, name ? name : "", &x->layer, x->err);
	if (rc)
		stop(x, rc);
	else
		x->layer->crs = x->crs;
}

/* ---- numbers ---- */

static int take_token(struct landxml *x)
{
	struct decimal v;
	size_t n = x->n_token;

	x->n_token = 0;
	if (!n)
		return 0;
	if (!lines_number(x->token, n, &v))
		return lines_bad(x->l, x->err, XML_GetCurrentLineNumber(x->parser), "\"%.*s\" is no number", n < 40 ? (int)n : 40,
				 x->token);
	x->vertex[x->n_vertex++] = v;
	if (x->n_vertex < 3)
		return 0;
	x->n_vertex = 0;
	v = x->vertex[0]; /* the northing comes first */
	x->vertex[0] = x->vertex[1];
	x->vertex[1] = v;
	return lines_vertex_exact(x->l, x->vertex, x->err);
}

static void on_text(void *ctx, const XML_Char *text, int n)
{
	struct landxml *x = ctx;

	if (!x->list || x->rc)
		return;
	for (int i = 0; i < n; i++) {
		if (lines_is_blank(text[i])) {
			int rc = take_token(x);

			if (rc) {
				stop(x, rc);
				return;
			}
		} else if (x->n_token == TOKEN) {
			bad(x, "a number has more than 512 bytes");
			return;
		} else {
			x->token[x->n_token++] = text[i];
		}
	}
}

static void begin_list(struct landxml *x)
{
	int rc = lines_part(x->l, !strcmp(x->l->f.geometry, "Boundary"), x->err);

	x->list = true;
	x->n_token = 0;
	x->n_vertex = 0;
	if (rc)
		stop(x, rc);
}

static void end_list(struct landxml *x)
{
	int rc = take_token(x);

	x->list = false;
	if (rc)
		stop(x, rc);
	else if (x->n_vertex)
		bad(x, "a PntList3D does not have three numbers for each vertex");
}

/* ---- elements ---- */

static void on_begin(void *ctx, const XML_Char *full, const XML_Char **attributes)
{
	struct landxml *x = ctx;
	const char *colon = strrchr(full, ':'), *name = colon ? colon + 1 : full;

	if (x->rc)
		return;
	if (++x->depth > DEPTH_MOST) {
		bad(x, "elements lie in each other more than 64 deep");
		return;
	}
	if (x->depth == 1 && strcmp(name, "LandXML") != 0)
		bad(x, "the document is no LandXML");
	else if (x->list)
		bad(x, "a list of points has an element in it");
	else if (x->depth == 1 && attribute(attributes, "version"))
		lines_utf8(attribute(attributes, "version"), strlen(attribute(attributes, "version")), x->l->info.variant,
			   sizeof x->l->info.variant);
	else if (!strcmp(name, "Metric") || !strcmp(name, "Imperial"))
		take_unit(x, attributes);
	else if (!strcmp(name, "CoordinateSystem"))
		take_system(x, attributes);
	else if (!strcmp(name, "Surface"))
		take_surface(x, attributes);
	else if (x->feature && !strcmp(name, "PntList3D"))
		begin_list(x);
	else if (x->feature && !strcmp(name, "PntList2D"))
		lines_refuse(x->l, lines_no_z);
	else if (x->surface && (!strcmp(name, "Breakline") || !strcmp(name, "Boundary")))
		take_feature(x, !strcmp(name, "Breakline") ? "Breakline" : "Boundary", attributes);
	else if (x->surface && !x->feature && (!strcmp(name, "Contour") || !strcmp(name, "Definition")))
		take_other(x, !strcmp(name, "Contour") ? "Contour" : "faces of a surface");
	else if (!x->feature && (!strcmp(name, "PlanFeature") || !strcmp(name, "CgPoints")))
		take_other(x, !strcmp(name, "PlanFeature") ? "PlanFeature" : "CgPoints");
}

static void on_end(void *ctx, const XML_Char *full)
{
	struct landxml *x = ctx;

	if (x->rc)
		return;
	if (x->list)
		end_list(x);
	else if (x->feature == x->depth)
		end_feature(x);
	if (x->surface == x->depth) {
		x->surface = 0;
		x->layer = NULL;
	}
	x->depth--;
}

static void on_doctype(void *ctx, const XML_Char *name, const XML_Char *system, const XML_Char *public, int internal)
{
	struct landxml *x = ctx;

	if (x->rc)
		return;
	stop(x,
	     lines_bad(x->l, x->err, XML_GetCurrentLineNumber(x->parser), "it has a document type (DOCTYPE), which is not read"));
}

/* ---- the file ---- */

static int failed(struct landxml *x)
{
	enum XML_Error code = XML_GetErrorCode(x->parser);
	uint64_t line = XML_GetCurrentLineNumber(x->parser);

	if (x->rc)
		return x->rc;
	if (code == XML_ERROR_NO_MEMORY)
		return err_set(x->err, ERR_NOMEM, "no memory for XML");
	if (code == XML_ERROR_UNKNOWN_ENCODING) {
		err_set(x->err, ERR_INPUT, "its encoding is not read");
		return err_add_hint(x->err, "convert it to UTF-8 (iconv), and say so in its first line");
	}
	return lines_bad(x->l, x->err, line, "%s", XML_ErrorString(code));
}

static int feed(struct landxml *x, enum XML_Status *ret)
{
	void *buffer = XML_GetBuffer(x->parser, PIECE);
	int64_t at;
	size_t n = 0;
	int rc;

	if (!buffer)
		return err_set(x->err, ERR_NOMEM, "no memory for XML");
	if (x->fed > x->at + TAG_MOST)
		return lines_bad(x->l, x->err, XML_GetCurrentLineNumber(x->parser), "a tag or comment has more than 4 MiB");
	rc = lines_interrupted(x->l, x->err);
	if (!rc)
		rc = io_read_some(x->l->fd, buffer, PIECE, x->fed, x->l->path, &n, x->err);
	if (rc)
		return rc;
	x->fed += n;
	x->ended = n < PIECE;
	*ret = XML_ParseBuffer(x->parser, (int)n, x->ended);
	/* -1: the parser keeps an incomplete token; newer versions of expat (2.5.0-1+deb12u2, 2.6.0) do that for long tags. It is
	 * also -1 after XML_GetBuffer. */
	at = XML_GetCurrentByteIndex(x->parser);
	x->at = at > (int64_t)x->at ? (uint64_t)at : x->at;
	return 0;
}

static int next_landxml(struct lines *l, bool *ret_more, struct err *err)
{
	struct landxml *x = l->state;
	enum XML_Status status = XML_STATUS_OK;

	x->err = err;
	if (x->ready) {
		x->ready = false;
		status = XML_ResumeParser(x->parser);
	}
	while (status == XML_STATUS_OK && !x->ended) {
		int rc = feed(x, &status);

		if (rc)
			return rc;
	}
	*ret_more = status == XML_STATUS_SUSPENDED && !x->rc;
	return status == XML_STATUS_ERROR || x->rc ? failed(x) : 0;
}

static int open_landxml(struct lines *l, struct err *err)
{
	struct landxml *x = l->state = calloc(1, sizeof *x);

	if (x)
		x->parser = XML_ParserCreate(NULL);
	if (!x || !x->parser)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	x->l = l;
	x->err = err;
	x->crs.wkt = x->crs.from = "";
	XML_SetUserData(x->parser, x);
	XML_SetElementHandler(x->parser, on_begin, on_end);
	XML_SetCharacterDataHandler(x->parser, on_text);
	XML_SetStartDoctypeDeclHandler(x->parser, on_doctype);
	return 0;
}

static void close_landxml(struct lines *l)
{
	struct landxml *x = l->state;

	if (!x)
		return;
	if (x->parser)
		XML_ParserFree(x->parser);
	free(x->wkt);
	free(x);
}

const struct lines_reader lines_landxml_reader = {
	.name = "landxml",
	.title = "LandXML",
	.place = "line",
	.exact = true,
	.matches = matches,
	.open = open_landxml,
	.next = next_landxml,
	.close = close_landxml,
};
