/* A mesh into outputs: their options, the fetch, and what is printed at its end. */
#ifndef CTL_FETCH_H
#define CTL_FETCH_H

#include "cli.h"
#include "ctl_report.h"
#include "outputs.h"

/* One output; NULL, 0: not given. */
struct ctl_fetch_output {
	const char *path, *format, *origin, *z_unit, *color, *cell, *raster, *interval, *base, *index, *simplify;
	uint64_t width;
	bool canonical, polyface, sidecar;
};

enum { CTL_FETCH_OUTPUTS = 16 };

struct ctl_fetch_options {
	struct ctl_fetch_output
		output[CTL_FETCH_OUTPUTS + 1];   /* as given; the first has the options before any -o, and no path */
	const char *tile, *max_edge, *trim_hull; /* NULL: not given */
	struct cli_texts cut[OUTPUTS_CUTS];      /* files of --mask and --erase */
	uint64_t since;                          /* 0: not given */
	bool no_clobber, levels;
	bool gaps;             /* the view leaves gaps: of the ground or the surface */
	const char *max_error; /* the bound that this command asked for; NULL: none, or it submitted no job */
	const char *window;    /* "bbox", "polygon": only that area of the mesh; NULL: all of it */
};

unsigned ctl_fetch_count(const struct ctl_fetch_options *); /* of outputs */
/* Their paths, a NULL at the end. */
const char *const *ctl_fetch_paths(const struct ctl_fetch_options *, const char *ret[CTL_FETCH_OUTPUTS + 1]);
/* Output i (from 1; 0 without outputs) with the options that are of all. */
struct ctl_fetch_output ctl_fetch_output(const struct ctl_fetch_options *, unsigned i);
/* The output has a --format of its own, which then counts more than its name. */
bool ctl_fetch_own_format(const struct ctl_fetch_options *, unsigned i);
/* The unit that all outputs convert heights to; NULL: none, or not the same. */
const char *ctl_fetch_z_unit(const struct ctl_fetch_options *);
bool ctl_fetch_is_standard(const char *path); /* standard output, however it is named */
/* Names standard output "-" however it is named; whether it is one of the outputs. */
bool ctl_fetch_to_standard(struct ctl_fetch_options *);
/* --format names one that writes nothing, and no OUT is given: that is complete. */
bool ctl_fetch_nothing(const struct ctl_fetch_options *);
/* The format of output i (0: of none). NULL: it cannot be known, or there is no such. */
const struct format *ctl_fetch_format(const struct ctl_fetch_options *, unsigned i, struct err *err);
/* Checks what can be known without a daemon, and opens a run. */
int ctl_fetch_open(struct session *, const struct ctl_fetch_options *, struct outputs **ret, struct err *err);
/* The same for a program without a session: what these say of interruptions, memory and parts counts. */
int ctl_fetch_make(const struct ctl_fetch_options *, const struct outputs_options *, struct outputs **ret, struct err *err);
/* Fetches the job into the run, going on with what it has kept (outputs_keep), publishes, reports; exit status. */
int ctl_fetch(struct session *, const struct ctl_fetch_options *, uint64_t job, struct outputs *, const struct ctl_staged *);
/* The note that the bound asked for is not that of the job's view, as the lattice is coarser; "": it is, or none (NULL). */
enum { CTL_MESH_NOTE = 512 };
const char *ctl_fetch_bound(const struct acut_job *, const char *asked, char buf[CTL_MESH_NOTE]);
/* For a job that was waited for and not fetched; on a terminal only. */
void ctl_fetch_summary(struct console *, const struct acut_job *);

/* ---- for the files of this room ---- */

/* Each option must be of use for the output that it is of, or, of all, for one of them. */
int ctl_fetch_check_used(const struct ctl_fetch_options *, const struct format *const format[CTL_FETCH_OUTPUTS + 1],
			 struct err *);

/* A mesh that was written. */
struct ctl_mesh {
	struct console *console;
	const struct ctl_fetch_options *opt;
	const struct acut_job *job;
	const struct outputs_report *out;
	const struct ctl_staged *staged; /* NULL: a job that was there already */
};
void ctl_mesh_text(const struct ctl_mesh *);
void ctl_mesh_json(const struct ctl_mesh *);
/* The file that lists what is in the folder of tiles. */
const char *ctl_mesh_index(const struct ctl_fetch_options *);
/* The note that files of contours have no line; "": they have some. */
const char *ctl_mesh_no_lines(const struct ctl_mesh *, char buf[CTL_MESH_NOTE]);
bool ctl_mesh_simplifies(const struct ctl_fetch_options *); /* an output has --simplify */
/* A rule leaves out triangles. */
bool ctl_mesh_trims(const struct ctl_fetch_options *);
/* How many points of this command's inputs the lattice moved, and the largest shift an axis. */
uint64_t ctl_mesh_moved(const struct ctl_staged *, double ret_shift[3]);
/* Warnings of long edges; "edges". */
void ctl_mesh_warn_edges(const struct ctl_mesh *);
void ctl_mesh_warn_trimmed(const struct ctl_mesh *); /* that nothing is left */
void ctl_mesh_edges_json(struct term_json *, const struct ctl_mesh *);

/* The report of a window, in memory of its own. */
struct ctl_window {
	struct acut_report report;
	char digest[40], vertex_digest[40], note[200], max_error[64], largest_error[64];
};
/* -ERR_PROTO: the report in the tail cannot be read. */
int ctl_window_tail(struct ctl_window *, const struct acut_mesh_tail *, struct err *err);

#endif
