/*
 * Quotas of clients: connections, files that are not closed yet, and memory for messages.
 *
 * The model, for each of them:
 *
 * Connections. A user may have half of the connections that those of other users leave, so some always remain.
 *
 * Files being closed (base/io_closer.c). The number of a user's open closes is limited. Beyond it, nothing is received from this
 * user until there are fewer. If one of them takes longer than CLOSING_SECONDS, its file system does not answer, and the user's
 * connections are closed. The limit of time is generous, since a closing thread may be slower than the next files of a busy
 * client.
 *
 * Memory. Messages share one account of the ledger. If a message finds no memory, a client is disconnected: first the one that
 * holds more than a client that reads its answers ever does; then the one that has not read for the longest time; then, of the
 * user whose connections together hold the most, the one that holds the most, unless this user is the one that needs memory.
 *
 * A client is marked here, and closed when the loop comes to it: the caller may be iterating over lists that closing changes.
 */
#include <sys/resource.h>

#include "clock.h"
#include "io.h"
#include "rights.h"
#include "server_priv.h"

enum {
	HOARD_BYTES = 32 << 10,       /* a client that reads its answers does not hold as much for long */
	CROWD_BYTES = 256 << 10,      /* a user whose connections hold less together is not disconnected for it */
	CONNECTION_BYTES = 128 << 10, /* of the total memory, for each connection allowed: 4 KiB of the account for messages */
	CONNECTIONS_MIN = 64,
	CLOSING_MAX = 1024, /* files of one user that are being closed; and at most a CLOSING_SHARE-th of all descriptors */
	CLOSING_SHARE = 16,
	CLOSING_MIN = 16,
	CLOSING_SECONDS = 5,
	RECHECK_USEC = 5000, /* closing threads do not notify the loop, so it polls while a client is paused */
	RECHECK_ACCURACY_USEC = 1000,
};

/* ---- files that are being closed ---- */

uint32_t quota_owner(const struct peer *peer)
{
	return peer->uid + 1; /* 0: nobody */
}

int quota_closing_files(const struct peer *peer, bool *ret_pause, struct err *err)
{
	uint64_t since_ns;
	uint32_t owner = quota_owner(peer);
	rlim_t most = CLOSING_MAX;
	struct rlimit files;

	THREAD_LOOP_ONLY();
	*ret_pause = false;
	if (rights_admin(peer) || !io_close_backlog(owner, CLOSING_MIN, &since_ns))
		return 0;
	if (getrlimit(RLIMIT_NOFILE, &files) == 0 && files.rlim_cur / CLOSING_SHARE < most)
		most = files.rlim_cur / CLOSING_SHARE > CLOSING_MIN ? files.rlim_cur / CLOSING_SHARE : CLOSING_MIN;
	if (!io_close_backlog(owner, most, &since_ns))
		return 0;
	*ret_pause = clock_since(since_ns) < CLOSING_SECONDS;
	if (*ret_pause)
		return 0;
	err_set(err, ERR_BUSY, "%u files of this user could not be closed yet: a file system does not answer", (unsigned)most);
	err_add_hint(err, "make sure that the file system of these files answers, or unmount it, and try again");
	return err_add_place(err, ERR_NO_OFFSET, "user-files");
}

static int recheck_later(struct server *s);

static int on_recheck(sd_event_source *source, uint64_t usec, void *ctx)
{
	struct server *s = ctx;
	uint32_t owner = 0;
	bool pause = false, more = false;

	for (struct conn *c = s->conns; c; c = c->next) {
		struct err ignored = ERR_INIT; /* conn.c asks again, and sends the error */

		if (!c->paused || c->closed)
			continue;
		/* Usually all are of one user, and each check goes through the files that are being closed. */
		if (quota_owner(&c->peer) != owner)
			quota_closing_files(&c->peer, &pause, &ignored);
		owner = quota_owner(&c->peer);
		c->paused = pause;
		more |= pause;
		conn_update_events(c);
	}
	return more ? recheck_later(s) : 0;
}

static int recheck_later(struct server *s)
{
	int r;

	if (!s->recheck)
		return sd_event_add_time_relative(s->p.event, &s->recheck, CLOCK_MONOTONIC, RECHECK_USEC, RECHECK_ACCURACY_USEC,
						  on_recheck, s);
	r = sd_event_source_set_time_relative(s->recheck, RECHECK_USEC);
	return r < 0 ? r : sd_event_source_set_enabled(s->recheck, SD_EVENT_ONESHOT);
}

int quota_pause(struct conn *c, struct err *err)
{
	struct server *s = c->server;
	int r = 0;

	THREAD_LOOP_ONLY();
	if (!s->recheck || sd_event_source_get_enabled(s->recheck, NULL) == SD_EVENT_OFF)
		r = recheck_later(s);
	if (r < 0)
		return err_sys(err, -r, "a client cannot wait until its files are closed");
	c->paused = true;
	conn_update_events(c);
	return 0;
}

