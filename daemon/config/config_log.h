/* Errors and warnings of a configuration into the log. */
#ifndef CONFIG_LOG_H
#define CONFIG_LOG_H

#include <stdbool.h>

struct err;

/* config_told.tell of a daemon. */
void config_log(void *ctx, bool warning, const struct err *);

#endif
