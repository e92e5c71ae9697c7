/* Views: the matrix of rules against a table written by hand, canonical texts, preference among equals. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "lattice.h"
#include "view.h"

static struct view view_with(const char *classes)
{
	struct view v = VIEW_INIT;
	struct err err = ERR_INIT;

	if (classes)
		assert_int_equal(view_set_classes(&v, classes, &err), 0);
	return v;
}

static struct point point_with(unsigned cls, unsigned number, unsigned count, unsigned flags)
{
	return (struct point){0, 0, 0, (uint8_t)cls, (uint8_t)(number | count << 4), (uint16_t)flags};
}

static void test_matrix(void **state)
{
	struct view all = view_with(NULL), named = view_with("2,7"), ground = all, surface = all, last = all, loud = all;
	struct view first = all, kept = all, ground7;

	ground.ground = true;
	surface.surface = true;
	first.returns = VIEW_RETURNS_FIRST;
	last.returns = VIEW_RETURNS_LAST;
	loud.keep_noise = true;
	kept.keep_withheld = true;
	ground7 = ground;
	ground7.keep_noise = true;
	const struct {
		const struct view *view;
		unsigned cls, number, count, flags;
		enum view_rule want;
	} rows[] = {
		{&all, 2, 1, 1, 0, VIEW_KEPT},
		{&all, 7, 1, 1, 0, VIEW_BY_NOISE},
		{&all, 18, 1, 1, 0, VIEW_BY_NOISE},
		{&all, 2, 1, 1, POINT_WITHHELD, VIEW_BY_WITHHELD},
		{&all, 7, 1, 1, POINT_WITHHELD, VIEW_BY_NOISE}, /* the first rule is the one counted */
		{&all, 2, 1, 1, POINT_SYNTHETIC | POINT_OVERLAP | POINT_KEY, VIEW_KEPT},
		{&all, 255, 5, 9, 0, VIEW_KEPT},
		{&loud, 7, 1, 1, 0, VIEW_KEPT},
		{&loud, 18, 1, 1, POINT_WITHHELD, VIEW_BY_WITHHELD},
		{&kept, 2, 1, 1, POINT_WITHHELD, VIEW_KEPT},
		{&kept, 7, 1, 1, POINT_WITHHELD, VIEW_BY_NOISE},
		{&named, 2, 1, 1, 0, VIEW_KEPT},
		{&named, 7, 1, 1, 0, VIEW_KEPT}, /* named: not noise */
		{&named, 18, 1, 1, 0, VIEW_BY_CLASS},
		{&named, 3, 1, 1, POINT_WITHHELD, VIEW_BY_CLASS},
		{&named, 7, 1, 1, POINT_WITHHELD, VIEW_BY_WITHHELD},
		{&ground, 2, 1, 1, 0, VIEW_KEPT},
		{&ground, 8, 1, 1, 0, VIEW_KEPT},
		{&ground, 5, 1, 1, 0, VIEW_BY_CLASS},
		{&ground, 5, 1, 1, POINT_KEY, VIEW_KEPT},
		{&ground, 7, 1, 1, POINT_KEY, VIEW_BY_NOISE},
		{&ground, 18, 1, 1, POINT_KEY, VIEW_BY_NOISE},
		{&ground, 7, 1, 1, 0, VIEW_BY_CLASS},
		{&ground, 2, 1, 1, POINT_WITHHELD, VIEW_BY_WITHHELD},
		{&ground7, 7, 1, 1, POINT_KEY, VIEW_KEPT},
		{&surface, 5, 1, 3, 0, VIEW_KEPT},
		{&surface, 5, 2, 3, 0, VIEW_BY_RETURNS},
		{&surface, 5, 2, 3, POINT_WITHHELD, VIEW_BY_RETURNS},
		{&surface, 5, 0, 0, 0, VIEW_KEPT}, /* no returns known */
		{&first, 5, 1, 3, 0, VIEW_KEPT},
		{&first, 5, 3, 3, 0, VIEW_BY_RETURNS},
		{&last, 5, 3, 3, 0, VIEW_KEPT},
		{&last, 5, 1, 1, 0, VIEW_KEPT},
		{&last, 5, 1, 3, 0, VIEW_BY_RETURNS},
		{&last, 5, 0, 0, 0, VIEW_KEPT},
		{&last, 5, 0, 1, 0, VIEW_KEPT},
		{&last, 5, 0, 2, 0, VIEW_BY_RETURNS},
		{&last, 5, 4, 3, 0, VIEW_KEPT}, /* beyond its count */
	};

	for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
		struct point p = point_with(rows[i].cls, rows[i].number, rows[i].count, rows[i].flags);
		enum view_rule got = view_judge(rows[i].view, &p);

		if (got != rows[i].want)
			print_error("row %zu: %s, not %s\n", i, view_rule_text(got), view_rule_text(rows[i].want));
		assert_int_equal(got, rows[i].want);
		assert_true(view_by_kind(rows[i].view));
	}
	(void)state;
}

