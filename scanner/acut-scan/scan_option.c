/*
 * The table of options, and the reading of the command line by it.
 *
 * A row says the option's name, what follows it, what it must be, where it goes and which commands take it. Numbers
 * are read here, strictly, so that a command sees only what is one. Options may stand before and after the command;
 * "--" ends them. An option that is said twice is an error, but --profiles, which adds a folder each time.
 */
#include <stddef.h>
#include <string.h>

#include "cli_guess.h"
#include "err.h"
#include "parse.h"
#include "scan.h"

#define AT(field) offsetof(struct scan_args, field)

static const struct scan_option table[] = {
	{"output", 'o', "FILE", SCAN_TEXT, AT(output), SCAN_RECORD | SCAN_REPLAY | SCAN_PUSH,
	 "write there; never over a file that is there"},
	{"folder", 0, "DIR", SCAN_TEXT, AT(folder), SCAN_RECORD, "a new spool in this folder: PROFILE-SERIAL-TIME.spool"},
	{"from", 0, "FILE|-", SCAN_TEXT, AT(from), SCAN_RECORD, "take the bytes of a file or pipe, not those of a device"},
	{"continue", 0, NULL, SCAN_FLAG, AT(resume), SCAN_RECORD,
	 "go on in the spool of -o, which a crash has left without its end"},
	{"reconnect", 0, NULL, SCAN_FLAG, AT(reconnect), SCAN_RECORD,
	 "when the device is unplugged, wait for it and go on in the same spool"},
	{"for", 0, "TIME", SCAN_SECONDS, AT(seconds), SCAN_RECORD | SCAN_PROBE, "stop after so long: 90, 90s, 5m, 2h"},
	{"bytes", 0, "SIZE", SCAN_SIZE, AT(bytes), SCAN_RECORD, "stop after so many bytes: 512M, 2G"},
	{"sync", 0, "TIME", SCAN_SECONDS, AT(sync_s), SCAN_RECORD, "make durable what came at least so often (1s)"},
	{"to", 0, "raw|telegrams|sweeps|csv|points", SCAN_TEXT, AT(to), SCAN_REPLAY, "what to write out"},

	{"into", 0, "DATASET", SCAN_TEXT, AT(into), SCAN_PUSH, "the dataset; made if there is none"},
	{"pose", 0, "FILE", SCAN_TEXT, AT(pose), SCAN_PUSH, "where the scanner was: a CSV of times, positions and attitudes"},
	{"pose-clock", 0, "utc|gps", SCAN_TEXT, AT(pose_clock), SCAN_PUSH, "what the times of the pose file are (utc)"},
	{"pose-offset", 0, "SECONDS", SCAN_NUMBER, AT(pose_offset_s), SCAN_PUSH, "added to the times of the pose file"},
	{"gap", 0, "TIME", SCAN_SECONDS, AT(gap_s), SCAN_PUSH, "poses further apart than this leave a gap (1.5s)"},
	{"heading", 0, "true|grid", SCAN_TEXT, AT(heading), SCAN_PUSH,
	 "headings are from true north (degrees), or from the plane's north"},
	{"grid-scale", 0, NULL, SCAN_FLAG, AT(grid_scale), SCAN_PUSH,
	 "shorten or lengthen ranges as the plane does lengths where the scanner is"},
	{"geoid", 0, "NAME", SCAN_TEXT, AT(geoid), SCAN_PUSH, "make ellipsoidal heights orthometric by this grid of the daemon"},
	{"replace", 0, NULL, SCAN_FLAG, AT(replace), SCAN_PUSH, "in place of what the dataset has of the spool already"},
	{"crs", 0, "CRS", SCAN_TEXT, AT(crs), SCAN_PUSH,
	 "the plane of the poses, or the datum of their degrees: EPSG:n, or a name"},
	{"utm", 0, "ZONE", SCAN_TEXT, AT(utm), SCAN_PUSH, "project degrees to this zone (32N, 5S), not to that of their middle"},
	{"name", 0, "NAME", SCAN_TEXT, AT(name), SCAN_PUSH, "the name under which the dataset keeps it (the spool's)"},
	{"socket", 0, "PATH", SCAN_TEXT, AT(socket), SCAN_PUSH, "where the daemon listens"},

	{"device", 'd', "DEVICE", SCAN_TEXT, AT(device), SCAN_DEVICE,
	 "which one: serial:TEXT, port:1-2.4, VENDOR:PRODUCT, or a profile's name"},
	{"profile", 0, "NAME|FILE", SCAN_TEXT, AT(profile), SCAN_DEVICE | SCAN_REPLAY | SCAN_PUSH,
	 "this profile, not that which the device or the spool asks for"},
	{"profiles", 0, "DIR", SCAN_FOLDERS, 0, SCAN_PROFILES,
	 "a folder of profiles, in place of the usual ones; may be repeated"},
	{"all", 'a', NULL, SCAN_FLAG, AT(all), SCAN_LIST, "all devices, not only those with a profile"},
	{"watch", 0, NULL, SCAN_FLAG, AT(watch), SCAN_LIST, "go on with a line for each device that comes or leaves"},
	{"udev", 0, NULL, SCAN_FLAG, AT(udev), SCAN_KINDS, "print udev rules: all, or lines of the profiles named"},

	{"json", 0, NULL, SCAN_FLAG, AT(json), SCAN_ALL, "results and errors as JSON"},
	{"quiet", 'q', NULL, SCAN_FLAG, AT(quiet), SCAN_ALL, "say nothing but errors and what was asked for"},
	{"no-progress", 0, NULL, SCAN_FLAG, AT(no_progress), SCAN_ALL, "no progress line"},
	{"help", 'h', NULL, SCAN_FLAG, AT(help), SCAN_ALL, "what the command does"},
};

