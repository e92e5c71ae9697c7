/*
 * The file, as libtiff reads it: the pixels of a mesh, each level the means of the one below, tags and keys; the same bytes
 * whatever the order of the triangles and the memory.
 */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <tiffio.h>
#include <unistd.h>
#include <cmocka.h>

#include "dem.h"
#include "err.h"
#include "outfile.h"
#include "random.h"
#include "repeat.h"

enum { PIXEL_SCALE = 33550, TIE_POINT = 33922, GEO_KEYS = 34735, GEO_ASCII = 34737, NODATA = 42113 };

static char folder[256];
static uint64_t seed = 1;

/* A grid of points with a hole, on a scale of 0.01; the cell is 1. */
enum { COLUMNS = 30, ROWS = 20, STEP = 4000, X0 = -60000, Y0 = 310, CELL = 100 };
struct grid {
	int32_t z[ROWS][COLUMNS];
	uint32_t order[2 * (ROWS - 1) * (COLUMNS - 1)];
	unsigned n;
};

static const struct acut_mesh_head head = {.scale_xy = "0.01",
					   .scale_z = "0.001",
					   .crs = "EPSG:2154 + EPSG:5720",
					   .unit_xy = "metre",
					   .unit_z = "metre",
					   .k = {65000000, 680000000, 0},
					   .box = {X0, Y0 - 5, 0, X0 + (COLUMNS - 1) * STEP + 123456, Y0 + (ROWS - 1) * STEP, 0}};
static const struct dem_options usual = {
	.cell = {1, 0}, .cell_num = 1, .cell_den = 1, .z_num = 1, .z_den = 1, .steep = 1, .unit_xy = "metre", .unit_z = "metre"};

static bool is_hole(unsigned square)
{
	unsigned c = square % (COLUMNS - 1), r = square / (COLUMNS - 1);

	return c >= 4 && c < 20 && r >= 3 && r < 17;
}

static void make(struct grid *g)
{
	seed = 1;
	g->n = 0;
	for (int r = 0; r < ROWS; r++)
		for (int c = 0; c < COLUMNS; c++)
			g->z[r][c] = (int32_t)random_below(&seed, 300000) - 50000;
	for (uint32_t i = 0; i < 2 * (ROWS - 1) * (COLUMNS - 1); i++)
		if (!is_hole(i / 2))
			g->order[g->n++] = i;
}

static void corners(const struct grid *g, uint32_t number, int32_t ret[3][3])
{
	unsigned square = number / 2, c = square % (COLUMNS - 1), r = square / (COLUMNS - 1);
	const unsigned at[2][3][2] = {{{0, 0}, {1, 0}, {1, 1}}, {{0, 0}, {1, 1}, {0, 1}}};

	for (int k = 0; k < 3; k++) {
		unsigned x = c + at[number & 1][k][0], y = r + at[number & 1][k][1];

		ret[k][0] = X0 + (int32_t)x * STEP;
		ret[k][1] = Y0 + (int32_t)y * STEP;
		ret[k][2] = g->z[y][x];
	}
}

static const char *path_of(const char *name)
{
	static char path[400];

	snprintf(path, sizeof(path), "%s/%s", folder, name);
	return path;
}

/* The triangles to a new model. */
static int draw(const struct grid *g, const struct acut_mesh_head *h, const struct dem_options *opt, struct outfile *out,
		struct dem **ret, struct err *err)
{
	struct dem *d = NULL;
	int r = dem_new(out, &d, err);

	*ret = d;
	if (!r)
		r = dem_head(d, h, opt, err);
	for (unsigned i = 0; i < g->n && !r; i++) {
		unsigned turn = (unsigned)random_below(&seed, 3);
		int32_t p[3][3];

		corners(g, g->order[i], p);
		r = dem_triangle(d, p[turn], p[(turn + 1) % 3], p[(turn + 2) % 3], err);
	}
	return r;
}

