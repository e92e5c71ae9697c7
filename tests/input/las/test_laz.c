/*
 * Compressed files that are not as they were: cut, changed at random, with other chunk tables, read in parts,
 * with file calls that fail. Made from the small real ones. Every one ends in points or in one clear error, in
 * the memory that input_info says; what is read of a cut file is the beginning of the whole one.
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <xxhash.h>

#include "account.h"

#include "fixture.h"
#include "io.h"
#include "repeat.h"

enum { BATCH = 100, BATCH_BYTES = BATCH * (24 + 3), NAMES = 17 };

/* One of each point format and item version, up to 60 KB. */
static const char *const names[NAMES] = {
	"las10_pdrf0_ft_pointwise.laz",
	"las10_pdrf1_tiny.laz",
	"las12_pdrf0_utm10.laz",
	"las12_pdrf2_utm10.laz",
	"las12_pdrf3_extrabytes.laz",
	"las13_pdrf4.laz",
	"las13_pdrf4_fullwave.laz",
	"las13_pdrf5.laz",
	"las14_pdrf6.laz",
	"las14_pdrf7_v4.laz",
	"las14_pdrf8.laz",
	"las14_pdrf9.laz",
	"las14_pdrf10.laz",
	"las14_pdrf6_tiny_chunk0.copc.laz",
	"las14_pdrf7_1065.copc.laz",
	"las15_pdrf9.laz",
	"las14_pdrf6_ground_21k.copc.laz",
};

static const struct input_options defaults = {.planar = true}, truncated = {.planar = true, .accept_truncated = true};
static const char *folder;
static int failures;

#define CHECK(name, condition, ...) \
	((condition) ? (void)0 : (failures++, printf("%s: ", (name)), printf(__VA_ARGS__), (void)putchar('\n')))

static struct bytes load(const char *name)
{
	char path[4400];
	struct bytes b = {0};
	struct stat st;
	int fd;

	snprintf(path, sizeof path, "%s/lidar/%s", folder, name);
	fd = open(path, O_RDONLY | O_CLOEXEC);
	if (fd < 0 || fstat(fd, &st)) {
		CHECK(name, false, "cannot be opened");
		exit(1);
	}
	b.size = (size_t)st.st_size;
	b.at = malloc(b.size + 16);
	if (!b.at || read(fd, b.at, b.size) != st.st_size)
		exit(1);
	close(fd);
	return b;
}

static uint64_t get64(const uint8_t *at)
{
	uint64_t v = 0;

	for (int i = 8; i-- > 0;)
		v = v << 8 | at[i];
	return v;
}

static void put64(uint8_t *at, uint64_t v)
{
	for (int i = 0; i < 8; i++, v >>= 8)
		at[i] = (uint8_t)v;
}

static uint32_t point_offset(const uint8_t *file)
{
	return (uint32_t)get64(file + 96);
}

/* XXH64 of the first `most` points from `in` on, and how many there were. */
static int hash_points(struct input *in, uint64_t most, XXH64_state_t *state, uint64_t *ret_n, struct err *err)
{
	struct input_points pts;
	int rc;

	fixture_points_new(&pts, BATCH);
	while (!(rc = input_read(in, &pts, err)) && pts.n && *ret_n < most) {
		size_t n = pts.n < most - *ret_n ? pts.n : (size_t)(most - *ret_n);

		for (size_t i = 0; i < n; i++) {
			XXH64_update(state, pts.raw[i], sizeof pts.raw[i]);
			XXH64_update(state, &pts.cls[i], 1);
			XXH64_update(state, &pts.ret[i], 1);
			XXH64_update(state, &pts.flags[i], 1);
		}
		*ret_n += n;
	}
	fixture_points_free(&pts);
	return rc;
}

