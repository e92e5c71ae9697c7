/* Requests about the generations of a dataset. A worker reads the manifest; the answer is a page of it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "breaklines.h"
#include "rights.h"
#include "server_priv.h"

enum { PAGE_MAX = 64 };

enum { PLACES_MAX = 512 };

struct page_request {
	struct request *request;
	uint64_t generation, after;
	unsigned limit;
	/* of the worker, for places */
	struct breaklines_place *place;
	size_t nplaces;
	uint64_t total;
};

static void read_page(struct conn *c, struct request *q, const char *name, const struct page_request *what, dataset_look_fn *look,
		      dataset_read_fn *answer)
{
	struct dataset *d = NULL;
	struct err err = ERR_INIT;
	int r = dataset_access(c->server->service->datasets, name, &c->peer, RIGHT_READ, &d, &err);
	struct page_request *ask = r ? NULL : malloc(sizeof *ask);

	if (!ask) {
		if (!r)
			err_set(&err, ERR_NOMEM, "no memory for a list");
		request_refuse(q, &err);
		return;
	}
	*ask = *what;
	ask->request = q;
	if (!ask->limit || ask->limit > PAGE_MAX)
		ask->limit = look ? PLACES_MAX : PAGE_MAX;
	dataset_look(d, &c->peer, look, answer, ask);
}

/* ---- the log ---- */

static void message_generation(const struct grid_generation *g, Acut__V1__Generation *m, char hex[DIGEST_HEX_SIZE],
			       char user[GRID_USER])
{
	acut__v1__generation__init(m);
	strncpy(user, g->user, GRID_USER - 1);
	user[GRID_USER - 1] = 0;
	m->number = g->number;
	m->time_us = g->time_us;
	m->uid = g->uid;
	m->user = frame_text_clean(user);
	m->kind = (char *)grid_generation_kind_text(g->kind);
	m->undoes = g->undoes;
	m->files = g->files;
	m->files_removed = g->files_removed;
	m->points_added = g->points_added;
	m->points_removed = g->points_removed;
	m->content = digest_hex(g->content, hex);
	m->lines_added = g->lines_added;
	m->lines_removed = g->lines_removed;
}

static void answer_log(const struct page_request *ask, const struct grid_manifest *m)
{
	Acut__V1__Log log = ACUT__V1__LOG__INIT;
	Acut__V1__Generation row[PAGE_MAX], *rows[PAGE_MAX];
	char hex[PAGE_MAX][DIGEST_HEX_SIZE], user[PAGE_MAX][GRID_USER];
	unsigned n = 0;

	log.oldest = m ? grid_manifest_oldest(m) : 0;
	log.newest = m ? m->generation : 0;
	for (size_t i = 0; m && i < m->ngenerations && !log.more; i++) {
		if (m->generations[i].number <= ask->after)
			continue;
		log.more = n == ask->limit;
		if (log.more)
			break;
		message_generation(&m->generations[i], &row[n], hex[n], user[n]);
		rows[n] = &row[n];
		n++;
	}
	log.generations = rows;
	log.n_generations = n;
	request_answer(ask->request, FRAME_MESSAGE(LOG, log, &log));
}

static void on_log(void *token, const struct err *why, const struct dataset *d, const struct grid_manifest *m)
{
	struct page_request *ask = token;

	if (why)
		request_refuse(ask->request, why);
	else
		answer_log(ask, m);
	free(ask);
}

void request_log(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const struct page_request what = {.after = m->log_request->after, .limit = m->log_request->limit};

	read_page(c, q, m->log_request->dataset, &what, NULL, on_log);
}

/* ---- the files of a generation ---- */

/* 1: the generation added the source, -1: it removed it, 0: neither. */
static int source_change(const struct grid_source *s, uint64_t g)
{
	for (size_t i = 0; i < s->nearlier; i++)
		if (s->earlier[i].added == g || s->earlier[i].removed == g)
			return s->earlier[i].added == g ? 1 : -1;
	if (s->added == s->removed || (s->added != g && s->removed != g))
		return 0;
	return s->added == g ? 1 : -1;
}

/* The source with the lowest number after `after` that the generation changed. */
static const struct grid_source *next_changed(const struct grid_manifest *m, uint64_t g, uint64_t after)
{
	const struct grid_source *best = NULL;

	for (size_t i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		if (s->id > after && s->kind != GRID_LINE_VERTICES && (!best || s->id < best->id) && source_change(s, g))
			best = s;
	}
	return best;
}

struct message_file {
	Acut__V1__DatasetFile file;
	Acut__V1__Lines lines;
	char name[GRID_SOURCE_NAME], hash[DIGEST_HEX_SIZE], overridden[GRID_SOURCE_OVERRIDDEN];
};

