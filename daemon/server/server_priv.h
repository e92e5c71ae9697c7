/* Shared by the files of this room. All functions belong to the loop thread. */
#ifndef SERVER_PRIV_H
#define SERVER_PRIV_H

#include "frame.h"
#include "service.h"
#include "log.h"
#include "server.h"
#include "stream.h"

enum {
	CONN_FILES_MAX = 8,     /* unanswered Probe and File, as protocol.md says */
	CONN_REQUESTS_MAX = 64, /* unanswered requests */
	CONN_PUSHES_MAX = 64,   /* open at once */
	CONN_STREAMS_MAX = 64,
};

struct listener {
	struct listener *next;
	struct server *server;
	int fd;
	sd_event_source *io;
};

/* Loop time of the users that share this account (fair.c). */
struct fair_account {
	uint64_t since_ns, used_ns;
};

/* Limits how often one event is logged (refusal.c). */
struct log_limit {
	sd_event_source *timer; /* end of the period, if something was suppressed */
	uint64_t since_ns;      /* start of the period */
	uint64_t suppressed;    /* in this period */
	uint64_t total;         /* since the start of the daemon */
	unsigned logged;        /* in this period */
	enum log_event event;
};

struct server {
	struct server_params p;
	struct service *service;
	struct listener *listeners;
	sd_event_source *again;   /* resumes accept, which pauses when descriptors run out */
	sd_event_source *recheck; /* of paused clients (quota.c) */
	struct conn *conns;
	unsigned nconns; /* that are not closed */
	uint64_t last_conn;
	uint64_t started_ns;
	bool stopping;
	bool reap; /* a connection is closed and not freed */
	struct fair_account fair[256];
	struct log_limit refused, cut, turned_away; /* no permission or over a quota; disconnected; a resource was missing */
};

/* A request that has not got its last answer. Keeps its connection in memory. */
struct request {
	struct request *next;
	struct conn *conn;
	uint32_t id;
	unsigned files; /* 1: counts among the unanswered files */
	size_t charged;
	struct push_ref *push; /* of PushBegin to PushAbort */
	uint64_t job;          /* of Wait and Fetch */
	bool watch, wait;
	struct prune *prune;      /* of Prune */
	struct named_view *named; /* a view whose files are looked for */
};

/* A push of this connection. */
struct push_ref {
	struct push_ref *next;
	struct conn *conn;
	struct push *push; /* NULL: it has ended */
	uint64_t id;
	uint32_t request; /* of its PushBegin, for Durable */
};

struct conn_job {
	struct conn_job *next;
	uint64_t id;
};
struct conn_dataset {
	struct conn_dataset *next;
	struct dataset *dataset;
};

struct conn {
	struct conn *next;
	struct server *server;
	struct frame_conn *frame; /* NULL: closed */
	sd_event_source *io;
	struct peer peer;
	uint64_t number;     /* of all connections since the start */
	uint64_t blocked_ns; /* since when its queued answers have not moved; 0: none are queued */
	bool hello, closed;
	bool dry;    /* no complete message is there */
	bool behind; /* its user is over the fair share of the loop (fair.c) */
	bool paused; /* nothing is received (quota_pause) */
	bool cut;    /* is disconnected when the loop comes to it */
	unsigned nrequests, nfiles;
	size_t charged; /* itself and its requests */
	struct request *requests;
	struct push_ref *pushes;
	struct conn_job *bound;    /* jobs that end with it */
	struct conn_dataset *held; /* one-step datasets that it pushed */
	struct stream_out *streams;
	struct cache_verify *verify; /* the verification that it requested; NULL: none */
	struct cache_adopt *adopt;   /* the pack that it passed; NULL: none */
	struct conn_copy *copies;    /* backups, exports and imports that are open */
};

#define ABOUT_CONN(c) (&(const struct log_about){ABOUT_USER((c)->peer.uid), .pid = (c)->peer.pid})

/* ---- conn.c ---- */

