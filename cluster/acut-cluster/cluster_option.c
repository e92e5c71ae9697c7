/* The options of acut-cluster. Those of inputs, views and outputs are the rows of acutctl's. */
#include <stddef.h>

#include "cluster.h"

#define AT(field) offsetof(struct program, field)

const struct cli_option cluster_options[] = {
	{"work", 0, "DIR", CLI_WORD, AT(opt.work), CLUSTER_NEW,
	 "the work folder, new or empty, on a file system that all nodes see"},
	{"on", 0, "slurm|local|script", CLI_WORD, AT(opt.on), CLUSTER_RUN,
	 "where tasks run: Slurm, processes of this machine, or a script for another scheduler"},
	{"script", 0, "FILE", CLI_WORD, AT(opt.script), CLUSTER_SCRIPT, "with --on script: write it there (WORK/script)"},
	{"task-memory", 0, "SIZE", CLI_SIZE, AT(opt.task_memory), CLUSTER_RUN, "memory of a task (1G)"},
	{"task-seconds", 0, "TIME", CLI_SECONDS, AT(opt.task_seconds), CLUSTER_RUN, "about so long shall a task take (120)"},
	{"task-points", 0, "N", CLI_MANY, AT(opt.task_points), CLUSTER_RUN, "about so many points a task, in place of a time"},
	{"sort", 0, NULL, CLI_FLAG, AT(opt.sort), CLUSTER_RUN, "sort the points of all files by place before they are meshed"},

#define OUT_OPTION(name, letter, value, kind, field, help) {name, letter, value, kind, AT(fetch.field), CLUSTER_VIEW, help},
#include "ctl_fetch_option.def"

#define VIEW_OPTION(name, value, kind, field, help) {name, 0, value, kind, AT(view.field), CLUSTER_VIEW, help},
#define VIEW_WINDOW_OPTION VIEW_OPTION
#include "ctl_view_option.def"

	{"scale", 0, "XY[,Z]", CLI_TEXT, AT(stage.scale), CLUSTER_INPUT, "lattice scale, in place of the inputs' finest"},
#define STAGE_OPTION(name, value, kind, field, help) {name, 0, value, kind, AT(stage.field), CLUSTER_INPUT, help},
#include "ctl_stage_option.def"
	{"geoid", 0, "FILE.pgm", CLI_TEXT, AT(stage.geoid), CLUSTER_INPUT, "shift the heights by this geoid grid"},
#define INPUT_OPTION(name, value, kind, field, help) {name, 0, value, kind, AT(input.field), CLUSTER_INPUT, help},
#define INPUT_STAGE_OPTION INPUT_OPTION
#include "ctl_input_option.def"
	{"directory", 0, "DIR", CLI_WORD, AT(opt.directory), CLUSTER_INPUT,
	 "where relative names begin, also for tasks on other nodes (the current folder)"},

	{"partition", 0, "NAME", CLI_WORD, AT(opt.partition), CLUSTER_SCHEDULER, "Slurm's partition"},
	{"account", 0, "NAME", CLI_WORD, AT(opt.account), CLUSTER_SCHEDULER, "the account that is charged"},
	{"qos", 0, "NAME", CLI_WORD, AT(opt.qos), CLUSTER_SCHEDULER, "the quality of service"},
	{"time", 0, "TIME", CLI_SECONDS, AT(opt.time), CLUSTER_SCHEDULER,
	 "a task is ended after so long (by what is expected, at least 1h)"},
	{"max-tasks", 0, "N", CLI_COUNT, AT(opt.max_tasks), CLUSTER_SCHEDULER, "at most so many tasks at once"},
	{"attempts", 0, "N", CLI_COUNT, AT(opt.attempts), CLUSTER_SCHEDULER, "a task that fails is tried so often (3)"},
	{"sbatch", 0, "OPTION", CLI_LIST, AT(opt.sbatch), CLUSTER_SCHEDULER,
	 "one more option of sbatch, as --sbatch=--constraint=avx2; may be repeated"},
	{"scratch", 0, "DIR", CLI_WORD, AT(opt.scratch), CLUSTER_RUN,
	 "a folder of each node for temporary files (the work folder)"},
	{"config", 0, "FILE", CLI_WORD, AT(opt.config), CLUSTER_RUN, "settings, in place of " ACUT_CLUSTER_CONFIG},
	{"no-config", 0, NULL, CLI_FLAG, AT(opt.no_config), CLUSTER_RUN, "read no file of settings"},

	{"wait", 0, NULL, CLI_FLAG, AT(opt.wait), CLUSTER_WAIT, "wait until the run is done and end with its status"},
	{"keep-dataset", 0, NULL, CLI_FLAG, AT(opt.keep_dataset), CLUSTER_CLEAN,
	 "leave the folder dataset for acutctl dataset import"},
	{"force", 0, NULL, CLI_FLAG, AT(opt.force), CLUSTER_CLEAN, "also of a run that is not done"},

	{"timeout", 0, "TIME", CLI_SECONDS, AT(session.opt.timeout), CLI_ALL, "end with status 124 after 90, 90s, 5m, 2h"},
	{"json", 0, NULL, CLI_FLAG, AT(session.console.json), CLI_ALL, "results and errors as JSON"},
	{"quiet", 'q', NULL, CLI_FLAG, AT(session.console.quiet), CLI_ALL, "print only errors and results"},
	{"no-progress", 0, NULL, CLI_FLAG, AT(session.console.no_progress), CLI_ALL, "no progress line"},
	{"help", 'h', NULL, CLI_FLAG, 0, CLI_ALL, "print help"},
};

const size_t cluster_noptions = sizeof(cluster_options) / sizeof(*cluster_options);
