/*
 * libacut: talk to acutd. The one public header; opaque handles, no global state, no threads of its own.
 *
 * Every call returns 0, or a negative acut_code (its details by acut_error). Calls wait for the answer;
 * while they wait, progress and interruption go through the callbacks. A call that timed out or was
 * interrupted leaves the connection whole: its late answer is dropped. After the other side went away or
 * broke the protocol, every further call fails in the same way. One thread at a time may use a connection;
 * different connections do not know of each other. Callbacks must not call on their own connection.
 */
#ifndef ACUT_H
#define ACUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct acut;

/* Same order and numbers as base/err.def (checked when libacut is built). New ones go to the end. */
enum acut_code {
	ACUT_OK,
	ACUT_E_INPUT,       /* the input is broken or cannot be used */
	ACUT_E_TRUNCATED,   /* the input has less data than its header says */
	ACUT_E_CHANGED,     /* the input changed while it was read */
	ACUT_E_LIMIT,       /* it can never fit into the limits that are set */
	ACUT_E_CANCELLED,   /* the job was cancelled, or a callback ended the call */
	ACUT_E_GONE,        /* the stream cannot be continued */
	ACUT_E_DIGEST,      /* the digests do not agree */
	ACUT_E_INTERNAL,    /* a fault in acut itself */
	ACUT_E_USAGE,       /* the request is not well formed */
	ACUT_E_UNSUPPORTED, /* this version of acut cannot do that */
	ACUT_E_NOTFOUND,    /* there is no such job, dataset or device */
	ACUT_E_NODAEMON,    /* no daemon answers, or it went away */
	ACUT_E_IO,          /* reading or writing failed */
	ACUT_E_NOSPACE,     /* there is no space left */
	ACUT_E_CORRUPT,     /* stored data is damaged */
	ACUT_E_BUSY,        /* not now; time alone mends it */
	ACUT_E_NOMEM,       /* the system gave no memory */
	ACUT_E_PROTO,       /* the other side does not keep to the protocol */
	ACUT_E_VERSION,     /* the versions do not agree */
	ACUT_E_PERM,        /* not permitted */
	ACUT_E_TIMEOUT,     /* it took longer than the time-out */
	ACUT_E_CONFLICT,    /* what is there already does not allow it: a name is taken, a dataset is pinned */
};
struct acut_failure {
	int code;                                  /* enum acut_code */
	const char *name;                          /* "bad-input", frozen */
	int exit_status;                           /* what acutctl ends with */
	const char *message, *file, *field, *hint; /* "" if none */
	uint64_t offset;                           /* UINT64_MAX if unknown */
};

struct acut_options {
	const char *program; /* for the daemon's log; NULL: "libacut" */
	double timeout;      /* seconds without a sign of life while a call waits; 0: for ever */
	/* Asked about ten times a second while a call waits; non-zero: the call ends with "cancelled". */
	int (*interrupted)(void *ctx);
	void *ctx;
};

/* The version of this library, as "0.1.0". Structs of releases with the same first two numbers have the same layout. */
const char *acut_version(void);

/* ---- connection ---- */

int acut_connect(const char *socket_path, const struct acut_options *, struct acut **ret);
/* Takes over a connected socket, whatever the result. On failure of either, *ret is still set, for
 * acut_error; close it (NULL only if there is no memory even for that). */
int acut_attach(int fd, const struct acut_options *, struct acut **ret);
struct acut *acut_close(struct acut *);
/* The error of the last call; valid until the next one. With NULL: out of memory. */
const struct acut_failure *acut_error(const struct acut *);
int acut_fd(const struct acut *);                   /* to poll for POLLIN between calls */
int acut_dispatch(struct acut *);                   /* read what is there; runs callbacks, never waits */
const char *acut_daemon_build(const struct acut *); /* build id of the other side */

int acut_ping(struct acut *, double *ret_seconds);

struct acut_ledger_entry {
	const char *name;
	uint64_t bytes; /* held now */
	uint64_t peak;  /* the most since the start; 0 in a holder's list */
};
/* Memory that is held by a job, a later stream of one ("fetch"), a plan, a push or a connection. */
struct acut_holder {
	const char *kind, *what;              /* what: the dataset, "" if there is none */
	uint64_t id;                          /* of the job or push; of a connection a running number */
	uint32_t uid, pid;                    /* pid 0: not known */
	const struct acut_ledger_entry *held; /* names of which it holds something */
	size_t nheld;
};
/* The file system of one of the daemon's folders, and what counts there. */
struct acut_side {
	bool known, has_quota;           /* false: an older daemon does not report it */
	uint64_t used, quota;            /* of the daemon's, that the quota is about */
	uint64_t total, free, keep_free; /* of the file system; of it, what stays free */
};
struct acut_status {
	const char *version, *state_dir, *cache_dir;
	uint64_t pid, memory, peak_rss_bytes;
	uint32_t threads, jobs_running, jobs_waiting, connections;
	double uptime_seconds;
	const struct acut_ledger_entry *ledger;
	size_t nledger;
	const struct acut_holder *holders;        /* those that hold the most; memory without a holder is the daemon's own */
	size_t nholders, holders_more;            /* that were left out */
	uint64_t pipe_capacity;                   /* of the kernel's pipes of open streams: beside `memory` */
	uint64_t ledger_peak;                     /* the most that all names together held */
	uint64_t rss_bytes;                       /* resident now */
	const char *disk_limit, *keep_free_limit; /* as they were set: "80%", "200 GB" */
	struct acut_side state_side, cache_side;
	bool one_file_system; /* both are the same then */
};
/* Results stay valid until the next call on this connection. */
int acut_status(struct acut *, const struct acut_status **ret);

