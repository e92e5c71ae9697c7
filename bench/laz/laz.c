/*
 * Decoding LAZ, one thread, CPU time: all fields, what terrain needs, and LASzip's own library beside it (with
 * -Dlaszip=PREFIX), in turn. Median and range of the passes; million points a second.
 * Usage: bench-laz [-n PASSES] FILE.laz...; bench-laz -a PASSES FILE.laz... and -t: acut alone, for a profile, all fields or
 * terrain
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "input.h"
#include "input_las_parts.h"
#include "io.h"

#ifdef HAVE_LASZIP
unsigned long long laszip_pass(const char *path, int all);
#endif

enum { BATCH = 1024, PASSES_MAX = 99 };

static double cpu_seconds(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static int read_fd(void *ctx, uint64_t at, void *buf, size_t n, size_t *ret_n, struct err *err)
{
	return io_read_some(*(int *)ctx, buf, n, at, "input", ret_n, err);
}

/* The records of a file; 0 on failure, which is told. */
static unsigned long long acut_pass(const struct input *in, enum laz_fields fields)
{
	const struct input_las *las = input_las_of(in);
	int fd = in->fd;
	const struct laz_source source = {&fd, read_fd};
	void *memory = malloc(laz_table_bytes() + 64), *decoder = malloc(laz_reader_bytes(&las->laz, fields));
	uint8_t *records = malloc((size_t)BATCH * las->length);
	struct err err = ERR_INIT;
	struct laz_table *table;
	struct laz_reader *reader;
	struct laz_chunk chunk = laz_table_whole(&las->laz, &las->place);
	unsigned long long points = 0;
	uint64_t chunks;
	const char *why;
	bool more = true;
	size_t n;
	int rc = laz_table_open(memory, &las->laz, &source, &las->place, &table, &chunks, &why, &err);

	if (!rc)
		rc = laz_reader_new(decoder, &las->laz, fields, &source, &reader, &err);
	while (!rc && more) {
		if (chunks)
			rc = laz_table_next(table, &chunk, &more, &err);
		if (!rc && more)
			rc = laz_reader_chunk(reader, &chunk, &err);
		while (!rc && more && !(rc = laz_reader_read(reader, records, BATCH, &n, &err)) && n)
			points += n;
		more = more && chunks;
	}
	if (rc)
		printf("%s\n", err.message);
	free(memory);
	free(decoder);
	free(records);
	return rc ? 0 : points;
}

enum { ACUT_ALL, ACUT_TERRAIN, LASZIP_ALL, LASZIP_TERRAIN, KINDS };

static unsigned long long pass(const struct input *in, const char *path, int kind)
{
	switch (kind) {
	case ACUT_ALL:
		return acut_pass(in, LAZ_ALL);
	case ACUT_TERRAIN:
		return acut_pass(in, LAZ_TERRAIN);
	default:
#ifdef HAVE_LASZIP
		return laszip_pass(path, kind == LASZIP_ALL);
#else
		return 0;
#endif
	}
}

static int compare(const void *a, const void *b)
{
	double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

static void measure(const char *path, unsigned passes, const char *only)
{
	static const char *const name[KINDS] = {"acut", "acut terrain", "LASzip", "LASzip terrain"};
	const struct input_options options = {.planar = true};
	double rate[KINDS][PASSES_MAX];
	struct err err = ERR_INIT;
	struct input *in;
	int fd = open(path, O_RDONLY | O_CLOEXEC);

	if (fd < 0 || input_open(fd, path, &options, &in, &err)) {
		printf("%s: %s\n", path, err.message);
		return;
	}
	for (unsigned i = 0; i < passes; i++) {
		for (int k = 0; k < KINDS; k++) {
			double start = cpu_seconds();
			unsigned long long n = !only || k == (only[1] == 't' ? ACUT_TERRAIN : ACUT_ALL) ? pass(in, path, k) : 0;

			rate[k][i] = (double)n / (cpu_seconds() - start) * 1e-6;
		}
	}
	printf("%s, %s, %llu points\n", strrchr(path, '/') ? strrchr(path, '/') + 1 : path, input_info(in)->variant,
	       (unsigned long long)input_info(in)->claimed);
	for (int k = 0; k < KINDS; k++) {
		qsort(rate[k], passes, sizeof rate[k][0], compare);
		if (rate[k][passes / 2] > 0)
			printf("  %-15s %6.2f M points/s (%.2f..%.2f)\n", name[k], rate[k][passes / 2], rate[k][0],
			       rate[k][passes - 1]);
	}
	if (rate[LASZIP_ALL][passes / 2] > 0)
		printf("  acut / LASzip   %6.2f all fields, %.2f terrain\n",
		       rate[ACUT_ALL][passes / 2] / rate[LASZIP_ALL][passes / 2],
		       rate[ACUT_TERRAIN][passes / 2] / rate[LASZIP_TERRAIN][passes / 2]);
	input_close(in);
	close(fd);
}

int main(int argc, char **argv)
{
	const char *only = argc > 2 && (!strcmp(argv[1], "-a") || !strcmp(argv[1], "-t")) ? argv[1] : NULL;
	unsigned passes = 5;
	int i = 1;

	if (argc > 2 && (only || !strcmp(argv[1], "-n"))) {
		passes = (unsigned)atoi(argv[2]);
		passes = passes < 1 ? 1 : passes > PASSES_MAX ? PASSES_MAX : passes;
		i = 3;
	}
	for (; i < argc; i++)
		measure(argv[i], passes, only);
	return 0;
}
