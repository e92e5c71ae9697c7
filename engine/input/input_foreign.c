/*
 * Recognises files of other programs by their first bytes, so that the error names the format and how to convert it to one that
 * acut reads.
 *
 * Model: one row for each format. Signatures come first. A format without a signature is recognised by the extension of the name
 * and by bytes that do not contradict it. A text that matches a row is never read as points, unless --input-format demands it.
 * In a hint @ stands for the file and & for its name without the last extension.
 */
#include "input_table.h"
#include "input_text.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "cursor.h"

struct head {
	const uint8_t *at;
	size_t n;
	uint64_t size; /* of the file */
	const char *name;
};

struct row {
	const char *magic;   /* "" where only `test` tells */
	uint16_t length, at; /* of the magic, and where it lies */
	bool (*test)(const struct head *);
	const char *extensions; /* NULL: whatever it is called */
	const char *what, *hint;
};

#define PDAL "convert it: pdal translate @ &.laz"
#define RASTER "its cells become points by: gdal2xyz.py -skipnodata @ &.xyz"
#define VECTOR "if it has points: ogr2ogr -f CSV -lco GEOMETRY=AS_XYZ &.csv @"
#define VENDOR "export it as LAS, LAZ or PTX with the program of the scanner's maker"
#define MAGIC(text, place) .magic = text, .length = sizeof(text) - 1, .at = place

/* ---- formats without a fixed signature ---- */

/* The place of the first line that is neither blank nor begins with `comment`; NULL: it is not among the first bytes. */
static const char *first_line(const struct head *h, char comment)
{
	const char *p = (const char *)h->at, *end = p + h->n;

	if (h->n >= 3 && !memcmp(p, "\xef\xbb\xbf", 3))
		p += 3;
	while (p < end) {
		while (p < end && isspace((unsigned char)*p))
			p++;
		if (p == end || !comment || *p != comment)
			break;
		while (p < end && *p != '\n')
			p++;
	}
	return p < end ? p : NULL;
}

/* Its words one after the other, with blanks or line ends between them, whatever their case. */
static bool has_words(const struct head *h, const char *p, const char *words)
{
	const char *end = (const char *)h->at + h->n;

	for (; p && *words; words++) {
		if (*words == ' ') {
			const char *begin = p;

			while (p < end && isspace((unsigned char)*p))
				p++;
			if (p == begin)
				return false;
		} else if (p == end || tolower((unsigned char)*p++) != *words) {
			return false;
		}
	}
	return p && (p == end || isspace((unsigned char)*p));
}

static bool has_text(const struct head *h, const char *text)
{
	return memmem(h->at, h->n, text, strlen(text));
}

static bool is_text(const struct head *h)
{
	return input_text_is(h->at, h->n);
}

static bool is_binary(const struct head *h)
{
	return h->n && !is_text(h) && (h->n < 4 || memcmp(h->at, "LASF", 4));
}

static bool is_bzip2(const struct head *h)
{
	return h->n >= 10 && h->at[3] >= '1' && h->at[3] <= '9' &&
	       (!memcmp(h->at + 4, "1AY&SY", 6) || !memcmp(h->at + 4, "\x17\x72\x45\x38\x50\x90", 6));
}

/* A line without the blanks around it. */
struct line {
	const char *at;
	size_t n;
};

/* The line at *p, which moves behind it; false: there is none. */
static bool next_line(const struct head *h, const char **p, struct line *ret)
{
	const char *end = (const char *)h->at + h->n, *stop;

	if (!*p || *p >= end)
		return false;
	stop = memchr(*p, '\n', (size_t)(end - *p));
	stop = stop ? stop : end;
	*ret = (struct line){*p, (size_t)(stop - *p)};
	*p = stop < end ? stop + 1 : end;
	while (ret->n && isspace((unsigned char)*ret->at))
		ret->at++, ret->n--;
	while (ret->n && isspace((unsigned char)ret->at[ret->n - 1]))
		ret->n--;
	return true;
}

static bool line_is(struct line l, const char *text)
{
	return l.n == strlen(text) && !memcmp(l.at, text, l.n);
}

static bool is_ply(const struct head *h)
{
	return h->n > 3 && (h->at[3] == '\n' || h->at[3] == '\r') && has_text(h, "format ");
}

static bool is_pcd(const struct head *h)
{
	return (has_words(h, first_line(h, 0), "# .pcd") && has_text(h, "\nVERSION ")) ||
	       (has_words(h, first_line(h, '#'), "version") && has_text(h, "\nFIELDS "));
}

