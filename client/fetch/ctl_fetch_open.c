/* Outputs from options: what can be known without a daemon is checked, and a run of writers is opened. */
#include <string.h>
#include <unistd.h>

#include "ctl_fetch.h"
#include "parse.h"

static int parse_origin(const char *text, struct format_options *opt, struct err *err)
{
	char part[3 * DECIMAL_TEXT_SIZE], *at = part, *rest;

	if (!strcmp(text, "auto")) {
		opt->origin_auto = true;
		return 0;
	}
	opt->has_origin = strlen(text) < sizeof(part);
	snprintf(part, sizeof(part), "%s", text);
	for (int i = 0; i < 3 && opt->has_origin; i++) {
		rest = strchr(at, ',');
		if (!rest != (i == 2))
			opt->has_origin = false;
		if (rest)
			*rest++ = 0;
		if (opt->has_origin && !decimal_parse(at, &opt->origin[i]))
			opt->has_origin = false;
		at = rest;
	}
	if (!opt->has_origin)
		return err_set(err, ERR_USAGE, "--origin is not X,Y,Z or auto: \"%s\"", text);
	return 0;
}

/* A number with an optional unit. */
static bool number_of(const char *text, struct decimal *ret, const char **ret_unit)
{
	char number[DECIMAL_TEXT_SIZE];
	size_t n = strlen(text), m = n;

	while (m && ((text[m - 1] | 32) >= 'a' && (text[m - 1] | 32) <= 'z'))
		m--;
	*ret_unit = m < n ? format_unit_of_word(text + m, n - m) : NULL;
	snprintf(number, sizeof(number), "%.*s", (int)m, text);
	return m < sizeof(number) && (m == n || *ret_unit) && decimal_parse(number, ret);
}

static bool length_of(const char *text, struct decimal *ret, const char **ret_unit)
{
	return number_of(text, ret, ret_unit) && ret->mantissa > 0;
}

static int parse_cell(const char *text, struct format_options *opt, struct err *err)
{
	if (length_of(text, &opt->cell, &opt->cell_unit))
		return 0;
	err_set(err, ERR_USAGE, "--cell is not a length above zero: \"%s\"", text);
	return err_add_hint(err, "give a number in the units of the files, or one with m, ft or ftUS, as in 1m");
}

static int parse_simplify(const struct ctl_fetch_output *o, struct format_options *opt, struct err *err)
{
	if (!o->simplify || length_of(o->simplify, &opt->simplify, &opt->simplify_unit))
		return 0;
	err_set(err, ERR_USAGE, "--simplify is not a length above zero: \"%s\"", o->simplify);
	return err_add_hint(err, "give a number in the units of the files, or one with m, ft or ftUS, as in 0.1m");
}

static int parse_levels(const struct ctl_fetch_output *o, struct format_options *opt, struct err *err)
{
	uint64_t index = 0;

	if (o->interval && !length_of(o->interval, &opt->interval, &opt->interval_unit)) {
		err_set(err, ERR_USAGE, "--interval is not a length above zero: \"%s\"", o->interval);
		return err_add_hint(err, "give a number in the units of the heights, or one with m, ft or ftUS, as in 1m");
	}
	opt->has_base = o->base != NULL;
	if (o->base && !number_of(o->base, &opt->base, &opt->base_unit)) {
		err_set(err, ERR_USAGE, "--base is not a height: \"%s\"", o->base);
		return err_add_hint(err, "give a number in the units of the heights, or one with m, ft or ftUS, as in 0.5m");
	}
	opt->has_index = o->index != NULL;
	if (o->index && (!parse_u64(o->index, &index) || index > UINT32_MAX))
		return err_set(err, ERR_USAGE, "--index is not a number: \"%s\"", o->index);
	opt->index = (uint32_t)index;
	return 0;
}

