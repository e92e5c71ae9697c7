/* The insides of a push, shared by push.c (the queue of what was asked) and push_ask.c (what each asks). */
#ifndef PUSH_PRIV_H
#define PUSH_PRIV_H

#include "admission.h"
#include "dataset.h"
#include "geoid.h"
#include "lock.h"
#include "names.h"
#include "push.h"
#include "push_guard.h"

enum { PUSHES_MAX = 1024 };

struct pushes {
	struct core *core;
	struct admission *admission;
	struct datasets *datasets;
	struct geoids *geoids;
	struct push *first; /* the youngest first */
};

enum push_kind {
	PUSH_BEGIN,
	PUSH_PROBE,
	PUSH_PLAN,
	PUSH_STAGE, /* of our own: memory for the stage */
	PUSH_FILE,
	PUSH_SYNC, /* of our own: what was staged becomes durable */
	PUSH_PARK, /* of our own: the stage goes to disk and gives its memory back */
	PUSH_COMMIT,
	PUSH_ABORT,
	PUSH_CLOSE, /* of our own, the last */
	PUSH_KINDS
};

/* An input that comes through a pipe (push_stream.c). */
struct push_stream {
	struct push_stream *next;
	struct push *push;
	char *name;
	int fd, spool; /* the pipe's reading end; the file of what is kept, -1: none yet */
	void *watch;   /* of whoever watches the pipe */
	struct sched_task task;
	bool busy; /* a worker keeps bytes */
	bool text; /* that can be read forwards */
	bool kept; /* the worker has kept all that it must, or err says why not; the loop: ready */
	bool ready;
	bool forward, ended; /* the rest is read from the pipe; the pipe has ended */
	bool asks;           /* its File waits for the pipe */
	uint8_t look[INPUT_FORWARD_LOOK];
	size_t nlook;
	uint64_t size, room; /* kept; bytes of the disk taken for that */
	uint64_t claimed;    /* points, as its header says */
	bool told;           /* the client has said what will come: */
	struct digest hash;
	uint64_t told_size;
	struct digest_stream *seen; /* what came of it to a File that reads forwards */
	uint64_t seen_size;
	struct err err;
	struct input *input; /* of its File, while that goes on */
	struct pipe_ingested in;
};

enum { PUSH_READING_SIZE = 64 };

/* The sum of a file's bytes, while they are read. */
struct push_hashing {
	struct push *push;
	struct digest_stream *sum; /* NULL: not begun */
	uint64_t at;               /* of the file, up to there */
	int fd;
	const char *name;
	bool missed; /* something was shown that does not follow: all is read once more */
};

struct push_ask {
	struct push_ask *next;
	struct push *push;
	enum push_kind kind;
	void *token;
	int fd;
	char *name, *format, *columns, *path;
	char *replaces; /* file of the dataset, by path or name; "": none */
	bool checksum, add, replace, projected, decimal_comma;
	bool told; /* hash and size of what a stream will bring were said */
	uint64_t told_size;
	bool sealing;               /* a commit, by several workers now */
	struct push_stream *stream; /* it comes from there */
	/* of the worker */
	bool dry; /* the stream's pipe is: the ask goes on later */
	int r;
	struct err err;
	struct input_info info;
	char info_format[16];
	char overridden[GRID_SOURCE_OVERRIDDEN]; /* what its records say, where the push overrides that */
	struct client_file id;
	uint32_t source;
	struct pipe_ingested in;
	struct digest hash;
	struct push_hashing hashing; /* of a file */
	enum push_known_as known;
	size_t target;       /* 1 + which source of push.base `replaces` means; 0: none */
	struct input *whole; /* a file that several workers read; closed by the loop */
	struct push_helpers *crew;
	size_t adopted; /* which source of push.adopt it is */
};

struct push_probed {
	char *name;
	const char *path;                 /* behind the name */
	const char *overridden, *reading; /* as grid_source has them; of push.texts */
	struct client_file id;
	struct lattice_input coords;
	const struct crs_info *crs;   /* what it says; one of push.crs_seen, as the next */
	const struct crs_info *plane; /* what it becomes in the dataset; NULL: not decided */
	size_t read_bytes;            /* what decoding it takes */
	uint64_t claimed;             /* points, as it says; 0: it does not */
	struct push_why *why;         /* it was left out of the plan; NULL: it was not */
	bool replace;                 /* what the dataset has of its path goes, */
	size_t target;                /* and this one, as push_ask.target */
	bool stepped;                 /* `coords` are those on the dataset's plane */
};

