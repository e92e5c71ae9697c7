/*
 * acutd: start and end. (What goes on between: loop.c.)
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
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/vfs.h>
#include <systemd/sd-daemon.h>
#include <systemd/sd-event.h>
#include <unistd.h>

#include "catalogue.h"
#include "config.h"
#include "config_report.h"
#include "err.h"
#include "io.h"
#include "service.h"
#include "journal.h"
#include "ledger.h"
#include "log.h"
#include "loop.h"
#include "marker.h"
#include "notify.h"
#include "parse.h"
#include "place.h"
#include "place_fs.h"
#include "sched_pool.h"
#include "server.h"
#include "settings.h"
#include "space.h"

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
			return err_sys(err, errno, "cannot use descriptor %d that was handed over", SD_LISTEN_FDS_START + i);
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

/* Somebody has removed the cache's folder: again, with its lock. */
static int remake_cache(void *ctx, int *ret_fd, struct err *err)
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

/* One that an earlier acutd made, or that was copied from a backup. Before SQLite has it: to close it here would give up its
 * locks. */
static void close_to_others(const char *path)
{
	static const char *const ends[] = {"", "-wal", "-shm"};
	char name[620];
	struct stat st;

	for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
		int fd;

		snprintf(name, sizeof name, "%s%s", path, ends[i]);
		fd = open(name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
		if (fd < 0)
			continue;
		if (fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && (st.st_mode & 0077) && fchmod(fd, st.st_mode & 0700) != 0)
			log_warning("%s can be opened by others, and its mode cannot be changed: %s", name, strerror(errno));
		close(fd);
	}
}

/* It names what rights.c tells not everybody, and the folder may be one that somebody made with another mode: SQLite goes by the
 * umask, its other files by this one's mode. */
static int open_catalogue(const char *path, struct daemon *d, struct err *err)
{
	mode_t mask = umask(0077);
	int r;

	close_to_others(path);
	r = catalogue_new(path, d->ledger, &d->catalogue, err);
	umask(mask);
	return r;
}

/* Whoever has started it has asked what he wants to know. */
#define DEFER_SECONDS 2.0

static int make_service(struct daemon *d, struct err *err)
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
		.setting = settings_get,
		.settings = CONFIG_SETTINGS,
		.setting_ctx = &d->config,
		.memory_most = config_cgroup_limit(""),
		.tasks_most = tasks_most,
		.warning = *d->warning ? d->warning : NULL,
	};
	struct service_params service = {
		.core =
			{
				.ledger = d->ledger,
				.statefd = d->statefd,
				.cachefd = d->cachefd,
				.store = d->store.id,
				.threads = d->config.threads,
				.disk = d->config.disk,
				.keep_free = d->config.keep_free,
				.space_wait = d->config.space_wait,
				.defer_seconds = DEFER_SECONDS,
				.keep_removed = d->config.keep_removed,
				.user = {.jobs = d->config.user_jobs,
					 .memory = d->config.user_memory,
					 .datasets = d->config.user_datasets,
					 .disk = d->config.user_disk},
				.remake_cache = remake_cache,
				.cache_ctx = d,
			},
		.changed = server_job_changed,
	};
	int r;

	settings_rights(&d->config, &server.rights);
	snprintf(path, sizeof path, "%s/catalogue.db", d->config.state);
	r = sched_new(d->ledger, d->config.threads, &d->sched, err);
	if (!r)
		r = open_catalogue(path, d, err);
	if (!r)
		r = server_new(&server, &d->server, err);
	if (!r) {
		service.core.sched = d->sched;
		service.core.catalogue = d->catalogue;
		service.ctx = d->server;
		r = service_new(&service, &d->service, err);
	}
	if (!r)
		r = loop_watch(d, sched_fd(d->sched), loop_on_sched, err);
	if (!r)
		r = loop_watch(d, catalogue_fd(d->catalogue), loop_on_catalogue, err);
	if (!r)
		server_set_service(d->server, d->service);
	return r;
}

/* Of a disk that others have filled: the catalogue cannot even be opened then, and nobody would be there to evict.
 * What keep-free says is seen to later. */
static void make_room(struct daemon *d)
{
	const uint64_t least = 1 << 20;
	const struct space_params p = {.statefd = d->statefd, .cachefd = d->cachefd, .keep_free = {SPACE_BYTES, 2 * least}};
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
		snprintf(d->warning, sizeof d->warning,
			 "the state folder is in memory: what is pushed is gone when the machine stops");
	else if (place_fs_check(d->cachefd, &err) == -ERR_UNSUPPORTED)
		snprintf(d->warning, sizeof d->warning, "the cache is on a network file system: it is slow, and not made for it");
}

/* A connection was handed over: acutctl has this daemon for one command, with a state that goes with it. */
static bool has_one_client(void)
{
	return sd_listen_fds(0) > 0 && sd_is_socket(SD_LISTEN_FDS_START, AF_UNIX, SOCK_STREAM, 0) > 0;
}

static int start(struct daemon *d, struct err *err)
{
	bool init = d->config.init || (d->config.init_first && place_cache_unused(d->config.cache));
	int r = place_apart(d->config.state, d->config.cache, has_one_client(), err);

	if (!r)
		r = place_state(d->config.state, init, &d->statefd, &d->state_lock, &d->store, err);
	if (!r)
		r = place_cache(d->config.cache, &d->cachefd, &d->cache_lock, err);
	if (!r)
		make_room(d);
	if (!r)
		r = place_cache_serves(d->cachefd, d->config.cache, &d->store, err);
	if (!r)
		r = loop_make(d, err);
	if (!r)
		r = io_close_aside(err);
	if (!r)
		r = make_budget(d, err);
	if (!r)
		look_places(d);
	if (!r)
		r = make_service(d, err);
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
	io_close_waits(); /* in this order */
	server_free(d->server);
	sched_free(d->sched);
	catalogue_free(d->catalogue);
	service_free(d->service);
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
			server_refuse_waiting(SD_LISTEN_FDS_START + i, why);
}

int main(int argc, char **argv)
{
	struct daemon d = {.statefd = -1, .cachefd = -1, .state_lock = -1, .cache_lock = -1, .socket_lock = -1};
	struct config_report report = {.emit = config_report_log};
	struct err err = ERR_INIT;
	char size[32];
	int what, r;

	io_take_standard();
	log_init("acutd", LOG_LEVEL_INFO);
	journal_open("acutd");
	tame_malloc();
	raise_files();
	r = config_parse(argc, argv, &d.config, &what, &report, &err);
	if (what == CONFIG_CHECK)
		return config_check(&d.config, &report);
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
	log_floods(true);
	return 0;
}
