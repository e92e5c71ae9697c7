/* Outputs from options: what can be known without a daemon is checked, and a run of writers is opened. */
#include <string.h>
#include <unistd.h>

#include "ctl_fetch.h"

bool ctl_fetch_to_standard(struct ctl_fetch_options *opt)
{
	static const char *const name[] = {"/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "-"};
	bool any = false;

	for (unsigned i = 0; i < opt->out.n; i++)
		for (unsigned k = 0; k < 4; k++)
			if (!strcmp(opt->out.text[i], name[k])) {
				opt->out.text[i] = "-";
				any = true;
			}
	return any;
}

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

/* The given options that a format takes. */
static int options_of(const struct ctl_fetch_options *a, unsigned takes, struct format_options *opt, struct err *err)
{
	*opt = (struct format_options){.no_clobber = a->no_clobber, .canonical = a->canonical && (takes & FORMAT_CANONICAL)};
	if (takes & FORMAT_SIZED && a->width > FORMAT_WIDTH_MAX)
		return err_set(err, ERR_USAGE, "--width is more than %d", FORMAT_WIDTH_MAX);
	if (takes & FORMAT_SIZED)
		opt->width = (uint32_t)a->width;
	if (takes & FORMAT_COLORED && a->color)
		format_parse_color(a->color, &opt->color);
	if (takes & FORMAT_Z_UNIT && a->z_unit)
		opt->z_unit = format_unit_of_word(a->z_unit, strlen(a->z_unit));
	return takes & FORMAT_ORIGIN && a->origin ? parse_origin(a->origin, opt, err) : 0;
}

/* An option must be of use for one of the outputs. */
static int check_used(const struct ctl_fetch_options *a, unsigned takes, const char *format, struct err *err)
{
	unsigned given = (a->canonical ? FORMAT_CANONICAL : 0) | (a->origin ? FORMAT_ORIGIN : 0) |
			 (a->z_unit ? FORMAT_Z_UNIT : 0) | (a->width ? FORMAT_SIZED : 0) | (a->color ? FORMAT_COLORED : 0);
	unsigned useless = given & ~takes;

	if (useless & (FORMAT_SIZED | FORMAT_COLORED))
		return err_set(err, ERR_USAGE, "--%s is for pictures, and no OUT is one",
			       format_option_name(useless & (FORMAT_SIZED | FORMAT_COLORED)));
	return useless ? err_set(err, ERR_USAGE, "--%s has no meaning for %s", format_option_name(useless), format) : 0;
}

static const struct format *format_of(const struct ctl_fetch_options *a, const char *path, struct err *err)
{
	const char *tile = a->format ? a->format : "ply";
	const struct format *by_path = strcmp(path, "-") ? format_by_path(path) : NULL, *f = by_path;

	if (a->tile || (a->format && (a->out.n == 1 || !by_path))) {
		f = format_find(a->tile ? tile : a->format);
		if (!f) {
			err_set(err, ERR_USAGE, "there is no output format %s", a->tile ? tile : a->format);
			err_add_hint(err, "acutctl formats lists them");
		}
	} else if (!f && !strcmp(path, "-")) {
		f = format_find("ply"); /* the default, as for tiles */
	} else if (!f) {
		err_set(err, ERR_USAGE, "the name does not give a format");
		err_add_file(err, path);
		err_add_hint(err, "give --format, as in --format ply; acutctl formats lists them");
	}
	return f;
}

static int add_output(const struct ctl_fetch_options *a, const char *path, struct outputs *run, unsigned *takes,
		      const char **ret_format, struct err *err)
{
	const struct format *f = path ? format_of(a, path, err) : format_find(a->format);
	struct format_options opt;
	int r = f ? options_of(a, f->takes, &opt, err) : -(int)err->code;

	if (r)
		return r;
	if (path && !a->tile && f->kind != FORMAT_NOTHING && !strcmp(path, "-") && isatty(STDOUT_FILENO)) {
		err_set(err, ERR_USAGE, "standard output is a terminal");
		return err_add_hint(err, "give a file, as in -o mesh.%s, or a pipe", f->name);
	}
	*takes |= f->takes;
	*ret_format = f->name;
	return outputs_add(run, path, f, &opt, err);
}

bool ctl_fetch_nothing(const struct ctl_fetch_options *a)
{
	const struct format *f = a->format ? format_find(a->format) : NULL;

	return !a->out.n && f && f->kind == FORMAT_NOTHING;
}

static int check_outputs(const struct ctl_fetch_options *a, struct err *err)
{
	unsigned standard = 0;

	if (!a->out.n && !ctl_fetch_nothing(a)) {
		err_set(err, ERR_USAGE, "no output given");
		return err_add_hint(err, "name the output with -o OUT, as in -o mesh.ply");
	}
	for (unsigned i = 0; i < a->out.n; i++) {
		standard += !strcmp(a->out.text[i], "-");
		for (unsigned j = 0; j < i; j++)
			if (!strcmp(a->out.text[i], a->out.text[j]))
				return err_set(err, ERR_USAGE, "the output %s is given twice", a->out.text[i]);
	}
	if (a->tile && a->out.n != 1) {
		err_set(err, ERR_USAGE,
			a->out.n ? "tiles go into one folder, and --output is given %u times" : "tiles need a folder", a->out.n);
		return err_add_hint(err, "name the folder with one -o DIR/, as in -o tiles/");
	}
	return standard > 1 ? err_set(err, ERR_USAGE, "standard output is given twice") : 0;
}

/* A number with an optional unit. */
static int parse_length(const char *text, struct outputs_options *opt, struct err *err)
{
	char number[DECIMAL_TEXT_SIZE];
	size_t n = strlen(text), m = n;

	while (m && ((text[m - 1] | 32) >= 'a' && (text[m - 1] | 32) <= 'z'))
		m--;
	opt->has_max_edge = true;
	opt->max_edge_unit = m < n ? format_unit_of_word(text + m, n - m) : NULL;
	snprintf(number, sizeof(number), "%.*s", (int)m, text);
	if (m < sizeof(number) && (m == n || opt->max_edge_unit) && decimal_parse(number, &opt->max_edge) &&
	    opt->max_edge.mantissa > 0)
		return 0;
	err_set(err, ERR_USAGE, "--max-edge is not a length above zero: \"%s\"", text);
	return err_add_hint(err, "give a number in the units of the files, or one with m, ft or ftUS, as in 30m");
}

static int parse_tile(struct session *session, const char *tile, struct outputs_options *opt, struct err *err)
{
	opt->tiled = true;
	opt->interrupted = session_interrupted;
	opt->ctx = session;
	if (decimal_parse(tile, &opt->tile) && opt->tile.mantissa > 0)
		return 0;
	err_set(err, ERR_USAGE, "--tile is not a number above zero: \"%s\"", tile);
	return err_add_hint(err, "give the side of a tile in the units of the dataset, as in --tile 500");
}

int ctl_fetch_open(struct session *session, const struct ctl_fetch_options *a, struct outputs **ret, struct err *err)
{
	struct outputs_options opt = {.edges = !a->since, .changes = a->since > 0};
	struct outputs *run = NULL;
	const char *format = NULL;
	unsigned takes = 0;
	int r = check_outputs(a, err);

	if (!r && a->max_edge)
		r = parse_length(a->max_edge, &opt, err);
	if (!r && a->since && a->window)
		r = err_set(err, ERR_USAGE, "--changed-since is of a whole mesh, not of --%s", a->window);
	if (!r && a->tile && a->since) {
		r = err_set(err, ERR_USAGE, "--tile has no meaning with --changed-since: a tile needs all of its triangles");
		err_add_hint(err, "fetch the tiles of the whole mesh: those that have not changed are the same bytes");
	}
	if (!r && a->tile)
		r = parse_tile(session, a->tile, &opt, err);
	if (!r)
		r = outputs_new(&opt, &run, err);
	if (!r && ctl_fetch_nothing(a))
		r = add_output(a, NULL, run, &takes, &format, err);
	for (unsigned i = 0; i < a->out.n && !r; i++)
		r = add_output(a, a->out.text[i], run, &takes, &format, err);
	if (!r)
		r = check_used(a, takes, format, err);
	if (r)
		outputs_free(run);
	else
		*ret = run;
	return r;
}