/* A setting of the daemon, as it is written in acutd.conf. */
struct acut_setting {
	const char *name, *value; /* "": unset */
	const char *preset;       /* the default; "": see preset_told */
	const char *preset_told;
	const char *unit, *help;
	const char *origin; /* "default", "environment", "control_group", "file", "command_line" */
	const char *file;   /* of "file" */
	uint32_t line;
	bool reload; /* SIGHUP can change it */
};
int acut_config(struct acut *, void (*each)(void *ctx, const struct acut_setting *), void *ctx);

/* ---- push ---- */

struct acut_progress {
	const char *phase; /* "probe", "stage", "hash" (points are bytes), "seal", "select", "simplify", "check", "mesh" */
	uint64_t points, points_total, domains, domains_total;
	double seconds_left; /* of a job, at the pace of late, without waiting; 0: not known */
	const char
		*waiting; /* what a job waits for, in words; "stalled-file: NAME": a file of a push gives nothing; "stalled-files:
			   * N": N files of other pushes of the user do, and no more are read meanwhile; "": nothing */
};
typedef void (*acut_progress_fn)(void *ctx, const struct acut_progress *);

struct acut_push_options {
	const char *dataset;                     /* NULL: one-step */
	const char *scale_xy, *scale_z, *format; /* NULL: as found */
	const char *columns;    /* of text inputs, a letter each ("xyzc", "_" skips one); NULL: from their headers */
	const char *assume_crs; /* for inputs without a system: "EPSG:n", a WKT, or a name; NULL: nothing */
	const char *assume_unit_xy, *assume_unit_z; /* "m", "ft", "ftUS"; NULL: nothing */
	const char *override_crs;                   /* in place of the system of the inputs, likewise; not beside assume_* */
	const char *override_unit_xy, *override_unit_z;
	const char *utm;       /* zone that degrees are projected to: "32N", "UPS-S"; NULL: of the middle of all */
	const char *geoid;     /* a grid that the daemon keeps, to shift the heights; NULL: they stay */
	const char *geoid_way; /* what they become: "orthometric" (also NULL) or "ellipsoidal" */
	bool planar, accept_truncated;
	bool strict;          /* a line of a text without a value for a coordinate is an error; else it is left out and counted */
	bool checksum;        /* the same file: by its content, not by path, size and time */
	const double *crop;   /* NULL, or x1, y1, x2, y2: no view will ask for points outside; one-step only */
	bool add;             /* a file of a path that is there already is taken beside the old one, */
	bool replace;         /* or in its place */
	const char *replaces; /* files are taken in place of this one, by path or name; NULL: none */
	acut_progress_fn progress;
	void *ctx;
};
struct acut_probe {
	const char *name, *format, *variant, *crs, *unit_xy, *unit_z, *plane, *warning;
	const char *datum;                /* "": unknown */
	const char *crs_name;             /* names of the numbers, "A", "A + B"; "": none */
	uint64_t left_out, left_out_line; /* of a text: lines without a value for a coordinate, and the first of them */
	uint32_t epsg, epsg_z;            /* EPSG numbers of the systems of x and y, and of z; 0: unknown */
	uint64_t points;
	double min[3], max[3];
	const char *scale[3], *offset[3];
	uint32_t replaced; /* files of the dataset that an adopted file replaces */
	int known;         /* not 0: the push needs no file for it, and only its number of points is given here */
	const char *wkt;   /* of its system, in one line; "": none, and of a push */
};
enum {
	ACUT_KNOWN = 1,        /* the dataset has it, or this push has it twice */
	ACUT_KNOWN_ADOPTED = 2 /* taken up from a push that was interrupted: it counts as staged */
};
struct acut_file_result {
	const char *name, *warning;
	uint64_t points, moved;
	double max_shift[3];
	const char *projected_from; /* system of its degrees, if they were projected; else "" */
	const char *geoid;          /* "WAY HASH NAME" that shifted its heights; "" */
	uint64_t shifted;           /* heights that were, and by how many metres */
	double shift_min, shift_mean, shift_max;
	uint64_t bytes_read, bytes;       /* for its points; of the file */
	uint64_t left_out, left_out_line; /* as of the probe */
	bool partial;                     /* points outside of the push's crop were not read */
	uint32_t replaced;                /* files of the dataset that it replaces */
	const char *overridden;           /* the system in its records that the push overrode; else "" */
};
/* Beside the lattice, what acut_push_plan fixed. */
struct acut_push_planned {
	const char *lattice, *crs;
	const char *zone, *datum; /* that degrees are projected to, and theirs; "": there are none */
	const char *geoid;        /* "WAY HASH NAME"; "": heights stay */
	const char *note;         /* which scale was chosen for inputs that have more digits than it keeps, in words; "" */
};
struct acut_push_result {
	const char *dataset;
	uint64_t generation, points; /* of the dataset now; no new generation where no point came and none went, 0: it has none */
	bool unchanged;              /* so it was: no new one */
	/* Of all lines of the dataset, where the push changed them and some are left; else NULL. */
	const struct acut_line_set *line_set;
};
struct acut_line_set {
	uint64_t features[4], lines, vertices; /* of the files: hard, lake, boundary, hole */
	uint64_t positions, pieces;            /* what became of them */
	uint64_t crossings;                    /* where lines cross between their vertices */
	uint64_t uneven;                       /* positions with vertices of different heights */
	double widest, widest_at[2];           /* the largest difference of heights at these, in the unit of z, and where it is */
	uint64_t left_out;                     /* pieces outside of the boundary, or in a hole */
	uint64_t doubled, points;              /* segments that lie on others, and those without length */
};
/* Where lines of a generation (0: the newest) cross, and where vertices have different heights. */
struct acut_line_place {
	const char *kind; /* "crossing", "uneven" */
	double x, y, lower, upper;
};
int acut_line_places(struct acut *, const char *dataset, uint64_t generation,
		     void (*each)(void *ctx, const struct acut_line_place *), void *ctx);