/* push_plane.c: where degrees and heights go */
struct push_plane {
	bool projects; /* there are degrees, and they go to `zone` */
	struct crs_zone zone, wanted;
	char datum[64];                         /* of the degrees */
	char created[512];                      /* plane that the dataset was created with; "": it was not */
	char geoid_path[64], geoid[GRID_GEOID]; /* as the manifest keeps it; "": heights stay */
	enum crs_geoid_way way;
};

struct push {
	struct push *next;
	struct pushes *pushes;
	struct admission_stage admission;
	size_t charged; /* of LEDGER_JOBS */
	struct dataset *dataset;
	uint64_t id;
	struct push_calls calls;
	void *ctx;
	struct peer peer;
	char *scale_xy, *scale_z, *format, *utm, *geoid, *geoid_way;
	bool planar, accept_truncated, strict, has_crop;
	double crop[4];

	struct sched_task task;
	struct sched_owner owner;          /* of all its tasks */
	struct push_ask *asks, **asks_end; /* the first is being done if `busy` */
	bool busy, waiting_row, row, left, committed, opened;
	bool row_comes;              /* its row is on its way to the disk: nothing is written before it is there */
	struct push_guard row_guard; /* around row_comes, and broken_err of a row that did not come, for workers */
	_Atomic bool row_awaited;    /* a worker has something to write */
	bool reads;                  /* the dataset's newest manifest, by name */
	bool settled;                /* what was there is known, and the push's own (push_begin_done) */
	/* The first ask waits for memory: its worker is done and `done` is asked again, or all of it is (again). */
	bool lacks, again;
	bool old_goes; /* the manifest before this push's is used by nobody */
	struct push_stream *streams;
	struct push_ask *last; /* made beforehand, so that closing needs no memory */
	unsigned unanswered;

	struct grid_manifest *base; /* as the push found it; NULL: none */
	uint64_t base_generation;   /* of that */
	char base_name[64];
	bool has_lattice;
	struct lattice lattice;
	char lattice_note[512]; /* what it does to inputs that did not ask for it; "" */
	struct push_plane plane;
	char crs[512], unit_xy[16], unit_z[16];
	char crs_of[256]; /* who says so: the dataset, or an input */
	bool has_crs, assumes;
	bool overrides;         /* `assume` is in place of what the inputs say */
	struct crs_info assume; /* for inputs that say nothing */
	struct push_probed *probes;
	size_t nprobes;
	struct names probe_names, probe_paths;
	char **texts; /* what is kept of many files alike, each once */
	size_t ntexts;
	struct names text_keys;
	struct push_crs **crs_seen; /* what the probes say, each once */
	size_t ncrs;
	struct names crs_keys;
	struct names base_paths; /* live sources of `base` */
	/* Sources of `base` that go with the commit: which, and their numbers; NULL: nothing is replaced. */
	bool *goes;
	uint32_t *gone;
	size_t ngone;
	struct grid_manifest *adopt; /* of the interrupted push that this one goes on with; NULL: none */
	struct names adopt_paths;
	bool *adopt_taken; /* the client named that source again */
	size_t ntaken;
	uint32_t adopt_last;     /* the largest number of a source in its stage */
	struct pending *pending; /* what it claims, or becomes */
	bool claims;             /* pending was taken out of the dataset's list */
	uint64_t drops;          /* the number of an interrupted push that did not fit; 0: none */
	bool drops_row;          /* ... and its row may go: nothing of it is left */
	char note[160];
	char reading[PUSH_READING_SIZE]; /* of all its files; "": there is none yet */
	bool on_disk;                    /* its files say that it can be gone on with */
	bool aborted, kept;
	uint64_t table_bytes, table_used; /* charged, and needed, for what is kept of each file */

	struct grid_stage *stage;
	uint64_t stage_bytes;         /* charged */
	uint64_t stage_ns;            /* since when */
	struct push_sealing *sealing; /* of the commit, while it goes on */
	size_t read_bytes;            /* in it, for decoding one file at a time */
	bool broken;
	struct err broken_err;
	struct grid_source *sources;
	size_t nsources;
	uint32_t files; /* staged whole */
	uint32_t durable;
	uint64_t unsynced_points;
	uint64_t synced_ns, begun_ns, asked_ns, commit_ns; /* the last: when the commit was asked for first */

