/*
 * Doctor: checks of the daemon. Each has a name, a state, a sentence, and a hint.
 *
 * The model: a worker examines disks and geoid grids (health_check); everything else is known to the loop. Then all checks are
 * made at once. State "wrong": the service cannot keep a promise now, and somebody has to act. State "warning": that may follow.
 * Counts are since the start of the daemon. The client itself checks socket, clock and groups.
 */
#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "clock.h"
#include "log.h"
#include "parse.h"
#include "rights.h"
#include "process.h"
#include "server_priv.h"

enum { CHECKS = 40, SENTENCE = 512 };
enum check_state { OK, WARNING, WRONG, UNKNOWN };
static const char *const states[] = {"ok", "warning", "wrong", "unknown"};

#define DAY 86400.0
#define VERIFY_DAYS 35                     /* acut-verify.timer runs each week */
#define PROCESS_BYTES (UINT64_C(48) << 20) /* of the process, outside of its budget */

/* The checks of one request. */
struct doctor {
	struct request *q;
	int64_t client_us;
	Acut__V1__Doctor answer;
	Acut__V1__DoctorCheck check[CHECKS], *checks[CHECKS];
	char message[CHECKS][SENTENCE], hint[CHECKS][SENTENCE];
};

static void add_check(struct doctor *v, const char *name, enum check_state state, const char *hint, const char *fmt, ...)
	__attribute__((format(printf, 5, 6)));
static void add_check(struct doctor *v, const char *name, enum check_state state, const char *hint, const char *fmt, ...)
{
	size_t n = v->answer.n_checks;
	Acut__V1__DoctorCheck *c = &v->check[n];
	va_list ap;

	if (n == CHECKS)
		abort();
	acut__v1__doctor_check__init(c);
	va_start(ap, fmt);
	vsnprintf(v->message[n], SENTENCE, fmt, ap);
	va_end(ap);
	snprintf(v->hint[n], SENTENCE, "%s", state == OK ? "" : hint);
	c->name = (char *)name;
	c->state = (char *)states[state];
	c->message = v->message[n];
	c->hint = v->hint[n];
	v->checks[v->answer.n_checks++] = c;
}

static unsigned long long event_count(enum log_event e)
{
	return (unsigned long long)log_event_count(e);
}

/* ---- the peer, and the process ---- */

static void check_rights(struct doctor *v, const struct server *s, const struct peer *peer)
{
	add_check(v, "rights", OK, "", "user %u (group %u and %u more) may submit and push%s", peer->uid, peer->gid,
		  peer->ngroups,
		  rights_admin(peer) ? ", and is an administrator" : ", and sees its own data and what it may read");
	if (s->p.rights.gid == RIGHTS_NOBODY && !s->p.rights.group[0])
		add_check(v, "group", OK, "", "no group is set: everybody who can connect to the socket may submit");
	else if (s->p.rights.gid == RIGHTS_NOBODY)
		add_check(v, "group", WRONG, "make the group (addgroup --system NAME), then: systemctl restart acutd",
			  "the group %s that may submit does not exist", s->p.rights.group);
	else
		add_check(v, "group", OK, "", "members of the group %s may submit", s->p.rights.group);
}

static void check_files(struct doctor *v, const struct health *h)
{
	static const char hint[] = "raise LimitNOFILE= of acutd.service (16384), or the limit of the shell that starts acutd";
	unsigned n = h->open_files;
	struct rlimit files;

	if (getrlimit(RLIMIT_NOFILE, &files) != 0)
		add_check(v, "files", UNKNOWN, "", "the limit of open files cannot be read: %s", strerror(errno));
	else if (n + 32 > files.rlim_cur || n > files.rlim_cur - files.rlim_cur / 10)
		add_check(v, "files", WRONG, hint, "%u files are open, of %llu that may be", n,
			  (unsigned long long)files.rlim_cur);
	else if (files.rlim_cur < 1024 || event_count(LOG_EVENT_CLIENTS_WAIT))
		add_check(v, "files", WARNING, hint,
			  "%u files are open, of %llu that may be; clients had to wait for a descriptor %llu times", n,
			  (unsigned long long)files.rlim_cur, event_count(LOG_EVENT_CLIENTS_WAIT));
	else
		add_check(v, "files", OK, "", "%u files are open, of %llu that may be", n, (unsigned long long)files.rlim_cur);
}

