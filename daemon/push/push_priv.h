/* What the files of this room share. Loop unless a function says "worker" or "any thread". */
#ifndef PUSH_PRIV_H
#define PUSH_PRIV_H

#include <string.h>

#include "admission.h"
#include "agree_set.h"
#include "breaklines.h"
#include "dataset.h"
#include "file_hash.h"
#include "geoid.h"
#include "grid_manifest.h"
#include "grid_stage.h"
#include "lock.h"
#include "names.h"
#include "push.h"
#include "admission_guard.h"

enum { PUSHES_MAX = 1024 };

struct pushes {
	struct core *core;
	struct admission *admission;
	struct datasets *datasets;
	struct geoids *geoids;
	struct push *first; /* the youngest first */
};

/* What a request asks for. Those without a comment come from the client. */
enum push_kind {
	PUSH_BEGIN,
	PUSH_PROBE,
	PUSH_PLAN,
	PUSH_STAGE, /* internal: memory for the stage */
	PUSH_FILE,
	PUSH_SYNC, /* internal: what was staged becomes durable */
	PUSH_PARK, /* internal: the stage goes to the disk and returns its memory */
	PUSH_COMMIT,
	PUSH_ABORT,
	PUSH_CLOSE, /* internal, the last one */
	PUSH_KINDS
};

/* An input that comes through a pipe (push_stream.c). */
struct push_stream {
	struct push_stream *next;
	struct push *push;
	char *name;
	int fd, spool; /* the pipe's reading end; the file of spooled bytes, -1: none yet */
	void *watch;   /* of whoever watches the pipe */
	struct sched_task task;
	bool busy;                        /* `task` spools bytes */
	bool text;                        /* of a text that can be read forwards */
	bool spooled;                     /* the worker has spooled all that it must, or has set err */
	bool ready;                       /* the same, for the loop */
	bool forward;                     /* the rest is read from the pipe */
	bool ended;                       /* the pipe has ended */
	bool request_waits;               /* its File waits for the pipe */
	uint8_t head[INPUT_FORWARD_LOOK]; /* the first bytes */
	size_t nhead;
	uint64_t size;     /* spooled */
	uint64_t reserved; /* bytes of the disk */
	uint64_t claimed;  /* points, by its header */
	bool announced;    /* the client has said what will come: */
	struct digest hash;
	uint64_t announced_size;
	struct digest_stream *seen; /* hash of what a File that reads forwards has got */
	uint64_t seen_size;
	struct err err;
	struct input *input; /* of its File, while that runs */
	struct pipe_ingested in;
};

enum { PUSH_READING_SIZE = 64 };

/* A file of lines that was staged. */
struct push_lines_file {
	struct push_lines_file *next;
	struct grid_lines lines;
};

struct push_request {
	struct push_request *next;
	struct push *push;
	enum push_kind kind;
	void *token;
	int fd;
	char *name, *format, *columns, *path;
	char *replaces; /* a file of the dataset, by path or name; "": none */
	bool checksum, add, replace, projected, decimal_comma;
	bool announced; /* the client has said hash and size of a stream */
	uint64_t announced_size;
	bool sealing;               /* a commit that several workers seal */
	struct push_stream *stream; /* where it comes from; NULL: a file */
	/* of the worker */
	bool stream_dry; /* the pipe is empty: the request continues later */
	int r;
	struct err err;
	struct input_info info;
	char info_format[16];
	char overridden[GRID_SOURCE_OVERRIDDEN]; /* what its records say, where the push overrides that */
	char *wkt;                               /* of its system; NULL: none */
	struct client_file id;
	uint32_t source;
	struct pipe_ingested in;
	struct digest hash;
	struct file_hashing hashing;
	struct push_lines_file *lines; /* of an input of lines, when it is staged */
	enum push_known_as known;
	bool in_base;        /* known, because the dataset has it */
	size_t target;       /* 1 + the index in push.base of the source that it replaces; 0: none */
	struct input *whole; /* a file that several workers read; the loop closes it */
	struct push_helpers *helpers;
	struct push_offer *offer; /* with the source that this file is, at this index: */
	size_t adopted;
};

