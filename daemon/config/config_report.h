/*
 * Errors and warnings of a configuration, as many as there are. The start fails with a single error, so it is printed once. If
 * there are several, each is emitted, and the start fails with their number.
 */
#ifndef CONFIG_REPORT_H
#define CONFIG_REPORT_H

#include <stdbool.h>

#include "err.h"

struct config_report {
	void (*emit)(void *ctx, bool warning, const struct err *);
	void *ctx;
	unsigned errors, warnings;
	struct err first; /* error; emitted when there is a second one */
};

void config_report_error(struct config_report *, const struct err *);
void config_report_warning(struct config_report *, const struct err *);
/* The error that the start fails with; 0: there is none. */
int config_report_end(const struct config_report *, struct err *err);
/* For `emit`: writes into the log. */
void config_report_log(void *ctx, bool warning, const struct err *);

#endif