static void check_memory(struct doctor *v, const struct server *s)
{
	char a[32], b[32], c[32];
	uint64_t peak = process_peak_rss();

	parse_size_text(s->p.memory, a);
	parse_size_text(peak, b);
	if (s->p.memory_most != UINT64_MAX && s->p.memory_most != 0 && s->p.memory_most < s->p.memory + PROCESS_BYTES)
		add_check(v, "memory", WRONG,
			  "raise MemoryMax= of acutd.service, or lower memory in acutd.conf: 48M less than MemoryMax=",
			  "acutd may use %s, but its control group allows %s", a, parse_size_text(s->p.memory_most, c));
	else if (peak > s->p.memory + PROCESS_BYTES)
		add_check(v, "memory", WARNING, "please report this, with the output of acutctl status --json",
			  "acutd had %s resident, more than its memory of %s", b, a);
	else
		add_check(v, "memory", OK, "", "%s, at most %s were resident so far", a, b);
}

static void check_clock(struct doctor *v)
{
	int64_t now = clock_real_us();
	double skew = (double)(v->client_us - now) / 1e6;

	if (now < INT64_C(1700000000) * 1000000 || now > INT64_C(7258118400) * 1000000)
		add_check(v, "clock", WRONG, "set the clock (timedatectl): pushes are dated by it",
			  "the clock of acutd is wrong by years");
	else if (v->client_us && (skew > 5 || skew < -5))
		add_check(v, "clock", WARNING, "set both clocks by NTP (timedatectl)",
			  "the clocks of acutctl and acutd differ by %.0f seconds", skew < 0 ? -skew : skew);
	else
		add_check(v, "clock", OK, "", "the clocks of acutctl and acutd agree");
}

/* All threads exist from the start. If the limit is lower now, the next start fails. */
static void check_tasks(struct doctor *v, const struct server *s, const struct health *h)
{
	uint64_t most = s->p.tasks_most ? s->p.tasks_most() : UINT64_MAX;

	if (!h->threads)
		add_check(v, "tasks", UNKNOWN, "", "the threads of acutd cannot be counted");
	else if (most < h->threads)
		add_check(
			v, "tasks", WARNING,
			"raise TasksMax= of acutd.service (320), or lower threads in acutd.conf: otherwise the next start fails",
			"acutd has %u threads, and its control group allows %llu tasks", h->threads, (unsigned long long)most);
	else if (most == UINT64_MAX)
		add_check(v, "tasks", OK, "", "%u threads; no control group limits them", h->threads);
	else
		add_check(v, "tasks", OK, "", "%u threads, of %llu tasks that its control group allows", h->threads,
			  (unsigned long long)most);
}

/* ---- quotas of the user ---- */

/* "USED of LIMIT WHAT, ..." */
struct quota_text {
	char text[320];
	size_t n;
	bool near; /* one is used to 90 % */
};

static void add_quota(struct quota_text *l, uint64_t has, uint64_t most, bool bytes, const char *what)
{
	char a[32], b[32];
	int n;

	if (!most)
		return;
	snprintf(a, sizeof a, "%llu", (unsigned long long)has);
	snprintf(b, sizeof b, "%llu", (unsigned long long)most);
	n = snprintf(l->text + l->n, sizeof l->text - l->n, "%s%s of %s %s", l->n ? ", " : "",
		     bytes ? parse_size_text(has, a) : a, bytes ? parse_size_text(most, b) : b, what);
	l->n += n > 0 && (size_t)n < sizeof l->text - l->n ? (size_t)n : 0;
	l->near |= has >= most - most / 10;
}

