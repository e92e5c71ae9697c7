/* Rules that concern several keys of a profile. */
#include <stdarg.h>
#include <stdio.h>

#include "err.h"
#include "profile_table.h"

enum { CLASS_MASS_STORAGE = 8 };

__attribute__((format(printf, 3, 4))) static int wrong(struct err *err, const char *key, const char *fmt, ...)
{
	char text[300];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	err_set(err, ERR_INPUT, "%s", text);
	return err_add_place(err, ERR_NO_OFFSET, key);
}

bool profile_matches_some(const struct profile *p)
{
	return p->vendor >= 0 || p->product >= 0 || p->device_class >= 0 || p->interface_class >= 0 || *p->serial;
}

static int check_match(const struct profile *p, struct err *err)
{
	if (p->product >= 0 && p->vendor < 0)
		return wrong(err, "product", "a product number means nothing without its vendor");
	if (p->device_class == CLASS_MASS_STORAGE || p->interface_class == CLASS_MASS_STORAGE)
		return wrong(err, "interface-class", "class 8 is mass storage, which acut-scan leaves to the system");
	return 0;
}

static int check_usb(const struct profile *p, struct err *err)
{
	if (p->transfer_size % 512)
		return wrong(err, "transfer-size",
			     "transfer-size = %u: a multiple of 512 is wanted, or the last packet of a transfer does not fit in",
			     p->transfer_size);
	if ((p->starts || p->stops) && !p->endpoint_out)
		return wrong(err, "endpoint-out", "commands need an endpoint-out");
	return 0;
}

static int check_framer(const struct profile *p, struct err *err)
{
	if (p->framer == PROFILE_FRAMER_FIXED && !p->fixed_size)
		return wrong(err, "size", "kind = fixed needs the size of a telegram");
	if (p->framer != PROFILE_FRAMER_FIXED && p->fixed_size)
		return wrong(err, "size", "size belongs to kind = fixed");
	if (p->framer == PROFILE_FRAMER_LENGTH && !p->length_size)
		return wrong(err, "length", "kind = length needs the place of the length");
	if (p->framer != PROFILE_FRAMER_LENGTH && (p->length_size || p->length_add))
		return wrong(err, "length", "length and length-add belong to kind = length");
	if (p->sync_size && p->framer != PROFILE_FRAMER_FIXED && p->framer != PROFILE_FRAMER_LENGTH)
		return wrong(err, "sync", "sync belongs to kind = fixed and kind = length");
	if (p->starts_torn && p->framer != PROFILE_FRAMER_LINE)
		return wrong(err, "starts-torn", "starts-torn belongs to kind = line");
	if (p->sync_size > p->fixed_size && p->framer == PROFILE_FRAMER_FIXED)
		return wrong(err, "sync", "sync is longer than the telegram");
	if (p->fixed_size > p->telegram_max)
		return wrong(err, "size", "size is more than telegram-max");
	if (p->framer == PROFILE_FRAMER_LENGTH && p->length_offset < p->sync_size)
		return wrong(err, "length", "the length stands in the sync");
	if (p->framer == PROFILE_FRAMER_LENGTH && p->length_offset + p->length_size > p->telegram_max)
		return wrong(err, "length", "the length stands behind telegram-max");
	return 0;
}

int profile_check(const struct profile *p, struct err *err)
{
	int rc;

	if ((rc = check_match(p, err)) || (rc = check_usb(p, err)) || (rc = check_framer(p, err)))
		return rc;
	if (p->range_max && p->range_max < p->range_min)
		return wrong(err, "range-max", "range-max = %g is less than range-min = %g", p->range_max, p->range_min);
	if (p->ranges.range_most < p->ranges.range_least)
		return wrong(err, "range-most", "range-most is less than range-least");
	return 0;
}
