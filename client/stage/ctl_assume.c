/*
 * --assume-crs and --assume-units: assumed for inputs that do not declare them. --override-crs and --override-units: used
 * instead of the declared ones. Here the words become texts for the daemon, which knows coordinate systems; a WKT may be in a
 * file. Also the warning of what is still unknown.
 */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "ctl_stage.h"
#include "io.h"

enum { WKT_MAX = 32768 };

static int read_wkt(const char *path, char **ret, struct err *err)
{
	char *text;
	size_t n;
	int fd, r = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);

	if (r)
		return r;
	text = malloc(WKT_MAX + 1);
	r = text ? io_read_some(fd, text, WKT_MAX + 1, 0, path, &n, err) :
		   err_set(err, ERR_NOMEM, "no memory for a coordinate system");
	io_close(fd);
	if (!r && n > WKT_MAX) {
		err_set(err, ERR_USAGE, "it is no coordinate system: longer than %d bytes", WKT_MAX);
		r = err_add_file(err, path);
	}
	if (!r && (n == 0 || memchr(text, 0, n))) {
		err_set(err, ERR_USAGE, "it is no coordinate system: %s", n ? "not a text" : "empty");
		r = err_add_file(err, path);
	}
	if (r) {
		free(text);
		return r;
	}
	text[n] = 0;
	*ret = text;
	return 0;
}

int ctl_stage_crs(const char *word, const char *option, char **ret, struct err *err)
{
	struct stat st;

	if (!*word)
		return err_set(err, ERR_USAGE, "%s is empty", option);
	/* "EPSG:n", a number and a complete WKT are not names of files */
	if (strncasecmp(word, "EPSG:", 5) && !strchr(word, '[') && word[strspn(word, "0123456789")] && !stat(word, &st) &&
	    S_ISREG(st.st_mode))
		return read_wkt(word, ret, err);
	*ret = strdup(word);
	return *ret ? 0 : err_set(err, ERR_NOMEM, "no memory for a coordinate system");
}

static bool is_unit(const char *text)
{
	static const char *const units[] = {"m", "ft", "ftUS"};

	for (size_t i = 0; i < sizeof(units) / sizeof(*units); i++)
		if (!strcasecmp(text, units[i]))
			return true;
	return false;
}

static int read_units(const char *units, const char *option, struct ctl_assume *ret, struct err *err)
{
	const char *comma = strchr(units, ',');
	size_t n = comma ? (size_t)(comma - units) : strlen(units);
	bool good;

	if (n < sizeof(ret->unit_xy))
		memcpy(ret->unit_xy, units, n);
	snprintf(ret->unit_z, sizeof(ret->unit_z), "%s", comma ? comma + 1 : "");
	good = n < sizeof(ret->unit_xy) && (!comma || strlen(comma + 1) < sizeof(ret->unit_z)) &&
	       (is_unit(ret->unit_xy) || (!n && comma)) && (!comma || is_unit(ret->unit_z));
	if (good)
		return 0;
	err_set(err, ERR_USAGE, "%s is not UNIT[,UNIT] of m, ft and ftUS: \"%s\"", option, units);
	return err_add_hint(err, "the first is of x and y, the second of z; ,ft is z alone");
}

int ctl_assume_read(const struct ctl_stage_options *a, struct ctl_assume *ret, struct err *err)
{
	bool over = a->override_crs || a->override_units;
	const char *crs = over ? a->override_crs : a->assume_crs, *units = over ? a->override_units : a->assume_units;

	*ret = (struct ctl_assume){.overrides = over};
	if (over && (a->assume_crs || a->assume_units)) {
		err_set(err, ERR_USAGE,
			"%s is for inputs without a system, %s replaces the system of all: both at once contradict",
			a->assume_crs ? "--assume-crs" : "--assume-units",
			a->override_crs ? "--override-crs" : "--override-units");
		return err_add_hint(err, "an override holds for all inputs, also for those without a system");
	}
	if (units && read_units(units, over ? "--override-units" : "--assume-units", ret, err))
		return -(int)err->code;
	return crs ? ctl_stage_crs(crs, over ? "--override-crs" : "--assume-crs", &ret->crs, err) : 0;
}

void ctl_assume_options(const struct ctl_assume *a, struct acut_push_options *opt)
{
	*(a->overrides ? &opt->override_crs : &opt->assume_crs) = a->crs;
	*(a->overrides ? &opt->override_unit_xy : &opt->assume_unit_xy) = a->unit_xy;
	*(a->overrides ? &opt->override_unit_z : &opt->assume_unit_z) = a->unit_z;
}

void ctl_assume_done(struct ctl_assume *a)
{
	free(a->crs);
	a->crs = NULL;
}

static bool unknown(const char *text)
{
	return !strcmp(text, "unknown");
}

void ctl_assume_see(struct ctl_assume *a, const struct acut_probe *p)
{
	a->no_crs |= unknown(p->crs);
	a->no_unit_xy |= unknown(p->unit_xy);
	a->no_unit_z |= unknown(p->unit_z);
}

void ctl_assume_warn(struct console *c, const struct ctl_assume *a)
{
	const char *what[3];
	unsigned n = 0;

	if (a->no_crs)
		what[n++] = "the coordinate system";
	if (a->no_unit_xy)
		what[n++] = "the unit of x and y";
	if (a->no_unit_z)
		what[n++] = "the unit of z";
	if (!n)
		return;
	console_warn(c, "%s%s%s%s%s %s unknown: a mesh needs no unit, and its outputs note it; %s", what[0],
		     n == 3 ? ", " :
		     n == 2 ? " and " :
			      "",
		     n > 1 ? what[1] : "", n == 3 ? " and " : "", n == 3 ? what[2] : "", n == 1 ? "is" : "are",
		     a->no_crs ? "set them with --assume-crs and --assume-units" : "set it with --assume-units");
}
