/*
 * Files that all tasks write at once: for any number of tasks and any size of blocks, a PLY has the vertices and triangles of the
 * packs, each number at its position, and an STL the same triangles; also where positions have no triangle of their own domain,
 * where all are collinear, and where there are none. Attempts that are killed, that run at once or whose calls fail do no harm,
 * and leave nothing.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "digest.h"
#include "gather.h"
#include "io.h"
#include "mesh_fixture.h"
#include "no_sync.h"
#include "repeat.h"

static char out_folder[128], ply[160], stl[160];

static void out_make(const char *top)
{
	snprintf(out_folder, sizeof(out_folder), "%s/out", top);
	snprintf(ply, sizeof(ply), "%s/x.ply", out_folder);
	snprintf(stl, sizeof(stl), "%s/x.stl", out_folder);
	assert_true(!mkdir(out_folder, 0777) || errno == EEXIST);
}

static unsigned out_files(void)
{
	DIR *d = opendir(out_folder);
	unsigned n = 0;

	assert_non_null(d);
	for (struct dirent *e; (e = readdir(d));)
		n += strcmp(e->d_name, ".") && strcmp(e->d_name, "..");
	closedir(d);
	return n;
}

/* ---- reading the files ---- */

static uint8_t *file_bytes(const char *path, size_t *ret_n)
{
	int fd = open(path, O_RDONLY);
	struct stat st;
	uint8_t *all;

	assert_true(fd >= 0 && !fstat(fd, &st));
	all = malloc((size_t)st.st_size + 1);
	assert_int_equal(read(fd, all, (size_t)st.st_size), st.st_size);
	all[st.st_size] = 0;
	close(fd);
	*ret_n = (size_t)st.st_size;
	return all;
}

struct numbers {
	uint64_t vertices, triangles;
	struct digest digest, vertex_digest;
	struct digest floats; /* of the triangles as STL has them, in any order */
};

/* From the least corner on, so that it does not matter which comes first. */
static void add_floats(struct digest *sum, const float corner[3][3])
{
	float turned[3][3];
	int first = 0;

	for (int i = 1; i < 3; i++)
		if (memcmp(corner[i], corner[first], sizeof(corner[i])) < 0)
			first = i;
	for (int i = 0; i < 3; i++)
		memcpy(turned[i], corner[(first + i) % 3], sizeof(turned[i]));
	digest_add(sum, digest_hash(turned, sizeof(turned)));
}

static const uint8_t *ply_counts(const uint8_t *all, struct numbers *ret)
{
	const char *end = strstr((const char *)all, "end_header\n");
	unsigned long long v, t;

	assert_non_null(end);
	assert_int_equal(sscanf(strstr((const char *)all, "element vertex"), "element vertex %llu", &v), 1);
	assert_int_equal(sscanf(strstr((const char *)all, "element face"), "element face %llu", &t), 1);
	ret->vertices = v;
	ret->triangles = t;
	return (const uint8_t *)end + strlen("end_header\n");
}

static struct numbers read_ply(void)
{
	enum { VERTEX = 24, FACE = 13 };
	struct numbers n = {0};
	size_t size;
	uint8_t *all = file_bytes(ply, &size);
	const uint8_t *vertex = ply_counts(all, &n), *face = vertex + n.vertices * VERTEX;

	assert_int_equal(size, (size_t)(face - all) + n.triangles * FACE);
	for (uint64_t i = 0; i < n.vertices; i++) {
		double at[3];

		memcpy(at, vertex + i * VERTEX, sizeof(at));
		digest_add_vertex(&n.vertex_digest, llround(at[0] * 100), llround(at[1] * 100), llround(at[2] * 1000));
	}
	for (uint64_t i = 0; i < n.triangles; i++) {
		int64_t corner[3][2];
		float floats[3][3];

		assert_int_equal(face[i * FACE], 3);
		for (int k = 0; k < 3; k++) {
			uint32_t number;
			double at[3];

			memcpy(&number, face + i * FACE + 1 + 4 * k, sizeof(number));
			assert_true(number < n.vertices);
			memcpy(at, vertex + (size_t)number * VERTEX, sizeof(at));
			for (int c = 0; c < 3; c++)
				floats[k][c] = (float)at[c];
			corner[k][0] = llround(at[0] * 100);
			corner[k][1] = llround(at[1] * 100);
		}
		digest_add_triangle(&n.digest, (const int64_t(*)[2])corner);
		add_floats(&n.floats, (const float(*)[3])floats);
	}
	free(all);
	return n;
}

