/* Help, out of the tables: all commands, or one with its verbs, options, examples and exit statuses. */
#include <string.h>

#include "cli.h"
#include "err.h"
#include "term.h"

enum { LEFT = 24 /* columns of an option */, VERB = 30, USAGE_MOST = 30 };

static void put_head(FILE *out, const char *text)
{
	struct term term = term_of(out);

	fprintf(out, "%s%s%s\n", term_tint(&term, TERM_BOLD), text, term_tint(&term, TERM_PLAIN));
}

/* Prints the options of every command (`all`), or the others that this command takes. */
static void put_options(const struct cli *cli, const struct cli_command *c, bool all, FILE *out)
{
	for (const struct cli_option *o = cli->option; o < cli->option + cli->noption; o++) {
		char letter[8] = "", left[80];

		if ((o->groups & CLI_ALL) != all || !cli_takes(c, NULL, o))
			continue;
		if (o->letter)
			snprintf(letter, sizeof(letter), "-%c, ", o->letter);
		snprintf(left, sizeof(left), "%s--%s%s%s", letter, o->name, o->value ? " " : "", o->value ? o->value : "");
		fprintf(out, "  %s", left);
		if (strlen(left) > LEFT)
			fprintf(out, "\n  %*s %s\n", LEFT, "", o->help);
		else
			fprintf(out, "%*s %s\n", LEFT - (int)strlen(left), "", o->help);
	}
}

static void help_all(const struct cli *cli, FILE *out)
{
	int width = 0;

	for (size_t i = 0; i < cli->ncommand; i++) {
		int n = (int)strlen(cli->command[i].usage);

		width = n > width && n <= USAGE_MOST ? n : width;
	}
	fprintf(out, "%s: %s\n\n", cli->program, cli->about);
	for (size_t i = 0; i < cli->ncommand; i++)
		fprintf(out, "  %s %-*s %s\n", cli->program, width, cli->command[i].usage, cli->command[i].help);
	fputs("\noptions of every command:\n", out);
	put_options(cli, NULL, true, out);
	fprintf(out, "\n%s help COMMAND prints options, examples and exit status of a command; the manual is man %s.\n",
		cli->program, cli->program);
}

static void help_one(const struct cli *cli, const struct cli_command *c, FILE *out)
{
	fprintf(out, "%s %s: %s\n\n", cli->program, c->usage, c->help);
	fputs(cli->words(c), out);
	for (const struct cli_verb *v = c->verbs; v && v->name; v++)
		fprintf(out, "  %s %s %-*s %s\n", cli->program, c->name, VERB - (int)strlen(c->name), v->usage, v->help);
	if (c->verbs)
		fputc('\n', out);
	if (c->groups != CLI_ALL) {
		put_head(out, "options:");
		put_options(cli, c, false, out);
	}
	put_head(out, "options of every command:");
	put_options(cli, c, true, out);
	put_head(out, "examples:");
	for (const char *line = c->examples; *line; line += strcspn(line, "\n"), line += *line == '\n')
		fprintf(out, "  %s %.*s\n", cli->program, (int)strcspn(line, "\n"), line);
	put_head(out, "exit status:");
	fputs(cli->statuses(c), out);
}

void cli_help(const struct cli *cli, const struct cli_command *c, FILE *out)
{
	if (c)
		help_one(cli, c, out);
	else
		help_all(cli, out);
}

/* "help [COMMAND [VERB]]": a verb is on the page of its command. */
static int run_help(const struct cli *cli, const struct cli_line *l, FILE *out, struct err *err)
{
	const struct cli_command *c = l->nword ? cli_find_command(cli, l->word[0]) : NULL;

	if (l->nword && !c)
		return cli_unknown_command(cli, l->word[0], err);
	if (l->nword > 1 && c->verbs && !cli_find_verb(c, l->word[1]))
		return cli_unknown_verb(cli, c, l->word[1], err);
	if (l->nword > 1 && !c->verbs)
		return err_set(err, ERR_USAGE, "help of %s takes no word \"%s\"", c->name, l->word[1]);
	cli_help(cli, c, out);
	return 0;
}

int cli_run(const struct cli *cli, const struct cli_line *l, struct program *program, FILE *out, struct err *err)
{
	if (!l->command->run && !l->command->verbs)
		return run_help(cli, l, out, err);
	if (!l->help)
		return (l->verb ? l->verb->run : l->command->run)(program);
	cli_help(cli, l->command, out);
	return 0;
}
