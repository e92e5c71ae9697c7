/*
 * "complete N WORD..." for the shells, whose functions (cli.bash.in, cli.zsh.in) only show what it prints. Commands, verbs
 * and options come from the tables; candidates of a kind of words come from the program.
 */
#include <string.h>

#include "cli.h"
#include "parse.h"

typedef bool kind_fn(struct cli_typed *, const char *name, size_t n);

bool cli_is_kind(const char *name, size_t n, const char *kind)
{
	return strlen(kind) == n && !memcmp(name, kind, n);
}

void cli_offer(const struct cli_typed *t, const char *word, const char *what)
{
	if (!strncmp(word, t->begun, strlen(t->begun)) && !strpbrk(word, "\n\t"))
		printf("%s\t%s\n", word, what);
}

static void offer_commands(const struct cli_typed *t)
{
	for (size_t i = 0; i < t->cli->ncommand; i++)
		cli_offer(t, t->cli->command[i].name, t->cli->command[i].help);
}

static void offer_verbs(const struct cli_typed *t, const struct cli_command *c)
{
	for (const struct cli_verb *v = c ? c->verbs : NULL; v && v->name; v++)
		cli_offer(t, v->name, v->help);
}

static void offer_options(const struct cli_typed *t)
{
	char word[64];

	for (const struct cli_option *o = t->cli->option; o < t->cli->option + t->cli->noption; o++) {
		if (!cli_takes(t->command, t->verb, o))
			continue;
		snprintf(word, sizeof(word), "--%s", o->name);
		cli_offer(t, word, o->help);
	}
}

/* One alternative of a usage: a kind of words, or the word itself. */
static void offer_kind(struct cli_typed *t, const char *kind, size_t n, const char *what, kind_fn *offer)
{
	char word[64];

	if (offer(t, kind, n) || !n || n >= sizeof(word))
		return;
	if (cli_is_kind(kind, n, "FILE") || cli_is_kind(kind, n, "OUT") || cli_is_kind(kind, n, "PATH")) {
		puts(":files");
	} else if (cli_is_kind(kind, n, "DIR") || cli_is_kind(kind, n, "FOLDER")) {
		puts(":folders");
	} else if (cli_is_kind(kind, n, "COMMAND")) {
		offer_commands(t);
	} else if (kind[0] >= 'a' && kind[0] <= 'z') {
		snprintf(word, sizeof(word), "%.*s", (int)n, kind);
		cli_offer(t, word, what);
	}
}

/* "low|normal|high", "DATASET", "X,Y,Z|auto". */
static void offer_alternatives(struct cli_typed *t, const char *text, size_t size, const char *what, kind_fn *offer)
{
	while (size) {
		const char *bar = memchr(text, '|', size);
		size_t n = bar ? (size_t)(bar - text) : size;

		offer_kind(t, text, n, what, offer);
		n += bar != NULL;
		text += n;
		size -= n;
	}
}

/* The word of the usage in this place: the nth, or the last one if it may be repeated ("..."). */
static void offer_words(struct cli_typed *t, kind_fn *offer)
{
	const char *usage = t->verb ? t->verb->usage : t->command->usage;
	unsigned at = 0;

	for (const char *word = usage + strcspn(usage, " "); *(word += strspn(word, " ")) && *word != '-';) {
		size_t size = strcspn(word, " "), from = *word == '[', to = size - (word[size - 1] == ']');
		bool repeats = to > 3 && !memcmp(word + to - 3, "...", 3);

		if (repeats)
			to -= word[to - 4] == ']' ? 4 : 3;
		if (at++ == t->nword || repeats) {
			offer_alternatives(t, word + from, to - from, "", offer);
			return;
		}
		word += size;
	}
}

/* Reads the words before the one to be completed. "=" is a word of its own where the shell has split --option=value. */
static void read_line(struct cli_typed *t, char **word, unsigned n)
{
	static const struct cli_command none = {.name = "", .usage = "", .most = 0};

	for (unsigned i = 1; i < n; i++) {
		const struct cli_option *o;

		if (!t->ended && !strcmp(word[i], "--")) {
			t->ended = true;
		} else if (!t->ended && word[i][0] == '-' && word[i][1]) {
			o = cli_find_option(t->cli, word[i], t->command);
			if (!o || !o->value || strchr(word[i], '=') || (word[i][1] != '-' && word[i][2]))
				continue;
			i += i + 1 < n && !strcmp(word[i + 1], "=");
			if (++i >= n)
				t->option = o;
			else if (o->kind == CLI_TEXT)
				*(const char **)((char *)t->program + o->at) = word[i];
		} else if (!t->command) {
			t->command = cli_find_command(t->cli, word[i]);
			t->command = t->command ? t->command : &none;
		} else if (t->command->verbs && !t->verb) {
			t->verb = cli_find_verb(t->command, word[i]);
		} else if (t->nword < sizeof(t->word) / sizeof(*t->word)) {
			t->word[t->nword++] = word[i];
		}
	}
}

int cli_complete(const struct cli *cli, int argc, char **argv, struct program *program, kind_fn *kind)
{
	struct cli_typed t = {.cli = cli, .program = program, .begun = ""};
	char **word = argv + 3;
	uint64_t n;

	if (argc < 4 || !parse_u64(argv[2], &n) || !n || n > (uint64_t)argc - 3)
		return CLI_USAGE;
	if (n < (uint64_t)argc - 3 && strcmp(word[n], "="))
		t.begun = word[n];
	read_line(&t, word, (unsigned)n);
	if (!t.option && !t.ended && !strncmp(t.begun, "--", 2) && strchr(t.begun, '=')) {
		t.option = cli_find_option(cli, t.begun, t.command);
		t.begun = strchr(t.begun, '=') + 1;
	}
	if (t.option && t.option->value)
		offer_alternatives(&t, t.option->value, strlen(t.option->value), t.option->help, kind);
	else if (!t.ended && t.begun[0] == '-')
		offer_options(&t);
	else if (!t.command)
		offer_commands(&t);
	else if (t.command->verbs && !t.verb)
		offer_verbs(&t, t.command);
	else if (!strcmp(t.command->name, "help") && t.nword)
		offer_verbs(&t, t.nword == 1 ? cli_find_command(cli, t.word[0]) : NULL);
	else
		offer_words(&t, kind);
	return 0;
}
