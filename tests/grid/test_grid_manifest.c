/* Manifests: what is written is read back; what breaks a rule is rejected in both directions; random bytes never crash. */
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <xxhash.h>

#include "grid_fixture.h"
#include "ledger.h"

static struct grid_segment_info segment(const char *file, uint64_t points)
{
	struct grid_segment_info s = {
		.points = points, .cells = 3, .bytes = 99999, .box = {-5, INT32_MIN, 7, INT32_MAX}, .sum = {1, ~0ull}};

	snprintf(s.file, sizeof s.file, "%s", file);
	s.classes[0] = 1;
	s.classes[255] = points - 1;
	s.lo = point_morton(-5, INT32_MIN);
	s.hi = point_morton(7, INT32_MAX) - 1;
	return s;
}

static const struct grid_lines some_lines = {{1, 2, 3, ~0ull}, 5, 6, 7, 0, {8, 9}},
			       set_lines = {.bytes = 100, .places = 2, .content = {1, 0}};
static char longest_wkt[GRID_WKT];
static char longest[GRID_SOURCE_NAME], farthest[GRID_SOURCE_PATH], whoever[GRID_USER];
static const struct grid_span first_lives[] = {{1, 2}, {4, 6}};
static struct grid_span lives[2];
static const struct grid_generation first_history[] = {
	{.number = 1,
	 .time_us = INT64_MIN,
	 .uid = UINT32_MAX,
	 .kind = GRID_PUSH,
	 .files = 3,
	 .points_added = ~0ull,
	 .lines_added = ~0ull},
	{.number = 4,
	 .time_us = 7,
	 .kind = GRID_REPLACE,
	 .user = whoever,
	 .files_removed = UINT32_MAX,
	 .lines_removed = 4,
	 .content = {5, 6}},
	{.number = 9, .kind = GRID_REVERT, .undoes = 4, .points_removed = 8, .user = ""},
};
static struct grid_generation history[3];

static struct grid_manifest sample(struct grid_segment_info segments[2])
{
	memcpy(lives, first_lives, sizeof lives);
	memcpy(history, first_history, sizeof history);
	segments[0] = segment("a.seg", 10);
	segments[1] = segment("b.seg", (uint64_t)1 << 60);
	struct grid_manifest m = manifest_of(segments, 2, 4);

	m.generation = 9;
	m.sources[1].added = 4;
	m.sources[1].removed = 9;
	m.sources[1].points = ~(uint64_t)0;
	m.sources[2].hash = (struct digest){3, 4};
	m.sources[3].id = UINT32_MAX;
	memset(longest, 'n', sizeof longest - 1);
	memset(farthest, 'p', sizeof farthest - 1);
	m.sources[3].name = longest;
	m.sources[3].path = farthest;
	m.sources[1].path = "/survey/b.las";
	m.sources[2].overridden = "EPSG:4978, x and y in metre, z in metre";
	m.sources[2].left_out = ~(uint64_t)0;
	m.sources[2].reading = "xyz columns=_nez decimal-comma";
	m.sources[2].size = ~(uint64_t)0;
	m.sources[2].mtime_ns = INT64_MIN;
	m.sources[0].earlier = lives;
	m.sources[0].nearlier = 2;
	m.sources[0].added = 7;
	m.sources[0].points = 0;
	m.sources[0].kind = GRID_LINES;
	m.sources[0].lines = &some_lines;
	m.sources[2].kind = GRID_LINE_VERTICES;
	m.sources[2].lines = &set_lines;
	m.sources[2].name = m.sources[2].path = "";
	strcpy(m.choices, "planar=1");
	memset(longest_wkt, 'w', sizeof longest_wkt - 1);
	m.wkt = longest_wkt;
	m.wkt_since = 9;
	m.oldest = 2;
	memset(whoever, 'u', sizeof whoever - 1);
	m.generations = history;
	m.ngenerations = 3;
	return m;
}

