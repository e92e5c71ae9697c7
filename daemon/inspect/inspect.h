/* What is in the header and in the records of one file, for `acutctl info`. Loop; workers read. */
#ifndef INSPECT_H
#define INSPECT_H

#include "core.h"
#include "pipe.h"

/* What the header of a file says. `fd` becomes the service's in any case. */
void inspect_header(struct core *, int fd, const char *name, const char *format, const char *columns, bool decimal_comma,
		    const struct peer *,
		    void (*probed)(void *token, const struct err *why, const char *name, const struct input_info *), void *token);

enum { INSPECT_DIFFERENCES = 8 };
struct inspect_result {
	const char *name;
	struct input_info info;
	struct lattice lattice;
	struct pipe_inspected in;
	bool has_place;                            /* on the earth: */
	char no_place[256];                        /* why not */
	double area, perimeter;                    /* of the hull, by geodesics: square metres, metres */
	double south, west, north, east;           /* of the hull, degrees */
	char mgrs[16];                             /* of the middle of the box, a square of 1 km; "": none there */
	char difference[INSPECT_DIFFERENCES][192]; /* between header and records, in words */
	unsigned ndifferences;
};
typedef void inspect_answer_fn(void *token, const struct err *why, const struct inspect_result *);
/* Reads all of the file. `fd` becomes the service's in any case. */
void inspect_file(struct core *, int fd, const char *name, const char *format, const char *columns, bool decimal_comma,
		  const struct peer *, inspect_answer_fn *answer, void *token);

#endif
