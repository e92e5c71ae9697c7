/*
 * Recognising formats. Files of other programs are refused with the name of the format and a hint, under a typical name and under
 * the name of a text or LAS file. Texts of points that are similar to such files are read.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "fixture.h"

/* Bytes of a file: those of `text`, zeros up to `at`, then `more`, and zeros up to `size`. */
struct row {
	const char *name, *text;
	size_t n, at;
	const char *more;
	size_t n_more, size;
	const char *what, *todo;
	bool named; /* told by the name, too */
};

#define TEXT(t) t, sizeof(t) - 1
#define NOTHING 0, NULL, 0, 0

static const struct row foreign[] = {
	{"a.las.gz", TEXT("\x1f\x8b\x08\0\0\0\0\0\0\3"), NOTHING, "a gzip file", "gunzip -k a.las.gz", false},
	{"a.zip", TEXT("PK\3\4\x14\0"), NOTHING, "a zip archive", "unzip a.zip", false},
	{"a.zip", TEXT("PK\5\6\0\0"), NOTHING, "an empty zip archive", "get it again", false},
	{"a.zip", TEXT("PK\7\10PK\3\4"), NOTHING, "a part of a zip archive", "zip -s 0", false},
	{"a.las.bz2", TEXT("BZh91AY&SY\0\0"), NOTHING, "a bzip2 file", "bunzip2 -k a.las.bz2", false},
	{"a.las.xz",
	 TEXT("\xfd"
	      "7zXZ\0\0\4"),
	 NOTHING, "an xz file", "unxz -k a.las.xz", false},
	{"a.las.zst", TEXT("\x28\xb5\x2f\xfd\4"), NOTHING, "a zstd file", "unzstd a.las.zst", false},
	{"a.7z", TEXT("7z\xbc\xaf\x27\x1c\0\4"), NOTHING, "a 7z archive", "7z x a.7z", false},
	{"a.rar", TEXT("Rar!\x1a\7\1\0"), NOTHING, "a RAR archive", "unrar x a.rar", false},
	{"a.tar", TEXT("a.las"), 257, TEXT("ustar  "), 1024, "a tar archive", "tar -xf a.tar", false},
	{"a.e57", TEXT("ASTM-E57\1\0\0\0"), NOTHING, "E57 (ASTM E2807)", "pdal translate a.e57 a.laz", false},
	{"my scan.e57", TEXT("ASTM-E57\1\0\0\0"), NOTHING, "E57 (ASTM E2807)", "pdal translate FILE FILE.laz", false},
	{"d/a.ply", TEXT("ply\nformat ascii 1.0\nelement vertex 1\n"), NOTHING, "PLY", "pdal translate a.ply a.laz", false},
	{"a.ply", TEXT("ply\r\nformat binary_little_endian 1.0\r\n\1\2"), NOTHING, "PLY", "pdal translate a.ply a.laz", false},
	{"a.pcd", TEXT("# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"), NOTHING, "PCD", "pdal translate a.pcd a.laz",
	 false},
	{"a.pcd", TEXT("VERSION .7\nFIELDS x y z\n"), NOTHING, "PCD", "pdal translate a.pcd a.laz", false},
	{"a.obj", TEXT("# made by hand\nmtllib a.mtl\nv 1 2 3\n"), NOTHING, "OBJ", "pdal translate a.obj a.laz", false},
	{"a.obj", TEXT("v 1.0 2.0 3.0\nv 4 5 6\n"), NOTHING, "OBJ", "pdal translate a.obj a.laz", false},
	{"a.obj", TEXT("o Terrain\nv 1 2 3\n"), NOTHING, "OBJ", "pdal translate a.obj a.laz", false},
	{"a.tif", TEXT("II*\0\10\0\0\0"), NOTHING, "TIFF, perhaps GeoTIFF", "gdal2xyz.py -skipnodata a.tif a.xyz", false},
	{"a.tif", TEXT("MM\0*\0\0\0\10"), NOTHING, "TIFF, perhaps GeoTIFF", "gdal2xyz.py -skipnodata a.tif a.xyz", false},
	{"a.tif", TEXT("II+\0\10\0\0\0"), NOTHING, "BigTIFF", "gdal2xyz.py -skipnodata a.tif a.xyz", false},
	{"a.tif", TEXT("MM\0+\0\10\0\0"), NOTHING, "BigTIFF", "gdal2xyz.py -skipnodata a.tif a.xyz", false},
	{"a.asc", TEXT("ncols 4\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3 4\n5 6 7 8\n"), NOTHING,
	 "an ESRI ASCII grid", "gdal2xyz.py -skipnodata a.asc a.xyz", false},
	{"a.asc", TEXT("NCOLS        4\r\nNROWS 2\r\n"), NOTHING, "an ESRI ASCII grid", "gdal2xyz.py -skipnodata a.asc a.xyz",
	 false},
	{"a.asc", TEXT("nrows 4\nncols 2\n"), NOTHING, "an ESRI ASCII grid", "gdal2xyz.py -skipnodata a.asc a.xyz", false},
	{"hdr.adf", TEXT("GRID1.2\0\0\0"), NOTHING, "an ESRI binary grid", "name its folder", false},
	{"w001001.adf", TEXT("\0\0\x27\x0a\xff\xff\xfc\x14"), NOTHING, "an ESRI binary grid", "name its folder", false},
	{"a.grd", TEXT("DSBB\4\0"), NOTHING, "a Surfer grid", "gdal2xyz.py -skipnodata a.grd a.xyz", false},
	{"a.grd", TEXT("DSAA\n4 4\n"), NOTHING, "a Surfer grid", "gdal2xyz.py -skipnodata a.grd a.xyz", false},
	{"a.fbi", TEXT("FASTBIN\0\1"), NOTHING, "FBI (TerraScan Fast Binary)", "pdal translate a.fbi a.laz", false},
	{"a.bin",
	 TEXT("\x38\0\0\0\x4b\x7c\x31\1\xa1\xce\x0e\0"
	      "CXYZ"),
	 NOTHING, "TerraScan binary", "pdal translate -r readers.terrasolid a.bin a.laz", false},
	{"a.h5", TEXT("\x89HDF\r\n\x1a\n\0"), NOTHING, "HDF5", "readers.hdf", false},
	{"a.nc", TEXT("CDF\1\0\0"), NOTHING, "netCDF", "gdal2xyz.py", false},
	{"a.dxf", TEXT("  0\nSECTION\n  2\nHEADER\n"), NOTHING, "DXF", "ogr2ogr -f CSV -lco GEOMETRY=AS_XYZ a.csv a.dxf", false},
	{"a.dxf", TEXT("999\r\nmade by hand\r\n  0\r\nSECTION\r\n"), NOTHING, "DXF", "ogr2ogr", false},
	{"a.dxf", TEXT("999\none\n999\ntwo\n0\nSECTION\n2\nHEADER\n"), NOTHING, "DXF", "ogr2ogr", false},
	{"a.dxf", TEXT("AutoCAD Binary DXF\r\n\x1a\0\0"), NOTHING, "DXF, binary", "in ASCII", false},
	{"a.dwg", TEXT("AC1027\0\0"), NOTHING, "DWG", "a.csv a.dxf", false},
	{"a.shp", TEXT("\0\0\x27\x0a"), 28, TEXT("\xe8\3\0\0"), 100, "a Shapefile", "a.csv a.shp", false},
	{"a.gpkg", TEXT("SQLite format 3\0"), 68, TEXT("GPKG"), 100, "a GeoPackage", "a.csv a.gpkg", false},
	{"a.sqlite", TEXT("SQLite format 3\0"), 90, NULL, 0, 100, "an SQLite database", "ogr2ogr", false},
	{"a.lax", TEXT("LASX\0\0\0\0LASS"), NOTHING, "an index of LAStools", "beside it", false},
	{"a.pdf", TEXT("%PDF-1.4\n"), NOTHING, "a PDF document", "with points", false},
	{"a.laz", TEXT("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"), NOTHING, "a pointer of Git LFS",
	 "git lfs pull", false},
	{"a.laz", TEXT("<!DOCTYPE html>\n<html>404</html>\n"), NOTHING, "a web page (HTML)", "get the file again", false},
	{"a.xml", TEXT("<?xml version=\"1.0\"?>\n<LandXML version=\"1.2\">\n"), NOTHING, "LandXML", "export its points", false},
	{"a.gml", TEXT("\xef\xbb\xbf<?xml version=\"1.0\"?>\n<gml/>\n"), NOTHING, "XML", "ogr2ogr", false},
	{"a.geojson", TEXT("{ \"type\": \"FeatureCollection\" }"), NOTHING, "JSON, perhaps GeoJSON", "a.csv a.geojson", false},
	{"sbet.out", TEXT("\0\0\0\0\0\x88\x13\x41\x18\x2d\x44\x54\xfb\x21\xe9\x3f"), 200, NULL, 0, 272, "SBET, a trajectory",
	 "LAS or LAZ", true},
	{"a.rxp", TEXT("\xaf\x63\x05\0\1"), NOTHING, "RXP (RIEGL)", "RiSCAN PRO", true},
	{"a.RDBX", TEXT("\x10\0\5\0\1"), NOTHING, "RDB (RIEGL)", "readers.rdb", true},
	{"a.fls", TEXT("\x10\0\5\0\1"), NOTHING, "FLS (FARO)", "PTX", true},
	{"a.zfs", TEXT("\x10\0\5\0\1"), NOTHING, "ZFS (Zoller + Froehlich)", "PTX", true},
	{"a.ptg", TEXT("\x10\0\5\0\1"), NOTHING, "PTG (Leica)", "PTX", true},
	{"a.rcs", TEXT("\x10\0\5\0\1"), NOTHING, "ReCap (Autodesk)", "PTX", true},
	{"a.flt", TEXT("\0\0\x80\x3f\0"), NOTHING, "an ESRI float grid", "gdal2xyz.py", true},
};