/* Reads a file in memory; returns the hash of its points. *ret_rc: the result of the last read. */
static uint64_t hash_bytes(const struct bytes *b, const struct input_options *options, uint64_t most, uint64_t *ret_n,
			   int *ret_rc, uint64_t *ret_parts)
{
	XXH64_state_t *state = XXH64_createState();
	struct err err = ERR_INIT;
	struct input *in = NULL;
	int fd = fixture_fd(b->at, b->size);
	uint64_t hash;

	XXH64_reset(state, 0);
	*ret_n = *ret_parts = 0;
	*ret_rc = input_open(fd, "a.laz", options, &in, &err);
	if (!*ret_rc) {
		*ret_parts = input_info(in)->parts;
		*ret_rc = hash_points(in, most, state, ret_n, &err);
	}
	input_close(in);
	close(fd);
	hash = XXH64_digest(state);
	XXH64_freeState(state);
	return hash;
}

/* --- changed and cut --- */

/* What the process worked: a machine that is busy with others is no fault of the reader's. */
static uint64_t cpu_ns(void)
{
	struct timespec t;

	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
	return (uint64_t)t.tv_sec * 1000000000 + (uint64_t)t.tv_nsec;
}

static void check_one(const char *name, const uint8_t *at, size_t size, const struct input_options *options, unsigned *read)
{
	uint64_t start = cpu_ns();
	struct outcome out;

	account_begin();
	out = fixture_read(at, size, "a.laz", options, BATCH);
	CHECK(name, account_taken() <= input_bytes() + out.info.read_bytes + BATCH_BYTES, "%zu bytes of memory", account_taken());
	CHECK(name, out.info.read_bytes < 12 << 20, "%zu bytes to read it", out.info.read_bytes);
	CHECK(name, account_read() <= 4 * (uint64_t)size + (1 << 20), "%" PRIu64 " bytes read", account_read());
	CHECK(name, cpu_ns() - start < UINT64_C(5000000000), "it took seconds");
	CHECK(name, out.code < ERR_COUNT && (!out.code || (out.err.message[0] && !strcmp(out.err.file, "a.laz"))), "error %d %s",
	      out.code, out.err.message);
	*read += out.code == 0;
}

static void random_changes(const char *name, const struct bytes *whole)
{
	static const uint8_t odd[] = {0, 1, 0x7f, 0x80, 0xff};
	uint64_t seed = XXH64(name, strlen(name), 0);
	uint32_t points = point_offset(whole->at);
	uint8_t *copy = malloc(whole->size);
	unsigned read = 0;
	int rounds = (int)repeat_cases(400);

	for (int round = 0; round < rounds; round++) {
		unsigned n = 1 + fixture_random(&seed) % 6;
		size_t size = whole->size;

		memcpy(copy, whole->at, size);
		for (unsigned i = 0; i < n; i++) {
			/* header and records; the first points and layer sizes; the table; anywhere */
			size_t from[] = {0, points, size - 100, 0}, range[] = {points, 120, 100, size};
			unsigned kind = fixture_random(&seed) % 4;
			size_t at = from[kind] + fixture_random(&seed) % range[kind];

			if (at < size)
				copy[at] = fixture_random(&seed) % 2 ? odd[fixture_random(&seed) % sizeof odd] :
								       (uint8_t)fixture_random(&seed);
		}
		if (fixture_random(&seed) % 4 == 0)
			size -= fixture_random(&seed) % size;
		check_one(name, copy, size, round % 2 ? &defaults : &truncated, &read);
	}
	CHECK(name, read > 0 && read < (unsigned)rounds, "%u of %d changed files were read", read, rounds);
	free(copy);
}

/* Without its end the file is in error; --accept-truncated gives the beginning of the points, no other ones. */
static void cut(const char *name, const struct bytes *whole)
{
	uint64_t seed = 5, n, m, parts;
	int rc;

	for (int round = 0; round < 12; round++) {
		uint32_t points = point_offset(whole->at);
		struct bytes b = {whole->at, points + fixture_random(&seed) % (whole->size - points)};
		uint64_t hash = hash_bytes(&b, &truncated, UINT64_MAX, &n, &rc, &parts);

		if (rc)
			continue;
		CHECK(name, hash == hash_bytes(whole, &defaults, n, &m, &rc, &parts) && m == n,
		      "cut at %zu it gives other points", b.size);
		hash_bytes(&b, &defaults, UINT64_MAX, &m, &rc, &parts);
		CHECK(name, rc || m == n, "cut at %zu it is not in error", b.size);
	}
}

