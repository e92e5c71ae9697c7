/*
 * COPC files read through a crop box: every point of the box is there, less than the whole is read, in one go or in
 * parts; and hierarchies that lie, each made from a real one, which must cost a warning and nothing else.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "decimal.h"
#include "fixture.h"

static int failures;

#define CHECK(condition, ...) \
	((condition) ? (void)0 : (failures++, printf("%s: ", what), printf(__VA_ARGS__), (void)putchar('\n')))

/* What was read, and of it what lies in a box; sums do not depend on the order. */
struct sums {
	uint64_t points, inside, hash;
};

static void add(struct sums *s, const struct input_points *pts, const struct lattice_input *coords, const double crop[4])
{
	double scale[2], offset[2];

	for (int k = 0; k < 2; k++) {
		scale[k] = decimal_double(coords->scale[k]);
		offset[k] = decimal_double(coords->offset[k]);
	}
	for (size_t i = 0; i < pts->n; i++) {
		double x = (double)pts->raw[i][0] * scale[0] + offset[0], y = (double)pts->raw[i][1] * scale[1] + offset[1];
		uint64_t h = (uint64_t)pts->raw[i][0] * 0x9e3779b97f4a7c15u ^ (uint64_t)pts->raw[i][1] * 0xc2b2ae3d27d4eb4fu ^
			     (uint64_t)pts->raw[i][2] * 0x165667b19e3779f9u;

		s->points++;
		if (x < crop[0] || x > crop[2] || y < crop[1] || y > crop[3])
			continue;
		s->inside++;
		s->hash += (h ^ h >> 29) * 0xbf58476d1ce4e5b9u + pts->cls[i];
	}
}

static int read_all(struct input *in, const double crop[4], struct sums *s, struct err *err)
{
	struct input_points pts;
	int rc;

	fixture_points_new(&pts, 1000);
	while (!(rc = input_read(in, &pts, err)) && pts.n)
		add(s, &pts, &input_info(in)->coords, crop);
	fixture_points_free(&pts);
	return rc;
}

/* `parts`: each part by a reader of its own, the last one first. */
static struct sums read_fd(const char *what, int fd, const double crop[4], bool select, bool parts, struct input_info *ret_info)
{
	struct input_options options = {.planar = true, .has_crop = select};
	struct sums s = {0};
	struct input *in = NULL;
	struct err err = ERR_INIT;
	int rc;

	memcpy(options.crop, crop, sizeof options.crop);
	rc = input_open(fd, what, &options, &in, &err);
	if (!rc) {
		*ret_info = *input_info(in);
		if (!parts)
			rc = read_all(in, crop, &s, &err);
		for (uint64_t n = parts ? ret_info->parts : 0; !rc && n; n--) {
			struct input *part = NULL;

			rc = input_open_part(in, n - 1, n, &part, &err);
			if (!rc)
				rc = read_all(part, crop, &s, &err);
			input_close(part);
		}
	}
	CHECK(!rc, "%s (%s, byte %llu)", err.message, err.field, (unsigned long long)err.offset);
	input_close(in);
	return s;
}

static int open_file(const char *folder, const char *name)
{
	char path[4400];

	snprintf(path, sizeof path, "%s/lidar/%s", folder, name);
	return open(path, O_RDONLY | O_CLOEXEC);
}

/* Boxes all over the extent and beyond; `least` of them must have saved something. */
static void boxes(const char *folder, const char *name, unsigned least)
{
	const char *what = name;
	struct input_info info, all_info;
	unsigned saved = 0;
	int fd = open_file(folder, name);
	uint64_t state = 7;

	CHECK(fd >= 0, "cannot be opened");
	if (fd < 0)
		return;
	read_fd(what, fd, (double[4]){0}, false, false, &info);
	for (int round = 0; round < 40; round++) {
		double crop[4], size[2];
		struct sums some, parts, all;

		for (int k = 0; k < 2; k++) {
			size[k] = info.coords.max[k] - info.coords.min[k];
			crop[k] = info.coords.min[k] + size[k] * (fixture_random(&state) % 1200 / 1000.0 - 0.1);
			crop[2 + k] = crop[k] + size[k] * (fixture_random(&state) % 300 / 1000.0);
		}
		all = read_fd(what, fd, crop, false, false, &all_info);
		some = read_fd(what, fd, crop, true, false, &info);
		parts = read_fd(what, fd, crop, true, true, &info);
		CHECK(some.inside == all.inside && some.hash == all.hash, "box %d: %llu of %llu points", round,
		      (unsigned long long)some.inside, (unsigned long long)all.inside);
		CHECK(parts.points == some.points && parts.hash == some.hash, "box %d: other points in parts", round);
		CHECK(!*info.warning && info.claimed == some.points, "box %d: %s", round, info.warning);
		CHECK(info.partial == (some.points < all.points), "box %d: partial %d", round, info.partial);
		CHECK(info.partial == (info.bytes_selected < info.bytes), "box %d: bytes", round);
		CHECK(!all_info.partial && all_info.bytes_selected == all_info.bytes, "box %d: whole", round);
		saved += info.bytes_selected < info.bytes / 2;
	}
	CHECK(saved >= least, "only %u boxes saved half of the file", saved);
	close(fd);
}

