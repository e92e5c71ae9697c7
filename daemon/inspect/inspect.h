/* The header and the records of one file, for `acutctl info`. Calls are for the loop; workers read the file. */
#ifndef INSPECT_H
#define INSPECT_H

#include "core.h"
#include "pipe.h"

struct inspect_input {
	int fd;                              /* taken over in any case */
	const char *name, *format, *columns; /* format, columns "": by the content */
	bool decimal_comma;
};
/* Reads the header. Answers once; `why` NULL: `info` has it, and `wkt` what input_wkt gives. */
typedef void inspect_header_fn(void *token, const struct err *why, const char *name, const struct input_info *info,
			       const char *wkt);
void inspect_header(struct core *, const struct inspect_input *, const struct peer *, inspect_header_fn *answer, void *token);

enum { INSPECT_DIFFERENCES = 8 };
struct inspect_result {
	const char *name, *wkt;
	struct input_info info;
	struct lattice lattice;
	struct pipe_inspected in;
	bool has_place;                            /* the following is known */
	char no_place[256];                        /* otherwise the reason */
	double area, perimeter;                    /* of the hull, by geodesics: square metres, metres */
	double south, west, north, east;           /* of the hull, degrees */
	char mgrs[16];                             /* of the centre of the box, a square of 1 km; "": outside of its range */
	char difference[INSPECT_DIFFERENCES][192]; /* between header and records, sentences */
	unsigned ndifferences;
};
/* Reads all of the file. Answers once; `why` NULL: there is a result. */
typedef void inspect_result_fn(void *token, const struct err *why, const struct inspect_result *);
void inspect_file(struct core *, const struct inspect_input *, const struct peer *, inspect_result_fn *answer, void *token);

#endif
