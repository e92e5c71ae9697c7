/*
 * The commands and options of acut-scan. A new command is a file scan_NAME.c and a row here. Numbers are read strictly, so that a
 * command sees only valid ones.
 */
#include <stddef.h>

#include "scan.h"

#define AT(field) offsetof(struct program, field)

static const struct cli_command commands[] = {
	{"help", "help [COMMAND]", "this text, or that of one command", CLI_ALL, 0, 1, NULL, NULL, "help record"},
	{"list", "list", "the scanners that are plugged in", CLI_ALL | SCAN_PROFILES | SCAN_LIST, 0, 0, scan_list, NULL,
	 "list\nlist --all --json"},
	{"probe", "probe [DEVICE]", "listen to a scanner for a second, and report its data",
	 CLI_ALL | SCAN_PROFILES | SCAN_DEVICE | SCAN_PROBE, 0, 1, scan_probe, NULL, "probe\nprobe serial:20370043"},
	{"profiles", "profiles [FILE...]", "the kinds of scanners that are known; checks files of them",
	 CLI_ALL | SCAN_PROFILES | SCAN_KINDS, 0, 100000, scan_profiles, NULL, "profiles\nprofiles my-scanner.conf"},
	{"push", "push SPOOL... --into DATASET", "decode a spool, put it on the ground by a pose file, into a dataset",
	 CLI_ALL | SCAN_PROFILES | SCAN_PUSH, 1, 100000, scan_push, NULL, "push monday.spool --pose monday.csv --into valley"},
	{"record", "record [DEVICE]", "capture the data of a scanner into a spool",
	 CLI_ALL | SCAN_PROFILES | SCAN_DEVICE | SCAN_RECORD, 0, 1, scan_record, NULL,
	 "record -o monday.spool\nrecord serial:20370043 --folder /var/lib/acut-scan --reconnect\nrecord --from dump.bin --profile sick-tim -o monday.spool"},
	{"replay", "replay SPOOL...", "decode spools again: check, count, or write out their content",
	 CLI_ALL | SCAN_PROFILES | SCAN_REPLAY, 1, 100000, scan_replay, NULL,
	 "replay monday.spool\nreplay monday.spool --to raw -o dump.bin"},
	{"version", "version", "the version of acut-scan", CLI_ALL, 0, 0, scan_version, NULL, "version"},
};

