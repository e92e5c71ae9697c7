/*
 * acutctl: what its commands share. One file a command (ctl_NAME.c with ctl_NAME_run), bound by the table in
 * ctl_command.c; options are rows of ctl_option.c. A command returns the exit status.
 */
#ifndef CTL_H
#define CTL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/types.h>
#include <time.h>

#include "acut.h"
#include "cli.h"
#include "ctl_view.h"
#include "format.h"
#include "session.h"
#include "term_error.h"
#include "term_json.h"
#include "term_text.h"

struct stat;

/* What the options said. Texts are NULL, numbers 0 if not given; ctl_option_check has looked at them. */
struct ctl_args {
	bool header, decimal_comma, strict, planar, accept_truncated, checksum, add, replace;
	bool all;       /* cache gc */
	bool origin_of; /* config show */
	bool canonical, no_clobber, wait, fresh, resume, files, removed, copy;
	uint64_t since, width, generation, keep, before;
	const char *scale, *input_format, *manifest, *assume_crs, *crs, *assume_units, *override_crs, *override_units;
	const char *columns;
	const char *utm, *geoid, *geoid_way, *name;
	const char *format, *tile, *origin, *max_edge, *z_unit, *color;
	const char *priority, *replaces, *as, *settle, *mode;
	const char *textfile;
	struct cli_texts out;
};

struct program {
	struct session session;
	struct ctl_args args;
	struct ctl_view_options view;
	struct cli_line line;
};

/* Which options a command takes: an option is allowed where its groups meet the command's. */
enum ctl_group {
	CTL_STAGE = 2,  /* what is stored: mesh, push */
	CTL_VIEW = 4,   /* which points: mesh, submit, plan */
	CTL_OUT = 8,    /* what is written: mesh, fetch */
	CTL_OWN = 16,   /* a daemon of its own: mesh, info */
	CTL_INPUT = 32, /* reads inputs: mesh, push, info */
	CTL_SUBMIT = 64,
	CTL_GENERATION = 128, /* of a dataset: submit, plan, dataset show */
	CTL_FETCH = 256,
	CTL_PUSH = 512,
	CTL_CREATE = 1024,     /* dataset create */
	CTL_DATASET = 1 << 24, /* dataset log, restore */
	CTL_REMOVED = 1 << 25, /* datasets */
	CTL_GEOID = 1 << 16,
	CTL_CACHE = 1 << 22,  /* cache gc */
	CTL_CONFIG = 1 << 26, /* config show */
	CTL_INFO = 1 << 17,
	CTL_JOB = 1 << 18, /* begins a job: mesh, submit */
	CTL_METRICS = 1 << 20,
	CTL_COPY = 1 << 19, /* backup, dataset export */
	CTL_INGEST = 1 << 11,
	CTL_MANIFEST = 1 << 12, /* inputs that are named: mesh, push */
	CTL_REPLACES = 1 << 13, /* push */
};

extern const struct cli_verb ctl_cache_verbs[], ctl_config_verbs[], ctl_dataset_verbs[], ctl_geoid_verbs[];

struct cli ctl_cli(void);
extern const struct cli_option ctl_options[];
extern const size_t ctl_noptions;
/* Values that can be judged without knowing the command. */
int ctl_option_check(struct program *, struct err *err);
int ctl_complete(const struct cli *, int argc, char **argv, struct program *);

/* ---- ctl_outlier.c ---- */

/* After a mesh was written: warnings of long edges and of many points at one position; "edges". */
void ctl_outlier_warn(struct program *, const struct acut_report *, const struct format_report *);
void ctl_outlier_most(struct program *, const struct acut_report *); /* of a job without outputs */
/* Whether so many points at one position, of all at so many positions, are worth a word. */
bool ctl_outlier_many(uint64_t at_one, uint64_t points, uint64_t positions);
void ctl_outlier_json(struct program *, struct term_json *, const struct format_report *);

/* ---- ctl_window.c ---- */

