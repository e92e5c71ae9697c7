/* Well-known binary: ISO (SQL/MM 3, codes 1001 and so on for Z) and the flags of EWKB. */
#ifndef LINES_WKB_H
#define LINES_WKB_H

#include "lines_priv.h"

/* The geometry into the feature that was begun. */
int lines_wkb(struct lines *, const uint8_t *bytes, size_t n, struct err *err);

#endif
