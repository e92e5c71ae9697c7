/*
 * Metrics for monitoring, in pages. The client writes them in Prometheus' text format.
 *
 * The model: a page is one allocation with families and their samples. The first page has the metrics of the daemon, the next
 * ones those of datasets by name (cursor "d" and the last name), then those of users by number (cursor "u" and the next number).
 * Counters are since the start of the daemon. A user who is no administrator sees the datasets that he may read, and himself.
 * Names follow the rules of Prometheus: base units, _total for counters, a help text each.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "ledger.h"
#include "log.h"
#include "rights.h"
#include "process.h"
#include "server_priv.h"
#include "space.h"

enum {
	FAMILIES = 72,
	SAMPLES = 400,
	LABELS = 2,    /* of a sample, at most */
	DATASETS = 40, /* of a page: each takes 1 KiB at most */
	USERS = 96,
	TEXT = 24, /* of a number */
	EVENT_NAME = 32,
};
#define EVENT(name, id, level, subject) _Static_assert(sizeof #name <= EVENT_NAME, "the name of an event is too long");
#include "log_event.def"
#undef EVENT

struct metrics_page {
	Acut__V1__Metrics metrics;
	Acut__V1__MetricFamily family[FAMILIES], *families[FAMILIES];
	Acut__V1__MetricSample sample[SAMPLES], *samples[SAMPLES];
	Acut__V1__MetricLabel label[SAMPLES * LABELS], *labels[SAMPLES * LABELS];
	size_t nsamples, nlabels;
	char events[LOG_EVENTS][EVENT_NAME];
	char uid[DATASETS > USERS ? DATASETS : USERS][TEXT];
	struct dataset_info dataset[DATASETS];
	struct service_user user[USERS];
	char next[128];
};

/* Begins a family. The samples that follow are its samples. */
static void family(struct metrics_page *p, const char *name, const char *type, const char *help)
{
	Acut__V1__MetricFamily *f = &p->family[p->metrics.n_families];

	if (p->metrics.n_families == FAMILIES)
		abort();
	acut__v1__metric_family__init(f);
	f->name = (char *)name;
	f->type = (char *)type;
	f->help = (char *)help;
	f->samples = p->samples + p->nsamples;
	p->families[p->metrics.n_families++] = f;
}

static void label(struct metrics_page *p, Acut__V1__MetricSample *s, const char *name, const char *value)
{
	Acut__V1__MetricLabel *l = &p->label[p->nlabels];

	acut__v1__metric_label__init(l);
	l->name = (char *)name;
	l->value = (char *)value;
	p->labels[p->nlabels++] = l;
	s->n_labels++;
}

/* name, name2: labels; NULL: none. */
static void sample2(struct metrics_page *p, double value, const char *name, const char *text, const char *name2,
		    const char *text2)
{
	Acut__V1__MetricSample *s = &p->sample[p->nsamples];

	if (p->nsamples == SAMPLES)
		abort();
	acut__v1__metric_sample__init(s);
	s->value = value;
	s->labels = p->labels + p->nlabels;
	if (name)
		label(p, s, name, text);
	if (name2)
		label(p, s, name2, text2);
	p->samples[p->nsamples++] = s;
	p->family[p->metrics.n_families - 1].n_samples++;
}

static void sample(struct metrics_page *p, double value, const char *name, const char *text)
{
	sample2(p, value, name, text, NULL, NULL);
}

static void gauge(struct metrics_page *p, const char *name, const char *help, double value)
{
	family(p, name, "gauge", help);
	sample(p, value, NULL, NULL);
}

static void counter(struct metrics_page *p, const char *name, const char *help, uint64_t value)
{
	family(p, name, "counter", help);
	sample(p, (double)value, NULL, NULL);
}

/* ---- the daemon ---- */

static void add_process(struct metrics_page *p, struct server *s)
{
	struct ledger *l = s->p.ledger;

	family(p, "acut_build_info", "gauge", "1, with the version of acutd.");
	sample(p, 1, "version", s->p.version);
	gauge(p, "acut_start_time_seconds", "Start of acutd, in seconds since 1970. Counters begin then.",
	      (double)clock_real_us() / 1e6 - clock_since(s->started_ns));
	gauge(p, "acut_threads", "The most domains that are triangulated at once.", s->p.threads);
	gauge(p, "acut_memory_limit_bytes", "The memory that acutd may use.", (double)s->p.memory);
	gauge(p, "acut_resident_memory_bytes", "Resident memory of acutd.", (double)process_rss());
	gauge(p, "acut_resident_memory_peak_bytes", "The most resident memory of acutd since its start.",
	      (double)process_peak_rss());
	family(p, "acut_ledger_bytes", "gauge", "Memory charged to the budget, by account.");
	for (int i = 0; i < LEDGER_NAMES; i++)
		sample(p, (double)ledger_held(l, (enum ledger_name)i), "name", ledger_name_text((enum ledger_name)i));
	family(p, "acut_ledger_peak_bytes", "gauge", "The most memory charged to the budget since the start, by account.");
	for (int i = 0; i < LEDGER_NAMES; i++)
		sample(p, (double)ledger_peak(l, (enum ledger_name)i), "name", ledger_name_text((enum ledger_name)i));
	gauge(p, "acut_connections_open", "Clients that are connected.", server_connection_count(s));
	counter(p, "acut_connections_total", "Clients that were served since the start.", s->last_conn);
	counter(p, "acut_refusals_total",
		"Clients and requests that were refused for rights or limits of a user since the start.", s->refused.total);
}