/* --- chunk tables --- */

static void tables(const char *name, const struct bytes *whole)
{
	struct bytes b = {malloc(whole->size + 8), whole->size};
	uint8_t *address;
	uint64_t n, m, parts, parts_then, hash, then;
	int rc;

	memcpy(b.at, whole->at, whole->size);
	address = b.at + point_offset(b.at);
	hash = hash_bytes(&b, &defaults, UINT64_MAX, &n, &rc, &parts);
	CHECK(name, !rc && n, "not read");
	if (parts > 1) {
		/* a writer that could not seek */
		put64(b.at + b.size, get64(address));
		put64(address, UINT64_MAX);
		b.size += 8;
		then = hash_bytes(&b, &defaults, UINT64_MAX, &m, &rc, &parts_then);
		CHECK(name, !rc && then == hash && parts_then == parts, "address at the end: %d, %" PRIu64 " parts", rc,
		      parts_then);
		/* a writer that was interrupted: only chunks of a fixed size can be read */
		put64(address, point_offset(b.at));
		then = hash_bytes(&b, &defaults, UINT64_MAX, &m, &rc, &parts_then);
		if (strstr(name, ".copc."))
			CHECK(name, rc == -ERR_INPUT, "without a table: %d", rc);
		else
			CHECK(name, !rc && then == hash && parts_then == 1, "without a table: %d", rc);
		/* one chunk less, and one more, in the table than there are */
		put64(address, get64(whole->at + point_offset(b.at)));
		for (int more = -1; more <= 1; more += 2) {
			uint8_t *count = b.at + get64(address) + 4;

			*count = (uint8_t)(*count + more);
			hash_bytes(&b, &defaults, UINT64_MAX, &m, &rc, &parts_then);
			CHECK(name, rc < 0 || parts_then == 1, "with %+d chunk it is read", more);
			*count = (uint8_t)(*count - more);
		}
	}
	free(b.at);
}

/* The header's count: more or fewer points than the chunks hold is an error, never silence. */
static void counts(const char *name, const struct bytes *whole)
{
	struct bytes b = {malloc(whole->size), whole->size};
	uint64_t n, m, parts;
	int rc;

	hash_bytes(whole, &defaults, UINT64_MAX, &n, &rc, &parts);
	for (int more = -1; more <= 1; more += 2) {
		memcpy(b.at, whole->at, whole->size);
		for (int k = 0; k < 4; k++) {
			b.at[107 + k] = (uint8_t)((n + (uint64_t)more) >> (8 * k));
			if (b.at[25] >= 4)
				b.at[247 + k] = b.at[107 + k];
		}
		hash_bytes(&b, &defaults, UINT64_MAX, &m, &rc, &parts);
		/* one stream for all has no end that could be compared */
		CHECK(name, rc || strstr(name, "pointwise"), "with %+d points in the header it is read", more);
	}
	free(b.at);
}

static struct outcome read_bytes(const struct bytes *b, const struct input_options *options)
{
	return fixture_read(b->at, b->size, "a.laz", options, BATCH);
}

