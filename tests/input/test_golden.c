/*
 * Real LAS files against what two other decoders made of them (golden.def): the hash of the records as
 * the reader steps through them, and, of what it decodes, counts, extent and classes. Every file of the
 * folder must have a row. The text files are added up.
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
#include "input_las_parts.h"

struct row {
	const char *file;
	unsigned minor, format, length;
	uint64_t points;
	uint64_t hash; /* XXH64, seed 0, of the raw records */
	double min[3], max[3];
	const char *classes; /* "1:789 2:276", or "N different" */
	unsigned class2;
	unsigned compressor; /* 0: LAS */
};

static const struct row rows[] = {
#define GOLDEN(...) {__VA_ARGS__},
#include "golden.def"
#undef GOLDEN
};

/* What the files say of their coordinate systems; all others say nothing. */
static const struct {
	const char *file;
	enum crs_plane plane;
	const char *crs, *unit_xy, *unit_z;
} systems[] = {
	{"las10_pdrf0_ft.las", CRS_PLANE_PROJECTED, "EPSG:32128", "us-survey-foot", "unknown"},
	{"las10_pdrf1_tiny.las", CRS_PLANE_PROJECTED, "EPSG:26917", "metre", "metre"},
	{"las12_pdrf0_lonlat_epsg4326.las", CRS_PLANE_GEOGRAPHIC, "EPSG:4326", "degree", "unknown"},
	{"las12_pdrf0_utm10.las", CRS_PLANE_PROJECTED, "EPSG:26910", "metre", "unknown"},
	{"las12_pdrf2_utm10.las", CRS_PLANE_PROJECTED, "EPSG:26910", "metre", "unknown"},
	{"las12_pdrf3_autzen_ft.las", CRS_PLANE_PROJECTED, "NAD_1983_HARN_Lambert_Conformal_Conic", "foot", "unknown"},
	{"las12_pdrf3_epsg2903_ftus.las", CRS_PLANE_PROJECTED, "EPSG:2903 + EPSG:5103", "us-survey-foot", "us-survey-foot"},
	{"las12_pdrf3_lonlat_epsg4326.las", CRS_PLANE_GEOGRAPHIC, "EPSG:4326", "degree", "unknown"},
	{"las10_pdrf0_ft_pointwise.laz", CRS_PLANE_PROJECTED, "EPSG:32128", "us-survey-foot", "unknown"},
	{"las10_pdrf1_tiny.laz", CRS_PLANE_PROJECTED, "EPSG:26917", "metre", "metre"},
	{"las11_pdrf1_town_278k.laz", CRS_PLANE_PROJECTED, "EPSG:32754", "metre", "metre"},
	{"las12_pdrf0_utm10.laz", CRS_PLANE_PROJECTED, "EPSG:26910", "metre", "unknown"},
	{"las12_pdrf2_utm10.laz", CRS_PLANE_PROJECTED, "EPSG:26910", "metre", "unknown"},
	{"las12_pdrf3_autzen_ft.laz", CRS_PLANE_PROJECTED, "NAD_1983_HARN_Lambert_Conformal_Conic", "foot", "unknown"},
	{"las13_pdrf1_forest_217k.laz", CRS_PLANE_PROJECTED, "EPSG:32617", "metre", "metre"},
	{"las13_pdrf4_fullwave.laz", CRS_PLANE_PROJECTED, "unknown", "unknown", "metre"},
	{"las14_pdrf7_autzen_ft.las", CRS_PLANE_PROJECTED, "NAD_1983_HARN_Lambert_Conformal_Conic", "foot", "unknown"},
	{"las14_pdrf6_ign_289k.laz", CRS_PLANE_PROJECTED, "EPSG:2154", "metre", "unknown"},
	{"tiles_ign_pdrf8/770500_6277550.laz", CRS_PLANE_PROJECTED, "EPSG:2154", "metre", "unknown"},
	{"tiles_ign_pdrf8/770550_6277550.laz", CRS_PLANE_PROJECTED, "EPSG:2154", "metre", "unknown"},
	{"tiles_ign_pdrf8/770600_6277550.laz", CRS_PLANE_PROJECTED, "EPSG:2154", "metre", "unknown"},
	{"tiles_ign_pdrf8/770500_6277600.laz", CRS_PLANE_PROJECTED, "EPSG:2154", "metre", "unknown"},
	{"tiles_ign_pdrf8/770550_6277600.laz", CRS_PLANE_PROJECTED, "EPSG:2154", "metre", "unknown"},
	{"tiles_ign_pdrf8/770600_6277600.laz", CRS_PLANE_PROJECTED, "EPSG:2154", "metre", "unknown"},
	{"las14_pdrf10_fullwave.laz", CRS_PLANE_PROJECTED, "EPSG:32723", "metre", "unknown"},
	{"las14_pdrf7_1065.copc.laz", CRS_PLANE_PROJECTED, "EPSG:2991 + EPSG:6360", "metre", "us-survey-foot"},
	{"las14_pdrf6_tiny_chunk0.copc.laz", CRS_PLANE_PROJECTED, "EPSG:26917", "metre", "unknown"},
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

static void check_system(const struct row *row, const struct input_info *info)
{
	size_t i = 0;

	while (i < sizeof systems / sizeof *systems && strcmp(systems[i].file, row->file))
		i++;
	if (i == sizeof systems / sizeof *systems) {
		CHECK(row, info->crs.plane == CRS_PLANE_UNKNOWN && !strcmp(info->crs.text, "unknown"), "is %s", info->crs.text);
		return;
	}
	CHECK(row, info->crs.plane == systems[i].plane, "plane %d", info->crs.plane);
	CHECK(row, !strcmp(info->crs.text, systems[i].crs), "is %s", info->crs.text);
	CHECK(row, !strcmp(info->crs.unit_xy, systems[i].unit_xy), "in %s", info->crs.unit_xy);
	CHECK(row, !strcmp(info->crs.unit_z, systems[i].unit_z), "heights in %s", info->crs.unit_z);
}

static void check_variant(const struct row *row, const struct input_info *info)
{
	char text[64], compressor[24] = "";

	if (row->compressor)
		snprintf(compressor, sizeof compressor, ", compressor %u", row->compressor);
	snprintf(text, sizeof text, "LA%c 1.%u, point format %u, %u bytes%s", row->compressor ? 'Z' : 'S', row->minor,
		 row->format, row->length, compressor);
	CHECK(row, !strcmp(text, info->variant), "is %s", info->variant);
}

/* `whole`: every byte of the records is looked at; otherwise only what terrain needs is decoded. */
static void check_file(const char *folder, const struct row *row, bool whole)
{
	const struct input_options options = {.planar = true};
	struct err err = ERR_INIT;
	struct input_points pts;
	struct sums sums = {0};
	struct input *in = NULL;
	XXH64_state_t *hash = XXH64_createState();
	char path[4400];
	int fd, rc;

	snprintf(path, sizeof path, "%s/lidar/%s", folder, row->file);
	fd = open(path, O_RDONLY | O_CLOEXEC);
	CHECK(row, fd >= 0, "cannot open %s", path);
	XXH64_reset(hash, 0);
	fixture_points_new(&pts, 4096);
	rc = fd < 0 ? -1 : input_open(fd, row->file, &options, &in, &err);
	if (!rc) {
		check_variant(row, input_info(in));
		check_system(row, input_info(in));
		input_las_of(in)->watch = whole ? hash_records : NULL;
		input_las_of(in)->watch_arg = hash;
		while (!(rc = input_read(in, &pts, &err)) && pts.n)
			add(&sums, &pts);
		check_sums(row, &sums, &input_info(in)->coords);
		CHECK(row, !whole || XXH64_digest(hash) == row->hash, "hash %016llx", (unsigned long long)XXH64_digest(hash));
	}
	CHECK(row, !rc, "%s", err.message);
	input_close(in);
	fixture_points_free(&pts);
	XXH64_freeState(hash);
	if (fd >= 0)
		close(fd);
}

/* Text: points, places of the last digit, sums of all raw numbers (by Python's decimals). */
static const struct text_row {
	const char *file;
	uint64_t points;
	int place_xy, place_z;
	int64_t sum[3];
} texts[] = {
	{"s400.xyz", 400, -3, -1, {40599627, 40221370, 0}},
	{"rect1.xyz", 242, -3, -1, {24601886, 14489233, 0}},
	{"grid_60m.xyz", 400, 0, 0, {176528000, 1500288000, 50706}},
};

static void check_text(const char *folder, const struct text_row *row)
{
	const struct input_options options = {0};
	struct err err = ERR_INIT;
	struct input_points pts;
	struct input *in = NULL;
	int64_t sum[3] = {0};
	uint64_t n = 0;
	char path[4400];
	int fd, rc;

	snprintf(path, sizeof path, "%s/lidar/xyz/%s", folder, row->file);
	fd = open(path, O_RDONLY | O_CLOEXEC);
	CHECK(row, fd >= 0, "cannot open %s", path);
	fixture_points_new(&pts, 100);
	rc = fd < 0 ? -1 : input_open(fd, row->file, &options, &in, &err);
	if (!rc) {
		const struct lattice_input *c = &input_info(in)->coords;

		CHECK(row, c->scale[0].exponent == row->place_xy && c->scale[2].exponent == row->place_z, "1e%d, 1e%d",
		      c->scale[0].exponent, c->scale[2].exponent);
		while (!(rc = input_read(in, &pts, &err)) && pts.n) {
			for (size_t i = 0; i < pts.n; i++, n++)
				for (int k = 0; k < 3; k++)
					sum[k] += pts.raw[i][k];
		}
		CHECK(row, n == row->points, "%llu points", (unsigned long long)n);
		CHECK(row, !memcmp(sum, row->sum, sizeof sum), "sums %lld %lld %lld", (long long)sum[0], (long long)sum[1],
		      (long long)sum[2]);
	}
	CHECK(row, !rc, "%s", err.message);
	input_close(in);
	fixture_points_free(&pts);
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

		if (!dot || (strcmp(dot, ".las") && strcmp(dot, ".laz")))
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
		check_file(folder, &rows[i], true);
	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		if (rows[i].compressor)
			check_file(folder, &rows[i], false);
	for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
		check_text(folder, &texts[i]);
	check_folder(folder);
	printf("%zu files, %d failures\n", sizeof rows / sizeof *rows, failures);
	return failures != 0;
}
