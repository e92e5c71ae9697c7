/* Shared by the files that read PTX: heads of scans (input_ptx_head.c), cells (input_ptx.c). */
#ifndef INPUT_PTX_H
#define INPUT_PTX_H

#include "input_text_parts.h"

/* State of a PTX file; see input_ptx.c. */
struct input_ptx {
	struct input_xyz text;        /* first: the reader of lines keeps its place there */
	int64_t turn[3][3];           /* of the scan's matrix, in 1e-15: a row for x, y, z of a cell */
	int64_t shift[3];             /* in nanometres */
	uint64_t scans;               /* begun so far */
	uint64_t scan_line;           /* where the last one begins */
	uint64_t columns, rows, left; /* of that scan; cells still to come */
	uint64_t cells, empty;        /* read so far; those without a return */
	bool begun;                   /* the line with the columns of the next scan was read: */
	uint64_t begun_columns, begun_line;
	bool probing;
};

static inline struct input_ptx *input_ptx_of(const struct input *in)
{
	return input_state(in);
}

/* Numbers of cells and shifts are nanometres, of a matrix 1e-15. */
enum { INPUT_PTX_PLACES = 9, INPUT_PTX_MATRIX_PLACES = 15 };

/* The next line that is not blank; ret->at NULL at the end. A line that the end of the file may have cut has *ret_cut. */
int input_ptx_line(struct input *in, struct input_line *ret, bool *ret_cut, struct err *err);
/* The next number of a line behind blanks or a separator. */
enum input_number_state input_ptx_number(const char **at, const char *end, int places, int64_t most, int64_t *ret);
/* The head of the next scan into the state. *ret_more false: there is none, the file ends where one ends. *ret_cut: it ends
 * within the head. */
int input_ptx_head(struct input *in, bool *ret_more, bool *ret_cut, struct err *err);

#endif
