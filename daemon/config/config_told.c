/* Errors and warnings of a configuration: see config_told.h. */
#include "config_told.h"

void config_told_error(struct config_told *t, const struct err *err)
{
	if (++t->errors == 1) {
		t->first = *err;
		return;
	}
	if (t->errors == 2)
		t->tell(t->ctx, false, &t->first);
	t->tell(t->ctx, false, err);
}

void config_told_warning(struct config_told *t, const struct err *err)
{
	t->warnings++;
	t->tell(t->ctx, true, err);
}

int config_told_end(const struct config_told *t, struct err *err)
{
	if (!t->errors)
		return 0;
	if (t->errors == 1) {
		if (!err->code)
			*err = t->first;
		return -(int)err->code;
	}
	err_set(err, ERR_USAGE, "the configuration has %u errors", t->errors);
	return err_add_hint(err, "acutd --check-config tells them without a start");
}
