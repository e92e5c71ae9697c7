/* Shared by the files of this room; nobody else includes it. */
#ifndef CRS_PARTS_H
#define CRS_PARTS_H

#include "crs.h"

extern const char crs_unknown[]; /* "unknown" */

/* Name of the length unit of `factor` metres, or of the angle unit of `factor` radians. */
const char *crs_unit_of_length(double factor);
const char *crs_unit_of_angle(double factor);
/* Name of the unit with this EPSG code (9001 metre, 9002 foot, 9003 US survey foot, 9102 degree, ...). */
const char *crs_unit_of_epsg(unsigned code);
/* Length unit of a projected or vertical system that EPSG defines, for the few that need no table. */
const char *crs_unit_of_system(unsigned epsg);

void crs_set_unit(char unit[CRS_UNIT_SIZE], const char *name);
/* Append to info->text, leaving out what is not printable ASCII; "unknown" and "" are overwritten. */
void crs_text_append(struct crs_info *info, const char *separator, const char *text, size_t size);

#endif