static const struct cli_option options[] = {
	{"output", 'o', "FILE", CLI_WORD, AT(output), SCAN_RECORD | SCAN_REPLAY | SCAN_PUSH,
	 "write there; never over a file that is there"},
	{"folder", 0, "DIR", CLI_WORD, AT(folder), SCAN_RECORD, "a new spool in this folder: PROFILE-SERIAL-TIME.spool"},
	{"from", 0, "FILE|-", CLI_WORD, AT(from), SCAN_RECORD, "take the bytes of a file or pipe, not those of a device"},
	{"continue", 0, NULL, CLI_FLAG, AT(resume), SCAN_RECORD,
	 "go on in the spool of -o, which a crash has left without its end"},
	{"reconnect", 0, NULL, CLI_FLAG, AT(reconnect), SCAN_RECORD,
	 "when the device is unplugged, wait for it and go on in the same spool"},
	{"for", 0, "TIME", CLI_SECONDS, AT(seconds), SCAN_RECORD | SCAN_PROBE, "stop after so long: 90, 90s, 5m, 2h"},
	{"bytes", 0, "SIZE", CLI_SIZE, AT(bytes), SCAN_RECORD, "stop after so many bytes: 512M, 2G"},
	{"sync", 0, "TIME", CLI_SECONDS, AT(sync_s), SCAN_RECORD, "make data durable at least this often (1s)"},
	{"to", 0, "raw|telegrams|sweeps|csv|points", CLI_WORD, AT(to), SCAN_REPLAY, "what to write"},

	{"into", 0, "DATASET", CLI_WORD, AT(into), SCAN_PUSH, "the dataset; made if there is none"},
	{"pose", 0, "FILE", CLI_WORD, AT(pose), SCAN_PUSH, "where the scanner was: a CSV of times, positions and attitudes"},
	{"pose-clock", 0, "utc|gps", CLI_WORD, AT(pose_clock), SCAN_PUSH, "clock of the times of the pose file (utc)"},
	{"pose-offset", 0, "SECONDS", CLI_NUMBER, AT(pose_offset_s), SCAN_PUSH, "added to the times of the pose file"},
	{"gap", 0, "TIME", CLI_SECONDS, AT(gap_s), SCAN_PUSH, "poses further apart than this leave a gap (1.5s)"},
	{"heading", 0, "true|grid", CLI_WORD, AT(heading), SCAN_PUSH,
	 "headings are from true north (degrees), or from the plane's north"},
	{"grid-scale", 0, NULL, CLI_FLAG, AT(grid_scale), SCAN_PUSH,
	 "shorten or lengthen ranges as the plane does lengths where the scanner is"},
	{"geoid", 0, "NAME", CLI_WORD, AT(geoid), SCAN_PUSH, "make ellipsoidal heights orthometric by this grid of the daemon"},
	{"replace", 0, NULL, CLI_FLAG, AT(replace), SCAN_PUSH, "in place of the points of the spool in the dataset"},
	{"crs", 0, "CRS", CLI_WORD, AT(crs), SCAN_PUSH,
	 "the plane of the poses, or the datum of their degrees: EPSG:n, or a name"},
	{"utm", 0, "ZONE", CLI_WORD, AT(utm), SCAN_PUSH, "project degrees to this zone (32N, 5S), not to that of their middle"},
	{"name", 0, "NAME", CLI_WORD, AT(name), SCAN_PUSH, "the name under which the dataset keeps it (the spool's)"},
	{"socket", 0, "PATH", CLI_WORD, AT(socket), SCAN_PUSH, "where the daemon listens"},

	{"device", 'd', "DEVICE", CLI_WORD, AT(device), SCAN_DEVICE,
	 "which one: serial:TEXT, port:1-2.4, VENDOR:PRODUCT, or a profile's name"},
	{"profile", 0, "NAME|FILE", CLI_WORD, AT(profile), SCAN_DEVICE | SCAN_REPLAY | SCAN_PUSH,
	 "this profile, not that which the device or the spool asks for"},
	{"profiles", 0, "DIR", CLI_LIST, AT(profiles), SCAN_PROFILES,
	 "a folder of profiles, in place of the usual ones; may be repeated"},
	{"all", 'a', NULL, CLI_FLAG, AT(all), SCAN_LIST, "all devices, not only those with a profile"},
	{"watch", 0, NULL, CLI_FLAG, AT(watch), SCAN_LIST, "print a line for each device that comes or leaves"},
	{"udev", 0, NULL, CLI_FLAG, AT(udev), SCAN_KINDS, "print udev rules: all, or lines of the profiles named"},

	{"json", 0, NULL, CLI_FLAG, AT(console.json), CLI_ALL, "results and errors as JSON"},
	{"quiet", 'q', NULL, CLI_FLAG, AT(console.quiet), CLI_ALL, "print only errors and results"},
	{"no-progress", 0, NULL, CLI_FLAG, AT(console.no_progress), CLI_ALL, "no progress line"},
	{"help", 'h', NULL, CLI_FLAG, 0, CLI_ALL, "print help"},
};

static const char *words(const struct cli_command *c)
{
	if (!(c->groups & SCAN_DEVICE))
		return "";
	return "DEVICE is serial:TEXT, port:1-2.4, VENDOR:PRODUCT (hexadecimal) or the name of a profile; where one\n"
	       "known scanner is plugged in it need not be said.\n\n";
}

static const char *statuses(const struct cli_command *c)
{
	return "  0 done, also where a signal has ended a capture; 1 the device or an input failed; 2 usage;\n"
	       "  3 captured, but the device was unplugged before it was to end; pushed, but some spools were refused;\n"
	       "  4 there is no such device or dataset; 69 no daemon; 74 reading or writing failed, or no space;\n"
	       "  75 not now, try again later; 76 versions; 77 not permitted; 124 the device did not answer in time\n";
}

struct cli scan_cli(void)
{
	return (struct cli){.program = "acut-scan",
			    .about = "captures scanners over USB, and pushes their points into datasets of acutd",
			    .command = commands,
			    .ncommand = sizeof(commands) / sizeof(*commands),
			    .option = options,
			    .noption = sizeof(options) / sizeof(*options),
			    .words = words,
			    .statuses = statuses};
}

bool scan_offer(struct cli_typed *t, const char *kind, size_t n)
{
	if (!cli_is_kind(kind, n, "SPOOL"))
		return false;
	puts(":files .spool");
	return true;
}

int scan_version(struct program *args)
{
	struct term_json j = {.out = stdout};

	if (!args->console.json) {
		puts("acut-scan " ACUT_VERSION);
		return 0;
	}
	term_json_open(&j, NULL, '{');
	term_json_text(&j, "version", ACUT_VERSION);
	term_json_end(&j);
	return 0;
}