/* The first word of the line is a keyword of OBJ. */
static bool is_obj_line(struct line l)
{
	static const char words[] = " v vn vt vp f l p o g s usemtl mtllib ";
	char word[10] = " ";
	size_t n = 0;

	while (n < l.n && !isspace((unsigned char)l.at[n]))
		n++;
	if (!n || *l.at == '#')
		return true;
	if (n > sizeof word - 3)
		return false;
	memcpy(word + 1, l.at, n);
	word[n + 1] = ' ';
	return strstr(words, word);
}

/* The text has vertices or materials, and no other lines: lists of points may have codes that are also keywords of OBJ. */
static bool is_obj(const struct head *h)
{
	const char *p = first_line(h, '#'), *end = (const char *)h->at + h->n;
	bool has_vertex = false;
	struct line l;

	if (!p || !is_text(h))
		return false;
	if (has_words(h, p, "mtllib"))
		return true;
	while (next_line(h, &p, &l)) {
		if (p == end && l.n && l.at + l.n == end && has_vertex)
			break; /* perhaps cut */
		if (!is_obj_line(l))
			return false;
		has_vertex |= l.n > 1 && l.at[0] == 'v' && isspace((unsigned char)l.at[1]);
	}
	return has_vertex;
}

/* The number of columns or rows, alone on the first line. */
static bool is_esri_ascii(const struct head *h)
{
	const char *p = first_line(h, 0), *at;
	struct line l;

	if (!(has_words(h, p, "ncols") || has_words(h, p, "nrows")) || !next_line(h, &p, &l))
		return false;
	for (at = l.at + strlen("ncols"); at < l.at + l.n && isspace((unsigned char)*at);)
		at++;
	for (p = at; at < l.at + l.n && isdigit((unsigned char)*at);)
		at++;
	return at > p && at == l.at + l.n;
}

static bool is_surfer_text(const struct head *h)
{
	const char *p = (const char *)h->at;
	struct line l;

	return is_text(h) && next_line(h, &p, &l) && line_is(l, "DSAA");
}

static bool is_geopackage(const struct head *h)
{
	return h->n >= 72 && !memcmp(h->at + 68, "GPKG", 4);
}

static bool is_shapefile(const struct head *h)
{
	return h->n >= 32 && !memcmp(h->at + 28, "\xe8\3\0", 4);
}

static bool is_terrascan(const struct head *h)
{
	return h->n >= 16 && !memcmp(h->at + 8, "\xa1\xce\x0e", 4);
}

/* Pairs of group code and value, each alone on its line: comments (999), then the start of a section (0). */
static bool is_dxf(const struct head *h)
{
	const char *p = first_line(h, 0);
	struct line code, value;

	while (next_line(h, &p, &code) && next_line(h, &p, &value)) {
		if (!line_is(code, "999"))
			return line_is(code, "0") && value.n == 7 && !strncasecmp(value.at, "SECTION", 7);
	}
	return false;
}

static bool is_xml(const struct head *h)
{
	const char *p = first_line(h, 0), *end = (const char *)h->at + h->n;

	return p && end - p >= 5 && !memcmp(p, "<?xml", 5);
}

static bool is_landxml(const struct head *h)
{
	const char *p = first_line(h, 0);

	return p && *p == '<' && is_text(h) && has_text(h, "<LandXML");
}

static bool is_html(const struct head *h)
{
	const char *p = first_line(h, 0);
	size_t n = p ? (size_t)((const char *)h->at + h->n - p) : 0;

	return (n >= 14 && !strncasecmp(p, "<!doctype html", 14)) || (n >= 5 && !strncasecmp(p, "<html", 5));
}

/* An object: a brace, then the name of a member. */
static bool is_json(const struct head *h)
{
	const char *p = first_line(h, 0), *end = (const char *)h->at + h->n;

	if (!p || *p++ != '{' || !is_text(h))
		return false;
	while (p < end && isspace((unsigned char)*p))
		p++;
	return p == end || *p == '"' || *p == '}';
}

static bool is_lax(const struct head *h)
{
	return h->n >= 12 && !memcmp(h->at + 8, "LASS", 4);
}

static bool is_tar(const struct head *h)
{
	return h->n >= 512 && h->at[0] && is_binary(h);
}

/* 17 doubles a record: seconds, latitude and longitude in radians, height, ... */
static bool is_sbet(const struct head *h)
{
	struct cursor c = cursor_of(h->at, h->n);
	double time, latitude, longitude, height;

	if (h->n < 136 || h->size % 136 || !is_binary(h))
		return false;
	time = cursor_f64(&c);
	latitude = cursor_f64(&c);
	longitude = cursor_f64(&c);
	height = cursor_f64(&c);
	return time >= 0 && time < 1e10 && fabs(latitude) <= M_PI / 2 && fabs(longitude) <= M_PI && fabs(height) < 1e5;
}

/* ---- the table ---- */

