/* The table beside a Shapefile: one field of its rows, and which rows are deleted. */
#ifndef LINES_DBF_H
#define LINES_DBF_H

#include "lines_priv.h"

struct lines_dbf {
	int fd; /* -1: there is no table */
	uint64_t rows;
	uint32_t head, row_size, field_at, field_size; /* field_size 0: none is wanted */
};

/* Takes the descriptor (-1: there is none). The field is that of --kind-field. */
int lines_dbf_open(struct lines *, int fd, struct lines_dbf *ret, struct err *err);
/* Row `i` from 0: *ret_deleted, and the kind of the feature. */
int lines_dbf_row(struct lines *, struct lines_dbf *, uint64_t i, bool *ret_deleted, struct err *err);

#endif
