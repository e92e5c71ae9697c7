/* The commands of acut-cluster, sorted by name, and the texts of help that are not in the tables. */
#include "cluster.h"

#define MANY 100000u
#define RUN CLUSTER_INPUT | CLUSTER_RUN | CLUSTER_SCHEDULER

static const struct cli_command commands[] = {
	{"cancel", "cancel WORK", "end all tasks; resume goes on", CLI_ALL, 1, 1, cluster_cancel_run, NULL,
	 "cancel /lustre/valley"},
	{"clean", "clean WORK", "remove the work folder of a run that is done", CLI_ALL | CLUSTER_CLEAN, 1, 1, cluster_clean_run,
	 NULL, "clean /lustre/valley"},
	{"help", "help [COMMAND]", "this text, or that of one command", CLI_ALL, 0, 1, NULL, NULL, "help mesh"},
	{"mesh", "mesh INPUT... -o OUT", "inputs to a mesh, by tasks of a cluster",
	 CLI_ALL | RUN | CLUSTER_VIEW | CLUSTER_NEW | CLUSTER_WAIT | CLUSTER_SCRIPT, 0, MANY, cluster_mesh_run, NULL,
	 "mesh tiles/ -o out/ --tile 1000 --work /lustre/valley --on slurm\nmesh tiles/ -o valley.ply --work /data/valley --on local"},
	{"plan", "plan INPUT...", "how many tasks, bytes and core-hours a run takes; submits nothing",
	 CLI_ALL | RUN | CLUSTER_VIEW, 0, MANY, cluster_plan_run, NULL, "plan tiles/ --task-seconds 300"},
	{"resume", "resume WORK", "submit again what is missing", CLI_ALL | CLUSTER_SCHEDULER | CLUSTER_WAIT | CLUSTER_SCRIPT, 1,
	 1, cluster_resume_run, NULL, "resume /lustre/valley --wait"},
	{"show", "show WORK", "how far a run is", CLI_ALL, 1, 1, cluster_show_run, NULL, "show /lustre/valley"},
	{"stage", "stage INPUT...", "inputs to a dataset, for acutctl dataset import",
	 CLI_ALL | RUN | CLUSTER_NEW | CLUSTER_WAIT | CLUSTER_SCRIPT, 0, MANY, cluster_stage_run, NULL,
	 "stage tiles/ --work /lustre/valley --on slurm"},
	{"version", "version", "the version of acut-cluster", CLI_ALL, 0, 0, cluster_version_run, NULL, "version"},
	{"wait", "wait WORK", "wait until a run is done, and submit again what was lost", CLI_ALL, 1, 1, cluster_wait_run, NULL,
	 "wait /lustre/valley"},
};

static const char *words(const struct cli_command *c)
{
	if (c->groups & CLUSTER_INPUT)
		return "INPUT is a file, a folder (its survey files) or @LIST (names, one a line), which all nodes see.\n\n";
	return "WORK is the work folder of a run.\n\n";
}

static const char *statuses(const struct cli_command *c)
{
	return "  0 done, or submitted; 1 an input is broken, or a task does not fit; 2 usage; 4 there is no such run;\n"
	       "  69 the scheduler is not on this machine; 74 reading or writing failed, or no space;\n"
	       "  75 the scheduler does not answer; 76 versions; 77 not permitted; 124 --timeout has passed;\n"
	       "  128 and the number of a signal\n";
}

struct cli cluster_cli(void)
{
	return (struct cli){.program = "acut-cluster",
			    .about = "terrain meshes from survey points, by the nodes of a cluster",
			    .command = commands,
			    .ncommand = sizeof(commands) / sizeof(*commands),
			    .option = cluster_options,
			    .noption = cluster_noptions,
			    .scope_at = offsetof(struct program, fetch.output),
			    .scope_size = sizeof(struct ctl_fetch_output),
			    .scopes = CTL_FETCH_OUTPUTS + 1,
			    .words = words,
			    .statuses = statuses};
}

static void offer_formats(const struct cli_typed *t, bool in)
{
	size_t n;
	const struct format *const *out = format_rows(&n);

	for (const struct ctl_input_format *f = ctl_input_formats; in && f->name; f++)
		cli_offer(t, f->name, f->help);
	for (size_t i = 0; !in && i < n; i++)
		cli_offer(t, out[i]->name, out[i]->help);
}

bool cluster_offer(struct cli_typed *t, const char *kind, size_t n)
{
	if (cli_is_kind(kind, n, "FORMAT") || cli_is_kind(kind, n, "INPUT-FORMAT")) {
		offer_formats(t, n > 6);
	} else if (cli_is_kind(kind, n, "FILE.pgm")) {
		puts(":files .pgm");
	} else if (cli_is_kind(kind, n, "WORK")) {
		puts(":folders");
	} else if (cli_is_kind(kind, n, "INPUT")) {
		fputs(":files", stdout);
		for (const struct ctl_input_format *f = ctl_input_formats; f->name; f++)
			printf(" %s", f->extensions);
		putchar('\n');
	} else {
		return false;
	}
	return true;
}

int cluster_version_run(struct program *p)
{
	struct term_json j;

	if (!p->session.console.json) {
		puts("acut-cluster " ACUT_VERSION);
		return 0;
	}
	j = console_json(&p->session.console);
	term_json_text(&j, "version", ACUT_VERSION);
	term_json_end(&j);
	return 0;
}