struct acut_push;
/* The order: begin, probe each, plan, file each, commit. Probe and file take an open regular file (the
 * caller closes it). A failed probe or file names the input and does not end the push. */
int acut_push_begin(struct acut *, const struct acut_push_options *, struct acut_push **ret);
int acut_push_probe(struct acut_push *, int fd, const char *name, const struct acut_probe **ret);
/* An input through a pipe: probe and file of that name then take fd -1. *ret_fd, the writing end, is the caller's, who must
 * fill and close it in another thread or process while the calls for this input wait. LAS is read as it arrives; the daemon
 * first spools every other format to a file. */
int acut_push_stream(struct acut_push *, const char *name, int *ret_fd);
int acut_push_plan(struct acut_push *, const char **ret_lattice);
/* The result of the last acut_push_plan, until the next call. */
const struct acut_push_planned *acut_push_planned(const struct acut_push *);
int acut_push_file(struct acut_push *, int fd, const char *name, const struct acut_file_result **ret);
int acut_push_commit(struct acut_push *, const struct acut_push_result **ret);

/* One of many inputs. */
struct acut_push_input {
	int fd; /* an open regular file; the library closes it */
	const char *name;
	const char *path; /* absolute: the identity of the input; NULL: unknown, always taken. Only read while sending. */
	/* For a stream (fd -1): the hash of its content, so that path and content identify it as a file is identified with
	 * `checksum`: known, adopted, replaced. XXH3-128 (seed 0) of all bytes, 32 hexadecimal digits; a stream with another
	 * hash is refused. NULL: unknown. */
	const char *hash;
	uint64_t size;      /* and how many */
	bool checksum;      /* its content identifies it, as with acut_push_options.checksum */
	const char *format; /* instead of acut_push_options.format; NULL: that */
};
/* acut_push_probe and acut_push_file with the identity of the input. Its descriptor stays the caller's here. */
int acut_push_probe_input(struct acut_push *, const struct acut_push_input *, const struct acut_probe **ret);
int acut_push_file_input(struct acut_push *, const struct acut_push_input *, const struct acut_file_result **ret);
/* Callbacks for each of n inputs, in their order. They must not call on the connection. */
struct acut_push_each {
	/* Opens input i. 1: it is left out; negative: the call ends. */
	int (*open)(void *ctx, size_t i, struct acut_push_input *ret);
	/* The result for one input: `why` NULL, or the failure, which concerns this input alone if it is one of the input.
	 * Non-zero ends the call, with that failure. */
	int (*probed)(void *ctx, size_t i, const struct acut_failure *why, const struct acut_probe *);
	int (*staged)(void *ctx, size_t i, const struct acut_failure *why, const struct acut_file_result *);
	void *ctx;
};
/* The same as a probe or file of each, but several at a time: thousands of small files do not wait for an
 * answer each. */