/* The given options that a format takes. */
static int options_of(const struct ctl_fetch_output *o, unsigned takes, struct format_options *opt, struct err *err)
{
	opt->sidecar = o->sidecar;
	opt->has_raster = o->raster && (takes & FORMAT_RASTERED);
	opt->canonical = o->canonical && (takes & FORMAT_CANONICAL);
	opt->polyface = o->polyface && (takes & FORMAT_POLYFACE);
	if (takes & FORMAT_SIZED && o->width > FORMAT_WIDTH_MAX)
		return err_set(err, ERR_USAGE, "--width is more than %d", FORMAT_WIDTH_MAX);
	if (takes & FORMAT_SIZED)
		opt->width = (uint32_t)o->width;
	if (takes & FORMAT_COLORED && o->color)
		format_parse_color(o->color, &opt->color, &opt->lines);
	if (takes & FORMAT_Z_UNIT && o->z_unit)
		opt->z_unit = format_unit_of_word(o->z_unit, strlen(o->z_unit));
	if (takes & FORMAT_RASTERED && o->raster && !format_parse_raster(o->raster, &opt->raster))
		return err_set(err, ERR_USAGE, "--raster is not elevation, slope or hillshade: \"%s\"", o->raster);
	if (takes & FORMAT_CELL && o->cell && parse_cell(o->cell, opt, err))
		return -err->code;
	if (takes & FORMAT_INTERVAL && parse_levels(o, opt, err))
		return -err->code;
	if (takes & FORMAT_SIMPLIFY && parse_simplify(o, opt, err))
		return -err->code;
	return takes & FORMAT_ORIGIN && o->origin ? parse_origin(o->origin, opt, err) : 0;
}

const struct format *ctl_fetch_format(const struct ctl_fetch_options *a, unsigned i, struct err *err)
{
	const struct ctl_fetch_output output = ctl_fetch_output(a, i), *o = &output;
	const char *folder = o->format ? o->format : a->levels ? "html" : "ply"; /* of the files in it */
	const struct format *by_path = o->path && strcmp(o->path, "-") ? format_by_path(o->path) : NULL, *f = by_path;

	if (a->tile || a->levels || !o->path || ctl_fetch_own_format(a, i) ||
	    (o->format && (ctl_fetch_count(a) == 1 || !by_path))) {
		f = format_find(a->tile || a->levels ? folder : o->format);
		if (!f) {
			err_set(err, ERR_USAGE, "there is no output format %s", o->format);
			err_add_hint(err, "acutctl formats lists them");
		}
	} else if (!f && !strcmp(o->path, "-")) {
		f = format_find("ply"); /* the default, as for tiles */
	} else if (!f && !format_elsewhere(o->path, err)) {
		err_set(err, ERR_USAGE, "the name does not give a format");
		err_add_file(err, o->path);
		err_add_hint(err, "give --format, as in --format ply; acutctl formats lists them");
	} else if (o->interval && f == format_find("dxf")) {
		f = format_find("dxf-contours");
	}
	return f;
}

static int add_output(const struct outputs_options *run_opt, const struct ctl_fetch_options *a, unsigned i, struct outputs *run,
		      const struct format *f, unsigned rasters, struct err *err)
{
	struct ctl_fetch_output o = ctl_fetch_output(a, i);
	struct format_options opt = {
		.no_clobber = a->no_clobber, .rasters = rasters, .interrupted = run_opt->interrupted, .ctx = run_opt->ctx};
	int r = options_of(&o, f->takes, &opt, err);

	if (r)
		return r;
	if (o.path && !a->tile && !a->levels && f->kind != FORMAT_NOTHING && !strcmp(o.path, "-") && isatty(STDOUT_FILENO)) {
		err_set(err, ERR_USAGE, "standard output is a terminal");
		return err_add_hint(err, "give a file, as in -o mesh.%s, or a pipe", f->name);
	}
	return outputs_add(run, o.path, f, &opt, err);
}

bool ctl_fetch_nothing(const struct ctl_fetch_options *a)
{
	const char *name = a->output[0].format;
	const struct format *f = name ? format_find(name) : NULL;

	return !ctl_fetch_count(a) && f && f->kind == FORMAT_NOTHING;
}

static int check_outputs(const struct ctl_fetch_options *a, struct err *err)
{
	unsigned standard = 0, n = ctl_fetch_count(a);

	if (!n && !ctl_fetch_nothing(a)) {
		err_set(err, ERR_USAGE, "no output given");
		return err_add_hint(err, "name the output with -o OUT, as in -o mesh.ply");
	}
	for (unsigned i = 1; i <= n; i++) {
		standard += !strcmp(a->output[i].path, "-");
		for (unsigned j = 1; j < i; j++)
			if (!strcmp(a->output[i].path, a->output[j].path))
				return err_set(err, ERR_USAGE, "the output %s is given twice", a->output[i].path);
	}
	if ((a->tile || a->levels) && n != 1) {
		err_set(err, ERR_USAGE, n ? "tiles go into one folder, and --output is given %u times" : "tiles need a folder",
			n);
		return err_add_hint(err, "name the folder with one -o DIR/, as in -o %s/", a->tile ? "tiles" : "survey");
	}
	if (a->tile && a->levels)
		return err_set(err, ERR_USAGE, "--levels has no meaning with --tile: its tiles are squares of its own");
	return standard > 1 ? err_set(err, ERR_USAGE, "standard output is given twice") : 0;
}