	struct grid_manifest *made;  /* by the commit */
	struct dataset_next becomes; /* by `made` */
	char made_name[64];

	struct push_space {
		struct lock lock;               /* of what is not atomic */
		_Atomic uint64_t taken, staged; /* bytes of the disk; points of files that are read */
		uint64_t promised;              /* of `taken`, not written yet */
		uint64_t own, owed;             /* of user-disk, taken of who pushes; of the owner, if that is another one */
		uint32_t owner;                 /* of the dataset, when the push began */
		struct err why;                 /* there is no room for more */
	} space;
	_Atomic uint64_t progress, claimed; /* points of the file that a worker reads */
	_Atomic uint64_t hashed, hash_end;  /* bytes of the file that is read for its sum alone; 0: none is */
	uint64_t told_ns;
	atomic_bool cancel;
};

/* Charged for an open push: itself, its last ask, its texts. */
enum { PUSH_BYTES = sizeof(struct push) + sizeof(struct push_ask) + 512 };

/* Each kind: `start` (loop) says 0: submit p->task (prepared there) for `run`; PUSH_NOW: nothing for a
 * worker, `done` at once; PUSH_WAIT: ask again later; negative: err says why, `done` at once with it. */
enum { PUSH_NOW = 1, PUSH_WAIT = 2 };
struct push_row {
	int (*start)(struct push *, struct push_ask *, struct err *err);
	void (*run)(struct push *, struct push_ask *);
	/* Answers and tidies up. True: the ask is over; false: it is answered later (push_ask_over), or asked again. */
	bool (*done)(struct push *, struct push_ask *, const struct err *why);
};
extern const struct push_row push_rows[PUSH_KINDS];
extern const struct admission_stage_calls push_stage_calls;
void push_stage_give(struct push *); /* the stage's memory; the stage is gone */

struct input_options push_options(const struct push *, const struct push_ask *); /* push_ask.c */

/* push_stream.c */
struct push_stream *push_stream_find(const struct push *, const char *name);
/* What came through the pipe so far takes the place of a descriptor. Loop. */
int push_stream_open(struct push_ask *, struct err *err);
/* The next piece of its points into the stage: a->in is what came so far, a->dry that there is more to come. */
void push_stream_run(struct push *, struct push_ask *);
/* Worker: push_known of a stream, and what came of one that was kept whole: is it what was said? */
int push_stream_known(struct push *, struct push_ask *);
int push_stream_kept(struct push_ask *);
void push_stream_wait(struct push_stream *); /* the push's task is submitted again when the pipe has bytes */
void push_streams_wake(struct push *);       /* cancelled: nobody waits any longer */
bool push_streams_busy(const struct push *);
void push_streams_free(struct push *);

/* push_begin.c: the row of PUSH_BEGIN; and that in the catalogue, which a worker waits for. It ends with the push's cancel. */
int push_row_wait(void *push, struct err *err);
void push_row_wake(struct push *);
int push_begin_start(struct push *, struct push_ask *, struct err *err);
void push_begin_run(struct push *, struct push_ask *);
bool push_begin_done(struct push *, struct push_ask *, const struct err *why);

/* push_close.c: the rows of PUSH_PARK, PUSH_ABORT and PUSH_CLOSE (whose worker's part is that of both) */
int push_park_start(struct push *, struct push_ask *, struct err *err);
void push_park_run(struct push *, struct push_ask *);
bool push_park_done(struct push *, struct push_ask *, const struct err *why);
int push_close_start(struct push *, struct push_ask *, struct err *err);
int push_abort_start(struct push *, struct push_ask *, struct err *err);
void push_close_run(struct push *, struct push_ask *);
bool push_abort_done(struct push *, struct push_ask *, const struct err *why);
bool push_close_done(struct push *, struct push_ask *, const struct err *why);

/* push_commit.c: the row of PUSH_COMMIT */
int push_commit_start(struct push *, struct push_ask *, struct err *err);
void push_commit_run(struct push *, struct push_ask *);
bool push_commit_done(struct push *, struct push_ask *, const struct err *why);

/* push_event.c */
#define ABOUT_PUSH(p)                                                                            \
	(&(const struct log_about){.push = (p)->id,                                              \
				   .dataset = (p)->dataset->onestep ? NULL : (p)->dataset->name, \
				   ABOUT_USER((p)->peer.uid),                                    \
				   .pid = (p)->peer.pid})
