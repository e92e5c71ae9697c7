/* Options of a view as the request that the daemon resolves (protocol.md, "Views"). */
#ifndef CTL_VIEW_H
#define CTL_VIEW_H

#include <stdbool.h>
#include <stdint.h>

struct err;

/* Texts are NULL, and counts are 0, if not given. */
struct ctl_view_options {
	bool ground, surface;
	const char *classes, *not_classes, *returns, *duplicates;
	const char *crop, *bbox, *polygon, *thin, *thin_pick, *breakline_clear, *max_error, *metric, *weight;
#define VIEW_FLAG(field, ...) bool field;
#define VIEW_COUNT(field, ...) uint64_t field;
#define VIEW_HEIGHT(field, ...) const char *field; /* a decimal */
#include "view_option.def"
};

/* The request, to be freed. Reads the files of --crop and --polygon. */
int ctl_view_text(const struct ctl_view_options *, char **ret, struct err *err);
/* The same, and the box of --crop: x1, y1, x2, y2; *ret_cropped: there is one. */
int ctl_view_box(const struct ctl_view_options *, char **ret, bool *ret_cropped, double ret_box[4], struct err *err);
/* The area of --bbox or --polygon alone, as a fetch asks for it, to be freed; NULL: there is none. */
int ctl_view_window(const struct ctl_view_options *, char **ret, struct err *err);

#endif
