/* Files of places. Internal. */
#ifndef PLACES_H
#define PLACES_H

#include "breaklines.h"

enum { PLACES_BUFFERED = 1024 };

struct places {
	int dirfd, fd; /* fd -1: there is no place yet, and no file */
	char name[64], temp[72];
	uint64_t written;
	bool published;
	size_t n;
	uint8_t buffer[PLACES_BUFFERED * GRID_PLACE_BYTES];
};

int places_begin(struct places *, int dirfd, const char *name, struct err *err);
int places_add(struct places *, enum breakline_event, int32_t x, int32_t y, int32_t lower, int32_t upper, struct err *err);
int places_finish(struct places *, struct err *err); /* without places there is no file */
void places_end(struct places *);
int places_read(int dirfd, const char *name, uint64_t count, uint64_t first, size_t most, struct breaklines_place *ret,
		size_t *ret_n, struct err *err);

#endif