static void check(const struct row *row, const char *name, bool told)
{
	const struct input_options defaults = {.format = NULL};
	uint8_t bytes[2048] = {0};
	size_t size = row->size ? row->size : row->n;
	struct outcome out;

	memcpy(bytes, row->text, row->n);
	if (row->more)
		memcpy(bytes + row->at, row->more, row->n_more);
	out = fixture_read(bytes, size, name, &defaults, 10);
	if (out.code != ERR_INPUT || !*out.err.file)
		fail_msg("%s as %s: %d %s", row->what, name, out.code, out.err.message);
	if (!told)
		return;
	if (strncmp(out.err.message, "this is ", 8) || strncmp(out.err.message + 8, row->what, strlen(row->what)) ||
	    !strstr(out.err.message, "; acut reads LAS, LAZ, COPC, ") ||
	    (!strcmp(name, row->name) && !strstr(out.err.hint, row->todo)))
		fail_msg("%s as %s: %s; %s", row->what, name, out.err.message, out.err.hint);
}

static void signatures(void **state)
{
	static const char *const names[] = {"a.xyz", "a.txt", "a.pts", "a.las", "a.laz", "a", "a.unknown"};

	for (size_t i = 0; i < sizeof foreign / sizeof *foreign; i++) {
		check(&foreign[i], foreign[i].name, true);
		for (size_t k = 0; k < sizeof names / sizeof *names; k++)
			check(&foreign[i], names[k], !foreign[i].named);
	}
}