/* ---- hierarchies that lie: las14_pdrf7_1065.copc.laz, whose hierarchy is the end of the file ---- */

enum { INFO = 429, HIERARCHY = 31604, NODES = 65, ENTRY = 32, LENGTH_AT = 31564 };

struct entry {
	int32_t level, x, y, z;
	uint64_t at;
	int32_t bytes, points;
};

_Static_assert(sizeof(struct entry) == ENTRY, "as in the file");

struct lie {
	const char *name;
	void (*tell)(struct bytes *, struct entry *);
	bool harmless;      /* it is only unusual */
	const double *crop; /* NULL: the usual one */
};

static void no_lie(struct bytes *b, struct entry *e)
{
	(void)b, (void)e;
}
static void left_out(struct bytes *b, struct entry *e)
{
	(void)b, e[7].points = 0;
}
static void twice(struct bytes *b, struct entry *e)
{
	(void)b, e[7] = e[8];
}
static void moved(struct bytes *b, struct entry *e)
{
	(void)b, e[7].at++;
}
static void beyond(struct bytes *b, struct entry *e)
{
	(void)b, e[7].at = b->size;
}
static void far_beyond(struct bytes *b, struct entry *e)
{
	(void)b, e[7].at = UINT64_MAX - 4;
}
static void negative_size(struct bytes *b, struct entry *e)
{
	(void)b, e[7].bytes = -5;
}
static void more_points(struct bytes *b, struct entry *e)
{
	(void)b, e[7].points = INT32_MAX;
}
static void no_such_points(struct bytes *b, struct entry *e)
{
	(void)b, e[7].points = -2;
}
static void no_such_node(struct bytes *b, struct entry *e)
{
	(void)b, e[7].x = 4;
}
static void negative_node(struct bytes *b, struct entry *e)
{
	(void)b, e[7].y = -1;
}
static void deep_node(struct bytes *b, struct entry *e)
{
	(void)b, e[7].level = 200;
}
/* The smallest node in the last corner of the cube, whose number has no successor. */
static void last_node(struct bytes *b, struct entry *e)
{
	(void)b;
	e[NODES - 1].level = 31;
	e[NODES - 1].x = e[NODES - 1].y = e[NODES - 1].z = INT32_MAX;
}
static void page_of_itself(struct bytes *b, struct entry *e)
{
	(void)b;
	e[7] = (struct entry){.level = 0, .at = HIERARCHY, .bytes = NODES * ENTRY, .points = -1};
}
static void page_elsewhere(struct bytes *b, struct entry *e)
{
	(void)b;
	e[7] = (struct entry){.level = 2, .at = 1000, .bytes = ENTRY, .points = -1};
}
static void page_cut(struct bytes *b, struct entry *e)
{
	(void)b;
	e[7] = (struct entry){.level = 2, .at = HIERARCHY, .bytes = 33, .points = -1};
}

static void put_double(struct bytes *b, size_t at, double v)
{
	memcpy(b->at + INFO + at, &v, 8);
}
static void put_long(struct bytes *b, size_t at, uint64_t v)
{
	memcpy(b->at + INFO + at, &v, 8);
}
static void small_cube(struct bytes *b, struct entry *e)
{
	(void)e, put_double(b, 24, 1000);
}
static void endless_cube(struct bytes *b, struct entry *e)
{
	(void)e, put_double(b, 24, 1.0 / 0.0);
}
static void moved_cube(struct bytes *b, struct entry *e)
{
	(void)e, put_double(b, 0, 0);
}
static void root_elsewhere(struct bytes *b, struct entry *e)
{
	(void)e, put_long(b, 40, 0);
}
static void root_too_long(struct bytes *b, struct entry *e)
{
	(void)e, put_long(b, 48, 1 << 20);
}
static void no_hierarchy(struct bytes *b, struct entry *e)
{
	(void)e, b->at[HIERARCHY - 60 + 2] = 'C';
}

static bool is_below(const struct entry *e, const struct entry *node)
{
	int up = e->level - node->level;

	return up >= 0 && e->x >> up == node->x && e->y >> up == node->y && e->z >> up == node->z;
}

/* The same nodes on a page for each node of level 1 with pages below it for those of level 2; the root page
 * last. Room for 20 more entries was made. */
