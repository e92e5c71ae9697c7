/*
 * Closing files in background threads (io.h).
 *
 * The last close of an unlinked file frees its blocks, which takes a second for some tens of gigabytes. Closing a file
 * in a user-space file system waits for an answer from there. The event loop gets descriptors from clients, so it must
 * not close them itself.
 *
 * A thread declares once that it must not wait. From then on, what it closes goes to a list that closer threads
 * process, except pipes, and sockets whose bytes are all read (a socket may hold descriptors that were sent and never
 * received). Nothing is asked about the file, because that might wait, too. The number of the descriptor is free when
 * it is closed.
 *
 * Each entry has an owner, and only one entry of each owner is being closed at a time. An owner of files that never
 * close occupies one thread, and its later files wait behind it. There are as many threads as necessary for that, up to
 * CLOSERS; so many owners with such files block all others. One thread waits for the next entry, the others end. The
 * code that receives descriptors limits how many an owner may have here, and for how long (io_close_backlog), because a
 * close can no longer be refused.
 */
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "lock.h"
#include "thread.h"
#include "io_closer.h"

enum { CLOSERS = 16, NUMBERS = 16384 /* of descriptors whose owner is recorded; normally no more can be open */ };

struct closing {
	int fd;
	uint32_t owner;
	uint64_t since_ns; /* in the list; later, in a thread */
};

struct closer {
	bool there;
	struct closing at; /* what it is closing; fd -1: nothing */
};

static struct {
	struct lock lock;
	pthread_cond_t wake;
	struct closing *list;
	size_t n, cap;
	struct closer closer[CLOSERS];
	unsigned threads, idle;
} aside = {.lock = LOCK_STATIC(CLOSERS), .wake = PTHREAD_COND_INITIALIZER};
static _Atomic size_t pending; /* in the list or in a thread */
static _Atomic uint32_t owner_of[NUMBERS];
static _Thread_local bool must_not_wait;
static _Thread_local uint32_t current_owner;

static bool is_closing(uint32_t owner)
{
	for (unsigned i = 0; i < CLOSERS; i++)
		if (aside.closer[i].there && aside.closer[i].at.fd >= 0 && aside.closer[i].at.owner == owner)
			return true;
	return false;
}

/* The first entry whose owner has none in a thread; n: there is none. */
static size_t next_entry(void)
{
	size_t i = 0;

	while (i < aside.n && is_closing(aside.list[i].owner))
		i++;
	return i;
}

static int start_closer(void);

/* Ensures that a thread takes the next entry, if possible. A thread that was woken and has not run yet counts as idle;
 * it looks for an entry itself. */
static void wake_closer(void)
{
	if (next_entry() == aside.n)
		return;
	if (aside.idle)
		pthread_cond_signal(&aside.wake);
	else if (aside.threads < CLOSERS)
		start_closer(); /* if it fails, the existing threads will take it */
}

static void *closer(void *ctx)
{
	struct closer *mine = ctx;

	thread_mark_helper();
	lock_take(&aside.lock);
	for (;;) {
		size_t i = next_entry();

		if (i == aside.n && aside.idle)
			break;
		if (i == aside.n) {
			aside.idle++;
			lock_wait(&aside.lock, &aside.wake);
			aside.idle--;
			continue;
		}
		mine->at = aside.list[i];
		mine->at.since_ns = clock_mono_ns();
		memmove(&aside.list[i], &aside.list[i + 1], (--aside.n - i) * sizeof *aside.list);
		wake_closer();
		lock_give(&aside.lock);
		io->close(mine->at.fd);
		lock_take(&aside.lock);
		mine->at.fd = -1;
		pending--;
	}
	mine->there = false;
	aside.threads--;
	lock_give(&aside.lock);
	return NULL;
}

static int start_closer(void)
{
	enum { STACK_BYTES = 64 << 10 };
	struct closer *c = aside.closer;
	pthread_attr_t attr;
	pthread_t thread;
	int r;

	while (c->there)
		c++;
	*c = (struct closer){.there = true, .at.fd = -1};
	pthread_attr_init(&attr);
	pthread_attr_setstacksize(&attr, STACK_BYTES);
	pthread_attr_setdetachstate(&attr, PTHREAD_CREATE_DETACHED);
	r = pthread_create(&thread, &attr, closer, c);
	pthread_attr_destroy(&attr);
	c->there = !r;
	aside.threads += !r;
	return r;
}

int io_close_background(struct err *err)
{
	int r = 0;

	must_not_wait = true;
	lock_take(&aside.lock);
	if (!aside.threads)
		r = start_closer();
	lock_give(&aside.lock);
	return r ? err_sys(err, r, "cannot start a thread") : 0;
}

void io_close_foreground(void)
{
	must_not_wait = false;
}

uint32_t io_close_owner(uint32_t owner)
{
	uint32_t before = current_owner;

	current_owner = owner;
	return before;
}

void io_close_assign(int fd, uint32_t owner)
{
	if (fd >= 0 && fd < NUMBERS)
		owner_of[fd] = owner;
}

bool io_close_backlog(uint32_t owner, size_t most, uint64_t *ret_since_ns)
{
	uint64_t since = 0;
	size_t n = 0;

	if (pending < most)
		return false;
	lock_take(&aside.lock);
	for (unsigned i = 0; i < CLOSERS; i++)
		if (aside.closer[i].there && aside.closer[i].at.fd >= 0 && aside.closer[i].at.owner == owner) {
			since = aside.closer[i].at.since_ns;
			n++;
		}
	/* None is in a thread: the first that waits for one. */
	for (size_t i = 0; i < aside.n; i++)
		if (aside.list[i].owner == owner) {
			since = since ? since : aside.list[i].since_ns;
			n++;
		}
	lock_give(&aside.lock);
	*ret_since_ns = since;
	return n >= most;
}

static bool at_once(int fd)
{
	socklen_t size = sizeof(int);
	int type, unread;

	if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0)
		return ioctl(fd, FIONREAD, &unread) != 0 || !unread;
	return fcntl(fd, F_GETPIPE_SZ) >= 0;
}

static bool room(void)
{
	struct closing *more;
	size_t cap;

	if (aside.n < aside.cap)
		return true;
	cap = aside.cap ? 2 * aside.cap : 16;
	more = realloc(aside.list, cap * sizeof *more);
	if (!more)
		return false;
	aside.list = more;
	aside.cap = cap;
	return true;
}

bool io_closer(int fd)
{
	/* After the close the number can belong to another file. */
	uint32_t owner = fd < NUMBERS && owner_of[fd] ? atomic_exchange(&owner_of[fd], 0) : current_owner;
	bool kept;

	if (!must_not_wait || at_once(fd))
		return false;
	lock_take(&aside.lock);
	kept = aside.threads && room();
	if (kept) {
		aside.list[aside.n++] = (struct closing){fd, owner, clock_mono_ns()};
		pending++;
		wake_closer();
	}
	lock_give(&aside.lock);
	return kept;
}
