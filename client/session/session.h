/*
 * The session of a command: what it prints, the daemon that it speaks to, and when it has to end.
 *
 * The daemon is that of --socket, $ACUT_SOCKET or the system, in this order; where none is set, and only for commands that need
 * nothing kept, a private one that is started for it.
 */
#ifndef SESSION_H
#define SESSION_H

#include "acut.h"
#include "console.h"
#include "err.h"

struct session_daemon;

/* Exit statuses that are no error's. */
enum { SESSION_DONE = 0, SESSION_SOME_REFUSED = 3 };

struct session_options {
	const char *socket;
	bool own_private;
	const char *memory, *threads, *cache, *disk, *keep_free; /* a daemon of this command alone; NULL: not given */
	double timeout;                                          /* seconds; 0: none */
};

struct session {
	struct console console;
	struct session_options opt;
	struct acut *acut;             /* NULL: not connected */
	struct session_daemon *daemon; /* of this command alone, or NULL */
	bool starts;                   /* a private daemon is started where none is set */
	bool writes;                   /* it has outputs */
	bool for_reader;               /* without a reader of standard output it need not go on: -o -, wait, watch */
	bool out_closed;               /* that reader is gone */
	uint64_t begun_ns;
	struct err failure;          /* the last error that was printed */
	unsigned long long refusals; /* inputs that were left out */
};

/* Handles signals; begins the time of --timeout. */
void session_begin(struct session *);
int session_check(const struct session *, struct err *err); /* of its options: -ERR_USAGE */

/* ---- the connection ---- */

/* Finds or starts a daemon and sets session->acut. Prints its failure; exit status. */
int session_connect(struct session *);
int session_connect_try(struct session *, struct err *err); /* prints nothing */
/* To a daemon that runs: the configured one, else the user's private one. Starts none, prints nothing. */
bool session_connect_running(struct session *);
const char *session_path(const struct session *); /* of the socket that it would try; NULL: none is set */
void session_disconnect(struct session *);        /* also ends a daemon of its own */

/* ---- failures ---- */

/* Prints the failure; the exit status. A caught signal or a passed deadline is printed as that. */
int session_error(struct session *, const struct err *);
/* The same for the last failure of the connection. */
int session_error_acut(struct session *);
/* The connection's last failure as a struct err; `file` is set if it has none, and if it is not NULL. */
int session_failure(const struct session *, const char *file, struct err *ret);
void session_failure_of(const struct acut_failure *, struct err *ret);
/* Prints the error of an input that is left out, up to a hundred of them; session_refusals_end prints how many more there
 * were. JSON has each with its own line. */
void session_refusal(struct session *, const struct err *);
void session_refusals_end(struct session *, int status);

/* ---- the end ---- */

/* For acut_options: not 0 if a signal was caught, --timeout has passed, or the reader of standard output is gone. `ctx` is
 * the session. */
int session_interrupted(void *ctx);
int session_caught(void); /* number of the signal, or 0 */
bool session_late(const struct session *);
/* Standard input ended because all that held the other ends is gone, as with a broken connection of ssh: its end is no end. Known
 * by what else came over it: the socket's other direction, or standard output and error. If only standard output is gone it waits
 * for 5 s; session_interrupted ends that. */
bool session_cut_off(struct session *);

/* ---- progress ---- */

struct session_progress {
	struct session *session;
	char phase[16];
	uint64_t start_ns, last_ns; /* of the phase; of the last line */
	uint64_t base, total;       /* staging: points of files that are done, of all files */
	bool on, printed_space;
	char stalled[320]; /* the last note about files that give nothing; "": they do again */
};
void session_progress_init(struct session_progress *, struct session *);
void session_progress_show(void *ctx, const struct acut_progress *); /* an acut_progress_fn */
void session_progress_job(void *ctx, const struct acut_job *);       /* for acut_job_wait */
const char *session_progress_time(double seconds, char buf[24]);     /* 1:02:03 */

#endif