int acut_push_probe_each(struct acut_push *, size_t n, const struct acut_push_each *);
int acut_push_file_each(struct acut_push *, size_t n, const struct acut_push_each *);
/* What is there of interrupted pushes of this user into this dataset, and what was dropped, in words; "": nothing. */
const char *acut_push_note(const struct acut_push *);
/* Nothing was pushed into its dataset before: what is not known of the coordinates is worth telling. */
bool acut_push_first(const struct acut_push *);
/* Files 1..n are durable on the daemon's disk and outlive this connection (counted as they were sent). */
uint64_t acut_push_durable(const struct acut_push *);
struct acut_push *acut_push_end(struct acut_push *); /* aborts if not committed; NULL is fine; gives NULL */
/* Forgets a push without aborting it: what is durable stays pending with the daemon. */
struct acut_push *acut_push_leave(struct acut_push *);

/* For text inputs from now on: 123,45 is a number, and columns are not separated by commas. */
int acut_decimal_comma(struct acut *, bool);
/* `columns`: of a text input, a letter each; NULL: from its header. */
int acut_info(struct acut *, int fd, const char *name, const char *format, const char *columns, const struct acut_probe **ret);

/* The content of the records of a file: reads all of it. */
struct acut_inspected {
	struct acut_probe header;
	uint64_t points, distinct; /* read; distinct xy positions */
	double min[3], max[3];     /* of the records; NAN without points */
	uint64_t classes[256], returns[16], return_counts[16];
	uint64_t flags[4];     /* withheld, synthetic, key-point, overlap */
	uint32_t hull_corners; /* of the convex hull of the positions */
	bool hull_thinned;     /* it has more */
	double hull_area;      /* in squares of the file's unit */
	const char *lattice;
	bool has_place;                  /* it is known where on the earth this is: */
	const char *no_place;            /* or why not */
	double area, perimeter;          /* of the hull by geodesics: square metres, metres */
	double south, west, north, east; /* of the hull, degrees */
	const char *mgrs;                /* of the middle, a square of 1 km; "": none */
	char *const *difference;         /* between header and records, in words */
	size_t ndifference;
	double inner_min[3], inner_max[3]; /* bounds of 99.9 % of the records at least: no more than a 6,000th lies beyond each
					      side; NAN: unknown */
	uint64_t most_points;              /* at the position that most records share; 0: each has one, or it is not known */
	double most_at[2];                 /* that position, x and y */
};
int acut_inspect(struct acut *, int fd, const char *name, const char *format, const char *columns,
		 const struct acut_inspected **ret);

/* ---- geoid grids that the daemon keeps ---- */

struct acut_geoid {
	const char *name, *hash, *description, *date;
	uint32_t width, height, uid;
	uint64_t bytes;
	double min, max;             /* metres above the ellipsoid */
	double rms_error, max_error; /* of the interpolation, as its author states them; NAN: unknown */
};
/* A checked copy of GeographicLib's PGM `file` (an open regular file, borrowed) under `name`. */
int acut_geoid_add(struct acut *, int fd, const char *name, const char *file, const struct acut_geoid **ret);
int acut_geoids(struct acut *, void (*each)(void *ctx, const struct acut_geoid *), void *ctx); /* by name */
int acut_geoid_remove(struct acut *, const char *name);

/* ---- the disk ---- */

struct acut_cache_kind {
	const char *name; /* "datasets", "domains", ... */
	uint64_t bytes, entries;
	bool state; /* below the state folder; else below the cache's */
};
struct acut_cache_stat {
	const struct acut_cache_kind *kinds;
	size_t nkinds;
	struct acut_side state, cache;
	bool one_file_system, measured;
	const char *disk_limit, *keep_free_limit;
	uint64_t evicted_bytes, evicted_entries;
};
int acut_cache_stat(struct acut *, const struct acut_cache_stat **ret);

struct acut_cache_damage {
	const char *what, *dataset; /* "segment", "domain", ...; "": of no dataset */
	struct acut_failure error;
	bool derived, removed; /* it can be made again; and is removed */
};
struct acut_cache_verified {
	uint64_t files, bytes, damaged, derived; /* damaged: of what was pushed */
	uint64_t newer, derived_newer;           /* not damaged, but of a newer version than the daemon's */
};
/* Reads everything that the daemon keeps; `damage` for each damaged thing, and each of a newer version (error.code
 * "version"). progress->points are bytes. */
int acut_cache_verify(struct acut *, void (*damage)(void *ctx, const struct acut_cache_damage *), acut_progress_fn progress,
		      void *ctx, struct acut_cache_verified *ret);
/* What a daemon took of the finished domains of a pack, or of several. */
struct acut_cache_adopted {
	uint64_t packs, domains, bytes; /* domains that are in its store now; their bytes */
	uint64_t there, flat;           /* were in it already; are of a survey without triangles, which no store has */
};
/* Gives the daemon the finished domains of packs, which the tasks of acut-cluster make. `next` gives one after the other, and
 * NULL when there are no more; the name is for messages, *ret_fd stays the caller's. Non-zero from it ends the call and is
 * returned. A pack that is refused ends it, too; domains of earlier ones stay. Administrators. */