static struct numbers read_stl(void)
{
	enum { HEAD = 84, EACH = 50 };
	struct numbers n = {0};
	uint32_t count;
	size_t size;
	uint8_t *all = file_bytes(stl, &size);

	assert_true(size >= HEAD);
	memcpy(&count, all + 80, sizeof(count));
	assert_int_equal(size, HEAD + (size_t)count * EACH);
	n.triangles = count;
	for (uint32_t i = 0; i < count; i++) {
		float floats[3][3];

		memcpy(floats, all + HEAD + (size_t)i * EACH + 12, sizeof(floats));
		add_floats(&n.floats, (const float(*)[3])floats);
	}
	free(all);
	return n;
}

/* ---- runs ---- */

struct sharing {
	struct run run;
	struct ctl_fetch_options options;
	struct gather_params p;
};

static void outputs_of(struct sharing *s, bool floats)
{
	s->options = (struct ctl_fetch_options){.output[1].path = ply};
	if (floats)
		s->options.output[2].path = stl;
}

static void begin(struct sharing *s, struct set set, uint32_t tasks, uint32_t gathers, uint64_t block, bool floats)
{
	run_gathers = gathers;
	set_up(&s->run, set, 2, tasks);
	outputs_of(s, floats);
	s->p = (struct gather_params){.work = s->run.work, .outputs = &s->options, .memory = 64 << 20, .block = block};
}

struct counts {
	uint64_t extra, looked_up, domains;
};

static void add_counts(const struct sharing *s, uint32_t task, struct counts *c)
{
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	uint64_t extra, looked_up, domains;

	CHECK(work_record_need(s->run.work, WORK_GATHER, task, &record, &err));
	CHECK(work_record_u64(record, "extra", &extra, &err));
	CHECK(work_record_u64(record, "looked_up", &looked_up, &err));
	CHECK(work_record_u64(record, "domains", &domains, &err));
	c->extra += extra;
	c->looked_up += looked_up;
	c->domains += domains;
	work_record_free(record);
}

static void check_files(const struct sharing *s)
{
	const bool floats = s->options.output[2].path != NULL;
	struct mesh_sums sums;
	struct whole whole;
	struct numbers n = read_ply();

	whole_gather(&s->run, &whole, &sums);
	assert_int_equal(n.vertices, sums.vertices);
	assert_int_equal(n.triangles, sums.triangles);
	assert_true(digest_equal(n.digest, sums.digest));
	assert_true(digest_equal(n.vertex_digest, sums.vertex_digest));
	if (floats) {
		const struct numbers other = read_stl();

		assert_int_equal(other.triangles, n.triangles);
		assert_true(digest_equal(other.floats, n.floats));
	}
	assert_int_equal(out_files(), 1 + floats);
	whole_free(&whole);
}

static void remove_files(void)
{
	unlink(ply);
	unlink(stl);
	assert_int_equal(out_files(), 0);
}

/* All tasks, in some order. */
static void gather_all(struct sharing *s, uint64_t *seed, struct counts *c)
{
	uint32_t n = work_about(s->run.work)->tasks[WORK_GATHER], first = (uint32_t)random_below(seed, n);
	struct err err = ERR_INIT;

	CHECK(gather_sum(&s->p, &err));
	for (uint32_t i = 0; i < n; i++)
		CHECK(gather_task(&s->p, (first + i) % n, &err));
	CHECK(gather_finish(&s->p, &err));
	for (uint32_t i = 0; i < n; i++)
		add_counts(s, i, c);
}

/* Coordinates that floats tell apart. */
static bool is_near(const struct set *set)
{
	for (size_t i = 0; i < set->n; i++)
		if (llabs(set->pts[i].x) > 200000 || llabs(set->pts[i].y) > 200000 || llabs(set->pts[i].z) > 1000000)
			return false;
	return true;
}

