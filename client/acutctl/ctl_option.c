/*
 * The table of options, and the reading of the command line by it.
 *
 * A row says the option's name, what follows it, where its value goes and which commands take it. Rows of
 * kind LATER belong to a version to come: they are refused by name, never ignored, since a script that asks
 * for a crop must not get the whole. Options may stand before and after the command; "--" ends them.
 */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "clock.h"
#include "ctl.h"
#include "cli_guess.h"
#include "parse.h"

#define FLAG CTL_FLAG
#define TEXT CTL_TEXT
#define OUTPUT CTL_OUTPUT
#define LATER CTL_LATER

#define AT(field) offsetof(struct ctl_args, field)

static const struct ctl_option table[] = {
	{"output", 'o', "OUT", OUTPUT, 0, CTL_OUT, "write there; \"-\" is standard output; may be repeated"},
	{"format", 0, "FORMAT", TEXT, AT(format), CTL_OUT,
	 "what to write, where the name of OUT does not say it; null: nothing, without OUT"},
	{"max-edge", 0, "LENGTH", TEXT, AT(max_edge), CTL_OUT,
	 "leave out triangles with a longer xy edge: 12 in file units, or 12m, 40ft, 40ftUS"},
	{"z-unit", 0, "m|ft|ftUS", TEXT, AT(z_unit), CTL_OUT, "convert heights to this unit"},
	{"origin", 0, "X,Y,Z|auto", TEXT, AT(origin), CTL_OUT, "subtract this point from all coordinates"},
	{"canonical", 0, NULL, FLAG, AT(canonical), CTL_OUT,
	 "one order of vertices and triangles: the same mesh is the same file"},
	{"no-clobber", 0, NULL, FLAG, AT(no_clobber), CTL_OUT, "an OUT that exists is an error"},
	{"width", 0, "PIXELS", TEXT, AT(width), CTL_OUT, "width of a picture (1600)"},
	{"color", 0, "hillshade|elevation|domain", TEXT, AT(color), CTL_OUT, "what a picture shows (hillshade)"},
	{"resume", 0, NULL, FLAG, AT(resume), CTL_FETCH, "go on with what an earlier fetch has kept in OUT.part"},
	{"tile", 0, "SIZE", TEXT, AT(tile), CTL_OUT,
	 "one file a square of a grid of this side (file units); OUT is their folder"},
	{"trim", 0, "LENGTH", LATER, 0, CTL_OUT, NULL},
	{"mask", 0, "FILE", LATER, 0, CTL_OUT, NULL},
	{"changed-since", 0, "GENERATION", TEXT, AT(since), CTL_FETCH,
	 "only what differs from the mesh of that state; OUT.changes.geojson lists the regions"},

	{"class", 0, "LIST", TEXT, AT(classes), CTL_VIEW, "only points of these classes: 2,8 or 2-5"},
	{"not-class", 0, "LIST", TEXT, AT(not_classes), CTL_VIEW, "no points of these classes"},
	{"returns", 0, "all|first|last", TEXT, AT(returns), CTL_VIEW, "only these returns"},
	{"ground", 0, NULL, FLAG, AT(ground), CTL_VIEW, "classes 2 and 8 and key-points, the lowest of a position"},
	{"surface", 0, NULL, FLAG, AT(surface), CTL_VIEW, "first returns, the highest of a position"},
	{"keep-withheld", 0, NULL, FLAG, AT(keep_withheld), CTL_VIEW, "take withheld points too"},
	{"keep-noise", 0, NULL, FLAG, AT(keep_noise), CTL_VIEW, "take classes 7 and 18 too"},
	{"duplicates", 0, "lowest|highest", TEXT, AT(duplicates), CTL_VIEW, "which of several points of one position (lowest)"},
	{"drop-overlap", 0, NULL, FLAG, AT(drop_overlap), CTL_VIEW,
	 "leave out points of overlapping strips (their flag; class 12 of old formats)"},
	{"zmin", 0, "Z", TEXT, AT(zmin), CTL_VIEW, "only points at this height or above (file units)"},
	{"zmax", 0, "Z", TEXT, AT(zmax), CTL_VIEW, "only points at this height or below"},
	{"crop", 0, "X1,Y1,X2,Y2|FILE", TEXT, AT(crop), CTL_VIEW,
	 "only points inside a box or the polygons of a GeoJSON or WKT file"},
	{"bbox", 0, "X1,Y1,X2,Y2", TEXT, AT(bbox), CTL_VIEW | CTL_FETCH,
	 "only those triangles of the whole mesh that meet this box"},
	{"polygon", 0, "FILE", TEXT, AT(polygon), CTL_VIEW | CTL_FETCH, "likewise, the polygons of a GeoJSON or WKT file"},
	{"every", 0, "N", TEXT, AT(every), CTL_VIEW, "about one position of N, always the same ones"},
	{"thin", 0, "CELL", TEXT, AT(thin), CTL_VIEW, "one point a square cell of this side: file units, or 10m, 30ft, 30ftUS"},
	{"thin-pick", 0, "lowest|highest|median", TEXT, AT(thin_pick), CTL_VIEW, "which point of a cell (lowest)"},
	{"constraints", 0, "FILE", LATER, 0, CTL_VIEW, NULL},

	{"scale", 0, "XY[,Z]", TEXT, AT(scale), CTL_STAGE | CTL_CREATE,
	 "lattice scale of a new dataset, in place of the inputs' finest"},
	{"mode", 0, "MODE", TEXT, AT(mode), CTL_PUSH | CTL_CREATE,
	 "of a dataset that comes to be: 640, o+r (of 640); unless given 666 less the umask"},
	{"crs", 0, "CRS", TEXT, AT(crs), CTL_CREATE, "EPSG:n, a WKT file, or a name that all inputs must be in"},
	{"planar", 0, NULL, FLAG, AT(planar), CTL_STAGE, "triangulate the file's own plane, degrees included"},
	{"accept-truncated", 0, NULL, FLAG, AT(accept_truncated), CTL_STAGE,
	 "take files that have fewer points than their header says, or a header that counts none"},
	{"strict", 0, NULL, FLAG, AT(strict), CTL_STAGE, "one refused input refuses all, and one line without a value its input"},
	{"checksum", 0, NULL, FLAG, AT(checksum), CTL_PUSH,
	 "a file is the same if its content is, whatever its name and times; reads it"},
	{"add", 0, NULL, FLAG, AT(add), CTL_PUSH,
	 "take a file whose name is there with other content, or read otherwise, beside the old one"},
	{"replace", 0, NULL, FLAG, AT(replace), CTL_PUSH,
	 "take a file whose name is there with other content, or read otherwise, in place of the old one"},
	{"replaces", 0, "FILE", TEXT, AT(replaces), CTL_REPLACES,
	 "take the one input in place of this file of the dataset, by path or name"},
	{"settle", 0, "TIME", TEXT, AT(settle), CTL_INGEST,
	 "files are taken that have not changed for so long: 30 (unless said), 30s, 5m"},
	{"manifest", 0, "FILE", TEXT, AT(manifest), CTL_MANIFEST,
	 "all inputs must have the SHA-256 sums that FILE (of sha256sum) lists"},
	{"columns", 0, "LETTERS", TEXT, AT(columns), CTL_INPUT,
	 "columns of texts: x y z (or e n z), c class, r return, n number of returns, _ to skip one"},
	{"decimal-comma", 0, NULL, FLAG, AT(decimal_comma), CTL_INPUT, "numbers of texts have decimal commas: 123,45"},
	{"input-format", 0, "INPUT-FORMAT", TEXT, AT(input_format), CTL_INPUT,
	 "format of the inputs, in place of what their bytes say"},
	{"assume-crs", 0, "CRS", TEXT, AT(assume_crs), CTL_STAGE, "EPSG:n, a WKT file, or a name, for inputs that say nothing"},
	{"assume-units", 0, "XY[,Z]", TEXT, AT(assume_units), CTL_STAGE, "m, ft or ftUS, for inputs that do not say their units"},
	{"override-crs", 0, "CRS", TEXT, AT(override_crs), CTL_STAGE, "likewise, in place of what the inputs say"},
	{"override-units", 0, "XY[,Z]", TEXT, AT(override_units), CTL_STAGE, "units in place of those that the inputs say"},
	{"utm", 0, "ZONE", TEXT, AT(utm), CTL_STAGE,
	 "project degrees to this zone (32N, 5S, UPS-N), not to that of their middle"},
	{"geoid", 0, "GEOID|FILE.pgm", TEXT, AT(geoid), CTL_STAGE, "shift the heights by a kept geoid grid, or by a .pgm file"},
	{"geoid-way", 0, "orthometric|ellipsoidal", TEXT, AT(geoid_way), CTL_STAGE, "what they become (orthometric)"},
	{"header", 0, NULL, FLAG, AT(header), CTL_INFO, "read the headers only"},
	{"all", 0, NULL, FLAG, AT(all), CTL_CACHE, "everything that can be made again"},
	{"origin", 0, NULL, FLAG, AT(origin_of), CTL_CONFIG, "with the file and line that each comes from"},
	{"copy", 0, NULL, FLAG, AT(copy), CTL_COPY, "copy all files, also where a hard link would do"},
	{"textfile", 0, "FILE", TEXT, AT(textfile), CTL_METRICS, "into this file, whole or not at all: for the node exporter"},
	{"name", 0, "NAME", TEXT, AT(name), CTL_GEOID | CTL_PUSH, "under this name, not that of the file; push: of one INPUT"},

	{"wait", 0, NULL, FLAG, AT(wait), CTL_SUBMIT, "wait until the job is over and end with its status"},
	{"new", 0, NULL, FLAG, AT(fresh), CTL_SUBMIT, "a job of its own, even if there is the same already"},
	{"priority", 0, "low|normal|high", TEXT, AT(priority), CTL_JOB,
	 "before or after the jobs of others (high: administrators)"},
	{"at", 0, "GENERATION", TEXT, AT(generation), CTL_GENERATION, "of this state of the dataset, not the newest"},
	{"generation", 0, "GENERATION", TEXT, AT(generation), CTL_GENERATION, "the same as --at"},
	{"files", 0, NULL, FLAG, AT(files), CTL_DATASET, "log: with each file"},
	{"as", 0, "NAME", TEXT, AT(as), CTL_DATASET, "restore: under another name"},
	{"removed", 0, NULL, FLAG, AT(removed), CTL_REMOVED, "those that were removed and can be restored"},
	{"keep", 0, "N", TEXT, AT(keep), CTL_DATASET, "prune: so many of the newest generations stay"},
	{"before", 0, "GENERATION", TEXT, AT(before), CTL_DATASET, "prune: the generations before this one go"},

	{"memory", 0, "SIZE", TEXT, AT(memory), CTL_OWN, "a daemon of this command's own, with this much memory"},
	{"threads", 0, "N", TEXT, AT(threads), CTL_OWN, "the same, with this many threads"},
	{"cache", 0, "FOLDER", TEXT, AT(cache), CTL_OWN, "the same, with this cache"},
	{"disk", 0, "SIZE|N%", TEXT, AT(disk), CTL_OWN, "the same, which may hold so much on the disk"},
	{"keep-free", 0, "SIZE|N%", TEXT, AT(keep_free), CTL_OWN, "the same, which leaves so much of the disk free"},

	{"socket", 0, "PATH", TEXT, AT(socket), CTL_ALL, "where the daemon listens"},
	{"private", 0, NULL, FLAG, AT(own_private), CTL_ALL, "use the user's private daemon, start it if need be"},
	{"timeout", 0, "TIME", TEXT, AT(timeout), CTL_ALL, "end with status 124 after 90, 90s, 5m, 2h"},
	{"json", 0, NULL, FLAG, AT(json), CTL_ALL, "results and errors as JSON"},
	{"quiet", 'q', NULL, FLAG, AT(quiet), CTL_ALL, "say nothing but errors and what was asked for"},
	{"no-progress", 0, NULL, FLAG, AT(no_progress), CTL_ALL, "no progress line"},
	{"help", 'h', NULL, FLAG, AT(help), CTL_ALL, "what the command does"},
};

