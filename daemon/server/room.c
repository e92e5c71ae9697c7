/*
 * Room for messages: what clients hold of their part of the memory, and who gives way when others find none.
 *
 * The model: a client that keeps more than an honest one ever does is cut off first, then who has not read for the longest.
 * Where nobody is like that it is a crowd: of the user whose connections hold most together those are cut off that hold
 * most, as long as it is not he who asks. How many connections one user has is bounded as other things that are shared are: half
 * of what those of others leave. So a crowd that does nothing at all keeps nobody out, and neither does one that holds a little
 * with each. Nor does one whose files do not close (base/io_closer.c): there are so many of a user, then he waits until there are
 * fewer, and is cut off when the first of them has not been closed for so long: its file system does not answer. A thread that
 * closes may well come later than the next files of a busy client.
 *
 * Who is cut off is closed when the loop comes to him: what calls here may be going through lists of what closing changes.
 */
#include <sys/resource.h>

#include "clock.h"
#include "io.h"
#include "rights.h"
#include "server_priv.h"

enum {
	FAT = 32 << 10,    /* nobody who reads his answers has as much for long */
	CROWD = 256 << 10, /* a user whose connections hold less is no crowd */
	PLACE = 128 << 10, /* of the memory there is a place for each so many bytes: 4 KiB of what is kept for messages */
	PLACES_LEAST = 64,
	CLOSING_MOST = 1024, /* files of a user that are not closed yet, and a share of all descriptors at most */
	CLOSING_SHARE = 16,
	CLOSING_LEAST = 16,
	CLOSING_SECONDS = 5, /* that the close of one of them may take */
	LATER_USEC = 5000,   /* between two looks whether those who wait may go on: a thread that closes does not tell the loop */
	LATER_ACCURACY_USEC = 1000,
};

/* All that may be there, half of the descriptors at most. */
static unsigned places(const struct server *s)
{
	uint64_t n = ledger_total(s->p.ledger) / PLACE;
	struct rlimit files;

	n = n < PLACES_LEAST ? PLACES_LEAST : n;
	if (getrlimit(RLIMIT_NOFILE, &files) == 0 && files.rlim_cur / 2 < n)
		n = files.rlim_cur / 2;
	return (unsigned)n;
}

uint32_t room_owner(const struct peer *peer)
{
	return peer->uid + 1; /* 0 is nobody */
}

/* A file system in user space that does not answer keeps what is closed there open for ever: of one user at most so many. */
int room_files(const struct peer *peer, bool *ret_later, struct err *err)
{
	uint64_t since;
	uint32_t owner = room_owner(peer);
	rlim_t most = CLOSING_MOST;
	struct rlimit files;

	*ret_later = false;
	if (rights_admin(peer) || !io_close_backlog(owner, CLOSING_LEAST, &since))
		return 0;
	if (getrlimit(RLIMIT_NOFILE, &files) == 0 && files.rlim_cur / CLOSING_SHARE < most)
		most = files.rlim_cur / CLOSING_SHARE > CLOSING_LEAST ? files.rlim_cur / CLOSING_SHARE : CLOSING_LEAST;
	if (!io_close_backlog(owner, most, &since))
		return 0;
	*ret_later = clock_since(since) < CLOSING_SECONDS;
	if (*ret_later)
		return 0;
	err_set(err, ERR_BUSY, "%u files of this user could not be closed yet: a file system does not answer", (unsigned)most);
	err_add_hint(err, "see that what they lie on answers or is unmounted, and try again");
	return err_add_place(err, ERR_NO_OFFSET, "user-files");
}

static int look_later(struct server *s);

static int look_again(sd_event_source *source, uint64_t usec, void *ctx)
{
	struct server *s = ctx;
	uint32_t owner = 0;
	bool later = false, more = false;

	for (struct conn *c = s->conns; c; c = c->next) {
		struct err err = ERR_INIT;

		if (!c->waits || c->closed)
			continue;
		/* Most are of one user, and each look goes through what is to be closed. Who is refused hears it in his turn. */
		if (room_owner(&c->peer) != owner)
			room_files(&c->peer, &later, &err);
		owner = room_owner(&c->peer);
		c->waits = later;
		more |= later;
		conn_watch(c);
	}
	return more ? look_later(s) : 0;
}

