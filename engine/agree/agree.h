/* Coordinate systems and units of inputs: what a person says of them, and whether they agree. Any thread. */
#ifndef AGREE_H
#define AGREE_H

#include <stdbool.h>
#include <string.h>

#include "crs.h"

struct err;

static inline bool agree_known(const char *text)
{
	return *text && strcmp(text, "unknown");
}

/* The texts of a system, its unit of x and y, and that of z; "": not said. `fields` are named in errors. -ERR_USAGE. */
int agree_read(const char *const words[3], const char *const fields[3], struct crs_info *ret, struct err *err);
/* Completes what an input says. -ERR_INPUT: it says something else. planar: its plane is taken as it is. */
int agree_assume(const struct crs_info *assumed, bool planar, const char *name, struct crs_info *info, struct err *err);
/* Replaces what an input says; `overridden` gets that, if it said something. */
enum { AGREE_OVERRIDDEN = 512 };
int agree_override(const struct crs_info *replacement, bool planar, const char *name, struct crs_info *info,
		   char overridden[AGREE_OVERRIDDEN], struct err *err);

struct agree_difference {
	const char *what, *mine, *theirs;
	const char *option; /* that would define what is unknown; NULL: none */
};
bool agree_texts_differ(const struct crs_info *, const char *crs, const char *unit_xy, const char *unit_z,
			struct agree_difference *ret);
bool agree_definitions_differ(const struct crs_info *, const struct crs_info *);
/* -ERR_INPUT: `name` and `other` differ. */
int agree_refuse(const struct agree_difference *, const char *name, const char *other, struct err *err);
int agree_refuse_pair(const char *a, const struct crs_info *ca, const char *b, const struct crs_info *cb, struct err *err);

#endif
