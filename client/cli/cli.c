/* Lookup in the tables, and errors that name the nearest word. */
#include "cli.h"

#include <string.h>

#include "cli_guess.h"
#include "err.h"
#include "parse.h"

const struct cli_command *cli_find_command(const struct cli *cli, const char *name)
{
	for (size_t i = 0; i < cli->ncommand; i++)
		if (!strcmp(cli->command[i].name, name))
			return &cli->command[i];
	return NULL;
}

const struct cli_verb *cli_find_verb(const struct cli_command *c, const char *name)
{
	for (const struct cli_verb *v = c->verbs; v && v->name; v++)
		if (!strcmp(v->name, name))
			return v;
	return NULL;
}

const struct cli_option *cli_find_option(const struct cli *cli, const char *arg, const struct cli_command *c)
{
	const struct cli_option *found = NULL, *end = cli->option + cli->noption;
	size_t n = strcspn(arg, "=") - 2;

	for (const struct cli_option *o = cli->option; o < end; o++) {
		if (arg[1] == '-' ? cli_is_kind(arg + 2, n, o->name) : o->letter == arg[1])
			found = !found || (c && (o->groups & c->groups)) ? o : found;
	}
	return found;
}

/* A list of words with a blank between two. */
static bool is_listed(const char *list, const char *word)
{
	size_t n = strlen(word);

	for (const char *at = list; at && (at = strstr(at, word)); at += n)
		if ((at == list || at[-1] == ' ') && (!at[n] || at[n] == ' '))
			return true;
	return false;
}

bool cli_takes(const struct cli_command *c, const struct cli_verb *v, const struct cli_option *o)
{
	if (!(o->groups & (c ? c->groups : CLI_ALL)))
		return false;
	return !v || (o->groups & CLI_ALL) || is_listed(v->options, o->name);
}

/* Also "log" for "dataset log". */
int cli_unknown_command(const struct cli *cli, const char *name, struct err *err)
{
	struct cli_guess g = {.given = name};
	char buf[128], prefix[32];

	err_set(err, ERR_USAGE, "there is no command %s", name);
	for (size_t i = 0; i < cli->ncommand; i++) {
		if (cli_find_verb(&cli->command[i], name))
			return err_add_hint(err, "did you mean %s %s %s? %s help lists the commands", cli->program,
					    cli->command[i].name, name, cli->program);
		cli_guess_offer(&g, cli->command[i].name);
	}
	snprintf(prefix, sizeof(prefix), "%s ", cli->program);
	return err_add_hint(err, "%s%s help lists the commands", cli_guess_text(&g, prefix, buf), cli->program);
}

int cli_unknown_verb(const struct cli *cli, const struct cli_command *c, const char *word, struct err *err)
{
	struct cli_guess g = {.given = word};
	char buf[128], all[200] = "";
	size_t n = 0;

	for (const struct cli_verb *v = c->verbs; v->name && n < sizeof(all); v++) {
		cli_guess_offer(&g, v->name);
		n += (size_t)snprintf(all + n, sizeof(all) - n, "%s%s", v == c->verbs ? "" : v[1].name ? ", " : " or ", v->name);
	}
	if (*word)
		err_set(err, ERR_USAGE, "there is no command %s %s", c->name, word);
	else
		err_set(err, ERR_USAGE, "%s needs a verb", c->name);
	return err_add_hint(err, "%s%s %s %s", cli_guess_text(&g, "", buf), cli->program, c->name, all);
}

int cli_number(const char *name, const char *text, uint64_t least, uint64_t most, uint64_t *ret, struct err *err)
{
	uint64_t n;

	if (!parse_u64(text, &n) || n < least || n > most)
		return err_set(err, ERR_USAGE, "%s must be a whole number from %llu to %llu, not \"%s\"", name,
			       (unsigned long long)least, (unsigned long long)most, text);
	*ret = n;
	return 0;
}
