/* The formats, one row each. acutctl has the names, extensions and helps of its own: tests/input/formats.py compares them. */
#include "input_las.h"
#include "input_table.h"
#include "input_text.h"

enum { LAS, PTX, PTS, XYZ, ROWS };

static const struct input_format_row texts[ROWS] = {
	[LAS] = {"las", "LAS, LAZ, COPC", "ASPRS LAS 1.0 to 1.5 and LAZ, point formats 0 to 10", ".las .laz"},
	[PTX] = {"ptx", "PTX", "scans of a scanner that stands (Leica, FARO): cells by column and row, each scan with its matrix",
		 ".ptx"},
	[PTS] = {"pts", "PTS", "text with the number of points in its first line, then as xyz", ".pts"},
	[XYZ] = {"xyz", "text of x y z", "text, one point a line: x y z or --columns; space, tab, comma or semicolon",
		 ".xyz .txt .csv .asc"},
};

const struct input_row input_rows[ROWS] = {
	[LAS] = {&texts[LAS], &input_las_reader},
	[PTX] = {&texts[PTX], &input_ptx_reader},
	[PTS] = {&texts[PTS], &input_pts_reader},
	[XYZ] = {&texts[XYZ], &input_xyz_reader},
};

const size_t input_n_rows = ROWS;

const struct input_format_row *input_formats(size_t *ret_n)
{
	*ret_n = ROWS;
	return texts;
}