/* The report of a window, in memory of its own. */
struct ctl_window {
	struct acut_report report;
	char digest[40], vertex_digest[40], note[200];
};
void ctl_window_tail(struct ctl_window *, const struct acut_mesh_tail *);

/* ---- ctl_input.c ---- */

struct ctl_input {
	char *name;
	int fd;         /* -1: opened when it is its turn; else a pipe's reading end */
	int kept;       /* of a pipe that is judged by its content, a regular file that has all of it; 0: none */
	bool anonymous; /* standard input without --name */
	bool refused;
	bool verified; /* by --manifest, as this file: */
	dev_t dev;
	ino_t ino;
	off_t size;
	struct timespec mtime;
	const char *entry; /* NULL, or what it is called in dirfd: an ingest's, opened there, and only as the very file that was
			      seen */
	int dirfd;
	struct timespec ctime;
	const char *path; /* NULL, or its absolute one, which `name` is not */
	int copier;       /* the process that empties the pipe; 0: none */
	uint8_t *
		head; /* of a pipe that was looked at: its first bytes, which are read already; at least 4, unless it has fewer */
	unsigned nhead;
	const char *label;           /* NULL, or by --name: what it is called in the dataset */
	struct ctl_archive *archive; /* NULL, or whose member it is (ctl_archive.h), by number; then `kept` is that, unpacked */
	size_t member;
};
struct ctl_inputs {
	struct ctl_input *input;
	size_t n, room;
	bool each;          /* what became of each is told by the caller: that all were refused is no failure of its own */
	const double *crop; /* NULL, or the box (x1, y1, x2, y2) that is all that will be asked for */
	struct ctl_archive *archives; /* of its members */
};
/* What folders and archives are searched for. */
#define CTL_INPUT_ENDINGS ".las, .laz, .ptx, .xyz or .pts"
bool ctl_input_is_survey(const char *name, size_t n);
/* Files, folders (their survey files, sorted), lists (@FILE), "-". */
int ctl_input_gather(struct program *, char **word, unsigned nword, struct ctl_inputs *ret, struct err *err);
/* One more. `fd` is -1, or the reading end of a pipe, which is taken over. */
int ctl_input_add(struct ctl_inputs *, const char *name, int fd, struct err *err);
/* *ret_fd is the caller's; -1 of a pipe. Of an archive's member: it is unpacked, and stays so (ctl_archive_drop). */
int ctl_input_open(struct program *, struct ctl_input *, int *ret_fd, struct err *err);
void ctl_input_close(const struct ctl_input *, int fd);
/* Whether it is still the file that was seen, and as it was. */
bool ctl_input_unchanged(const struct ctl_input *, const struct stat *);
/* Its absolute path, links as they are; NULL if it has none. */
const char *ctl_input_path(const struct ctl_input *, char *buf, size_t size);
void ctl_input_done(struct ctl_inputs *);
/* -ERR_USAGE if an output is one of the inputs. */
int ctl_input_not_output(const struct ctl_inputs *, const struct ctl_args *, struct err *err);

/* ---- ctl_temp.c ---- */

/* A file without a name. *ret_folder: where it is, for messages. */
int ctl_temp_open(const char **ret_folder, int *ret_fd, struct err *err);

/* ---- ctl_manifest.c ---- */

/* Every input against args.manifest; the error names the first that does not agree, its hint the others. */
int ctl_manifest_check(struct program *, struct ctl_inputs *, struct err *err);

/* ---- ctl_pipe.c ---- */

