/*
 * Real LAS files against what two other decoders made of them (golden.def): the hash of the records as
 * the reader steps through them, and, of what it decodes, counts, extent and classes. Every file of the
 * folder must have a row.
 */
#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <xxhash.h>

#include "decimal.h"
#include "fixture.h"
#include "input_parts.h"

struct row {
	const char *file;
	unsigned minor, format, length;
	uint64_t points;
	uint64_t hash; /* XXH64, seed 0, of the raw records */
	double min[3], max[3];
	const char *classes; /* "1:789 2:276", or "N different" */
	unsigned class2;
};

static const struct row rows[] = {
#define GOLDEN(...) { __VA_ARGS__ },
#include "golden.def"
#undef GOLDEN
};

static int failures;

#define CHECK(row, condition, ...) \
	((condition) ? (void)0 : (failures++, printf("%s: ", (row)->file), printf(__VA_ARGS__), (void)putchar('\n')))

static void hash_records(void *arg, const uint8_t *records, size_t n, size_t length)
{
	XXH64_update(arg, records, n * length);
}

struct sums {
	uint64_t n, classes[256];
	int64_t min[3], max[3];
};

static void add(struct sums *s, const struct input_points *pts)
{
	for (size_t i = 0; i < pts->n; i++) {
		for (int k = 0; k < 3; k++) {
			int64_t v = pts->raw[i][k];

			s->min[k] = !s->n || v < s->min[k] ? v : s->min[k];
			s->max[k] = !s->n || v > s->max[k] ? v : s->max[k];
		}
		s->classes[pts->cls[i]]++;
		s->n++;
	}
}

static void classes_text(const struct sums *s, char *text, size_t size)
{
	unsigned different = 0;
	size_t n = 0;

	text[0] = 0;
	for (unsigned c = 0; c < 256; c++) {
		if (!s->classes[c])
			continue;
		different++;
		if (n < size)
			n += (size_t)snprintf(text + n, size - n, "%s%u:%llu", n ? " " : "", c,
					      (unsigned long long)s->classes[c]);
	}
	if (different > 20)
		snprintf(text, size, "%u different", different);
}

static void check_sums(const struct row *row, const struct sums *s, const struct lattice_input *coords)
{
	char text[4096];

	CHECK(row, s->n == row->points, "%llu points", (unsigned long long)s->n);
	classes_text(s, text, sizeof text);
	CHECK(row, !strcmp(text, row->classes), "classes %s", text);
	CHECK(row, s->classes[2] == row->class2, "%llu of class 2", (unsigned long long)s->classes[2]);
	for (int k = 0; k < 3; k++) {
		double scale = decimal_double(coords->scale[k]), offset = decimal_double(coords->offset[k]);
		double min = (double)s->min[k] * scale + offset, max = (double)s->max[k] * scale + offset;

		CHECK(row, fabs(min - row->min[k]) <= scale / 2, "minimum %d is %.9g", k, min);
		CHECK(row, fabs(max - row->max[k]) <= scale / 2, "maximum %d is %.9g", k, max);
	}
}

static void check_file(const char *folder, const struct row *row)
{
	const struct input_options options = { .planar = true };
	struct err err = ERR_INIT;
	struct input_points pts;
	struct sums sums = { 0 };
	struct input *in = NULL;
	XXH64_state_t *hash = XXH64_createState();
	char path[4400], variant[64];
	int fd, rc;

	snprintf(path, sizeof path, "%s/lidar/%s", folder, row->file);
	fd = open(path, O_RDONLY | O_CLOEXEC);
	CHECK(row, fd >= 0, "cannot open %s", path);
	XXH64_reset(hash, 0);
	fixture_points_new(&pts, 4096);
	rc = fd < 0 ? -1 : input_open(fd, row->file, &options, &in, &err);
	if (!rc) {
		snprintf(variant, sizeof variant, "LAS 1.%u, point format %u, %u bytes", row->minor, row->format,
			 row->length);
		CHECK(row, !strcmp(variant, input_info(in)->variant), "is %s", input_info(in)->variant);
		in->as.las.watch = hash_records;
		in->as.las.watch_arg = hash;
		while (!(rc = input_read(in, &pts, &err)) && pts.n)
			add(&sums, &pts);
		check_sums(row, &sums, &input_info(in)->coords);
		CHECK(row, XXH64_digest(hash) == row->hash, "hash %016llx", (unsigned long long)XXH64_digest(hash));
	}
	CHECK(row, !rc, "%s", err.message);
	input_close(in);
	fixture_points_free(&pts);
	XXH64_freeState(hash);
	if (fd >= 0)
		close(fd);
}

static void check_folder(const char *folder)
{
	char path[4200];
	struct dirent *e;
	DIR *dir;

	snprintf(path, sizeof path, "%s/lidar", folder);
	dir = opendir(path);
	while (dir && (e = readdir(dir))) {
		const char *dot = strrchr(e->d_name, '.');
		size_t i = 0;

		if (!dot || strcmp(dot, ".las"))
			continue;
		while (i < sizeof rows / sizeof *rows && strcmp(rows[i].file, e->d_name))
			i++;
		if (i == sizeof rows / sizeof *rows) {
			printf("%s has no row in golden.def\n", e->d_name);
			failures++;
		}
	}
	if (dir)
		closedir(dir);
	else
		failures++;
}

int main(void)
{
	const char *folder = fixture_data();

	if (!*folder)
		return 77;
	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		check_file(folder, &rows[i]);
	check_folder(folder);
	printf("%zu files, %d failures\n", sizeof rows / sizeof *rows, failures);
	return failures != 0;
}
