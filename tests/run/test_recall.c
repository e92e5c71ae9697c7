/*
 * The memory of stored domains: after a push of one point, planning reads few of their files. Files that were removed or damaged
 * only cost time.
 *
 * Linked with --wrap of store_proof, by which planning reads a file.
 */
#include "fixture.h"

#include "store.h"

enum { POINTS = 400000, PUSHES = 4 };

static atomic_uint reads;

int __real_store_proof(int dirfd, const struct store_id *id, void *memory, size_t size, struct store_front *ret, struct err *err);
int __wrap_store_proof(int dirfd, const struct store_id *id, void *memory, size_t size, struct store_front *ret, struct err *err);

int __wrap_store_proof(int dirfd, const struct store_id *id, void *memory, size_t size, struct store_front *ret, struct err *err)
{
	reads++;
	return __real_store_proof(dirfd, id, memory, size, ret, err);
}

/* The first push has the survey, each other one a point. */
static struct job *grow(unsigned pushes, bool job)
{
	struct dataset *d = push("valley", pushes ? 1 : POINTS, 1 + pushes);
	struct job *made = NULL;

	reads = 0;
	if (job) {
		made = submit(d, false, "");
		turn_until_final(made);
		assert_int_equal(info_of(made).state, JOB_done);
	}
	dataset_release(d);
	return made;
}

static unsigned files;

static int remove_file(const char *path, const struct stat *st, int kind, struct FTW *ftw)
{
	files += kind == FTW_F;
	return kind == FTW_F ? remove(path) : 0;
}

/* Damages a byte of the header, and restores the time. */
static int rot_file(const char *path, const struct stat *st, int kind, struct FTW *ftw)
{
	const struct timespec times[2] = {st->st_atim, st->st_mtim};
	uint8_t byte;
	int fd;

	if (kind != FTW_F)
		return 0;
	files++;
	fd = open(path, O_RDWR | O_CLOEXEC);
	assert_int_equal(pread(fd, &byte, 1, 100), 1);
	byte ^= 1;
	assert_int_equal(pwrite(fd, &byte, 1, 100), 1);
	close(fd);
	return utimensat(AT_FDCWD, path, times, 0);
}

static void each_stored(int (*what)(const char *, const struct stat *, int, struct FTW *))
{
	char path[128];

	files = 0;
	snprintf(path, sizeof path, "%s/domains", h.folder);
	assert_int_equal(nftw(path, what, 16, FTW_PHYS), 0);
}

/* The digest of the mesh of that many pushes, made with an empty store. */
static void check(void **state, const struct job *job, unsigned pushes)
{
	char digest[2][DIGEST_HEX_SIZE];
	struct job *made;

	snprintf(digest[0], sizeof digest[0], "%s", info_of(job).report->digest);
	assert_int_equal(teardown(state), 0);
	assert_int_equal(setup(state), 0);
	for (unsigned i = 0; i < pushes; i++)
		made = grow(i, i + 1 == pushes);
	assert_int_equal(info_of(made).report->domains_reused, 0);
	snprintf(digest[1], sizeof digest[1], "%s", info_of(made).report->digest);
	assert_string_equal(digest[0], digest[1]);
}

static void few_are_read(void **state)
{
	const struct job_report *r;
	struct job *job = grow(0, true);

	for (unsigned i = 1; i < PUSHES; i++) {
		job = grow(i, true);
		r = info_of(job).report;
		assert_true(r->domains >= 8 && r->domains_reused >= r->domains / 2);
		printf("%u of %llu domains read, %llu made\n", (unsigned)reads, (unsigned long long)r->domains,
		       (unsigned long long)(r->domains - r->domains_reused));
		assert_true(reads < r->domains / 2);
	}
	check(state, job, PUSHES);
}

static void gone(void **state)
{
	struct job *job;

	grow(0, true);
	grow(1, true);
	each_stored(remove_file);
	assert_true(files >= 8);
	job = grow(2, true);
	assert_int_equal(info_of(job).report->domains_reused, 0);
	each_stored(remove_file);
	assert_true(files >= 8); /* they were made and stored again */
	check(state, job, 3);
}

/* The sums are unchanged. */
static void rotten(void **state)
{
	struct job *job;

	grow(0, true);
	each_stored(rot_file);
	assert_true(files >= 8);
	job = grow(1, true);
	check(state, job, 2);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {TEST(few_are_read), TEST(gone), TEST(rotten)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