static int look_later(struct server *s)
{
	int r;

	if (!s->closing)
		return sd_event_add_time_relative(s->p.event, &s->closing, CLOCK_MONOTONIC, LATER_USEC, LATER_ACCURACY_USEC,
						  look_again, s);
	r = sd_event_source_set_time_relative(s->closing, LATER_USEC);
	return r < 0 ? r : sd_event_source_set_enabled(s->closing, SD_EVENT_ONESHOT);
}

int room_wait(struct conn *c, struct err *err)
{
	struct server *s = c->server;
	int r = 0;

	if (!s->closing || sd_event_source_get_enabled(s->closing, NULL) == SD_EVENT_OFF)
		r = look_later(s);
	if (r < 0)
		return err_sys(err, -r, "a client cannot wait until its files are closed");
	c->waits = true;
	conn_watch(c);
	return 0;
}

int room_place(const struct server *s, const struct peer *peer, struct err *err)
{
	unsigned own, others, most;
	bool later;

	if (rights_admin(peer))
		return 0;
	if (room_files(peer, &later, err))
		return -(int)err->code;
	own = conns_of(s, peer->uid);
	if (s->p.user_connections && own >= s->p.user_connections) {
		err_set(err, ERR_BUSY, "%u connections of this user are open, and no more than %u may be (user-connections)", own,
			s->p.user_connections);
	} else {
		others = s->nconns - own;
		most = places(s) > others ? (places(s) - others) / 2 : 0;
		if (own < (most ? most : 1))
			return 0;
		err_set(err, ERR_BUSY,
			"%u connections of this user are open, as many as one user may have beside those of others", own);
	}
	err_add_hint(err, "try again when some of them are closed");
	return err_add_place(err, ERR_NO_OFFSET, "user-connections");
}

/* Who has more than an honest client; else who has not read what lies ready for him for the longest: answers wait for
 * those who read until the loop comes to them again, for those who do not ever longer. */
static struct conn *hoarder(const struct server *s, const struct conn *but)
{
	struct conn *c, *most = NULL, *idle = NULL;

	for (c = s->conns; c; c = c->next) {
		if (c == but || !c->frame || c->cut)
			continue;
		if (frame_conn_held(c->frame) > FAT && (!most || frame_conn_held(c->frame) > frame_conn_held(most->frame)))
			most = c;
		if (c->blocked_ns && (!idle || c->blocked_ns < idle->blocked_ns))
			idle = c;
	}
	return most ? most : idle;
}

/* Users whose numbers agree in the last bits have one account, as in turn.c. */
static struct conn *of_crowd(const struct server *s, uint32_t uid)
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
	if (held[user] < CROWD || held[user] <= held[uid % ACCOUNTS])
		return NULL;
	for (c = s->conns; c; c = c->next)
		if (c->frame && !c->cut && c->peer.uid % ACCOUNTS == user && (!most || conn_held(c) > conn_held(most)))
			most = c;
	return most;
}

static bool relieve(struct server *s, uint32_t uid, const struct conn *but)
{
	struct conn *c = hoarder(s, but);
	struct err err = ERR_INIT;

	if (!c)
		c = of_crowd(s, uid);
	if (!c)
		return false;
	if (refusal_cut(s))
		log_event(LOG_EVENT_CLIENT_CUT, ABOUT_CONN(c),
			  "a client (pid %u) is cut off: it keeps %llu KiB of messages, and others have no memory for theirs",
			  c->peer.pid, (unsigned long long)conn_held(c) >> 10);
	err_set(&err, ERR_BUSY, "the client keeps too many messages");
	frame_conn_cut(c->frame, &err);
	c->blocked_ns = 0;
	c->cut = true;
	return true;
}

/* What those have yet who are cut off comes when they are closed. */
static uint64_t coming(const struct server *s)
{
	uint64_t n = 0;

	for (const struct conn *c = s->conns; c; c = c->next)
		n += c->cut && c->frame ? conn_held(c) : 0;
	return n;
}

void room_make(struct server *s, size_t bytes, uint32_t uid, const struct conn *but)
{
	uint64_t room = ledger_available(s->p.ledger, LEDGER_MESSAGE);

	while (room < bytes && room + coming(s) < bytes && relieve(s, uid, but))
		room = ledger_available(s->p.ledger, LEDGER_MESSAGE);
}
