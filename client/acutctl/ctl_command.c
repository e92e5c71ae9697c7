/*
 * The commands of acutctl, sorted by name, and the texts of help that are not in the tables. A new command is a file ctl_NAME.c
 * and a row here.
 */
#include "ctl.h"

#define MANY 100000u

static const struct cli_command commands[] = {
	{"backup", "backup DIR", "copy all that was pushed into a folder; again: only what is new", CLI_ALL | CTL_COPY, 1, 1,
	 ctl_backup_run, NULL, "backup /mnt/backup/acut"},
	{"cache", "cache stat|verify|gc", "use of the daemon's disk; check and clean it", CLI_ALL | CTL_CACHE, 1, MANY, NULL,
	 ctl_cache_verbs, "cache stat\ncache gc --all"},
	{"cancel", "cancel JOB...", "end unfinished jobs", CLI_ALL, 1, MANY, ctl_cancel_run, NULL, "cancel 12"},
	{"config", "config show", "the settings of the daemon", CLI_ALL | CTL_CONFIG, 1, MANY, NULL, ctl_config_verbs,
	 "config show --origin"},
	{"dataset", "dataset VERB NAME", "show, change, restore or copy one dataset",
	 CLI_ALL | CTL_CREATE | CTL_GENERATION | CTL_DATASET | CTL_COPY, 1, MANY, NULL, ctl_dataset_verbs,
	 "dataset show valley\ndataset log valley --files\ndataset revert valley 7"},
	{"datasets", "datasets", "list the datasets", CLI_ALL | CTL_REMOVED, 0, 0, ctl_datasets_run, NULL,
	 "datasets\ndatasets --removed"},
	{"doctor", "doctor", "check the daemon and report problems", CLI_ALL, 0, 0, ctl_doctor_run, NULL, "doctor"},
	{"fetch", "fetch JOB -o OUT", "stream the triangles of a job into files", CLI_ALL | CTL_OUT | CTL_FETCH, 1, 1,
	 ctl_fetch_run, NULL, "fetch 12 -o valley.ply -o valley.png\nfetch 12 -o valley.ply --resume"},
	{"formats", "formats", "list the formats of inputs and outputs", CLI_ALL, 0, 0, ctl_formats_run, NULL, "formats"},
	{"geoid", "geoid add|list|rm", "add, list or remove geoid grids of the daemon", CLI_ALL | CTL_GEOID, 1, MANY, NULL,
	 ctl_geoid_verbs, "geoid add egm2008-1.pgm"},
	{"help", "help [COMMAND]", "this text, or that of one command", CLI_ALL, 0, 2, NULL, NULL, "help mesh"},
	{"info", "info INPUT...", "print the content of input files", CLI_ALL | CTL_OWN | CTL_INPUT | CTL_INFO, 1, MANY,
	 ctl_info_run, NULL, "info survey.laz\ninfo --header monday/"},
	{"ingest", "ingest DATASET FOLDER", "one pass over a drop folder: push settled files, move them to done/ or failed/",
	 CLI_ALL | CTL_STAGE | CTL_INPUT | CTL_PUSH | CTL_INGEST, 2, 2, ctl_ingest_run, NULL,
	 "ingest valley /data/incoming --settle 60"},
	{"jobs", "jobs", "list the jobs", CLI_ALL, 0, 0, ctl_jobs_run, NULL, "jobs"},
	{"mesh", "mesh INPUT... -o OUT", "one step: stage, triangulate, write",
	 CLI_ALL | CTL_STAGE | CTL_MANIFEST | CTL_VIEW | CTL_OUT | CTL_OWN | CTL_INPUT | CTL_JOB | CTL_LINES, 1, MANY,
	 ctl_mesh_run, NULL, "mesh survey.laz -o survey.ply\nmesh monday/ --ground --max-edge 30m -o ground.ply -o ground.png"},
	{"metrics", "metrics", "numbers of the daemon for Prometheus", CLI_ALL | CTL_METRICS, 0, 0, ctl_metrics_run, NULL,
	 "metrics --textfile /run/acut-metrics/acut.prom"},
	{"ping", "ping", "check that the daemon answers", CLI_ALL, 0, 0, ctl_ping_run, NULL, "ping"},
	{"plan", "plan DATASET", "estimate domains, memory, disk and time; starts nothing", CLI_ALL | CTL_VIEW | CTL_GENERATION,
	 1, 1, ctl_plan_run, NULL, "plan valley --ground"},
	{"push", "push DATASET INPUT...", "stage files into a named dataset",
	 CLI_ALL | CTL_STAGE | CTL_MANIFEST | CTL_INPUT | CTL_PUSH | CTL_REPLACES, 2, MANY, ctl_push_run, NULL,
	 "push valley monday/\npush valley --replace delivery-2/ --manifest delivery-2/SHA256SUMS\npush valley roads.shp --lines-as hard"},
	{"rm", "rm JOB...", "remove finished jobs", CLI_ALL, 1, MANY, ctl_rm_run, NULL, "rm 12 13"},
	{"show", "show JOB", "print all of a job", CLI_ALL, 1, 1, ctl_show_run, NULL, "show 12"},
	{"status", "status", "the daemon: memory, threads, jobs", CLI_ALL, 0, 0, ctl_status_run, NULL, "status --json"},
	{"submit", "submit DATASET", "queue a job and print its number",
	 CLI_ALL | CTL_VIEW | CTL_GENERATION | CTL_SUBMIT | CTL_JOB, 1, 1, ctl_submit_run, NULL,
	 "submit valley --wait\nsubmit valley --ground --at 3"},
	{"version", "version", "the version of acutctl", CLI_ALL, 0, 0, ctl_version_run, NULL, "version"},
	{"volume", "volume JOB [JOB]", "cut and fill between two meshes, or above a level", CLI_ALL | CTL_VOLUME, 1, 2,
	 ctl_volume_run, NULL,
	 "volume 12 15\nvolume 12 15 --within plots.geojson --csv\nvolume 12 15 --cell 1m -o change.png\nvolume 12 --level 55.5"},
	{"wait", "wait JOB...", "wait until jobs are finished", CLI_ALL, 1, MANY, ctl_wait_run, NULL, "wait 12 13"},
	{"watch", "watch [JOB]", "print the changes of a job, or of all jobs", CLI_ALL, 0, 1, ctl_watch_run, NULL, "watch"},
};

static const char *words(const struct cli_command *c)
{
	if (!(c->groups & CTL_INPUT))
		return "";
	return "INPUT is a file, a folder (its survey files), @LIST (names, one a line) or - (standard input), or a named pipe.\n\n";
}

#define STATUSES(more)                                                                                    \
	"  0 done; 1 the job or an input failed; 2 usage" more ";\n"                                      \
	"  4 there is no such job or dataset; 69 no daemon; 74 reading or writing failed, or no space;\n" \
	"  75 not now, try again later; 76 versions; 77 not permitted; 124 --timeout has passed\n"

static const char *statuses(const struct cli_command *c)
{
	return c->groups & CTL_INPUT ? STATUSES("; 3 done, but some inputs were refused") : STATUSES("");
}

struct cli ctl_cli(void)
{
	return (struct cli){.program = "acutctl",
			    .about = "terrain meshes from survey points, through acutd",
			    .command = commands,
			    .ncommand = sizeof(commands) / sizeof(*commands),
			    .option = ctl_options,
			    .noption = ctl_noptions,
			    .scope_at = offsetof(struct program, fetch.output),
			    .scope_size = sizeof(struct ctl_fetch_output),
			    .scopes = CTL_FETCH_OUTPUTS + 1,
			    .words = words,
			    .statuses = statuses};
}
