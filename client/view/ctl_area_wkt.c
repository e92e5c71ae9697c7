/*
 * Areas from well-known text: POLYGON and MULTIPOLYGON, with or without Z and M (which are read and ignored), one or several
 * in a file. Numbers become exact decimals. SRIDs are not interpreted, and lines and points are refused.
 */
#include <ctype.h>
#include <string.h>
#include <strings.h>

#include "ctl_area.h"
#include "err.h"

struct wkt {
	const char *text, *at, *end;
	struct ctl_area *area;
	struct err *err;
};

static int bad(struct wkt *w, const char *what)
{
	const char *end = w->at;
	unsigned line = 1;

	for (const char *t = w->text; t < w->at; t++)
		line += *t == '\n';
	while (end < w->end && end - w->at < 24 && !isspace((unsigned char)*end) && isprint((unsigned char)*end))
		end++;
	if (w->at == w->end)
		err_set(w->err, ERR_INPUT, "line %u: the text ends where %s should be", line, what);
	else
		err_set(w->err, ERR_INPUT, "line %u: \"%.*s\", where %s should be", line, (int)(end - w->at), w->at, what);
	return err_add_place(w->err, (uint64_t)(w->at - w->text), NULL);
}

static void space(struct wkt *w)
{
	while (w->at < w->end && strchr(" \t\r\n", *w->at) && *w->at)
		w->at++;
}

static bool sign(struct wkt *w, char c)
{
	space(w);
	if (w->at == w->end || *w->at != c)
		return false;
	w->at++;
	return true;
}

static bool word(struct wkt *w, const char *text)
{
	size_t n = strlen(text);

	space(w);
	if ((size_t)(w->end - w->at) < n || strncasecmp(w->at, text, n) || isalnum((unsigned char)w->at[n]))
		return false;
	w->at += n;
	return true;
}

static int number(struct wkt *w, struct decimal *ret)
{
	char text[128];
	size_t n;

	space(w);
	n = strspn(w->at, "+-.0123456789eE");
	if (!n || n >= sizeof(text))
		return bad(w, "a number");
	memcpy(text, w->at, n);
	text[n] = '\0';
	if (!decimal_parse(text, ret)) {
		bad(w, "a number");
		return err_add_hint(w->err, "numbers are decimals of at most 18 digits");
	}
	w->at += n;
	return 0;
}

/* x y, and up to two more that do not matter. */
static int corner(struct wkt *w)
{
	struct decimal d[2], more;
	int r;

	if ((r = number(w, &d[0])) || (r = number(w, &d[1])))
		return r;
	for (int i = 0; i < 2; i++) {
		space(w);
		if (w->at == w->end || *w->at == ',' || *w->at == ')')
			break;
		if ((r = number(w, &more)))
			return r;
	}
	return ctl_area_corner(w->area, d[0], d[1], w->err);
}

static int ring(struct wkt *w, bool shell)
{
	int r;

	if (!sign(w, '('))
		return bad(w, "\"(\", the start of a ring,");
	if ((r = ctl_area_ring(w->area, shell, w->err)))
		return r;
	do {
		if ((r = corner(w)))
			return r;
	} while (sign(w, ','));
	return sign(w, ')') ? 0 : bad(w, "\",\" or \")\"");
}

static int polygon(struct wkt *w)
{
	bool shell = true;
	int r;

	if (word(w, "EMPTY"))
		return 0;
	if (!sign(w, '('))
		return bad(w, "\"(\", the start of a polygon,");
	do {
		if ((r = ring(w, shell)))
			return r;
		shell = false;
	} while (sign(w, ','));
	return sign(w, ')') ? 0 : bad(w, "\",\" or \")\"");
}

static int multipolygon(struct wkt *w)
{
	int r;

	if (word(w, "EMPTY"))
		return 0;
	if (!sign(w, '('))
		return bad(w, "\"(\", the start of a multipolygon,");
	do {
		if ((r = polygon(w)))
			return r;
	} while (sign(w, ','));
	return sign(w, ')') ? 0 : bad(w, "\",\" or \")\"");
}

static void dimensions(struct wkt *w)
{
	if (!word(w, "ZM") && !word(w, "Z"))
		word(w, "M");
}

static int geometry(struct wkt *w)
{
	static const char *const many[] = {"MULTIPOLYGON", "MULTIPOLYGONZ", "MULTIPOLYGONM", "MULTIPOLYGONZM"};
	static const char *const one[] = {"POLYGON", "POLYGONZ", "POLYGONM", "POLYGONZM"};

	for (unsigned i = 0; i < 4; i++) {
		if (word(w, many[i])) {
			dimensions(w);
			return multipolygon(w);
		}
		if (word(w, one[i])) {
			dimensions(w);
			return polygon(w);
		}
	}
	bad(w, "POLYGON or MULTIPOLYGON");
	return err_add_hint(w->err, "an area is polygons as GeoJSON or WKT, in the coordinates of the dataset; --crop also "
				    "takes X1,Y1,X2,Y2");
}

int ctl_area_wkt(const char *text, size_t size, struct ctl_area *area, struct err *err)
{
	struct wkt w = {.text = text, .at = text, .end = text + size, .area = area, .err = err};
	int r;

	if (size >= 3 && !memcmp(text, "\xef\xbb\xbf", 3))
		w.at += 3;
	do {
		if ((r = geometry(&w)))
			return r;
		sign(&w, ';');
		space(&w);
	} while (w.at < w.end);
	return 0;
}