#define ROWS (sizeof(table) / sizeof(table[0]))

const struct ctl_option *ctl_option_rows(size_t *ret_n)
{
	*ret_n = ROWS;
	return table;
}

/* Its values are words of a list. */
static bool has_choices(const struct ctl_option *o)
{
	return o->value && o->value[0] >= 'a' && strchr(o->value, '|') && !strpbrk(o->value, ",[%");
}

/* Of two options with one name that of the command, NULL if it was not named yet. */
static const struct ctl_option *find_name(const char *name, size_t n, const char *command)
{
	const struct ctl_command *c = command ? ctl_command_find(command) : NULL;
	const struct ctl_option *found = NULL;

	for (size_t i = 0; i < ROWS; i++)
		if (strlen(table[i].name) == n && !memcmp(table[i].name, name, n) &&
		    (!found || (c && (table[i].groups & c->groups))))
			found = &table[i];
	return found;
}

static const struct ctl_option *find_letter(char letter)
{
	for (size_t i = 0; i < ROWS; i++)
		if (table[i].letter == letter)
			return &table[i];
	return NULL;
}

struct reader {
	int argc, at;
	char **argv;
	const char *command; /* NULL: it has not come yet */
	struct ctl_args *args;
	bool seen[ROWS];
};

/* To be written to where it is, like "-", not replaced by a new file of its name. */
static bool is_standard_output(const char *path)
{
	return !strcmp(path, "/dev/stdout") || !strcmp(path, "/dev/fd/1") || !strcmp(path, "/proc/self/fd/1");
}