enum { ROWS = sizeof(table) / sizeof(table[0]) };

const struct scan_option *scan_option_rows(size_t *ret_n)
{
	*ret_n = ROWS;
	return table;
}

struct reader {
	int argc, at;
	char **argv;
	struct scan_args *args;
	bool seen[ROWS];
};

static const struct scan_option *find(const char *name, size_t n, char letter)
{
	for (size_t i = 0; i < ROWS; i++)
		if (letter ? table[i].letter == letter : strlen(table[i].name) == n && !memcmp(table[i].name, name, n))
			return &table[i];
	return NULL;
}

static int no_option(const char *arg, struct err *err)
{
	char name[64], buf[128];
	struct cli_guess g = {.given = name + 2};

	snprintf(name, sizeof(name), "%.*s", (int)strcspn(arg, "="), arg);
	err_set(err, ERR_USAGE, "there is no option %s", name);
	for (size_t i = 0; !strncmp(arg, "--", 2) && i < ROWS; i++)
		cli_guess_offer(&g, table[i].name);
	return err_add_hint(err, "%sacut-scan help COMMAND lists the options of a command", cli_guess_text(&g, "--", buf));
}

static bool is_choice(const struct scan_option *o, const char *value)
{
	size_t n = strlen(value);

	for (const char *at = o->value; *at; at += strcspn(at, "|"), at += *at == '|')
		if (strcspn(at, "|") == n && !memcmp(at, value, n))
			return true;
	return false;
}

static int set(struct reader *r, const struct scan_option *o, const char *value, struct err *err)
{
	char *to = (char *)r->args + o->at;
	double number = 0;
	uint64_t size = 0;

	if (r->seen[o - table] && o->value && o->kind != SCAN_FOLDERS)
		return err_set(err, ERR_USAGE, "--%s is given twice", o->name);
	r->seen[o - table] = true;
	switch (o->kind) {
	case SCAN_FLAG:
		*(bool *)to = true;
		return 0;
	case SCAN_TEXT:
		if (o->value[0] >= 'a' && !is_choice(o, value))
			return err_set(err, ERR_USAGE, "--%s is one of %s, not \"%s\"", o->name, o->value, value);
		if (!*value)
			return err_set(err, ERR_USAGE, "--%s is empty", o->name);
		*(const char **)to = value;
		return 0;
	case SCAN_FOLDERS:
		if (r->args->n_profiles == SCAN_PROFILE_FOLDERS)
			return err_set(err, ERR_USAGE, "more than %d times --%s", SCAN_PROFILE_FOLDERS, o->name);
		r->args->profiles[r->args->n_profiles++] = value;
		return 0;
	case SCAN_SECONDS:
		if (!parse_seconds(value, &number) || !(number > 0) || number > 1e8) {
			err_set(err, ERR_USAGE, "--%s is no time: \"%s\"", o->name, value);
			return err_add_hint(err, "give seconds, or a number with s, m or h, as in --%s 5m", o->name);
		}
		*(double *)to = number;
		return 0;
	case SCAN_SIZE:
		if (!parse_size(value, &size) || !size) {
			err_set(err, ERR_USAGE, "--%s is no size: \"%s\"", o->name, value);
			return err_add_hint(err, "give bytes, or a number with K, M or G, as in --%s 512M", o->name);
		}
		*(uint64_t *)to = size;
		return 0;
	case SCAN_NUMBER:
		if (!parse_double(value, &number))
			return err_set(err, ERR_USAGE, "--%s is no number: \"%s\"", o->name, value);
		*(double *)to = number;
		return 0;
	}
	return err_set(err, ERR_INTERNAL, "--%s has no kind", o->name);
}