/* Separate samples of state and cache, even if both are on one file system. */
static void add_folders(struct metrics_page *p, const struct space_stat *st)
{
	static const struct {
		const char *name, *help;
		size_t at;
	} rows[] = {
		{"acut_filesystem_size_bytes", "Size of the file system of state and cache.", offsetof(struct space_side, total)},
		{"acut_filesystem_free_bytes", "Free space on the file system of state and cache.",
		 offsetof(struct space_side, free)},
		{"acut_filesystem_keep_free_bytes", "Space that has to stay free there (keep-free).",
		 offsetof(struct space_side, keep_free)},
		{"acut_disk_used_bytes", "Space that acutd uses there and that the quota limits.",
		 offsetof(struct space_side, used)},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		family(p, rows[i].name, "gauge", rows[i].help);
		sample(p, (double)*(const uint64_t *)((const char *)&st->state + rows[i].at), "side", "state");
		sample(p, (double)*(const uint64_t *)((const char *)&st->cache + rows[i].at), "side", "cache");
	}
	if (st->state.quota == UINT64_MAX && st->cache.quota == UINT64_MAX)
		return;
	family(p, "acut_disk_quota_bytes", "gauge", "The most that acutd may use there (disk).");
	if (st->state.quota != UINT64_MAX)
		sample(p, (double)st->state.quota, "side", "state");
	if (st->cache.quota != UINT64_MAX)
		sample(p, (double)st->cache.quota, "side", "cache");
}

static void add_disk(struct metrics_page *p, struct server *s)
{
	struct cache_stat st;

	cache_stat(s->service->maintenance, &st);
	add_folders(p, &st.space);
	family(p, "acut_stored_bytes", "gauge", "Bytes stored on the disk, by kind.");
	for (int k = 0; k < SPACE_KINDS; k++)
		sample(p, (double)st.space.kind[k].bytes, "kind", space_kind_text((enum space_kind)k));
	family(p, "acut_stored_entries", "gauge", "Entries stored on the disk, by kind.");
	for (int k = 0; k < SPACE_KINDS; k++)
		if (st.space.kind[k].entries || k == SPACE_DOMAINS || k == SPACE_SELECTIONS)
			sample(p, (double)st.space.kind[k].entries, "kind", space_kind_text((enum space_kind)k));
	counter(p, "acut_evicted_bytes_total", "Bytes that were removed from the cache to make room since the start.",
		st.space.evicted_bytes);
	counter(p, "acut_evicted_entries_total", "Domains and selections that were removed to make room since the start.",
		st.space.evicted_files);
}

static void add_jobs(struct metrics_page *p, const struct service_numbers *n)
{
	family(p, "acut_jobs", "gauge", "Unfinished jobs, by state.");
	for (int i = 0; i < JOB_STATES; i++)
		if (!job_state_final((enum job_state)i))
			sample(p, (double)n->states[i], "state", job_state_text((enum job_state)i));
	gauge(p, "acut_jobs_kept", "Jobs in the list, finished ones included.", (double)n->jobs_listed);
	gauge(p, "acut_job_oldest_waiting_seconds", "Waiting time of the oldest job that has not begun; 0: none waits.",
	      n->oldest_waiting);
	gauge(p, "acut_jobs_waiting_for_space", "Jobs that wait for room on the disk.", (double)n->waiting_space);
	family(p, "acut_jobs_ended_total", "counter", "Jobs that ended since the start, by result.");
	sample(p, (double)log_event_count(LOG_EVENT_JOB_DONE), "result", "done");
	sample(p, (double)log_event_count(LOG_EVENT_JOB_FAILED), "result", "failed");
	sample(p, (double)log_event_count(LOG_EVENT_JOB_CANCELLED), "result", "cancelled");
	counter(p, "acut_triangles_made_total", "Triangles of the domains that were triangulated since the start.",
		n->tally.triangles);
	counter(p, "acut_domains_made_total", "Domains that were triangulated since the start.", n->tally.domains_made);
	counter(p, "acut_domains_reused_total", "Finished domains that were reused since the start.", n->tally.domains_reused);
}