static int set(struct reader *r, const struct ctl_option *o, const char *value, struct err *err)
{
	char *base = (char *)r->args;

	if (o->kind != OUTPUT && r->seen[o - table] && o->value)
		return err_set(err, ERR_USAGE, "--%s is given twice", o->name);
	r->seen[o - table] = true;
	if (o->kind == FLAG) {
		*(bool *)(base + o->at) = true;
	} else if (o->kind == TEXT) {
		*(const char **)(base + o->at) = value;
	} else {
		if (r->args->nout == CTL_OUTPUTS)
			return err_set(err, ERR_USAGE, "more than %d outputs", CTL_OUTPUTS);
		r->args->out[r->args->nout++] = is_standard_output(value) ? "-" : value;
	}
	return 0;
}

static int no_option(const char *arg, struct err *err)
{
	char name[64], buf[128];
	struct cli_guess g = {.given = name};

	snprintf(name, sizeof(name), "%.*s", (int)strcspn(arg, "="), arg);
	err_set(err, ERR_USAGE, "there is no option %s", name);
	if (!strncmp(arg, "--", 2)) {
		memmove(name, name + 2, strlen(name + 2) + 1);
		for (size_t i = 0; i < ROWS; i++)
			if (table[i].kind != LATER)
				cli_guess_offer(&g, table[i].name);
	}
	return err_add_hint(err, "%sacutctl help COMMAND lists the options of a command", cli_guess_text(&g, "--", buf));
}

