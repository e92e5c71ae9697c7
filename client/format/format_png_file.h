/* A PNG file, written row by row. */
#ifndef FORMAT_PNG_FILE_H
#define FORMAT_PNG_FILE_H

#include <stdbool.h>
#include <stdint.h>

struct err;
struct outfile;

/* A zeroed one is empty. */
struct format_png_file {
	struct png_struct_def *png;
	struct png_info_def *info;
	struct outfile *out;
	struct err *err; /* of the running call, for libpng's callbacks */
};
/* Frees what is left of an earlier file. A row has 8 bits a sample: red, green, blue, alpha; without `color` grey, alpha. */
int format_png_begin(struct format_png_file *, struct outfile *, uint64_t width, uint64_t height, bool color, struct err *err);
int format_png_row(struct format_png_file *, const uint8_t *row, struct err *err);
int format_png_end(struct format_png_file *, struct err *err); /* all rows are there */
void format_png_done(struct format_png_file *);                /* also after a failure */

#endif