int acut_cache_adopt(struct acut *, int (*next)(void *ctx, const char **ret_name, int *ret_fd), acut_progress_fn progress,
		     void *ctx, struct acut_cache_adopted *ret);
/* all: removes everything derived. */
int acut_cache_gc(struct acut *, bool all, uint64_t *ret_bytes, uint64_t *ret_entries);

/* ---- watching ---- */

/* One sample of the Prometheus text format. */
struct acut_metric {
	const char *name, *type, *help; /* type: "counter", "gauge" */
	char *const *label;             /* name, value, name, value, ... */
	size_t nlabel;                  /* pairs */
	double value;
};
/* Samples of one name may come apart; the caller gathers them. */
int acut_metrics(struct acut *, void (*each)(void *ctx, const struct acut_metric *), void *ctx);

struct acut_check {
	const char *name, *state;   /* state: "ok", "warning", "wrong", "unknown" */
	const char *message, *hint; /* hint: what to do, "": nothing */
};
/* The health check of the daemon. */
int acut_doctor(struct acut *, void (*each)(void *ctx, const struct acut_check *), void *ctx);

/* ---- jobs ---- */

struct acut_removed {
	const char *rule;
	uint64_t count;
};
struct acut_report {
	uint64_t points, used, vertices, triangles, hull, domains, halo, peak_rss_bytes;
	const char *digest, *vertex_digest;
	const struct acut_removed *removed;
	size_t nremoved;
	double seconds, stage_seconds, first_triangle_seconds;
	uint64_t domains_reused;                            /* of `domains`: found finished, not made by this job */
	uint64_t points_read, cells_read;                   /* records, from the cache; cells, for halos */
	double seal_seconds, plan_seconds, domains_seconds; /* of staging; up to the plan; from there to the end */
	bool window;      /* of some triangles of a mesh: used, hull, halo and removed mean nothing; points were read for it */
	const char *note; /* "" or a sentence for readers of the mesh */
	uint64_t most_points; /* of the view, at the position that most of them share; 0: each has one, or it is not known */
	double most_at[2];    /* that position, x and y */
	/* Of a view with max-error or max-points: a decimal in units of the heights, the bound that holds for all points; "": of
	 * another view. Then the positions of all these points, those kept, rounds that added some, bounds that were tried. */
	const char *max_error;
	uint64_t positions, kept, rounds, attempts;
	/* And the greatest distance of a point, rounded up to a thousandth of the lattice; "": unknown, of an earlier version. */
	const char *largest_error;
};
struct acut_job {
	uint64_t id, generation;
	const char *dataset, *view, *state, *lattice, *crs, *unit_xy, *unit_z;
	uint32_t uid, pid;
	int64_t submitted_us, finished_us;
	struct acut_progress progress;
	const char *priority; /* "low", "normal", "high" */
	const char *waiting;  /* for what, in words: "memory: needs 134M, 20M are free"; "": it does not */
	uint64_t lacks_space; /* bytes of disk that it waits for; 0: it does not */
	uint32_t position;    /* among those that wait for their turn, from 1; 0: it has had it */
	bool final, has_report, has_error;
	struct acut_report report;
	struct acut_failure error;
};
int acut_submit(struct acut *, const char *dataset, uint64_t generation, const char *view, bool bound, bool fresh,
		const struct acut_job **ret);
struct acut_submission {
	const char *dataset;
	uint64_t generation;  /* 0: the newest */
	const char *view;     /* NULL: the default view */
	const char *priority; /* "low", "normal", "high"; NULL: normal, or as the earlier job has it */
	bool bound, fresh;    /* ends with the connection; never an earlier job */
};
int acut_submit_job(struct acut *, const struct acut_submission *, const struct acut_job **ret);
/* Once (follow false), or until the job is final; `changed` (may be NULL) at each change. */
int acut_job_wait(struct acut *, uint64_t id, bool follow, void (*changed)(void *ctx, const struct acut_job *), void *ctx,
		  const struct acut_job **ret);
int acut_job_cancel(struct acut *, uint64_t id, const struct acut_job **ret);
int acut_job_remove(struct acut *, uint64_t id);
/* Calls `each` for every job, paging inside. */
int acut_jobs(struct acut *, void (*each)(void *ctx, const struct acut_job *), void *ctx);

struct acut_dataset {
	const char *name, *lattice, *crs, *unit_xy, *unit_z, *pending;
	uint64_t generation, points, bytes;
	uint32_t files, uid;
	int64_t created_us, pushed_us;
	double min[3], max[3];        /* NAN: unknown */
	int64_t removed_us, until_us; /* 0: it is there; else until when it can be restored */
	bool pinned;
	uint32_t gid; /* its group; ACUT_NO_GROUP: none */
	uint64_t id;
	uint64_t oldest;   /* generation that can be read; 0: unknown */
	uint32_t segments; /* files that hold its points; 0: not known */
	bool merging;      /* some of them become one now */
	uint32_t mode;     /* as of a file: 0640 */
	/* As in acut_mesh_head. Of a list, wkt and geoid are "". */
	uint32_t epsg, epsg_z;
	const char *vertical, *wkt, *geoid;
	/* Of its files of lines: how many there are, and what is in them; 0 of a list. */
	uint32_t line_files;
	uint64_t features[4], lines, vertices; /* features: hard, lake, boundary, hole */
};
#define ACUT_NO_GROUP UINT32_MAX
/* The mode of datasets that this connection makes, by a push or before it: "640", "g+w" (of 640). Unless called it is what
 * the umask of this process leaves of 666. */
