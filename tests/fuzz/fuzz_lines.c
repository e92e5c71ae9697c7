/*
 * Any bytes as a file of lines. Usable features keep what the door promises, all failures have a sentence and a file, and reading
 * twice gives the same.
 *
 * FUZZ_LINES is the format. The bytes of a Shapefile are the sizes of the .shp and the .shx (two bytes each), these, and the
 * .dbf.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fuzz_input.h"
#include "lines_made.h"
#include "lines_survey.h"

enum { SHAPE, GEOJSON, GPKG, DXF, LANDXML, CSV };

static char folder[64];

static int remove_folder(void)
{
	char path[128];

	for (const char *const *p = (const char *const[]){"a.shp", "a.shx", "a.dbf", "a", NULL}; *p; p++) {
		snprintf(path, sizeof path, "%s/%s", folder, *p);
		unlink(path);
	}
	return rmdir(folder);
}

static void at_end(void)
{
	remove_folder();
}

/* The path of a file of these bytes. */
static const char *file_of(const char *name, const uint8_t *bytes, size_t n)
{
	static char path[128];
	FILE *f;

	if (!*folder) {
		snprintf(folder, sizeof folder, "%s/acut-fuzz-lines-XXXXXX", access("/dev/shm", W_OK) ? "/tmp" : "/dev/shm");
		if (!mkdtemp(folder) || atexit(at_end))
			abort();
	}
	snprintf(path, sizeof path, "%s/%s", folder, name);
	f = fopen(path, "wb");
	if (!f || fwrite(bytes, 1, n, f) != n || fclose(f))
		abort();
	return path;
}

static const char *input(const uint8_t *bytes, size_t size)
{
	size_t shp, shx;

	if (FUZZ_LINES != SHAPE)
		return file_of("a", bytes, size);
	if (size < 4)
		return NULL;
	shp = bytes[0] | (size_t)bytes[1] << 8;
	shx = bytes[2] | (size_t)bytes[3] << 8;
	bytes += 4;
	size -= 4;
	shp = shp < size ? shp : size;
	shx = shx < size - shp ? shx : size - shp;
	file_of("a.shx", bytes + shp, shx);
	file_of("a.dbf", bytes + shp + shx, size - shp - shx);
	if (!shx)
		unlink(file_of("a.shx", bytes, 0));
	if (shp + shx == size)
		unlink(file_of("a.dbf", bytes, 0));
	return file_of("a.shp", bytes, shp);
}

static void check_feature(const struct lines_feature *f)
{
	size_t at = 0;

	if (!f->layer || !f->geometry || f->nvertices > LINES_VERTICES_MOST || f->nparts > LINES_PARTS_MOST ||
	    (f->state == LINES_REFUSED || f->state == LINES_NO_LINE) != (f->why != NULL))
		abort();
	for (size_t i = 0; f->state == LINES_USABLE && i < f->nparts; i++) {
		if (f->part[i].first < at || f->part[i].n < (f->part[i].ring ? 3 : 2))
			abort();
		at = f->part[i].first + f->part[i].n;
	}
	if (at > f->nvertices || (f->state == LINES_USABLE && !f->nparts))
		abort();
	for (size_t i = 0; f->state == LINES_USABLE && i < f->nvertices; i++)
		for (unsigned k = 0; k < 3; k++)
			if (!(fabs(lines_coordinate(f, i, k)) <= 1e12))
				abort();
}

/* All features by themselves; how many are usable. */
static int read_all(const char *path, const struct lines_options *opt, uint64_t *ret, struct err *err)
{
	const struct lines_feature *f = NULL;
	struct lines *l = NULL;
	int rc = lines_open(path, opt, &l, err);

	*ret = 0;
	while (!rc && !(rc = lines_next(l, &f, err)) && f) {
		struct err refused = ERR_INIT;

		check_feature(f);
		*ret += f->state == LINES_USABLE;
		if (f->state == LINES_REFUSED && (!lines_refusal(l, f, &refused) || !*refused.message))
			abort();
	}
	lines_close(l);
	return rc;
}