static void assert_same(const struct grid_manifest *a, const struct grid_manifest *b)
{
	assert_true(lattice_equal(&a->lattice, &b->lattice));
	assert_string_equal(a->crs, b->crs);
	assert_string_equal(a->unit_xy, b->unit_xy);
	assert_string_equal(a->unit_z, b->unit_z);
	assert_string_equal(a->geoid, b->geoid);
	assert_string_equal(a->choices, b->choices);
	assert_string_equal(a->wkt ? a->wkt : "", b->wkt);
	assert_true(a->wkt_since == b->wkt_since);
	assert_true(a->generation == b->generation && a->nsegments == b->nsegments && a->nsources == b->nsources);
	for (size_t i = 0; i < a->nsegments; i++) {
		const struct grid_segment_info *s = &a->segments[i], *t = &b->segments[i];

		assert_string_equal(s->file, t->file);
		assert_true(s->points == t->points && s->cells == t->cells && s->bytes == t->bytes);
		assert_memory_equal(s->box, t->box, sizeof s->box);
		assert_true(s->lo == t->lo && s->hi == t->hi);
		assert_memory_equal(s->classes, t->classes, sizeof s->classes);
		assert_true(digest_equal(s->sum, t->sum));
	}
	for (size_t i = 0; i < a->nsources; i++) {
		const struct grid_source *s = &a->sources[i], *t = &b->sources[i];

		assert_true(s->id == t->id && s->added == t->added && s->removed == t->removed);
		assert_true(s->points == t->points && digest_equal(s->hash, t->hash));
		assert_string_equal(s->name, t->name);
		assert_string_equal(s->path ? s->path : "", t->path);
		assert_string_equal(s->overridden ? s->overridden : "", t->overridden);
		assert_true(s->left_out == t->left_out);
		assert_string_equal(s->reading ? s->reading : "", t->reading);
		assert_true(s->size == t->size && s->mtime_ns == t->mtime_ns);
		assert_true(s->nearlier == t->nearlier);
		assert_true(s->kind == t->kind && !s->lines == !t->lines);
		if (s->lines)
			assert_memory_equal(s->lines, t->lines, sizeof *s->lines);
		for (size_t k = 0; k < s->nearlier; k++)
			assert_memory_equal(&s->earlier[k], &t->earlier[k], sizeof *s->earlier);
	}
	assert_true(grid_manifest_oldest(a) == grid_manifest_oldest(b) && a->ngenerations == b->ngenerations);
	for (size_t i = 0; i < a->ngenerations; i++) {
		const struct grid_generation *g = &a->generations[i], *h = &b->generations[i];

		assert_true(g->number == h->number && g->time_us == h->time_us && g->uid == h->uid && g->kind == h->kind);
		assert_true(g->undoes == h->undoes && g->files == h->files && g->files_removed == h->files_removed);
		assert_true(g->points_added == h->points_added && g->points_removed == h->points_removed);
		assert_true(g->lines_added == h->lines_added && g->lines_removed == h->lines_removed);
		assert_true(digest_equal(g->content, h->content));
		assert_string_equal(g->user ? g->user : "", h->user);
	}
}

static void test_back(void **state)
{
	struct grid_segment_info segments[2];
	struct grid_manifest m = sample(segments), *back;
	struct folder f = folder_new();
	struct err err = ERR_INIT;

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	CHECK(grid_manifest_read(f.fd, "m", &back, &err));
	assert_same(&m, back);
	grid_manifest_free(back);
	m.nsegments = m.nsources = m.ngenerations = 0;
	m.crs[0] = 0;
	m.wkt = NULL;
	m.wkt_since = 0;
	strcpy(m.geoid, "orthometric 0123456789abcdef0123456789abcdef egm96-5");
	CHECK(grid_manifest_write(f.fd, "m", &m, &err)); /* replaces the old one */
	CHECK(grid_manifest_read(f.fd, "m", &back, &err));
	assert_same(&m, back);
	grid_manifest_free(back);
	assert_int_equal(folder_files(&f, ""), 1);
	assert_true(grid_manifest_read(f.fd, "absent", &back, &err) == -ERR_CORRUPT && err.sys == ENOENT);
	assert_null(grid_manifest_free(NULL));
	free(m.sources);
	folder_remove(&f);
}