int acut_dataset_mode(struct acut *, const char *mode);
/* A dataset before its first push. NULL, "": as the inputs of that push have it. */
int acut_dataset_create(struct acut *, const char *name, const char *scale_xy, const char *scale_z, const char *crs);
int acut_datasets(struct acut *, const char *name /* NULL: all */, void (*each)(void *ctx, const struct acut_dataset *),
		  void *ctx);

/* As it was in that generation: points and files; the call's texts until the next one. */
int acut_dataset_at(struct acut *, const char *dataset, uint64_t generation, struct acut_dataset *ret);

struct acut_generation {
	uint64_t number, undoes; /* the generation that it undoes, or up to which was pruned; 0: none */
	int64_t time_us;         /* 0: not known */
	const char *user, *kind; /* "": not known; push, revert, replace, prune, import */
	const char *content;     /* sum of the hashes of the files that it added */
	uint64_t points_added, points_removed;
	uint32_t uid, files, files_removed; /* files that it added (or brought back), and removed */
	bool readable;                      /* it was not pruned */
};
struct acut_log_file {
	const char *name, *hash; /* XXH3-128 of its bytes; "": not known */
	const char *path;        /* as the client saw it; "": a pipe, or not for this user */
	uint64_t points, size;
	uint32_t source;
	bool removed;           /* by the generation, not added */
	const char *overridden; /* what its records said of its coordinates, where the push overrode that; else "" */
	bool of_lines;          /* a file of lines, which has no points, but: */
	uint64_t features[4], lines, vertices; /* as in acut_dataset */
};
/* Calls that must not call on the connection. */
struct acut_log_sink {
	void (*generation)(void *ctx, const struct acut_generation *);
	void (*file)(void *ctx, const struct acut_log_file *);  /* of it; NULL: files are not asked for */
	void (*end)(void *ctx, const struct acut_generation *); /* of its files; may be NULL */
	void *ctx;
};
/* Ascending by number, paging inside. */
int acut_dataset_log(struct acut *, const char *dataset, const struct acut_log_sink *);

/* "remove" hides a dataset and keeps it for a while (until_us); "restore", by name or (id, where no removed one has
 * that name) by number, brings it back, under another name if `as` is not NULL; "pin": it can be neither removed nor
 * pruned; "unpin". What it is then, until the next call. */
int acut_dataset_change(struct acut *, const char *verb, const char *name, uint64_t id, const char *as, struct acut_dataset *ret);
/* "640", "g+w,o=", as chmod takes it; the owner, and administrators. */
int acut_dataset_chmod(struct acut *, const char *name, const char *mode, struct acut_dataset *ret);
/* To a group that the owner is in; administrators to any. */
int acut_dataset_chgrp(struct acut *, const char *name, uint32_t gid, struct acut_dataset *ret);
/* Administrators. */
int acut_dataset_chown(struct acut *, const char *name, uint32_t uid, struct acut_dataset *ret);
/* What can be restored, by number. */
int acut_datasets_removed(struct acut *, void (*each)(void *ctx, const struct acut_dataset *), void *ctx);

struct acut_reverted {
	uint64_t generation, undone, points; /* the new one; that it undoes; of the dataset now */
	uint32_t files, files_removed;       /* brought back; taken away */
	uint64_t points_added, points_removed;
};
/* generation 0: the newest. */
int acut_dataset_revert(struct acut *, const char *dataset, uint64_t generation, struct acut_reverted *ret);

struct acut_pruned {
	uint64_t oldest;                            /* generation that can be read now */
	uint64_t generations, files, points, bytes; /* that went; bytes on the disk */
	uint64_t segments;                          /* files of points that were made anew, or went */
};
/* All generations but the newest `keep` go, or all before generation `before`; the other one is 0. */
int acut_dataset_prune(struct acut *, const char *dataset, uint64_t keep, uint64_t before, struct acut_pruned *ret);

struct acut_discarded {
	uint64_t pushes, files, bytes; /* bytes on the disk, at most */
	const uint64_t *open;          /* numbers of pushes that go on, and keep what they have, until the next call */
	size_t nopen;
};
/* What interrupted pushes of this user into a dataset left goes; with `all` (1) that of all users, for its owner and
 * administrators. */
int acut_dataset_discard(struct acut *, const char *dataset, int all, struct acut_discarded *ret);

