/*
 * --mask and --erase against brute force: small meshes, and areas whose borders and corners have centroids on them all the time.
 * Whether a centroid is inside is found by another method: a ray upwards from a point that is moved.
 * ACUT_FUZZ_CASES: how many meshes (5,000).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmocka.h>

#include "err.h"
#include "random.h"
#include "repeat.h"
#include "small_mesh.h"

enum { FILES = 2, RINGS = 4, CORNERS = 9 };

/* A file of one polygon a shell, in hundredths: the lattice has tenths. */
struct polygons {
	struct {
		bool shell;
		unsigned n;
		int64_t at[CORNERS][2];
	} ring[RINGS];
	unsigned n;
};

struct areas {
	struct polygons file[FILES];
	unsigned n;
};

static char folder[] = "/tmp/acut-mask-XXXXXX";

/* Near the centroid of a triangle, and often beside or above the corner before. */
static void make_corner(int64_t (*at)[2], unsigned i, uint64_t *seed)
{
	const uint32_t *t = small.triangle[random_below(seed, small.n)];
	bool along = i && random_below(seed, 2);
	unsigned keep = (unsigned)random_below(seed, 2);

	for (unsigned k = 0; k < 2; k++) {
		int64_t sum = (int64_t)small.at[t[0]][k] + small.at[t[1]][k] + small.at[t[2]][k];

		/* a tenth and up to half of one beside */
		at[i][k] = along && k == keep ? at[i - 1][k] :
						10 * (SMALL_K * (int64_t)(k + 1) + sum / 3) + (int64_t)random_below(seed, 10) - 5;
	}
}

static void make_areas(struct areas *a, uint64_t *seed, unsigned least)
{
	memset(a, 0, sizeof *a);
	a->n = least + (unsigned)random_below(seed, FILES + 1 - least);
	for (unsigned f = 0; f < a->n; f++) {
		struct polygons *p = &a->file[f];

		p->n = 1 + (unsigned)random_below(seed, RINGS);
		for (unsigned r = 0; r < p->n; r++) {
			p->ring[r].shell = !r || random_below(seed, 2);
			p->ring[r].n = 3 + (unsigned)random_below(seed, CORNERS - 2);
			for (unsigned i = 0; i < p->ring[r].n; i++)
				make_corner(p->ring[r].at, i, seed);
		}
	}
}

static void put_rings(FILE *f, const struct polygons *p, bool json)
{
	for (unsigned r = 0; r < p->n; r++) {
		if (json)
			fprintf(f, "%s[", p->ring[r].shell ? r ? "],[" : "[" : ",");
		else
			fprintf(f, "%s(", p->ring[r].shell ? r ? "),(" : "(" : ",");
		for (unsigned i = 0; i <= p->ring[r].n; i++) {
			const int64_t *at = p->ring[r].at[i % p->ring[r].n];

			fprintf(f, json ? "%s[%lld.%02lld,%lld.%02lld]" : "%s%lld.%02lld %lld.%02lld", i ? "," : "",
				(long long)at[0] / 100, (long long)at[0] % 100, (long long)at[1] / 100, (long long)at[1] % 100);
		}
		fputc(json ? ']' : ')', f);
	}
	fputc(json ? ']' : ')', f);
}

/* In memory: a disk that others use makes each of some ten thousand small files wait. */
static const char *put_file(const struct polygons *p, bool json)
{
	static char path[64];
	static int memory = -1;
	FILE *f;

	if (memory < 0)
		memory = memfd_create("area", MFD_CLOEXEC);
	snprintf(path, sizeof path, "/proc/self/fd/%d", memory);
	f = fopen(path, "w");
	assert_non_null(f);
	if (json)
		fputs("{\"type\":\"MultiPolygon\",\"coordinates\":[", f);
	else
		fputs("MULTIPOLYGON(", f);
	put_rings(f, p, json);
	fputs(json ? "]}" : ")", f);
	assert_int_equal(fclose(f), 0);
	return path;
}

/* Three times the lattice number, rounded. */
static int64_t place(int64_t hundredths, unsigned axis)
{
	return 3 * ((hundredths + 5) / 10 - SMALL_K * (int64_t)(axis + 1));
}

static uint64_t on_border;

static bool in_ring(const struct polygons *p, unsigned r, int64_t x, int64_t y)
{
	bool in = false;

	for (unsigned i = 0; i < p->ring[r].n; i++) {
		int64_t a[2], b[2], above;

		for (unsigned k = 0; k < 2; k++) {
			a[k] = place(p->ring[r].at[i][k], k);
			b[k] = place(p->ring[r].at[(i + 1) % p->ring[r].n][k], k);
		}
		if (a[0] > b[0])
			for (unsigned k = 0; k < 2; k++) {
				int64_t t = a[k];

				a[k] = b[k];
				b[k] = t;
			}
		above = (a[1] - y) * (b[0] - a[0]) + (b[1] - a[1]) * (x - a[0]);
		on_border += !above && a[0] <= x && x <= b[0] && ((a[1] <= y && y <= b[1]) || (b[1] <= y && y <= a[1]));
		if (a[0] <= x && b[0] > x)
			in ^= above > 0 || (above == 0 && b[1] > a[1]);
	}
	return in;
}