static struct view asked(const char *request, const struct lattice *lattice)
{
	struct view v;
	struct err err = ERR_INIT;

	assert_int_equal(view_resolve(request, lattice, "metre", "metre", &v, &err), 0);
	view_bind(&v, lattice);
	return v;
}

/* Rules for place and height, in their order, on two lattices with the same absolute numbers. */
static void test_places(void **state)
{
	static const struct lattice lattices[] = {{{1, 0}, {1, 0}, {0, 0, 0}}, {{1, 0}, {1, 0}, {1000, -2000, 77}}};
	static const struct {
		const char *request;
		int32_t x, y, z;
		unsigned cls, flags;
		enum view_rule want;
		uint8_t ret; /* 0: the only return */
	} rows[] = {
		{"ask 1 not-class=3-5", 0, 0, 0, 2, 0, VIEW_KEPT},
		{"ask 1 not-class=3-5", 0, 0, 0, 3, 0, VIEW_BY_CLASS},
		{"ask 1 not-class=3-5", 0, 0, 0, 7, 0, VIEW_BY_NOISE},
		{"ask 1 not-class=7", 0, 0, 0, 7, 0, VIEW_BY_CLASS},
		{"ask 1 ground not-class=5", 0, 0, 0, 5, POINT_KEY, VIEW_BY_CLASS},
		{"ask 1 drop-overlap", 0, 0, 0, 2, POINT_OVERLAP, VIEW_BY_OVERLAP},
		{"ask 1 drop-overlap", 0, 0, 0, 12, 0, VIEW_KEPT}, /* the reader sets the flag for old classes */
		{"ask 1", 0, 0, 0, 2, POINT_OVERLAP, VIEW_KEPT},
		{"ask 1 drop-overlap zmin=5", 0, 0, 0, 2, POINT_OVERLAP | POINT_WITHHELD, VIEW_BY_WITHHELD},
		{"ask 1 drop-overlap zmin=5", 0, 0, 0, 2, POINT_OVERLAP, VIEW_BY_OVERLAP},
		{"ask 1 returns=first drop-overlap", 0, 0, 0, 2, POINT_OVERLAP, VIEW_BY_RETURNS, 0x32},
		{"ask 1 returns=first drop-overlap", 0, 0, 0, 2, POINT_OVERLAP, VIEW_BY_OVERLAP, 0x31},
		{"ask 1 zmin=5", 0, 0, 4, 2, 0, VIEW_BY_Z},
		{"ask 1 zmin=5", 0, 0, 5, 2, 0, VIEW_KEPT},
		{"ask 1 zmax=5", 0, 0, 5, 2, 0, VIEW_KEPT},
		{"ask 1 zmax=5", 0, 0, 6, 2, 0, VIEW_BY_Z},
		{"ask 1 zmin=-3 zmax=-3", 0, 0, -3, 2, 0, VIEW_KEPT},
		{"ask 1 zmax=5 crop=box:1,2,3,4", 0, 0, 6, 7, POINT_WITHHELD, VIEW_BY_CROP},
		{"ask 1 zmax=5 crop=box:1,2,3,4", 1, 2, 6, 2, 0, VIEW_BY_Z},
		{"ask 1 crop=box:1,2,3,4", 1, 2, 0, 2, 0, VIEW_KEPT},
		{"ask 1 crop=box:1,2,3,4", 3, 4, 0, 2, 0, VIEW_KEPT},
		{"ask 1 crop=box:1,2,3,4", 0, 2, 0, 2, 0, VIEW_BY_CROP},
		{"ask 1 crop=box:1,2,3,4", 1, 1, 0, 2, 0, VIEW_BY_CROP},
		{"ask 1 crop=box:1,2,3,4", 4, 4, 0, 2, 0, VIEW_BY_CROP},
		{"ask 1 crop=box:1,2,3,4", 3, 5, 0, 2, 0, VIEW_BY_CROP},
		{"ask 1 crop=area@0:+AAIAAI", 0, 4, 0, 2, 0, VIEW_BY_CROP}, /* 0 0, 4 0, 4 4 */
		{"ask 1 crop=area@0:+AAIAAI", 2, 2, 0, 2, 0, VIEW_KEPT},
		{"ask 1 crop=area@0:+AAIAAI", 3, 1, 0, 2, 0, VIEW_KEPT},
		{"ask 1 crop=area@0:+AAIAAI every=1000000", 0, 4, 0, 2, 0, VIEW_BY_CROP},
		{"ask 1", 0, 0, 0, 2, POINT_NEAR_LINE, VIEW_BY_LINE},
		{"ask 1", 0, 0, 0, 2, POINT_IN_AREA, VIEW_BY_AREA},
		{"ask 1", 0, 0, 0, 7, POINT_IN_AREA, VIEW_BY_NOISE},
		{"ask 1 zmin=5", 0, 0, 4, 2, POINT_NEAR_LINE, VIEW_BY_Z},
		{"ask 1 crop=box:1,2,3,4 breakline-clear=3", 3, 4, 0, 2, POINT_NEAR_LINE, VIEW_BY_LINE},
		{"ask 1 ground breakline-clear=3", 0, 0, 0, 0, POINT_LINE, VIEW_KEPT},
		{"ask 1 class=2 zmin=5 zmax=6", 0, 0, 0, 0, POINT_LINE, VIEW_KEPT},
		{"ask 1 crop=box:1,2,3,4", 3, 4, 0, 0, POINT_LINE, VIEW_KEPT},
		{"ask 1 crop=box:1,2,3,4", 3, 5, 0, 0, POINT_LINE, VIEW_BY_CROP},
	};

	for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
		for (unsigned l = 0; l < 2; l++) {
			const int64_t *k = lattices[l].k;
			struct view v = asked(rows[i].request, &lattices[l]);
			struct point p = {rows[i].x - (int32_t)k[0], rows[i].y - (int32_t)k[1],        rows[i].z - (int32_t)k[2],
					  (uint8_t)rows[i].cls,      rows[i].ret ? rows[i].ret : 0x11, (uint16_t)rows[i].flags};
			int32_t box[4] = {p.x, p.y, p.x, p.y};
			enum view_rule got = view_judge(&v, &p);

			if (got != rows[i].want)
				print_error("row %zu: %s\n", i, view_rule_text(got));
			assert_int_equal(got, rows[i].want);
			if (got == VIEW_KEPT)
				assert_true(view_may_hold(&v, box));
			assert_int_equal(view_selects(&v), strstr(rows[i].request, "crop") != NULL);
			assert_int_equal(view_by_kind(&v), !strstr(rows[i].request, "crop") && !strstr(rows[i].request, " z"));
			struct view rest = view_rest(&v);

			p.cls = 18;
			p.tag = POINT_WITHHELD | POINT_OVERLAP;
			assert_int_equal(view_judge(&rest, &p), VIEW_KEPT);
			assert_false(view_selects(&rest));
			view_done(&v);
		}
	}
	(void)state;
}