static int write_file(const struct grid *g, const struct acut_mesh_head *h, const struct dem_options *opt, const char *name,
		      struct err *err)
{
	const int32_t box[6] = {X0, Y0, -50000, X0 + (COLUMNS - 1) * STEP, Y0 + (ROWS - 1) * STEP, 250000};
	struct outfile *out = NULL;
	struct dem *d = NULL;
	int r = outfile_new(path_of(name), false, &out, err);

	if (!r)
		r = draw(g, h, opt, out, &d, err);
	if (!r)
		r = dem_finish(d, g->n ? box : NULL, err);
	if (!r)
		r = outfile_publish(out, err);
	dem_free(d);
	outfile_free(out);
	return r;
}

struct image {
	uint32_t w, h;
	float *pixel;
};

static struct image read_level(TIFF *t)
{
	struct image m = {0};
	uint16_t bits = 0, format = 0, compression = 0, predictor = 0;
	uint32_t tw = 0, th = 0;
	float *tile = malloc(DEM_TILE * DEM_TILE * sizeof(*tile));

	TIFFGetField(t, TIFFTAG_IMAGEWIDTH, &m.w);
	TIFFGetField(t, TIFFTAG_IMAGELENGTH, &m.h);
	TIFFGetField(t, TIFFTAG_TILEWIDTH, &tw);
	TIFFGetField(t, TIFFTAG_TILELENGTH, &th);
	TIFFGetField(t, TIFFTAG_BITSPERSAMPLE, &bits);
	TIFFGetField(t, TIFFTAG_SAMPLEFORMAT, &format);
	TIFFGetField(t, TIFFTAG_COMPRESSION, &compression);
	TIFFGetField(t, TIFFTAG_PREDICTOR, &predictor);
	assert_int_equal(tw, DEM_TILE);
	assert_int_equal(th, DEM_TILE);
	assert_int_equal(bits, 32);
	assert_int_equal(format, SAMPLEFORMAT_IEEEFP);
	assert_int_equal(compression, COMPRESSION_ADOBE_DEFLATE);
	assert_int_equal(predictor, PREDICTOR_FLOATINGPOINT);
	m.pixel = malloc((size_t)m.w * m.h * sizeof(*m.pixel));
	for (uint32_t y = 0; y < m.h; y += DEM_TILE)
		for (uint32_t x = 0; x < m.w; x += DEM_TILE) {
			uint32_t i = TIFFComputeTile(t, x, y, 0, 0);
			bool absent = !TIFFGetStrileByteCount(t, i);

			assert_int_equal(absent, !TIFFGetStrileOffset(t, i));
			for (int k = 0; k < DEM_TILE * DEM_TILE; k++)
				tile[k] = -9999;
			if (!absent)
				assert_int_equal(TIFFReadEncodedTile(t, i, tile, -1), DEM_TILE * DEM_TILE * 4);
			for (uint32_t dy = 0; dy < DEM_TILE && y + dy < m.h; dy++)
				for (uint32_t dx = 0; dx < DEM_TILE && x + dx < m.w; dx++)
					m.pixel[(size_t)(y + dy) * m.w + x + dx] = tile[dy * DEM_TILE + dx];
		}
	free(tile);
	return m;
}

static TIFF *open_file(const char *name)
{
	TIFF *t;

	TIFFSetWarningHandler(NULL); /* of tags that it does not know */
	t = TIFFOpen(path_of(name), "r");
	assert_non_null(t);
	return t;
}

/* The height at the centre of the pixel in column x and row y of absolute numbers, doubled lattice numbers; heights that are
 * so near to a border between floats that doubles do not tell are left to test_raster.c. */
