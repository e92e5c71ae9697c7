/*
 * The view options as the canonical text that a daemon takes (PROTOCOL.md, "Views"): "view 1", then the words
 * of what differs from taking all but noise and withheld points, in one fixed order. The daemon's own writer
 * and this one are held together by a test over all combinations.
 */
#include <stdlib.h>
#include <string.h>

#include "ctl.h"

/* "2,8" or "2-5,9" into 256 flags; false for rubbish. */
static bool read_classes(const char *text, bool has[256])
{
	for (;;) {
		unsigned long first, last;
		char *end;

		if (*text < '0' || *text > '9')
			return false;
		first = last = strtoul(text, &end, 10);
		if (*end == '-') {
			text = end + 1;
			if (*text < '0' || *text > '9')
				return false;
			last = strtoul(text, &end, 10);
		}
		if (first > last || last > 255)
			return false;
		for (unsigned long c = first; c <= last; c++)
			has[c] = true;
		if (!*end)
			return true;
		if (*end != ',')
			return false;
		text = end + 1;
	}
}

static void write_classes(const bool has[256], char *buf, size_t size)
{
	const char *between = " class=";
	size_t n = strlen(buf);

	for (unsigned c = 0; c < 256; c++) {
		unsigned last = c;

		if (!has[c])
			continue;
		while (last < 255 && has[last + 1])
			last++;
		n += (size_t)snprintf(buf + n, size - n, last > c ? "%s%u-%u" : "%s%u", between, c, last);
		between = ",";
		c = last;
	}
}

/* What contradicts itself is a mistake of whoever typed it. */
static int check(const struct ctl_args *a, struct err *err)
{
	bool last = a->returns && !strcmp(a->returns, "last");
	bool highest = a->duplicates && !strcmp(a->duplicates, "highest");

	if (a->returns && strcmp(a->returns, "all") && strcmp(a->returns, "first") && !last)
		return err_set(err, ERR_USAGE, "--returns is all, first or last, not \"%s\"", a->returns);
	if (a->duplicates && strcmp(a->duplicates, "lowest") && !highest)
		return err_set(err, ERR_USAGE, "--duplicates is lowest or highest, not \"%s\"",
			       a->duplicates);
	if (a->ground && a->surface) {
		err_set(err, ERR_USAGE, "a mesh cannot be of the ground and of the surface at once");
		return err_add_hint(err, "submit two jobs on one dataset: they share its points");
	}
	if (a->surface && last) {
		err_set(err, ERR_USAGE, "the surface is made of first returns, not of last ones");
		return err_add_hint(err, "leave out one of --surface and --returns last");
	}
	if (a->surface && a->duplicates && !highest) {
		err_set(err, ERR_USAGE, "the surface is the highest of several points of one position");
		return err_add_hint(err, "use --returns first --duplicates lowest");
	}
	if (a->ground && highest) {
		err_set(err, ERR_USAGE, "the ground is the lowest of several points of one position");
		return err_add_hint(err, "use --class 2,8 --duplicates highest");
	}
	return 0;
}

int ctl_view_text(const struct ctl_args *a, char buf[CTL_VIEW_SIZE], struct err *err)
{
	bool has[256] = { false };
	bool first = a->surface || (a->returns && !strcmp(a->returns, "first"));
	bool highest = a->surface || (a->duplicates && !strcmp(a->duplicates, "highest"));
	int r = check(a, err);
	size_t n;

	if (r)
		return r;
	strcpy(buf, "view 1");
	if (a->classes) {
		if (!read_classes(a->classes, has)) {
			err_set(err, ERR_USAGE, "\"%s\" is not a list of classes", a->classes);
			return err_add_hint(err, "give numbers from 0 to 255, as in 2,8 or 2-5,9");
		}
		write_classes(has, buf, CTL_VIEW_SIZE);
	}
	n = strlen(buf);
	snprintf(buf + n, CTL_VIEW_SIZE - n, "%s%s%s%s%s", a->ground ? " ground" : "",
		 first ? " returns=first" : a->returns && !strcmp(a->returns, "last") ? " returns=last" : "",
		 a->keep_withheld ? " keep-withheld" : "", a->keep_noise ? " keep-noise" : "",
		 highest ? " duplicates=highest" : "");
	return 0;
}
