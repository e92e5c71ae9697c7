#include "survey_fixture.h"

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "grid.h"
#include "no_sync.h"
#include "random.h"

char survey_top[64];
static unsigned runs; /* names of work folders */

struct told told;

void check(int r, const struct err *err)
{
	char text[1600];

	if (r)
		fail_msg("%d: %s", r, err_format(err, text, sizeof text));
}

static void refused(void *ctx, const struct err *why)
{
	size_t n = strlen(told.all);

	told.refused++;
	snprintf(told.all + n, sizeof told.all - n, "%s: %s\n", why->file, why->message);
}

static void warned(void *ctx, const char *path, const char *text)
{
	size_t n = strlen(told.all);

	told.warned++;
	snprintf(told.all + n, sizeof told.all - n, "%s: %s\n", path, text);
}

static int interrupted(void *ctx)
{
	if (!told.stop || ++told.asked < told.stop)
		return 0;
	if (told.kills)
		raise(SIGKILL);
	return 1;
}

struct survey_params params(void)
{
	return (struct survey_params){.refused = refused, .warned = warned};
}

/* ---- inputs ---- */

void see(struct work_input *in)
{
	struct stat st;

	assert_int_equal(stat(in->path, &st), 0);
	in->size = (uint64_t)st.st_size;
	in->mtime_ns = (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec;
}

void add(struct inputs *in, const char *name, const char *text)
{
	char *path = in->path[in->n];
	FILE *f;

	snprintf(path, sizeof in->path[0], "%s/%s", survey_top, name);
	f = fopen(path, "w");
	assert_non_null(f);
	fputs(text, f);
	fclose(f);
	in->file[in->n].path = path;
	see(&in->file[in->n++]);
}

static void put(uint8_t *at, const void *value, size_t n)
{
	memcpy(at, value, n); /* LAS is little-endian, as all machines that acut runs on */
}

/* Three points, LAS 1.2 format 0, with the EPSG number of a projected system. */
void add_las(struct inputs *in, const char *name, uint16_t epsg, int32_t x)
{
	enum { HEAD = 227, KEYS = 54 + 24 };
	static const double box[6] = {500100, 500000, 5400010, 5400000, 110, 100};
	const uint16_t keys[12] = {1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, epsg};
	uint8_t all[HEAD + KEYS + 60] = "LASF", *at = all + HEAD;
	const uint16_t head = HEAD, key = 34735, bytes = sizeof keys, record = 20;
	const uint32_t start = HEAD + KEYS, n = 3, one = 1;
	FILE *f;

	all[24] = 1;
	all[25] = 2;
	put(all + 94, &head, 2);
	put(all + 96, &start, 4);
	put(all + 100, &one, 4);
	put(all + 105, &record, 2);
	put(all + 107, &n, 4);
	put(all + 111, &n, 4);
	for (int k = 0; k < 3; k++)
		put(all + 131 + 8 * k, &(double){.01}, 8);
	put(all + 179, box, sizeof box);
	strcpy((char *)at + 2, "LASF_Projection");
	put(at + 18, &key, 2);
	put(at + 20, &bytes, 2);
	put(at + 54, keys, sizeof keys);
	for (int i = 0; i < 3; i++) {
		const int32_t p[3] = {50000000 + x + i * 10, 540000000 + i * i, 10000 + i};

		put(all + start + 20 * i, p, sizeof p);
		all[start + 20 * i + 14] = 0x09;
		all[start + 20 * i + 15] = 2;
	}
	add(in, name, "");
	f = fopen(in->path[in->n - 1], "w");
	assert_int_equal(fwrite(all, 1, sizeof all, f), sizeof all);
	fclose(f);
	see(&in->file[in->n - 1]);
}

/* Tiles in rows of four; some have more points than others, and one has none of its own. */
struct inputs tiles(void)
{
	static struct inputs in;
	static char text[POINTS * 3 * 64];
	uint64_t seed = 7;

	in.n = 0;
	for (unsigned i = 0; i < FILES; i++) {
		unsigned n = POINTS * (1 + i % 3);
		size_t at = 0;
		char name[32];

		for (unsigned k = 0; k < n; k++) {
			unsigned x = (unsigned)random_below(&seed, 10000), y = (unsigned)random_below(&seed, 10000);

			at += (size_t)snprintf(text + at, sizeof text - at, "%u.%02u %u.%02u %u.%u\n",
					       500000 + i % 4 * 100 + x / 100, x % 100, 5400000 + i / 4 * 100 + y / 100, y % 100,
					       100 + k % 50, k % 10);
		}
		snprintf(name, sizeof name, "tile%u.xyz", i * 7 % FILES);
		add(&in, name, text);
	}
	return in;
}

/* ---- runs ---- */

const struct shape one_stage = {1, 64 << 20, 0};

struct work *open_work(const char *folder)
{
	struct work *w = NULL;
	struct err err = ERR_INIT;

	check(work_open(folder, &w, &err), &err);
	work_set_patience(w, 0);
	work_set_interrupt(w, interrupted, NULL);
	return w;
}

struct work *make_run(const struct inputs *in, const struct shape *shape)
{
	struct work_about about = {.id = 0x1234, .memory = shape->memory};
	char folder[128];
	struct work *w;
	struct err err = ERR_INIT;

	about.tasks[WORK_HEAD] = about.tasks[WORK_COMMIT] = 1;
	about.tasks[WORK_STAGE] = shape->stages;
	about.tasks[WORK_SORT] = shape->sorts;
	snprintf(folder, sizeof folder, "%s/work%u", survey_top, runs++);
	check(work_make(folder, &about, in->file, in->n, &w, &err), &err);
	work_set_patience(w, 0);
	work_set_interrupt(w, interrupted, NULL);
	return w;
}

void run_all(struct work *w, const struct survey_params *p)
{
	struct err err = ERR_INIT;

	check(survey_head(w, p, &err), &err);
	for (uint32_t i = 0; i < work_about(w)->tasks[WORK_STAGE]; i++)
		check(survey_stage(w, i, p, &err), &err);
	for (uint32_t i = 0; i < work_about(w)->tasks[WORK_SORT]; i++)
		check(survey_sort(w, i, p, &err), &err);
	check(survey_commit(w, p, &err), &err);
}

uint64_t value_of(struct work *w, enum work_phase phase, uint32_t task, const char *key)
{
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	uint64_t n = 0;

	check(work_record_need(w, phase, task, &record, &err), &err);
	check(work_record_u64(record, key, &n, &err), &err);
	work_record_free(record);
	return n;
}

/* As the clients choose files of a dataset to import. */
static bool is_imported(const char *name)
{
	size_t k = strlen(name);

	return !strcmp(name, "manifest") || (k > 4 && !strcmp(name + k - 4, ".seg")) || !strcmp(name, "sources") ||
	       (!strncmp(name, "sources-", 8) && !strchr(name, '.'));
}

struct content content_of(struct work *w)
{
	struct content c = {.points = 0};
	struct grid_manifest *m;
	struct grid *g;
	struct err err = ERR_INIT;
	struct dirent *e;
	struct work_record *record = NULL;
	size_t files = 0;
	char name[64];
	DIR *dir;
	int fd;

	check(io_open(work_fd(w), WORK_IN_DATASET, O_RDONLY | O_DIRECTORY, 0, &fd, &err), &err);
	check(grid_open(fd, "manifest", GRID_NEWEST, NULL, 1 << 20, &g, &err), &err);
	check(grid_manifest_read(fd, "manifest", &m, &err), &err);
	c.digest = grid_content(g);
	c.points = grid_points(g);
	c.sources = m->nsources;
	c.segments = m->nsegments;
	for (size_t i = 0; i < m->nsources; i++) {
		unsigned k = FILES;

		assert_non_null(m->sources[i].name);
		if (sscanf(m->sources[i].name, "tile%u.xyz", &k) == 1) {
			assert_true(k < FILES);
			c.hash[k] = m->sources[i].hash;
			c.id[k] = m->sources[i].id;
		}
	}
	assert_int_equal(m->ngenerations, 1);
	assert_int_equal(m->generations[0].kind, GRID_PUSH);
	assert_int_equal(m->generations[0].points_added, c.points);
	assert_int_equal(m->generations[0].files, c.sources);
	dir = fdopendir(fd);
	while ((e = readdir(dir)))
		files += *e->d_name != '.' && (!told.left || is_imported(e->d_name));
	assert_int_equal(files, 1 + m->nsegments + m->nfiles);
	assert_int_equal(m->nfiles, 1);
	snprintf(name, sizeof name, "sources-%016llx", (unsigned long long)m->files[0].check);
	assert_string_equal(m->files[0].name, name);
	check(work_record_need(w, WORK_COMMIT, 0, &record, &err), &err);
	assert_int_equal(record->nfile, 2);
	assert_string_equal(record->file[0].name, "dataset/manifest");
	assert_string_equal(record->file[1].name + strlen("dataset/"), name);
	work_record_free(record);
	assert_int_equal(value_of(w, WORK_COMMIT, 0, "bytes"), grid_manifest_bytes(m));
	grid_manifest_free(m);
	grid_close(g);
	closedir(dir);
	return c;
}

void same(const struct content *a, const struct content *b)
{
	assert_true(digest_equal(a->digest, b->digest));
	assert_int_equal(a->points, b->points);
	assert_int_equal(a->sources, b->sources);
	for (unsigned i = 0; i < FILES; i++) {
		assert_true(digest_equal(a->hash[i], b->hash[i]));
		assert_int_equal(a->id[i], b->id[i]);
	}
}

int setup(void **state)
{
	memset(&told, 0, sizeof told);
	no_sync();
	grid_sources_here = 0; /* every commit makes a file of sources */
	strcpy(survey_top, "/tmp/acut-survey-XXXXXX");
	return mkdtemp(survey_top) ? 0 : -1;
}

int teardown(void **state)
{
	struct err err = ERR_INIT;

	io = &io_system;
	return io_folder_remove(AT_FDCWD, survey_top, &err);
}