/* The file as an older version wrote it: 1 had no paths, sizes and times of sources; 2 no geoid; 3 no oldest
 * generation, earlier spans and list of generations; 4 no overridden systems and readings; 5 no WKT; 6 no lines. Without
 * segments, one source, no list. */
static size_t make_old(uint32_t version, const uint8_t *bytes, size_t n, uint8_t *ret)
{
	const size_t head = version < 4 ? 40 : 56, from = 60, kind = 1, tail = version < 2 ? 8 + 8 + 2 + 4 : version < 3 ? 4 : 0;
	const size_t spans = version < 4 ? 2 : 0, read = version < 5 ? 2 + 8 + 2 : 0, all_wkt = 2 + 8,
		     wkt = version < 6 ? all_wkt : 0, choices = 4, check = 8;
	size_t at = n - check - all_wkt - choices - kind - read - spans; /* end of the source's path, or of all of it */
	uint64_t size, sum;

	memcpy(ret, bytes, head);
	memcpy(ret + head, bytes + from, at - from);
	at -= from - head;
	memcpy(ret + at, bytes + n - check - all_wkt - choices, choices + all_wkt);
	size = at + choices + all_wkt - wkt - tail + check;
	memcpy(ret + 8, &version, sizeof version);
	memcpy(ret + 16, &size, sizeof size);
	sum = XXH3_64bits(ret, size - 8);
	memcpy(ret + size - 8, &sum, sizeof sum);
	return size;
}

static void old_version(uint32_t version)
{
	struct grid_manifest m = manifest_of(NULL, 0, 1), *back;
	struct grid_generation derived = {.number = 1, .kind = GRID_PUSH, .files = 1, .points_added = 5, .content = {1, 2}};
	struct ledger *ledger = ledger_new(1 << 20);
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	uint8_t bytes[1024], old[1024];
	size_t n;
	int fd;

	m.sources[0].points = 5;
	m.sources[0].hash = (struct digest){1, 2};
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	fd = openat(f.fd, "m", O_RDWR);
	n = (size_t)pread(fd, bytes, sizeof bytes, 0);
	n = make_old(version, bytes, n, old);
	assert_int_equal(pwrite(fd, old, n, 0), n);
	assert_int_equal(ftruncate(fd, (off_t)n), 0);
	close(fd);
	CHECK(grid_manifest_load(f.fd, "m", ledger, &back, &err));
	assert_int_equal(ledger_held(ledger, LEDGER_MANIFEST), back->charged);
	m.generations = &derived;
	m.ngenerations = version < 4;
	assert_same(&m, back);
	grid_manifest_free(back);
	assert_int_equal(ledger_left(ledger), 1 << 20);
	ledger_free(ledger);
	free(m.sources);
	folder_remove(&f);
}

static void test_old_versions(void **state)
{
	old_version(1);
	old_version(2);
	old_version(3);
	old_version(4);
	old_version(5);
	old_version(6);
}

/* A newer version is rejected by name, whatever else it has. */
static void test_newer_version(void **state)
{
	struct grid_manifest m = manifest_of(NULL, 0, 1), *back;
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	uint8_t bytes[1024];
	uint32_t version = 9;
	uint64_t check;
	ssize_t n;
	int fd;

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	fd = openat(f.fd, "m", O_RDWR);
	n = pread(fd, bytes, sizeof bytes, 0);
	memcpy(bytes + 8, &version, sizeof version);
	check = XXH3_64bits(bytes, (size_t)n - 8);
	memcpy(bytes + n - 8, &check, sizeof check);
	assert_int_equal(pwrite(fd, bytes, (size_t)n, 0), n);
	close(fd);
	assert_int_equal(grid_manifest_read(f.fd, "m", &back, &err), -ERR_VERSION);
	assert_non_null(strstr(err.message, "version 9"));
	free(m.sources);
	folder_remove(&f);
}

