/*
 * acutd: start, the loop, stop.
 *
 * The order of a start: options, locks on the folders, the budget, workers, catalogue, jobs (which clean up
 * after a crash), sockets, READY. A stop (SIGTERM, SIGINT, or idleness of a private daemon) ends connections
 * and what is bound to them, waits for the workers, and leaves folders without temporary files; after nine
 * seconds it removes those and goes, which is safe at any moment.
 */
#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <sys/vfs.h>
#include <systemd/sd-daemon.h>
#include <systemd/sd-event.h>
#include <unistd.h>

#include "catalogue.h"
#include "clock.h"
#include "config.h"
#include "config_log.h"
#include "config_told.h"
#include "err.h"
#include "io.h"
#include "job.h"
#include "journal.h"
#include "ledger.h"
#include "log.h"
#include "marker.h"
#include "notify.h"
#include "parse.h"
#include "place.h"
#include "place_fs.h"
#include "sched_pool.h"
#include "server.h"
#include "settings.h"
#include "space.h"

#define TICK_USEC 100000
#define QUIET_TICK_USEC 30000000 /* whether others have filled the disk */
#define PARK_USEC 9000000
#define STOP_SPARE_USEC 20000000 /* beyond that, for what was on its way to the disk */
#define HAND_OVER_MAX 16
#define SLOW_NS UINT64_C(1000000000)
#define HEAP_SLACK (UINT64_C(1) << 20)

struct daemon {
	struct config config;
	int statefd, cachefd, state_lock, cache_lock, socket_lock;
	int sockets[HAND_OVER_MAX]; /* that listen */
	int nsockets;
	bool bound; /* the socket is ours by --socket */
	sd_event *event;
	struct ledger *ledger;
	struct sched *sched;
	struct catalogue *catalogue;
	struct jobs *jobs;
	struct server *server;
	sd_event_source *tick, *last;
	struct notify notify;
	bool ticking, stopping, over;
	uint64_t tick_usec; /* that the tick was set to */
	uint64_t slow_ns; /* when a slow round was told last, 0: never */
	char warning[256]; /* that the start found; "": none */
	uint64_t idle_ns; /* since when, 0: busy */
	uint64_t heaped;  /* the most that heap_trim has seen since it trimmed */
};

/* ---- the loop ---- */

static void stop(struct daemon *d);

static bool busy(struct daemon *d)
{
	return server_connections(d->server) || jobs_active(d->jobs);
}

/* Nobody can connect while the lock of the socket is held, so a last look is the last. */
static void end_if_idle(struct daemon *d)
{
	int lock = -1;

	if (d->nsockets && !d->bound && !place_lock_socket(d->sockets[0], &lock)) {
		d->idle_ns = clock_mono_ns();
		return;
	}
	if (server_accept_last(d->server)) {
		io_close(lock);
		return;
	}
	if (d->nsockets)
		log_event(LOG_EVENT_STOP, NULL, "idle for %.0f seconds: the end", d->config.idle_exit);
	else
		log_event(LOG_EVENT_STOP, NULL, "the only client is gone: the end");
	for (int i = 0; i < d->nsockets; i++)
		place_unbind(d->sockets[i]);
	io_close(lock);
	stop(d);
}

/* Seconds that a private daemon stays without work and clients; less than 0: for ever. */
static double idle_wait(const struct daemon *d)
{
	/* Without a listening socket nobody can come any more. */
	if (!server_listens(d->server))
		return 0;
	return d->config.idle_exit > 0 ? d->config.idle_exit : -1;
}

static void look_idle(struct daemon *d)
{
	double wait = idle_wait(d);

	if (!d->stopping && wait >= 0 && d->idle_ns && !busy(d) && clock_since(d->idle_ns) >= wait)
		end_if_idle(d);
}

/* Until when the loop may sleep: while there is work ten times a second, else until the service manager wants a sign of life,
 * and to see whether others have filled the disk; both at once. */