/* The header counts no points: said, and with --accept-truncated those of the chunks are read, no other ones. */
static void uncounted(const char *name, const struct bytes *whole)
{
	struct bytes b = {malloc(whole->size), whole->size};
	uint64_t n, m, parts, hash;
	bool pointwise = strstr(name, "pointwise");
	struct outcome out;
	int rc;

	hash = hash_bytes(whole, &defaults, UINT64_MAX, &n, &rc, &parts);
	memcpy(b.at, whole->at, whole->size);
	memset(b.at + 107, 0, 4);
	if (b.at[25] >= 4)
		memset(b.at + 247, 0, 8);
	out = read_bytes(&b, &defaults);
	CHECK(name, !out.code && !out.points && !out.info.claimed, "without a count: %s", out.err.message);
	CHECK(name, strstr(out.info.warning, "counts no points, but"), "says %s", out.info.warning);
	CHECK(name, hash_bytes(&b, &truncated, UINT64_MAX, &m, &rc, &parts) == hash && m == n && !rc,
	      "without a count: %" PRIu64 " of %" PRIu64 " points, %d", m, n, rc);
	out = read_bytes(&b, &truncated);
	CHECK(name, pointwise || out.info.claimed >= n, "claims %" PRIu64, out.info.claimed);
	/* only of pointwise chunks of a fixed size the number is not known before */
	CHECK(name, b.at[24 + 80] < 0x86 || out.info.claimed == n, "claims %" PRIu64, out.info.claimed);
	free(b.at);
}

/* All of its points, and how many they are said to be. */
static void check_found(const char *name, const struct bytes *whole, const struct bytes *b, const char *what)
{
	struct outcome out = read_bytes(b, &defaults);
	uint64_t n, m, parts, hash = hash_bytes(whole, &defaults, UINT64_MAX, &n, &(int){0}, &parts);
	char said[80];
	int rc;

	CHECK(name,
	      !out.code && !out.points && strstr(out.info.warning, " bytes of points are there, which --accept-truncated reads"),
	      "%s: %s; says %s", what, out.err.message, out.info.warning);
	CHECK(name, out.info.accounted == b->size, "%s: %" PRIu64 " bytes accounted for", what, out.info.accounted);
	CHECK(name, hash_bytes(b, &truncated, UINT64_MAX, &m, &rc, &parts) == hash && m == n && !rc,
	      "%s: %" PRIu64 " of %" PRIu64 " points, %d", what, m, n, rc);
	snprintf(said, sizeof said, "%" PRIu64 " points were read", n);
	out = read_bytes(b, &truncated);
	CHECK(name, strstr(out.info.warning, said), "%s: says %s", what, out.info.warning);
}

/* Cut anywhere it gives the points before the cut, no other ones, and says how many. */
static void check_found_of_cut(const char *name, const struct bytes *whole, const struct bytes *b)
{
	uint64_t seed = 7, n, m, parts, first = point_offset(b->at), most = 0;
	char said[80];
	int rc;

	for (int round = 0; round < 12; round++) {
		struct bytes part = {b->at, first + fixture_random(&seed) % (b->size - first)};
		uint64_t hash = hash_bytes(&part, &truncated, UINT64_MAX, &n, &rc, &parts);
		struct outcome out = read_bytes(&part, &truncated);

		CHECK(name, !rc && hash == hash_bytes(whole, &defaults, n, &m, &rc, &parts) && m == n,
		      "cut at %zu it gives %" PRIu64 " other points, %s", part.size, n, out.err.message);
		snprintf(said, sizeof said, "%" PRIu64 " points were read", n);
		CHECK(name, !n || strstr(out.info.warning, said), "cut at %zu it says %s", part.size, out.info.warning);
		most = n > most ? n : most;
	}
	CHECK(name, most || b->at[104] >= 0x86, "cut it gives no points");
}

/* A writer that was interrupted, with and without a place to go back to: no count, no table, and of the points a part. */
static void interrupted(const char *name, const struct bytes *whole)
{
	struct bytes b = {malloc(whole->size), whole->size};
	uint8_t *address;
	uint64_t table;

	memcpy(b.at, whole->at, whole->size);
	memset(b.at + 107, 0, 4);
	if (b.at[25] >= 4) {
		memset(b.at + 247, 0, 8);
		memset(b.at + 235, 0, 12);
	}
	b.at[6] &= (uint8_t)~2;
	address = b.at + point_offset(b.at);
	table = get64(address);
	if (strstr(name, "pointwise")) {
		check_found(name, whole, &b, "one stream");
		check_found_of_cut(name, whole, &b);
	} else if (table > point_offset(b.at) && table < b.size && !strstr(name, ".copc.")) {
		memset(b.at + table, 0xff, 4);
		check_found(name, whole, &b, "a table that cannot be used");
		b.size = table;
		put64(address, point_offset(b.at));
		check_found(name, whole, &b, "no table");
		put64(address, UINT64_MAX);
		check_found(name, whole, &b, "no address");
		check_found_of_cut(name, whole, &b);
	}
	free(b.at);
}

