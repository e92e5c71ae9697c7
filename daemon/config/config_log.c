/* Errors and warnings of a configuration into the log: see config_log.h. */
#include "config_log.h"

#include <stddef.h>

#include "err.h"
#include "log.h"

void config_log(void *ctx, bool warning, const struct err *err)
{
	if (warning)
		log_err(LOG_LEVEL_WARNING, "configuration", err);
	else
		log_event_err(LOG_EVENT_CONFIG_REFUSED, NULL, "configuration", err);
}