static uint64_t sleep_usec(struct daemon *d)
{
	uint64_t usec = jobs_active(d->jobs) || d->stopping ? TICK_USEC : QUIET_TICK_USEC, most = notify_wait(&d->notify);
	double wait = idle_wait(d);

	if (wait < 0 || busy(d)) {
		d->idle_ns = 0;
	} else {
		if (!d->idle_ns)
			d->idle_ns = clock_mono_ns();
		wait -= clock_since(d->idle_ns);
		if (wait * 1e6 < (double)usec)
			usec = wait > 1e-3 ? (uint64_t)(wait * 1e6) : 1000;
	}
	return most < usec ? most : usec;
}

static void tick_wanted(struct daemon *d)
{
	uint64_t usec = sleep_usec(d);

	if (d->ticking && usec >= d->tick_usec)
		return;
	d->ticking = true;
	d->tick_usec = usec;
	sd_event_source_set_time_relative(d->tick, usec);
	sd_event_source_set_enabled(d->tick, SD_EVENT_ONESHOT);
}

static int on_tick(sd_event_source *source, uint64_t usec, void *ctx)
{
	struct daemon *d = ctx;

	d->ticking = false;
	jobs_tick(d->jobs);
	look_idle(d);
	return 0;
}

/* Small things are freed in any order, and the heap gives back its end only: what lies free between goes back to the
 * kernel here, so that nobody has what the ledger gives to others. */
static void heap_trim(struct daemon *d)
{
	const unsigned small = 1u << LEDGER_MESSAGE | 1u << LEDGER_JOBS | 1u << LEDGER_FILES | 1u << LEDGER_MANIFEST |
			       1u << LEDGER_PLAN | 1u << LEDGER_INDEX;
	uint64_t held = ledger_claimed(d->ledger, small);

	if (held + HEAP_SLACK < d->heaped) {
		malloc_trim(0);
		d->heaped = held;
	} else if (held > d->heaped) {
		d->heaped = held;
	}
}

/* After each round: what was freed, finished or asked in it may let something else start. */
/* Everybody waited meanwhile; told at most once a minute. */
static void look_slow(struct daemon *d)
{
	uint64_t began, now = clock_mono_ns();

	if (sd_event_now(d->event, CLOCK_MONOTONIC, &began) != 0 || now < 1000 * began + SLOW_NS ||
	    (d->slow_ns && now - d->slow_ns < 60 * SLOW_NS))
		return;
	d->slow_ns = now;
	log_event(LOG_EVENT_SLOW, NULL, "clients had to wait for %.1f seconds: a round of the loop took so long",
		  (double)(now - 1000 * began) / 1e9);
}

static int on_round(sd_event_source *source, void *ctx)
{
	struct daemon *d = ctx;
	struct jobs_work work;

	jobs_settle(d->jobs);
	server_settle(d->server);
	heap_trim(d);
	jobs_work(d->jobs, &work);
	notify_round(&d->notify, &work);
	if (d->stopping && jobs_parked(d->jobs) && !server_connections(d->server)) {
		d->over = true;
		sd_event_exit(d->event, 0);
	}
	tick_wanted(d);
	look_slow(d);
	return 0;
}

static int on_sched(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	sched_dispatch(((struct daemon *)ctx)->sched);
	return 0;
}

static int on_catalogue(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	catalogue_dispatch(((struct daemon *)ctx)->catalogue);
	return 0;
}

/* Work did not end in time. What is durable is so already; the rest is removed by name. */
static int on_last(sd_event_source *source, uint64_t usec, void *ctx)
{
	struct daemon *d = ctx;

	log_event(LOG_EVENT_STOP_CUT, NULL, "work did not stop in time: it is cut off");
	jobs_abandon(d->jobs);
	_exit(0);
}

static void stop(struct daemon *d)
{
	if (d->stopping)
		return;
	d->stopping = true;
	notify_stopping(&d->notify, PARK_USEC + STOP_SPARE_USEC);
	if (d->bound)
		place_unbind(d->sockets[0]);
	server_stop(d->server);
	jobs_park(d->jobs);
	if (sd_event_add_time_relative(d->event, &d->last, CLOCK_MONOTONIC, PARK_USEC, 0, on_last, d) < 0)
		log_warning("no timer: the stop takes as long as the work");
}

