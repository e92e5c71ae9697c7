/* help: all commands, or one with its verbs, options, examples and exit status; out of the tables. */
#include <string.h>

#include "ctl.h"
#include "cli_guess.h"
#include "term.h"

/* At least one of each command; tests/acutctl/cli.py reads them as command lines. */
static const struct {
	const char *command, *line;
} examples[] = {
	{"backup", "acutctl backup /mnt/backup/acut"},
	{"cache", "acutctl cache stat"},
	{"cache", "acutctl cache gc --all"},
	{"cancel", "acutctl cancel 12"},
	{"config", "acutctl config show --origin"},
	{"dataset", "acutctl dataset show valley"},
	{"dataset", "acutctl dataset log valley --files"},
	{"dataset", "acutctl dataset revert valley 7"},
	{"datasets", "acutctl datasets"},
	{"datasets", "acutctl datasets --removed"},
	{"doctor", "acutctl doctor"},
	{"fetch", "acutctl fetch 12 -o valley.ply -o valley.png"},
	{"fetch", "acutctl fetch 12 -o valley.ply --resume"},
	{"formats", "acutctl formats"},
	{"geoid", "acutctl geoid add egm2008-1.pgm"},
	{"help", "acutctl help mesh"},
	{"info", "acutctl info survey.laz"},
	{"info", "acutctl info --header monday/"},
	{"ingest", "acutctl ingest valley /data/incoming --settle 60"},
	{"jobs", "acutctl jobs"},
	{"mesh", "acutctl mesh survey.laz -o survey.ply"},
	{"mesh", "acutctl mesh monday/ --ground --max-edge 30m -o ground.ply -o ground.png"},
	{"metrics", "acutctl metrics --textfile /run/acut-metrics/acut.prom"},
	{"ping", "acutctl ping"},
	{"plan", "acutctl plan valley --ground"},
	{"push", "acutctl push valley monday/"},
	{"push", "acutctl push valley --replace delivery-2/ --manifest delivery-2/SHA256SUMS"},
	{"rm", "acutctl rm 12 13"},
	{"show", "acutctl show 12"},
	{"status", "acutctl status --json"},
	{"submit", "acutctl submit valley --wait"},
	{"submit", "acutctl submit valley --ground --at 3"},
	{"version", "acutctl version"},
	{"wait", "acutctl wait 12 13"},
	{"watch", "acutctl watch"},
};

static void head(FILE *out, const char *text)
{
	struct term term = term_of(out);

	fprintf(out, "%s%s%s\n", term_tint(&term, TERM_BOLD), text, term_tint(&term, TERM_PLAIN));
}

/* The options that the groups take. */
static void put_options(FILE *out, unsigned groups)
{
	size_t n;
	const struct ctl_option *row = ctl_option_rows(&n);

	for (size_t i = 0; i < n; i++) {
		char letter[8] = "", left[80];

		if (row[i].kind == CTL_LATER || !(row[i].groups & groups))
			continue;
		if (row[i].letter)
			snprintf(letter, sizeof(letter), "-%c, ", row[i].letter);
		snprintf(left, sizeof(left), "%s--%s%s%s", letter, row[i].name, row[i].value ? " " : "",
			 row[i].value ? row[i].value : "");
		if (strlen(left) <= 24)
			fprintf(out, "  %-24s %s\n", left, row[i].help);
		else
			fprintf(out, "  %s\n  %-24s %s\n", left, "", row[i].help);
	}
}

static void help_all(FILE *out)
{
	size_t n;
	const struct ctl_command *row = ctl_command_rows(&n);

	fputs("acutctl: terrain meshes from survey points, through acutd\n\n", out);
	for (size_t i = 0; i < n; i++)
		if (row[i].run && !row[i].hidden)
			fprintf(out, "  acutctl %-22s %s\n", row[i].usage, row[i].help);
	fputs("\noptions of every command:\n", out);
	put_options(out, CTL_ALL);
	fputs("\nacutctl help COMMAND tells a command's options, examples and exit status; man acutctl tells all.\n", out);
}

static void statuses(FILE *out, const struct ctl_command *c)
{
	head(out, "exit status:");
	fputs("  0 done; 1 the job or an input failed; 2 usage", out);
	if (c->groups & CTL_INPUT)
		fputs("; 3 done, but some inputs were refused", out);
	fputs(";\n  4 there is no such job or dataset; 69 no daemon; 74 reading or writing failed, or no space;\n"
	      "  75 not now, try again later; 76 versions; 77 not permitted; 124 --timeout has passed\n",
	      out);
}

static void help_one(FILE *out, const struct ctl_command *c)
{
	bool any = false;

	fprintf(out, "acutctl %s: %s\n\n", c->usage, c->help);
	if (c->groups & CTL_INPUT)
		fputs("INPUT is a file, a folder (its survey files), @LIST (names, one a line) or - "
		      "(standard input), or a named pipe.\n\n",
		      out);
	for (const struct ctl_verb *v = c->verbs; v && v->name; v++)
		fprintf(out, "  acutctl %s %-*s %s\n", c->name, 30 - (int)strlen(c->name), v->usage, v->help);
	if (c->verbs)
		fputc('\n', out);
	if (c->groups != CTL_ALL) {
		head(out, "options:");
		put_options(out, c->groups & ~(unsigned)CTL_ALL);
	}
	head(out, "options of every command:");
	put_options(out, CTL_ALL);
	for (size_t i = 0; i < sizeof(examples) / sizeof(*examples); i++) {
		if (strcmp(examples[i].command, c->name))
			continue;
		if (!any)
			head(out, "examples:");
		any = true;
		fprintf(out, "  %s\n", examples[i].line);
	}
	statuses(out, c);
}

int ctl_help_run(struct ctl *ctl)
{
	const struct ctl_command *c = ctl->command;
	struct err err = ERR_INIT;

	if (c->run == ctl_help_run && !ctl->args.nword) {
		help_all(stdout);
		return CTL_DONE;
	}
	if (c->run == ctl_help_run && ctl->args.nword) {
		c = ctl_command_find(ctl->args.word[0]);
		if (!c) {
			ctl_command_unknown(ctl->args.word[0], &err);
			return ctl_error(ctl, &err);
		}
		/* A verb is on the page of its command. */
		if (ctl->args.nword > 1 && !(c->verbs && ctl_verb_find(c, ctl->args.word[1]))) {
			if (c->verbs)
				ctl_verb_unknown(c, ctl->args.word[1], &err);
			else
				err_set(&err, ERR_USAGE, "help of %s takes no word \"%s\"", c->name, ctl->args.word[1]);
			return ctl_error(ctl, &err);
		}
	}
	if (!c->run) {
		err_set(&err, ERR_UNSUPPORTED, "%s is not in this version of acut", c->name);
		return ctl_error(ctl, &err);
	}
	help_one(stdout, c);
	return CTL_DONE;
}
