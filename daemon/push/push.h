/*
 * Pushes: files of a client become points of a dataset. A client begins a push, has each file probed, has the lattice planned,
 * stages each file, and commits. Loop; each request is answered once. The model: push.c.
 */
#ifndef PUSH_H
#define PUSH_H

#include "core.h"
#include "dataset.h"
#include "input.h"
#include "pipe.h"

struct admission;
struct geoids;
struct push;
struct pushes;
struct push_stream;

int pushes_new(struct core *, struct admission *, struct datasets *, struct geoids *, struct pushes **ret, struct err *err);
struct pushes *pushes_free(struct pushes *); /* NULL is fine; returns NULL */
unsigned pushes_open(const struct pushes *);
void pushes_settle(struct pushes *); /* each that waits asks again */
void pushes_tick(struct pushes *);
/* The last resort of a stop that takes too long: removes temporary files at once. Workers still run: exit next. */
void pushes_abandon(struct pushes *);
/* Each that holds something of the budget. */
void pushes_held(const struct pushes *, void (*each)(void *ctx, const struct core_holder *), void *ctx);

struct push_begun {
	struct push *push;
	uint64_t id;
	const char *lattice;
	const char *note; /* "", or what became of an interrupted push */
};
struct push_file {
	const char *name;
	struct pipe_ingested in;
	const char *geoid;      /* that shifted its heights: as in the manifest; "": none */
	uint32_t replaced;      /* files of the dataset, by this one */
	const char *crs_of;     /* of the file itself, where it was projected; "": it was not */
	const char *overridden; /* what its records say, where the push overrides that; "": it does not */
};
struct push_planned {
	const char *lattice, *crs;
	const char *zone, *datum; /* that degrees go to, and theirs; "": none are projected */
	const char *geoid;        /* "": heights stay */
	const char *note;         /* which scale was chosen for inputs that have more digits; "" */
};
struct push_committed {
	struct dataset *dataset;
	uint64_t generation, points;
	bool unchanged; /* it made no generation */
};

enum push_known_as {
	PUSH_NEW,
	PUSH_KNOWN,   /* the dataset has it, or this push has it twice: no File for it */
	PUSH_ADOPTED, /* of the interrupted push that this one takes up: no File for it, it counts as staged */
};
struct push_probe_result {
	const char *name;
	const struct input_info *info; /* NULL if it is known: it was not read */
	enum push_known_as known;
	uint64_t points;   /* of one that is known */
	uint32_t replaced; /* files of the dataset, by one that is taken up */
};
struct push_input {
	const char *name, *format;
	const char *columns; /* of a text, as input_options; "": as it says itself */
	bool decimal_comma;
	const char *path;     /* absolute; "": it has none */
	bool checksum;        /* judged by its content, not by path, size and time */
	bool add;             /* taken beside another one of its path */
	bool replace;         /* taken in place of those of its path */
	const char *replaces; /* and of this one, by path or name; "": none */
	bool told;            /* of a stream: what will come has this content; else nothing is known of it */
	struct digest hash;
	uint64_t size;
};

/* Each request is answered once, with `why` (NULL: done) and its own token. */
struct push_calls {
	void (*begun)(void *token, const struct err *why, const struct push_begun *);
	void (*probed)(void *token, const struct err *why, const struct push_probe_result *);
	void (*planned)(void *token, const struct err *why, const struct push_planned *);
	void (*staged)(void *token, const struct err *why, const struct push_file *);
	void (*committed)(void *token, const struct err *why, const struct push_committed *);
	void (*aborted)(void *token);
	/* Unasked. `progress` comes with the token of the request that it is about. */
	void (*durable)(void *ctx, uint64_t files);
	void (*progress)(void *token, const char *phase, uint64_t points, uint64_t total);
	/* Tell push_stream_ready once when `fd` has bytes or has ended. *watch (NULL at first) is for whoever
	 * watches; `unwatch` ends it for good. */
	int (*watch)(void *ctx, struct push_stream *, int fd, void **watch, struct err *err);
	void (*unwatch)(void *watch);
};
struct push_params {
	const char *dataset; /* "" = one-step */
	const char *scale_xy, *scale_z, *format;
	const char *assume_crs, *assume_unit_xy, *assume_unit_z;       /* for inputs that say nothing; NULL, "": nothing */
	const char *override_crs, *override_unit_xy, *override_unit_z; /* in place of what they say; not beside assume_* */
	const char *utm;                                               /* zone that degrees go to; "": of the middle of all */
	const char *geoid;                                             /* grid that shifts the heights; "": none */
	const char *geoid_way;                                         /* "orthometric" or "ellipsoidal"; "": orthometric */
	bool has_mode;                                                 /* for a dataset that comes to be; else DATASET_MODE */
	uint32_t mode;
	bool planar, accept_truncated, strict;
	const double *crop; /* x1, y1, x2, y2, in the dataset's coordinates, or ncrop is 0; of one-step ones only */
	size_t ncrop;
	struct peer peer;
	const struct push_calls *calls;
	void *ctx; /* of calls->durable; until push_leave */
};
void push_begin(struct pushes *, const struct push_params *, void *token);
/* `fd` becomes the push's in any case. */
void push_probe(struct push *, int fd, const struct push_input *, void *token);
/* An input that comes through a pipe: `fd`, its non-blocking reading end, becomes the push's in any case. Probe
 * and File of that name, with fd -1, mean it. LAS is read forwards; all else is kept in a file first. */
int push_stream(struct push *, int fd, const char *name, struct err *err);
void push_stream_ready(struct push_stream *);
void push_plan(struct push *, void *token);
void push_file(struct push *, int fd, const struct push_input *, void *token);
void push_commit(struct push *, void *token);
void push_abort(struct push *, void *token);
/* Nobody will call any more: what is unanswered is still answered. What was staged whole into a named dataset and
 * neither committed nor aborted stays as a pending push. The push is void. */
void push_leave(struct push *);

#endif