static void message_file(const struct grid_source *s, uint64_t g, bool owner, struct message_file *m)
{
	acut__v1__dataset_file__init(&m->file);
	strncpy(m->name, s->name, sizeof m->name - 1);
	m->name[sizeof m->name - 1] = 0;
	m->file.source = s->id;
	m->file.name = frame_text_clean(m->name);
	m->file.path.data = owner ? (uint8_t *)s->path : NULL;
	m->file.path.len = owner ? strlen(s->path) : 0;
	m->file.points = s->points;
	m->file.size = s->size;
	if (!digest_is_zero(s->hash))
		m->file.hash = digest_hex(s->hash, m->hash);
	m->file.removed = source_change(s, g) < 0;
	snprintf(m->overridden, sizeof m->overridden, "%s", s->overridden);
	m->file.overridden = frame_text_clean(m->overridden);
	if (s->lines)
		m->file.lines = request_lines(s->lines, &m->lines);
}

static void answer_files(const struct page_request *ask, bool owner, const struct grid_manifest *m)
{
	struct message_file *page = calloc(PAGE_MAX, sizeof *page);
	Acut__V1__DatasetFile *rows[PAGE_MAX];
	Acut__V1__Files files = ACUT__V1__FILES__INIT;
	const struct grid_source *s;
	uint64_t after = ask->after;
	struct err err = ERR_INIT;
	unsigned n = 0;

	if (!page) {
		err_set(&err, ERR_NOMEM, "no memory for a list");
		request_refuse(ask->request, &err);
		return;
	}
	files.files = rows;
	while (m && (s = next_changed(m, ask->generation, after))) {
		files.more = n == ask->limit;
		if (files.more)
			break;
		message_file(s, ask->generation, owner, &page[n]);
		rows[n] = &page[n].file;
		files.n_files = n + 1;
		if (frame_message_size(FRAME_MESSAGE(FILES, files, &files)) > FRAME_MAX) {
			files.n_files = n;
			files.more = true;
			break;
		}
		after = s->id;
		n++;
	}
	request_answer(ask->request, FRAME_MESSAGE(FILES, files, &files));
	free(page);
}

static void on_files(void *token, const struct err *why, const struct dataset *d, const struct grid_manifest *m)
{
	struct page_request *ask = token;
	struct dataset_info info;
	bool owner;

	dataset_info(d, &info);
	owner = rights_allow(&ask->request->conn->peer, RIGHT_OWN, info.uid, info.gid, info.mode);
	if (why)
		request_refuse(ask->request, why);
	else
		answer_files(ask, owner, m);
	free(ask);
}

void request_files(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const Acut__V1__FilesRequest *in = m->files_request;
	const struct page_request what = {.generation = in->generation, .after = in->after, .limit = in->limit};

	read_page(c, q, in->dataset, &what, NULL, on_files);
}

/* ---- places of lines ---- */

static int look_for_places(void *token, int dirfd, const struct grid_manifest *m, struct err *err)
{
	struct page_request *ask = token;
	uint64_t g = ask->generation ? ask->generation : m->generation;
	const struct grid_source *s;

	if (g > m->generation || g < grid_manifest_oldest(m)) {
		err_set(err, ERR_NOTFOUND, "there is no generation %llu", (unsigned long long)g);
		return err_add_hint(err, "those from %llu to %llu can be read", (unsigned long long)grid_manifest_oldest(m),
				    (unsigned long long)m->generation);
	}
	s = grid_manifest_line_vertices(m, g);
	if (grid_manifest_lacks_line_set(m, g)) {
		err_set(err, ERR_NOTFOUND, "the places where lines of generation %llu cross are not kept", (unsigned long long)g);
		return err_add_hint(err, "they are there again after a mesh of that generation (--at)");
	}
	ask->total = s ? s->lines->places : 0;
	ask->place = calloc(ask->limit, sizeof *ask->place);
	if (!ask->place)
		return err_set(err, ERR_NOMEM, "no memory for a list");
	return s ? breaklines_places(dirfd, s, ask->after, ask->limit, ask->place, &ask->nplaces, err) : 0;
}

static void answer_places(const struct page_request *ask, const struct grid_manifest *m)
{
	static const char *const kinds[BREAKLINE_EVENTS] = {"crossing", "uneven"};
	Acut__V1__Place *all = calloc(ask->nplaces + 1, sizeof *all), **rows = calloc(ask->nplaces + 1, sizeof *rows);
	Acut__V1__Places places = ACUT__V1__PLACES__INIT;
	struct err err = ERR_INIT;

	if (!all || !rows) {
		err_set(&err, ERR_NOMEM, "no memory for a list");
		request_refuse(ask->request, &err);
	}
	for (size_t i = 0; all && rows && i < ask->nplaces; i++) {
		const struct breaklines_place *p = &ask->place[i];

		acut__v1__place__init(&all[i]);
		all[i].kind = (char *)kinds[p->event];
		all[i].x = lattice_coordinate(&m->lattice, 0, p->x);
		all[i].y = lattice_coordinate(&m->lattice, 1, p->y);
		all[i].lower = lattice_coordinate(&m->lattice, 2, p->lower);
		all[i].upper = lattice_coordinate(&m->lattice, 2, p->upper);
		rows[i] = &all[i];
	}
	places.places = rows;
	places.n_places = ask->nplaces;
	places.total = ask->total;
	if (all && rows)
		request_answer(ask->request, FRAME_MESSAGE(PLACES, places, &places));
	free(all);
	free(rows);
}