static int on_signal(sd_event_source *source, const struct signalfd_siginfo *si, void *ctx)
{
	log_event(LOG_EVENT_STOP, NULL, "signal %u: the end", si->ssi_signo);
	stop(ctx);
	return 0;
}

static int on_hangup(sd_event_source *source, const struct signalfd_siginfo *si, void *ctx)
{
	struct daemon *d = ctx;

	if (!d->stopping)
		settings_reload(&d->config, d->jobs, d->server);
	return 0;
}

/* ---- the start ---- */

static int adopt(struct daemon *d, int fd, struct err *err)
{
	int r, flags = fcntl(fd, F_GETFL);

	/* The service manager hands over blocking ones. */
	if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0)
		return err_sys(err, errno, "descriptor %d that was handed over cannot be used", fd);
	if (sd_is_socket(fd, AF_UNIX, SOCK_STREAM, 1) > 0) {
		r = server_listen(d->server, fd, err);
		if (!r)
			d->sockets[d->nsockets++] = fd;
		return r;
	}
	if (sd_is_socket(fd, AF_UNIX, SOCK_STREAM, 0) > 0)
		return server_adopt(d->server, fd, err);
	return err_set(err, ERR_USAGE, "descriptor %d that was handed over is not a Unix stream socket", fd);
}

static int take_sockets(struct daemon *d, struct err *err)
{
	int n = sd_listen_fds(1), r = 0;

	if (n > HAND_OVER_MAX)
		return err_set(err, ERR_USAGE, "more than %d sockets were handed over", HAND_OVER_MAX);
	for (int i = 0; !r && i < n; i++) {
		/* systemd and acutctl hand over blocking sockets: an accept with nobody waiting would stop
		 * the loop. */
		int flags = fcntl(SD_LISTEN_FDS_START + i, F_GETFL);

		if (flags < 0 || fcntl(SD_LISTEN_FDS_START + i, F_SETFL, flags | O_NONBLOCK) < 0)
			return err_sys(err, errno, "cannot use descriptor %d that was handed over",
				       SD_LISTEN_FDS_START + i);
		r = adopt(d, SD_LISTEN_FDS_START + i, err);
	}
	if (!r && n > 0 && *d->config.socket) {
		err_set(err, ERR_USAGE, "--socket, but %d socket(s) were handed over", n);
		return err_add_hint(err, "leave --socket out");
	}
	if (!r && *d->config.socket) {
		int fd;

		r = place_bind(d->config.socket, &fd, &d->socket_lock, err);
		if (!r)
			r = server_listen(d->server, fd, err);
		if (!r) {
			d->sockets[d->nsockets++] = fd;
			d->bound = true;
		}
	}
	if (!r && n <= 0 && !*d->config.socket) {
		err_set(err, ERR_USAGE, "there is nothing to listen on");
		r = err_add_hint(err, "give --socket PATH, or start acutd by a socket unit");
	}
	return r;
}

static int watch(struct daemon *d, int fd, sd_event_io_handler_t handler, struct err *err)
{
	int r = sd_event_add_io(d->event, NULL, fd, EPOLLIN, handler, d);

	return r < 0 ? err_sys(err, -r, "cannot watch a descriptor") : 0;
}

static int make_loop(struct daemon *d, struct err *err)
{
	static const int signals[] = {SIGTERM, SIGINT};
	sigset_t set;
	int r;

	sigemptyset(&set);
	for (size_t i = 0; i < sizeof signals / sizeof signals[0]; i++)
		sigaddset(&set, signals[i]);
	sigaddset(&set, SIGHUP);
	sigprocmask(SIG_BLOCK, &set, NULL);
	signal(SIGPIPE, SIG_IGN);
	signal(SIGXFSZ, SIG_IGN); /* a limit of file sizes is an error of who meets it */
	r = sd_event_default(&d->event);
	for (size_t i = 0; r >= 0 && i < sizeof signals / sizeof signals[0]; i++)
		r = sd_event_add_signal(d->event, NULL, signals[i], on_signal, d);
	if (r >= 0)
		r = sd_event_add_signal(d->event, NULL, SIGHUP, on_hangup, d);
	if (r >= 0)
		r = sd_event_add_time_relative(d->event, &d->tick, CLOCK_MONOTONIC, TICK_USEC, TICK_USEC / 10,
					       on_tick, d);
	if (r >= 0)
		r = sd_event_add_post(d->event, NULL, on_round, d);
	if (r < 0)
		return err_sys(err, -r, "cannot make the event loop");
	sd_event_source_set_enabled(d->tick, SD_EVENT_ONESHOT);
	d->ticking = true;
	return 0;
}

