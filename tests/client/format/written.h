/* Writes a mesh as a file of one format, in a temporary folder of the test program. */
#ifndef WRITTEN_H
#define WRITTEN_H

#include "meshes.h"
#include "outputs.h"

struct CMUnitTest;

extern const struct meshes_spec written_grid;

/* Writes the mesh as the format `name`. The options and the report may be NULL, except `opt`. */
int written_as(const char *name, const struct meshes *, const struct format_options *opt, const struct outputs_options *ropt,
	       struct outputs_report *report, struct err *err);
const char *written_path(void); /* of the file that was written last */
/* Runs the tests with the folder; returns the status of the program. */
int written_run(const struct CMUnitTest *tests, size_t n);

#endif