/* Reads the first bytes of a pipe, to see what it holds; who copies it begins with them. */
int ctl_pipe_look(struct program *, struct ctl_input *, struct err *err);
/* What the daemon, which connects if need be, says of a file that begins so: -ERR_INPUT where it is none that can be read. */
int ctl_pipe_check(struct program *, const struct ctl_input *, struct err *err);
/* Lets the daemon make a pipe and starts a process that copies into it. Prints its failure; exit status. */
int ctl_pipe_start(struct ctl_input *, struct acut_push *, struct program *);
/* After the input was staged: whether all of it was copied. */
int ctl_pipe_finish(struct ctl_input *, struct err *err);
void ctl_pipe_stop(struct ctl_input *);
/* All of it into a file without a name, for a command that looks at an input only. */
int ctl_pipe_keep(struct program *, const struct ctl_input *, int *ret_fd, struct err *err);

/* ---- ctl_cache.c ---- */

void ctl_cache_sides(FILE *out, bool one, const struct acut_side *state, const struct acut_side *cache, const char *disk,
		     const char *keep_free);
void ctl_cache_side_json(struct term_json *, const char *name, const struct acut_side *);

/* ---- ctl_assume.c: what is taken for inputs that say nothing, or in place of what they say ---- */

struct ctl_assume {
	char *crs, unit_xy[16], unit_z[16]; /* NULL, "": nothing */
	bool overrides;                     /* in place of what the inputs say */
	bool no_crs, no_unit_xy, no_unit_z; /* of the inputs seen: still unknown */
};
/* The text of a CRS: the word, or what is in the file of that name. `*ret` is the caller's. */
int ctl_assume_crs(const char *word, const char *option, char **ret, struct err *err);
int ctl_assume_read(const struct ctl_args *, struct ctl_assume *ret, struct err *err);
void ctl_assume_options(const struct ctl_assume *, struct acut_push_options *); /* borrows the texts */
void ctl_assume_seen(struct ctl_assume *, const struct acut_probe *);
void ctl_assume_warn(struct program *, const struct ctl_assume *); /* once a dataset */
void ctl_assume_done(struct ctl_assume *);
struct ctl_staged;
void ctl_assume_text(struct program *, const struct ctl_staged *); /* whose word was overridden */

/* ---- ctl_stage.c: inputs into a dataset ---- */

struct ctl_staged {
	char dataset[256];
	uint64_t generation, points;
	bool committed; /* also where that made no generation: then the dataset may have none, and not be there */
	bool unchanged; /* it made none */
	unsigned good, refused, known, adopted; /* adopted ones are known ones too */
	struct ctl_staged_file {
		char *name;
		bool refused;
		int known; /* of struct acut_probe */
		uint64_t points, moved, bytes_read, bytes;
		uint64_t left_out; /* lines */
		bool partial;
		uint32_t replaced; /* files of the dataset */
		double shift[3];
		char *warning;        /* NULL: none */
		char *projected_from; /* of its degrees; NULL: they were not projected */
		char *overridden;     /* what its records say, in place of which something else was taken; NULL: nothing was */
		uint64_t shifted;     /* heights, by a geoid; by how many metres */
		double height[3];     /* smallest, mean, largest */
		struct err err;
	} * file;
	size_t nfile;
	double seconds;
	char zone[16], datum[64], geoid[160]; /* that degrees and heights went to; "": nothing did */
};
/* Pushes all inputs; refused ones are told. `dataset` NULL: one-step. Prints its failure; exit status, where
 * SESSION_SOME_REFUSED means that the push is done without them. */
int ctl_stage(struct program *, const char *dataset, struct ctl_inputs *, struct ctl_staged *ret);
void ctl_stage_done(struct ctl_staged *);

/* ---- ctl_push.c: what a push did ---- */

/* Each file and the sum, for people or as JSON. moved_to (NULL: a push, which moves nothing): where each file is now, NULL
 * where it was. Prints its failure; exit status. */
int ctl_push_check(const struct program *, struct err *err); /* of its options */
int ctl_push_report(struct program *, const struct ctl_staged *, const char *const *moved_to);

/* ---- ctl_inspect.c: what is in the records of a file ---- */

void ctl_inspect_text(struct program *, const struct acut_inspected *);
/* Its keys; NULL: the records were not read, so all are null. */
void ctl_inspect_json(struct term_json *, const struct acut_inspected *);

