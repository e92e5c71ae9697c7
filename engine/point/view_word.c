/*
 * Words of the texts of views (view_word.h). Strict: there is exactly one spelling.
 */
#include "view_word.h"

#include <string.h>

#include "err.h"
#include "parse.h"

const struct view_word_row view_word_rows[VIEW_WORDS] = {
#define VIEW_FLAG(field, word, help) {word, VIEW_KIND_FLAG, offsetof(struct view, field), 0},
#define VIEW_COUNT(field, word, value, help) {word "=", VIEW_KIND_COUNT, offsetof(struct view, field), 0},
#define VIEW_HEIGHT(field, word, value, help) \
	{word "=", VIEW_KIND_HEIGHT, offsetof(struct view, field), offsetof(struct view, has_##field)},
#define VIEW_OWN(field, word) {word, VIEW_KIND_OWN, 0, 0},
#include "view_option.def"
};

/* A row is read and written through a pointer of its kind. */
#define VIEW_FLAG(field, word, help) _Static_assert(_Generic(((struct view *)0)->field, bool : 1, default : 0), "bool " #field);
#define VIEW_COUNT(field, word, value, help) \
	_Static_assert(_Generic(((struct view *)0)->field, uint64_t : 1, default : 0), "uint64_t " #field);
#define VIEW_HEIGHT(field, word, value, help) \
	_Static_assert(_Generic(((struct view *)0)->field, int64_t : 1, default : 0), "int64_t " #field);
#include "view_option.def"

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

bool view_word_class(struct view_word w, unsigned *ret)
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
		if (!view_word_class(low, &first) || !view_word_class(high, &last) || last < first)
			return false;
		for (unsigned c = first; c <= last; c++)
			classes[c >> 6] |= UINT64_C(1) << (c & 63);
	}
	return true;
}

static bool to_source(struct view_word w, uint32_t *ret)
{
	uint64_t v;

	if (!number_u64(w, &v) || !v || v > UINT32_MAX)
		return false;
	*ret = (uint32_t)v;
	return true;
}

int view_word_sources(struct view_word w, int32_t radius, struct slots_list *l)
{
	struct view_word part, low;
	uint32_t first, last;

	if (!w.n || w.at[w.n - 1] == '+')
		return 1;
	while (view_word_part(&w, '+', &part)) {
		bool one = !part.n || !memchr(part.at, '-', part.n);

		if (!view_word_part(&part, '-', &low) || !to_source(low, &first) || (!one && !to_source(part, &last)))
			return 1;
		last = one ? first : last;
		if (last < first)
			return 1;
		if (!slots_list_add(l, first, last, radius))
			return -ERR_NOMEM;
	}
	return 0;
}

static bool parse_metric(struct view_word w, struct view_metric *ret)
{
	int64_t *const to[3] = {&ret->p, &ret->q, &ret->k};
	struct view_word part;

	for (unsigned i = 0; i < 3; i++)
		if (!view_word_part(&w, i < 2 ? ',' : '\0', &part) || !view_word_i64(part, to[i]))
			return false;
	return w.n == 0 && (ret->p || ret->q || ret->k);
}

bool view_word_plain(struct view *v, enum view_word_id id, struct view_word w)
{
	const struct view_word_row *row = &view_word_rows[id];

	if (row->kind == VIEW_KIND_FLAG)
		return *view_word_flag(v, row->at) = true;
	if (row->kind == VIEW_KIND_COUNT)
		return number_u64(w, view_word_count(v, row)) && *view_word_count(v, row);
	switch (id) {
	case VIEW_WORD_classes:
		v->has_classes = true;
		return view_word_classes(w, v->classes);
	case VIEW_WORD_not_classes:
		return view_word_classes(w, v->not_classes);
	case VIEW_WORD_ground:
		return v->ground = true;
	case VIEW_WORD_hidden:
		return v->hidden = true;
	case VIEW_WORD_returns:
		v->returns = view_word_is(w, "first") ? VIEW_RETURNS_FIRST : VIEW_RETURNS_LAST;
		return view_word_is(w, "first") || view_word_is(w, "last");
	case VIEW_WORD_duplicates:
		v->duplicates = VIEW_HIGHEST;
		return view_word_is(w, "highest");
	case VIEW_WORD_metric:
		return parse_metric(w, &v->metric);
	default:
		return false;
	}
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

_Static_assert(VIEW_WORDS <= 32, "bits of struct view_seen");

enum view_word_id view_word_next(struct view_seen *seen, struct view_word *w)
{
	for (unsigned i = 0; i < VIEW_WORDS; i++) {
		const char *word = view_word_rows[i].word;
		bool valued = word[strlen(word) - 1] == '=';

		if (valued ? !view_word_after(w, word) : !view_word_is(*w, word))
			continue;
		if (seen->words >> i & 1)
			break;
		seen->words |= 1u << i;
		if (!valued)
			*w = (struct view_word){w->at + w->n, 0};
		return (enum view_word_id)i;
	}
	return VIEW_WORDS;
}
