/*
 * The table of commands, sorted by name. A new command is a file scan_NAME.c and a row here; help text, completion,
 * the test of the man page and the dispatch read this table.
 */
#include <string.h>

#include "cli_guess.h"
#include "err.h"
#include "scan.h"

static const struct scan_command table[] = {
	{"help", "help [COMMAND]", "this text, or that of one command", SCAN_ALL, 0, 1, scan_help},
	{"list", "list", "the scanners that are plugged in", SCAN_ALL | SCAN_PROFILES | SCAN_LIST, 0, 0, scan_list},
	{"probe", "probe [DEVICE]", "listen to a scanner for a second, and say what came",
	 SCAN_ALL | SCAN_PROFILES | SCAN_DEVICE | SCAN_PROBE, 0, 1, scan_probe},
	{"profiles", "profiles [FILE...]", "the kinds of scanners that are known; checks files of them",
	 SCAN_ALL | SCAN_PROFILES | SCAN_KINDS, 0, 100000, scan_profiles},
	{"push", "push SPOOL... --into DATASET", "decode a spool, put it on the ground by a pose file, into a dataset",
	 SCAN_ALL | SCAN_PROFILES | SCAN_PUSH, 1, 100000, scan_push},
	{"record", "record [DEVICE]", "capture what a scanner sends into a spool",
	 SCAN_ALL | SCAN_PROFILES | SCAN_DEVICE | SCAN_RECORD, 0, 1, scan_record},
	{"replay", "replay SPOOL...", "decode spools again: check, count, or write out what is in them",
	 SCAN_ALL | SCAN_PROFILES | SCAN_REPLAY, 1, 100000, scan_replay},
	{"version", "version", "the version of acut-scan", SCAN_ALL, 0, 0, scan_version},
};

const struct scan_command *scan_command_rows(size_t *ret_n)
{
	*ret_n = sizeof(table) / sizeof(table[0]);
	return table;
}

const struct scan_command *scan_command_find(const char *name)
{
	for (size_t i = 0; i < sizeof(table) / sizeof(table[0]); i++)
		if (!strcmp(table[i].name, name))
			return &table[i];
	return NULL;
}

int scan_command_unknown(const char *name, struct err *err)
{
	struct cli_guess g = {.given = name};
	char buf[128];

	err_set(err, ERR_USAGE, "there is no command %s", name);
	for (size_t i = 0; i < sizeof(table) / sizeof(table[0]); i++)
		if (!table[i].hidden)
			cli_guess_offer(&g, table[i].name);
	return err_add_hint(err, "%sacut-scan help lists the commands", cli_guess_text(&g, "acut-scan ", buf));
}