static void check_limits(struct doctor *v, const struct conn *c, const struct health *h)
{
	struct quota_text l = {.n = 0};
	struct service_usage usage;

	service_usage(c->server->service, &c->peer, h->state.total, &usage);
	if (usage.exempt) {
		add_check(v, "limits", OK, "", "an administrator has no limits");
		return;
	}
	add_quota(&l, usage.jobs, usage.jobs_most, false, "unfinished jobs");
	add_quota(&l, usage.datasets, usage.datasets_most, false,
		  usage.removed ? "datasets (removed ones count until they are gone)" : "datasets");
	add_quota(&l, usage.disk, usage.disk_most, true, "on the disk");
	add_quota(&l, conn_count(c->server, c->peer.uid), c->server->p.user_connections, false, "connections");
	if (!l.n)
		add_check(v, "limits", OK, "", "no limits are set for users");
	else if (l.near)
		add_check(v, "limits", WARNING,
			  "remove what nobody needs (acutctl rm, dataset rm, prune, discard), or ask an administrator for more",
			  "this user is near a limit: %s", l.text);
	else
		add_check(v, "limits", OK, "", "this user has %s", l.text);
}

/* ---- the disk ---- */

static void check_folder(struct doctor *v, const char *name, const char *folder, const struct health_side *h,
			 const struct space_side *s)
{
	static const char make_room[] =
		"make room on the disk; acutctl cache stat shows what acut holds, cache gc --all frees what can be "
		"made again, dataset rm, prune and discard the rest";
	char a[32], b[32];

	parse_size_text(h->free, a);
	parse_size_text(s->keep_free, b);
	if (h->sys)
		add_check(v, name, WRONG, "check the mount of the folder", "%s cannot be examined: %s", folder, strerror(h->sys));
	else if (h->read_only)
		add_check(v, name, WRONG,
			  "look for errors of the disk in dmesg, repair the file system, and mount it for writing",
			  "%s is on a file system that is mounted read-only", folder);
	else if (h->free <= s->keep_free)
		add_check(v, name, WRONG, make_room, "%s are free for %s, and %s have to stay free: nothing can be pushed", a,
			  folder, b);
	else if (s->quota != UINT64_MAX && s->used >= s->quota)
		add_check(v, name, WRONG, make_room, "the quota of %s for %s is used up", parse_size_text(s->quota, b), folder);
	else if (h->files && h->files_free < 1000)
		add_check(v, name, WRONG, "remove files from the file system, or make one with more inodes",
			  "%llu inodes are free for %s", (unsigned long long)h->files_free, folder);
	else if (h->files && h->files_free < h->files / 50)
		add_check(v, name, WARNING, "remove files from the file system, or make one with more inodes",
			  "%llu of %llu inodes are free for %s", (unsigned long long)h->files_free, (unsigned long long)h->files,
			  folder);
	else if (h->free - s->keep_free < h->total / 20 || (s->quota != UINT64_MAX && s->used > s->quota - s->quota / 20))
		add_check(v, name, WARNING, make_room, "space for %s runs low: %s are free, %s of them have to stay free", folder,
			  a, b);
	else
		add_check(v, name, OK, "", "%s are free for %s", a, folder);
}

static void check_verify(struct doctor *v, const struct service_numbers *n)
{
	static const char how[] =
		"acutctl cache verify reads everything; acut-verify.timer does it each week (systemctl enable --now "
		"acut-verify.timer)";
	const struct verified *last = &n->verified;
	double days = (double)(clock_real_us() - last->at_us) / 1e6 / DAY;

	if (last->at_us && last->damaged)
		add_check(v, "verify", WRONG,
			  "acutctl cache verify names what is damaged: push it again or import a backup, and look at the "
			  "disk's health (smartctl, dmesg)",
			  "the last verification, %.0f days ago, found damage in %llu files of pushed data", days,
			  (unsigned long long)last->damaged);
	else if (last->at_us && last->newer)
		add_check(
			v, "verify", WRONG,
			"acutctl cache verify names them: install the newer acut that wrote them again, or a later one",
			"the last verification, %.0f days ago, found %llu files of a newer version of acut, which this one cannot read",
			days, (unsigned long long)last->newer);
	else if (!last->at_us)
		add_check(v, "verify", n->datasets ? WARNING : OK, how, "what is stored was never verified");
	else if (days > VERIFY_DAYS)
		add_check(v, "verify", WARNING, how, "what is stored was last verified %.0f days ago", days);
	else
		add_check(v, "verify", OK, "", "everything was verified %.0f days ago: %llu files, no damage to pushed data",
			  days < 0 ? 0 : days, (unsigned long long)last->files);
}

