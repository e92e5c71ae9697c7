/*
 * The table of commands, sorted by name. A new command is a file ctl_NAME.c and a row here; help text, man
 * page test and dispatch read this table. Rows without a function are names that a later version will know:
 * they are refused as such, so that nobody takes silence for consent.
 */
#include <string.h>

#include "ctl.h"
#include "cli_guess.h"

#define MANY 100000u

/* Of the commands with verbs. */
static int run_verb(struct ctl *ctl)
{
	return ctl->verb->run(ctl);
}

static const struct ctl_command table[] = {
	{"backup", "backup DIR", "all that was pushed, as of now, into a folder; again: what is new", CTL_ALL | CTL_COPY, 1, 1,
	 false, ctl_backup_run},
	{"cache", "cache stat|verify|gc", "what lies on the daemon's disk, and whether it is sound", CTL_ALL | CTL_CACHE, 1, MANY,
	 false, run_verb, ctl_cache_verbs},
	{"cancel", "cancel JOB...", "end jobs that are not done", CTL_ALL, 1, MANY, false, ctl_cancel_run},
	{"complete", "complete N WORD...", "what could stand as the Nth of these words; for the shells", CTL_ALL, 1, MANY, false,
	 ctl_complete_run, .hidden = true},
	{"config", "config show", "the settings of the daemon", CTL_ALL | CTL_CONFIG, 1, MANY, false, run_verb, ctl_config_verbs},
	{"dataset", "dataset VERB NAME", "what is in one dataset, and what becomes of it",
	 CTL_ALL | CTL_CREATE | CTL_GENERATION | CTL_DATASET | CTL_COPY, 1, MANY, false, run_verb, ctl_dataset_verbs},
	{"datasets", "datasets", "list the datasets", CTL_ALL | CTL_REMOVED, 0, 0, false, ctl_datasets_run},
	{"doctor", "doctor", "look for what is wrong", CTL_ALL, 0, 0, false, ctl_doctor_run},
	{"fetch", "fetch JOB -o OUT", "stream the triangles of a job into files", CTL_ALL | CTL_OUT | CTL_FETCH, 1, 1, false,
	 ctl_fetch_run},
	{"formats", "formats", "what can be read and written", CTL_ALL, 0, 0, false, ctl_formats_run},
	{"geoid", "geoid add|list|rm", "the geoid grids that the daemon keeps", CTL_ALL | CTL_GEOID, 1, MANY, false, run_verb,
	 ctl_geoid_verbs},
	{"help", "help [COMMAND]", "this text, or that of one command", CTL_ALL, 0, 2, false, ctl_help_run},
	{"info", "info INPUT...", "what is in files", CTL_ALL | CTL_OWN | CTL_INPUT | CTL_INFO, 1, MANY, true, ctl_info_run},
	{"ingest", "ingest DATASET FOLDER",
	 "one pass over a drop folder: what has settled is pushed, and moved to done/ or failed/",
	 CTL_ALL | CTL_STAGE | CTL_INPUT | CTL_PUSH | CTL_INGEST, 2, 2, false, ctl_ingest_run},
	{"jobs", "jobs", "list the jobs", CTL_ALL, 0, 0, false, ctl_jobs_run},
	{"mesh", "mesh INPUT... -o OUT", "one step: stage, triangulate, write",
	 CTL_ALL | CTL_STAGE | CTL_MANIFEST | CTL_VIEW | CTL_OUT | CTL_OWN | CTL_INPUT | CTL_JOB, 1, MANY, true, ctl_mesh_run},
	{"metrics", "metrics", "numbers of the daemon for Prometheus", CTL_ALL | CTL_METRICS, 0, 0, false, ctl_metrics_run},
	{"ping", "ping", "ask the daemon for a sign of life", CTL_ALL, 0, 0, false, ctl_ping_run},
	{"plan", "plan DATASET", "domains, memory, disk, time; starts nothing", CTL_ALL | CTL_VIEW | CTL_GENERATION, 1, 1, false,
	 ctl_plan_run},
	{"push", "push DATASET INPUT...", "stage files into a named dataset",
	 CTL_ALL | CTL_STAGE | CTL_MANIFEST | CTL_INPUT | CTL_PUSH | CTL_REPLACES, 2, MANY, false, ctl_push_run},
	{"rm", "rm JOB...", "forget jobs that are over", CTL_ALL, 1, MANY, false, ctl_rm_run},
	{"show", "show JOB", "all that is known of a job", CTL_ALL, 1, 1, false, ctl_show_run},
	{"status", "status", "the daemon: memory, threads, jobs", CTL_ALL, 0, 0, false, ctl_status_run},
	{"submit", "submit DATASET", "queue a job and print its number",
	 CTL_ALL | CTL_VIEW | CTL_GENERATION | CTL_SUBMIT | CTL_JOB, 1, 1, false, ctl_submit_run},
	{"version", "version", "the version of acutctl", CTL_ALL, 0, 0, false, ctl_version_run},
	{"wait", "wait JOB...", "wait until jobs are over", CTL_ALL, 1, MANY, false, ctl_wait_run},
	{"watch", "watch [JOB]", "print each change of a job, or of all", CTL_ALL, 0, 1, false, ctl_watch_run},
};

const struct ctl_verb *ctl_verb_find(const struct ctl_command *c, const char *name)
{
	for (const struct ctl_verb *v = c->verbs; v && v->name; v++)
		if (!strcmp(v->name, name))
			return v;
	return NULL;
}

const struct ctl_command *ctl_command_rows(size_t *ret_n)
{
	*ret_n = sizeof(table) / sizeof(table[0]);
	return table;
}

const struct ctl_command *ctl_command_find(const char *name)
{
	size_t low = 0, high = sizeof(table) / sizeof(table[0]);

	while (low < high) {
		size_t mid = (low + high) / 2;
		int c = strcmp(name, table[mid].name);

		if (!c)
			return &table[mid];
		if (c < 0)
			high = mid;
		else
			low = mid + 1;
	}
	return NULL;
}

/* Also "log" for "dataset log". */
int ctl_command_unknown(const char *name, struct err *err)
{
	struct cli_guess g = {.given = name};
	char buf[128];

	err_set(err, ERR_USAGE, "there is no command %s", name);
	for (size_t i = 0; i < sizeof(table) / sizeof(table[0]); i++) {
		if (ctl_verb_find(&table[i], name))
			return err_add_hint(err, "did you mean acutctl %s %s? acutctl help lists the commands", table[i].name,
					    name);
		if (table[i].run && !table[i].hidden)
			cli_guess_offer(&g, table[i].name);
	}
	return err_add_hint(err, "%sacutctl help lists the commands", cli_guess_text(&g, "acutctl ", buf));
}