/* ---- connections ---- */

/* The limit for all users together: at most half of the descriptors. */
static unsigned connections_max(const struct server *s)
{
	uint64_t n = ledger_total(s->p.ledger) / CONNECTION_BYTES;
	struct rlimit files;

	n = n < CONNECTIONS_MIN ? CONNECTIONS_MIN : n;
	if (getrlimit(RLIMIT_NOFILE, &files) == 0 && files.rlim_cur / 2 < n)
		n = files.rlim_cur / 2;
	return (unsigned)n;
}

int quota_connection(const struct server *s, const struct peer *peer, struct err *err)
{
	unsigned own, others, most;
	bool pause;

	THREAD_LOOP_ONLY();
	if (rights_admin(peer))
		return 0;
	if (quota_closing_files(peer, &pause, err))
		return -(int)err->code;
	own = conn_count(s, peer->uid);
	if (s->p.user_connections && own >= s->p.user_connections) {
		err_set(err, ERR_BUSY, "%u connections of this user are open, and no more than %u may be (user-connections)", own,
			s->p.user_connections);
	} else {
		others = s->nconns - own;
		most = connections_max(s) > others ? (connections_max(s) - others) / 2 : 0;
		if (own < (most ? most : 1))
			return 0;
		err_set(err, ERR_BUSY,
			"%u connections of this user are open, as many as one user may have beside those of others", own);
	}
	err_add_hint(err, "try again when some of them are closed");
	return err_add_place(err, ERR_NO_OFFSET, "user-connections");
}

/* ---- memory for messages ---- */

/* The client that holds the most, if that is too much; otherwise the client that has not read for the longest time. Answers to
 * clients that read wait only until the loop comes to them again. */
static struct conn *find_hoarder(const struct server *s, const struct conn *except)
{
	struct conn *c, *most = NULL, *idle = NULL;

	for (c = s->conns; c; c = c->next) {
		if (c == except || !c->frame || c->cut)
			continue;
		if (frame_conn_held(c->frame) > HOARD_BYTES &&
		    (!most || frame_conn_held(c->frame) > frame_conn_held(most->frame)))
			most = c;
		if (c->blocked_ns && (!idle || c->blocked_ns < idle->blocked_ns))
			idle = c;
	}
	return most ? most : idle;
}

/* Users with the same last 8 bits share an account, as in fair.c. */
static struct conn *find_in_crowd(const struct server *s, uint32_t uid)
{
	enum { ACCOUNTS = 256 };
	uint64_t held[ACCOUNTS] = {0};
	struct conn *c, *most = NULL;
	unsigned user = 0;

	for (c = s->conns; c; c = c->next)
		if (!c->cut)
			held[c->peer.uid % ACCOUNTS] += conn_held(c);
	for (unsigned i = 1; i < ACCOUNTS; i++)
		user = held[i] > held[user] ? i : user;
	if (held[user] < CROWD_BYTES || held[user] <= held[uid % ACCOUNTS])
		return NULL;
	for (c = s->conns; c; c = c->next)
		if (c->frame && !c->cut && c->peer.uid % ACCOUNTS == user && (!most || conn_held(c) > conn_held(most)))
			most = c;
	return most;
}

/* Marks a client for disconnection, which frees its unsent answers at once. */
static void cut(struct server *s, struct conn *c)
{
	struct err err = ERR_INIT;

	if (refusal_may_log_cut(s))
		log_event(LOG_EVENT_CLIENT_CUT, ABOUT_CONN(c),
			  "a client (pid %u) is cut off: it keeps %llu KiB of messages, and others have no memory for theirs",
			  c->peer.pid, (unsigned long long)conn_held(c) >> 10);
	err_set(&err, ERR_BUSY, "the client keeps too many messages");
	frame_conn_cut(c->frame, &err);
	c->blocked_ns = 0;
	c->cut = true;
}

/* Memory of clients that are marked: it comes free when they are closed. */
static uint64_t bytes_of_cut(const struct server *s)
{
	uint64_t bytes = 0;

	for (const struct conn *c = s->conns; c; c = c->next)
		bytes += c->cut && c->frame ? conn_held(c) : 0;
	return bytes;
}

/* Who does not read is disconnected until there is memory now: a caller does not wait for the loop, and would refuse a client
 * that does nothing wrong. A user with many connections loses no more of them than are needed when they are closed. */
void quota_reclaim(struct server *s, size_t bytes, uint32_t uid, const struct conn *except)
{
	uint64_t left;

	THREAD_LOOP_ONLY();
	while ((left = ledger_available(s->p.ledger, LEDGER_MESSAGE)) < bytes) {
		struct conn *c = find_hoarder(s, except);

		if (!c && left + bytes_of_cut(s) < bytes)
			c = find_in_crowd(s, uid);
		if (!c)
			return;
		cut(s, c);
	}
}