static const struct row rows[] = {
	{MAGIC("\x1f\x8b", 0), .what = "a gzip file", .hint = "unpack it: gunzip -k @"},
	{MAGIC("PK\3\4", 0), .what = "a zip archive", .hint = "unpack it: unzip @"},
	{MAGIC("PK\5\6", 0), .what = "an empty zip archive", .hint = "get it again, nothing is in it"},
	{MAGIC("PK\7\10", 0), .what = "a part of a zip archive", .hint = "put its parts together: zip -s 0 @ --out whole.zip"},
	{MAGIC("BZh", 0), .test = is_bzip2, .what = "a bzip2 file", .hint = "unpack it: bunzip2 -k @"},
	{MAGIC("\xfd"
	       "7zXZ\0",
	       0),
	 .what = "an xz file", .hint = "unpack it: unxz -k @"},
	{MAGIC("\x28\xb5\x2f\xfd", 0), .what = "a zstd file", .hint = "unpack it: unzstd @"},
	{MAGIC("7z\xbc\xaf\x27\x1c", 0), .what = "a 7z archive", .hint = "unpack it: 7z x @"},
	{MAGIC("Rar!\x1a\7", 0), .what = "a RAR archive", .hint = "unpack it: unrar x @"},
	{MAGIC("ustar", 257), .test = is_tar, .what = "a tar archive", .hint = "unpack it: tar -xf @"},
	{MAGIC("ASTM-E57", 0), .test = is_binary, .what = "E57 (ASTM E2807)", .hint = PDAL},
	{MAGIC("ply", 0), .test = is_ply, .what = "PLY", .hint = PDAL},
	{MAGIC("", 0), .test = is_pcd, .what = "PCD (Point Cloud Library)", .hint = PDAL},
	{MAGIC("", 0), .test = is_obj, .what = "OBJ (Wavefront)", .hint = PDAL},
	{MAGIC("II*\0", 0), .what = "TIFF, perhaps GeoTIFF", .hint = RASTER},
	{MAGIC("MM\0*", 0), .what = "TIFF, perhaps GeoTIFF", .hint = RASTER},
	{MAGIC("II+\0", 0), .what = "BigTIFF, perhaps GeoTIFF", .hint = RASTER},
	{MAGIC("MM\0+", 0), .what = "BigTIFF, perhaps GeoTIFF", .hint = RASTER},
	{MAGIC("", 0), .test = is_esri_ascii, .what = "an ESRI ASCII grid", .hint = RASTER},
	{MAGIC("GRID1.2", 0), .test = is_binary, .what = "an ESRI binary grid",
	 .hint = "name its folder: gdal2xyz.py -skipnodata FOLDER grid.xyz"},
	{MAGIC("\0\0\x27\x0a\xff\xff", 0), .what = "an ESRI binary grid",
	 .hint = "name its folder: gdal2xyz.py -skipnodata FOLDER grid.xyz"},
	{MAGIC("DSBB", 0), .test = is_binary, .what = "a Surfer grid", .hint = RASTER},
	{MAGIC("DSAA", 0), .test = is_surfer_text, .what = "a Surfer grid", .hint = RASTER},
	{MAGIC("FASTBIN", 0), .test = is_binary, .what = "FBI (TerraScan Fast Binary)", .hint = PDAL},
	{MAGIC("CXYZ", 12), .test = is_terrascan, .what = "TerraScan binary",
	 .hint = "convert it: pdal translate -r readers.terrasolid @ &.laz"},
	{MAGIC("\x89HDF\r\n\x1a\n", 0), .what = "HDF5",
	 .hint = "convert it with pdal's readers.hdf, which has to be told the names of its data sets"},
	{MAGIC("CDF", 0), .test = is_binary, .what = "netCDF", .hint = RASTER},
	{MAGIC("AutoCAD Binary DXF\r\n\x1a\0", 0), .what = "DXF, binary",
	 .hint = "save it as DXF in ASCII, then: ogr2ogr -f CSV -lco GEOMETRY=AS_XYZ &.csv @"},
	{MAGIC("", 0), .test = is_dxf, .what = "DXF", .hint = VECTOR},
	{MAGIC("AC10", 0), .test = is_binary, .what = "DWG",
	 .hint = "save it as DXF in ASCII, then: ogr2ogr -f CSV -lco GEOMETRY=AS_XYZ &.csv &.dxf"},
	{MAGIC("\0\0\x27\x0a", 0), .test = is_shapefile, .what = "a Shapefile", .hint = VECTOR},
	{MAGIC("SQLite format 3\0", 0), .test = is_geopackage, .what = "a GeoPackage", .hint = VECTOR},
	{MAGIC("SQLite format 3\0", 0), .what = "an SQLite database", .hint = VECTOR},
	{MAGIC("LASX", 0), .test = is_lax, .what = "an index of LAStools (LAX)", .hint = "name the LAS or LAZ file beside it"},
	{MAGIC("%PDF-", 0), .what = "a PDF document", .hint = "name a file with points"},
	{MAGIC("version https://git-lfs", 0), .what = "a pointer of Git LFS",
	 .hint = "get the file that it stands for: git lfs pull"},
	{MAGIC("", 0), .test = is_html, .what = "a web page (HTML)",
	 .hint = "perhaps a download that failed: open it, and get the file again"},
	{MAGIC("", 0), .test = is_landxml, .what = "LandXML",
	 .hint = "export its points as LAS or as text with the program that it comes from"},
	{MAGIC("", 0), .test = is_xml, .what = "XML", .hint = VECTOR},
	{MAGIC("", 0), .test = is_json, .what = "JSON, perhaps GeoJSON", .hint = VECTOR},
	/* no signature that is published */
	{MAGIC("", 0), .test = is_sbet, .extensions = ".sbet .out", .what = "SBET, a trajectory",
	 .hint = "it has no points on the ground: name the LAS or LAZ files that were made with it"},
	{MAGIC("", 0), .test = is_binary, .extensions = ".rxp", .what = "RXP (RIEGL)",
	 .hint = "export it as LAS with RiSCAN PRO or RiPROCESS, or convert it with pdal and RIEGL's readers.rxp"},
	{MAGIC("", 0), .test = is_binary, .extensions = ".rdbx .rdb", .what = "RDB (RIEGL)",
	 .hint = "export it as LAS with RiSCAN PRO or RiPROCESS, or convert it with pdal and RIEGL's readers.rdb"},
	{MAGIC("", 0), .test = is_binary, .extensions = ".fls .lsproj", .what = "FLS (FARO)", .hint = VENDOR},
	{MAGIC("", 0), .test = is_binary, .extensions = ".zfs .zfc", .what = "ZFS (Zoller + Froehlich)", .hint = VENDOR},
	{MAGIC("", 0), .test = is_binary, .extensions = ".ptg", .what = "PTG (Leica)", .hint = VENDOR},
	{MAGIC("", 0), .test = is_binary, .extensions = ".rcp .rcs", .what = "ReCap (Autodesk)", .hint = VENDOR},
	{MAGIC("", 0), .test = is_binary, .extensions = ".flt", .what = "an ESRI float grid", .hint = RASTER},
};

