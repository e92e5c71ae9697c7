/* Errors and warnings of a configuration: see config_report.h. */
#include "config_report.h"

#include <stddef.h>

#include "log.h"

void config_report_error(struct config_report *t, const struct err *err)
{
	if (++t->errors == 1) {
		t->first = *err;
		return;
	}
	if (t->errors == 2)
		t->emit(t->ctx, false, &t->first);
	t->emit(t->ctx, false, err);
}

void config_report_warning(struct config_report *t, const struct err *err)
{
	t->warnings++;
	t->emit(t->ctx, true, err);
}

int config_report_end(const struct config_report *t, struct err *err)
{
	if (!t->errors)
		return 0;
	if (t->errors == 1) {
		if (!err->code)
			*err = t->first;
		return -(int)err->code;
	}
	err_set(err, ERR_USAGE, "the configuration has %u errors", t->errors);
	return err_add_hint(err, "acutd --check-config lists them without a start");
}

void config_report_log(void *ctx, bool warning, const struct err *err)
{
	if (warning)
		log_err(LOG_LEVEL_WARNING, "configuration", err);
	else
		log_event_err(LOG_EVENT_CONFIG_REFUSED, NULL, "configuration", err);
}