typedef void (*breaker)(struct grid_manifest *);

static void long_crs(struct grid_manifest *m)
{
	memset(m->crs, 'x', sizeof m->crs);
}
static void twice(struct grid_manifest *m)
{
	m->sources[3].id = m->sources[0].id;
}
static void zero(struct grid_manifest *m)
{
	m->sources[1].id = 0;
}
static void future(struct grid_manifest *m)
{
	m->sources[2].added = 10;
}
static void backwards(struct grid_manifest *m)
{
	m->sources[1].removed = 3;
}
static void same_name(struct grid_manifest *m)
{
	strcpy(m->segments[1].file, m->segments[0].file);
}
static void climbing(struct grid_manifest *m)
{
	strcpy(m->segments[1].file, "../x");
}
static void nameless(struct grid_manifest *m)
{
	m->segments[1].file[0] = 0;
}
static void inside_out(struct grid_manifest *m)
{
	m->segments[0].box[2] = -6;
}
static void range_inside_out(struct grid_manifest *m)
{
	m->segments[0].lo = m->segments[0].hi + 1;
}
static void range_below(struct grid_manifest *m)
{
	m->segments[0].lo--;
}
static void range_above(struct grid_manifest *m)
{
	m->segments[0].hi += 2;
}
static void range_of_none(struct grid_manifest *m)
{
	m->segments[0].points = m->segments[0].cells = m->segments[0].lo = 0;
	memset(m->segments[0].classes, 0, sizeof m->segments[0].classes);
}
static void no_sum(struct grid_manifest *m)
{
	m->segments[0].classes[3] = 1;
}
static void no_cells(struct grid_manifest *m)
{
	m->segments[0].cells = 0;
}
static void long_name(struct grid_manifest *m)
{
	static char name[GRID_SOURCE_NAME + 1];

	memset(name, 'x', sizeof name - 1);
	m->sources[0].name = name;
}
static void long_overridden(struct grid_manifest *m)
{
	static char text[GRID_SOURCE_OVERRIDDEN + 1];

	memset(text, 'x', sizeof text - 1);
	m->sources[0].overridden = text;
}

static void long_reading(struct grid_manifest *m)
{
	static char text[GRID_SOURCE_READING + 1];

	memset(text, 'x', sizeof text - 1);
	m->sources[0].reading = text;
}

static void long_wkt(struct grid_manifest *m)
{
	static char text[GRID_WKT + 1];

	memset(text, 'x', sizeof text - 1);
	m->wkt = text;
}
static void two_lines(struct grid_manifest *m)
{
	m->wkt = "LOCAL_CS[\n]";
}
static void no_text(struct grid_manifest *m)
{
	m->wkt = "LOCAL_CS[\"\xff\"]";
}
static void future_wkt(struct grid_manifest *m)
{
	m->wkt_since = 10;
}

static void no_kind(struct grid_manifest *m)
{
	m->sources[2].kind = GRID_SOURCE_KINDS;
}
static void no_lines(struct grid_manifest *m)
{
	m->sources[2].lines = NULL;
}
static void lines_of_points(struct grid_manifest *m)
{
	m->sources[0].kind = GRID_POINTS;
}
static void points_of_lines(struct grid_manifest *m)
{
	m->sources[0].points = 1;
}
static void named_vertices(struct grid_manifest *m)
{
	m->sources[2].path = "/a";
}
static void two_sets(struct grid_manifest *m)
{
	m->sources[0].kind = GRID_LINE_VERTICES;
	m->sources[0].points = 0;
	m->sources[0].name = m->sources[0].path = "";
}

