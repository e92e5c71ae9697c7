/* Differences from an older mesh, region by region: OUT.changes.geojson (outputs_change.c). */
#ifndef OUTPUTS_CHANGE_H
#define OUTPUTS_CHANGE_H

#include "outputs_priv.h"

struct outputs_change;
/* Beside `out`, which must be a regular file; NULL: only counted. */
int outputs_change_new(const struct outfile *out, const char *path, const struct format_options *, struct outputs_change **ret,
		       struct err *err);
int outputs_change_head(struct outputs_change *, const struct acut_mesh_head *, struct err *err);
int outputs_change_base(struct outputs_change *, const struct acut_mesh_base *, struct err *err);
int outputs_change_gone(struct outputs_change *, const struct acut_mesh_region *, struct err *err);
int outputs_change_block(struct outputs_change *, const struct format_block *, struct err *err);
int outputs_change_tail(struct outputs_change *, struct err *err);
int outputs_change_publish(struct outputs_change *, const struct outputs_origin *, uint64_t *bytes, struct err *err);
const struct outputs_changes_counts *outputs_change_counts(const struct outputs_change *);
struct outputs_change *outputs_change_free(struct outputs_change *);

#endif