/* One argument that starts with a dash; takes the next one as its value if it needs one. */
static int take(struct reader *r, const char *arg, struct err *err)
{
	const struct scan_option *o;
	const char *value = NULL;

	if (arg[1] == '-') {
		const char *equal = strchr(arg, '=');

		o = find(arg + 2, equal ? (size_t)(equal - arg - 2) : strlen(arg + 2), 0);
		value = equal ? equal + 1 : NULL;
	} else {
		o = find(NULL, 0, arg[1]);
		value = o && arg[2] ? arg + 2 : NULL;
	}
	if (!o)
		return no_option(arg, err);
	if (!o->value && value)
		return err_set(err, ERR_USAGE, "--%s takes no value", o->name);
	if (o->value && !value) {
		if (r->at + 1 >= r->argc)
			return err_set(err, ERR_USAGE, "--%s needs a value: %s", o->name, o->value);
		value = r->argv[++r->at];
	}
	return set(r, o, value, err);
}

static int check(const struct reader *r, const struct scan_command *c, struct err *err)
{
	size_t n = r->args->n;

	for (size_t i = 0; i < ROWS; i++)
		if (r->seen[i] && !(table[i].groups & c->groups)) {
			err_set(err, ERR_USAGE, "%s takes no --%s", c->name, table[i].name);
			return err_add_hint(err, "acut-scan help %s lists its options", c->name);
		}
	if (r->args->help || (n >= c->least && n <= c->most))
		return 0;
	if (n < c->least)
		err_set(err, ERR_USAGE, "%s needs at least %u word%s after it, %zu given", c->name, c->least,
			c->least == 1 ? "" : "s", n);
	else
		err_set(err, ERR_USAGE, "%s takes no word \"%s\"", c->name, r->args->inputs[c->most]);
	return err_add_hint(err, "acut-scan %s", c->usage);
}

int scan_option_parse(int argc, char **argv, const char **words, struct scan_args *ret, const struct scan_command **ret_command,
		      struct err *err)
{
	struct reader r = {.argc = argc, .argv = argv, .args = ret};
	bool ended = false;

	*ret = (struct scan_args){.inputs = words, .sync_s = 1, .pose_clock = "utc"};
	/* What is asked for in JSON is answered so, whatever is wrong with the rest. */
	for (int i = 1; i < argc && strcmp(argv[i], "--"); i++)
		if (!strcmp(argv[i], "--json"))
			ret->json = true;
	for (r.at = 1; r.at < argc; r.at++) {
		const char *arg = argv[r.at];

		if (!ended && !strcmp(arg, "--"))
			ended = true;
		else if (!ended && arg[0] == '-' && arg[1]) {
			if (take(&r, arg, err))
				return -ERR_USAGE;
		} else if (!ret->command)
			ret->command = arg;
		else
			words[ret->n++] = arg;
	}
	if (!ret->command && ret->help)
		ret->command = "help";
	if (!ret->command) {
		err_set(err, ERR_USAGE, "no command given");
		return err_add_hint(err, "acut-scan help lists the commands");
	}
	*ret_command = scan_command_find(ret->command);
	if (!*ret_command)
		return scan_command_unknown(ret->command, err);
	return check(&r, *ret_command, err);
}