/* A header that was taken from another file: its extended records and waveforms begin inside the points. */
static void stale_pointers(const char *name, const struct bytes *whole)
{
	struct bytes b = {malloc(whole->size), whole->size};
	uint64_t n, m, parts, hash;
	struct outcome out;
	int rc;

	hash = hash_bytes(whole, &defaults, UINT64_MAX, &n, &rc, &parts);
	memcpy(b.at, whole->at, whole->size);
	if (b.at[25] >= 4) {
		put64(b.at + 235, point_offset(b.at) + 100);
		memcpy(b.at + 243, "\2\0\0\0", 4);
	}
	if (b.at[25] >= 3) {
		put64(b.at + 227, point_offset(b.at) + 90);
		b.at[6] |= 2;
	}
	if (strstr(name, ".copc.")) /* the hierarchy is such a record, and not needed */
		CHECK(name, hash_bytes(&b, &defaults, UINT64_MAX, &m, &rc, &parts) == hash && m == n, "%d", rc);
	out = read_bytes(&b, &defaults);
	CHECK(name, !out.code && out.points == n, "stale pointers: %s", out.err.message);
	CHECK(name, b.at[25] < 4 || strstr(out.info.warning, "extended records begin, is in the points"), "says %s",
	      out.info.warning);
	CHECK(name, hash_bytes(&b, &defaults, UINT64_MAX, &m, &rc, &parts) == hash, "stale pointers: other points");
	free(b.at);
}

/* Records behind the chunk table are read whatever they are called, and records that end in the file where there is no table. */
static void records_behind(const char *name, const struct bytes *whole)
{
	static const char *const users[] = {"LASF_Projection", "ab", "", "abcd\0\0\xff\xfe", "\xff"};
	enum { EXTRA = 2 * 60 + 5 };

	if (whole->at[25] < 4 || get64(whole->at + 243) << 32 || strstr(name, "chunk0"))
		return;
	for (size_t i = 0; i < 2 * sizeof users / sizeof *users; i++) {
		struct bytes b = {calloc(1, whole->size + EXTRA), whole->size + EXTRA};
		uint8_t *record = b.at + whole->size;
		struct outcome out;
		uint64_t points;

		memcpy(b.at, whole->at, whole->size);
		points = read_bytes(&b, &defaults).points;
		memcpy(record + 2, users[i / 2], i / 2 == 3 ? 8 : strlen(users[i / 2]));
		put64(record + 20, 5);
		put64(b.at + 235, whole->size);
		memcpy(b.at + 243, "\2\0\0\0", 4);
		if (i % 2)
			put64(b.at + point_offset(b.at), point_offset(b.at));
		out = read_bytes(&b, &defaults);
		CHECK(name,
		      !out.code && out.points == points && !strstr(out.info.warning, "in the points") &&
			      out.info.accounted == b.size,
		      "records %zu behind: %s; %s", i, out.err.message, out.info.warning);
		free(b.at);
	}
}