static void long_path(struct grid_manifest *m)
{
	static char path[GRID_SOURCE_PATH + 1];

	memset(path, 'x', sizeof path - 1);
	m->sources[0].path = path;
}
static void overlapping(struct grid_manifest *m)
{
	lives[1].added = 2;
}
static void unending(struct grid_manifest *m)
{
	lives[1].removed = 7;
}
static void stillborn(struct grid_manifest *m)
{
	lives[0].removed = 1;
}
static void unordered(struct grid_manifest *m)
{
	history[1].number = 1;
}
static void unnumbered(struct grid_manifest *m)
{
	history[0].number = 0;
}
static void not_yet(struct grid_manifest *m)
{
	history[2].number = 10;
}
static void kindless(struct grid_manifest *m)
{
	history[1].kind = GRID_KINDS;
}
static void prophetic(struct grid_manifest *m)
{
	history[1].undoes = 5;
}
static void long_user(struct grid_manifest *m)
{
	static char user[GRID_USER + 1];

	memset(user, 'x', sizeof user - 1);
	history[0].user = user;
}
static void pruned_all(struct grid_manifest *m)
{
	m->oldest = 10;
}
static void scaleless(struct grid_manifest *m)
{
	m->lattice.scale_xy.mantissa = 0;
}

static void test_rules(void **state)
{
	static const breaker breakers[] = {long_crs,         twice,          zero,
					   future,           backwards,      same_name,
					   climbing,         nameless,       inside_out,
					   no_sum,           no_cells,       scaleless,
					   long_name,        long_path,      long_overridden,
					   long_reading,     overlapping,    unending,
					   stillborn,        unordered,      unnumbered,
					   not_yet,          kindless,       prophetic,
					   long_user,        pruned_all,     long_wkt,
					   two_lines,        no_text,        future_wkt,
					   no_kind,          no_lines,       lines_of_points,
					   points_of_lines,  named_vertices, two_sets,
					   range_inside_out, range_below,    range_above,
					   range_of_none};
	struct folder f = folder_new();

	for (unsigned i = 0; i < sizeof breakers / sizeof *breakers; i++) {
		struct grid_segment_info segments[2];
		struct grid_manifest m = sample(segments);
		struct err err = ERR_INIT;

		breakers[i](&m);
		assert_int_equal(grid_manifest_write(f.fd, "m", &m, &err), -ERR_INTERNAL);
		assert_int_equal(folder_files(&f, ""), 0);
		free(m.sources);
	}
	folder_remove(&f);
}

/* Changed bytes with a corrected checksum: accepted only if every rule holds, which writing it again shows. */
static void test_rubbish(void **state)
{
	struct grid_segment_info segments[2];
	struct grid_manifest m = sample(segments);
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	uint8_t bytes[8192], changed[8192];
	uint64_t rng = 3;
	size_t accepted = 0;
	int fd;

	m.wkt = "LOCAL_CS[\"quarry\"]";
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	fd = openat(f.fd, "m", O_RDWR);
	size_t n = (size_t)pread(fd, bytes, sizeof bytes, 0);

	for (int i = 0; i < 20000; i++) {
		struct grid_manifest *got = NULL, *again;
		uint64_t size = i % 3 ? n : n - random_below(&rng, n - 48), check;

		memcpy(changed, bytes, n);
		for (uint64_t k = random_below(&rng, 3) + (size == n); k-- > 0;)
			changed[24 + random_below(&rng, size - 32)] = (uint8_t)(random_below(&rng, 2) ? random_next(&rng) : 255);
		memcpy(changed + 16, &size, sizeof size);
		check = XXH3_64bits(changed, size - 8);
		memcpy(changed + size - 8, &check, sizeof check);
		assert_int_equal(pwrite(fd, changed, size, 0), size);
		assert_int_equal(ftruncate(fd, (off_t)size), 0);
		err_clear(&err);
		int rc = grid_manifest_read(f.fd, "m", &got, &err);

		if (rc) {
			assert_int_equal(rc, -ERR_CORRUPT);
			assert_string_equal(err.file, "m");
			continue;
		}
		if (accepted++ % 50 == 0) { /* writing takes time */
			CHECK(grid_manifest_write(f.fd, "again", got, &err));
			CHECK(grid_manifest_read(f.fd, "again", &again, &err));
			assert_same(got, again);
			grid_manifest_free(again);
		}
		grid_manifest_free(got);
	}
	assert_true(accepted > 100 && accepted < 20000);
	close(fd);
	free(m.sources);
	folder_remove(&f);
}