static void add_pushes(struct metrics_page *p, const struct service_numbers *n)
{
	gauge(p, "acut_pushes_open", "Open pushes.", (double)n->pushes);
	gauge(p, "acut_pushes_pending", "Interrupted pushes that can be resumed.", (double)n->pending);
	family(p, "acut_pushes_total", "counter", "Pushes that ended since the start, by result.");
	sample(p, (double)log_event_count(LOG_EVENT_PUSH_COMMITTED), "result", "committed");
	sample(p, (double)log_event_count(LOG_EVENT_PUSH_FAILED), "result", "failed");
	sample(p, (double)log_event_count(LOG_EVENT_PUSH_PENDING), "result", "interrupted");
	counter(p, "acut_files_staged_total", "Files that pushes have read completely since the start.", n->tally.files_staged);
	counter(p, "acut_files_refused_total", "Files that were refused since the start.",
		log_event_count(LOG_EVENT_FILE_REFUSED));
	counter(p, "acut_points_staged_total", "Points that pushes have read since the start.", n->tally.points_staged);
	counter(p, "acut_input_bytes_total", "Bytes of files that pushes have read since the start.", n->tally.bytes_read);
	counter(p, "acut_merges_total", "Merges of segments since the start.", n->tally.merges);
	counter(p, "acut_merged_bytes_total", "Bytes that merges have written since the start.", n->tally.merged_bytes);
}

static void add_health(struct metrics_page *p, const struct service_numbers *n)
{
	const struct verified *v = &n->verified;

	family(p, "acut_checksum_errors_total", "counter",
	       "How often damage was found since the start, in pushed data and in derived files.");
	sample(p, (double)log_event_count(LOG_EVENT_DAMAGE), "data", "pushed");
	sample(p, (double)log_event_count(LOG_EVENT_DAMAGE_DERIVED), "data", "derived");
	gauge(p, "acut_catalogue_unsure", "1: the catalogue cannot be written.", n->catalogue_failed);
	gauge(p, "acut_datasets", "Named datasets.", (double)n->datasets);
	gauge(p, "acut_datasets_removed", "Datasets that were removed and can be restored.", (double)n->removed);
	gauge(p, "acut_last_verify_timestamp_seconds", "Time of the last complete verification, in seconds since 1970; 0: never.",
	      (double)v->at_us / 1e6);
	if (v->at_us) {
		gauge(p, "acut_last_verify_files", "Files that the last verification read.", (double)v->files);
		gauge(p, "acut_last_verify_bytes", "Bytes that the last verification read.", (double)v->bytes);
		family(p, "acut_last_verify_damaged", "gauge",
		       "Damaged files that the last verification found, in pushed data and in derived files.");
		sample(p, (double)v->damaged, "data", "pushed");
		sample(p, (double)v->derived, "data", "derived");
		gauge(p, "acut_last_verify_newer",
		      "Files of pushed data that a newer version of acut wrote, as the last verification found.",
		      (double)v->newer);
	}
	family(p, "acut_events_total", "counter", "Events of the log since the start, by name.");
	for (int i = 0; i < LOG_EVENTS; i++) {
		char *to = p->events[i];

		snprintf(to, sizeof p->events[i], "%s", log_event_name((enum log_event)i));
		for (; *to; to++)
			*to = *to >= 'A' && *to <= 'Z' ? (char)(*to - 'A' + 'a') : *to;
		sample(p, (double)log_event_count((enum log_event)i), "event", p->events[i]);
	}
}

static void first_page(struct metrics_page *p, struct server *s)
{
	struct service_numbers n;

	service_numbers(s->service, &n);
	gauge(p, "acut_up", "1: acutd answers.", 1);
	add_process(p, s);
	add_disk(p, s);
	add_jobs(p, &n);
	add_pushes(p, &n);
	add_health(p, &n);
	snprintf(p->next, sizeof p->next, "d");
}

/* ---- datasets, users ---- */

static double dataset_bytes(const struct dataset_info *i)
{
	return (double)i->bytes;
}
static double dataset_points(const struct dataset_info *i)
{
	return (double)i->points;
}
static double dataset_files(const struct dataset_info *i)
{
	return (double)i->files;
}
static double dataset_generation(const struct dataset_info *i)
{
	return (double)i->generation;
}
static double dataset_pushed(const struct dataset_info *i)
{
	return (double)i->pushed_us / 1e6;
}
static double dataset_pending(const struct dataset_info *i)
{
	return i->pending;
}

