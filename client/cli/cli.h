/*
 * The command line of a program as tables: commands, their verbs, options. Parsing, refusals that name the nearest word, help
 * and completion read them; nothing else knows what a program understands.
 *
 * In usages and values, words in lower case are literal (all|first|last), and capitals name a kind (JOB, DATASET, FILE).
 */
#ifndef CLI_H
#define CLI_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

struct err;
struct program; /* what the commands of a program work with; each program defines its own */

enum { CLI_USAGE = 2 /* exit status */, CLI_TEXTS = 16 };

/* The values of an option that may be repeated; a NULL ends them. */
struct cli_texts {
	const char *text[CLI_TEXTS + 1];
	unsigned n;
};

enum cli_kind {
	CLI_FLAG,    /* bool */
	CLI_TEXT,    /* const char *; NULL: not given */
	CLI_WORD,    /* likewise, and not empty */
	CLI_LIST,    /* struct cli_texts */
	CLI_SCOPE,   /* const char *; opens the next scope (struct cli) */
	CLI_SECONDS, /* double, above zero */
	CLI_SIZE,    /* uint64_t, above zero */
	CLI_NUMBER,  /* double */
	CLI_COUNT,   /* uint64_t, a whole number above zero */
	CLI_MANY,    /* likewise, also in thousands and millions: 12k, 1.5M, 1G */
};

/* An option is allowed where its groups meet those of the command. */
enum { CLI_ALL = 1 }; /* every command; the other groups are the program's */

struct cli_option {
	const char *name; /* without the dashes */
	char letter;
	const char *value; /* what follows; NULL: nothing */
	enum cli_kind kind;
	size_t at; /* in struct program */
	unsigned groups;
	const char *help;
};

/* A verb of a command: "show" of "dataset show". */
struct cli_verb {
	const char *name, *usage, *help;
	unsigned least, most; /* words after the verb */
	const char *options;  /* of the command's own options those that it takes: "at scale"; NULL: none */
	int (*run)(struct program *);
};

struct cli_command {
	const char *name, *usage, *help;
	unsigned groups, least, most; /* least, most: words after it */
	int (*run)(struct program *); /* NULL: help */
	const struct cli_verb *verbs; /* up to one without a name; the words begin with one of them, which runs */
	const char *examples;         /* a line each */
};

struct cli {
	const char *program, *about;
	const struct cli_command *command; /* sorted by name */
	size_t ncommand;
	const struct cli_option *option;
	size_t noption;
	/* Options that may be given once a scope: those whose place is in the first of `scopes` structs of `scope_size` bytes at
	 * `scope_at` in struct program. The first struct has those before any option of kind CLI_SCOPE; each of these opens the
	 * next. */
	size_t scope_at, scope_size;
	unsigned scopes;
	/* Paragraphs of the help of a command: what kinds of words it takes, and its exit statuses. */
	const char *(*words)(const struct cli_command *);
	const char *(*statuses)(const struct cli_command *);
};

/* A command line without its options, which are in struct program. */
struct cli_line {
	const struct cli_command *command;
	const struct cli_verb *verb; /* of a command with verbs */
	char **word;                 /* after command and verb; freed by cli_done */
	unsigned nword;
	bool help;
	char **all; /* with the verb */
};

/* Fills the options of *program and *ret. -ERR_USAGE, -ERR_UNSUPPORTED; *ret is to be done with in any case. */
int cli_parse(const struct cli *, int argc, char **argv, struct program *, struct cli_line *ret, struct err *err);
void cli_done(struct cli_line *);
/* Runs the command, or prints help. Exit status; -ERR_USAGE. */
int cli_run(const struct cli *, const struct cli_line *, struct program *, FILE *out, struct err *err);
/* A whole number from `least` to `most`; `name` is what messages call it. -ERR_USAGE. */
int cli_number(const char *name, const char *text, uint64_t least, uint64_t most, uint64_t *ret, struct err *err);

/* ---- completion ---- */

/* A command line that is being typed, up to the word that is to be completed. */
struct cli_typed {
	const struct cli *cli;
	struct program *program;
	const char *begun; /* what is there of the word */
	const struct cli_command *command;
	const struct cli_verb *verb;
	const struct cli_option *option; /* the word is its value; NULL: it is not a value */
	const char *word[8];             /* after command and verb */
	unsigned nword;
	bool ended; /* "--" came before */
};

/*
 * "complete N WORD...": prints the candidates for the Nth of the words (the 0th is the program), one a line with a tab and a
 * description; or ":files", ":files .las .laz" or ":folders". `kind` offers the candidates of a kind of words, and returns
 * false for kinds that the program does not know. Text options are read into *program. Exit status.
 */
int cli_complete(const struct cli *, int argc, char **argv, struct program *,
		 bool (*kind)(struct cli_typed *, const char *name, size_t n));
bool cli_is_kind(const char *name, size_t n, const char *kind);
void cli_offer(const struct cli_typed *, const char *word, const char *what);

/* ---- for the files of this room ---- */

const struct cli_command *cli_find_command(const struct cli *, const char *name); /* NULL: there is none */
const struct cli_verb *cli_find_verb(const struct cli_command *, const char *name);
/* "--name=value", "--name" or "-n". Of several options of a name that of the command, if there is one. */
const struct cli_option *cli_find_option(const struct cli *, const char *arg, const struct cli_command *);
bool cli_takes(const struct cli_command *, const struct cli_verb *, const struct cli_option *);
/* Errors with the nearest word. */
int cli_unknown_command(const struct cli *, const char *name, struct err *err);
int cli_unknown_verb(const struct cli *, const struct cli_command *, const char *word, struct err *err);
void cli_help(const struct cli *, const struct cli_command * /* NULL: all */, FILE *out);

#endif
