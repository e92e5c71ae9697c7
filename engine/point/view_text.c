/*
 * A view as its canonical text and back (view.h): "view 1", then the words for everything that differs from the default
 * (all points but noise and withheld ones), in a fixed order. After parsing, the text of the result must be equal to
 * the text that was read, so there is only one text for each view.
 *
 * The writer passes its words to a sink that counts, copies, compares or hashes them, so the text of a large area need
 * not be in memory.
 */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "err.h"
#include "view.h"
#include "view_area.h"
#include "view_word.h"

struct sink {
	size_t n;         /* bytes so far */
	char *copy;       /* NULL: none */
	const char *like; /* if not NULL, the text must be equal to this */
	bool differs;
	XXH3_state_t *hash; /* NULL: none */
	bool no_sources;    /* numbers of sources are left out */
};

static void put_bytes(struct sink *s, const char *bytes, size_t n)
{
	if (s->copy)
		memcpy(s->copy + s->n, bytes, n);
	if (s->like && !s->differs)
		s->differs = strncmp(s->like + s->n, bytes, n) != 0;
	if (s->hash)
		XXH3_128bits_update(s->hash, bytes, n);
	s->n += n;
}

/* At most 200 bytes in one call. */
__attribute__((format(printf, 2, 3))) static void put_text(struct sink *s, const char *fmt, ...)
{
	char buf[208];
	va_list ap;
	int n;

	va_start(ap, fmt);
	n = vsnprintf(buf, sizeof buf, fmt, ap);
	va_end(ap);
	put_bytes(s, buf, (size_t)n);
}

static bool class_bit(const uint64_t classes[4], unsigned cls)
{
	return classes[cls >> 6] >> (cls & 63) & 1;
}

/* " class=2-5,9" */
static void put_classes(struct sink *s, const char *word, const uint64_t classes[4])
{
	put_text(s, " %s", word);
	for (unsigned c = 0, some = 0; c < 256; c++) {
		unsigned last = c;

		if (!class_bit(classes, c))
			continue;
		while (last < 255 && class_bit(classes, last + 1))
			last++;
		put_text(s, last > c ? "%s%u-%u" : "%s%u", some++ ? "," : "", c, last);
		c = last;
	}
}

static void put_area(struct sink *s, const char *word, const struct view_area *a)
{
	int64_t x = 0, y = 0;

	put_text(s, " %sarea:", word);
	for (size_t i = 0; i < view_area_rings(a); i++) {
		const int64_t(*corner)[2];
		bool shell;
		size_t n = view_area_ring_at(a, i, &shell, &corner);

		put_bytes(s, shell ? "+" : "-", 1);
		for (size_t k = 0; k < n; k++) {
			char code[2 * AREA_CODE_SIZE];
			size_t len = area_code_put((__int128)corner[k][0] - x, code);

			len += area_code_put((__int128)corner[k][1] - y, code + len);
			put_bytes(s, code, len);
			x = corner[k][0];
			y = corner[k][1];
		}
	}
}

static void put_place(struct sink *s, const char *word, unsigned kind, const int64_t b[4], const struct view_area *a)
{
	if (kind == VIEW_CROP_BOX)
		put_text(s, " %sbox:%lld,%lld,%lld,%lld", word, (long long)b[0], (long long)b[1], (long long)b[2],
			 (long long)b[3]);
	else if (kind == VIEW_CROP_AREA)
		put_area(s, word, a);
}

static const char *const pick_text[] = {"lowest", "highest", "median"};

/* "#1-3+7" */
static void put_sources(struct sink *s, const struct slots *slots, uint8_t slot)
{
	bool first = true;

	if (s->no_sources)
		put_text(s, "#");
	for (size_t i = 0; i < slots->n && !s->no_sources; i++) {
		const struct slots_range *r = &slots->range[i];

		if (r->slot != slot)
			continue;
		put_text(s, "%s%u", first ? "#" : "+", r->first);
		if (r->last > r->first)
			put_text(s, "-%u", r->last);
		first = false;
	}
}

static void put_weights(struct sink *s, const char *word, const struct view *v)
{
	for (unsigned i = 0; i < v->nweight; i++) {
		const struct view_weight *w = &v->weight[i];

		put_text(s, "%s%s", i ? "," : " ", i ? "" : word);
		if (w->slot)
			put_sources(s, v->slots, w->slot);
		else
			put_text(s, "%u", w->cls);
		put_text(s, ":%d", w->radius);
	}
}