static bool is_height(const struct grid *g, int64_t x, int64_t y, float got)
{
	int64_t dx = x - 2 * X0, dy = y - 2 * Y0, c, r;
	double u, v, z[4], want;

	if (dx < 0 || dy <= 0 || dx >= 2 * STEP * (COLUMNS - 1) || dy > 2 * STEP * (ROWS - 1))
		return got == -9999;
	c = dx / (2 * STEP);
	r = (dy - 1) / (2 * STEP); /* a centre on a border is of the square below */
	if (is_hole((unsigned)(r * (COLUMNS - 1) + c)))
		return got == -9999;
	u = (double)dx / (2 * STEP) - (double)c;
	v = (double)dy / (2 * STEP) - (double)r;
	for (int i = 0; i < 4; i++)
		z[i] = g->z[r + i / 2][c + i % 2] / 1000.0;
	want = v <= u ? z[0] + u * (z[1] - z[0]) + v * (z[3] - z[1]) : z[0] + v * (z[2] - z[0]) + u * (z[3] - z[2]);
	return got == (float)(want + 1e-12) || got == (float)(want - 1e-12);
}

static float mean(const struct image *m, uint32_t x, uint32_t y)
{
	double sum = 0;
	int n = 0;

	for (uint32_t i = 0; i < 4; i++) {
		uint32_t px = 2 * x + i % 2, py = 2 * y + i / 2;

		if (px < m->w && py < m->h && m->pixel[(size_t)py * m->w + px] != -9999) {
			sum += m->pixel[(size_t)py * m->w + px];
			n++;
		}
	}
	return n ? (float)(sum / n) : -9999;
}

static void check_levels(TIFF *t, struct image m)
{
	unsigned levels = 1;

	while (TIFFReadDirectory(t)) {
		struct image next = read_level(t);
		uint32_t type = 0;

		TIFFGetField(t, TIFFTAG_SUBFILETYPE, &type);
		assert_int_equal(type, FILETYPE_REDUCEDIMAGE);
		assert_int_equal(next.w, (m.w + 1) / 2);
		assert_int_equal(next.h, (m.h + 1) / 2);
		for (uint32_t y = 0; y < next.h; y++)
			for (uint32_t x = 0; x < next.w; x++)
				assert_true(next.pixel[(size_t)y * next.w + x] == mean(&m, x, y));
		free(m.pixel);
		m = next;
		levels++;
	}
	assert_true(m.w <= DEM_TILE && m.h <= DEM_TILE);
	assert_true(levels == 4);
	free(m.pixel);
}

static void read_back(bool big)
{
	struct grid *g = calloc(1, sizeof(*g));
	struct dem_options opt = usual;
	struct err err = ERR_INIT;
	double *scale = NULL, *tie = NULL;
	uint32_t n = 0;
	uint16_t *keys = NULL, short_n = 0;
	char *text = NULL;
	struct image m;
	TIFF *t;

	make(g);
	opt.big = big;
	assert_int_equal(write_file(g, &head, &opt, "out.tif", &err), 0);
	t = open_file("out.tif");
	m = read_level(t);
	/* 649400 to 661000 and 6800003.1 to 6807603.1 */
	assert_int_equal(m.w, 1160);
	assert_int_equal(m.h, 761);
	for (uint32_t y = 0; y < m.h; y++)
		for (uint32_t x = 0; x < m.w; x++)
			assert_true(is_height(g, X0 * 2 + (2 * (int64_t)x + 1) * CELL,
					      (2 * (int64_t)(m.h - 1 - y) + 1) * CELL + 600, m.pixel[(size_t)y * m.w + x]));
	assert_int_equal(TIFFGetField(t, PIXEL_SCALE, &short_n, &scale), 1);
	assert_true(short_n == 3 && scale[0] == 1 && scale[1] == 1 && scale[2] == 0);
	assert_int_equal(TIFFGetField(t, TIE_POINT, &short_n, &tie), 1);
	assert_int_equal(short_n, 6);
	assert_true(tie[0] == 0 && tie[1] == 0 && tie[3] == 649400 && tie[4] == 6800764);
	assert_int_equal(TIFFGetField(t, GEO_KEYS, &short_n, &keys), 1);
	n = short_n;
	assert_int_equal(n, 4 * 8);
	assert_int_equal(keys[3], 7);
	for (unsigned i = 2; i < n / 4; i++)
		assert_true(keys[4 * i] > keys[4 * (i - 1)]);
	assert_int_equal(keys[4 * 4 + 3], 2154);
	assert_int_equal(keys[4 * 6 + 3], 5720);
	assert_int_equal(TIFFGetField(t, NODATA, &short_n, &text), 1);
	assert_string_equal(text, "-9999");
	check_levels(t, m);
	TIFFClose(t);
	free(g);
}

