/* How a file was read, as manifests keep it, and whether it would be read so again. Any thread. */
#ifndef AGREE_READING_H
#define AGREE_READING_H

#include <stdbool.h>
#include <stddef.h>

#include "agree.h"

enum {
	AGREE_COLUMNS_MOST = 100, /* letters that are recorded */
	AGREE_SYSTEM_MOST = 400,  /* characters of a system's text that are recorded */
};

struct agree_system {
	char text[AGREE_SYSTEM_MOST + 1], unit_xy[CRS_UNIT_SIZE], unit_z[CRS_UNIT_SIZE];
};
/* The text of format.md in parts. */
struct agree_reading {
	char format[16], columns[AGREE_COLUMNS_MOST + 1];
	bool decimal_comma;
	bool has_system; /* that of the file is not that of the dataset */
	struct agree_system system;
};

bool agree_reading_is_text(const char *format); /* columns and decimal commas matter */
/* crs NULL: the system of the file is that of the dataset. */
void agree_reading_text(const char *format, const char *columns, bool decimal_comma, const struct crs_info *crs, char *ret,
			size_t size);
void agree_reading_parse(const char *text, struct agree_reading *ret); /* ignores words of other versions */

void agree_system_set(struct agree_system *, const char *text, const char *unit_xy, const char *unit_z);
/* A file of which `said` is assumed (overrides: in place of what it says) would have the system that it has. */
bool agree_system_holds(const struct agree_system *said, bool overrides, const struct agree_system *has);

#endif