/* The coordinate system of files; each has one of its own at most. */
struct push_crs {
	struct crs_info crs;
	char key[DIGEST_HEX_SIZE];
	const char *wkt; /* of the first source of the push that carries one; NULL: none does; of push.texts */
};

/* What is kept of a file that was probed. */
struct push_probed {
	char *name;
	const char *path;                 /* in the memory of `name` */
	const char *overridden, *reading; /* as grid_source has them; of push.texts, as the next */
	const char *wkt;                  /* NULL: none */
	struct client_file id;
	struct agree_input in;          /* its systems are of push.crs_seen */
	size_t read_bytes;              /* memory to decode it */
	uint64_t claimed;               /* points, by its header; 0: it does not say */
	struct push_excluded *excluded; /* why it is not part of the plan; NULL: it is */
	bool replace;                   /* it replaces the sources of its path ... */
	size_t target;                  /* ... and this one, as push_request.target */
};

/* A pending push of the dataset, as this push found it (push_pending.c). */
struct push_offer {
	uint64_t id, stamp; /* as of struct pending */
	uint32_t files;
	bool own;                        /* of the same user: only these are continued */
	struct grid_manifest *manifest;  /* NULL: it cannot be read */
	struct names paths;              /* of its sources */
	uint32_t last;                   /* largest number of a source in its stage */
	char reading[PUSH_READING_SIZE]; /* how its files were read; "": with other options than this push */
	const char *useless;             /* why nobody can continue it; NULL: somebody can */
	char unread[160]; /* why it cannot be read, now or by this version: it stays; "": it was read, or is useless */
	bool *gone;       /* by source: not pending any more after the commit of this push */
};

struct push {
	struct push *next;
	struct pushes *pushes;
	struct admission_stage admission;
	size_t charged; /* bytes of LEDGER_JOBS */
	struct dataset *dataset;
	uint64_t id;
	uint64_t stem; /* the number in the names of its staged files: its own, or that of the pending push that it continues */
	struct push_calls calls;
	void *ctx;
	struct peer peer;
	char *format;
	bool accept_truncated, strict, has_crop;
	double crop[4];

	/* The queue. */
	struct sched_task task;
	struct sched_owner owner;                      /* of all its tasks */
	struct push_request *requests, **requests_end; /* the first one is being handled while `busy` */
	bool busy;
	bool left;                        /* its caller is gone: what is queued is cancelled */
	bool committed, opened;           /* opened: the dataset's folder */
	bool commit_row_queued;           /* the row of its commit is on its way */
	bool has_row;                     /* the catalogue has its row, or will */
	bool row_queued;                  /* its row is on its way: nothing is written before it is there */
	struct admission_guard row_guard; /* around row_queued, and the broken_err of a row that failed, for workers */
	_Atomic bool row_awaited;         /* a worker has something to write */
	bool reading_base;                /* between dataset_read_begin and _end */
	bool base_settled;                /* what the dataset had is known (push_begin_done) */
	/* The first request waits for memory: its worker is done, and `done` is called again; with `retry` all of it is. */
	bool waits_memory, retry;
	bool removes_old_manifest; /* nobody opens the manifest before its commit */
	struct push_stream *streams;
	struct push_request *close_request; /* made at the beginning, so that closing needs no memory */
	unsigned unanswered;                /* PROBE and FILE requests */

	/* The dataset as the push found it. */
	struct grid_manifest *base; /* NULL: no generation */
	uint64_t base_generation;
	char base_name[64];
	struct names base_paths; /* live sources of `base` */
	struct agree agree;      /* its coordinate system, plane and lattice */

	/* Its files (push_table.c). */
	struct push_probed *probes;
	size_t nprobes;
	struct names probe_names, probe_paths;
	char **texts; /* that many files share, each once */
	size_t ntexts;
	struct names text_keys;
	struct push_crs **crs_seen; /* coordinate systems of the files, each once */
	size_t ncrs;
	struct names crs_keys;
	uint64_t table_bytes, table_used; /* charged, and needed, for all that */
	/* Sources of `base` that the commit replaces: a flag for each, and their numbers. NULL: nothing is replaced. */
	bool *is_replaced;
	uint32_t *replaced;
	size_t nreplaced;