static void test_read_back(void **state)
{
	uint8_t version[2][4] = {{0}};

	for (int big = 0; big < 2; big++) {
		FILE *f;

		read_back(big);
		f = fopen(path_of("out.tif"), "r");
		assert_int_equal(fread(version[big], 1, 4, f), 4);
		fclose(f);
	}
	assert_memory_equal(version, "II*\0II+\0", 8);
}

/* The keys as a text: "1024=1", and "1026=c" of a citation. */
static void keys_text(TIFF *t, char *ret, size_t size)
{
	uint32_t n[2] = {0}; /* more than libtiff may write */
	uint16_t *keys = NULL;
	char *pool = NULL;
	size_t at = 0;

	assert_int_equal(TIFFGetField(t, GEO_KEYS, &n[0], &keys), 1);
	assert_int_equal(TIFFGetField(t, GEO_ASCII, &n[1], &pool), 1);
	assert_int_equal(n[0], 4 * (keys[3] + 1));
	for (unsigned i = 1; i <= keys[3]; i++) {
		const uint16_t *k = keys + 4 * i;

		assert_true(i == 1 || k[0] > k[-4]);
		if (k[1] == GEO_ASCII)
			assert_int_equal(pool[k[3] + k[2] - 1], '|');
		if (k[1] == GEO_ASCII)
			at += (size_t)snprintf(ret + at, size - at, "%u=%.*s ", k[0], k[2] - 1, pool + k[3]);
		else
			at += (size_t)snprintf(ret + at, size - at, "%u=%u ", k[0], k[3]);
		assert_true(at < size);
	}
}

/* A number where one is certain, else a citation. */
static void test_system(void **state)
{
	static char longest[3001];
	static const struct {
		const char *crs, *wkt, *unit_xy, *unit_z;
		enum dem_kind kind;
		bool converted;
		const char *want;
	} row[] = {
		{"EPSG:2154 + EPSG:5720", "W[]", "metre", "metre", DEM_ELEVATION, false,
		 "1024=1 1025=1 1026=EPSG:2154 + EPSG:5720 3072=2154 3076=9001 4096=5720 4099=9001 "},
		{"EPSG:2154 + EPSG:5720", "W[]", "metre", "metre", DEM_SLOPE, false,
		 "1024=1 1025=1 1026=EPSG:2154 + EPSG:5720 3072=2154 3076=9001 "},
		{"EPSG:2154 + EPSG:5720", "W[]", "metre", "metre", DEM_ELEVATION, true,
		 "1024=1 1025=1 1026=EPSG:2154 + EPSG:5720 3072=2154 3076=9001 "},
		{"EPSG:2154 + orthometric height (egm96)", "", "metre", "foot", DEM_ELEVATION, false,
		 "1024=1 1025=1 1026=EPSG:2154 + orthometric height (egm96) 3072=2154 3076=9001 4096=32767 "
		 "4097=orthometric height (egm96) 4099=9002 "},
		{"EPSG:2154 + ellipsoidal height (a|b)", NULL, "metre", "metre", DEM_ELEVATION, false,
		 "1024=1 1025=1 1026=EPSG:2154 + ellipsoidal height (a/b) 3072=2154 3076=9001 4097=ellipsoidal height (a/b) 4099=9001 "},
		{"EPSG:32633 + EPSG:5030", "", "metre", "unknown", DEM_ELEVATION, false,
		 "1024=1 1025=1 1026=EPSG:32633 + EPSG:5030 3072=32633 3076=9001 4097=EPSG:5030 "},
		{"EPSG:4326 + EPSG:5773", "", "degree", "metre", DEM_ELEVATION, false,
		 "1024=2 1025=1 1026=EPSG:4326 + EPSG:5773 2048=4326 2054=9102 4096=5773 4099=9001 "},
		{"site", "W[\"a\"]", "metre", "metre", DEM_HILLSHADE, false,
		 "1024=32767 1025=1 1026=site 3073=ESRI PE String = W[\"a\"] 3076=9001 "},
		{"site + here", "W[]", "metre", "metre", DEM_ELEVATION, false,
		 "1024=32767 1025=1 1026=site + here 3073=ESRI PE String = W[] 3076=9001 "},
		{"site + here", "W[]", "metre", "metre", DEM_SLOPE, false, "1024=32767 1025=1 1026=site + here 3076=9001 "},
		{"site", "W[\"|\"]", "metre", "metre", DEM_ELEVATION, false, "1024=32767 1025=1 1026=site 3076=9001 "},
		{"site", longest, "metre", "metre", DEM_ELEVATION, false, "1024=32767 1025=1 1026=site 3076=9001 "},
		{"site", NULL, "metre", "metre", DEM_ELEVATION, false, "1024=32767 1025=1 1026=site 3076=9001 "},
	};
	struct grid *g = calloc(1, sizeof(*g));

	memset(longest, 'w', sizeof(longest) - 1);
	for (unsigned i = 0; i < sizeof(row) / sizeof(*row); i++) {
		struct acut_mesh_head h = head;
		struct dem_options opt = usual;
		struct err err = ERR_INIT;
		char text[4096];
		TIFF *t;

		h.crs = row[i].crs;
		h.wkt = row[i].wkt;
		opt.unit_xy = row[i].unit_xy;
		opt.unit_z = row[i].unit_z;
		opt.kind = row[i].kind;
		opt.z_converted = row[i].converted;
		assert_int_equal(write_file(g, &h, &opt, "out.tif", &err), 0);
		t = open_file("out.tif");
		keys_text(t, text, sizeof(text));
		assert_string_equal(text, row[i].want);
		TIFFClose(t);
	}
	free(g);
}

