/* Shared by the files that read PTX: heads of scans (input_ptx_head.c), cells (input_ptx.c). */
#ifndef INPUT_PTX_H
#define INPUT_PTX_H

#include "input_text.h"

/* Numbers of cells and shifts are nanometres, of a matrix 1e-15. */
enum { INPUT_PTX_PLACES = 9, INPUT_PTX_MATRIX_PLACES = 15 };

/* The next line that is not blank; ret->at NULL at the end. A line that the end of the file may have cut has *ret_cut. */
int input_ptx_line(struct input *in, struct input_line *ret, bool *ret_cut, struct err *err);
/* The next number of a line behind blanks or a separator. */
enum input_number_state input_ptx_number(const char **at, const char *end, int places, int64_t most, int64_t *ret);
/* The head of the next scan into as.ptx. *ret_more false: there is none, the file ends where one ends. *ret_cut: it ends
 * within the head. */
int input_ptx_head(struct input *in, bool *ret_more, bool *ret_cut, struct err *err);

#endif
