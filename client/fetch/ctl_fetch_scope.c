/*
 * Options of outputs: those behind an -o are of that output, those before the first of all.
 *
 * The options that there were before outputs had their own (--canonical, --format, --origin, --z-unit, --width, --color) are of
 * all outputs wherever they stand if they are given once: today's scripts keep their meaning.
 */
#include <string.h>

#include "ctl_fetch.h"

struct scoped_option {
	unsigned bit; /* FORMAT_CANONICAL ...; 0: --format */
	size_t at, size;
	bool of_all; /* given once, it is of all outputs */
};

#define ROW(bit, field, of_all)                                                                                         \
	{                                                                                                               \
		bit, offsetof(struct ctl_fetch_output, field), sizeof(((struct ctl_fetch_output *)NULL)->field), of_all \
	}
static const struct scoped_option rows[] = {
	ROW(0, format, true),
	ROW(FORMAT_CANONICAL, canonical, true),
	ROW(0, sidecar, false), /* of any format */
	ROW(FORMAT_ORIGIN, origin, true),
	ROW(FORMAT_Z_UNIT, z_unit, true),
	ROW(FORMAT_SIZED, width, true),
	ROW(FORMAT_COLORED, color, true),
	ROW(FORMAT_POLYFACE, polyface, false),
	ROW(FORMAT_CELL, cell, false),
	ROW(FORMAT_RASTERED, raster, false),
	ROW(FORMAT_INTERVAL, interval, false),
	ROW(FORMAT_BASE, base, false),
	ROW(FORMAT_INDEX, index, false),
	ROW(FORMAT_SIMPLIFY, simplify, false),
};

static char *value_of(struct ctl_fetch_output *o, const struct scoped_option *row)
{
	return (char *)o + row->at;
}

static bool is_given(const struct ctl_fetch_output *o, const struct scoped_option *row)
{
	static const char none[sizeof(uint64_t)];

	return memcmp((const char *)o + row->at, none, row->size) != 0;
}

unsigned ctl_fetch_count(const struct ctl_fetch_options *opt)
{
	unsigned n = 0;

	while (n < CTL_FETCH_OUTPUTS && opt->output[n + 1].path)
		n++;
	return n;
}

const char *const *ctl_fetch_paths(const struct ctl_fetch_options *opt, const char *ret[CTL_FETCH_OUTPUTS + 1])
{
	unsigned n = ctl_fetch_count(opt);

	for (unsigned i = 0; i < n; i++)
		ret[i] = opt->output[i + 1].path;
	ret[n] = NULL;
	return ret;
}

bool ctl_fetch_is_standard(const char *path)
{
	static const char *const name[] = {"/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "-"};

	for (unsigned k = 0; k < 4; k++)
		if (!strcmp(path, name[k]))
			return true;
	return false;
}

bool ctl_fetch_to_standard(struct ctl_fetch_options *opt)
{
	bool any = false;

	for (unsigned i = 1; i <= ctl_fetch_count(opt); i++)
		if (ctl_fetch_is_standard(opt->output[i].path)) {
			opt->output[i].path = "-";
			any = true;
		}
	return any;
}

bool ctl_mesh_simplifies(const struct ctl_fetch_options *opt)
{
	for (unsigned i = 0; i <= ctl_fetch_count(opt); i++)
		if (opt->output[i].simplify)
			return true;
	return false;
}

const char *ctl_fetch_z_unit(const struct ctl_fetch_options *opt)
{
	unsigned n = ctl_fetch_count(opt);
	struct ctl_fetch_output first = ctl_fetch_output(opt, n ? 1 : 0);

	for (unsigned i = 2; i <= n; i++) {
		struct ctl_fetch_output o = ctl_fetch_output(opt, i);

		if (!o.z_unit || !first.z_unit || strcmp(o.z_unit, first.z_unit))
			return NULL;
	}
	return first.z_unit;
}

/* The one output that `row` is given for, if it is then of all; 0: none. */
static unsigned given_once(const struct ctl_fetch_options *opt, const struct scoped_option *row)
{
	unsigned only = 0;

	if (!row->of_all || is_given(&opt->output[0], row))
		return 0;
	for (unsigned i = 1; i <= ctl_fetch_count(opt); i++)
		if (is_given(&opt->output[i], row)) {
			if (only)
				return 0;
			only = i;
		}
	return only;
}

struct ctl_fetch_output ctl_fetch_output(const struct ctl_fetch_options *opt, unsigned i)
{
	struct ctl_fetch_output ret = opt->output[i];

	for (const struct scoped_option *row = rows; row < rows + sizeof(rows) / sizeof(*rows); row++) {
		unsigned from = is_given(&ret, row) ? i : given_once(opt, row);

		memcpy(value_of(&ret, row), (const char *)&opt->output[from] + row->at, row->size);
	}
	return ret;
}

bool ctl_fetch_own_format(const struct ctl_fetch_options *opt, unsigned i)
{
	return is_given(&opt->output[i], &rows[0]) && (ctl_fetch_count(opt) == 1 || !given_once(opt, &rows[0]));
}

static int refuse(unsigned bit, const char *format, struct err *err)
{
	if (!format)
		return err_set(err, ERR_USAGE, "--%s is for pictures, and no OUT is one", format_option_name(bit));
	err_set(err, ERR_USAGE, "--%s has no meaning for %s", format_option_name(bit), format);
	return bit == FORMAT_INTERVAL ? err_add_hint(err, "contours are gpkg, geojson or dxf-contours") : -ERR_USAGE;
}

int ctl_fetch_check_used(const struct ctl_fetch_options *opt, const struct format *const format[CTL_FETCH_OUTPUTS + 1],
			 struct err *err)
{
	unsigned n = ctl_fetch_count(opt), last = n ? n : 0, takes = format[last]->takes;

	for (unsigned i = 1; i <= n; i++)
		takes |= format[i]->takes;
	for (const struct scoped_option *row = rows; row < rows + sizeof(rows) / sizeof(*rows); row++) {
		bool of_all = is_given(&opt->output[0], row) || given_once(opt, row);

		if (of_all && row->bit & ~takes)
			return refuse(row->bit, row->bit & (FORMAT_SIZED | FORMAT_COLORED) ? NULL : format[last]->name, err);
		for (unsigned i = 1; i <= n && !given_once(opt, row); i++)
			if (is_given(&opt->output[i], row) && row->bit & ~format[i]->takes) {
				refuse(row->bit, format[i]->name, err);
				return err_add_file(err, opt->output[i].path);
			}
	}
	return 0;
}