/* Somebody has removed the cache's folder: again, with its lock. */
static int cache_again(void *ctx, int *ret_fd, struct err *err)
{
	struct daemon *d = ctx;
	int lock, r = place_cache(d->config.cache, ret_fd, &lock, err);

	if (r)
		return r;
	io_close(d->cache_lock);
	d->cache_lock = lock;
	return 0;
}

static uint64_t part(uint64_t total, unsigned of, uint64_t least, uint64_t most)
{
	uint64_t bytes = total / of;

	return bytes < least ? least : bytes > most ? most : bytes;
}

/* What is small and cannot wait has its part whatever domains and stages take, and what clients can make grow has a
 * bound. Stacks are there as long as the threads. */
static int make_budget(struct daemon *d, struct err *err)
{
	const uint64_t kib = 1 << 10, mib = 1 << 20, total = d->config.memory;
	uint64_t stacks = sched_thread_bytes(d->config.threads + 1); /* and the catalogue's */
	struct ledger *l = d->ledger = ledger_new(total);
	char need[32], have[32];

	if (!l)
		return err_set(err, ERR_NOMEM, "no memory for the ledger");
	if (!ledger_share(l, LEDGER_CATALOGUE, CATALOGUE_HEAP + CATALOGUE_QUEUE, CATALOGUE_HEAP + 4 * CATALOGUE_QUEUE) ||
	    !ledger_share(l, LEDGER_MESSAGE, part(total, 32, 768 * kib, 16 * mib), part(total, 8, 2 * mib, 256 * mib)) ||
	    !ledger_share(l, LEDGER_JOBS, part(total, 64, 384 * kib, 32 * mib), part(total, 8, 2 * mib, 256 * mib)) ||
	    !ledger_share(l, LEDGER_PIPE, part(total, 64, 256 * kib, 16 * mib), total / 8) ||
	    !ledger_share(l, LEDGER_PLAN, part(total, 128, 192 * kib, 32 * mib), 0))
		return err_set(err, ERR_LIMIT, "the memory is too little for a daemon");
	if (stacks > total / 4 || !ledger_take(l, LEDGER_THREAD, stacks)) {
		err_set(err, ERR_LIMIT, "%u threads take %s of stacks, more than a quarter of the memory, %s", d->config.threads,
			parse_size_text(stacks, need), parse_size_text(total, have));
		return err_add_hint(err, "give fewer --threads, or --memory %s", parse_size_text(4 * stacks, need));
	}
	return 0;
}

static uint64_t tasks_most(void)
{
	return config_cgroup_tasks("");
}