	/* Pending pushes that it can continue, the one that it continues, and what it becomes (push_pending.c). */
	struct push_offer *offers, *taken; /* taken: of the offers; NULL: none */
	size_t noffers;
	struct grid_manifest *adopt; /* of `taken` */
	bool *adopt_named;           /* by source: the client named it again */
	size_t nadopt_named;
	struct pending *pending; /* what it continues, or will become */
	char note[256];
	char reading[PUSH_READING_SIZE]; /* how all its files are read; "": no file yet */
	bool on_disk;                    /* its files on the disk suffice to continue it */
	bool aborted, kept;              /* kept: something of it is pending */
	uint64_t kept_bytes;             /* of that on the disk */

	struct grid_stage *stage;
	uint64_t stage_bytes;         /* charged */
	uint64_t stage_ns;            /* since when */
	struct push_sealing *sealing; /* of the commit, while it runs */
	size_t read_bytes;            /* part of stage_bytes, to decode one file at a time */
	bool broken;
	struct err broken_err;
	struct grid_source *sources;
	size_t nsources;
	uint32_t files;  /* staged whole: as many as sources */
	uint32_t listed; /* of these, in the list on the disk */
	uint32_t durable;
	uint64_t unsynced_points;
	uint64_t synced_ns, begun_ns, asked_ns, commit_ns; /* asked: the last request; commit: the first commit request */

	struct push_lines { /* push_lines.c */
		struct push_lines_file *files;
		bool staged;           /* there may be files of lines */
		uint64_t want, have;   /* memory for the line set, of stage_bytes; want 0: no commit changes lines */
		uint32_t id;           /* number of the source of line vertices; 0: the commit changes no lines */
		bool published, built; /* files have their final names; the line set is there */
		struct breaklines made;
	} lines;

	struct grid_manifest *made; /* by the commit */
	struct grid_apart apart;
	struct dataset_next new_state;
	char made_name[64], sources_name[64];

	struct push_space {                     /* push_space.c */
		struct lock lock;               /* guards what is not atomic */
		_Atomic uint64_t taken, staged; /* bytes of the disk; points of files that are read */
		uint64_t promised;              /* of `taken`, not written yet */
		uint64_t held,
			adopted;    /* bytes of the pending push that it continues, not in `taken`; of a segment of its files */
		uint64_t own, owed; /* of user-disk: of the pushing user; of the owner, if that is another user */
		uint32_t owner;     /* of the dataset, when the push began */
		struct err why;     /* set: there is no space for more */
	} space;
	_Atomic uint64_t progress, claimed; /* points of the file that a worker reads */
	_Atomic uint64_t hashed, hash_end;  /* bytes of a file that is read only for its hash; 0: none is */
	uint64_t progress_ns;               /* when progress was reported last */
	_Atomic uint64_t run_ns;            /* since when a worker runs the first request; 0: none does */
	uint64_t seen, seen_ns;             /* what it had read, and since when that has been so; seen_ns 0: it reads no file */
	bool holds;                         /* sched_hold, and not sched_release yet */
	atomic_bool cancel;
};

/* Charged for an open push: itself, its last request, its texts. */
enum { PUSH_BYTES = sizeof(struct push) + sizeof(struct push_request) + 512 };

/* ---- handlers of requests ---- */

/*
 * `start` (loop) returns 0: submit push.task, which it may change, for `run`; PUSH_NOW: no task, `done` at once; PUSH_WAIT: call
 * it again later; negative: `done` at once with err. `run` (worker). `done` (loop) answers, and returns true if the request ends;
 * false: it ends later by push_request_end, or starts again.
 */
