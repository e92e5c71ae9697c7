/* Inside libacut: the connection, and how a call sends its request and waits for the answers. */
#ifndef CALL_H
#define CALL_H

#include <poll.h>

#include "acut.h"
#include "err.h"
#include "frame.h"

struct acut_push {
	struct acut *acut;
	struct acut_push *next; /* on acut->pushes */
	uint32_t request_id;    /* of PushBegin: Durable is sent under it */
	uint64_t push, durable;
	char *format, *columns, *note;
	bool decimal_comma;
	bool first; /* of its dataset */
	bool checksum, add, replace;
	char *replaces;
	acut_progress_fn progress;
	void *ctx;
	bool committed;
	struct err failed; /* what came unasked; code 0: nothing */
};

/* Questions that went out together, as many as the daemon takes unanswered, and the answers that came. */
enum { CALL_WINDOW = 8 };
struct call_window {
	struct call_slot {
		uint32_t id; /* 0: free */
		size_t i;    /* what it is about */
		Acut__V1__Message *answer;
	} slot[CALL_WINDOW];
	unsigned first, n;
};

struct acut {
	struct frame_conn *conn; /* NULL: never connected */
	struct acut_options options;
	char program[64], build[128];
	unsigned features; /* of the daemon, of enum call_feature */
	uint32_t last_id;
	struct err err;              /* of the last call */
	struct err dead;             /* why the connection is beyond use; code 0: it is not */
	struct acut_failure failure; /* err, for acut_error */
	struct acut_push *pushes;
	struct call_window *window; /* of the call that waits; NULL: it waits for one answer */

	acut_progress_fn progress; /* of the call that waits; may be NULL */
	void *progress_ctx;

	char umask_mode[8], mode[40]; /* of datasets that come to be; "": by the umask */
	bool decimal_comma;           /* of texts */
	char *area;                   /* of fetches; NULL: all */
	struct fetch *fetch;          /* the one that runs, or the last one until the next call; NULL: none */

	Acut__V1__Message *answer; /* what the results below point into */
	void *rows;                /* an array that the result points to */
	struct acut_status status;
	struct acut_probe probe;
	struct acut_file_result file;
	struct acut_push_result pushed;
	struct acut_line_set line_set; /* of `pushed` */
	struct acut_push_planned planned;
	struct acut_geoid geoid;
	struct acut_cache_stat cache;
	struct acut_inspected inspected;
	struct acut_job job;
	struct acut_plan plan;
	struct acut_imported imported;
};

/* system.c: the EPSG numbers in the text of a coordinate system, 0 if there are none, and its half of the heights, or "". */
void call_system(const char *crs, uint32_t *ret_epsg, uint32_t *ret_epsg_z, const char **ret_vertical);
/* Features that older daemons would ignore in a request: without them in its Hello.features the call fails before it is sent. */
enum call_feature { CALL_MODE = 1, CALL_DECIMAL_COMMA = 2, CALL_OVERRIDE = 4 };
int call_needs(struct acut *, enum call_feature);
/* The mode for a dataset that the call creates; "": the daemon's. Until the next call. */
char *call_mode(struct acut *);
/* Starts a call: forgets the last one's error and results. Negative if the connection is dead. */
int call_begin(struct acut *);
/* Sends a request. `fd` (-1: none) stays the caller's. */
int call_send(struct acut *, const Acut__V1__Message *, int fd, uint32_t *ret_id);
/* Waits for the next answer to `id` other than Progress, which goes to acut->progress. The caller frees *ret
 * (frame_message_free); an Error becomes the call's failure. ret_fd NULL: no descriptor is expected. */
int call_next(struct acut *, uint32_t id, Acut__V1__Message **ret, int *ret_fd);
/* begin, send, next; the answer must be `want` and is kept as acut->answer. */
int call_ask(struct acut *, const Acut__V1__Message *, int fd, Acut__V1__Message__BodyCase want);
/* Same without begin, for the second and later requests of one call. *ret is the caller's. */
int call_again(struct acut *, const Acut__V1__Message *, int fd, Acut__V1__Message__BodyCase want, uint32_t *ret_id,
	       Acut__V1__Message **ret);
/* A list, page by page (call_list.c). */
struct call_list {
	const Acut__V1__Message *req; /* of the first page; then as `next` left it */
	Acut__V1__Message__BodyCase want;
	bool asks; /* `rows` asks the daemon itself: the next page is asked for only then */
	void *ctx;
	/* Sets the request to the page after this one; false: it is the last. */
	bool (*next)(void *ctx, const Acut__V1__Message *page);
	/* Hands it out. The page before it is still there. Negative ends the list. */
	int (*rows)(void *ctx, const Acut__V1__Message *page);
};
int call_list(struct acut *, const struct call_list *);
/* -ERR: the keys of a list do not rise. */
int call_rises(struct acut *, bool rises, const char *what);
/* As many rows as the daemon puts into one page. */
enum { CALL_PAGE = 1000 };
/* Waits until the first slot of the window has its answer. */
int call_window_wait(struct acut *);
/* The failure of a message that should not have come. */
int call_unexpected(struct acut *, const Acut__V1__Message *);

/* Reads one message without waiting. 0: one was taken (if it answers `id` and is not Progress: *ret is set,
 * else NULL); FRAME_E_AGAIN; negative. */
int call_pump(struct acut *, uint32_t id, Acut__V1__Message **ret, int *ret_fd);
/* Waits for the connection or for `other` (NULL: none), at most a tenth of a second at a time if there is an interrupt
 * callback. `since`: clock_mono_ns of the last sign of life. */
int call_pause(struct acut *, uint64_t since, struct pollfd *other);

/* fetch.c. NULL is fine; gives NULL. */
struct fetch *fetch_free(struct fetch *);

/* ---- messages to results ---- */

/* Text for a message; NULL: "". */
char *call_text(const char *text);
void call_failure(const struct err *err, struct acut_failure *ret);
void call_wire_failure(const Acut__V1__Error *, struct acut_failure *ret);
void call_line_set(const Acut__V1__LineSet *, struct acut_line_set *ret); /* lines.c */
void call_side(const Acut__V1__CacheSide *, struct acut_side *ret);       /* cache.c; NULL is fine */
void call_progress(const Acut__V1__Progress *, struct acut_progress *ret);
void call_dataset(const Acut__V1__Dataset *, struct acut_dataset *ret);
/* The file must be one that the daemon takes. */
int call_file(struct acut *, int fd, const char *name);
void call_probe(const Acut__V1__Probed *, struct acut_probe *ret);

#endif
