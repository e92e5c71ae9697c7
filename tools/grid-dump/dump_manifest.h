/* The lists of a manifest, for acut-grid-dump. */
#ifndef DUMP_MANIFEST_H
#define DUMP_MANIFEST_H

struct grid_manifest;

void dump_manifest_lists(const struct grid_manifest *); /* on standard output, one line each */
/* The fault if the generations do not agree with the sources, or NULL. */
const char *dump_manifest_fault(const struct grid_manifest *);

#endif
