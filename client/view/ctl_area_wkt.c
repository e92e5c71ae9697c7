/*
 * Areas from well-known text: POLYGON and MULTIPOLYGON, with or without Z and M (which are read and ignored), one or several
 * in a file. Numbers become exact decimals. SRIDs are not interpreted, and lines and points are refused.
 */
#include <ctype.h>
#include <inttypes.h>
#include <string.h>
#include <strings.h>

#include "ctl_area.h"
#include "err.h"
#include "text_source.h"

enum { WORD = 24, SHOWN = 24 };

/* A place to return to. */
struct place {
	uint64_t at, line;
};

struct wkt {
	struct text_source *source;
	struct place word_at;
	char word[WORD]; /* the next one, in small letters, that is taken from the source but not used; "": none */
	struct ctl_area *area;
	struct err *err;
};

static struct place here(const struct wkt *w)
{
	return (struct place){text_source_at(w->source), w->source->line};
}

/* What stands at the place, where `what` should be. */
static int bad_at(struct wkt *w, struct place p, const char *what)
{
	char text[SHOWN + 1];
	size_t n = 0;
	int c;

	text_source_seek(w->source, p.at, p.line);
	while (n < SHOWN && (c = text_source_take(w->source)) > ' ' && c < 0x7f)
		text[n++] = (char)c;
	text[n] = '\0';
	if (w->source->rc)
		return w->source->rc;
	if (!n && c < 0)
		err_set(w->err, ERR_INPUT, "line %" PRIu64 ": the text ends where %s should be", p.line, what);
	else
		err_set(w->err, ERR_INPUT, "line %" PRIu64 ": \"%s\", where %s should be", p.line, text, what);
	return err_add_place(w->err, p.at, NULL);
}

static void space(struct wkt *w)
{
	int c;

	while ((c = text_source_peek(w->source)) == ' ' || c == '\t' || c == '\r' || c == '\n')
		text_source_take(w->source);
}

static int bad(struct wkt *w, const char *what)
{
	if (*w->word)
		return bad_at(w, w->word_at, what);
	space(w);
	return bad_at(w, here(w), what);
}

static bool sign(struct wkt *w, char c)
{
	if (*w->word)
		return false;
	space(w);
	if (text_source_peek(w->source) != c)
		return false;
	text_source_take(w->source);
	return true;
}

/* Takes the word. */
static bool word(struct wkt *w, const char *text)
{
	size_t n = 0;

	if (!*w->word) {
		space(w);
		w->word_at = here(w);
		for (int c; (c = text_source_peek(w->source)) >= 0 && isalnum(c) && n + 1 < WORD; text_source_take(w->source))
			w->word[n++] = (char)c;
		w->word[n] = '\0';
	}
	if (strcasecmp(w->word, text) != 0)
		return false;
	*w->word = '\0';
	return true;
}

static int number(struct wkt *w, struct decimal *ret)
{
	char text[128];
	size_t n = 0;
	struct place from;
	int c;

	if (*w->word)
		return bad(w, "a number");
	space(w);
	from = here(w);
	while ((c = text_source_peek(w->source)) > 0 && strchr("+-.0123456789eE", c) && n + 1 < sizeof(text))
		text[n++] = (char)text_source_take(w->source);
	text[n] = '\0';
	if (!n || n + 1 == sizeof(text))
		return bad_at(w, from, "a number");
	if (!decimal_parse(text, ret)) {
		bad_at(w, from, "a number");
		return err_add_hint(w->err, "numbers are decimals of at most 18 digits");
	}
	return 0;
}

/* x y, and up to two more that do not matter. */
static int corner(struct wkt *w, bool first)
{
	struct decimal d[2], more;
	int r;

	if ((r = number(w, &d[0])) || (r = number(w, &d[1])))
		return r;
	for (int i = 0; i < 2; i++) {
		int c;

		space(w);
		c = text_source_peek(w->source);
		if (c < 0 || c == ',' || c == ')')
			break;
		if ((r = number(w, &more)))
			return r;
	}
	return ctl_area_corner(w->area, d[0], d[1], w->err);
}

/* "(", one or more with commas between them, ")". */
static int list(struct wkt *w, const char *start, int (*each)(struct wkt *, bool first))
{
	bool first = true;
	int r;

	if (!sign(w, '('))
		return bad(w, start);
	do {
		if ((r = each(w, first)))
			return r;
		first = false;
	} while (sign(w, ','));
	return sign(w, ')') ? 0 : bad(w, "\",\" or \")\"");
}

static int ring(struct wkt *w, bool shell)
{
	int r = ctl_area_ring(w->area, shell, w->err);

	return r ? r : list(w, "\"(\", the start of a ring,", corner);
}

static int polygon(struct wkt *w, bool first)
{
	return word(w, "EMPTY") ? 0 : list(w, "\"(\", the start of a polygon,", ring);
}

static int multipolygon(struct wkt *w)
{
	return word(w, "EMPTY") ? 0 : list(w, "\"(\", the start of a multipolygon,", polygon);
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
			return polygon(w, true);
		}
	}
	bad(w, "POLYGON or MULTIPOLYGON");
	return err_add_hint(w->err, "an area is polygons as GeoJSON or WKT, in the coordinates of the dataset; --crop also "
				    "takes X1,Y1,X2,Y2");
}

int ctl_area_wkt(struct text_source *source, struct ctl_area *area, struct err *err)
{
	struct wkt w = {.source = source, .area = area, .err = err};
	int r;

	do {
		if ((r = ctl_area_feature(area, err)) || (r = geometry(&w)))
			return r;
		sign(&w, ';');
		space(&w);
	} while (*w.word || text_source_peek(source) >= 0);
	return source->rc;
}