static bool fits(const struct row *r, const struct head *h)
{
	return h->n >= (size_t)r->at + r->length && !memcmp(h->at + r->at, r->magic, r->length) &&
	       (!r->extensions || input_has_extension(h->name, r->extensions)) && (!r->test || r->test(h));
}

/* Its name in a command; "FILE" where a shell would want more than the bare name. */
static void plain_name(const char *name, char *ret, size_t size)
{
	const char *base = strrchr(name, '/');

	base = base ? base + 1 : name;
	if (!*base || *base == '-' || strlen(base) >= size ||
	    strspn(base, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-+") != strlen(base))
		base = "FILE";
	snprintf(ret, size, "%s", base);
}

static void add_hint(const char *hint, const char *name, struct err *err)
{
	char plain[100], text[400];
	const char *dot;
	size_t n = 0;

	plain_name(name, plain, sizeof plain);
	dot = strrchr(plain, '.');
	for (; *hint && n < sizeof text - sizeof plain; hint++) {
		if (*hint == '@' || *hint == '&')
			n += (size_t)snprintf(text + n, sizeof text - n, "%.*s",
					      *hint == '&' && dot > plain ? (int)(dot - plain) : (int)sizeof plain, plain);
		else
			text[n++] = *hint;
	}
	text[n] = 0;
	err_add_hint(err, "%s", text);
}

/* "LAS, LAZ, PTX and text" */
static void list_titles(char *ret, size_t size)
{
	size_t n = 0;

	for (size_t i = 0; i < input_n_rows && n < size; i++)
		n += (size_t)snprintf(ret + n, size - n, "%s%s",
				      !n                   ? "" :
				      i + 1 < input_n_rows ? ", " :
							     " and ",
				      input_rows[i].title);
}

int input_foreign_check(struct input *in, size_t n, struct err *err)
{
	const struct head h = {in->buffer, n, in->size, in->name};
	char titles[200];

	for (size_t i = 0; n && i < sizeof rows / sizeof *rows; i++) {
		if (!fits(&rows[i], &h))
			continue;
		list_titles(titles, sizeof titles);
		input_fail(in, err, ERR_INPUT, ERR_NO_OFFSET, NULL, "this is %s; acut reads %s", rows[i].what, titles);
		add_hint(rows[i].hint, in->name, err);
		return -(int)ERR_INPUT;
	}
	return 0;
}
