/* Help: made of the tables of commands and options; the examples stand here. */
#include <string.h>

#include "err.h"
#include "scan.h"

static const struct {
	const char *command, *line;
} examples[] = {
	{"help", "acut-scan help record"},
	{"list", "acut-scan list"},
	{"list", "acut-scan list --all --json"},
	{"probe", "acut-scan probe"},
	{"probe", "acut-scan probe serial:20370043"},
	{"profiles", "acut-scan profiles"},
	{"profiles", "acut-scan profiles my-scanner.conf"},
	{"push", "acut-scan push monday.spool --pose monday.csv --into valley"},
	{"record", "acut-scan record -o monday.spool"},
	{"record", "acut-scan record serial:20370043 --folder /var/lib/acut-scan --reconnect"},
	{"record", "acut-scan record --from dump.bin --profile sick-tim -o monday.spool"},
	{"replay", "acut-scan replay monday.spool"},
	{"replay", "acut-scan replay monday.spool --to raw -o dump.bin"},
	{"version", "acut-scan version"},
};

static void head(const char *text)
{
	struct term term = term_of(stdout);

	printf("%s%s%s\n", term_tint(&term, TERM_BOLD), text, term_tint(&term, TERM_PLAIN));
}

static void options(unsigned groups)
{
	size_t n;
	const struct scan_option *row = scan_option_rows(&n);

	for (size_t i = 0; i < n; i++) {
		char letter[8] = "", left[80];

		if (!(row[i].groups & groups))
			continue;
		if (row[i].letter)
			snprintf(letter, sizeof(letter), "-%c, ", row[i].letter);
		snprintf(left, sizeof(left), "%s--%s%s%s", letter, row[i].name, row[i].value ? " " : "",
			 row[i].value ? row[i].value : "");
		if (strlen(left) <= 24)
			printf("  %-24s %s\n", left, row[i].help);
		else
			printf("  %s\n  %-24s %s\n", left, "", row[i].help);
	}
}

static void help_all(void)
{
	size_t n;
	const struct scan_command *row = scan_command_rows(&n);

	puts("acut-scan: captures scanners over USB, and brings what they saw into datasets of acutd\n");
	for (size_t i = 0; i < n; i++)
		if (!row[i].hidden)
			printf("  acut-scan %-30s %s\n", row[i].usage, row[i].help);
	puts("\noptions of every command:");
	options(SCAN_ALL);
	puts("\nacut-scan help COMMAND tells a command's options, examples and exit status; man acut-scan tells all.");
}

static void help_one(const struct scan_command *c)
{
	bool any = false;

	printf("acut-scan %s: %s\n\n", c->usage, c->help);
	if (c->groups & SCAN_DEVICE)
		puts("DEVICE is serial:TEXT, port:1-2.4, VENDOR:PRODUCT (hexadecimal) or the name of a profile; where one\n"
		     "known scanner is plugged in it need not be said.\n");
	if (c->groups != SCAN_ALL) {
		head("options:");
		options(c->groups & ~(unsigned)SCAN_ALL);
	}
	head("options of every command:");
	options(SCAN_ALL);
	for (size_t i = 0; i < sizeof(examples) / sizeof(*examples); i++) {
		if (strcmp(examples[i].command, c->name))
			continue;
		if (!any)
			head("examples:");
		any = true;
		printf("  %s\n", examples[i].line);
	}
	head("exit status:");
	puts("  0 done, also where a signal has ended a capture; 1 the device or an input failed; 2 usage;\n"
	     "  3 captured, but the device was unplugged before it was to end; pushed, but some spools were refused;\n"
	     "  4 there is no such device or dataset; 69 no daemon; 74 reading or writing failed, or no space;\n"
	     "  75 not now, try again later; 76 versions; 77 not permitted; 124 the device did not answer in time");
}

int scan_help(const struct scan_args *args)
{
	const struct scan_command *c = scan_command_find(args->command);
	struct err err = ERR_INIT;

	if (c->run == scan_help) {
		if (!args->n) {
			help_all();
			return 0;
		}
		c = scan_command_find(args->inputs[0]);
		if (!c) {
			scan_command_unknown(args->inputs[0], &err);
			return scan_fail(args, &err);
		}
	}
	help_one(c);
	return 0;
}

int scan_version(const struct scan_args *args)
{
	struct term_json j = {.out = stdout};

	if (!args->json) {
		puts("acut-scan " ACUT_VERSION);
		return 0;
	}
	term_json_open(&j, NULL, '{');
	term_json_text(&j, "version", ACUT_VERSION);
	term_json_close(&j, '}');
	term_json_line(&j);
	return 0;
}