/* XXH3-64 of the positions, against python3-xxhash. */
static void test_every(void **state)
{
	const struct lattice l = {{1, -2}, {1, -2}, {63500000, 685300000, 0}};
	struct view v = VIEW_INIT;
	unsigned kept = 0;

	for (v.every = 2; v.every < 2000; v.every = v.every * 3 + 1) {
		view_bind(&v, &l);
		assert_false(view_by_kind(&v));
		kept = 0;
		for (int i = 0; i < 20000; i++) {
			struct point p = {i % 200, i / 200, i, 2, 0x11, 0}, q = p;

			q.z = -5;
			q.cls = 3;
			kept += view_judge(&v, &p) == VIEW_KEPT;
			/* All points of a position are kept, or none. */
			assert_int_equal(view_judge(&v, &p), view_judge(&v, &q));
		}
		assert_true(kept > 20000 / v.every / 2 && kept < 20000 / v.every * 2);
	}
	/* xxhash.xxh3_64_intdigest(struct.pack("<qq", 63500000 + x, 685300000 + y)) % 7 == 0 for x in 0..15, y = 3 */
	static const char want[16 + 1] = "...x.....x......";
	char got[16 + 1] = "";

	v.every = 7;
	for (int x = 0; x < 16; x++) {
		struct point p = {x, 3, 0, 2, 0x11, 0};

		got[x] = view_judge(&v, &p) == VIEW_KEPT ? 'x' : '.';
	}
	assert_string_equal(got, want);
	(void)state;
}

