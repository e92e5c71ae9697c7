/*
 * Reads a command line into options, command, verb and words.
 *
 * Options may come before and after the command; "--" ends them. An option that is given twice is an error, unless it is a
 * list, or of two scopes. Options of a later version are refused by name, never ignored: a script that asks for a part must not
 * get the whole.
 */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "cli.h"
#include "cli_guess.h"
#include "err.h"
#include "parse.h"

struct reader {
	const struct cli *cli;
	int argc, at;
	char **argv;
	struct program *program;
	const struct cli_command *command; /* NULL: it has not come yet, or there is none of that name */
	uint8_t *seen;                     /* for each option: SEEN, SEEN_IN_SCOPE */
	unsigned scope;
};

enum { SEEN = 1, SEEN_IN_SCOPE = 2 };

/* ---- values ---- */

static bool has_choices(const struct cli_option *o)
{
	return o->value && o->value[0] >= 'a' && strchr(o->value, '|') && !strpbrk(o->value, ",[%");
}

/* "a, b or c" of "a|b|c". */
static void choices_text(const char *choices, char *buf, size_t size)
{
	size_t n = 0;

	for (buf[0] = 0; *choices && n < size;) {
		size_t k = strcspn(choices, "|");
		const char *rest = choices + k + (choices[k] == '|'), *then = !*rest ? "" : strchr(rest, '|') ? ", " : " or ";

		n += (size_t)snprintf(buf + n, size - n, "%.*s%s", (int)k, choices, then);
		choices = rest;
	}
}

/* One of the words, in their spelling: the case of letters does not count. */
static int check_choice(const struct cli_option *o, char *value, struct err *err)
{
	struct cli_guess g = {.given = value};
	char all[128];
	size_t n = strlen(value);

	for (const char *at = o->value; *at; at += strcspn(at, "|"), at += *at == '|')
		if (strcspn(at, "|") == n && !strncasecmp(at, value, n)) {
			memcpy(value, at, n);
			return 0;
		}
	choices_text(o->value, all, sizeof(all));
	err_set(err, ERR_USAGE, "--%s is %s, not \"%s\"", o->name, all, value);
	cli_guess_offer_choices(&g, o->value);
	return g.distance ? err_add_hint(err, "did you mean %s?", g.best) : -ERR_USAGE;
}

static int set_seconds(const struct cli_option *o, const char *value, double *to, struct err *err)
{
	if (parse_seconds(value, to) && *to > 0 && *to <= 1e8)
		return 0;
	err_set(err, ERR_USAGE, "--%s is not a time: \"%s\"", o->name, value);
	return err_add_hint(err, "give seconds, or a number with s, m or h, as in --%s 5m", o->name);
}

static int set_size(const struct cli_option *o, const char *value, uint64_t *to, struct err *err)
{
	if (parse_size(value, to) && *to)
		return 0;
	err_set(err, ERR_USAGE, "--%s is not a size: \"%s\"", o->name, value);
	return err_add_hint(err, "give bytes, or a number with K, M or G, as in --%s 512M", o->name);
}

static int set_many(const struct cli_option *o, const char *value, uint64_t *to, struct err *err)
{
	if (parse_many(value, to) && *to)
		return 0;
	err_set(err, ERR_USAGE, "--%s is not a number above 0: \"%s\"", o->name, value);
	return err_add_hint(err, "give a number, or one with k, M or G, as in --%s 10M", o->name);
}

static int add_text(const struct cli_option *o, const char *value, struct cli_texts *to, struct err *err)
{
	if (to->n == CLI_TEXTS)
		return err_set(err, ERR_USAGE, "--%s is given more than %d times", o->name, CLI_TEXTS);
	to->text[to->n++] = value;
	return 0;
}

static bool is_scoped(const struct cli *cli, const struct cli_option *o)
{
	return cli->scopes && o->at >= cli->scope_at && o->at < cli->scope_at + cli->scope_size;
}