static void in_pages(struct bytes *b, struct entry *e)
{
	struct entry old[NODES], *at = e, root[5];
	unsigned n = 1;

	memcpy(old, e, sizeof old);
	root[0] = old[0];
	for (unsigned i = 0; i < NODES; i++) {
		struct entry page[5], *begin;
		unsigned m = 1;

		if (old[i].level != 1)
			continue;
		page[0] = old[i];
		for (unsigned k = 0; k < NODES; k++) {
			if (old[k].level != 2 || !is_below(&old[k], &old[i]))
				continue;
			begin = at;
			for (unsigned j = 0; j < NODES; j++)
				if (is_below(&old[j], &old[k]))
					*at++ = old[j];
			page[m] = old[k];
			page[m].at = HIERARCHY + (uint64_t)(begin - e) * ENTRY;
			page[m].bytes = (int32_t)(at - begin) * ENTRY;
			page[m++].points = -1;
		}
		begin = at;
		memcpy(at, page, m * sizeof *page);
		at += m;
		root[n] = old[i];
		root[n].at = HIERARCHY + (uint64_t)(begin - e) * ENTRY;
		root[n].bytes = (int32_t)(at - begin) * ENTRY;
		root[n++].points = -1;
	}
	memcpy(at, root, n * sizeof *root);
	put_long(b, 40, HIERARCHY + (uint64_t)(at - e) * ENTRY);
	put_long(b, 48, n * ENTRY);
}

static const double last_corner[4] = {638000, 851300, 1e7, 1e7};

static const struct lie lies[] = {
	{"no lie", no_lie, true},
	{"pages below pages", in_pages, true},
	{"a node in the last corner", last_node, true, last_corner},
	{"a node left out", left_out, false},
	{"a node twice, another left out", twice, false},
	{"a node at another byte", moved, false},
	{"a node beyond the file", beyond, false},
	{"a node far beyond", far_beyond, false},
	{"a node of negative size", negative_size, false},
	{"a node of too many points", more_points, false},
	{"a node of -2 points", no_such_points, false},
	{"a node out of the cube", no_such_node, false},
	{"a node below the cube", negative_node, false},
	{"a node of level 200", deep_node, false},
	{"a page that names itself", page_of_itself, false},
	{"a page among the points", page_elsewhere, false},
	{"a page of 33 bytes", page_cut, false},
	{"a cube too small", small_cube, false},
	{"a cube without end", endless_cube, false},
	{"a cube elsewhere", moved_cube, false},
	{"a root page elsewhere", root_elsewhere, false},
	{"a root page too long", root_too_long, false},
	{"no hierarchy", no_hierarchy, false},
};

static struct bytes read_bytes(int fd, size_t more)
{
	struct stat st;
	struct bytes b;

	if (fstat(fd, &st))
		abort();
	b = (struct bytes){calloc(1, (size_t)st.st_size + more), (size_t)st.st_size + more};
	if (pread(fd, b.at, (size_t)st.st_size, 0) != st.st_size)
		abort();
	return b;
}

static void tell(const char *folder, const struct lie *lie)
{
	static const double usual[4] = {635700, 849000, 636000, 849500};
	const double *crop = lie->crop ? lie->crop : usual;
	const char *what = lie->name;
	size_t more = lie->tell == in_pages ? 20 * ENTRY : 0;
	struct entry entries[NODES + 20];
	struct input_info info;
	struct sums all, some;
	int fd = open_file(folder, "las14_pdrf7_1065.copc.laz"), changed;
	struct bytes b = read_bytes(fd, more);
	uint64_t length = (uint64_t)(NODES * ENTRY) + more;

	memcpy(b.at + LENGTH_AT, &length, 8);
	memcpy(entries, b.at + HIERARCHY, (size_t)length);
	lie->tell(&b, entries);
	memcpy(b.at + HIERARCHY, entries, (size_t)length);
	changed = fixture_fd(b.at, b.size);
	all = read_fd(what, fd, crop, false, false, &info);
	some = read_fd(what, changed, crop, true, false, &info);
	CHECK(some.inside == all.inside && some.hash == all.hash && all.inside > 0, "%llu of %llu points",
	      (unsigned long long)some.inside, (unsigned long long)all.inside);
	CHECK(info.partial == lie->harmless, "partial %d", info.partial);
	CHECK(lie->harmless ? !*info.warning : !!strstr(info.warning, "COPC"), "warning \"%s\"", info.warning);
	CHECK(lie->harmless == (some.points < all.points), "%llu points", (unsigned long long)some.points);
	close(changed);
	close(fd);
	free(b.at);
}

int main(void)
{
	const char *folder = fixture_data();

	if (!*folder)
		return 77;
	boxes(folder, "las14_pdrf6_ground_21k.copc.laz", 5);
	boxes(folder, "las14_pdrf7_1065.copc.laz", 10);
	boxes(folder, "las14_pdrf6_tiny_chunk0.copc.laz", 0);
	boxes(folder, "las14_pdrf6.laz", 0);
	for (size_t i = 0; i < sizeof lies / sizeof *lies; i++)
		tell(folder, &lies[i]);
	printf("%zu hierarchies, %d failures\n", sizeof lies / sizeof *lies, failures);
	return failures > 0;
}