/* Takes over `fd` if it succeeds. -ERR_PERM, -ERR_BUSY: the client is refused. */
int conn_new(struct server *, int fd, struct err *err);
unsigned conn_count(const struct server *, uint32_t uid);                      /* open connections of the user */
uint64_t conn_held(const struct conn *);                                       /* bytes of LEDGER_MESSAGE */
void conn_update_events(struct conn *);                                        /* waits for what it can process now */
void conn_close(struct conn *);                                                /* for the peer; conn_reap frees it */
bool conn_reap(struct conn *);                                                 /* frees a closed one without requests */
void conn_send(struct conn *, uint32_t id, const Acut__V1__Message *, int fd); /* takes over `fd`; -1: none */
void conn_send_error(struct conn *, uint32_t id, const struct err *);
void conn_fail(struct conn *, const struct err *); /* a violation of the protocol: Error with id 0, then closed */

/* `bytes`: of its message. NULL: no memory; err says so. */
struct request *request_new(struct conn *, uint32_t id, size_t bytes, struct err *err);
struct request *request_free(struct request *);
/* The last answer: these free the request. */
void request_answer(struct request *, const Acut__V1__Message *);
void request_answer_done(struct request *);
void request_finish(struct request *, const struct err *why); /* refuses, or answers Done if `why` is NULL */
void request_answer_page(struct request *, Acut__V1__Message__BodyCase list, const struct frame_page *, bool more);
void request_refuse(struct request *, const struct err *);
/* An answer in between. */
void request_progress(struct request *, const char *phase, uint64_t done, uint64_t total, const char *waiting);

/* ---- fair.c ---- */

/* Priorities of the loop's event sources: requests, then streams, then requests of users over their fair share. */
enum { FAIR_REQUESTS = SD_EVENT_PRIORITY_NORMAL, FAIR_STREAMS = FAIR_REQUESTS + 3, FAIR_BEHIND = FAIR_REQUESTS + 5 };
bool fair_is_behind(struct server *, uint32_t uid, uint64_t now_ns);
void fair_charge(struct server *, uint32_t uid, uint64_t since_ns); /* the time from then until now */

/* ---- quota.c ---- */

/* Disconnects clients until there is memory for a message of so many bytes, as far as that is possible. `except` is not
 * disconnected for what it holds; NULL: any may be. */
void quota_reclaim(struct server *, size_t bytes, uint32_t uid, const struct conn *except);
/* For one more connection. -ERR_BUSY. */
int quota_connection(const struct server *, const struct peer *, struct err *err);
uint32_t quota_owner(const struct peer *); /* of descriptors that this user passes (io_close_assign) */
/* For one more file of this user. *ret_pause: not yet. -ERR_BUSY: too many do not close. */
int quota_closing_files(const struct peer *, bool *ret_pause, struct err *err);
/* Receives nothing until quota_closing_files allows it. */
int quota_pause(struct conn *, struct err *err);

/* ---- refusal.c ---- */

/* Sends the error to a client for which nothing is kept, as far as the socket takes it. Takes over `fd`. */
void refusal_send(int fd, const struct err *why);
/* True: log it; false: there were too many, and it is only counted. */
bool refusal_may_log_turned_away(struct server *); /* a client is refused because a resource is missing */
bool refusal_may_log_cut(struct server *);         /* a client is disconnected */
/* Logs or counts what a user has no permission for, or too much of. */
void refusal_log(struct server *, const struct peer *, const struct err *why);
bool refusal_is_logged(const struct err *why); /* it is such an error */
void refusals_flush(struct server *);          /* logs what was only counted */

/* ---- handlers of requests: each answers or refuses its request once ---- */

/* request.c: calls the handler of the message. Takes over `fd`. */
void request_handle(struct conn *, uint32_t id, Acut__V1__Message *, int fd);

typedef void request_fn(struct conn *, struct request *, Acut__V1__Message *, int fd);
request_fn request_status;
request_fn request_config;
request_fn request_metrics, request_doctor;
request_fn request_geoid_add, request_geoids, request_geoid_remove;
request_fn request_backup, request_backup_next, request_backup_end, request_import, request_import_file, request_import_commit;
request_fn request_push_begin, request_probe, request_push_plan, request_file, request_push_commit, request_push_abort,
	request_stream;