static void test_small(void **state)
{
	uint64_t first = repeat_first(), triangles = 0, flat = 0, empty = 0, floats = 0;
	struct counts c = {0};

	(void)state;
	for (uint64_t i = 0; i < repeat_cases(500); i++) {
		uint64_t seed = first * 1000003 + i;
		uint32_t tasks = 1 + (uint32_t)random_below(&seed, 5), gathers = 2 + (uint32_t)random_below(&seed, 7);
		uint64_t block = 1 + random_below(&seed, random_below(&seed, 3) ? 700 : 20000);
		struct set set = small_set(&seed);
		struct numbers n;
		struct sharing s;

		begin(&s, set, tasks, gathers, block, is_near(&set));
		s.run.p.view = random_below(&seed, 8) ? "" : "ask 1 class=77";
		s.run.p.load = 1 + (uint32_t)random_below(&seed, 60);
		s.run.p.cap = s.run.p.load + 20000;
		s.run.p.top = (uint32_t)random_below(&seed, 400);
		run_all(&s.run);
		gather_all(&s, &seed, &c);
		check_files(&s);
		n = read_ply();
		triangles += n.triangles;
		flat += n.vertices && !n.triangles;
		empty += !n.vertices;
		floats += s.options.output[2].path != NULL;
		remove_files();
		run_remove(&s.run);
	}
	print_message(
		"%llu triangles, %llu flat, %llu empty, %llu with STL; %llu domains read, %llu corners looked up, %llu positions without "
		"triangles of their own\n",
		(unsigned long long)triangles, (unsigned long long)flat, (unsigned long long)empty, (unsigned long long)floats,
		(unsigned long long)c.domains, (unsigned long long)c.looked_up, (unsigned long long)c.extra);
	assert_true(triangles && flat && empty && floats && c.extra && c.looked_up > 100);
}

/* More than the numbers of a file can count is refused before its first byte. */
static void test_too_many(void **state)
{
	static const char *const name[] = {"ply", "stl"};

	(void)state;
	for (unsigned i = 0; i < 2; i++) {
		const struct acut_mesh_tail tail = {.vertices = i ? 3 : 1ull << 32, .triangles = i ? 1ull << 32 : 1};
		const struct format_options options = {.canonical = false};
		const struct format *f = format_find(name[i]);
		struct err err = ERR_INIT;
		uint8_t *bytes = NULL;
		void *writer = NULL;
		size_t size, triangle;

		CHECK(f->open(NULL, &options, &writer, &err));
		assert_int_equal(f->fixed->front(writer, NULL, &tail, &bytes, &size, &triangle, &err), -ERR_LIMIT);
		assert_non_null(strstr(err.hint, i ? "--tile" : "OBJ"));
		f->free(writer);
	}
}

/* ---- attempts ---- */

static void begin_some(struct sharing *s, size_t points, uint32_t gathers)
{
	begin(s, set_make(SHAPE_UNIFORM, points, 5, 11), 2, gathers, 4096, false);
	s->run.p.load = 100;
	s->run.p.cap = 20000;
	run_all(&s->run);
}

static void begin_medium(struct sharing *s, uint32_t gathers)
{
	begin_some(s, 4000, gathers);
}

/* A process of its own; task of gather, or finish. `at`: it is killed when it asks so often whether it was interrupted. */
static pid_t start(const struct sharing *s, uint32_t task, unsigned at)
{
	pid_t pid = fork();

	if (pid == 0) {
		struct gather_params p = s->p;
		struct err err = ERR_INIT;

		p.work = run_opened(&s->run, at);
		work_set_patience(p.work, 5);
		if (gather_sum(&p, &err))
			_exit(1);
		_exit(task == work_about(p.work)->tasks[WORK_GATHER] ? gather_finish(&p, &err) != 0 :
								       gather_task(&p, task, &err) != 0);
	}
	assert_true(pid > 0);
	return pid;
}

static void forget(const struct sharing *s)
{
	char name[64];

	for (uint32_t i = 0; i < work_about(s->run.work)->tasks[WORK_GATHER]; i++) {
		snprintf(name, sizeof(name), "done/gather-%u", i);
		unlinkat(work_fd(s->run.work), name, 0);
	}
	unlinkat(work_fd(s->run.work), "done/finish-0", 0);
	unlinkat(work_fd(s->run.work), "shared-0-0000000000000007", 0);
}

/* All attempts of a task end well. */
static void test_at_once(void **state)
{
	enum { GATHERS = 2, ATTEMPTS = 3 };
	struct sharing s;

	(void)state;
	begin_medium(&s, GATHERS);
	for (unsigned i = 0; i < repeat_cases(10); i++) {
		pid_t pid[GATHERS * ATTEMPTS];

		for (unsigned k = 0; k < GATHERS * ATTEMPTS; k++)
			pid[k] = start(&s, k % GATHERS, 0);
		for (unsigned k = 0; k < GATHERS * ATTEMPTS; k++)
			assert_int_equal(status_of(pid[k]), 0);
		for (unsigned k = 0; k < ATTEMPTS; k++)
			pid[k] = start(&s, GATHERS, 0);
		for (unsigned k = 0; k < ATTEMPTS; k++)
			assert_int_equal(status_of(pid[k]), 0);
		check_files(&s);
		forget(&s);
		remove_files();
	}
	run_remove(&s.run);
}