/* Bytes behind everything are known as such, at the latest when all was read. */
static void accounted(const char *name, const struct bytes *whole)
{
	struct bytes b = {calloc(1, whole->size + 5000), whole->size + 5000};
	struct err err = ERR_INIT;
	struct input *in = NULL;
	XXH64_state_t *state = XXH64_createState();
	uint64_t n = 0;
	int fd;

	memcpy(b.at, whole->at, whole->size);
	fd = fixture_fd(b.at, b.size);
	XXH64_reset(state, 0);
	CHECK(name, !input_open(fd, "a.laz", &defaults, &in, &err), "%s", err.message);
	CHECK(name, !hash_points(in, UINT64_MAX, state, &n, &err) && n, "%s", err.message);
	n = input_info(in)->accounted;
	CHECK(name, n + 64 >= whole->size && n <= whole->size + 16, "%" PRIu64 " of %zu bytes accounted for", n, whole->size);
	input_close(in);
	close(fd);
	XXH64_freeState(state);
	free(b.at);
}

/* --- parts --- */

static void read_parts(const char *name, const struct bytes *whole)
{
	uint64_t n, m = 0, parts, step, hash;
	XXH64_state_t *state = XXH64_createState();
	struct err err = ERR_INIT;
	struct input *in = NULL, *part = NULL;
	int fd = fixture_fd(whole->at, whole->size), rc;

	hash = hash_bytes(whole, &defaults, UINT64_MAX, &n, &rc, &parts);
	CHECK(name, !input_open(fd, "a.laz", &defaults, &in, &err), "%s", err.message);
	for (step = 1; step <= parts; step = step * 2 + 1) {
		XXH64_reset(state, 0);
		m = 0;
		for (uint64_t first = 0; first < parts; first += step) {
			uint64_t got = 0, last = first + step < parts ? first + step : parts;

			rc = input_open_part(in, first, last, &part, &err);
			if (!rc)
				rc = hash_points(part, UINT64_MAX, state, &got, &err);
			CHECK(name, !rc && (!got || input_info(part)->first_point == m), "part %" PRIu64 ": %s", first,
			      err.message);
			part = input_close(part);
			m += got;
		}
		CHECK(name, m == n && XXH64_digest(state) == hash, "in parts of %" PRIu64 " it is another one", step);
	}
	input_close(in);
	close(fd);
	XXH64_freeState(state);
}

/* --- file calls that fail, or give a few bytes at a time --- */

static void file_calls_fail(const char *name, const struct bytes *whole)
{
	struct outcome out;
	uint64_t points;

	fixture_faults_begin();
	for (fixture_faults.fail_at = 1;; fixture_faults.fail_at++) {
		fixture_faults.calls = 0;
		out = fixture_read(whole->at, whole->size, "a.laz", &defaults, BATCH);
		if (fixture_faults.calls < fixture_faults.fail_at)
			break;
		CHECK(name, out.code == ERR_IO && !strcmp(out.err.file, "a.laz"), "call %u fails: %d, %s", fixture_faults.fail_at,
		      out.code, out.err.message);
	}
	points = out.points;
	CHECK(name, !out.code && points, "%s", out.err.message);
	fixture_faults.fail_at = 0;
	fixture_faults.at_most = 61;
	out = fixture_read(whole->at, whole->size, "a.laz", &defaults, BATCH);
	CHECK(name, !out.code && out.points == points, "in small pieces: %s", out.err.message);
	fixture_faults_end();
}

int main(void)
{
	folder = fixture_data();
	if (!*folder)
		return 77;
	for (unsigned i = 0; i < NAMES; i++) {
		struct bytes whole = load(names[i]);

		random_changes(names[i], &whole);
		cut(names[i], &whole);
		tables(names[i], &whole);
		counts(names[i], &whole);
		uncounted(names[i], &whole);
		interrupted(names[i], &whole);
		records_behind(names[i], &whole);
		stale_pointers(names[i], &whole);
		accounted(names[i], &whole);
		read_parts(names[i], &whole);
		file_calls_fail(names[i], &whole);
		free(whole.at);
	}
	/* a last layered chunk that is not full */
	struct bytes part_full = load("las14_pdrf6_ign_289k.laz");

	uncounted("las14_pdrf6_ign_289k.laz", &part_full);
	interrupted("las14_pdrf6_ign_289k.laz", &part_full);
	free(part_full.at);
	printf("%d files, %d failures\n", NAMES + 1, failures);
	return failures != 0;
}