/* A word that is no row of a kind. */
static void put_own(struct sink *s, const struct view *v, enum view_word_id id)
{
	const char *word = view_word_rows[id].word;

	switch (id) {
	case VIEW_WORD_classes:
		if (v->has_classes)
			put_classes(s, word, v->classes);
		break;
	case VIEW_WORD_not_classes:
		if (v->not_classes[0] | v->not_classes[1] | v->not_classes[2] | v->not_classes[3])
			put_classes(s, word, v->not_classes);
		break;
	case VIEW_WORD_ground:
		if (v->ground)
			put_text(s, " %s", word);
		break;
	case VIEW_WORD_returns:
		if (v->returns != VIEW_RETURNS_ALL)
			put_text(s, " %s%s", word, v->returns == VIEW_RETURNS_FIRST ? "first" : "last");
		break;
	case VIEW_WORD_crop:
		put_place(s, word, v->crop, v->crop_box, v->area);
		break;
	case VIEW_WORD_thin:
		if (v->thin.cell)
			put_text(s, " %s%lld:%s", word, (long long)v->thin.cell, pick_text[v->thin.pick]);
		break;
	case VIEW_WORD_duplicates:
		if (v->duplicates == VIEW_HIGHEST)
			put_text(s, " %shighest", word);
		break;
	case VIEW_WORD_breakline_clear:
		if (v->breakline_clear)
			put_text(s, " %s%lld", word, (long long)v->breakline_clear);
		break;
	case VIEW_WORD_max_error:
		if (v->has_max_error)
			put_text(s, " %s%lld", word, (long long)v->max_error);
		break;
	case VIEW_WORD_window:
		put_place(s, word, v->window, v->window_box, v->window_area);
		break;
	case VIEW_WORD_metric:
		if (v->metric.k)
			put_text(s, " %s%lld,%lld,%lld", word, (long long)v->metric.p, (long long)v->metric.q,
				 (long long)v->metric.k);
		break;
	case VIEW_WORD_weight:
		put_weights(s, word, v);
		break;
	case VIEW_WORD_hidden:
		if (v->hidden)
			put_text(s, " %s", word);
		break;
	default:
		break;
	}
}

static void put_view(struct sink *s, const struct view *view)
{
	struct view v = view_normal(view);

	put_text(s, "view 1");
	for (unsigned i = 0; i < VIEW_WORDS; i++) {
		const struct view_word_row *row = &view_word_rows[i];

		switch (row->kind) {
		case VIEW_KIND_FLAG:
			if (*view_word_flag(&v, row->at))
				put_text(s, " %s", row->word);
			break;
		case VIEW_KIND_COUNT:
			if (*view_word_count(&v, row))
				put_text(s, " %s%llu", row->word, (unsigned long long)*view_word_count(&v, row));
			break;
		case VIEW_KIND_HEIGHT:
			if (*view_word_flag(&v, row->has))
				put_text(s, " %s%lld", row->word, (long long)*view_word_height(&v, row));
			break;
		default:
			put_own(s, &v, (enum view_word_id)i);
		}
	}
}

size_t view_text_size(const struct view *view)
{
	struct sink s = {0};

	put_view(&s, view);
	return s.n;
}

char *view_text(const struct view *view)
{
	size_t n = view_text_size(view);
	struct sink s = {.copy = malloc(n + 1)};

	if (!s.copy)
		return NULL;
	put_view(&s, view);
	s.copy[n] = '\0';
	return s.copy;
}

static struct digest hash_of(const struct view *view, bool no_sources)
{
	XXH3_state_t state;
	struct sink s = {.hash = &state, .no_sources = no_sources};
	XXH128_hash_t h;

	XXH3_128bits_reset(&state);
	put_view(&s, view);
	h = XXH3_128bits_digest(&state);
	return (struct digest){h.high64, h.low64};
}

struct digest view_hash(const struct view *view)
{
	return hash_of(view, false);
}

struct digest view_hash_slots(const struct view *view)
{
	return hash_of(view, true);
}

static int set_list(uint64_t classes[4], const char *list, struct err *err)
{
	uint64_t got[4];

	if (!view_word_classes((struct view_word){list, strlen(list)}, got)) {
		err_set(err, ERR_USAGE, "\"%.100s\" is not a list of classes", list);
		return err_add_hint(err, "give numbers from 0 to 255, as in 2,8 or 2-5,9");
	}
	memcpy(classes, got, sizeof got);
	return 0;
}

int view_set_classes(struct view *view, const char *list, struct err *err)
{
	int r = set_list(view->classes, list, err);

	view->has_classes |= !r;
	return r;
}

int view_set_not_classes(struct view *view, const char *list, struct err *err)
{
	return set_list(view->not_classes, list, err);
}

/* ---- reading ---- */

struct area_ctx {
	struct view_area *area;
	struct err *err;
};

static int area_ring(void *ctx, bool shell)
{
	struct area_ctx *a = ctx;

	return view_area_ring(a->area, shell, a->err);
}

static int area_corner(void *ctx, __int128 x, __int128 y)
{
	struct area_ctx *a = ctx;

	if (x > VIEW_AREA_MOST || x < -VIEW_AREA_MOST || y > VIEW_AREA_MOST || y < -VIEW_AREA_MOST)
		return 1;
	return view_area_corner(a->area, (int64_t)x, (int64_t)y, a->err);
}

/* 0, a negative error, or 1: not an area. */
static int parse_area(struct view_word w, struct view_area **ret, int64_t ret_box[4], struct err *err)
{
	struct area_ctx ctx = {view_area_new(), err};
	struct view_rings to = {area_ring, area_corner, &ctx};
	int r = ctx.area ? view_word_rings(w, &to) : err_set(err, ERR_NOMEM, "no memory for the area of a view");

	if (!r)
		r = view_area_end(ctx.area, err);
	if (r) {
		view_area_free(ctx.area);
		return r;
	}
	*ret = ctx.area;
	view_area_bounds(ctx.area, ret_box);
	return 0;
}