static void test_killed(void **state)
{
	enum { GATHERS = 3 };
	struct sharing s;
	unsigned killed = 0;

	(void)state;
	begin_medium(&s, GATHERS);
	for (unsigned at = 1; at < 40; at += 3 * repeat_step(5)) {
		for (uint32_t task = 0; task <= GATHERS; task++) {
			killed += WIFSIGNALED(status_of(start(&s, task, at)));
			assert_int_equal(status_of(start(&s, task, 0)), 0);
		}
		check_files(&s);
		forget(&s);
		remove_files();
	}
	assert_true(killed > 5);
	run_remove(&s.run);
}

/* Late attempts that would write other bytes change nothing: one whose task has its record, one that begins when the run is over
 * and sees no record, and one of finish. */
static void test_late(void **state)
{
	struct counts c = {0};
	struct err err = ERR_INIT;
	struct sharing s;
	struct gather_params other;
	struct ctl_fetch_options moved;
	uint64_t seed = 1;
	uint8_t *before, *after;
	size_t n, m;

	(void)state;
	begin_medium(&s, 2);
	moved = s.options;
	moved.output[1].origin = "1000,2000,0";
	other = s.p;
	other.outputs = &moved;
	CHECK(gather_sum(&s.p, &err));
	for (uint32_t i = 0; i < 2; i++) {
		CHECK(gather_task(&s.p, i, &err));
		CHECK(gather_task(&other, i, &err));
	}
	gather_all(&s, &seed, &c);
	check_files(&s);
	before = file_bytes(ply, &n);
	CHECK(gather_finish(&other, &err));
	assert_int_equal(unlinkat(work_fd(s.run.work), "done/gather-1", 0), 0);
	assert_int_equal(gather_task(&other, 1, &err), -ERR_GONE);
	assert_non_null(strstr(err.hint, "resume"));
	after = file_bytes(ply, &m);
	assert_true(n == m && !memcmp(before, after, n));
	assert_int_equal(out_files(), 1);
	free(before);
	free(after);
	remove_files();
	run_remove(&s.run);
}

/* It would write other bytes if it made another file: here the fixture shows that it can. */
static void test_other_bytes(void **state)
{
	struct ctl_fetch_options moved;
	struct err err = ERR_INIT;
	struct counts c = {0};
	struct sharing s;
	uint64_t seed = 1;
	uint8_t *one, *two;
	size_t n, m;

	(void)state;
	begin_medium(&s, 2);
	gather_all(&s, &seed, &c);
	one = file_bytes(ply, &n);
	forget(&s);
	moved = s.options;
	moved.output[1].origin = "1000,2000,0";
	s.p.outputs = &moved;
	gather_all(&s, &seed, &c);
	two = file_bytes(ply, &m);
	assert_true(n != m || memcmp(one, two, n));
	err_clear(&err);
	free(one);
	free(two);
	remove_files();
	run_remove(&s.run);
}

static int gate[2] = {-1, -1}; /* an attempt waits here, when it asks whether it was interrupted */

static int wait_gate(void *ctx)
{
	static unsigned asked;
	char byte;

	if (++asked == 6) {
		assert_int_equal(write(gate[1], "w", 1), 1);
		assert_int_equal(read(gate[1], &byte, 1), 1);
	}
	return 0;
}

/* An attempt that has the file open is stopped, and goes on when its task was done again, the output has its name, and the user
 * has put another file in its place. Neither file changes. */
static void test_open_late(void **state)
{
	static const char mine[] = "this file is of a later run";
	struct err err = ERR_INIT;
	struct counts c = {0};
	struct sharing s;
	uint64_t seed = 1;
	uint8_t *before, *after;
	char kept[200], byte;
	size_t n, m;
	pid_t pid;
	int fd;

	(void)state;
	begin_medium(&s, 2);
	CHECK(gather_sum(&s.p, &err));
	assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, gate), 0);
	pid = fork();
	if (pid == 0) {
		struct gather_params p = s.p;

		p.work = run_opened(&s.run, 0);
		work_set_interrupt(p.work, wait_gate, NULL);
		_exit(gather_task(&p, 1, &err) != 0);
	}
	assert_int_equal(read(gate[0], &byte, 1), 1);
	gather_all(&s, &seed, &c);
	check_files(&s);
	before = file_bytes(ply, &n);
	snprintf(kept, sizeof(kept), "%s/kept", run_top);
	assert_int_equal(rename(ply, kept), 0);
	fd = open(ply, O_WRONLY | O_CREAT | O_EXCL, 0600);
	assert_int_equal(write(fd, mine, sizeof(mine)), sizeof(mine));
	close(fd);
	assert_int_equal(write(gate[0], "g", 1), 1);
	assert_int_equal(status_of(pid), 0);
	after = file_bytes(kept, &m);
	assert_true(n == m && !memcmp(before, after, n));
	free(after);
	after = file_bytes(ply, &m);
	assert_true(m == sizeof(mine) && !memcmp(after, mine, m));
	assert_int_equal(out_files(), 1);
	free(before);
	free(after);
	close(gate[0]);
	close(gate[1]);
	unlink(kept);
	remove_files();
	run_remove(&s.run);
}