void push_tell_committed(const struct push *);
void push_tell_failed(const struct push *, const struct err *why);                    /* before it is broken */
void push_tell_refused(const struct push *, const char *file, const struct err *why); /* one file of it */

/* push_seal.c: the stage becomes a segment */
struct push_sealing *push_sealing_new(struct push *, struct err *err); /* worker; NULL: err says why */
struct push_sealing *push_sealing_free(struct push_sealing *);
void push_sealing_start(struct push_sealing *); /* loop: helpers, for a task that finishes ... */
int push_sealing_finish(struct push_sealing *, struct grid_segment_info *ret, struct err *err); /* worker */
void push_sealing_end(struct push_sealing *); /* loop: that is over; push_task_over when all are */

/* push.c */
void push_tick(struct push *);
void push_retry(struct push *);
void push_remove_files(struct push *);

struct push_ask *push_ask_new(struct push *, enum push_kind, void *token, bool front); /* NULL: no memory */
void push_break(struct push *, const struct err *why); /* nothing can be staged or committed any more */
void push_ask_over(struct push *);                     /* the first one */
void push_pump(struct push *);

/* Loop: the ask is over, as a->r and a->err say. */
void push_task_over(struct push *);

/* push_parts.c: a->whole by several workers; push_task_over when all are done */
int push_helpers_start(struct push *, struct push_ask *, struct err *err);
struct push_helpers *push_helpers_free(struct push_helpers *);
uint64_t push_helpers_held(const struct push_helpers *);      /* of LEDGER_INPUT, by those who help; NULL: none */
uint64_t push_helpers_step(uint64_t parts, unsigned members); /* parts that are read at a time */
/* push_ask.c: when all was read: hash it, and see that it is still the same file. */
int push_file_finish(struct push *, struct push_ask *);

/* push_input.c: descriptors and what their inputs say */
int push_choose_lattice(struct push *, struct err *err);

/* push_plane.c */
struct push_plane_step {
	struct crs_info from, to; /* params points to these: do not move it */
	struct crs_info plane;    /* as the dataset has it: with what a geoid makes of the heights */
	bool projects, needed;
	struct crs_step_params params;
};
int push_plane_begin(struct push *, struct err *err);  /* worker: what was asked for, against the base */
int push_plane_choose(struct push *, struct err *err); /* from all probes */
/* The heights of the base are those that the push makes. -ERR_USAGE. */
int push_plane_heights(const struct push *, struct err *err);
/* What an input that says this of itself becomes. */
int push_plane_of(const struct push *, const struct crs_info *, struct push_plane_step *ret, struct err *err);
int push_plane_coords(struct push *, struct push_probed *, struct err *err); /* worker */

/* push_probes.c: what is kept of each file */
const struct crs_info *push_keep_crs(struct push *, const struct crs_info *); /* NULL: no memory */
int push_remember_probe(struct push *, const struct push_ask *, struct err *err);
/* Memory to read any of them, one at a time. */
size_t push_read_bytes(const struct push *);
struct push_probed *push_find_probe(const struct push *, const char *name); /* NULL: not probed */
/* `why` is of that file. -ERR_NOMEM. */
int push_leave_out(struct push_probed *, const struct err *why);
void push_left_out(const struct push_probed *, struct err *ret); /* that it was left out for */
void push_forget_probes(struct push *);
/* Memory for that; PUSH_WAIT: there is none now (whoever asked sets `lacks`); -ERR_LIMIT, -ERR_BUSY. */
int push_room(struct push *, uint64_t bytes, struct err *err);
void push_room_give(struct push *);
bool push_waits_in_vain(const struct push *);
/* What it keeps while it waits for its stage, and beside it. */
static inline uint64_t push_staged_bytes(const struct push *p)
{
	return p->stage_bytes + p->table_bytes;
}
static inline bool push_wants_stage(const struct push *p) /* and waits for it */
{
	return p->asks && p->asks->kind == PUSH_STAGE && !p->busy && !p->left && !p->waiting_row;
}
static inline uint64_t push_keeps(const struct push *p)
{
	return p->charged + p->table_bytes;
}

/* What decided about plane and lattice before this push's files: the dataset, an interrupted push; NULL: nothing. */
static inline const struct grid_manifest *push_settled(const struct push *p)
{
	return p->base ? p->base : p->adopt;
}

