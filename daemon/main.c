/*
 * acutd: start and end. (The time between: loop.c.)
 *
 * The order of a start: configuration, locks on the folders, the budget, workers, catalogue, service (which sweeps what a crash
 * left), sockets, READY. A stop (SIGTERM, SIGINT, or idle exit) closes connections with what is bound to them, waits for the
 * workers, and leaves folders without temporary files. After nine seconds it removes these files and exits, which is safe at any
 * moment.
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

static int adopt_socket(struct daemon *d, int fd, struct err *err)
{
	int r, flags = fcntl(fd, F_GETFL);

	/* systemd and acutctl pass blocking sockets: an accept without a client would stop the loop. */
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

static int open_sockets(struct daemon *d, struct err *err)
{
	int n = sd_listen_fds(1), r = 0;

	if (n > PASSED_SOCKETS_MAX)
		return err_set(err, ERR_USAGE, "more than %d sockets were handed over", PASSED_SOCKETS_MAX);
	for (int i = 0; !r && i < n; i++)
		r = adopt_socket(d, SD_LISTEN_FDS_START + i, err);
	if (!r && n > 0 && *d->config.socket) {
		err_set(err, ERR_USAGE, "--socket is given, but %d socket(s) were handed over", n);
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

/* Makes the removed folder of the cache again, with its lock. */
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

static uint64_t part_of(uint64_t total, unsigned of, uint64_t least, uint64_t most)
{
	uint64_t bytes = total / of;

	return bytes < least ? least : bytes > most ? most : bytes;
}

/* Sets memory aside for small things that cannot wait, whatever domains and stages take; and limits what clients can make grow.
 * Stacks, with that of the catalogue's thread, are charged as long as the threads exist; config_resolve has checked that they
 * fit. */
static int make_budget(struct daemon *d, struct err *err)
{
	const uint64_t kib = 1 << 10, mib = 1 << 20, total = d->config.memory;
	struct ledger *l = d->ledger = ledger_new(total);

	if (!l)
		return err_set(err, ERR_NOMEM, "no memory for the ledger");
	if (!ledger_reserve(l, LEDGER_CATALOGUE, CATALOGUE_HEAP + CATALOGUE_QUEUE, CATALOGUE_HEAP + 4 * CATALOGUE_QUEUE) ||
	    !ledger_reserve(l, LEDGER_MESSAGE, part_of(total, 32, 768 * kib, 16 * mib), part_of(total, 8, 2 * mib, 256 * mib)) ||
	    !ledger_reserve(l, LEDGER_JOBS, part_of(total, 64, 384 * kib, 32 * mib), part_of(total, 8, 2 * mib, 256 * mib)) ||
	    !ledger_reserve(l, LEDGER_PIPE, part_of(total, 64, 256 * kib, 16 * mib), total / 8) ||
	    !ledger_reserve(l, LEDGER_PLAN, part_of(total, 128, 192 * kib, 32 * mib), 0) ||
	    !ledger_take(l, LEDGER_THREAD, sched_thread_bytes(d->config.threads + 1)))
		return err_set(err, ERR_LIMIT, "the memory is too little for a daemon");
	return 0;
}

static uint64_t tasks_most(void)
{
	return config_cgroup_tasks("");
}

/* Removes the permissions of others from a catalogue that an earlier acutd made, or that came from a backup. Before SQLite opens
 * it: closing the descriptor here would release its locks. */
static void restrict_mode(const char *path)
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

/* The catalogue has data of all users, and the folder may have any mode. SQLite makes the file by the umask, and its other files
 * with the mode of this one. */
static int open_catalogue(const char *path, struct daemon *d, struct err *err)
{
	mode_t mask = umask(0077);
	int r;

	restrict_mode(path);
	r = catalogue_new(path, d->ledger, &d->catalogue, err);
	umask(mask);
	return r;
}

/* By then a client that started the daemon has had its first answer. */
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
				.defer_seconds = DEFER_SECONDS,
				.remake_cache = remake_cache,
				.cache_ctx = d,
			},
		.changed = server_job_changed,
	};
	int r;

	settings_rights(&d->config, &server.rights);
	settings_limits(&d->config, &service.core.limits);
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

/* If other programs have filled the disk, the catalogue cannot be opened. So the start evicts derived data until there is enough
 * space for that; keep-free is enforced later. */
static void evict_if_full(struct daemon *d)
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

/* Folders that work, but not well. */
static void check_folders(struct daemon *d)
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

/* A connection was passed: acutctl uses this daemon for one command, with a temporary state. */
static bool has_one_client(void)
{
	return sd_listen_fds(0) > 0 && sd_is_socket(SD_LISTEN_FDS_START, AF_UNIX, SOCK_STREAM, 0) > 0;
}

