/* A mesh as a file of a format, for the tests of what is in the file. */
#ifndef READBACK_H
#define READBACK_H

#include "err.h"
#include "meshes.h"
#include "outputs.h"

/* Writes it; 0, or what failed. `name` is that of the file in the folder of the test. */
int readback_write(const char *format, const char *name, const struct meshes *, const struct format_options *, struct err *);
int readback_write_with(const char *format, const char *name, const struct meshes *, const struct format_options *,
			const struct outputs_options *, struct err *);
/* What the file then has, and a zero, to be freed. */
char *readback_text(const char *format, const char *name, const struct meshes *, const struct format_options *, size_t *ret_size);
/* The bytes that the same run sends through a pipe; likewise. */
char *readback_piped(const char *format, const struct meshes *, const struct format_options *, size_t *ret_size);
/* They are these. */
void readback_same_piped(const char *format, const struct meshes *, const struct format_options *, const char *text, size_t size);

/* What a writer says of one more block when it goes on with what `saved` counts. */
int readback_late(const char *format, const uint8_t saved[FORMAT_SAVED], const struct meshes *, const struct format_options *,
		  struct err *);

/* All vertices and triangles in the order of the stream. */
struct readback_mesh {
	int32_t (*vertex)[3];
	uint64_t (*triangle)[3];
	uint64_t nvertex, ntriangle;
};
struct readback_mesh readback_flat(const struct meshes *);
void readback_flat_done(struct readback_mesh *);
/* A decimal without its point: "499930.00" is 49993000. Ends the test if `decimals` are not behind it. */
int64_t readback_number(const char **at, int decimals);

int readback_begin(void **state);
int readback_end(void **state);

/* 1,617 squares in blocks; 89,401 in one, whose faces are more than a buffer in every format. */
extern const struct meshes_spec readback_small, readback_large;

#endif