static void check_damage(struct doctor *v)
{
	if (event_count(LOG_EVENT_DAMAGE) || event_count(LOG_EVENT_VERIFY_DAMAGE))
		add_check(v, "damage", WRONG,
			  "acutctl cache verify names what is damaged: push it again or import a backup, and look at the "
			  "disk's health (smartctl, dmesg)",
			  "damage to pushed data was found %llu times since the start", event_count(LOG_EVENT_DAMAGE));
	else if (event_count(LOG_EVENT_DAMAGE_DERIVED))
		add_check(v, "damage", WARNING, "look at the disk's health (smartctl, dmesg)",
			  "damage to files of the cache was found %llu times since the start; these files were made again",
			  event_count(LOG_EVENT_DAMAGE_DERIVED));
	else
		add_check(v, "damage", OK, "", "no damage was found since the start");
}

static void check_geoids(struct doctor *v, const struct health *h)
{
	if (h->geoids_bad || (!h->geoids && *h->geoid_why))
		add_check(v, "geoids", WRONG, "remove it and add it again: acutctl geoid rm, acutctl geoid add",
			  "%u of %u geoid grids cannot be used: %s", h->geoids_bad, h->geoids, h->geoid_why);
	else
		add_check(v, "geoids", OK, "", "%u geoid grids are kept", h->geoids);
}

/* ---- catalogue, pushes, jobs, log ---- */

static void check_catalogue(struct doctor *v, const struct service_numbers *n)
{
	static const char hint[] =
		"look at the space and the health of the disk with the state folder, then: systemctl restart acutd";

	if (n->catalogue_failed)
		add_check(v, "catalogue", WRONG, hint, "the catalogue cannot be written: no change is acknowledged");
	else if (event_count(LOG_EVENT_CATALOGUE_FAILED))
		add_check(v, "catalogue", WARNING, hint, "the catalogue could not be written %llu times since the start",
			  event_count(LOG_EVENT_CATALOGUE_FAILED));
	else
		add_check(v, "catalogue", OK, "", "it can be written; datasets: %llu, jobs: %llu",
			  (unsigned long long)n->datasets, (unsigned long long)n->jobs_listed);
}

/* Only who pushes, and administrators, see the name of a file. */
static void check_pushes(struct doctor *v, const struct server *s, const struct peer *peer, const struct service_numbers *n)
{
	struct push_stall stall;
	unsigned stalled = pushes_stalled(s->service->pushes, &stall);
	bool shown = stalled && *stall.file && (rights_admin(peer) || peer->uid == stall.uid);

	if (stalled)
		add_check(
			v, "pushes", WARNING,
			"look at the file system that it is on (a network or FUSE mount that does not answer): acutd cannot end a "
			"read, which keeps a thread and the memory of its push until it returns",
			"%u pushes read a file that gives nothing, push %llu since %.0f seconds%s%.300s", stalled,
			(unsigned long long)stall.push, stall.seconds, shown ? ": " : "", shown ? stall.file : "");
	else if (n->pending && n->pending_left < DAY)
		add_check(
			v, "pushes", WARNING,
			"push the same files again: durable files are not read twice (acutctl datasets shows where); or discard "
			"them (acutctl dataset discard)",
			"%llu interrupted pushes wait, the first is removed in %.0f hours", (unsigned long long)n->pending,
			n->pending_left < 0 ? 0 : n->pending_left / 3600);
	else if (n->pending)
		add_check(v, "pushes", OK, "", "%llu interrupted pushes wait to be pushed again, %llu pushes are open",
			  (unsigned long long)n->pending, (unsigned long long)n->pushes);
	else
		add_check(v, "pushes", OK, "", "%llu pushes are open, none was interrupted", (unsigned long long)n->pushes);
}