static int start_daemon(struct daemon *d, struct err *err)
{
	bool init = d->config.init || (d->config.init_first && place_cache_unused(d->config.cache));
	int r = place_check_separate(d->config.state, d->config.cache, has_one_client(), err);

	if (!r)
		r = place_state(d->config.state, init, &d->statefd, &d->state_lock, &d->store, err);
	if (!r)
		r = place_cache(d->config.cache, &d->cachefd, &d->cache_lock, err);
	if (!r)
		evict_if_full(d);
	if (!r)
		r = place_cache_claim(d->cachefd, d->config.cache, &d->store, err);
	if (!r)
		r = loop_make(d, err);
	if (!r)
		r = make_budget(d, err);
	if (!r)
		check_folders(d);
	if (!r)
		r = make_service(d, err);
	/* Up to here nobody waits for this thread, and a close by it takes less time than waking another. */
	if (!r)
		r = io_close_background(err);
	if (!r)
		r = open_sockets(d, err);
	if (r == -ERR_NOSPACE)
		err_add_hint(err, "make room on the disk of state and cache, and start acutd again");
	return r;
}

enum { FILES_WANTED = 16384, STATUS_CONFIG = 78 /* EX_CONFIG */ };

/* Few arenas, and early return of freed memory: the resident size follows the ledger. */
static void set_up_malloc(void)
{
	mallopt(M_ARENA_MAX, 2);
	mallopt(M_MMAP_THRESHOLD, 64 << 10);
	mallopt(M_TRIM_THRESHOLD, 128 << 10);
}

/* Sealing opens as many runs as it merges, for several pushes at once. If the limit cannot be raised, some pushes may fail. */
static void raise_file_limit(void)
{
	struct rlimit files;

	if (getrlimit(RLIMIT_NOFILE, &files) != 0)
		return;
	files.rlim_cur = files.rlim_max < FILES_WANTED ? files.rlim_max : FILES_WANTED;
	setrlimit(RLIMIT_NOFILE, &files);
}

static void free_daemon(struct daemon *d)
{
	io_close_foreground(); /* in this order */
	server_free(d->server);
	sched_free(d->sched);
	catalogue_free(d->catalogue);
	service_free(d->service);
	sd_event_unref(d->event);
	if (d->ledger) {
		/* A start that failed early has not charged it. ledger_free asserts that everything else was given back. */
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

/* The exit status of a failed start. Errors that no later start can avoid have a status that the unit knows
 * (RestartPreventExitStatus=): a folder that is no store (not an error of the disk), damage, too little memory. */
static int start_status(const struct err *err)
{
	bool is_permanent = (err->code == ERR_IO && !err->sys) || err->code == ERR_CORRUPT || err->code == ERR_LIMIT;

	return is_permanent ? STATUS_CONFIG : err_exit_status(err->code);
}

/* Clients that wait in the sockets of the service manager would make it start acutd again and again. They get the error. */
static void refuse_clients(const struct err *why)
{
	int n = sd_listen_fds(0);

	for (int i = 0; i < n && i < PASSED_SOCKETS_MAX; i++)
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

	io_reserve_standard();
	log_init("acutd", LOG_LEVEL_INFO);
	journal_open("acutd");
	set_up_malloc();
	raise_file_limit();
	r = config_parse(argc, argv, &d.config, &what, &report, &err);
	if (what == CONFIG_CHECK)
		return config_check(&d.config, &report);
	if (!r && what == CONFIG_EXIT)
		return 0;
	if (!r) {
		log_init("acutd", d.config.level);
		log_event(LOG_EVENT_START, NULL, "acutd %s starts", ACUT_VERSION);
		notify_start(&d.notify);
		r = start_daemon(&d, &err);
	}
	if (r) {
		log_event_err(LOG_EVENT_START_FAILED, NULL, "acutd cannot start", &err);
		refuse_clients(&err);
		free_daemon(&d);
		return start_status(&err);
	}
	log_event(LOG_EVENT_READY, NULL, "acutd %s: %s of memory, %u threads, state in %s, cache in %s", ACUT_VERSION,
		  parse_size_text(d.config.memory, size), d.config.threads, d.config.state, d.config.cache);
	malloc_trim(0);
	notify_ready(&d.notify);
	r = sd_event_loop(d.event);
	if (r < 0) {
		/* Workers still run. As after a crash, the next start sweeps. */
		log_event(LOG_EVENT_LOOP_FAILED, NULL, "the event loop failed: %s", strerror(-r));
		_exit(1);
	}
	free_daemon(&d);
	log_report_suppressed(true);
	return 0;
}