/* "a, b or c" of "a|b|c". */
static void choices_text(const char *choices, char *buf, size_t size)
{
	size_t n = 0;

	for (buf[0] = 0; *choices && n < size;) {
		size_t k = strcspn(choices, "|");
		const char *rest = choices + k + (choices[k] == '|');

		n += (size_t)snprintf(buf + n, size - n, "%.*s%s", (int)k, choices,
				      !*rest            ? "" :
				      strchr(rest, '|') ? ", " :
							  " or ");
		choices = rest;
	}
}

/* Of an option whose values are words: one of them. Letters of another size are for whoever reads the value. */
static int check_choice(const struct ctl_option *o, const char *value, struct err *err)
{
	struct cli_guess g = {.given = value};
	char all[128];
	size_t n = strlen(value);

	for (const char *at = o->value; *at; at += strcspn(at, "|"), at += *at == '|')
		if (strcspn(at, "|") == n && !strncasecmp(at, value, n))
			return 0;
	choices_text(o->value, all, sizeof(all));
	err_set(err, ERR_USAGE, "--%s is %s, not \"%s\"", o->name, all, value);
	cli_guess_offer_choices(&g, o->value);
	return g.distance ? err_add_hint(err, "did you mean %s?", g.best) : -ERR_USAGE;
}

