/* Files that other programs make from ours: what to write, and what to run on it. */
#include <string.h>
#include <strings.h>

#include "err.h"
#include "format.h"

/* In texts @ stands for the name without its extension, and % for the extension. */
static const struct elsewhere {
	const char *extensions; /* ".a .b" */
	const char *what;
} row[] = {
	{".asc", "write -o @.tif --cell 1m, then run: gdal_translate -of AAIGrid @.tif @%"},
	{".grd", "write -o @.tif --cell 1m, then run: gdal_translate -of GSBG @.tif @%"},
	{".img", "write -o @.tif --cell 1m, then run: gdal_translate -of HFA @.tif @%"},
	{".bil .flt", "write -o @.tif --cell 1m, then run: gdal_translate -of EHdr @.tif @%"},
	{".nc", "write -o @.tif --cell 1m, then run: gdal_translate -of netCDF @.tif @%"},
	{".vrt", "write -o @.tif --cell 1m, then run: gdalbuildvrt @% @.tif"},
	{".jpg .jpeg", "write -o @.png, then run: gdal_translate -of JPEG -b 1 -b 2 -b 3 @.png @%"},
	{".kml", "write -o @.gpkg --interval 1m, contours, then run: ogr2ogr -f KML @% @.gpkg"},
	{".shp .fgb .gml .tab .mif", "write -o @.gpkg --interval 1m, contours, then run: ogr2ogr @% @.gpkg"},
	{".gltf", "write -o @.glb --origin auto, then run: assimp export @.glb @%"},
	{".dae .fbx .x3d", "write -o @.glb --origin auto, then run: assimp export @.glb @%"},
	{".dwg", "write -o @.dxf: CAD programs save it as DWG"},
	{".2dm", "write -o @.ply: QGIS opens it as a mesh layer, as it does 2DM"},
	{".las .laz .e57", "acutctl writes meshes, not points, as in -o @.ply"},
};

/* Copies `text` with the name in place of @ and the extension in place of %; what does not fit is cut. */
static void fill(const char *text, const char *path, const char *dot, char *ret, size_t size)
{
	size_t at = 0;

	for (; *text; text++) {
		const char *from = *text == '@' ? path : *text == '%' ? dot : text;
		size_t n = *text == '@' ? (size_t)(dot - path) : *text == '%' ? strlen(dot) : 1;

		n = n < size - 1 - at ? n : size - 1 - at;
		memcpy(ret + at, from, n);
		at += n;
	}
	ret[at] = 0;
}

bool format_elsewhere(const char *path, struct err *err)
{
	const char *dot = format_extension(path);
	char hint[sizeof(err->hint)];

	for (const struct elsewhere *e = row; dot && e < row + sizeof(row) / sizeof(row[0]); e++)
		if (format_has_extension(e->extensions, dot)) {
			fill(e->what, path, dot, hint, sizeof(hint));
			err_set(err, ERR_USAGE, "acutctl writes no %s files", dot);
			err_add_file(err, path);
			err_add_hint(err, "%s", hint);
			return true;
		}
	return false;
}