static int parse_length(const char *option, const char *text, struct outputs_length *ret, struct err *err)
{
	ret->given = true;
	if (length_of(text, &ret->value, &ret->unit))
		return 0;
	err_set(err, ERR_USAGE, "--%s is not a length above zero: \"%s\"", option, text);
	return err_add_hint(err, "give a number in the units of the files, or one with m, ft or ftUS, as in 30m");
}

static int parse_tile(const char *tile, struct outputs_options *opt, struct err *err)
{
	opt->tiled = true;
	if (decimal_parse(tile, &opt->tile) && opt->tile.mantissa > 0)
		return 0;
	err_set(err, ERR_USAGE, "--tile is not a number above zero: \"%s\"", tile);
	return err_add_hint(err, "give the side of a tile in the units of the dataset, as in --tile 500");
}

int ctl_fetch_open(struct session *session, const struct ctl_fetch_options *a, struct outputs **ret, struct err *err)
{
	const struct outputs_options opt = {.interrupted = session_interrupted, .ctx = session};

	return ctl_fetch_make(a, &opt, ret, err);
}

int ctl_fetch_make(const struct ctl_fetch_options *a, const struct outputs_options *given, struct outputs **ret, struct err *err)
{
	struct outputs_options opt = *given;
	struct outputs *run = NULL;
	const struct format *format[CTL_FETCH_OUTPUTS + 1] = {NULL};
	unsigned n = ctl_fetch_count(a), rasters = 0;
	int r = check_outputs(a, err);

	if (!r && a->max_edge)
		r = parse_length("max-edge", a->max_edge, &opt.max_edge, err);
	if (!r && a->trim_hull)
		r = parse_length("trim-hull", a->trim_hull, &opt.trim_hull, err);
	if (!r && a->trim_hull && (a->since || a->window)) {
		r = err_set(err, ERR_USAGE, "--trim-hull needs a whole mesh, not %s%s", a->since ? "changes" : "the window of --",
			    a->since ? "" : a->window);
		err_add_hint(err, "--max-edge, --mask and --erase leave out triangles wherever they are");
	}
	if (!r && a->since && a->window)
		r = err_set(err, ERR_USAGE, "--changed-since is of a whole mesh, not of --%s", a->window);
	if (!r && a->tile && a->since) {
		r = err_set(err, ERR_USAGE, "--tile has no meaning with --changed-since: a tile needs all of its triangles");
		err_add_hint(err, "fetch the tiles of the whole mesh: those that have not changed are the same bytes");
	}
	if (!r && a->levels && a->since) {
		r = err_set(err, ERR_USAGE, "--levels has no meaning with --changed-since: a page shows a whole mesh");
		err_add_hint(err, "fetch the page of the whole mesh");
	}
	opt.edges = !a->since;
	opt.changes = a->since > 0;
	opt.levels = a->levels;
	if (!r && a->tile)
		r = parse_tile(a->tile, &opt, err);
	for (unsigned i = n > 0; i <= n && !r; i++) {
		format[i] = ctl_fetch_format(a, i, err);
		r = format[i] ? 0 : -(int)err->code;
		rasters += format[i] && (format[i]->kind == FORMAT_RASTER ||
					 (format[i]->kind == FORMAT_PICTURE && ctl_fetch_output(a, i).cell));
	}
	if (!r)
		r = ctl_fetch_check_used(a, format, err);
	if (!r)
		r = outputs_new(&opt, &run, err);
	for (int k = 0; k < OUTPUTS_CUTS; k++)
		for (unsigned i = 0; i < a->cut[k].n && !r; i++)
			r = outputs_cut(run, (enum outputs_cut)k, a->cut[k].text[i], err);
	for (unsigned i = n > 0; i <= n && !r; i++)
		r = add_output(&opt, a, i, run, format[i], rasters, err);
	if (r)
		outputs_free(run);
	else
		*ret = run;
	return r;
}