static bool in_areas(const struct areas *a, int64_t x, int64_t y)
{
	for (unsigned f = 0; f < a->n; f++) {
		bool in = false;

		for (unsigned r = 0; r < a->file[f].n; r++) {
			bool here = in_ring(&a->file[f], r, x, y);

			if (a->file[f].ring[r].shell && in)
				return true;
			in = a->file[f].ring[r].shell ? here : in && !here;
		}
		if (in)
			return true;
	}
	return false;
}

/* ret_by: how many each option leaves out. */
static void find_gone(const struct areas area[OUTPUTS_CUTS], uint64_t ret_by[OUTPUTS_CUTS])
{
	memset(ret_by, 0, OUTPUTS_CUTS * sizeof *ret_by);
	for (unsigned t = 0; t < small.n; t++) {
		const int32_t *a = small.at[small.triangle[t][0]], *b = small.at[small.triangle[t][1]],
			      *c = small.at[small.triangle[t][2]];
		int64_t x = (int64_t)a[0] + b[0] + c[0], y = (int64_t)a[1] + b[1] + c[1];

		bool outside = area[OUTPUTS_MASK].n && !in_areas(&area[OUTPUTS_MASK], x, y);

		small.gone[t] = outside || in_areas(&area[OUTPUTS_ERASE], x, y);
		ret_by[OUTPUTS_MASK] += outside;
		ret_by[OUTPUTS_ERASE] += !outside && small.gone[t];
	}
}

static struct outputs *start(const struct areas area[OUTPUTS_CUTS], bool json, bool turned)
{
	const struct outputs_options opt = {.edges = true};
	const struct format_options none = {0};
	struct err err = ERR_INIT;
	struct outputs *run;

	assert_int_equal(outputs_new(&opt, &run, &err), 0);
	for (unsigned k = 0; k < OUTPUTS_CUTS; k++)
		for (unsigned f = 0; f < area[k].n; f++) {
			const struct polygons *p = &area[k].file[turned ? area[k].n - 1 - f : f];

			assert_int_equal(outputs_cut(run, (enum outputs_cut)k, put_file(p, json), &err), 0);
		}
	assert_int_equal(outputs_add(run, NULL, &small_format, &none, &err), 0);
	return run;
}

static uint64_t cut, stayed;

static void one_case(uint64_t seed)
{
	struct areas area[OUTPUTS_CUTS];
	struct outputs_report report[2];
	uint64_t by[OUTPUTS_CUTS];
	char trimmed[256];

	/* so that centroids are on lattice numbers, too */
	small_make(&seed, random_below(&seed, 2) ? 1 : 3);
	make_areas(&area[OUTPUTS_MASK], &seed, 0);
	make_areas(&area[OUTPUTS_ERASE], &seed, !area[OUTPUTS_MASK].n);
	find_gone(area, by);
	for (unsigned pass = 0; pass < 2; pass++) {
		struct outputs *run = start(area, pass, pass);
		struct acut_mesh_sink sink = outputs_sink(run);
		unsigned left;

		assert_int_equal(small_send(&sink, &seed), 0);
		outputs_report(run, &report[pass]);
		left = small_check(&report[pass]);
		for (unsigned k = 0; k < OUTPUTS_CUTS; k++) {
			const struct outputs_left_out *out = &report[pass].left_out_by[k ? OUTPUTS_BY_ERASE : OUTPUTS_BY_MASK];

			assert_int_equal(out->given, area[k].n > 0);
			assert_int_equal(out->triangles, by[k]);
		}
		cut += left;
		stayed += small.n - left;
		/* The same area in another format and order is the same text. */
		assert_int_equal(!strstr(small_trimmed(), "mask="), !area[OUTPUTS_MASK].n);
		assert_int_equal(!strstr(small_trimmed(), "erase="), !area[OUTPUTS_ERASE].n);
		if (pass)
			assert_string_equal(small_trimmed(), trimmed);
		snprintf(trimmed, sizeof trimmed, "%s", small_trimmed());
		outputs_free(run);
	}
	assert_memory_equal(&report[0].left_out.area, &report[1].left_out.area, sizeof(double));
}

static void test_random(void **state)
{
	uint64_t n = repeat_cases(5000), first = repeat_first();

	for (uint64_t i = 0; i < n; i++)
		one_case((first + i) * UINT64_C(0x2545f4914f6cdd1d));
	print_message("%llu meshes: %llu triangles cut, %llu stayed; %llu centroids on an edge\n", (unsigned long long)n,
		      (unsigned long long)cut, (unsigned long long)stayed, (unsigned long long)on_border);
	assert_true(cut && stayed && on_border > n);
}