static int survey(const char *path, const struct lines_options *opt, uint64_t *ret)
{
	struct lines_survey s = {.nlayers = 0};
	struct err err = ERR_INIT;
	struct lines *l = NULL;
	int rc = lines_open(path, opt, &l, &err);

	if (!rc)
		rc = lines_survey(l, &s, &err);
	*ret = s.all.usable;
	fuzz_input_check(rc, &err);
	lines_survey_done(&s);
	lines_close(l);
	return rc;
}

/* What may be lines has the names of columns that lines have. */
static void check_may_be(const char *path, const struct lines_options *opt)
{
	struct err err = ERR_INIT;
	struct lines *l = NULL;

	if (lines_may_be(path) && lines_open(path, opt, &l, &err))
		abort();
	lines_close(l);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static const struct lines_options plain = {.csv = FUZZ_LINES == CSV},
					  kinds = {.csv = FUZZ_LINES == CSV, .kind_field = "sort"},
					  layer = {.csv = FUZZ_LINES == CSV, .layer = "a"};
	const char *path = input(bytes, size);
	uint64_t one, two;
	struct err err = ERR_INIT;
	int rc;

	if (!path)
		return 0;
	rc = read_all(path, &plain, &one, &err);
	fuzz_input_check(rc, &err);
	if (rc && !*err.file)
		abort();
	if (survey(path, &plain, &two) != rc || one != two)
		abort();
	survey(path, &kinds, &two);
	survey(path, &layer, &two);
	check_may_be(path, &(struct lines_options){.csv = true});
	return 0;
}

/* ---- seeds ---- */

static const char *const geojson[] = {
	"{\"type\":\"FeatureCollection\",\"name\":\"a\",\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::25832\"}},"
	"\"features\":[{\"type\":\"Feature\",\"properties\":{\"sort\":\"lake\",\"b\":[1,null,{\"c\":true}]},\"geometry\":{\"type\":\"LineString\","
	"\"coordinates\":[[1,2,3],[4.5,5e1,-6]]}},{\"geometry\":{\"coordinates\":[[[[0,0,1],[9,0,1],[9,9,1],[0,0,1]]]],\"type\":\"MultiPolygon\"},"
	"\"type\":\"Feature\"}]}",
	"{\"type\":\"GeometryCollection\",\"geometries\":[{\"type\":\"Point\",\"coordinates\":[1,2]},{\"type\":\"MultiLineString\","
	"\"coordinates\":[[[1,2,3],[4,5,6]],[[NaN,2],[1,1,null]]]}]}",
	"{\"type\":\"Polygon\",\"coordinates\":[[[0,0,1],[9,0,1],[9,9,1],[0,0,2]]],\"x\":\"\\u00e9\\ud83d\\ude00\\n\"}",
};

static const char *const csv[] = {
	"x,y,z,name,sort\n1,2,3,a,lake\n4,5,6,a,lake\n7,8,9,\"b, \"\"c\"\"\",hard\n1,1,1,\"b, \"\"c\"\"\",soft\n",
	"Line ID;Height [m];Easting;Northing\r\n# no\r\na;0.1;1e3;2\r\na;;3;4\r\n",
};

static const char *const dxf[] = {
	"999\nx\n0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1027\n9\n$INSUNITS\n70\n6\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nLINE\n8\na\n10\n1\n"
	"20\n2\n30\n3\n11\n4.5\n21\n5e1\n31\n-6\n0\nPOLYLINE\n8\nb\n66\n1\n70\n9\n0\nVERTEX\n8\na\n10\n0\n20\n0\n30\n1\n0\nVERTEX\n10\n9\n20\n0\n"
	"30\n1\n0\nVERTEX\n10\n9\n20\n9\n30\n1\n42\n0\n0\nSEQEND\n0\nENDSEC\n0\nEOF\n",
	"0\r\nSECTION\r\n2\r\nENTITIES\r\n0\r\nLWPOLYLINE\r\n8\r\na\r\n90\r\n3\r\n70\r\n1\r\n38\r\n7.5\r\n10\r\n0\r\n20\r\n0\r\n10\r\n9\r\n20\r\n0\r\n10\r\n9"
	"\r\n20\r\n9\r\n0\r\n3DFACE\r\n8\r\na\r\n10\r\n0\r\n20\r\n0\r\n30\r\n1\r\n11\r\n9\r\n21\r\n0\r\n31\r\n1\r\n12\r\n9\r\n22\r\n9\r\n32\r\n1\r\n13\r\n0\r\n"
	"23\r\n9\r\n33\r\n1\r\n70\r\n2\r\n0\r\nARC\r\n8\r\nb\r\n0\r\nTEXT\r\n67\r\n1\r\n0\r\nENDSEC\r\n0\r\nEOF\r\n",
};