/* The index is charged by name, rejected while there is not enough memory, and uncharged. */
static void test_ledger(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 5000, 1, 2);
	struct grid_segment_info info;
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	struct ledger *ledger = ledger_new(100000);
	struct grid *g;

	CHECK(stage_set(&f, "a", &s, 0, &info, &err));
	struct grid_manifest m = manifest_of(&info, 1, 1);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	CHECK(grid_open(f.fd, "m", 1, ledger, (size_t)1 << 30, &g, &err)); /* no more frames than pages */
	assert_true(ledger_held(ledger, LEDGER_INDEX) > 16384 && ledger_held(ledger, LEDGER_INDEX) < 40000);
	grid_close(g);
	assert_true(ledger_left(ledger) == 100000);
	assert_true(ledger_take(ledger, LEDGER_STAGE, 99000));
	assert_int_equal(grid_open(f.fd, "m", 1, ledger, 1 << 20, &g, &err), -ERR_BUSY);
	ledger_give(ledger, LEDGER_STAGE, 99000);
	err_clear(&err);
	assert_int_equal(grid_open(f.fd, "m", 2, ledger, 1 << 20, &g, &err), -ERR_NOTFOUND);
	err_clear(&err);
	m.nsources = 0; /* the segment's source is missing */
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	assert_int_equal(grid_open(f.fd, "m", 1, ledger, 1 << 20, &g, &err), -ERR_CORRUPT);
	ledger_free(ledger);
	free(m.sources);
	set_free(&s);
	folder_remove(&f);
}

/* Charged before it is read and until it is freed; too little memory, now or ever, is distinguished from damage. */
static void test_load_charges(void **state)
{
	enum { N = 2000 };
	struct grid_source *sources = calloc(N, sizeof *sources);
	struct grid_manifest *back, *m = calloc(1, sizeof *m);
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	struct ledger *ledger = ledger_new(4 << 20);

	assert_true(lattice_parse("0.01 0.01 0 0 0", &m->lattice));
	strcpy(m->crs, "unknown");
	strcpy(m->unit_xy, "metre");
	strcpy(m->unit_z, "metre");
	m->generation = 1;
	m->sources = sources;
	m->nsources = N;
	for (uint32_t i = 0; i < N; i++)
		sources[i] = (struct grid_source){.id = i + 1, .added = 1, .name = "a name", .path = "/a path/of some length"};
	CHECK(grid_manifest_write(f.fd, "m", m, &err));
	CHECK(grid_manifest_load(f.fd, "m", ledger, &back, &err));
	assert_true(ledger_held(ledger, LEDGER_MANIFEST) >= N * (sizeof *sources + strlen(sources[0].path)));
	assert_int_equal(ledger_held(ledger, LEDGER_MANIFEST), back->charged);
	assert_true(ledger_peak(ledger, LEDGER_MANIFEST) > back->charged);
	grid_manifest_free(back);
	assert_int_equal(ledger_held(ledger, LEDGER_MANIFEST), 0);
	assert_true(ledger_take(ledger, LEDGER_STAGE, (4 << 20) - 4096));
	assert_int_equal(grid_manifest_load(f.fd, "m", ledger, &back, &err), -ERR_BUSY);
	ledger_give(ledger, LEDGER_STAGE, (4 << 20) - 4096);
	assert_true(ledger_left(ledger) == 4 << 20);
	ledger_free(ledger);
	err_clear(&err);
	ledger = ledger_new(100 << 10);
	assert_int_equal(grid_manifest_load(f.fd, "m", ledger, &back, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.hint, "--memory"));
	ledger_free(ledger);
	free(sources);
	free(m);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_back),         cmocka_unit_test(test_old_versions), cmocka_unit_test(test_newer_version),
		cmocka_unit_test(test_rules),        cmocka_unit_test(test_rubbish),      cmocka_unit_test(test_ledger),
		cmocka_unit_test(test_load_charges),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid: manifests", tests, NULL, NULL);
}
