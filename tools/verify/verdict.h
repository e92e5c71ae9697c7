/* What acut-verify was asked, and what it found. */
#ifndef VERDICT_H
#define VERDICT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "check_file.h"
#include "check_lines.h"
#include "digest.h"
#include "verify.h"
#include "view.h"

struct verdict {
	const char *name;
	bool json, quiet;
	struct view view;
	const char *view_text; /* NULL: use the options */
	bool options;          /* an option was given */
	struct check_mesh mesh;
	struct check_points points;
	bool with_points;
	const char *weight_text; /* of --weight; NULL */
	int64_t *weight;         /* of vertices, if the view has weights */
	struct check_power power;
	const char *bound_text;    /* of --max-error; NULL: that of the view */
	bool partial;              /* the vertices are some of the points: the view has a bound, or a number */
	bool bounded;              /* `bound` counts */
	int64_t bound;             /* lattice numbers of z */
	struct check_error errors; /* if `partial` and with_points */
	const char **line_file;    /* as many as arguments at most */
	uint8_t *line_kind;
	size_t line_files;
	struct check_lines_options line_options;
	struct check_lines lines;
	struct check_fault line_fault;
	struct verify_report report;
	struct digest digest, vertex_digest;
	const char *fault; /* NULL: no fault */
	char text[256];
	double seconds;
};

/* What options say in lengths, when the mesh was read (verdict_view.c): the view of --view; the radii of --weight; the bound of
 * --max-error, or that of the view, so after it. */
int verdict_view(struct verdict *, struct err *err);
int verdict_weights(struct verdict *, char **points, struct err *err);
int verdict_bound(struct verdict *, struct err *err);
/* One word of a request, as a view. 1: it is none. */
int verdict_resolve(const struct verdict *, const char *word, const char *value, struct view *ret, struct err *err);

/* On standard output. */
void verdict_print_json(const struct verdict *);
void verdict_print_text(const struct verdict *);

#endif