/* For a crop or a window that has no area yet. */
static int parse_place(struct view_word w, uint8_t *kind, int64_t box[4], struct view_area **area, struct err *err)
{
	struct view_word part;

	if (*kind)
		return 1;
	*kind = VIEW_CROP_AREA;
	if (view_word_after(&w, "area:"))
		return parse_area(w, area, box, err);
	*kind = VIEW_CROP_BOX;
	if (!view_word_after(&w, "box:"))
		return 1;
	for (unsigned i = 0; i < 4; i++)
		if (!view_word_part(&w, ',', &part) || !view_word_i64(part, &box[i]))
			return 1;
	return w.n != 0;
}

static int parse_thin(struct view *v, struct view_word w)
{
	struct view_word cell;

	if (!view_word_part(&w, ':', &cell) || !view_word_i64(cell, &v->thin.cell) || v->thin.cell <= 0)
		return 1;
	for (unsigned i = 0; i < 3; i++) {
		if (!view_word_is(w, pick_text[i]))
			continue;
		v->thin.pick = (uint8_t)i;
		return 0;
	}
	return 1;
}

static int parse_weight(struct view *v, struct view_word of, int64_t radius, struct slots_list *sources)
{
	unsigned c;

	if (radius < 0 || radius > VIEW_RADIUS_MOST)
		return 1;
	if (view_word_after(&of, "#"))
		return view_word_sources(of, (int32_t)radius, sources);
	return !radius || !view_word_class(of, &c) || !view_weight_set(v, (uint8_t)c, (int32_t)radius);
}

static int parse_weights(struct view *v, struct view_word w, struct err *err)
{
	struct slots_list sources = {NULL, 0, 0};
	struct view_word part, of;
	int64_t radius;
	int r = 0;

	while (!r && view_word_part(&w, ',', &part)) {
		if (!view_word_part(&part, ':', &of) || !view_word_i64(part, &radius))
			r = 1;
		else
			r = parse_weight(v, of, radius, &sources);
	}
	if (!r)
		r = view_weight_sources(v, &sources, err);
	slots_list_free(&sources);
	return r;
}

static int parse_word(struct view *v, enum view_word_id id, struct view_word w, struct err *err)
{
	const struct view_word_row *row = &view_word_rows[id];

	if (id == VIEW_WORD_crop)
		return parse_place(w, &v->crop, v->crop_box, &v->area, err);
	if (id == VIEW_WORD_window)
		return parse_place(w, &v->window, v->window_box, &v->window_area, err);
	if (id == VIEW_WORD_thin)
		return parse_thin(v, w);
	if (id == VIEW_WORD_weight)
		return parse_weights(v, w, err);
	if (id == VIEW_WORD_breakline_clear)
		return !view_word_i64(w, &v->breakline_clear) || v->breakline_clear <= 0 || v->breakline_clear > VIEW_CLEAR_MOST;
	if (id == VIEW_WORD_max_error) {
		v->has_max_error = true;
		return !view_word_i64(w, &v->max_error) || v->max_error < 0 || v->max_error > VIEW_ERROR_MOST;
	}
	if (row->kind == VIEW_KIND_HEIGHT)
		return !(*view_word_flag(v, row->has) = view_word_i64(w, view_word_height(v, row)));
	return !view_word_plain(v, id, w);
}

/* 0, a negative error, or 1: not a text that view_text writes. */
static int parse(const char *text, struct view *v, struct err *err)
{
	struct view_word all = {text, strlen(text)}, w;
	struct sink same = {.like = text};
	struct view_seen seen = {0};

	if (all.n > VIEW_TEXT_MAX || !view_word_after(&all, "view 1"))
		return 1;
	while (all.n) {
		if (!view_word_after(&all, " ") || !all.n)
			return 1;
		w = (struct view_word){all.at, strcspn(all.at, " ")};
		all.at += w.n;
		all.n -= w.n;
		enum view_word_id id = view_word_next(&seen, &w);
		int r = id == VIEW_WORDS ? 1 : parse_word(v, id, w, err);

		if (r)
			return r;
	}
	if (view_check(v, err))
		return 1;
	put_view(&same, v);
	return same.differs || same.n != strlen(text) || (v->crop == VIEW_CROP_AREA && view_area_is_box(v->area)) ||
	       (v->window == VIEW_CROP_AREA && view_area_is_box(v->window_area));
}

int view_parse(const char *text, struct view *ret, struct err *err)
{
	struct view v = VIEW_INIT;
	struct err ignored = ERR_INIT;
	int r = parse(text, &v, &ignored);

	if (r) {
		view_done(&v);
		if (r == -ERR_NOMEM)
			return err_set(err, ERR_NOMEM, "no memory for a view");
		return err_set(err, ERR_PROTO, "\"%.200s\" is not the text of a view of this version", text);
	}
	*ret = v;
	return 0;
}