static int open_scope(struct reader *r, const struct cli_option *o, struct err *err)
{
	if (r->scope + 1 >= r->cli->scopes)
		return err_set(err, ERR_USAGE, "--%s is given more than %u times", o->name, r->cli->scopes - 1);
	r->scope++;
	for (size_t i = 0; i < r->cli->noption; i++)
		if (is_scoped(r->cli, &r->cli->option[i]))
			r->seen[i] &= (uint8_t)~SEEN_IN_SCOPE;
	return 0;
}

static int set(struct reader *r, const struct cli_option *o, char *value, struct err *err)
{
	uint8_t *seen = &r->seen[o - r->cli->option];
	char name[64], *to;

	if (o->kind == CLI_SCOPE && open_scope(r, o, err))
		return -ERR_USAGE;
	if (*seen & SEEN_IN_SCOPE && o->value && o->kind != CLI_LIST)
		return err_set(err, ERR_USAGE, "--%s is given twice", o->name);
	*seen = SEEN | SEEN_IN_SCOPE;
	to = (char *)r->program + o->at + (is_scoped(r->cli, o) ? r->scope * r->cli->scope_size : 0);
	if (has_choices(o) && check_choice(o, value, err))
		return -ERR_USAGE;
	switch (o->kind) {
	case CLI_FLAG:
		*(bool *)to = true;
		return 0;
	case CLI_WORD:
		if (!*value)
			return err_set(err, ERR_USAGE, "--%s is empty", o->name);
		/* fall through */
	case CLI_SCOPE:
	case CLI_TEXT:
		*(const char **)to = value;
		return 0;
	case CLI_LIST:
		return add_text(o, value, (struct cli_texts *)to, err);
	case CLI_SECONDS:
		return set_seconds(o, value, (double *)to, err);
	case CLI_SIZE:
		return set_size(o, value, (uint64_t *)to, err);
	case CLI_NUMBER:
		return parse_double(value, (double *)to) ?
			       0 :
			       err_set(err, ERR_USAGE, "--%s is not a number: \"%s\"", o->name, value);
	case CLI_COUNT:
		snprintf(name, sizeof(name), "--%s", o->name);
		return cli_number(name, value, 1, UINT64_MAX, (uint64_t *)to, err);
	case CLI_MANY:
		return set_many(o, value, (uint64_t *)to, err);
	}
	return err_set(err, ERR_INTERNAL, "--%s has no kind", o->name);
}

/* ---- options ---- */

static int unknown_option(const struct reader *r, const char *arg, struct err *err)
{
	char name[64], buf[128];
	struct cli_guess g = {.given = name + 2};

	snprintf(name, sizeof(name), "%.*s", (int)strcspn(arg, "="), arg);
	err_set(err, ERR_USAGE, "there is no option %s", name);
	for (size_t i = 0; !strncmp(arg, "--", 2) && i < r->cli->noption; i++)
		cli_guess_offer(&g, r->cli->option[i].name);
	return err_add_hint(err, "%s%s help COMMAND lists the options of a command", cli_guess_text(&g, "--", buf),
			    r->cli->program);
}

/* An argument that begins with a dash; the next one is its value, if it needs one and has none. */
static int read_option(struct reader *r, char *arg, struct err *err)
{
	const struct cli_option *o = cli_find_option(r->cli, arg, r->command);
	char *value = arg[1] == '-' ? strchr(arg, '=') : arg[2] ? arg + 1 : NULL;

	if (!o)
		return unknown_option(r, arg, err);
	if (!o->value && value)
		return err_set(err, ERR_USAGE, "--%s takes no value", o->name);
	if (value)
		value++;
	else if (o->value && r->at + 1 >= r->argc)
		return err_set(err, ERR_USAGE, "--%s needs a value: %s", o->name, o->value);
	else if (o->value)
		value = r->argv[++r->at];
	return set(r, o, value, err);
}

