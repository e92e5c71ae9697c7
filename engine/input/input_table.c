/* The formats, one row each. A new format is a new row here and a new file beside this one. */
#include "input_parts.h"

enum { LAS, PTX, PTS, XYZ, ROWS };

static const struct input_format_row texts[ROWS] = {
	[LAS] = {"las", "ASPRS LAS 1.0 to 1.5 and LAZ, point formats 0 to 10", ".las .laz"},
	[PTX] = {"ptx", "scans of a scanner that stands (Leica, FARO): cells by column and row, each scan with its matrix",
		 ".ptx"},
	[PTS] = {"pts", "text with the number of points in its first line, then as xyz", ".pts"},
	[XYZ] = {"xyz", "text, one point a line: x y z or --columns; space, tab, comma or semicolon", ".xyz .txt .csv .asc"},
};

const struct input_row input_rows[ROWS] = {
	[LAS] = {&texts[LAS], input_las_matches, input_las_open, input_las_read, input_las_part, input_laz_close},
	[PTX] = {&texts[PTX], input_ptx_matches, input_ptx_open, input_ptx_read, NULL, NULL},
	[PTS] = {&texts[PTS], input_pts_matches, input_xyz_open, input_xyz_read, NULL, NULL},
	[XYZ] = {&texts[XYZ], input_xyz_matches, input_xyz_open, input_xyz_read, NULL, NULL},
};

const size_t input_n_rows = ROWS;

const struct input_format_row *input_formats(size_t *ret_n)
{
	*ret_n = ROWS;
	return texts;
}