static int make_jobs(struct daemon *d, struct err *err)
{
	char path[600];
	struct server_params server = {
		.event = d->event,
		.ledger = d->ledger,
		.version = ACUT_VERSION,
		.state_dir = d->config.state,
		.cache_dir = d->config.cache,
		.memory = d->config.memory,
		.threads = d->config.threads,
		.user_connections = d->config.user_connections,
		.setting = settings_tell,
		.settings = CONFIG_SETTINGS,
		.setting_ctx = &d->config,
		.memory_most = config_cgroup_limit(""),
		.tasks_most = tasks_most,
		.warning = *d->warning ? d->warning : NULL,
	};
	struct jobs_params jobs = {
		.ledger = d->ledger,
		.statefd = d->statefd,
		.cachefd = d->cachefd,
		.threads = d->config.threads,
		.disk = d->config.disk,
		.keep_free = d->config.keep_free,
		.space_wait = d->config.space_wait,
		.keep_removed = d->config.keep_removed,
		.user = {.jobs = d->config.user_jobs, .memory = d->config.user_memory,
			 .datasets = d->config.user_datasets, .disk = d->config.user_disk},
		.cache_again = cache_again,
		.cache_ctx = d,
		.changed = server_job_changed,
	};
	int r;

	settings_rights(&d->config, &server.rights);
	snprintf(path, sizeof path, "%s/catalogue.db", d->config.state);
	r = sched_new(d->ledger, d->config.threads, &d->sched, err);
	if (!r)
		r = catalogue_new(path, d->ledger, &d->catalogue, err);
	if (!r)
		r = server_new(&server, &d->server, err);
	if (!r) {
		jobs.sched = d->sched;
		jobs.catalogue = d->catalogue;
		jobs.ctx = d->server;
		r = jobs_new(&jobs, &d->jobs, err);
	}
	if (!r)
		r = watch(d, sched_fd(d->sched), on_sched, err);
	if (!r)
		r = watch(d, catalogue_fd(d->catalogue), on_catalogue, err);
	if (!r)
		server_set_jobs(d->server, d->jobs);
	return r;
}

/* Of a disk that others have filled: the catalogue cannot even be opened then, and nobody would be there to evict.
 * What keep-free says is seen to later. */
static void make_room(struct daemon *d)
{
	const uint64_t least = 1 << 20;
	const struct space_params p = {.statefd = d->statefd, .cachefd = d->cachefd,
				       .keep_free = {SPACE_BYTES, 2 * least}};
	struct err err = ERR_INIT;
	struct space *space;
	struct statvfs vfs;
	uint64_t bytes, files;

	if (io->fstatvfs(d->statefd, &vfs) != 0 || (uint64_t)vfs.f_bavail * vfs.f_frsize >= least)
		return;
	log_event(LOG_EVENT_DISK_FULL, NULL, "the disk is full: %llu bytes are free for the state",
		  (unsigned long long)vfs.f_bavail * vfs.f_frsize);
	if (!space_new(&p, &space, &err)) {
		space_evict(space, false, &bytes, &files, &err);
		space_free(space);
	}
	if (err.code)
		log_event_err(LOG_EVENT_DISK_FULL, NULL, "nothing can be evicted", &err);
}

/* Where it works, but not as it should. */
static void look_places(struct daemon *d)
{
	const uint32_t tmpfs = 0x01021994, ramfs = 0x858458f6;
	struct err err = ERR_INIT;
	struct statfs fs;

	if (io->fstatfs(d->statefd, &fs) == 0 && ((uint32_t)fs.f_type == tmpfs || (uint32_t)fs.f_type == ramfs))
		snprintf(d->warning, sizeof d->warning, "the state folder is in memory: what is pushed is gone when the machine stops");
	else if (place_fs_check(d->cachefd, &err) == -ERR_UNSUPPORTED)
		snprintf(d->warning, sizeof d->warning, "the cache is on a network file system: it is slow, and not made for it");
}

static int start(struct daemon *d, struct err *err)
{
	struct marker store;
	bool init = d->config.init || (d->config.init_first && place_cache_unused(d->config.cache));
	int r = place_state(d->config.state, init, &d->statefd, &d->state_lock, &store, err);

	/* One folder for both is one lock. */
	if (!r && strcmp(d->config.state, d->config.cache))
		r = place_cache(d->config.cache, &d->cachefd, &d->cache_lock, err);
	else if (!r)
		d->cachefd = dup(d->statefd);
	if (!r)
		make_room(d);
	if (!r && place_cache_serves(d->cachefd, &store, err))
		r = err_add_file(err, d->config.cache);
	if (!r)
		r = make_loop(d, err);
	if (!r)
		r = make_budget(d, err);
	if (!r)
		look_places(d);
	if (!r)
		r = make_jobs(d, err);
	if (!r)
		r = take_sockets(d, err);
	if (r == -ERR_NOSPACE)
		err_add_hint(err, "make room on the disk of state and cache, and start acutd again");
	return r;
}

enum { FILES_WANTED = 16384, STATUS_CONFIG = 78 /* EX_CONFIG */ };

