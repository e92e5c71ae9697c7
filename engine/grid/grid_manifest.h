/* What the files about manifests share. Internal. */
#ifndef GRID_MANIFEST_H
#define GRID_MANIFEST_H

#include "grid.h"

/* What is wrong with a manifest, or NULL; *ret_nomem: nothing, but memory is missing. */
const char *grid_manifest_fault(const struct grid_manifest *, bool *ret_nomem);
/* The generations of a manifest that does not list them: those in which a source came or went. False: no memory. */
bool grid_manifest_derive(struct grid_manifest *);

#endif