static int give_up(void *ctx)
{
	return ++*(int *)ctx == 3;
}

static void test_interrupted(void **state)
{
	struct grid *g = calloc(1, sizeof(*g));
	struct dem_options opt = usual;
	struct err err = ERR_INIT;
	int asked = 0;

	make(g);
	opt.interrupted = give_up;
	opt.ctx = &asked;
	assert_int_equal(write_file(g, &head, &opt, "given-up.tif", &err), -ERR_CANCELLED);
	assert_int_equal(asked, 3);
	assert_int_equal(access(path_of("given-up.tif"), F_OK), -1);
	free(g);
}

static uint8_t *bytes_of(const char *name, size_t *ret_n)
{
	FILE *f = fopen(path_of(name), "r");
	uint8_t *bytes = malloc(1 << 26);

	assert_non_null(f);
	*ret_n = fread(bytes, 1, 1 << 26, f);
	fclose(f);
	return bytes;
}

static void same_files(const char *a, const char *b)
{
	size_t n, m;
	uint8_t *x = bytes_of(a, &n), *y = bytes_of(b, &m);

	assert_int_equal(n, m);
	assert_memory_equal(x, y, n);
	free(x);
	free(y);
}

static void test_order_and_memory(void **state)
{
	struct grid *g = calloc(1, sizeof(*g));
	struct dem_options opt = usual;
	struct err err = ERR_INIT;

	make(g);
	for (opt.kind = DEM_ELEVATION; opt.kind <= DEM_HILLSHADE; opt.kind++) {
		opt.cache = 0;
		assert_int_equal(write_file(g, &head, &opt, "a.tif", &err), 0);
		for (unsigned round = 0; round < 3; round++) {
			for (unsigned i = g->n; i > 1; i--) {
				unsigned k = (unsigned)random_below(&seed, i);
				uint32_t was = g->order[i - 1];

				g->order[i - 1] = g->order[k];
				g->order[k] = was;
			}
			opt.cache = 2 + 3 * round;
			assert_int_equal(write_file(g, &head, &opt, "b.tif", &err), 0);
			same_files("a.tif", "b.tif");
		}
	}
	/* drawn twice, as a fetch may that goes on */
	memcpy(g->order + g->n / 2, g->order, (g->n - g->n / 2) * sizeof(*g->order));
	free(g);
}