/* One argument that starts with a dash; takes the next one as its value if it needs one. */
static int take(struct reader *r, const char *arg, struct err *err)
{
	const struct ctl_option *o;
	const char *value = NULL;

	if (arg[1] == '-') {
		const char *equal = strchr(arg, '=');
		size_t n = equal ? (size_t)(equal - arg - 2) : strlen(arg + 2);
		o = find_name(arg + 2, n, r->command);
		value = equal ? equal + 1 : NULL;
	} else {
		o = find_letter(arg[1]);
		value = o && arg[2] ? arg + 2 : NULL;
	}
	if (!o)
		return no_option(arg, err);
	if (o->kind == LATER)
		return err_set(err, ERR_UNSUPPORTED, "--%s is not in this version of acut", o->name);
	if (!o->value && value)
		return err_set(err, ERR_USAGE, "--%s takes no value", o->name);
	if (o->value && !value) {
		if (r->at + 1 >= r->argc)
			return err_set(err, ERR_USAGE, "--%s needs a value: %s", o->name, o->value);
		value = r->argv[++r->at];
	}
	if (has_choices(o) && check_choice(o, value, err))
		return -ERR_USAGE;
	return set(r, o, value, err);
}

/* Every option that was seen must be one that the command takes. */
static int check_groups(const struct reader *r, const struct ctl_command *c, struct err *err)
{
	for (size_t i = 0; i < ROWS; i++) {
		if (r->seen[i] && !(table[i].groups & c->groups)) {
			err_set(err, ERR_USAGE, "%s takes no --%s", c->name, table[i].name);
			return err_add_hint(err, "acutctl help %s lists its options", c->name);
		}
	}
	return 0;
}

static int check_command(struct ctl *ctl, char *name, struct err *err)
{
	struct ctl_args *a = &ctl->args;

	if (!name) {
		err_set(err, ERR_USAGE, "no command given");
		return err_add_hint(err, "acutctl help lists the commands");
	}
	ctl->command = ctl_command_find(name);
	if (!ctl->command)
		return ctl_command_unknown(name, err);
	if (!ctl->command->run && !a->help)
		return err_set(err, ERR_UNSUPPORTED, "%s is not in this version of acut", name);
	return 0;
}

static int check_words(const struct ctl *ctl, struct err *err)
{
	const struct ctl_command *c = ctl->command;
	unsigned n = ctl->args.nword;

	if (ctl->args.nword >= c->least && ctl->args.nword <= c->most)
		return 0;
	if (n < c->least)
		err_set(err, ERR_USAGE, "%s needs at least %u word%s after it, %u given", c->name, c->least,
			c->least == 1 ? "" : "s", n);
	else
		err_set(err, ERR_USAGE, "%s takes no word \"%s\"", c->name, ctl->args.word[c->most]);
	return err_add_hint(err, "acutctl %s", c->usage);
}

