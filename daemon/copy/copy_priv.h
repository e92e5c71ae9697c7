/* Shared by the files of this room. */
#ifndef COPY_PRIV_H
#define COPY_PRIV_H

#include "copy.h"
#include "dataset.h"

struct copies {
	struct core *core;
	struct datasets *datasets;
	struct backup *backups; /* open backups and exports */
	uint64_t last_backup, last_import;
};

#endif