struct acut_plan {
	uint64_t points, domains, memory_bytes, disk_bytes;
	uint64_t domains_reused; /* of `domains`: there already, finished */
	bool exact;
	double seconds;
	uint32_t load, threads;
};
int acut_plan(struct acut *, const char *dataset, uint64_t generation, const char *view, const struct acut_plan **ret);

/* ---- backups, exports, imports ---- */

struct acut_backup_ready {
	uint64_t files, bytes;
	uint64_t damaged;           /* datasets whose list of files is damaged: all of their files are kept */
	struct acut_failure damage; /* if there are any: what is wrong with the first */
	const char *identity;       /* of the store and the dataset: no two have the same, whatever their names; "": not known */
	uint64_t state_device, state_inode, cache_device, cache_inode; /* of the daemon's folders; zeros: not known */
};
struct acut_backup_file {
	const char *name; /* relative, with '/', nothing in it climbs */
	uint64_t size;
	bool lasting; /* a file of this name never has other bytes */
	int fd;       /* for reading; closed when the callback returns */
};
/* Takes the files of the whole state (dataset NULL: what acutd started on them has, as of this moment), or of one
 * dataset ("manifest" last). Non-zero from a callback ends it and is returned. */
struct acut_backup_sink {
	int (*ready)(void *ctx, const struct acut_backup_ready *); /* may be NULL */
	int (*file)(void *ctx, const struct acut_backup_file *);
	void *ctx;
};
int acut_backup(struct acut *, const char *dataset, const struct acut_backup_sink *);

struct acut_imported {
	const char *dataset;
	uint64_t generation, points;
};
/* A new dataset of the files of one: `next` gives them one after the other, "manifest" first, and NULL when there are no
 * more; *ret_fd stays the caller's. Non-zero from it ends it and is returned. */
int acut_import(struct acut *, const char *dataset, int (*next)(void *ctx, const char **ret_name, int *ret_fd), void *ctx,
		const struct acut_imported **ret);

/* ---- the mesh ---- */

struct acut_mesh_head {
	const char *lattice, *scale_xy, *scale_z, *crs, *unit_xy, *unit_z, *view, *stream_id;
	int64_t k[3];              /* coordinate = (X + k) * scale */
	int32_t box[6];            /* min x y z, max x y z: holds all vertices */
	int64_t scale_mantissa[2]; /* scale = mantissa * 10^exponent; [0] of x and y, [1] of z */
	int32_t scale_exponent[2];
	/* The coordinate system, of which `crs` has both halves, "X and y + heights". From an older daemon the last two are "".
	 */
	uint32_t epsg, epsg_z; /* of x and y, and of heights; 0: no number is known */
	const char *vertical;  /* the half of the heights: "EPSG:5720", a name; "": none is known */
	/* As an input carried it, in one line of at most 32,768 bytes; "": none did. It may be that of x and y alone. */
	const char *wkt;
	const char *geoid; /* "WAY HASH NAME" of the grid that converted the heights; "": none did */
	bool lines;        /* it has breaklines, shores, boundaries or holes, so blocks may have flags */
	bool bounded;      /* it ends at boundaries or holes: the tail's hull is 0 */
};
/* The class of a record, and the number of the file that it is of (acut_log_file.source). */
struct acut_mesh_origin {
	uint32_t source;
	uint8_t cls, zero[3];
};
struct acut_mesh_block {
	uint64_t index, first;
	int64_t box[4]; /* the domain's region, closed, doubled lattice numbers: min x y, max x y;
			 * pieces of one domain have the same */
	const uint64_t *foreign;
	const int32_t (*vertex)[3];
	const uint32_t (*triangle)[3]; /* local numbers: foreign first, then new */
	const uint8_t *final;          /* bit set over nforeign + nnew */
	/* One byte a triangle: bit k: the side across from corner k is a piece of a line (a breakline, a shore). NULL: none is.
	 */
	const uint8_t *flags;
	uint32_t nforeign, nnew, ntriangle;
	/* Positions of all of these: of the foreign ones, then `vertex`. Valid as long as the other arrays: during the callback,
	 * of a fetch by steps until the next call. May be NULL if the block has no vertices. */
	const int32_t (*local)[3];
	/* Of a view with `hidden`: the record of each new vertex; else NULL. */
	const struct acut_mesh_origin *origin;
};
struct acut_mesh_tail {
	uint64_t blocks, vertices, triangles, hull;
	int32_t box[6];
	const char *digest, *vertex_digest, *report;
};
/* Non-zero from a callback ends the fetch with "cancelled". */
struct acut_mesh_sink {
	int (*head)(void *ctx, const struct acut_mesh_head *);
	int (*block)(void *ctx, const struct acut_mesh_block *);
	int (*tail)(void *ctx, const struct acut_mesh_tail *); /* digests were computed here and agreed */
	acut_progress_fn progress;                             /* may be NULL */
	void *ctx;
};
/* Streams the mesh of a job from block 0; checks frames, numbering and both digests ("digest-mismatch"). A
 * stream that ends without its tail, or with an error in it, is an error. What the sink gets is valid
 * during the callback; until the tail came, it is not yet known to be whole. */