static void on_places(void *token, const struct err *why, const struct dataset *d, const struct grid_manifest *m)
{
	struct page_request *ask = token;

	if (why)
		request_refuse(ask->request, why);
	else
		answer_places(ask, m);
	free(ask->place);
	free(ask);
}

void request_places(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const Acut__V1__PlacesRequest *in = m->places_request;
	const struct page_request what = {.generation = in->generation, .after = in->after, .limit = in->limit};

	read_page(c, q, in->dataset, &what, look_for_places, on_places);
}

/* ---- a dataset in an earlier generation, or with its coordinate system ---- */

static void on_state(void *token, const struct err *why, const struct dataset *d, const struct grid_manifest *m)
{
	struct page_request *ask = token;
	struct err err = ERR_INIT;

	if (!why && ask->generation && dataset_check_generation(d, ask->generation, &err))
		why = &err;
	if (!ask->generation)
		request_dataset_system(ask->request, d, m);
	else if (why)
		request_refuse(ask->request, why);
	else
		request_dataset_state(ask->request, d, m, ask->generation);
	free(ask);
}

void request_dataset_at(struct conn *c, struct request *q, const char *name, uint64_t generation)
{
	const struct page_request what = {.generation = generation};

	read_page(c, q, name, &what, NULL, on_state);
}

/* ---- reverts ---- */

static void on_reverted(void *token, const struct err *why, const struct reverted *r)
{
	Acut__V1__Reverted m = ACUT__V1__REVERTED__INIT;

	if (why) {
		request_refuse(token, why);
		return;
	}
	m.generation = r->generation;
	m.undone = r->undone;
	m.points = r->points;
	m.files = r->made->files;
	m.files_removed = r->made->files_removed;
	m.points_added = r->made->points_added;
	m.points_removed = r->made->points_removed;
	m.lines_added = r->made->lines_added;
	m.lines_removed = r->made->lines_removed;
	request_answer(token, FRAME_MESSAGE(REVERTED, reverted, &m));
}

void request_revert(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct err err = ERR_INIT;
	struct dataset *d;

	if (dataset_access(c->server->service->datasets, m->revert->dataset, &c->peer, RIGHT_WRITE, &d, &err))
		request_refuse(q, &err);
	else
		dataset_revert(d, m->revert->generation, &c->peer, on_reverted, q);
}

/* ---- prune ---- */

static void on_pruned(void *token, const struct err *why, const struct pruned *p)
{
	Acut__V1__Pruned m = ACUT__V1__PRUNED__INIT;

	if (why) {
		request_refuse(token, why);
		return;
	}
	m.oldest = p->oldest;
	m.generations = p->generations;
	m.files = p->files;
	m.points = p->points;
	m.bytes = p->bytes;
	m.segments = p->segments;
	request_answer(token, FRAME_MESSAGE(PRUNED, pruned, &m));
}

void request_prune(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct err err = ERR_INIT;
	struct prune *prune;
	struct dataset *d;

	if (dataset_access(c->server->service->datasets, m->prune->dataset, &c->peer, RIGHT_OWN, &d, &err)) {
		request_refuse(q, &err);
		return;
	}
	prune = dataset_prune(d, m->prune->keep, m->prune->before, &c->peer, on_pruned, q);
	if (prune)
		q->prune = prune;
}

/* ---- pending pushes ---- */

enum { OPEN_MOST = 64 };

struct discard_request {
	struct request *request;
	uint64_t open[OPEN_MOST];
	size_t nopen;
};

static void on_discarded(void *token, const struct err *why, const struct discarded *d)
{
	struct discard_request *ask = token;
	Acut__V1__Discarded m = ACUT__V1__DISCARDED__INIT;

	if (why) {
		request_refuse(ask->request, why);
	} else {
		m.pushes = d->pushes;
		m.files = d->files;
		m.bytes = d->bytes;
		m.open = ask->open;
		m.n_open = ask->nopen;
		request_answer(ask->request, FRAME_MESSAGE(DISCARDED, discarded, &m));
	}
	free(ask);
}

void request_discard(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const struct service *service = c->server->service;
	const Acut__V1__Discard *in = m->discard;
	const struct dataset *d = dataset_find(service->datasets, in->dataset, &c->peer);
	struct discard_request *ask;
	struct err err = ERR_INIT;

	ask = malloc(sizeof *ask);
	if (!ask) {
		err_set(&err, ERR_NOMEM, "no memory for a request");
		request_refuse(q, &err);
		return;
	}
	ask->request = q;
	ask->nopen = d ? pushes_into(service->pushes, d, c->peer.uid, in->all, ask->open, OPEN_MOST) : 0;
	ask->nopen = ask->nopen < OPEN_MOST ? ask->nopen : OPEN_MOST;
	dataset_discard(service->datasets, in->dataset, &c->peer, in->all, on_discarded, ask);
}