enum { PUSH_NOW = 1, PUSH_WAIT = 2 };
struct push_handler {
	int (*start)(struct push *, struct push_request *, struct err *err);
	void (*run)(struct push *, struct push_request *);
	bool (*done)(struct push *, struct push_request *, const struct err *why);
};
extern const struct push_handler push_handlers[PUSH_KINDS];
#define PUSH_HANDLER(name)                                                              \
	int push_##name##_start(struct push *, struct push_request *, struct err *err); \
	void push_##name##_run(struct push *, struct push_request *);                   \
	bool push_##name##_done(struct push *, struct push_request *, const struct err *why)
PUSH_HANDLER(begin);  /* push_begin.c */
PUSH_HANDLER(probe);  /* push_probe.c */
PUSH_HANDLER(plan);   /* push_probe.c */
PUSH_HANDLER(stage);  /* push_stage.c */
PUSH_HANDLER(file);   /* push_file.c */
PUSH_HANDLER(sync);   /* push_stage.c */
PUSH_HANDLER(park);   /* push_close.c */
PUSH_HANDLER(commit); /* push_commit.c */
PUSH_HANDLER(close);  /* push_close.c; its `run` is that of an abort, too */
int push_abort_start(struct push *, struct push_request *, struct err *err);
bool push_abort_done(struct push *, struct push_request *, const struct err *why);

/* push.c */
extern const struct admission_stage_calls push_stage_calls;
struct push *push_free(struct push *); /* NULL is fine; returns NULL */
/* Adds a request to the queue, or (front) before all others. NULL: no memory. */
struct push_request *push_request_new(struct push *, enum push_kind, void *token, bool front);
void push_request_end(struct push *);  /* the first one: frees it */
void push_request_done(struct push *); /* the first one: its task is over; request->r and ->err say how */
void push_pump(struct push *);         /* handles requests as far as possible */
void push_retry(struct push *);
void push_tick(struct push *);
void push_break(struct push *, const struct err *why); /* nothing can be staged or committed any more */
void push_remove_files(struct push *);
static inline void push_task_bytes(struct push *p, enum ledger_name name, uint64_t bytes)
{
	p->task.name = name;
	p->task.bytes = bytes;
}

/* push_begin.c */
char *push_copy_text(const char *text); /* NULL counts as ""; NULL: no memory. Any thread */
/* Worker: waits for the push's row in the catalogue. Ends with the push's cancel. */
int push_row_wait(void *push, struct err *err);
void push_row_wake(struct push *);

/* push_probe.c */
struct input_options push_options(const struct push *, const struct push_request *); /* any thread */
void push_remember_info(struct push_request *, const struct input *);                /* worker: into request->info */

/* push_file.c. Worker: all is read: makes its hash, and checks that the file has not changed. */
int push_file_finish(struct push *, struct push_request *);

/* push_stage.c */
/* A push becomes durable after that many seconds, or points. */
#define PUSH_DURABLE_SECONDS 5.0
#define PUSH_DURABLE_POINTS ((UINT64_C(1) << 30) / sizeof(struct point))
void push_stage_give(struct push *); /* returns the memory of a stage that was freed */

/* push_event.c */
#define ABOUT_PUSH(p)                                                                            \
	(&(const struct log_about){.push = (p)->id,                                              \
				   .dataset = (p)->dataset->onestep ? NULL : (p)->dataset->name, \
				   ABOUT_USER((p)->peer.uid),                                    \
				   .pid = (p)->peer.pid})
void push_event_committed(const struct push *);
void push_event_failed(const struct push *, const struct err *why);                    /* before it is broken */
void push_event_refused(const struct push *, const char *file, const struct err *why); /* one file */

/* ---- reading files ---- */

/* push_stream.c */
struct push_stream *push_stream_find(const struct push *, const char *name);
int push_stream_open(struct push_request *, struct err *err); /* the spooled bytes become the request's descriptor */
/* Worker: stages the next piece. request->in: points so far; request->stream_dry: more will come. */
void push_stream_run(struct push *, struct push_request *);
int push_stream_known(struct push *, struct push_request *); /* worker: push_known, for a stream */
int push_stream_kept(struct push_request *);                 /* worker: a stream that was spooled whole is what was announced */
void push_stream_wait(struct push_stream *);                 /* submits push.task again when the pipe has bytes */
void push_streams_wake(struct push *);                       /* the push is cancelled: nothing waits any more */
bool push_streams_busy(const struct push *);
void push_streams_free(struct push *);

