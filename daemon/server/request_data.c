/* Requests about datasets, and plans. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "lattice.h"
#include "mode.h"
#include "rights.h"
#include "server_priv.h"

enum { PAGE_MAX = 64 };

struct message_dataset {
	Acut__V1__Dataset dataset;
	double min[2], max[2];
	char pending[256], geoid[GRID_GEOID];
	struct grid_lines sum;
	Acut__V1__Lines lines;
};

/* A sentence about open and interrupted pushes. */
static void message_pending(const struct dataset_info *info, struct message_dataset *m)
{
	time_t until = (time_t)(info->pending_until_us / 1000000);
	struct tm tm;
	char day[32] = "";

	if (info->pending && gmtime_r(&until, &tm))
		strftime(day, sizeof day, "%Y-%m-%dT%H:%M:%SZ", &tm);
	if (info->pending)
		snprintf(
			m->pending, sizeof m->pending,
			"%s%u interrupted push%s, the newest of user %u: %llu files, %llu points, %skept until %s if not discarded (acutctl dataset discard)",
			info->pushes ? "a push is open; " : "", info->pending, info->pending == 1 ? "" : "es", info->pending_uid,
			(unsigned long long)info->pending_files, (unsigned long long)info->pending_points,
			info->pending == 1 ? "" : "the oldest ", day);
	else if (info->pushes)
		snprintf(m->pending, sizeof m->pending, "a push is open");
	m->dataset.pending = m->pending;
}

static void message_dataset(const struct dataset *d, struct message_dataset *m)
{
	struct dataset_info info;
	struct lattice lattice;
	int k;

	m->pending[0] = 0;
	dataset_info(d, &info);
	acut__v1__dataset__init(&m->dataset);
	m->dataset.name = (char *)info.name;
	m->dataset.generation = info.generation;
	m->dataset.points = info.points;
	m->dataset.bytes = info.bytes;
	m->dataset.files = info.files;
	m->dataset.lattice = (char *)info.lattice;
	m->dataset.crs = (char *)info.crs;
	m->dataset.unit_xy = (char *)info.unit_xy;
	m->dataset.unit_z = (char *)info.unit_z;
	m->dataset.uid = info.uid;
	m->dataset.gid = info.gid;
	m->dataset.mode = info.mode;
	m->dataset.created_us = info.created_us;
	m->dataset.pushed_us = info.pushed_us;
	m->dataset.segments = info.segments;
	m->dataset.merging = info.merging;
	m->dataset.removed_us = info.removed_us;
	m->dataset.until_us = info.until_us;
	m->dataset.pinned = info.pinned;
	m->dataset.id = info.id;
	m->dataset.oldest = info.oldest;
	message_pending(&info, m);
	if (!info.points || !lattice_parse(info.lattice, &lattice))
		return;
	for (k = 0; k < 2; k++) {
		m->min[k] = decimal_scaled_double(lattice.scale_xy, info.box[k] + lattice.k[k]);
		m->max[k] = decimal_scaled_double(lattice.scale_xy, info.box[2 + k] + lattice.k[k]);
	}
	m->dataset.n_min = m->dataset.n_max = 2;
	m->dataset.min = m->min;
	m->dataset.max = m->max;
}

/* `then` NULL: there is none. */
static void add_system(struct message_dataset *m, const struct grid_manifest *then, uint64_t generation)
{
	if (!then)
		return;
	memcpy(m->geoid, then->geoid, sizeof m->geoid);
	m->dataset.geoid = frame_text_clean(m->geoid);
	m->dataset.wkt = (char *)grid_manifest_wkt(then, generation);
}

static void add_lines(struct message_dataset *m, const struct grid_manifest *then, uint64_t generation)
{
	m->sum = (struct grid_lines){.lines = 0};
	for (size_t i = 0; then && i < then->nsources; i++) {
		const struct grid_source *s = &then->sources[i];

		if (s->kind != GRID_LINES || !grid_source_live(s, generation))
			continue;
		m->dataset.line_files++;
		for (unsigned k = 0; k < GRID_LINE_KINDS; k++)
			m->sum.features[k] += s->lines->features[k];
		m->sum.lines += s->lines->lines;
		m->sum.vertices += s->lines->vertices;
	}
	if (m->dataset.line_files)
		m->dataset.lines = request_lines(&m->sum, &m->lines);
}

