/* The parts of a page that a folder with levels of detail has, too. */
#ifndef FORMAT_HTML_H
#define FORMAT_HTML_H

#include "format.h"

/* What is known of a mesh before its triangles: JSON without its end, to be freed. `name` has fewer than 300 bytes. */
int format_html_facts(const char *name, const struct acut_mesh_head *, const struct format_options *, char **ret,
		      struct err *err);
/* With their end: digests, `more` ("" or members, each with its comma), counts of vertices and triangles. */
int format_html_put_facts(struct outfile *, const char *facts, const char *more, const struct acut_mesh_tail *,
			  const uint64_t counts[2], struct err *err);
/* The page up to its vertices. `sources`: what scripts it may run beside its own ("", "'self' "). */
int format_html_title(struct outfile *, const char *sources, const char *name, struct err *err);

#endif