/* What --input-format says, is meant. */
static void said(void **state)
{
	static const char text[] = "# .PCD v0.7\nVERSION 0.7\n1 2 3\n";

	assert_int_equal(
		fixture_read("v 1 2 3\n", 8, "a.xyz", &(struct input_options){.format = "xyz", .columns = "sxyz"}, 10).points, 1);
	assert_int_equal(fixture_read(text, sizeof text - 1, "a.xyz", &(struct input_options){.format = NULL}, 10).code,
			 ERR_INPUT);
}

/* Descriptions and codes of points may be words of other formats. */
static void survey_text(void **state)
{
	static const struct {
		const char *text, *columns;
		uint64_t points;
	} rows[] = {
		{"999 5400084.10 412.50 CROSS SECTION\n1000 5400085.20 412.60 CROSS SECTION\n", "xyzs", 2},
		{"999 612345.10 5400084.10 412.50\n1000 612346.10 5400085.20 412.60 SECTION\n", "sxyz", 2},
		{"# 999\n1 2 3\n4 5 6 SECTION\n", NULL, 2},
		{"# .pcd is made of this\n1 2 3\n", NULL, 1},
		{"v 612345.1 5400084.1 412.5\nkerb 612346.1 5400085.1 412.6\n", "sxyz", 2},
		{"G 612345.1 5400084.1 412.5\nv 612346.1 5400085.1 412.6\n", "sxyz", 2},
		{"O 612345.1 5400084.1 412.5\nv 612346.1 5400085.1 412.6\n", "sxyz", 2},
		{"DSAA 612345.1 5400084.1 412.5\n", "sxyz", 1},
		{"DSBB 612345.1 5400084.1 412.5\n", "sxyz", 1},
		{"GRID1.25 612345.1 5400084.1 412.5\n", "sxyz", 1},
		{"FASTBIN 612345.1 5400084.1 412.5\n", "sxyz", 1},
		{"nrows,x,y,z\n4,1,2,3\n", NULL, 1},
		{"nrows x y z\n4 1 2 3\n", NULL, 1},
		{"ncols 612345.1 5400084.1 412.5\n", "sxyz", 1},
		{"# of <LandXML version=\"1.2\">\n1 2 3\n", NULL, 1},
		{"{7} 612345.1 5400084.1 412.5\n", "sxyz", 1},
		{"// ASTM-E57\n1 2 3\n", NULL, 1},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const struct input_options options = {.columns = rows[i].columns};
		struct outcome out = fixture_read(rows[i].text, strlen(rows[i].text), "a.txt", &options, 10);

		if (out.code || out.points != rows[i].points)
			fail_msg("%s: %d %s", rows[i].text, out.code, out.err.message);
	}
}