/* A list of one. */
static void answer_dataset(struct request *q, struct message_dataset *m)
{
	Acut__V1__Datasets list = ACUT__V1__DATASETS__INIT;
	Acut__V1__Dataset *one = &m->dataset;

	list.n_datasets = 1;
	list.datasets = &one;
	request_answer(q, FRAME_MESSAGE(DATASETS, datasets, &list));
}

void request_dataset_system(struct request *q, const struct dataset *d, const struct grid_manifest *now)
{
	struct message_dataset m;

	message_dataset(d, &m);
	add_system(&m, now, m.dataset.generation);
	add_lines(&m, now, m.dataset.generation);
	answer_dataset(q, &m);
}

void request_dataset_state(struct request *q, const struct dataset *d, const struct grid_manifest *then, uint64_t generation)
{
	struct message_dataset m;

	message_dataset(d, &m);
	m.dataset.generation = generation;
	m.dataset.points = m.dataset.files = 0;
	for (size_t i = 0; then && i < then->nsources; i++)
		if (then->sources[i].kind != GRID_LINE_VERTICES && grid_source_live(&then->sources[i], generation)) {
			m.dataset.points += then->sources[i].points;
			m.dataset.files++;
		}
	for (size_t i = 0; then && i < then->ngenerations; i++)
		if (then->generations[i].number <= generation && then->generations[i].time_us)
			m.dataset.pushed_us = then->generations[i].time_us;
	add_system(&m, then, generation);
	add_lines(&m, then, generation);
	answer_dataset(q, &m);
}

static void answer_named(struct conn *c, struct request *q, const char *name)
{
	struct message_dataset m;
	struct err err = ERR_INIT;
	struct dataset *d;

	if (dataset_access(c->server->service->datasets, name, &c->peer, RIGHT_READ, &d, &err)) {
		request_refuse(q, &err);
		return;
	}
	message_dataset(d, &m);
	answer_dataset(q, &m);
}

/* A page of the datasets that were removed, by number. */
static void answer_removed(struct conn *c, struct request *q, uint64_t after, unsigned limit)
{
	struct message_dataset row;
	struct frame_page page;
	struct dataset *d;
	bool more = false;

	page.n = 0;
	for (unsigned n = 0; !more && (d = dataset_removed_after(c->server->service->datasets, after, &c->peer)); n++) {
		if (n < limit)
			message_dataset(d, &row);
		more = n == limit || !frame_page_add(&page, &row.dataset.base);
		after = row.dataset.id;
	}
	request_answer_page(q, ACUT__V1__MESSAGE__BODY_DATASETS, &page, more);
}

void request_datasets(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const char *after = m->datasets_request->after;
	unsigned limit = m->datasets_request->limit, found;
	struct dataset *datasets[PAGE_MAX + 1];
	struct message_dataset row;
	struct frame_page page;
	bool more = false;

	if (*m->datasets_request->name && (m->datasets_request->generation || m->datasets_request->system)) {
		request_dataset_at(c, q, m->datasets_request->name, m->datasets_request->generation);
		return;
	}
	if (*m->datasets_request->name) {
		answer_named(c, q, m->datasets_request->name);
		return;
	}
	if (!limit || limit > PAGE_MAX)
		limit = PAGE_MAX;
	if (m->datasets_request->removed) {
		answer_removed(c, q, m->datasets_request->after_id, limit);
		return;
	}
	page.n = 0;
	found = dataset_list(c->server->service->datasets, after, &c->peer, limit + 1, datasets);
	for (unsigned n = 0; n < found && !more; n++) {
		if (n < limit)
			message_dataset(datasets[n], &row);
		more = n == limit || !frame_page_add(&page, &row.dataset.base);
	}
	request_answer_page(q, ACUT__V1__MESSAGE__BODY_DATASETS, &page, more);
}