request_fn request_info, request_inspect;
request_fn request_submit, request_fetch, request_wait, request_cancel, request_remove, request_jobs;
request_fn request_cache_stat, request_cache_verify, request_cache_gc, request_cache_adopt;
request_fn request_datasets, request_dataset_create, request_dataset_change, request_plan;
request_fn request_log, request_files, request_places, request_revert, request_prune, request_discard;
Acut__V1__Lines *request_lines(const struct grid_lines *, Acut__V1__Lines *ret); /* returns ret */

void push_ref_leave(struct push_ref *); /* request_push.c: the push ends with its connection */
void conn_copies_end(struct conn *);    /* request_backup.c: likewise backups and imports */
/* request_inspect.c: answers with the header of a file. */
void request_answer_probed(struct request *, const char *name, const struct input_info *, const char *wkt);
/* request_job.c: answers those who watch the job. */
void request_job_changed(struct conn *, struct job *);
/* request_cache.c */
void message_side(const struct space_side *, Acut__V1__CacheSide *ret);
/* request_data.c: the mode of a new dataset. */
int request_mode(const char *text, bool *ret_has, uint32_t *ret, struct err *err);
/* request_data.c: answers with the dataset as it was in that generation. Manifest NULL: it has no points. */
void request_dataset_state(struct request *, const struct dataset *, const struct grid_manifest *, uint64_t generation);
/* The dataset as it is now, with what its manifest says of its coordinate system (NULL: there is none, or it cannot be read). */
void request_dataset_system(struct request *, const struct dataset *, const struct grid_manifest *);
/* request_generation.c: reads the manifest for one of these; generation 0: now. */
void request_dataset_at(struct conn *, struct request *, const char *name, uint64_t generation);

/* ---- message_job.c ---- */

/* A Job as a message, with the texts that it points to. Do not copy or move it. */
struct message_job {
	Acut__V1__Job job;
	Acut__V1__Progress progress;
	Acut__V1__Report report;
	Acut__V1__Removed removed[VIEW_RULES], *removed_list[VIEW_RULES];
	uint64_t removed_counts[VIEW_RULES];
	struct frame_error error;
	char waiting[96];
};
void message_job(const struct job *, struct message_job *ret);
/* job_submit, or job_plan, with a view that names files of the dataset. */
void request_named_view(struct request *, const struct job_params *, bool plan);
void request_named_leave(struct named_view *); /* the connection is closed; its answer comes soon */
void request_submitted(void *token, const struct err *why, struct job *);
void request_planned(void *token, const struct err *why, const struct job_plan *);
/* With `removed_counts`, for a page that message_job_rules gave the names to. */
void message_job_counts(const struct job *, struct message_job *ret);
bool message_job_rules(struct frame_page *); /* false: the names do not fit */
/* The report as a JSON object, for the tail of a stream. Returns buf. */
char *message_report_json(const struct job_report *, char *buf, size_t size);

/* ---- stream_out.c ---- */

struct digest;

/* A stream of that job, not started. *ret_read_end is the caller's. NULL: err says why. */
struct stream_out *stream_out_new(struct conn *, uint64_t job, uint32_t request, int *ret_read_end, struct err *err);
/* Before start. from: the first block. want: the id that the stream must have, NULL: any. since: only the changes against the
 * mesh of that generation, 0: the whole mesh. */
void stream_out_asks(struct stream_out *, bool system, bool lines); /* of Fetch */
void stream_out_from(struct stream_out *, uint64_t from, const struct digest *want, uint64_t since);
void stream_out_start(struct stream_out *, struct job *, char *window); /* takes over `window` (job_window); NULL: none */
void stream_out_leave(struct conn *);                                   /* ends all streams of the connection */
uint64_t stream_out_held(const struct conn *);                          /* bytes of LEDGER_PIPE */
uint64_t stream_out_pipes(const struct conn *);                         /* the kernel's capacity of its open pipes, in bytes */
void stream_out_progress(struct conn *, struct job *);

#endif