/* Windows side by side have each pixel once, and the same height as the whole. */
static void test_windows(void **state)
{
	const int64_t cut[] = {649400, 649623, 650000, 650517, 670000};
	struct grid *g = calloc(1, sizeof(*g));
	struct err err = ERR_INIT;
	uint64_t pixels = 0;
	struct image whole;
	TIFF *t;

	make(g);
	assert_int_equal(write_file(g, &head, &usual, "out.tif", &err), 0);
	t = open_file("out.tif");
	whole = read_level(t);
	TIFFClose(t);
	for (int i = 0; i < 4; i++) {
		struct acut_mesh_head h = head;
		struct image m;
		uint32_t from = (uint32_t)(cut[i] - cut[0]);
		char view[200];

		snprintf(view, sizeof(view), "view 1 zmin=3 window=box:%lld,%lld,%lld,%lld",
			 (long long)cut[i] * 100 + (i ? 50 : 0), 680000000ll, (long long)cut[i + 1] * 100 + 50, 690000000ll);
		h.view = view;
		assert_int_equal(write_file(g, &h, &usual, "out.tif", &err), 0);
		t = open_file("out.tif");
		m = read_level(t);
		TIFFClose(t);
		for (uint32_t y = 0; y < m.h; y++)
			for (uint32_t x = 0; x < m.w; x++)
				assert_true(m.pixel[(size_t)y * m.w + x] == whole.pixel[(size_t)y * whole.w + from + x]);
		assert_int_equal(m.h, whole.h);
		pixels += m.w;
		free(m.pixel);
	}
	assert_int_equal(pixels, whole.w);
	free(whole.pixel);
	free(g);
}

/* Nothing at all is one pixel of no data. */
static void test_empty(void **state)
{
	struct grid *g = calloc(1, sizeof(*g));
	struct err err = ERR_INIT;
	struct image m;
	TIFF *t;

	assert_int_equal(write_file(g, &head, &usual, "out.tif", &err), 0);
	t = open_file("out.tif");
	m = read_level(t);
	assert_true(m.w == 1 && m.h == 1 && m.pixel[0] == -9999);
	assert_false(TIFFReadDirectory(t));
	TIFFClose(t);
	free(m.pixel);
	free(g);
}

/* Slopes and shades of planes whose angles are known. */
static void test_slopes(void **state)
{
	const struct {
		int32_t east, north; /* rise over 4000 */
		enum dem_kind kind;
		double want;
	} row[] = {{0, 0, DEM_SLOPE, 0},         {40000, 0, DEM_SLOPE, 45},      {0, -40000, DEM_SLOPE, 45},
		   {0, 0, DEM_HILLSHADE, 180},   {40000, 0, DEM_HILLSHADE, 218}, {-40000, 0, DEM_HILLSHADE, 37},
		   {0, 40000, DEM_HILLSHADE, 37}};
	struct grid *g = calloc(1, sizeof(*g));

	for (size_t i = 0; i < sizeof(row) / sizeof(*row); i++) {
		struct dem_options opt = usual;
		struct err err = ERR_INIT;
		struct image m;
		TIFF *t;

		make(g);
		for (int r = 0; r < ROWS; r++)
			for (int c = 0; c < COLUMNS; c++)
				g->z[r][c] = row[i].east * c + row[i].north * r;
		opt.kind = row[i].kind;
		assert_int_equal(write_file(g, &head, &opt, "out.tif", &err), 0);
		t = open_file("out.tif");
		m = read_level(t);
		TIFFClose(t);
		assert_true(fabs(m.pixel[(size_t)(m.h - 5) * m.w + 5] - row[i].want) < 1e-4);
		free(m.pixel);
	}
	free(g);
}

