/* What differs from an older mesh, region by region: OUT.changes.geojson (format_change.c). */
#ifndef FORMAT_CHANGE_H
#define FORMAT_CHANGE_H

#include "format_priv.h"

struct format_change;
/* Beside `out`, which must be a regular file; NULL: only counted. */
int format_change_new(const struct format_output *out, const char *path, const struct format_options *,
		      struct format_change **ret, struct err *err);
int format_change_head(struct format_change *, const struct acut_mesh_head *, struct err *err);
int format_change_base(struct format_change *, const struct acut_mesh_base *, struct err *err);
int format_change_gone(struct format_change *, const struct acut_mesh_region *, struct err *err);
int format_change_block(struct format_change *, const struct format_block *, struct err *err);
int format_change_tail(struct format_change *, struct err *err);
void format_change_about(struct format_change *, uint64_t job, const char *dataset, uint64_t generation);
int format_change_publish(struct format_change *, uint64_t *bytes, struct err *err);
const struct format_changes *format_change_counts(const struct format_change *);
struct format_change *format_change_free(struct format_change *);

#endif