static void check_jobs(struct doctor *v, const struct service_numbers *n)
{
	uint64_t unfinished = 0;

	for (int i = 0; i < JOB_STATES; i++)
		unfinished += n->states[i];
	if (n->waiting_space)
		add_check(v, "jobs", WARNING, "acutctl jobs shows how much they need; make room, or run acutctl cache gc --all",
			  "%llu jobs wait for room on the disk", (unsigned long long)n->waiting_space);
	else if (n->oldest_waiting > 3600)
		add_check(v, "jobs", WARNING,
			  "acutctl jobs shows what each waits for: give acutd more memory or threads, or cancel jobs",
			  "the oldest of %llu jobs waits for %.1f hours", (unsigned long long)unfinished,
			  n->oldest_waiting / 3600);
	else
		add_check(v, "jobs", OK, "", "%llu are unfinished; since the start %llu were done, %llu failed",
			  (unsigned long long)unfinished, event_count(LOG_EVENT_JOB_DONE), event_count(LOG_EVENT_JOB_FAILED));
}

/* Warnings of the log that somebody may have missed. */
static void check_log(struct doctor *v, const struct server *s)
{
	static const enum log_event logged[] = {LOG_EVENT_SLOW,         LOG_EVENT_STORE_FAILED,      LOG_EVENT_LEFTOVER,
						LOG_EVENT_MERGE_FAILED, LOG_EVENT_CONFIG_REFUSED,    LOG_EVENT_SPACE_UNKNOWN,
						LOG_EVENT_UNREADABLE,   LOG_EVENT_CLIENT_TURNED_AWAY};
	unsigned bad = 0;

	if (s->p.warning) {
		add_check(v, "start", WARNING, "", "%s", s->p.warning);
		bad++;
	}
	for (size_t i = 0; i < sizeof logged / sizeof *logged; i++) {
		char hint[96];

		if (!log_event_count(logged[i]))
			continue;
		bad++;
		snprintf(hint, sizeof hint, "journalctl -x -t acutd MESSAGE_ID=%s", log_event_id(logged[i]));
		add_check(v, "log", WARNING, hint, "%s: %llu times since the start", log_event_subject(logged[i]),
			  event_count(logged[i]));
	}
	if (!bad)
		add_check(v, "log", OK, "", "no warnings since the start, %.1f hours ago", clock_since(s->started_ns) / 3600);
}

/* ---- all ---- */

static void on_health(void *token, const struct err *why, const struct health *h)
{
	struct doctor *v = token;
	struct request *q = v->q;
	struct server *s = q->conn->server;
	struct service_numbers n;
	struct cache_stat st;

	if (why) {
		request_refuse(q, why);
		free(v);
		return;
	}
	service_numbers(s->service, &n);
	cache_stat(s->service->maintenance, &st);
	check_rights(v, s, &q->conn->peer);
	check_limits(v, q->conn, h);
	check_files(v, h);
	check_tasks(v, s, h);
	check_memory(v, s);
	check_clock(v);
	check_folder(v, "state", s->p.state_dir, &h->state, &st.space.state);
	check_folder(v, "cache", s->p.cache_dir, &h->cache, &st.space.cache);
	check_verify(v, &n);
	check_damage(v);
	check_geoids(v, h);
	check_catalogue(v, &n);
	check_pushes(v, s, &q->conn->peer, &n);
	check_jobs(v, &n);
	check_log(v, s);
	request_answer(q, FRAME_MESSAGE(DOCTOR, doctor, &v->answer));
	free(v);
}

void request_doctor(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct doctor *v = calloc(1, sizeof *v);
	struct err err = ERR_INIT;

	if (!v) {
		err_set(&err, ERR_NOMEM, "no memory for the checks");
		request_refuse(q, &err);
		return;
	}
	acut__v1__doctor__init(&v->answer);
	v->answer.checks = v->checks;
	v->client_us = m->doctor_request->now_us;
	v->q = q;
	health_check(c->server->service, &c->peer, on_health, v);
}
