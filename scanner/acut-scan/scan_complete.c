/*
 * complete N WORD...: what could stand as the Nth of the words (the 0th is acut-scan itself), for the shells, whose
 * functions (acut-scan.bash, _acut-scan) only show it. The source are the tables of commands and options.
 *
 * A line a candidate: the word, a tab, what it is. Or, once: ":files", ":files .spool" or ":folders". What only a look
 * at the bus would tell is not offered: completion opens no device.
 */
#include <string.h>

#include "parse.h"
#include "scan.h"

static void offer(const char *begun, const char *word, const char *what)
{
	if (!strncmp(word, begun, strlen(begun)))
		printf("%s\t%s\n", word, what);
}

static bool is(const char *word, size_t n, const char *kind)
{
	return strlen(kind) == n && !memcmp(word, kind, n);
}

static void offer_commands(const char *begun)
{
	size_t n;
	const struct scan_command *row = scan_command_rows(&n);

	for (size_t i = 0; i < n; i++)
		if (!row[i].hidden)
			offer(begun, row[i].name, row[i].help);
}

/* "telegrams|sweeps|raw", "NAME|FILE", "DIR", "SPOOL...". */
static void offer_value(const char *begun, const char *value, size_t size, const char *what)
{
	char word[64];

	while (size) {
		const char *bar = memchr(value, '|', size);
		size_t n = bar ? (size_t)(bar - value) : size;

		if (is(value, n, "DIR"))
			puts(":folders");
		else if (is(value, n, "SPOOL"))
			puts(":files .spool");
		else if (is(value, n, "FILE") || is(value, n, "PATH"))
			puts(":files");
		else if (is(value, n, "COMMAND"))
			offer_commands(begun);
		else if (n && n < sizeof(word) && value[0] >= 'a' && value[0] <= 'z') {
			snprintf(word, sizeof(word), "%.*s", (int)n, value);
			offer(begun, word, what);
		}
		n += bar != NULL;
		value += n;
		size -= n;
	}
}

static const struct scan_option *find_option(const char *word)
{
	size_t n, len = strcspn(word, "=");
	const struct scan_option *row = scan_option_rows(&n);

	for (size_t i = 0; i < n; i++)
		if (word[1] == '-' ? is(word + 2, len - 2, row[i].name) : row[i].letter == word[1] && !word[2])
			return &row[i];
	return NULL;
}

static void offer_options(const struct scan_command *c, const char *begun)
{
	size_t n;
	const struct scan_option *row = scan_option_rows(&n);
	char word[64];

	for (size_t i = 0; i < n; i++)
		if (row[i].groups & (c ? c->groups : SCAN_ALL)) {
			snprintf(word, sizeof(word), "--%s", row[i].name);
			offer(begun, word, row[i].help);
		}
}

/* The one word that the usage names behind the command; of "WORD..." all. */
static void offer_words(const struct scan_command *c, unsigned nth, const char *begun)
{
	const char *word = strchr(c->usage, ' ');
	size_t size;

	if (!word)
		return;
	word += 1 + (word[1] == '[');
	size = strcspn(word, " ].");
	if (!nth || word[size] == '.')
		offer_value(begun, word, size, "");
}

int scan_complete(int argc, char **argv)
{
	const struct scan_command *command = NULL;
	const struct scan_option *option = NULL;
	char **word = argv + 3;
	unsigned words = (unsigned)argc - 3, plain = 0;
	const char *begun;
	bool ended = false, named = false;
	uint64_t at;

	if (!parse_u64(argv[2], &at) || !at || at > words)
		return 2;
	begun = at < words && strcmp(word[at], "=") ? word[at] : "";
	for (unsigned i = 1; i < at; i++) {
		if (!ended && !strcmp(word[i], "--")) {
			ended = true;
		} else if (!ended && word[i][0] == '-' && word[i][1]) {
			const struct scan_option *o = find_option(word[i]);

			if (!o || !o->value || strchr(word[i], '='))
				continue;
			if (i + 1 < at && !strcmp(word[i + 1], "=")) /* taken apart by the shell */
				i++;
			if (i + 1 >= at)
				option = o;
			i++;
		} else if (!named) {
			named = true;
			command = scan_command_find(word[i]);
		} else {
			plain++;
		}
	}
	if (!option && !ended && !strncmp(begun, "--", 2) && strchr(begun, '=')) {
		option = find_option(begun);
		begun = strchr(begun, '=') + 1;
	}
	if (option && option->value)
		offer_value(begun, option->value, strlen(option->value), option->help);
	else if (!ended && begun[0] == '-')
		offer_options(command, begun);
	else if (!named)
		offer_commands(begun);
	else if (command)
		offer_words(command, plain, begun);
	return 0;
}
