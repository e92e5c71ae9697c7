/* What the files of this room share. */
#ifndef SERVER_PRIV_H
#define SERVER_PRIV_H

#include "frame.h"
#include "service.h"
#include "log.h"
#include "server.h"
#include "stream.h"

enum {
	CONN_FILES_MAX = 8,     /* unanswered Probe and File, as PROTOCOL.md says */
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

struct server {
	struct server_params p;
	struct service *service;
	struct listener *listeners;
	sd_event_source *again;   /* accept paused: no descriptors left */
	sd_event_source *closing; /* to look whether there is room for those who wait (room_wait) */
	struct conn *conns;
	unsigned nconns;
	uint64_t last_conn;
	uint64_t started_ns;
	bool stopping, reap;
	struct turn { /* turn.c: what the loop did for users of late */
		uint64_t since_ns, used_ns;
	} turns[256];
	struct refusals { /* refusal.c: what the log was told in the last while */
		sd_event_source *timer;
		uint64_t since_ns, hidden, total;
		unsigned told;
		enum log_event event;
	} refusals, cuts, aways; /* of clients that were cut off; that no place was found for */
};

/* A request that is not answered for good. Holds its connection in memory. */
struct request {
	struct request *next;
	struct conn *conn;
	uint32_t id;
	unsigned files; /* 1: counts among the unanswered files */
	size_t charged;
	struct push_ref *push; /* of PushBegin to PushAbort */
	uint64_t job;          /* of Wait and Fetch */
	bool watch, wait;
	struct prune *prune; /* of Prune */
};

/* A push of this connection. */
struct push_ref {
	struct push_ref *next;
	struct conn *conn;
	struct push *push; /* NULL: over */
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
	uint64_t number;         /* of all that ever came */
	uint64_t blocked_ns;     /* since when it has read nothing of what lies ready for it; 0: it has read all */
	bool hello, closed, dry; /* dry: no whole message has come */
	bool later;              /* its turn is after others' */
	bool waits;              /* nothing is received: room_wait */
	bool cut;                /* it ends when the loop comes to it */
	unsigned nrequests, nfiles;
	size_t charged; /* itself and its requests */
	struct request *requests;
	struct push_ref *pushes;
	struct conn_job *bound;    /* jobs that end with it */
	struct conn_dataset *held; /* one-step datasets that it pushed */
	struct stream_out *streams;
	struct cache_verify *verify; /* that this connection asked for and that goes on; NULL: none */
	struct conn_copy *copies;    /* backups, exports and imports that are open */
};

#define ABOUT_CONN(c) (&(const struct log_about){ABOUT_USER((c)->peer.uid), .pid = (c)->peer.pid})

/* conn.c */
unsigned conns_of(const struct server *, uint32_t uid); /* that are open */
int conn_new(struct server *, int fd, struct err *err);
void conn_watch(struct conn *);                                                /* for what it waits for now */
void conn_close(struct conn *);                                                /* at once for the peer; the memory goes later */
bool conn_reap(struct conn *);                                                 /* frees it if nothing refers to it */
void conn_send(struct conn *, uint32_t id, const Acut__V1__Message *, int fd); /* takes over `fd`; -1: none */
void conn_send_error(struct conn *, uint32_t id, const struct err *);
void conn_fail(struct conn *, const struct err *); /* a breach: Error on id 0, then the end */
/* `bytes`: of its message. NULL: no memory; err says so. */
struct request *request_new(struct conn *, uint32_t id, size_t bytes, struct err *err);
struct request *request_free(struct request *);
void request_answer(struct request *, const Acut__V1__Message *); /* and free it */
/* The same, of a page of a list. */
void request_answer_page(struct request *, Acut__V1__Message__BodyCase list, const struct frame_page *, bool more);
void request_refuse(struct request *, const struct err *); /* likewise */

uint64_t conn_held(const struct conn *); /* taken of LEDGER_MESSAGE */

/* turn.c. Priorities of the loop's sources: requests before bulk, and both before requests of who had much of it. */
enum { TURN_NOW = SD_EVENT_PRIORITY_NORMAL, TURN_BULK = TURN_NOW + 3, TURN_LATER = TURN_NOW + 5 };
bool turn_later(struct server *, uint32_t uid, uint64_t now);      /* others come first */
uint64_t turn_used(struct server *, uint32_t uid, uint64_t since); /* until now, which it returns */

/* room.c: as far as that is possible, memory for messages of that user, at the expense of others but that one (NULL: of any). */
void room_make(struct server *, size_t bytes, uint32_t uid, const struct conn *but);
int room_place(const struct server *, const struct peer *, struct err *err); /* for one connection more. -ERR_BUSY */
uint32_t room_owner(const struct peer *);                                    /* of descriptors that he passes (io_close_assign) */
/* For a file more of his. *ret_later: not yet. -ERR_BUSY: too many of them do not close. */
int room_files(const struct peer *, bool *ret_later, struct err *err);
int room_wait(struct conn *, struct err *err); /* nothing is received until there is room, which is looked for every few ms */

/* refusal.c */
/* A client that nothing was kept for yet hears why, as far as the socket takes it, and is gone. Takes over `fd`. */
void refusal_tell(int fd, const struct err *why);
bool refusal_away(struct server *); /* a client is turned away for want of what is needed to serve him: likewise */
bool refusal_cut(struct server *);  /* a client is cut off: the log may have it; false: it is only counted */
/* What a user may not, or has too much of: to the log, but no flood of it. */
void refusal_log(struct server *, const struct peer *, const struct err *why);
bool refusal_worth(const struct err *why);
void refusals_end(struct server *);

/* request.c: the table */
void request_handle(struct conn *, uint32_t id, Acut__V1__Message *, int fd);

typedef void request_fn(struct conn *, struct request *, Acut__V1__Message *, int fd);
/* request_status.c */
request_fn request_status;

/* request_config.c */
request_fn request_config;
/* request_push.c */
request_fn request_push_begin, request_probe, request_push_plan, request_file, request_push_commit, request_push_abort,
	request_stream, request_info, request_inspect;
void push_ref_leave(struct push_ref *);
/* request_job.c */
request_fn request_submit, request_fetch, request_wait, request_cancel, request_remove, request_jobs;
void request_job_told(struct conn *, struct job *);
/* request_cache.c */
request_fn request_cache_stat, request_cache_verify, request_cache_gc;
void message_side(const struct space_side *, Acut__V1__CacheSide *ret);
/* request_metrics.c, request_doctor.c */
request_fn request_metrics, request_doctor;
/* request_geoid.c */
request_fn request_geoid_add, request_geoids, request_geoid_remove;
/* request_backup.c */
request_fn request_backup, request_backup_next, request_backup_end, request_import, request_import_file, request_import_commit;
void conn_copies_end(struct conn *);
/* request_data.c */
request_fn request_datasets, request_dataset_create, request_dataset_change, request_plan;
/* Of a dataset that comes to be. */
int request_mode(const char *text, bool *ret_has, uint32_t *ret, struct err *err);
/* Points and files as its manifest (NULL: none) says of that generation. */
void request_dataset_state(struct request *, const struct dataset *, const struct grid_manifest *, uint64_t generation);
/* request_generation.c */
request_fn request_log, request_files, request_revert, request_prune;
void request_dataset_at(struct conn *, struct request *, const char *name, uint64_t generation);

/* message_job.c: a Job as a message, with the texts that it points to. Do not copy or move it. */
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
/* With `removed_counts`, for a page that message_job_rules gave the names to; false: they do not fit. */
void message_job_counts(const struct job *, struct message_job *ret);
bool message_job_rules(struct frame_page *);
/* The report as a JSON object, for the tail of a stream. */
char *message_report_json(const struct job_report *, char *buf, size_t size);

/* stream_out.c */
struct stream_out *stream_out_new(struct conn *, uint64_t job, uint32_t request, int *ret_read_end, struct err *err);
/* Before start: go on at block `from` of the stream `want` (NULL: whatever it is). */
struct digest;
/* since: changes only, against the mesh of that generation; 0: the whole mesh. */
void stream_out_from(struct stream_out *, uint64_t from, const struct digest *want, uint64_t since);
void stream_out_start(struct stream_out *, struct job *, char *window); /* of job_window, given away; or NULL */
void stream_out_leave(struct conn *);                                   /* all streams of the connection end */
uint64_t stream_out_held(const struct conn *);                          /* taken of LEDGER_PIPE */
uint64_t stream_out_pipes(const struct conn *);                         /* the kernel's capacity for its pipes that are open */
void stream_out_progress(struct conn *, struct job *);

#endif