/* Finish believes no file that is not as it was made. */
static void test_torn(void **state)
{
	struct err err = ERR_INIT;
	struct sharing s;
	char path[512];
	DIR *d;

	(void)state;
	begin_medium(&s, 2);
	CHECK(gather_sum(&s.p, &err));
	for (uint32_t i = 0; i < 2; i++)
		CHECK(gather_task(&s.p, i, &err));
	d = opendir(out_folder);
	assert_non_null(d);
	path[0] = 0;
	for (struct dirent *e; (e = readdir(d));)
		if (strstr(e->d_name, ".part"))
			snprintf(path, sizeof(path), "%s/%s", out_folder, e->d_name);
	closedir(d);
	assert_true(*path);
	assert_int_equal(truncate(path, 5000), 0);
	assert_int_equal(gather_finish(&s.p, &err), -ERR_CORRUPT);
	assert_true(access(ply, F_OK));
	CHECK(gather_clean(&s.p, &err));
	assert_int_equal(out_files(), 0);
	run_remove(&s.run);
}

/* ---- calls that fail ---- */

static const struct io_table *usual;
static struct io_table table;
static unsigned calls, fail_at;

static bool fails(int sys)
{
	errno = sys;
	return ++calls == fail_at;
}

static ssize_t fail_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	return fails(ENOSPC) ? -1 : usual->pwrite(fd, buf, n, off);
}

static ssize_t fail_pread(int fd, void *buf, size_t n, off_t off)
{
	return fails(EIO) ? -1 : usual->pread(fd, buf, n, off);
}

static int fail_fsync(int fd)
{
	return fails(EIO) ? -1 : 0;
}

static int fail_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	return fails(EACCES) ? -1 : usual->openat(dirfd, path, flags, mode);
}

static int fail_linkat(int olddir, const char *old, int newdir, const char *name, int flags)
{
	return fails(EIO) ? -1 : usual->linkat(olddir, old, newdir, name, flags);
}

static int fail_renameat(int olddir, const char *old, int newdir, const char *name)
{
	return fails(EIO) ? -1 : usual->renameat(olddir, old, newdir, name);
}

/* Once each call of a task or of finish; the next attempt makes everything good. */
static void test_failures(void **state)
{
	enum { GATHERS = 2 };
	struct err err = ERR_INIT;
	struct sharing s;
	unsigned failed = 0;

	(void)state;
	begin_some(&s, 1200, GATHERS);
	CHECK(gather_sum(&s.p, &err));
	usual = io;
	table = *usual;
	table.pwrite = fail_pwrite;
	table.pread = fail_pread;
	table.fsync = fail_fsync;
	table.openat = fail_openat;
	table.linkat = fail_linkat;
	table.renameat = fail_renameat;
	for (uint32_t phase = 0; phase <= GATHERS; phase++) {
		for (unsigned at = 1, more = 1; more; at += repeat_step(7)) {
			int r;

			err = (struct err)ERR_INIT;

			for (uint32_t task = 0; task < phase; task++)
				CHECK(gather_task(&s.p, task, &err));
			calls = 0;
			fail_at = at;
			io = &table;
			r = phase < GATHERS ? gather_task(&s.p, phase, &err) : gather_finish(&s.p, &err);
			io = usual;
			more = calls >= at;
			failed += r != 0;
			assert_true(!r || err.message[0]);
			err = ERR_INIT;
			for (uint32_t task = 0; task < GATHERS; task++)
				CHECK(gather_task(&s.p, task, &err));
			CHECK(gather_finish(&s.p, &err));
			check_files(&s);
			forget(&s);
			remove_files();
		}
	}
	print_message("%u calls that failed\n", failed);
	assert_true(failed > 20);
	run_remove(&s.run);
}

static int setup(void **state)
{
	no_sync();
	run_begin(state);
	out_make(run_top);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_small),     cmocka_unit_test(test_too_many), cmocka_unit_test(test_at_once),
		cmocka_unit_test(test_killed),    cmocka_unit_test(test_late),     cmocka_unit_test(test_other_bytes),
		cmocka_unit_test(test_open_late), cmocka_unit_test(test_torn),     cmocka_unit_test(test_failures),
	};

	return cmocka_run_group_tests(tests, setup, run_end);
}