/* ---- ctl_geoid.c, ctl_height.c: what geoids do ---- */

/* Adds the file to the daemon's grids; `name` NULL: named after it. Exit status, failures printed. */
int ctl_geoid_file(struct program *, const char *path, const char *name, char ret_name[128], const struct acut_geoid **ret);
/* --geoid names a kept grid, or a .pgm file, which is added then. */
int ctl_height_geoid(struct program *, char ret_name[128]);
/* What the plan says, taken over and told. */
void ctl_height_planned(struct program *, const struct acut_push_planned *, struct ctl_staged *);
/* Keys "projection" and "geoid" of one file, or (NULL) of all that were staged; NULL both: null. */
void ctl_height_json(struct term_json *, const struct ctl_staged *, const struct ctl_staged_file *);
void ctl_height_text(struct program *, const struct ctl_staged *);

/* ---- ctl_output.c: outputs from the options ---- */

/* Checks them (what can be known without a daemon) and opens a run. */
/* --format names one that writes nothing, and no OUT is given: that is complete. */
bool ctl_output_nothing(const struct ctl_args *);
int ctl_output_open(struct program *, struct format_run **ret, struct err *err);
/* Fetches the job into the run, going on with what it has kept (format_run_keep), publishes, reports; exit status. */
int ctl_output_fetch(struct program *, uint64_t job, struct format_run *, const struct ctl_staged *);

/* ---- ctl_summary.c: what a mesh has become, for people ---- */

void ctl_summary(struct program *, const struct acut_job *, const struct format_report *,
		 const struct ctl_staged * /* or NULL */);
/* Of a job that was waited for and not fetched: on a terminal only. */
void ctl_summary_job(struct program *, const struct acut_job *);
/* How many points of this command's inputs the lattice moved, and the largest shift an axis. */
uint64_t ctl_summary_moved(const struct ctl_staged *, double ret_shift[3]);

/* ---- ctl_job.c: jobs as text and JSON ---- */

void ctl_job_print(struct program *, const struct acut_job *);
void ctl_job_json(struct program *, const struct acut_job *);
/* Exit status of a job that is over; prints why it failed. */
int ctl_job_status(struct program *, const struct acut_job *);
/* "12" or "job 12" as an id. */
int ctl_job_id(const char *text, uint64_t *ret, struct err *err);
/* Calls `each` for the words, in order; the first status that is not 0. */
int ctl_job_each(struct program *, int (*each)(struct program *, uint64_t id));
/* "12 of 340 domains made", or "340 domains". */
char *ctl_job_domains(const struct acut_report *, char *buf, size_t size);
/* The keys of a report, from "points" to "peak_rss_bytes"; all null without one. */
/* The position that most points share, as "most". */
void ctl_job_most(struct term_json *, uint64_t points, const double at[2]);
void ctl_job_report(struct term_json *, const struct acut_report * /* or NULL */);
/* "notes": the sentences of a report, none without one. */
void ctl_job_notes(struct term_json *, const struct acut_report * /* or NULL */);
/* lattice as a JSON object, null if the text is not one */
void ctl_job_lattice(struct term_json *, const char *lattice);
void ctl_job_units(struct term_json *, const char *crs, const char *unit_xy, const char *unit_z);
void ctl_job_refused(struct term_json *, const struct ctl_staged_file *);

/* ---- ctl_formats.c ---- */

/* What the daemon of this version reads; up to one without a name. extensions: ".las .laz". */
extern const struct ctl_input_format {
	const char *name, *extensions, *help;
} ctl_formats_input[];
/* "laz" is an extension of las. */
extern const struct ctl_input_format ctl_formats_archive[]; /* unpacked here: no values of --input-format */
bool ctl_formats_extension(const struct ctl_input_format *, const char *word);

/* ---- commands ---- */

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
CTL_COMMAND(wait)
CTL_COMMAND(watch)
#undef CTL_COMMAND

#endif
