/*
 * Errors and warnings of a configuration, as many as there are. One error alone is what the start fails with, so that it
 * is told once; of several each is told, and the start fails with their number.
 */
#ifndef CONFIG_TOLD_H
#define CONFIG_TOLD_H

#include <stdbool.h>

#include "err.h"

struct config_told {
	void (*tell)(void *ctx, bool warning, const struct err *);
	void *ctx;
	unsigned errors, warnings;
	struct err first; /* error, not told yet */
};

void config_told_error(struct config_told *, const struct err *);
void config_told_warning(struct config_told *, const struct err *);
/* What the whole fails with: 0 if there were no errors. */
int config_told_end(const struct config_told *, struct err *err);

#endif
