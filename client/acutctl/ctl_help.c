/* help: all commands, or one with its options; out of the two tables. */
#include "ctl.h"

static void help_all(FILE *out)
{
	size_t n;
	const struct ctl_command *row = ctl_command_rows(&n);

	fputs("acutctl: terrain meshes from survey points, through acutd\n\n", out);
	for (size_t i = 0; i < n; i++)
		if (row[i].run)
			fprintf(out, "  acutctl %-22s %s\n", row[i].usage, row[i].help);
	fputs("\noptions of every command:\n", out);
	ctl_option_help(out, CTL_ALL);
	fputs("\nacutctl help COMMAND lists the options of a command.\n", out);
}

static int help_one(struct ctl *ctl, const struct ctl_command *c)
{
	struct err err = ERR_INIT;

	if (!c->run) {
		err_set(&err, ERR_UNSUPPORTED, "%s is not in this version of acut", c->name);
		return ctl_error(ctl, &err);
	}
	fprintf(stdout, "acutctl %s: %s\n\n", c->usage, c->help);
	if (c->groups & CTL_INPUT)
		fputs("INPUT is a file, a folder (its survey files), @LIST (names, one a line) or - "
		      "(standard input), or a named pipe.\n\n",
		      stdout);
	ctl_option_help(stdout, c->groups);
	return CTL_DONE;
}

int ctl_help_run(struct ctl *ctl)
{
	const struct ctl_command *c = ctl->command;
	struct err err = ERR_INIT;

	if (c->run == ctl_help_run && ctl->args.nword) {
		c = ctl_command_find(ctl->args.word[0]);
		if (!c) {
			err_set(&err, ERR_USAGE, "there is no command %s", ctl->args.word[0]);
			return ctl_error(ctl, &err);
		}
	} else if (c->run == ctl_help_run) {
		help_all(stdout);
		return CTL_DONE;
	}
	return help_one(ctl, c);
}