static void test_thin(void **state)
{
	const struct lattice l = {{1, 0}, {1, 0}, {-3, 10, 0}};
	struct view v = asked("ask 1 thin=5:lowest", &l);
	struct view_thin high = {5, VIEW_PICK_HIGHEST}, median = {5, VIEW_PICK_MEDIAN};
	static const int32_t at[][4] = {/* x, y absolute, cell */
					{0, 0, 0, 0},
					{4, 5, 0, 1},
					{-1, -5, -1, -1},
					{-5, -6, -1, -2},
					{-6, 14, -2, 2}};
	struct point set[4 * 3 * 3 * 2 * 2];
	size_t n = 0;

	for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
		struct point p = {at[i][0] + 3, at[i][1] - 10, 0, 2, 0x11, 0};
		int64_t cell[2];

		view_thin_cell(&v, &p, cell);
		assert_int_equal(cell[0], at[i][2]);
		assert_int_equal(cell[1], at[i][3]);
		assert_int_equal(view_judge(&v, &p), VIEW_KEPT);
	}
	assert_true(view_selects(&v));
	for (int z = 0; z < 4; z++)
		for (unsigned m = 0; m < 36; m++)
			set[n++] = (struct point){(int32_t)(m % 3),  (int32_t)(m / 3 % 3), z, (uint8_t)(m / 9 % 2), 0x11,
						  (uint16_t)(m / 18)};
	/* Of points that are equal otherwise the one with the greatest slot comes first. */
	for (unsigned slot = 1; slot <= SLOTS_MOST; slot++) {
		struct point a = set[5], b = set[5];

		a.tag |= (uint16_t)(slot << POINT_SLOT_SHIFT);
		b.tag |= (uint16_t)((slot - 1) << POINT_SLOT_SHIFT);
		assert_true(view_thin_compare(&v.thin, &a, &b) < 0 && view_thin_compare(&high, &b, &a) > 0);
	}
	/* A total order, the same upwards and downwards except for z; the source does not matter. */
	for (size_t i = 0; i < n; i++) {
		for (size_t j = 0; j < n; j++) {
			struct point b = set[j];
			int low = view_thin_compare(&v.thin, &set[i], &b), up = view_thin_compare(&high, &set[i], &b);

			b.tag |= 7 << POINT_SOURCE_SHIFT; /* marks of lines */
			assert_int_equal(low, view_thin_compare(&median, &set[i], &b));
			assert_int_equal(!low, i == j);
			assert_int_equal(low<0, view_thin_compare(&v.thin, &b, &set[i])> 0);
			if (set[i].z != b.z)
				assert_int_equal(low < 0, set[i].z < b.z);
			else if (set[i].cls != b.cls)
				assert_int_equal(low < 0, set[i].cls < b.cls);
			else if (point_flags(&set[i]) != point_flags(&b))
				assert_int_equal(low < 0, point_flags(&set[i]) < point_flags(&b));
			assert_int_equal(set[i].z == b.z ? low < 0 : low > 0, up < 0);
			assert_int_equal(view_thin_prefers(&high, &set[i], &b), up < 0);
		}
	}
	(void)state;
}