static void dataset_page(struct metrics_page *p, struct server *s, const struct peer *peer, const char *after)
{
	static const struct {
		const char *name, *help;
		double (*of)(const struct dataset_info *);
	} rows[] = {
		{"acut_dataset_bytes", "Bytes of a dataset on the disk.", dataset_bytes},
		{"acut_dataset_points", "Points of a dataset.", dataset_points},
		{"acut_dataset_files", "Files that were pushed into a dataset.", dataset_files},
		{"acut_dataset_generation", "Number of the newest generation of a dataset.", dataset_generation},
		{"acut_dataset_last_push_timestamp_seconds",
		 "Time of the last push into a dataset, in seconds since 1970; 0: never.", dataset_pushed},
		{"acut_dataset_pushes_pending", "Interrupted pushes into a dataset that can be resumed.", dataset_pending},
	};
	_Static_assert(DATASETS * (sizeof rows / sizeof *rows) <= SAMPLES,
		       "a page of datasets has too many samples: fewer DATASETS");
	struct dataset *list[DATASETS + 1];
	size_t found = dataset_list(s->service->datasets, after, peer, DATASETS + 1, list),
	       n = found < DATASETS ? found : DATASETS;

	for (size_t i = 0; i < n; i++) {
		dataset_info(list[i], &p->dataset[i]);
		snprintf(p->uid[i], TEXT, "%" PRIu32, p->dataset[i].uid);
	}
	for (size_t k = 0; n && k < sizeof rows / sizeof *rows; k++) {
		family(p, rows[k].name, "gauge", rows[k].help);
		for (size_t i = 0; i < n; i++)
			sample2(p, rows[k].of(&p->dataset[i]), "dataset", p->dataset[i].name, "uid", p->uid[i]);
	}
	if (found > n)
		snprintf(p->next, sizeof p->next, "d%s", p->dataset[n - 1].name);
	else
		snprintf(p->next, sizeof p->next, "u0");
}

static double user_bytes(const struct service_user *u)
{
	return (double)u->bytes;
}
static double user_points(const struct service_user *u)
{
	return (double)u->points;
}
static double user_pending(const struct service_user *u)
{
	return (double)u->pending_bytes;
}
static double user_jobs(const struct service_user *u)
{
	return u->jobs;
}

static void user_page(struct metrics_page *p, struct server *s, const struct peer *peer, uint64_t from)
{
	static const struct {
		const char *name, *help;
		double (*of)(const struct service_user *);
	} rows[] = {
		{"acut_user_bytes", "Bytes on the disk of the datasets of a user, removed ones included.", user_bytes},
		{"acut_user_points", "Points of the datasets of a user, removed ones included.", user_points},
		{"acut_user_pending_bytes", "Upper bound of the bytes of a user's interrupted pushes.", user_pending},
		{"acut_user_jobs", "Unfinished jobs of a user.", user_jobs},
	};
	_Static_assert(USERS * (sizeof rows / sizeof *rows) <= SAMPLES, "a page of users has too many samples: fewer USERS");
	size_t n = service_users(s->service, from, p->user, USERS), shown = 0;

	if (n == USERS)
		snprintf(p->next, sizeof p->next, "u%" PRIu64, (uint64_t)p->user[n - 1].uid + 1);
	for (size_t i = 0; i < n; i++)
		if (rights_acts_as(peer, p->user[i].uid))
			p->user[shown++] = p->user[i];
	for (size_t i = 0; i < shown; i++)
		snprintf(p->uid[i], TEXT, "%" PRIu32, p->user[i].uid);
	for (size_t k = 0; shown && k < sizeof rows / sizeof *rows; k++) {
		family(p, rows[k].name, "gauge", rows[k].help);
		for (size_t i = 0; i < shown; i++)
			sample(p, rows[k].of(&p->user[i]), "uid", p->uid[i]);
	}
}

void request_metrics(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const char *cursor = m->metrics_request->cursor;
	struct metrics_page *p = calloc(1, sizeof *p);
	struct err err = ERR_INIT;

	if (!p) {
		err_set(&err, ERR_NOMEM, "no memory for metrics");
		request_refuse(q, &err);
		return;
	}
	acut__v1__metrics__init(&p->metrics);
	p->metrics.families = p->families;
	if (!*cursor)
		first_page(p, c->server);
	else if (*cursor == 'd')
		dataset_page(p, c->server, &c->peer, cursor + 1);
	else if (*cursor == 'u')
		user_page(p, c->server, &c->peer, strtoull(cursor + 1, NULL, 10));
	else
		err_set(&err, ERR_USAGE, "there is no such page of metrics");
	p->metrics.next = p->next;
	if (err.code)
		request_refuse(q, &err);
	else
		request_answer(q, FRAME_MESSAGE(METRICS, metrics, &p->metrics));
	free(p);
}