/* push_helpers.c: request->whole by several workers; push_request_done when all are done */
int push_helpers_start(struct push *, struct push_request *, struct err *err);
struct push_helpers *push_helpers_free(struct push_helpers *);
uint64_t push_helpers_held(const struct push_helpers *);      /* bytes of LEDGER_INPUT; NULL: 0 */
uint64_t push_helpers_step(uint64_t parts, unsigned members); /* parts of a batch */

static inline struct file_hash_watch push_hash_watch(struct push *p)
{
	return (struct file_hash_watch){&p->cancel, &p->hashed, &p->hash_end};
}

/* push_lines.c. Workers, but for those with "loop". */
int push_lines_begin(struct push *, struct push_request *, struct pipe_ingest_params *);
int push_lines_end(struct push *, struct push_request *, struct breakline_writer *, int r); /* r: of what was written */
void push_lines_source(struct push *, struct push_request *, struct grid_source *);         /* loop */
void push_lines_free(struct push *);
bool push_lines_change(const struct push *);              /* loop: the commit adds or replaces lines */
bool push_lines_need_memory(struct push *);               /* loop: the stage must come back smaller */
bool push_lines_again(struct push *, const struct err *); /* loop: a commit that failed starts again, with more memory */
int push_lines_build(struct push *, struct err *err);
void push_lines_put(struct push *, struct grid_manifest *);
void push_lines_undo(struct push *);

/* push_seal.c: the stage becomes a segment */
struct push_sealing *push_sealing_new(struct push *, struct err *err); /* worker; NULL: err says why */
struct push_sealing *push_sealing_free(struct push_sealing *);         /* NULL is fine; returns NULL */
void push_sealing_start(struct push_sealing *);                        /* submits helpers, beside a task that calls: */
int push_sealing_finish(struct push_sealing *, struct grid_segment_info *ret, struct err *err); /* worker */
void push_sealing_end(struct push_sealing *); /* that task is over; push_request_done when the helpers are */

/* ---- what is known of files ---- */

/* push_table.c */
const struct crs_info *push_keep_crs(struct push *, const struct crs_info *); /* NULL: no memory */
int push_remember_probe(struct push *, const struct push_request *, struct err *err);
size_t push_read_bytes(const struct push *);                                /* memory to read any of them */
struct push_probed *push_find_probe(const struct push *, const char *name); /* NULL: not probed */
int push_exclude(struct push_probed *, const struct err *why);              /* from the plan; -ERR_NOMEM */
void push_exclusion(const struct push_probed *, struct err *ret);           /* why it was excluded */
void push_forget_probes(struct push *);
/* Charges bytes for the table. PUSH_WAIT: no memory now (the caller sets waits_memory). -ERR_LIMIT, -ERR_BUSY. */
int push_table_reserve(struct push *, uint64_t bytes, struct err *err);
void push_table_release(struct push *);
/* It waits for memory that nobody will release, and is the youngest that does: its request must be refused. */
bool push_must_refuse(const struct push *);
static inline uint64_t push_staged_bytes(const struct push *p)
{
	return p->stage_bytes + p->table_bytes;
}
static inline uint64_t push_kept_bytes(const struct push *p) /* beside its stage */
{
	return p->charged + p->table_bytes;
}
static inline bool push_wants_stage(const struct push *p) /* and waits for it */
{
	return p->requests && p->requests->kind == PUSH_STAGE && !p->busy && !p->left && !p->commit_row_queued;
}

/* push_known.c. Worker. */
int push_known_index(const struct grid_manifest *, struct names *ret_paths, struct err *err); /* paths of live sources */
/* The source of a manifest that this file is; NULL: none. `paths`: of push_known_index. */
const struct grid_source *push_known_find(const struct push *, const struct grid_manifest *, const struct names *paths,
					  const struct push_request *);