/* A list of words with a blank between two. */
static bool listed(const char *list, const char *word)
{
	size_t n = strlen(word);

	for (const char *at = list; at && (at = strstr(at, word)); at += n)
		if ((at == list || at[-1] == ' ') && (!at[n] || at[n] == ' '))
			return true;
	return false;
}

/* "show, create or log" of the command's verbs. */
static void verbs_text(const struct ctl_command *c, char *buf, size_t size)
{
	size_t n = 0;

	buf[0] = 0;
	for (const struct ctl_verb *v = c->verbs; v->name && n < size; v++)
		n += (size_t)snprintf(buf + n, size - n, "%s%s", v == c->verbs ? "" : v[1].name ? ", " : " or ", v->name);
}

int ctl_verb_unknown(const struct ctl_command *c, const char *word, struct err *err)
{
	struct cli_guess g = {.given = word};
	char buf[128], all[200];

	for (const struct ctl_verb *v = c->verbs; v->name; v++)
		cli_guess_offer(&g, v->name);
	verbs_text(c, all, sizeof(all));
	err_set(err, ERR_USAGE, "there is no command %s %s", c->name, word);
	return err_add_hint(err, "%sacutctl %s %s", cli_guess_text(&g, "", buf), c->name, all);
}

static int check_verb(const struct reader *r, struct ctl *ctl, struct err *err)
{
	const struct ctl_command *c = ctl->command;
	unsigned n = ctl->args.nword;
	char all[200];

	if (!c->verbs)
		return 0;
	verbs_text(c, all, sizeof(all));
	if (!n) {
		err_set(err, ERR_USAGE, "%s needs a word that says what to do", c->name);
		return err_add_hint(err, "acutctl %s %s", c->name, all);
	}
	ctl->verb = ctl_verb_find(c, ctl->args.word[0]);
	if (!ctl->verb)
		return ctl_verb_unknown(c, ctl->args.word[0], err);
	if (n - 1 < ctl->verb->least || n - 1 > ctl->verb->most) {
		if (n - 1 < ctl->verb->least)
			err_set(err, ERR_USAGE, "%s %s needs %u word%s after it, %u given", c->name, ctl->verb->name,
				ctl->verb->least, ctl->verb->least == 1 ? "" : "s", n - 1);
		else
			err_set(err, ERR_USAGE, "%s %s takes no word \"%s\"", c->name, ctl->verb->name,
				ctl->args.word[ctl->verb->most + 1]);
		return err_add_hint(err, "acutctl %s %s", c->name, ctl->verb->usage);
	}
	for (size_t i = 0; i < ROWS; i++) {
		if (r->seen[i] && !(table[i].groups & CTL_ALL) && !listed(ctl->verb->options, table[i].name)) {
			err_set(err, ERR_USAGE, "%s %s takes no --%s", c->name, ctl->verb->name, table[i].name);
			return err_add_hint(err, "acutctl help %s lists its options", c->name);
		}
	}
	return 0;
}

int ctl_option_number(const char *name, const char *text, uint64_t least, uint64_t most, uint64_t *ret, struct err *err)
{
	uint64_t n;

	if (!parse_u64(text, &n) || n < least || n > most)
		return err_set(err, ERR_USAGE, "%s must be a whole number from %llu to %llu, not \"%s\"", name,
			       (unsigned long long)least, (unsigned long long)most, text);
	*ret = n;
	return 0;
}

static int disk_limit(const char *option, const char *text, struct err *err)
{
	size_t n = strlen(text);
	char digits[4] = "";
	uint64_t v;

	if (n > 1 && n <= 4 && text[n - 1] == '%') {
		memcpy(digits, text, n - 1);
		if (parse_u64(digits, &v) && v <= 100)
			return 0;
	}
	if (parse_size(text, &v))
		return 0;
	err_set(err, ERR_USAGE, "%s is neither a size nor a percentage: \"%s\"", option, text);
	return err_add_hint(err, "give a number with K, M or G, as in %s 20G, or as in %s 50%%", option, option);
}