static void on_changed(void *token, const struct err *why, struct dataset *d)
{
	struct message_dataset m;

	if (why) {
		request_refuse(token, why);
		return;
	}
	message_dataset(d, &m);
	answer_dataset(token, &m);
}

void request_dataset_change(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	static const char *const verbs[] = {
		[DATASET_REMOVE] = "remove", [DATASET_RESTORE] = "restore", [DATASET_PIN] = "pin",    [DATASET_UNPIN] = "unpin",
		[DATASET_CHMOD] = "chmod",   [DATASET_CHGRP] = "chgrp",     [DATASET_CHOWN] = "chown"};
	const Acut__V1__DatasetChange *in = m->dataset_change;
	struct dataset_action_params w = {.name = in->name, .as = in->as, .id = in->id, .peer = c->peer};
	struct err err = ERR_INIT;
	unsigned i = 0;

	while (i < sizeof verbs / sizeof *verbs && strcmp(in->verb, verbs[i]))
		i++;
	if (i == sizeof verbs / sizeof *verbs) {
		err_set(&err, ERR_UNSUPPORTED, "this acutd cannot \"%.40s\" a dataset", in->verb);
		request_refuse(q, &err);
		return;
	}
	w.action = (enum dataset_action)i;
	w.mode = w.action == DATASET_CHMOD ? in->mode : NULL;
	w.gid = in->gid;
	w.uid = in->uid;
	if ((w.action == DATASET_CHGRP ? w.gid : w.uid) == RIGHTS_NOBODY) {
		err_set(&err, ERR_USAGE, "nobody has the number %u", RIGHTS_NOBODY);
		request_refuse(q, &err);
		return;
	}
	dataset_act(c->server->service->datasets, &w, on_changed, q);
}

static void on_created(void *token, const struct err *why)
{
	request_finish(token, why);
}

int request_mode(const char *text, bool *ret_has, uint32_t *ret, struct err *err)
{
	*ret_has = *text != 0;
	return *text ? mode_parse(text, DATASET_MODE, 0, ret, err) : 0;
}

void request_dataset_create(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const Acut__V1__DatasetCreate *in = m->dataset_create;
	struct dataset_create_params wish = {
		.name = in->name,
		.scale_xy = in->scale_xy,
		.scale_z = in->scale_z,
		.crs = in->crs,
		.peer = c->peer,
	};
	struct err err = ERR_INIT;

	if (request_mode(in->mode, &wish.has_mode, &wish.mode, &err))
		request_refuse(q, &err);
	else
		dataset_create(c->server->service->datasets, &wish, on_created, q);
}

void request_planned(void *token, const struct err *why, const struct job_plan *p)
{
	Acut__V1__Plan m = ACUT__V1__PLAN__INIT;

	if (why) {
		request_refuse(token, why);
		return;
	}
	m.points = p->points;
	m.exact = p->exact;
	m.domains = p->domains;
	m.memory_bytes = p->memory_bytes;
	m.disk_bytes = p->disk_bytes;
	m.domains_reused = p->domains_reused;
	m.load = p->load;
	m.threads = p->threads;
	m.seconds = p->seconds;
	request_answer(token, FRAME_MESSAGE(PLAN, plan, &m));
}

void request_plan(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct job_params named = {.generation = m->plan_request->generation, .view = m->plan_request->view, .peer = c->peer};
	struct err err = ERR_INIT;
	struct dataset *d;

	if (dataset_access(c->server->service->datasets, m->plan_request->dataset, &c->peer, RIGHT_READ, &d, &err)) {
		request_refuse(q, &err);
		return;
	}
	named.dataset = d;
	if (job_names_files(named.view))
		request_named_view(q, &named, true);
	else
		job_plan(c->server->service->jobs, d, named.generation, named.view, &c->peer, request_planned, q);
}