/* No bytes are a text without points, and said to be; of any other format they are no file. */
static void empty(void **state)
{
	static const char *const refused[] = {"a.las",    "a.LAZ", "a.copc.laz", "a.ptx", "a.gz",
					      "a.xyz.gz", "a.zip", "a.e57",      "a",     "a.dat"},
				 *const taken[] = {"a.xyz", "a.txt", "a.CSV", "a.asc", "a.pts"};
	const struct input_options defaults = {.format = NULL}, said = {.format = "xyz"};
	struct outcome out;

	for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
		out = fixture_read("", 0, refused[i], &defaults, 10);
		if (out.code != ERR_TRUNCATED || strcmp(out.err.file, refused[i]) ||
		    strcmp(out.err.message, "the file is empty (0 bytes)"))
			fail_msg("%s: %d %s", refused[i], out.code, out.err.message);
		out = fixture_read("", 0, refused[i], &said, 10);
		if (out.code || out.points || !strstr(out.info.warning, "empty (0 bytes)"))
			fail_msg("%s as xyz: %d %s", refused[i], out.code, out.err.message);
	}
	for (size_t i = 0; i < sizeof taken / sizeof *taken; i++) {
		out = fixture_read("", 0, taken[i], &defaults, 10);
		if (out.code || out.points || !strstr(out.info.warning, "empty (0 bytes)"))
			fail_msg("%s: %d %s; %s", taken[i], out.code, out.err.message, out.info.warning);
	}
}

/* Points, and nothing else. */
static void points(void **state)
{
	static const struct {
		const char *text, *name;
		uint64_t points;
	} rows[] = {
		{"0\n1\n1 2 3\n", "a.pts", 1},
		{"999\n", "a.pts", 0},
		{"# ply\n1 2 3\n", "a.xyz", 1},
		{"# {json}\n1 2 3\n", "a.xyz", 1},
		{"// <?xml\n1 2 3\n", "a.xyz", 1},
		{"# o\n1 2 3\n", "a.obj", 1},
		{"1 2 3\n", "a.rxp", 1},
		{"1 2 3\n", "a.e57", 1},
		{"x y z\n1 2 3\n", "a.flt", 1},
		{"1 2 3\n", "a.asc", 1},
		{"# ncols nrows\n1 2 3\n", "a.asc", 1},
	};
	const struct input_options accept = {.accept_truncated = true};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct outcome out = fixture_read(rows[i].text, strlen(rows[i].text), rows[i].name, &accept, 10);

		if (out.code || out.points != rows[i].points)
			fail_msg("%s as %s: %d %s", rows[i].text, rows[i].name, out.code, out.err.message);
	}
}

static void formats_by_content_and_name(void **state)
{
	const struct input_options defaults = {.format = NULL}, forced = {.format = "xyz"}, wrong = {.format = "e57"};
	static const char binary[] = "\x7f"
				     "ELF\2\1\1\0\0\0";
	struct las_spec s = {.minor = 2, .n = 3};
	struct bytes b = fixture_las(&s);

	assert_string_equal(fixture_read(b.at, b.size, "data.bin", &defaults, 9).info.format, "las");
	assert_string_equal(fixture_read("1 2 3\n", 6, "data.bin", &defaults, 9).info.format, "xyz");
	assert_int_equal(fixture_read(b.at, b.size, "a.las", &forced, 9).code, ERR_INPUT);
	assert_int_equal(fixture_read(b.at, b.size, "a.las", &wrong, 9).code, ERR_USAGE);
	assert_int_equal(fixture_read(binary, sizeof binary, "a.bin", &defaults, 9).code, ERR_INPUT);
	assert_string_equal(fixture_read("1 2 3\n", 6, "a.LAS", &defaults, 9).err.field, "file signature");
	assert_int_equal(fixture_read("", 0, "a.las", &defaults, 9).code, ERR_TRUNCATED);
	assert_int_equal(fixture_read("", 0, "a.xyz", &defaults, 9).code, 0);
	assert_string_equal(fixture_read("1\n1 2 3\n", 8, "a.txt", &defaults, 9).info.format, "pts");
	assert_string_equal(fixture_read("1 2 3\n", 6, "a.pts", &defaults, 9).info.format, "xyz");
	assert_string_equal(fixture_read("", 0, "a.pts", &defaults, 9).info.format, "pts");
	free(b.at);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(signatures), cmocka_unit_test(said),   cmocka_unit_test(survey_text),
		cmocka_unit_test(empty),      cmocka_unit_test(points), cmocka_unit_test(formats_by_content_and_name),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
