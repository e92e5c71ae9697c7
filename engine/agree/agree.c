/* Do the coordinate systems of two inputs agree? (agree.h) */
#include "agree.h"

#include <string.h>

#include "err.h"

static bool differ(const char *what, const char *mine, const char *theirs, const char *option, struct agree_difference *ret)
{
	if (!agree_known(mine))
		mine = "unknown";
	if (!agree_known(theirs))
		theirs = "unknown";
	*ret = (struct agree_difference){what, mine, theirs, option};
	return strcmp(mine, theirs) != 0;
}

int agree_refuse(const struct agree_difference *d, const char *name, const char *other, struct err *err)
{
	err_set(err, ERR_INPUT, "%s is %.100s, but that of %.200s is %.100s", d->what, d->mine, other, d->theirs);
	if (!d->option)
		err_add_hint(err, "they have one name and different definitions; convert one of them first");
	else if (agree_known(d->mine) && agree_known(d->theirs))
		err_add_hint(err,
			     "a dataset has one coordinate system: convert one of them, or use two datasets; where what a file "
			     "says is wrong, --override-crs and --override-units say what holds");
	else
		err_add_hint(err, "say what it is where no record says so, with %s", d->option);
	return err_add_file(err, name);
}

/* The first unit of --assume-units is of x and y alone. */
static const char *assume_z(const char *mine, const char *theirs)
{
	static const char *const options[][2] = {{"metre", "--assume-units ,m which is of z alone"},
						 {"foot", "--assume-units ,ft which is of z alone"},
						 {"us-survey-foot", "--assume-units ,ftUS which is of z alone"}};
	const char *known = agree_known(mine) ? mine : theirs;

	for (size_t i = 0; known && i < sizeof options / sizeof *options; i++)
		if (!strcmp(known, options[i][0]))
			return options[i][1];
	return "--assume-units";
}

bool agree_texts_differ(const struct crs_info *a, const char *crs, const char *unit_xy, const char *unit_z,
			struct agree_difference *ret)
{
	return differ("its coordinate system", a->text, crs, "--assume-crs", ret) ||
	       differ("the unit of its x and y", a->unit_xy, unit_xy, "--assume-units", ret) ||
	       differ("the unit of its z", a->unit_z, unit_z, assume_z(a->unit_z, unit_z), ret);
}

bool agree_definitions_differ(const struct crs_info *a, const struct crs_info *b)
{
	return (a->plane != b->plane && a->plane != CRS_PLANE_UNKNOWN && b->plane != CRS_PLANE_UNKNOWN) ||
	       (a->system.method != CRS_METHOD_UNKNOWN && b->system.method != CRS_METHOD_UNKNOWN &&
		!crs_system_same(&a->system, &b->system));
}

/* The error is about the input that sorts first, so it does not depend on the order of the inputs. */
int agree_refuse_pair(const char *a, const struct crs_info *ca, const char *b, const struct crs_info *cb, struct err *err)
{
	static const struct agree_difference definition = {"the definition of its coordinate system", "one thing", "another",
							   NULL};
	struct agree_difference d;

	if (strcmp(a, b) > 0)
		return agree_refuse_pair(b, cb, a, ca, err);
	if (!agree_texts_differ(ca, cb->text, cb->unit_xy, cb->unit_z, &d))
		d = definition;
	return agree_refuse(&d, a, b, err);
}
