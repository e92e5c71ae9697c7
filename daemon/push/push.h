/*
 * Pushes: files of a client become points of a dataset. A client begins a push, has each file probed, has the lattice planned,
 * stages each file, and commits. The model: push.c.
 *
 * Loop thread. Each request is answered exactly once, in the order of requests, perhaps before the function returns; `why` is
 * NULL on success, and all that an answer points to is valid during the call only. Functions that return int give 0 or -ERR_X.
 */
#ifndef PUSH_H
#define PUSH_H

#include "agree_set.h"
#include "core.h"
#include "dataset.h"
#include "input.h"
#include "pipe.h"

struct admission;
struct geoids;
struct push;
struct pushes;
struct push_stream;

/* ---- all pushes ---- */

int pushes_new(struct core *, struct admission *, struct datasets *, struct geoids *, struct pushes **ret, struct err *err);
struct pushes *pushes_free(struct pushes *); /* no push is open. NULL is fine; returns NULL */
unsigned pushes_open(const struct pushes *); /* number of open pushes */
/* The numbers of those of a user, or of all users, into a dataset: the first `most` of them. Returns how many there are. */
size_t pushes_into(const struct pushes *, const struct dataset *, uint32_t uid, bool all, uint64_t *ret_ids, size_t most);
void pushes_settle(struct pushes *); /* each round of the loop: those that wait try again */
void pushes_tick(struct pushes *);   /* each timer tick */
/* For a stop that takes too long: removes temporary files at once, while workers still run. The process must exit next. */
void pushes_abandon(struct pushes *);
void pushes_held(const struct pushes *, void (*each)(void *ctx, const struct core_holder *), void *ctx);

/* A worker reads a file of it that gives nothing: a disk or a file system without an answer. A read cannot be ended from outside.
 */
struct push_stall {
	uint64_t push;
	uint32_t uid;
	const char *file; /* as the client named it; valid in this round of the loop */
	double seconds;
};
#define PUSH_STALL_SECONDS 15.0
unsigned pushes_stalled(const struct pushes *, struct push_stall *ret_longest); /* how many */

/* ---- answers ---- */

struct push_begun {
	struct push *push;
	uint64_t id;
	const char *lattice; /* "": not chosen yet */
	const char *note;    /* what became of a pending push; "": there was none */
};

enum push_known_as {
	PUSH_NEW,
	PUSH_KNOWN,   /* the dataset has it, or the push has it twice: no File request for it */
	PUSH_ADOPTED, /* staged by the pending push that this one continues: no File request for it */
};
struct push_probe_result {
	const char *name;
	const struct input_info *info; /* NULL: known, so it was not read */
	enum push_known_as known;
	uint64_t points;   /* of a known file */
	uint32_t replaced; /* files of the dataset that an adopted file replaces */
};

struct push_planned {
	const char *lattice, *crs;
	const char *zone, *datum; /* to which degrees are projected, and from which; "": there are none */
	const char *geoid;        /* that shifts heights; "": they stay */
	const char *note;         /* the scale that was chosen for inputs with more digits; "" */
};

struct push_file {
	const char *name;
	const struct grid_lines *lines; /* of an input of lines, else NULL */
	struct pipe_ingested in;
	const char *geoid;      /* that shifted its heights, as in the manifest; "": none */
	uint32_t replaced;      /* files of the dataset that it replaces */
	const char *crs_of;     /* system of the file, if it was projected; otherwise "" */
	const char *overridden; /* what its records say, if the push overrides that; otherwise "" */
};

struct push_committed {
	struct dataset *dataset;
	uint64_t generation, points;
	bool unchanged;                       /* there was nothing to commit, so no new generation */
	const struct breakline_counts *lines; /* of all lines of the dataset, if it changed them; else NULL */
	const struct lattice *lattice;
};

struct push_calls {
	void (*begun)(void *token, const struct err *why, const struct push_begun *);
	void (*probed)(void *token, const struct err *why, const struct push_probe_result *);
	void (*planned)(void *token, const struct err *why, const struct push_planned *);
	void (*staged)(void *token, const struct err *why, const struct push_file *);
	void (*committed)(void *token, const struct err *why, const struct push_committed *);
	void (*aborted)(void *token);
	/* Not answers: */
	void (*durable)(void *ctx, uint64_t files); /* so many files survive an interruption of the push */
	/* Progress of the request with that token; `total` 0: unknown. `waiting`: what it waits for, in words; "": nothing. */
	void (*progress)(void *token, const char *phase, uint64_t points, uint64_t total, const char *waiting);
	/* Watch `fd`, and call push_stream_ready once when it has bytes or has ended. *watch is NULL at first, and the caller's
	 * to set; `unwatch` ends it. */
	int (*watch)(void *ctx, struct push_stream *, int fd, void **watch, struct err *err);
	void (*unwatch)(void *watch);
};

/* ---- requests ---- */

/* Texts are copied; `calls` too. */
struct push_params {
	const char *dataset;     /* "": a one-step dataset */
	const char *format;      /* "": by the inputs */
	struct agree_words says; /* of the inputs */
	bool has_mode;           /* for a new dataset; otherwise DATASET_MODE */
	uint32_t mode;
	bool accept_truncated, strict;
	const double *crop; /* x1, y1, x2, y2 in the dataset's coordinates, for one-step datasets; none if ncrop is 0 */
	size_t ncrop;
	struct peer peer;
	const struct push_calls *calls;
	void *ctx; /* of calls->durable and ->watch; until push_leave */
};
struct push_input {
	const char *name, *format;
	const char *columns; /* of a text, as in input_options; "": by its own header */
	bool decimal_comma;
	const char *path;     /* absolute; "": none */
	bool checksum;        /* a known file is recognised by its content, not by path, size and time */
	bool add;             /* taken beside another file of its path */
	bool replace;         /* taken in place of the files of its path */
	const char *replaces; /* taken in place of this file, too, by path or name; "": none */
	bool announced;       /* for a stream: its content will have this hash and size */
	struct digest hash;
	uint64_t size;
};
void push_begin(struct pushes *, const struct push_params *, void *token);
void push_probe(struct push *, int fd, const struct push_input *, void *token); /* takes `fd` in any case */
void push_plan(struct push *, void *token);
void push_file(struct push *, int fd, const struct push_input *, void *token); /* takes `fd` in any case */
void push_commit(struct push *, void *token);
void push_abort(struct push *, void *token);
/* The caller is gone: queued requests are still answered, and the push is invalid afterwards. Files that were staged whole into a
 * named dataset, and neither committed nor aborted, stay as a pending push. */
void push_leave(struct push *);

/* An input that comes through a pipe: takes `fd`, its non-blocking reading end, in any case. push_probe and push_file with that
 * name and fd -1 refer to it. LAS is read forwards; other formats are spooled into a file first. */
int push_stream(struct push *, int fd, const char *name, struct err *err);
void push_stream_ready(struct push_stream *);

#endif
