/* What the files of this room share. Internal. */
#ifndef GRID_MANIFEST_PRIV_H
#define GRID_MANIFEST_PRIV_H

#include "grid_manifest.h"

/* NULL, or the rule that the manifest breaks. *ret_nomem: there was no memory to check them all. */
const char *grid_manifest_check(const struct grid_manifest *, bool *ret_nomem);
/* Derives the generations of a manifest that does not list them: those that added or removed a source. False: no memory. */
bool grid_manifest_derive(struct grid_manifest *);

#endif
