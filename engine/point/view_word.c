/*
 * Words of the texts of views (view_word.h). Strict: there is exactly one spelling.
 */
#include "view_word.h"

#include <string.h>

#include "parse.h"

bool view_word_is(struct view_word w, const char *text)
{
	return w.n == strlen(text) && memcmp(w.at, text, w.n) == 0;
}

bool view_word_after(struct view_word *w, const char *before)
{
	size_t n = strlen(before);

	if (w->n < n || memcmp(w->at, before, n) != 0)
		return false;
	w->at += n;
	w->n -= n;
	return true;
}

bool view_word_part(struct view_word *w, char end, struct view_word *ret)
{
	const char *at = w->n ? memchr(w->at, end, w->n) : NULL;

	if (!w->n)
		return false;
	*ret = (struct view_word){w->at, at ? (size_t)(at - w->at) : w->n};
	w->at += ret->n + (at != NULL);
	w->n -= ret->n + (at != NULL);
	return true;
}

enum { NUMBER_SIZE = 24 };

/* A zero-terminated copy; false if it is too long or its beginning is not that of a canonical number. */
static bool number_text(struct view_word w, char buf[NUMBER_SIZE])
{
	bool minus = w.n && *w.at == '-';

	if (w.n <= minus || w.n >= NUMBER_SIZE || w.at[minus] < '0' || w.at[minus] > '9')
		return false;
	if (w.at[minus] == '0' && (minus || w.n > 1))
		return false;
	memcpy(buf, w.at, w.n);
	buf[w.n] = '\0';
	return true;
}

static bool number_u64(struct view_word w, uint64_t *ret)
{
	char text[NUMBER_SIZE];

	return number_text(w, text) && parse_u64(text, ret);
}

bool view_word_i64(struct view_word w, int64_t *ret)
{
	char text[NUMBER_SIZE];

	return number_text(w, text) && parse_i64(text, ret);
}

static bool parse_class(struct view_word w, unsigned *ret)
{
	unsigned v = 0;

	for (size_t i = 0; i < w.n && v < 256; i++) {
		if (w.at[i] < '0' || w.at[i] > '9')
			return false;
		v = v * 10 + (unsigned)(w.at[i] - '0');
	}
	*ret = v;
	return w.n && v < 256;
}

bool view_word_classes(struct view_word w, uint64_t classes[4])
{
	struct view_word part;

	memset(classes, 0, 4 * sizeof *classes);
	if (!w.n || w.at[w.n - 1] == ',')
		return false;
	while (view_word_part(&w, ',', &part)) {
		const char *dash = part.n ? memchr(part.at, '-', part.n) : NULL;
		struct view_word low = {part.at, dash ? (size_t)(dash - part.at) : part.n}, high = low;
		unsigned first, last;

		if (dash)
			high = (struct view_word){dash + 1, part.n - low.n - 1};
		if (!parse_class(low, &first) || !parse_class(high, &last) || last < first)
			return false;
		for (unsigned c = first; c <= last; c++)
			classes[c >> 6] |= UINT64_C(1) << (c & 63);
	}
	return true;
}

bool view_word_plain(struct view *v, struct view_word w)
{
	if (view_word_after(&w, "class=")) {
		v->has_classes = true;
		return view_word_classes(w, v->classes);
	}
	if (view_word_after(&w, "not-class="))
		return view_word_classes(w, v->not_classes);
	if (view_word_after(&w, "every="))
		return number_u64(w, &v->every) && v->every;
	if (view_word_is(w, "ground"))
		v->ground = true;
	else if (view_word_is(w, "returns=first"))
		v->returns = VIEW_RETURNS_FIRST;
	else if (view_word_is(w, "returns=last"))
		v->returns = VIEW_RETURNS_LAST;
	else if (view_word_is(w, "keep-withheld"))
		v->keep_withheld = true;
	else if (view_word_is(w, "keep-noise"))
		v->keep_noise = true;
	else if (view_word_is(w, "drop-overlap"))
		v->drop_overlap = true;
	else if (view_word_is(w, "duplicates=highest"))
		v->duplicates = VIEW_HIGHEST;
	else
		return false;
	return true;
}

int view_word_rings(struct view_word w, const struct view_rings *to)
{
	const char *at = w.at, *end = w.at + w.n;
	__int128 x = 0, y = 0, dx, dy;
	int r;

	if (!w.n || *at != '+')
		return 1;
	while (at < end) {
		if (*at == '+' || *at == '-') {
			if ((r = to->ring(to->ctx, *at++ == '+')))
				return r;
			continue;
		}
		if (!area_code_get(&at, end, &dx) || !area_code_get(&at, end, &dy))
			return 1;
		/* Both are within 10^36, so the sum cannot overflow; it must be within it again. */
		x += dx;
		y += dy;
		if (x > AREA_CODE_MOST || x < -AREA_CODE_MOST || y > AREA_CODE_MOST || y < -AREA_CODE_MOST)
			return 1;
		if ((r = to->corner(to->ctx, x, y)))
			return r;
	}
	return 0;
}

bool view_word_new(struct view_seen *seen, struct view_word w)
{
	static const char *const kind[] = {
		"class=", "not-class=", "ground", "returns=", "keep-withheld", "keep-noise",  "drop-overlap",
		"zmin=",  "zmax=",      "crop=",  "every=",   "thin=",         "duplicates=", "window="};

	for (unsigned i = 0; i < sizeof kind / sizeof *kind; i++) {
		if (!view_word_after(&w, kind[i]))
			continue;
		if (seen->words >> i & 1)
			return false;
		seen->words |= 1u << i;
		return true;
	}
	return false;
}