/* Sets request->known, and request->in.points of a known file. Refuses another file with the same path. */
int push_known(struct push *, struct push_request *);

/* push_replace.c */
int push_replace_target(struct push *, struct push_request *);                            /* worker: sets request->target */
int push_replace_room(struct push *, const struct push_request *, struct err *err);       /* memory for it */
bool push_replace_means(const struct grid_source *target, const struct grid_source *);    /* a target means this source, too */
uint32_t push_replace_note(struct push *, const char *path, bool replace, size_t target); /* returns how many it replaces */
int push_replace_apply(struct push *, struct grid_manifest *, struct err *err);           /* worker: in the next manifest */
void push_replace_nothing(struct push *);
void push_replace_free(struct push *);

/* push_reading.c: how files are read */
/* This push would read the source as it was read; and the error if not. */
bool push_reading_same(const struct push *, const struct push_request *, const struct grid_source *);
int push_reading_refuse(const struct push *, struct push_request *, const struct grid_source *);
/* The same for a pending push, whose files all have one reading. */
void push_note_reading(struct push *, const struct push_request *);
bool push_same_reading(const struct push_offer *, const struct push_request *);

/* ---- lattice, plane, coordinate system ---- */

/* Any thread: an error of the input's own device gets the field PUSH_INPUT: the others of the push are as good as before. */
#define PUSH_INPUT "input"
void push_mark_unreadable(struct push_request *);

/* push_agree.c */
struct agree_inputs push_inputs(struct push *);         /* all probes */
int push_agree_begin(struct push *, struct err *err);   /* worker: checks the parameters against the base */
int push_heights(const struct push *, struct err *err); /* -ERR_USAGE: the base has other heights */
/* Worker: sets the WKT of a manifest, whose generation is set. To be freed when it is written; NULL: nothing. */
char *push_wkt_put(const struct push *, struct grid_manifest *);

/* push_created.c: what dataset_create asks of the first push */
int push_created_scale(struct push *, struct err *err);
int push_created_crs(const struct push *, struct err *err);

/* ---- disk, and pending pushes ---- */

/* push_space.c */
void push_space_claim(struct push *, const struct pending *); /* it left the dataset's list, and counts as before */
int push_space_plan(struct push *, struct err *err);          /* worker: for all probed files */
bool push_space_staged(struct push *, uint64_t points);       /* worker: for points of a file; false: no space */
const struct err *push_space_full(const struct push *);       /* NULL: there was space so far */
void push_space_tick(struct push *);
void push_space_end(struct push *);

/* push_pending.c */
int push_pending_write(struct push *, struct err *err); /* worker: what was staged so far can be continued */
void push_end_files(struct push *);                     /* worker: the files of a push that ends; sets push.kept */
void push_pending_keep(struct push *);                  /* the push has ended, and is pending */
int push_offers_list(struct push *, struct err *err);   /* which pending pushes there are */
int push_offers_read(struct push *, struct err *err);   /* worker: their files. -ERR_BUSY, -ERR_NOMEM */
void push_offers_forget(struct push *);                 /* what was read. Any thread */
void push_offers_settle(struct push *);                 /* drops those of no use; sets push.note */
void push_offers_free(struct push *);
uint64_t push_offers_bytes(const struct push *); /* memory of their tables */
/* The lattice of a pending push with the system that was agreed, for a dataset that has none yet. NULL: there is none. */
const struct lattice *push_offers_near(const struct push *);
/* Worker: searches the file among theirs; sets request->known, ->offer and ->adopted if it is there. */
void push_offers_find(struct push *, struct push_request *);
/* The file of a request that push_offers_find has found counts. Takes its pending push, if this push has not; PUSH_WAIT: no
 * memory now; PUSH_AGAIN: the pending push is not there any more, so the file must be probed again. -ERR_X */
enum { PUSH_AGAIN = 3 };
int push_adopt(struct push *, struct push_request *, struct err *err);
void push_offers_known(struct push *, const char *path); /* the dataset has this file */
void push_offers_committed(struct push *);               /* files that are in the dataset now are not pending any more */

#endif