int acut_fetch(struct acut *, uint64_t job, const struct acut_mesh_sink *);
/* From now on fetches are of those triangles only that meet this area ("box:X1,Y1,X2,Y2" or "area@E:RINGS",
 * protocol.md), of jobs that run too; the tail is then of these. NULL: of all again. Copied; ACUT_E_NOMEM. */
int acut_fetch_window(struct acut *, const char *area);
/*
 * The difference between two meshes of a dataset under one view: that of generation `since`, as its newest finished job made
 * it, and that of `job`, which must be done. Regions are those of the blocks (`box`). A reader that keeps the old mesh by
 * region removes the regions that are gone and adds the blocks that come. Any other reader removes each triangle whose
 * circumcentre is in a region that is gone (low < c < high on both axes, in doubled lattice numbers). For a circumcentre on a
 * border, let p be the corner with the greatest x (of two such, the greater y), and q and r the next ones, counter-clockwise:
 * on a border in x it counts as greater if q.y > r.y and as less if q.y < r.y, on one in y as greater if q.x < r.x and as
 * less if q.x > r.x; if they are equal, p is the greatest of the two others instead. Vertices are numbered within this
 * stream. A region of which only heights have changed is gone and comes again.
 */
struct acut_mesh_base {
	uint64_t generation, job;                                            /* of the old mesh */
	const char *old_digest, *old_vertex_digest, *digest, *vertex_digest; /* of the meshes, whole */
	uint64_t gone, gone_triangles, kept, kept_triangles;                 /* regions with triangles, of the old mesh */
};
struct acut_mesh_region {
	int64_t box[4];
	uint64_t triangles;
	const char *digest; /* of these */
};
struct acut_changes_sink {
	struct acut_mesh_sink mesh; /* the head first; then `base`, each `gone`, the blocks, the tail, which is of this stream */
	int (*base)(void *ctx, const struct acut_mesh_base *);
	int (*gone)(void *ctx, const struct acut_mesh_region *);
};
/* Callbacks get the ctx of `mesh`. Before `tail` the digests are checked: the old one without the regions that are gone and
 * with the blocks that came is the new one ("digest-mismatch"). "stream-gone": the regions of the old mesh are unknown. Such
 * a fetch cannot be continued (acut_fetch_state). */
int acut_fetch_changes(struct acut *, uint64_t job, uint64_t since, const struct acut_changes_sink *);
/* The state from which a fetch can be continued, on this connection or another one; its size grows with the vertices that are
 * not final yet. Inside of the sink's `block` it is as of that block, which the callback must then take; after a failed
 * fetch, until the next call, as of the last block that was taken (ACUT_E_USAGE if there is none). The caller frees *ret with
 * free(). */
int acut_fetch_state(struct acut *, void **ret, size_t *ret_size);
/* Continues from a state: `head` comes again, then the first block after those of the state; `tail` is of the whole mesh,
 * digests included. "stream-gone": the job's mesh does not come in these blocks any more; "corrupt": the state is damaged;
 * "version": it is of another version of this library. After each of these, fetch it from the start. */
int acut_fetch_from(struct acut *, const void *state, size_t size, const struct acut_mesh_sink *);

/*
 * The same fetches for a caller with a loop of its own: begin, then step until it gives 0. A step waits for the next frame,
 * hands it to the sink, and gives 1. The data in the sink stays valid until the next call on the connection, except the texts
 * of a tail and of the structs of `base` and `gone`. Any other call ends the fetch, and so does acut_fetch_end (without a
 * fetch it does nothing). `state` (size bytes; NULL: from the start) as acut_fetch_from takes it, with job 0. since 0: the
 * whole mesh, and only sink->mesh is used. The caller keeps the sink until the end.
 */
int acut_fetch_begin(struct acut *, uint64_t job, uint64_t since, const void *state, size_t size,
		     const struct acut_changes_sink *);
int acut_fetch_step(struct acut *);
void acut_fetch_end(struct acut *);

/* Arrays of a block, for which the caller has room: nearest doubles of its nnew vertices, and the ntriangle triangles
 * with the numbers that vertices have in the mesh (or in the stream, of a window or of changes). */
void acut_block_coordinates(const struct acut_mesh_head *, const struct acut_mesh_block *, double (*ret)[3]);
void acut_block_triangles(const struct acut_mesh_block *, uint64_t (*ret)[3]);

/* Coordinates from lattice numbers: nearest double; exact decimal text into buf (48 bytes).
 * axis: 0 x, 1 y, 2 z. */
double acut_coordinate(const struct acut_mesh_head *, int axis, int32_t number);
char *acut_coordinate_text(const struct acut_mesh_head *, int axis, int32_t number, char *buf);

#ifdef __cplusplus
}
#endif

#endif