static int begin_tile(void *ctx, const int64_t at[2], struct outfile **ret, struct err *err)
{
	return outfile_new(path_of("tile.tif"), false, ret, err);
}

static int end_tile(void *ctx, const int64_t at[2], struct outfile *out, const struct dem_tile *t, struct err *err)
{
	++*(unsigned *)ctx;
	outfile_free(out);
	return 0;
}

/* A square of many stored tiles is counted once. */
static void test_large_squares(void **state)
{
	struct grid *g = calloc(1, sizeof(*g));
	unsigned tiles = 0;
	/* 2 km: two squares have all of the raster, 5 by 3 stored tiles. */
	const struct dem_tiler tiler = {.p = 200000, .q = 1, .most = 2, .begin = begin_tile, .end = end_tile, .ctx = &tiles};
	struct err err = ERR_INIT;
	struct outfile *out = NULL;
	struct dem *d = NULL;

	make(g);
	assert_int_equal(outfile_new(path_of("whole.tif"), false, &out, &err), 0);
	assert_int_equal(draw(g, &head, &usual, out, &d, &err), 0);
	assert_int_equal(dem_finish_tiles(d, &tiler, &err), 0);
	assert_int_equal(tiles, 2);
	dem_free(d);
	outfile_free(out);
	free(g);
}

/* No space for the tiles that do not fit the memory, nor for anything after them. */
static void test_no_space(void **state)
{
	struct grid *g = calloc(1, sizeof(*g));
	struct dem_options opt = usual;
	struct rlimit was;

	make(g);
	opt.cache = 2;
	signal(SIGXFSZ, SIG_IGN);
	assert_int_equal(getrlimit(RLIMIT_FSIZE, &was), 0);
	for (rlim_t size = 0; size < 2000000; size += 150001) {
		const struct rlimit small = {size, was.rlim_max};
		struct err err = ERR_INIT;
		int r;

		assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
		r = write_file(g, &head, &opt, "full.tif", &err);
		assert_int_equal(setrlimit(RLIMIT_FSIZE, &was), 0);
		assert_true(r < 0);
		assert_int_equal(err_exit_status(err.code), 74);
		assert_int_equal(access(path_of("full.tif"), F_OK), -1);
	}
	free(g);
}

/* A height that would be read as none, and rasters that are too large, are errors with a way out. */
static void test_refused(void **state)
{
	struct grid *g = calloc(1, sizeof(*g));
	struct dem_options opt = usual;
	struct err err = ERR_INIT;

	make(g);
	for (int r = 0; r < ROWS; r++)
		for (int c = 0; c < COLUMNS; c++)
			g->z[r][c] = -9999000;
	assert_int_equal(write_file(g, &head, &opt, "refused.tif", &err), -ERR_USAGE);
	assert_non_null(strstr(err.message, "-9999"));
	assert_int_equal(access(path_of("refused.tif"), F_OK), -1);
	g->n = 1;
	opt.cell = (struct decimal){1, -3};
	err = ERR_INIT;
	assert_int_equal(write_file(g, &head, &opt, "refused.tif", &err), -ERR_USAGE);
	assert_non_null(strstr(err.message, "pixels"));
	assert_non_null(strstr(err.hint, "--cell 0.02 fits"));
	assert_int_equal(access(path_of("refused.tif"), F_OK), -1);
	free(g);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_read_back),   cmocka_unit_test(test_system),        cmocka_unit_test(test_order_and_memory),
		cmocka_unit_test(test_windows),     cmocka_unit_test(test_empty),         cmocka_unit_test(test_slopes),
		cmocka_unit_test(test_refused),     cmocka_unit_test(test_large_squares), cmocka_unit_test(test_no_space),
		cmocka_unit_test(test_interrupted),
	};
	char command[300];
	int failed;

	repeat_folder(folder, sizeof(folder), "dem");
	failed = cmocka_run_group_tests(tests, NULL, NULL);
	snprintf(command, sizeof(command), "rm -r '%s'", folder);
	return system(command) ? 1 : failed;
}