/* For any view the order of the points of a position does not matter, and the source never decides. */
static void test_preference(void **state)
{
	struct point all[3 * 2 * 2 * 2 * 2];
	size_t n = 0;

	for (int z = 0; z < 3; z++)
		for (unsigned m = 0; m < 16; m++)
			all[n++] = (struct point){
				0, 0, z, (uint8_t)(m & 1), (uint8_t)(m >> 1 & 1), (uint16_t)((m >> 2 & 1) | (m >> 3 & 1) << 4)};
	for (unsigned mode = 0; mode < 4; mode++) {
		struct view v = VIEW_INIT;

		v.duplicates = mode % 2 ? VIEW_HIGHEST : VIEW_LOWEST; /* the ground is lowest nevertheless */
		v.surface = mode == 2;
		v.ground = mode == 3;
		int want = mode == 1 || mode == 2 ? 2 : 0;

		for (size_t start = 0; start < n; start++) {
			struct point best = all[start];

			for (size_t i = 0; i < n; i++) {
				const struct point *p = &all[(start * 7 + i * 5) % n];

				assert_false(view_prefers(&v, p, &best) && view_prefers(&v, &best, p));
				if (view_prefers(&v, p, &best))
					best = *p;
			}
			assert_int_equal(best.z, want);
			assert_true(best.cls == 0 && best.ret == 0 && point_flags(&best) == 0);
		}
		struct point a = all[0], b = all[0];

		b.tag |= 5 << POINT_SOURCE_SHIFT;
		assert_false(view_prefers(&v, &a, &b) || view_prefers(&v, &b, &a));
	}
	(void)state;
}

static void test_text_round_trip(void **state)
{
	static const char *const lists[] = {NULL, "2", "2,8", "0-255", "7", "3-5,9,200-255", "0,2,4,6,8"};
	char *text, *again;
	struct digest seen[7 * 3 * 2 * 2 * 2 * 2];
	size_t nseen = 0;

	for (unsigned m = 0; m < 7 * 3 * 2 * 2 * 2 * 2; m++) {
		struct view v = view_with(lists[m % 7]), w = VIEW_INIT;
		struct err err = ERR_INIT;

		v.returns = (uint8_t)(m / 7 % 3);
		v.keep_noise = m / 21 % 2;
		v.keep_withheld = m / 42 % 2;
		v.ground = m / 84 % 2;
		v.duplicates = (uint8_t)(m / 168 % 2);
		if (view_check(&v, &err))
			continue;
		text = view_text(&v);
		assert_int_equal(view_parse(text, &w, &err), 0);
		again = view_text(&w);
		assert_string_equal(again, text);
		assert_true(digest_equal(digest_hash(text, strlen(text)), view_hash(&v)));
		free(text);
		free(again);
		assert_true(digest_equal(view_hash(&v), view_hash(&w)));
		assert_memory_equal(&v, &w, sizeof v);
		for (size_t i = 0; i < nseen; i++)
			assert_false(digest_equal(seen[i], view_hash(&v))); /* different views, different texts */
		seen[nseen++] = view_hash(&v);
	}
	(void)state;
}

static void assert_text(const struct view *v, const char *want)
{
	char *text = view_text(v);

	assert_string_equal(text, want);
	free(text);
}

/* Keys of stored domains have the radii of sources, not their numbers. */
static void test_hash_slots(void **state)
{
	static const char *const text[] = {
		"view 1 weight=2:150,#4-7:30,#9:3000", "view 1 weight=2:150,#1+5:30,#2-3:3000", /* the same slots */
		"view 1 weight=2:150,#4-7:30,#9:3001", "view 1 weight=2:151,#4-7:30,#9:3000",
		"view 1 weight=2:150,#4-7:30",         "view 1 weight=2:150",
	};
	enum { TEXTS = sizeof text / sizeof *text };
	struct digest hash[TEXTS], whole[TEXTS];

	for (unsigned i = 0; i < TEXTS; i++) {
		struct err err = ERR_INIT;
		struct view v;

		assert_int_equal(view_parse(text[i], &v, &err), 0);
		hash[i] = view_hash_slots(&v);
		whole[i] = view_hash(&v);
		view_done(&v);
		for (unsigned k = 0; k < i; k++) {
			assert_int_equal(digest_equal(hash[i], hash[k]), i == 1 && k == 0);
			assert_false(digest_equal(whole[i], whole[k]));
		}
	}
	/* That of a view without sources is as it always was. */
	assert_true(digest_equal(hash[TEXTS - 1], whole[TEXTS - 1]));
	(void)state;
}

