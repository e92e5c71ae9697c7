/*
 * acutctl: its command line, and what commands share. One file a command (ctl_NAME.c with ctl_NAME_run), a row in ctl_command.c;
 * options are rows of ctl_option.c. A command returns the exit status.
 */
#ifndef CTL_H
#define CTL_H

#include "ctl_fetch.h"
#include "ctl_view.h"
#include "volume.h"

/* Options of one command or two. Texts are NULL, numbers 0 if not given. */
struct ctl_options {
	bool header;    /* info */
	bool lines;     /* info: texts are lines in CSV */
	bool all;       /* cache gc */
	bool origin_of; /* config show */
	bool wait, fresh, resume, files, removed, copy;
	uint64_t generation, keep, before;
	const char *crs, *priority, *as, *settle, *textfile;
	struct lines_export_options line_options; /* `kind`: of --lines-as */
	struct cli_texts line_files[LINES_KINDS]; /* mesh */
	const char *line_report, *weight_report;
};

struct ctl_volume_options {
	const char *level, *within, *name_field, *unit, *cell; /* NULL: not given */
	bool csv, no_clobber;
	struct cli_texts output;
};

struct program {
	struct session session;
	struct ctl_input_options input;
	struct ctl_stage_options stage;
	struct ctl_view_options view;
	struct ctl_fetch_options fetch;
	struct ctl_options opt;
	struct ctl_volume_options volume;
	struct cli_line line;
};

/* Which options a command takes. */
enum ctl_group {
	CTL_STAGE = 2,  /* what is stored: mesh, push */
	CTL_VIEW = 4,   /* which points: mesh, submit, plan */
	CTL_OUT = 8,    /* what is written: mesh, fetch */
	CTL_OWN = 16,   /* a daemon of its own, and a private one if none is set: mesh, info */
	CTL_INPUT = 32, /* reads inputs: mesh, push, info */
	CTL_SUBMIT = 64,
	CTL_GENERATION = 128, /* of a dataset: submit, plan, dataset show */
	CTL_FETCH = 256,
	CTL_PUSH = 512,
	CTL_CREATE = 1 << 10, /* dataset create */
	CTL_INGEST = 1 << 11,
	CTL_MANIFEST = 1 << 12, /* inputs that are named: mesh, push */
	CTL_REPLACES = 1 << 13, /* push */
	CTL_GEOID = 1 << 14,
	CTL_INFO = 1 << 15,
	CTL_JOB = 1 << 16,  /* begins a job: mesh, submit */
	CTL_COPY = 1 << 17, /* backup, dataset export */
	CTL_METRICS = 1 << 18,
	CTL_CACHE = 1 << 19,   /* cache gc */
	CTL_DATASET = 1 << 20, /* dataset discard, log, prune, restore */
	CTL_REMOVED = 1 << 21, /* datasets */
	CTL_CONFIG = 1 << 22,  /* config show */
	CTL_LINES = 1 << 23,   /* mesh: files of lines beside its inputs */
	CTL_VOLUME = 1 << 24,
};

extern const struct cli_verb ctl_cache_verbs[], ctl_config_verbs[], ctl_dataset_verbs[], ctl_geoid_verbs[];

struct cli ctl_cli(void);
extern const struct cli_option ctl_options[];
extern const size_t ctl_noptions;
int ctl_complete(const struct cli *, int argc, char **argv, struct program *);

/* "12" as the number of a job. */
int ctl_job_id(const char *text, uint64_t *ret, struct err *err);
/* Calls `each` for the words, in order; the first status that is not 0. */
int ctl_job_each(struct program *, int (*each)(struct session *, uint64_t id));

/* push: with --lines-as or --kind-field all inputs are files of lines; without them a file of lines is refused. -ERR_USAGE. */
int ctl_lines_as(struct program *, struct ctl_inputs *, struct err *err);
/* mesh: adds its files of lines. `options`, to be filled, stay in use as long as the inputs. */
int ctl_lines_beside(struct program *, struct ctl_inputs *, struct lines_export_options options[LINES_KINDS], struct err *err);

/* volume: what is compared, and the results. */
struct ctl_volume {
	struct ctl_volume_mesh {
		uint64_t job, generation;
		char *dataset, *view;
	} mesh[2];
	const struct ctl_volume_options *opt;
	const struct volume *volume;
	bool has_level;
	double level;
};
void ctl_volume_text(const struct console *, const struct ctl_volume *);
void ctl_volume_csv(const struct console *, const struct ctl_volume *);
void ctl_volume_json(const struct console *, const struct ctl_volume *);

/* The disks of state and cache: cache stat, status. */
void ctl_cache_sides(FILE *out, bool one, const struct acut_side *state, const struct acut_side *cache, const char *disk,
		     const char *keep_free);
int ctl_cache_adopt(struct program *);
void ctl_cache_side_json(struct term_json *, const char *name, const struct acut_side *);

#define CTL_COMMAND(name) int ctl_##name##_run(struct program *);
CTL_COMMAND(backup)
CTL_COMMAND(cancel)
CTL_COMMAND(datasets)
CTL_COMMAND(doctor)
CTL_COMMAND(fetch)
CTL_COMMAND(formats)
CTL_COMMAND(info)
CTL_COMMAND(ingest)
CTL_COMMAND(jobs)
CTL_COMMAND(mesh)
CTL_COMMAND(metrics)
CTL_COMMAND(ping)
CTL_COMMAND(plan)
CTL_COMMAND(push)
CTL_COMMAND(rm)
CTL_COMMAND(show)
CTL_COMMAND(status)
CTL_COMMAND(submit)
CTL_COMMAND(version)
CTL_COMMAND(volume)
CTL_COMMAND(wait)
CTL_COMMAND(watch)
#undef CTL_COMMAND

#endif