/* Every option that was given must be one that the command takes. */
static int check_options(const struct reader *r, const struct cli_line *l, struct err *err)
{
	for (size_t i = 0; i < r->cli->noption; i++) {
		const struct cli_option *o = &r->cli->option[i];

		if (!r->seen[i] || cli_takes(l->command, l->verb, o))
			continue;
		err_set(err, ERR_USAGE, "%s%s%s takes no --%s", l->command->name, l->verb ? " " : "",
			l->verb ? l->verb->name : "", o->name);
		return err_add_hint(err, "%s help %s lists its options", r->cli->program, l->command->name);
	}
	return 0;
}

/* ---- words ---- */

static int check_words(const struct reader *r, const struct cli_line *l, struct err *err)
{
	unsigned least = l->verb ? l->verb->least : l->command->least, most = l->verb ? l->verb->most : l->command->most;
	char name[64];

	if (l->nword >= least && l->nword <= most)
		return 0;
	snprintf(name, sizeof(name), "%s%s%s", l->command->name, l->verb ? " " : "", l->verb ? l->verb->name : "");
	if (l->nword < least)
		err_set(err, ERR_USAGE, "%s needs at least %u word%s after it, %u given", name, least, least == 1 ? "" : "s",
			l->nword);
	else
		err_set(err, ERR_USAGE, "%s takes no word \"%s\"", name, l->word[most]);
	if (l->verb)
		return err_add_hint(err, "%s %s %s", r->cli->program, l->command->name, l->verb->usage);
	return err_add_hint(err, "%s %s", r->cli->program, l->command->usage);
}

static int check_line(const struct reader *r, struct cli_line *l, const char *name, struct err *err)
{
	if (!name) {
		err_set(err, ERR_USAGE, "no command given");
		return err_add_hint(err, "%s help lists the commands", r->cli->program);
	}
	l->command = cli_find_command(r->cli, name);
	if (!l->command)
		return cli_unknown_command(r->cli, name, err);
	if (check_options(r, l, err) || l->help)
		return -(int)err->code;
	if (l->command->verbs) {
		l->verb = cli_find_verb(l->command, l->nword ? l->word[0] : "");
		if (!l->verb)
			return cli_unknown_verb(r->cli, l->command, l->nword ? l->word[0] : "", err);
		l->word++;
		l->nword--;
	}
	return check_words(r, l, err) || check_options(r, l, err) ? -(int)err->code : 0;
}

static int read_line(struct reader *r, struct cli_line *l, const char **ret_name, struct err *err)
{
	bool ended = false;

	for (r->at = 1; r->at < r->argc; r->at++) {
		char *arg = r->argv[r->at];

		if (!ended && !strcmp(arg, "--")) {
			ended = true;
		} else if (!ended && !*ret_name && !strcmp(arg, "--version")) {
			*ret_name = "version";
		} else if (!ended && (!strcmp(arg, "--help") || !strcmp(arg, "-h"))) {
			l->help = true;
		} else if (!ended && arg[0] == '-' && arg[1]) {
			if (read_option(r, arg, err))
				return -(int)err->code;
		} else if (!*ret_name) {
			*ret_name = arg;
			r->command = cli_find_command(r->cli, arg);
		} else {
			l->all[l->nword++] = arg;
		}
	}
	return 0;
}

int cli_parse(const struct cli *cli, int argc, char **argv, struct program *program, struct cli_line *ret, struct err *err)
{
	struct reader r = {.cli = cli, .argc = argc, .argv = argv, .program = program};
	const char *name = NULL;

	*ret = (struct cli_line){.all = calloc((size_t)argc + 1, sizeof(*ret->all))};
	ret->word = ret->all;
	r.seen = calloc(cli->noption, sizeof(*r.seen));
	if (!ret->all || !r.seen)
		err_set(err, ERR_NOMEM, "no memory for the command line");
	else if (!read_line(&r, ret, &name, err))
		check_line(&r, ret, !name && ret->help ? "help" : name, err);
	free(r.seen);
	return -(int)err->code;
}

void cli_done(struct cli_line *l)
{
	free(l->all);
	*l = (struct cli_line){0};
}