/* Values that can be judged without knowing the command. */
static int check_values(struct ctl *ctl, struct err *err)
{
	const struct ctl_args *a = &ctl->args;
	uint64_t n;
	int r = 0;

	for (size_t i = 0; a->input_format && ctl_formats_input[i].name; i++)
		if (ctl_formats_extension(&ctl_formats_input[i], a->input_format))
			ctl->args.input_format = ctl_formats_input[i].name; /* laz is read as las */
	if (a->timeout && (!parse_seconds(a->timeout, &ctl->timeout) || ctl->timeout <= 0))
		return err_set(err, ERR_USAGE, "--timeout is not a time: \"%s\" (90, 90s, 5m, 2h)", a->timeout);
	if (ctl->timeout > 0)
		ctl->deadline_ns = clock_mono_ns() + (uint64_t)(ctl->timeout * 1e9);
	if (a->memory && (!parse_size(a->memory, &n) || n < 24u << 20)) {
		err_set(err, ERR_USAGE, "--memory is not a size of at least 24M: \"%s\"", a->memory);
		return err_add_hint(err, "give a number with K, M or G, as in --memory 256M");
	}
	if (a->threads)
		r = ctl_option_number("--threads", a->threads, 1, 1024, &n, err);
	if (!r && a->generation)
		r = ctl_option_number("--at", a->generation, 1, UINT64_MAX, &n, err);
	if (!r && a->since)
		r = ctl_option_number("--changed-since", a->since, 1, UINT64_MAX, &n, err);
	if (!r && a->disk)
		r = disk_limit("--disk", a->disk, err);
	if (!r && a->keep_free)
		r = disk_limit("--keep-free", a->keep_free, err);
	if (!r && a->own_private && (a->cache || a->disk || a->keep_free)) {
		err_set(err, ERR_USAGE,
			"--cache, --disk and --keep-free mean a daemon of the command's own, --private the one of the user");
		r = err_add_hint(err, "leave out --private");
	}
	if (!r && (a->memory || a->threads || a->cache || a->disk || a->keep_free) && a->socket) {
		err_set(err, ERR_USAGE,
			"--memory, --threads, --cache, --disk and --keep-free mean a daemon of the command's own");
		r = err_add_hint(err, "leave out --socket");
	}
	return r;
}

int ctl_option_parse(int argc, char **argv, struct ctl *ctl, struct err *err)
{
	struct reader r = {.argc = argc, .argv = argv, .args = &ctl->args};
	char *command = NULL;
	bool options = true;
	int rc;

	ctl->args.word = calloc((size_t)argc + 1, sizeof(char *));
	if (!ctl->args.word)
		return err_set(err, ERR_NOMEM, "no memory for the command line");
	for (r.at = 1; r.at < argc; r.at++) {
		char *arg = argv[r.at];

		if (options && !strcmp(arg, "--")) {
			options = false;
		} else if (options && arg[0] == '-' && arg[1]) {
			rc = !strcmp(arg, "--version") && !command ? 0 : take(&r, arg, err);
			if (rc)
				return rc;
			if (!strcmp(arg, "--version"))
				command = "version";
		} else if (!command) {
			r.command = command = arg;
		} else {
			ctl->args.word[ctl->args.nword++] = arg;
		}
	}
	if (!command && ctl->args.help)
		command = "help";
	rc = check_command(ctl, command, err);
	if (!rc)
		rc = check_groups(&r, ctl->command, err);
	if (!rc && !ctl->args.help)
		rc = check_words(ctl, err);
	if (!rc && !ctl->args.help)
		rc = check_verb(&r, ctl, err);
	return rc ? rc : check_values(ctl, err);
}