/* One area as --mask and as --erase: two parts that together are the mesh. */
static void test_partition(void **state)
{
	for (uint64_t i = 1; i <= 500; i++) {
		uint64_t seed = i * 77;
		struct areas area[2][OUTPUTS_CUTS] = {{{.n = 0}}};
		struct outputs_report report[2];
		struct digest sum = {0}, part;
		char hex[DIGEST_HEX_SIZE];

		small_make(&seed, 3);
		make_areas(&area[0][OUTPUTS_MASK], &seed, 1);
		area[1][OUTPUTS_ERASE] = area[0][OUTPUTS_MASK];
		for (unsigned k = 0; k < 2; k++) {
			struct outputs *run = start(area[k], false, false);
			struct acut_mesh_sink sink = outputs_sink(run);

			assert_int_equal(small_send(&sink, &seed), 0);
			outputs_report(run, &report[k]);
			assert_true(digest_parse(report[k].written, &part));
			digest_add(&sum, part);
			outputs_free(run);
		}
		memset(small.gone, 0, sizeof small.gone);
		assert_string_equal(digest_hex(sum, hex), digest_hex(small_digest(true), (char[DIGEST_HEX_SIZE]){0}));
		assert_int_equal(report[0].left_out.triangles + report[1].left_out.triangles, small.n);
		assert_string_equal(report[0].cut[OUTPUTS_MASK], report[1].cut[OUTPUTS_ERASE]);
	}
}

/* ---- refused ---- */

static void refused(const char *crs, const char *corner, const char *says, bool at_head)
{
	struct outputs_options opt = {.edges = true};
	const struct format_options none = {0};
	struct err err = ERR_INIT;
	struct outputs *run;
	struct acut_mesh_sink sink;
	uint64_t seed = 1;
	char path[128];
	FILE *f;
	int r;

	snprintf(path, sizeof path, "%s/area.json", folder);
	f = fopen(path, "w");
	assert_non_null(f);
	fprintf(f, "{%s\"type\":\"Polygon\",\"coordinates\":[[%s]]}", crs, corner);
	assert_int_equal(fclose(f), 0);
	small_make(&seed, 1);
	assert_int_equal(outputs_new(&opt, &run, &err), 0);
	r = outputs_cut(run, OUTPUTS_ERASE, path, &err);
	assert_int_equal(r != 0, says && !at_head);
	if (!r) {
		assert_int_equal(outputs_add(run, NULL, &small_format, &none, &err), 0);
		sink = outputs_sink(run);
		assert_int_equal(small_send(&sink, &seed) != 0, says != NULL);
		err = *outputs_error(run);
	}
	if (says) {
		assert_non_null(strstr(err.message, says));
		assert_string_equal(err.file, path);
	}
	outputs_free(run);
}

/* The mesh is in EPSG:2154. */
static void test_refused(void **state)
{
	static const char named[] = "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"%s\"}},";
	static const struct {
		const char *name, *says;
	} row[] = {
		{"urn:ogc:def:crs:EPSG::2154", NULL},
		{"EPSG:2154", NULL},
		{"http://www.opengis.net/def/crs/EPSG/0/2154", NULL},
		{"urn:ogc:def:crs:EPSG:9.8:2154", NULL},
		{"somewhere", NULL},
		{"urn:ogc:def:crs:EPSG::25832", "the area is in EPSG:25832, and the mesh in EPSG:2154"},
		{"urn:ogc:def:crs:OGC:1.3:CRS84", "the area is in EPSG:4326, and the mesh in EPSG:2154"},
		{"EPSG:215", "the area is in EPSG:215,"},
	};
	char crs[256];

	for (unsigned i = 0; i < sizeof row / sizeof *row; i++) {
		snprintf(crs, sizeof crs, named, row[i].name);
		refused(crs, "[0,0],[1,0],[1,1]", row[i].says, true);
	}
	refused("\"crs\":null,", "[0,0],[1,0],[1,1]", NULL, false);
	refused("", "", "there is no polygon in it", false);
	refused("", "[0,0],[1e17,0],[1,1]", NULL, false);
	refused("", "[0,0],[1e18,0],[1,1]", "reaches too far out", true);
	refused("", "[0,0],[\"a\",0],[1,1]", "not a number", false);
}

static int setup(void **state)
{
	return mkdtemp(folder) ? 0 : -1;
}

static int teardown(void **state)
{
	char path[128];

	snprintf(path, sizeof path, "%s/area.json", folder);
	unlink(path);
	return rmdir(folder);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_random), cmocka_unit_test(test_partition),
					   cmocka_unit_test(test_refused)};

	return cmocka_run_group_tests(tests, setup, teardown);
}