/* The heap gives back what is freed, and few arenas keep little: what the ledger counts is what the process
 * has. */
static void tame_malloc(void)
{
	mallopt(M_ARENA_MAX, 2);
	mallopt(M_MMAP_THRESHOLD, 64 << 10);
	mallopt(M_TRIM_THRESHOLD, 128 << 10);
}

/* Sealing opens as many runs as it merges, several pushes at once. To no avail: those that do not fit fail. */
static void raise_files(void)
{
	struct rlimit files;

	if (getrlimit(RLIMIT_NOFILE, &files) != 0)
		return;
	files.rlim_cur = files.rlim_max < FILES_WANTED ? files.rlim_max : FILES_WANTED;
	setrlimit(RLIMIT_NOFILE, &files);
}

static void finish(struct daemon *d)
{
	server_free(d->server);
	sched_free(d->sched);
	catalogue_free(d->catalogue);
	jobs_free(d->jobs);
	sd_event_unref(d->event);
	if (d->ledger) {
		/* A start that failed early has not taken it. All the rest must have come back: ledger_free
		 * asserts that. */
		ledger_give(d->ledger, LEDGER_THREAD, ledger_held(d->ledger, LEDGER_THREAD));
		ledger_free(d->ledger);
	}
	io_close(d->statefd);
	io_close(d->cachefd);
	/* The locks last. */
	io_close(d->socket_lock);
	io_close(d->cache_lock);
	io_close(d->state_lock);
}

/* Of a start that failed. What no other start mends has a status of its own, of which the unit knows (RestartPreventExitStatus=):
 * a folder that is no store (an error of ours, not one of the disk), damage, too little memory. */
static int start_status(const struct err *err)
{
	bool told_wrong = (err->code == ERR_IO && !err->sys) || err->code == ERR_CORRUPT || err->code == ERR_LIMIT;

	return told_wrong ? STATUS_CONFIG : err_exit_status(err->code);
}

/* Who waits in the sockets of the service manager would have it start acutd again and again: he is told why not. */
static void turn_away(const struct err *why)
{
	int n = sd_listen_fds(0);

	for (int i = 0; i < n && i < HAND_OVER_MAX; i++)
		if (sd_is_socket_unix(SD_LISTEN_FDS_START + i, SOCK_STREAM, 1, NULL, 0) > 0)
			server_turn_away(SD_LISTEN_FDS_START + i, why);
}

int main(int argc, char **argv)
{
	struct daemon d = {
		.statefd = -1, .cachefd = -1, .state_lock = -1, .cache_lock = -1, .socket_lock = -1};
	struct config_told told = {.tell = config_log};
	struct err err = ERR_INIT;
	char size[32];
	int what, r;

	log_init("acutd", LOG_LEVEL_INFO);
	journal_open("acutd");
	tame_malloc();
	raise_files();
	r = config_parse(argc, argv, &d.config, &what, &told, &err);
	if (what == CONFIG_CHECK)
		return config_check(&d.config, &told);
	if (!r && what == CONFIG_EXIT)
		return 0;
	if (!r) {
		log_init("acutd", d.config.level);
		log_event(LOG_EVENT_START, NULL, "acutd %s starts", ACUT_VERSION);
		notify_start(&d.notify);
		r = start(&d, &err);
	}
	if (r) {
		log_event_err(LOG_EVENT_START_FAILED, NULL, "acutd cannot start", &err);
		turn_away(&err);
		finish(&d);
		return start_status(&err);
	}
	log_event(LOG_EVENT_READY, NULL, "acutd %s: %s of memory, %u threads, state in %s, cache in %s", ACUT_VERSION,
		  parse_size_text(d.config.memory, size), d.config.threads, d.config.state, d.config.cache);
	malloc_trim(0);
	notify_ready(&d.notify);
	r = sd_event_loop(d.event);
	if (r < 0) {
		/* Workers are busy: as after a crash, the next start cleans up. */
		log_event(LOG_EVENT_LOOP_FAILED, NULL, "the event loop failed: %s", strerror(-r));
		_exit(1);
	}
	finish(&d);
	return 0;
}
