/* Verbs of dataset that have a file of their own, and what those that print a dataset share. */
#ifndef CTL_DATASET_H
#define CTL_DATASET_H

struct acut_dataset;
struct console;
struct program;

void ctl_dataset_json(const struct console *, const struct acut_dataset *);

int ctl_dataset_create(struct program *);
int ctl_dataset_discard(struct program *);
int ctl_dataset_log(struct program *);
int ctl_dataset_prune(struct program *);
int ctl_dataset_revert(struct program *);
int ctl_dataset_export(struct program *);
int ctl_dataset_import(struct program *);

#endif
