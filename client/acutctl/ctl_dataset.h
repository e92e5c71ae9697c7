/* A dataset as JSON, for the two commands that print one. */
#ifndef CTL_DATASET_H
#define CTL_DATASET_H

struct program;
struct acut_dataset;

void ctl_dataset_json(struct program *, const struct acut_dataset *);

int ctl_dataset_create(struct program *, const char *name);
int ctl_dataset_log(struct program *, const char *name);
int ctl_dataset_prune(struct program *, const char *name);
int ctl_dataset_revert(struct program *, const char *name, const char *generation /* NULL: the newest */);
/* ctl_backup.c; name NULL: that of the folder */
int ctl_dataset_export(struct program *, const char *name, const char *dir);
int ctl_dataset_import(struct program *, const char *dir, const char *name);

#endif