/* push_space.c: room on the disk */
void push_space_claim(struct push *, const struct pending *); /* loop: it is not in the list any more, and counts as before */
void push_space_unclaim(struct push *);                       /* loop: it is in the list again */
int push_space_plan(struct push *, struct err *err);          /* worker: for all that was probed */
bool push_space_staged(struct push *, uint64_t points);       /* worker: so many of a file more; false: there is no room */
void push_space_adopted(struct push *);
const struct err *push_space_full(const struct push *); /* NULL: there was room so far */
void push_space_tick(struct push *);
void push_space_end(struct push *); /* loop */

/* push_pending.c: pushes that were interrupted */
int push_leave_pending(struct push *, struct err *err);
void push_end_run(struct push *);
void push_becomes_pending(struct push *);
void push_claim(struct push *);
int push_adopt(struct push *, struct err *err);
void push_adopted(struct push *);
void push_adopt_nothing(struct push *);
void push_unclaim(struct push *);

/* push_reading.c: how files are read */
/* For the manifest; what it is and what its records say is known. */
void push_reading_text(const struct push *, const struct push_ask *, char ret[GRID_SOURCE_READING]);
/* Whether this push would read a source of the dataset as it was read; and the error that it would not. */
bool push_reading_same(const struct push *, const struct push_ask *, const struct grid_source *);
int push_reading_refuse(const struct push *, struct push_ask *, const struct grid_source *);
/* The same of an interrupted push: format and columns that were asked for all its files; are they those of this one? */
void push_note_reading(struct push *, const struct push_ask *);
bool push_same_reading(const struct push *, const struct push_ask *);

/* push_hash.c: sums of inputs */
/* XXH3-128 of the first `size` bytes. */
int push_hash(struct push *, int fd, uint64_t size, const char *name, struct digest *ret, struct err *err);
/* The same, of what somebody else reads anyway (input_options.seen): only the rest is read for it. */
void push_hash_begin(struct push_hashing *, struct push *, int fd, const char *name);
void push_hash_seen(void *ctx, uint64_t at, const void *bytes, size_t n);
int push_hash_end(struct push_hashing *, uint64_t size, struct digest *ret, struct err *err); /* and frees */
void push_hash_free(struct push_hashing *);                                                   /* what was begun */
/* Bytes behind what a header tells of that a pushed file may have. */
enum { PUSH_TRAILING_MOST = 1 << 30 };
/* ERR_INPUT if it has more. */
int push_hash_bounded(const struct input_info *, uint64_t size, const char *name, struct err *err);
/* The same, before a sum that is made before the header is read. */
int push_hash_look(struct push_ask *, const struct input_options *, struct err *err);

/* push_known.c: what the dataset has already */
int push_known_index(const struct grid_manifest *, struct names *ret_paths, struct err *err);
/* Sets a->known, and a->in.points of what is known; refuses another file of a name that is there. */
int push_known(struct push *, struct push_ask *);

/* push_replace.c: what it puts others in the place of */
int push_replace_target(struct push *, struct push_ask *);
int push_replace_room(struct push *, const struct push_ask *, struct err *err);
bool push_replace_means(const struct grid_source *target, const struct grid_source *); /* whether it goes with the target */
uint32_t push_replace_note(struct push *, const char *path, bool replace, size_t target);
int push_replace_apply(struct push *, struct grid_manifest *, struct err *err);
void push_replace_nothing(struct push *);
void push_replace_free(struct push *);

/* push_crs.c: coordinate systems and units */
int push_assume_read(struct push *, const struct push_params *, struct err *err);
/* Fills what the input `name` leaves open. -ERR_INPUT: it says something else. */
int push_assume(const struct push *, struct push_ask *); /* into its info.crs, overridden and err */
/* What the dataset is in decides for every further input. */
void push_crs_of_dataset(struct push *, const char *text, const char *unit_xy, const char *unit_z);
bool push_crs_is(const struct push *, const struct grid_manifest *); /* what it is in is what the push is in */
/* All that were probed, and the dataset, must be one; the push's texts are decided. The error names two. */
int push_crs_agree(struct push *, struct err *err);
/* push_created.c: what a dataset that was created beforehand asks of its first push */
int push_created_scale(struct push *, struct err *err);
int push_created_crs(const struct push *, struct err *err);
int push_compatible(struct push *, const char *name, const struct crs_info *, struct err *err);

#endif