static const char *const landxml[] = {
	"<?xml version=\"1.0\"?><LandXML version=\"1.2\" xmlns=\"http://www.landxml.org/schema/LandXML-1.2\"><Units><Metric linearUnit=\"meter\"/>"
	"</Units><CoordinateSystem name=\"UTM\" epsgCode=\"25832\"/><Surfaces><Surface name=\"a\"><SourceData><Breaklines><Breakline "
	"sort=\"wall\"><PntList3D>1 2 3 4.5 5e1 -6</PntList3D></Breakline></Breaklines><Boundaries><Boundary><PntList3D>0 0 1 9 0 1 9 9 1 0 0 1"
	"</PntList3D></Boundary></Boundaries></SourceData><Definition><Pnts><P id=\"1\">1 2 3</P></Pnts></Definition></Surface></Surfaces></LandXML>",
	"<l:LandXML><l:Surface><l:Breakline><l:PntList2D>1 2 3 4</l:PntList2D></l:Breakline><!-- x --><l:Contour elev=\"1\"/></l:Surface>"
	"<l:CgPoints/></l:LandXML>",
};

static size_t copy(const void *from, size_t n, uint8_t *bytes, size_t room)
{
	if (n > room)
		return 0;
	memcpy(bytes, from, n);
	return n;
}

static size_t shape_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static struct lines_case_bytes shp, shx, dbf, all;

	if (i > 3)
		return 0;
	lines_made_shape_begin(&shp, &shx, i & 1 ? 15 : 13);
	lines_made_shape(&shp, &shx, 13, (uint32_t[]){2, 3, 0});
	lines_made_shape(&shp, &shx, i & 1 ? 15 : 3, (uint32_t[]){4, 5, 0});
	lines_made_shape(&shp, &shx, 11, NULL);
	lines_made_table(&dbf, " * ", 3);
	all.n = 0;
	lines_case_u32(&all, (uint32_t)(shp.n | (i & 2 ? shx.n << 16 : 0)), 0);
	memcpy(all.at + all.n, shp.at, shp.n);
	all.n += shp.n;
	memcpy(all.at + all.n, shx.at, i & 2 ? shx.n : 0);
	all.n += i & 2 ? shx.n : 0;
	memcpy(all.at + all.n, dbf.at, i & 1 ? dbf.n : 0);
	all.n += i & 1 ? dbf.n : 0;
	return copy(all.at, all.n, bytes, room);
}

static size_t gpkg_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static const uint32_t codes[] = {1002, 0x80000003, 3002, 1008, 1001, 2};
	struct lines_case_bytes b = {.n = 0};
	struct lines_made_row rows[2] = {{"hard", b.at, 0}, {NULL, NULL, 0}};
	const char *path;
	size_t n;
	FILE *f;

	if (i >= sizeof codes / sizeof *codes)
		return 0;
	lines_made_gpkg_head(&b, 1 | (i % 5) << 1);
	lines_made_wkb(&b, i & 1, codes[i], 4);
	rows[0].n = b.n;
	path = file_of("a", bytes, 0);
	lines_made_gpkg(path, rows, 2, NULL);
	f = fopen(path, "rb");
	n = f ? fread(bytes, 1, room, f) : 0;
	if (f)
		fclose(f);
	return n;
}

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	switch (FUZZ_LINES) {
	case SHAPE:
		return shape_seed(i, bytes, room);
	case GPKG:
		return gpkg_seed(i, bytes, room);
	case DXF:
		return fuzz_input_text(dxf, sizeof dxf / sizeof *dxf, i, bytes, room);
	case LANDXML:
		return fuzz_input_text(landxml, sizeof landxml / sizeof *landxml, i, bytes, room);
	case CSV:
		return fuzz_input_text(csv, sizeof csv / sizeof *csv, i, bytes, room);
	default:
		return fuzz_input_text(geojson, sizeof geojson / sizeof *geojson, i, bytes, room);
	}
}