static void test_text(void **state)
{
	struct view v = view_with("9,2-3,4"), s = VIEW_INIT, t = VIEW_INIT, g = VIEW_INIT, every = VIEW_INIT;
	char *text;
	struct err err = ERR_INIT;

	assert_text(&s, "view 1");
	v.keep_noise = true;
	assert_text(&v, "view 1 class=2-4,9 keep-noise");
	s.surface = true;
	t.returns = VIEW_RETURNS_FIRST;
	t.duplicates = VIEW_HIGHEST;
	text = view_text(&t);
	assert_text(&s, text); /* two requests for the same view */
	g.ground = true;
	free(text);
	assert_text(&g, "view 1 ground");
	for (unsigned c = 0; c < 256; c += 2)
		every.classes[c >> 6] |= UINT64_C(1) << (c & 63);
	every.has_classes = every.keep_noise = every.keep_withheld = true;
	text = view_text(&every);
	assert_int_equal(view_parse(text, &v, &err), 0); /* the longest one without an area */
	assert_memory_equal(&v, &every, sizeof v);
	free(text);
	(void)state;
}

static void test_bad_texts(void **state)
{
	static const char *const bad[] = {
		"",
		"view",
		"view 2",
		"view 1 ",
		"view  1",
		"view 1  ground",
		"view 1 class=",
		"view 1 class=2,",
		"view 1 class=02",
		"view 1 class=3,2",
		"view 1 class=2,3",
		"view 1 class=256",
		"view 1 keep-noise keep-withheld",
		"view 1 surface",
		"view 1 returns=all",
		"view 1 ground duplicates=highest",
		"view 1 ground ground",
		"view 1 Ground",
		"view 1ground",
	};
	static const char *const lists[] = {"",   ",",  "2,", "-2",   "2-",    "5-2",        "256",
					    "2 ", " 2", "a",  "2,,3", "1-2-3", "99999999999"};
	struct view v = VIEW_INIT, same = v;

	for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
		struct err err = ERR_INIT;

		assert_int_equal(view_parse(bad[i], &v, &err), -ERR_PROTO);
	}
	for (size_t i = 0; i < sizeof lists / sizeof lists[0]; i++) {
		struct err err = ERR_INIT;

		assert_int_equal(view_set_classes(&v, lists[i], &err), -ERR_USAGE);
		assert_true(err.hint[0]);
	}
	assert_memory_equal(&v, &same, sizeof v);
	(void)state;
}

static void test_contradictions(void **state)
{
	struct view v = VIEW_INIT;
	struct err err = ERR_INIT;

	assert_int_equal(view_check(&v, &err), 0);
	v.ground = v.surface = true;
	assert_int_equal(view_check(&v, &err), -ERR_USAGE);
	err_clear(&err);
	v.ground = false;
	v.returns = VIEW_RETURNS_LAST;
	assert_int_equal(view_check(&v, &err), -ERR_USAGE);
	err_clear(&err);
	v = VIEW_INIT;
	v.ground = true;
	v.duplicates = VIEW_HIGHEST;
	assert_int_equal(view_check(&v, &err), -ERR_USAGE);
	(void)state;
}

/* Stored domains count by number, reports by name: neither changes. */
static void test_rules(void **state)
{
	static const char *const name[] = {"kept",    "crop", "class", "noise", "returns",  "withheld",
					   "overlap", "z",    "every", "thin",  "duplicate"};

	for (unsigned i = 0; i < VIEW_RULES; i++) {
		assert_non_null(view_rule_text((enum view_rule)i));
		if (i < sizeof name / sizeof *name)
			assert_string_equal(view_rule_text((enum view_rule)i), name[i]);
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_matrix),         cmocka_unit_test(test_preference), cmocka_unit_test(test_places),
		cmocka_unit_test(test_every),          cmocka_unit_test(test_thin),       cmocka_unit_test(test_text_round_trip),
		cmocka_unit_test(test_text),           cmocka_unit_test(test_hash_slots), cmocka_unit_test(test_bad_texts),
		cmocka_unit_test(test_contradictions), cmocka_unit_test(test_rules),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
