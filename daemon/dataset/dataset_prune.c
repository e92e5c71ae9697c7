/*
 * Prune: removes the oldest generations, and the points that no remaining generation has.
 *
 * The model: a source is dead if all of its lives end by the oldest generation that stays. Segments with records of dead sources
 * are rewritten without them, or removed if they have no others. The next manifest omits these sources and names the oldest
 * generation that can be read; it keeps the notes of all generations. The remaining generations keep their records and their
 * content sums. A prune is refused while an unfinished job needs a generation that would go.
 *
 * Line sets of earlier generations go by themselves, after a generation with other lines: they can be made again of the files of
 * lines (dataset_asked.c), and each one is as large as all lines. That is a prune, too, of these sources only, and of no
 * generation.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dataset_rewrite.h"
#include "grid_rewrite.h"
#include "log.h"

struct prune {
	struct dataset_rewrite rewrite;
	struct prune *next;
	uint64_t keep, before; /* as requested */
	uint64_t oldest;       /* the oldest generation that stays */
	uint64_t bytes;        /* of the dataset's segments before the prune */
	uint64_t gone;         /* of files of lines that go */
	uint32_t *dead;
	size_t ndead;
	struct pruned result;
	bool sets; /* only of line sets that the newest generation does not have */
	bool running;
	prune_answer_fn *answer;
	void *token;
};

/* ---- dead sources ---- */

static bool ends_by(uint64_t added, uint64_t removed, uint64_t oldest)
{
	return removed && (removed <= oldest || removed <= added);
}

/* The source is in no generation from `oldest` on. Its last life is the latest. */
static bool is_dead(const struct prune *p, const struct grid_source *s)
{
	if (p->sets)
		return s->kind == GRID_LINE_VERTICES && s->removed;
	return ends_by(s->added, s->removed, p->oldest) &&
	       (!s->nearlier || ends_by(s->earlier[s->nearlier - 1].added, s->earlier[s->nearlier - 1].removed, p->oldest));
}

static int by_number(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

static int find_dead(struct prune *p, const struct grid_manifest *m, struct err *err)
{
	free(p->dead);
	p->ndead = 0;
	p->dead = calloc(m->nsources + 1, sizeof *p->dead);
	if (!p->dead)
		return err_set(err, ERR_NOMEM, "no memory for a list of sources");
	for (size_t i = 0; i < m->nsources; i++)
		if (is_dead(p, &m->sources[i]))
			p->dead[p->ndead++] = m->sources[i].id;
	if (p->ndead)
		qsort(p->dead, p->ndead, sizeof *p->dead, by_number);
	return 0;
}

/* Notes the files of dead lines and line sets. */
static int find_gone(struct prune *p, const struct grid_manifest *m, struct err *err)
{
	struct dataset_rewrite *w = &p->rewrite;

	free(w->gone);
	w->ngone = 0;
	p->gone = 0;
	w->gone = calloc(GRID_SOURCE_FILES * p->ndead + 1, sizeof *w->gone);
	if (!w->gone)
		return err_set(err, ERR_NOMEM, "no memory for a list of files");
	for (size_t i = 0; i < m->nsources; i++) {
		struct grid_named of[GRID_SOURCE_FILES];
		size_t n = is_dead(p, &m->sources[i]) ? grid_source_files(&m->sources[i], of) : 0;

		for (size_t k = 0; k < n; k++) {
			memcpy(w->gone[w->ngone++], of[k].name, sizeof *w->gone);
			p->gone += of[k].bytes;
		}
	}
	return 0;
}

static int prune_choose(struct dataset_rewrite *w, const struct grid_manifest *m, struct err *err)
{
	struct prune *p = (struct prune *)w;
	int r = find_dead(p, m, err);

	if (!r)
		r = find_gone(p, m, err);
	p->bytes = 0;
	p->result.points = 0;
	for (size_t i = 0; !r && i < m->nsegments; i++) {
		const struct grid_segment_info *s = &m->segments[i];
		uint64_t points = 0;

		p->bytes += s->bytes;
		if (p->ndead)
			r = grid_segment_count_sources(w->dataset->dirfd, s, p->dead, p->ndead, &points, err);
		if (!r && points)
			r = rewrite_add(w, &s, 1, points == s->points, err);
		p->result.points += points;
	}
	w->drop = p->dead;
	w->ndrop = p->ndead;
	w->always = !p->sets || p->ndead;
	if (!r && rewrite_bytes(w) > w->memory_max) {
		err_set(err, ERR_LIMIT, "pruning %s takes %llu KiB of memory, it may have %llu KiB", w->dataset->name,
			(unsigned long long)(rewrite_bytes(w) >> 10), (unsigned long long)(w->memory_max >> 10));
		return err_add_hint(err, "run with memory=%lluM or more", (unsigned long long)(rewrite_bytes(w) >> 17) + 1);
	}
	return r;
}

/* ---- the manifest ---- */

static bool is_dropped(const struct prune *p, uint32_t id)
{
	return p->ndead && bsearch(&id, p->dead, p->ndead, sizeof id, by_number);
}

/* Drops lives that ended before the oldest generation. */
static void forget_lives(struct grid_source *s, uint64_t oldest)
{
	while (s->nearlier && ends_by(s->earlier->added, s->earlier->removed, oldest)) {
		s->earlier++;
		s->nearlier--;
	}
}

static int prune_alter(struct dataset_rewrite *w, const struct grid_manifest *base, struct grid_manifest *m, struct err *err)
{
	struct prune *p = (struct prune *)w;
	uint32_t last = 0;
	size_t n = 0;

	for (size_t i = 0; i < m->nsources; i++)
		last = m->sources[i].id > last ? m->sources[i].id : last;
	p->result.files = 0;
	for (size_t i = 0; i < m->nsources; i++)
		if (is_dropped(p, m->sources[i].id) && !is_dead(p, &m->sources[i]))
			return err_set(err, ERR_INTERNAL, "source %u of %s came back while it was pruned", m->sources[i].id,
				       w->dataset->name);
	for (size_t i = 0; i < m->nsources; i++) {
		struct grid_source *s = &m->sources[i];

		p->result.files += is_dropped(p, s->id) && s->kind != GRID_LINE_VERTICES;
		/* No source number is given twice, so the source with the last number stays, without points. */
		if (is_dropped(p, s->id) && s->id != last)
			continue;
		if (is_dropped(p, s->id)) {
			s->points = 0;
			s->file = 0;
			s->kind = GRID_POINTS;
			s->lines = NULL;
		}
		if (!p->sets)
			forget_lives(s, p->oldest);
		m->sources[n++] = *s;
	}
	m->nsources = n;
	if (p->sets)
		return 0;
	p->result.generations = p->oldest - grid_manifest_oldest(base);
	m->oldest = p->oldest;
	return 0;
}

/* ---- jobs ---- */

static int check_needed(const struct prune *p, struct err *err)
{
	const struct dataset *d = p->rewrite.dataset;
	const struct datasets *ds = d->datasets;

	return ds->calls && !p->sets ? ds->calls->needed(ds->ctx, d, p->oldest, err) : 0;
}

static int prune_check(struct dataset_rewrite *w, struct err *err)
{
	return check_needed((struct prune *)w, err);
}

/* ---- requests ---- */

static struct prune *prune_free(struct prune *p)
{
	dataset_rewrite_clear(&p->rewrite);
	uncharge(p->rewrite.dataset->datasets->core, sizeof *p);
	free(p->dead);
	free(p);
	return NULL;
}

static void prune_answer(struct prune *p, const struct err *why)
{
	struct dataset *d = p->rewrite.dataset;
	struct prune **at;

	for (at = &d->datasets->prunes; *at != p; at = &(*at)->next)
		;
	*at = p->next;
	if (p->sets) {
		d->drops_sets = false;
		if (why && why->code != ERR_CANCELLED)
			log_debug("%s: old line sets stay until the lines change again: %s", d->name, why->message);
		else
			log_debug("%s: old line sets of %llu bytes are gone", d->name, (unsigned long long)p->result.bytes);
		dataset_release(d);
		prune_free(p);
		return;
	}
	if (!why) {
		p->result.dataset = d;
		p->result.oldest = d->oldest;
		log_event(LOG_EVENT_DATASET_PRUNED, ABOUT_DATASET(d),
			  "%s: %llu generations before %llu were pruned, with %llu points of %llu files, %llu bytes", d->name,
			  (unsigned long long)p->result.generations, (unsigned long long)d->oldest,
			  (unsigned long long)p->result.points, (unsigned long long)p->result.files,
			  (unsigned long long)p->result.bytes);
	}
	p->answer(p->token, why, why ? NULL : &p->result);
	dataset_release(d);
	prune_free(p);
}

static void prune_done(struct dataset_rewrite *w, const struct err *why)
{
	struct prune *p = (struct prune *)w;
	uint64_t old = p->gone;

	if (!p->sets)
		w->dataset->prune_to = 0;
	for (size_t i = 0; i < w->nold; i++)
		old += w->old[i].bytes;
	p->result.bytes = old > w->written ? old - w->written : 0;
	p->result.segments = w->nold;
	prune_answer(p, why);
}

static int prune_decide(struct prune *p, struct err *err)
{
	const struct dataset *d = p->rewrite.dataset;
	uint64_t oldest = p->before;

	if (!d->generation)
		return err_set(err, ERR_NOTFOUND, "the dataset %s has no generation yet", d->name);
	if (d->pinned) {
		err_set(err, ERR_CONFLICT, "the dataset %s is pinned: nothing of it is pruned", d->name);
		return err_add_hint(err, "acutctl dataset unpin %s", d->name);
	}
	if (!p->keep == !p->before)
		return err_set(err, ERR_USAGE,
			       "give either the number of generations to keep, or the generation to prune before");
	if (p->keep)
		oldest = p->keep < d->generation ? d->generation - p->keep + 1 : 1;
	if (oldest > d->generation) {
		err_set(err, ERR_NOTFOUND, "%s has no generation %llu, the newest is %llu", d->name, (unsigned long long)oldest,
			(unsigned long long)d->generation);
		return err_add_hint(err, "the newest generation always stays");
	}
	p->oldest = oldest > d->oldest ? oldest : d->oldest;
	return check_needed(p, err);
}

/* The first in the queue, and no merge runs. */
static void prune_begin(struct prune *p)
{
	struct dataset_rewrite *w = &p->rewrite;
	struct err err = ERR_INIT;

	if (p->sets) {
		w->dataset->drops_sets = p->running = true;
		dataset_rewrite_start(w);
		return;
	}
	if (prune_decide(p, &err)) {
		prune_answer(p, &err);
		return;
	}
	if (p->oldest == w->dataset->oldest) {
		prune_answer(p, NULL);
		return;
	}
	p->running = true;
	w->dataset->prune_to = p->oldest;
	dataset_rewrite_start(w);
}

/* Old line sets that cannot go yet let others pass. */
static void let_others_pass(struct datasets *ds)
{
	struct prune *p = ds->prunes, **at;
	const struct dataset *d = p->rewrite.dataset;

	if (!p->sets || p->running || !p->next || !(ds->merge || d->reverts || d->asks))
		return;
	ds->prunes = p->next;
	p->next = NULL;
	for (at = &ds->prunes; *at; at = &(*at)->next)
		;
	*at = p;
}

void dataset_prune_settle(struct datasets *ds)
{
	struct prune *p;

	if (!ds->prunes)
		return;
	let_others_pass(ds);
	p = ds->prunes;
	if (p->running)
		dataset_rewrite_settle(&p->rewrite);
	else if (ds->merge && !p->sets)
		dataset_rewrite_cancel(ds->merge);
	/* A revert may revive sources, so dead ones are chosen when it is over. Runs open the line sets that they asked for. */
	else if (!ds->merge && !p->rewrite.dataset->reverts && !(p->sets && p->rewrite.dataset->asks))
		prune_begin(p);
}

void dataset_prune_tick(struct datasets *ds)
{
	if (ds->prunes && ds->prunes->running)
		dataset_rewrite_tick(&ds->prunes->rewrite);
}

static struct prune *prune_new(struct dataset *d, const struct peer *peer, struct err *err)
{
	struct datasets *ds = d->datasets;
	struct prune *p, **at;

	if (charge(ds->core, sizeof *p, "a prune", err))
		return NULL;
	p = calloc(1, sizeof *p);
	if (!p) {
		uncharge(ds->core, sizeof *p);
		err_set(err, ERR_NOMEM, "no memory for a request");
		return NULL;
	}
	p->rewrite.dataset = dataset_hold(d);
	p->rewrite.peer = rights_without_groups(peer);
	p->rewrite.what = "a prune";
	p->rewrite.choose = prune_choose;
	p->rewrite.alter = prune_alter;
	p->rewrite.check = prune_check;
	p->rewrite.done = prune_done;
	p->rewrite.priority = SCHED_NORMAL;
	p->rewrite.patient = p->rewrite.always = true;
	for (at = &ds->prunes; *at; at = &(*at)->next)
		;
	*at = p;
	return p;
}

struct prune *dataset_prune(struct dataset *d, uint64_t keep, uint64_t before, const struct peer *peer, prune_answer_fn *fn,
			    void *token)
{
	struct err err = ERR_INIT;
	struct prune *p = NULL;

	THREAD_LOOP_ONLY();
	if (d->datasets->core->stopping)
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	else if (!dataset_rights(d, peer, RIGHT_OWN, &err))
		p = prune_new(d, peer, &err);
	if (!p) {
		fn(token, &err, NULL);
		return NULL;
	}
	p->keep = keep;
	p->before = before;
	p->answer = fn;
	p->token = token;
	return p;
}

void dataset_sets_settle(struct datasets *ds)
{
	struct err err = ERR_INIT;
	struct dataset *d;

	if (!ds->sets_due || ds->core->stopping)
		return;
	ds->sets_due = false;
	for (d = ds->first; d && !d->onestep; d = d->next) {
		const struct peer owner = rights_of_user(d->uid, 0);
		struct prune *p = d->sets_due && !d->removed_us ? prune_new(d, &owner, &err) : NULL;

		/* Without memory they stay until the lines change again. */
		d->sets_due = false;
		if (p)
			p->sets = true;
	}
}

void dataset_prune_cancel(struct prune *p)
{
	struct err err = ERR_INIT;

	if (p->running) {
		dataset_rewrite_cancel(&p->rewrite);
		return;
	}
	err_set(&err, ERR_CANCELLED, "it was cancelled");
	prune_answer(p, &err);
}

void dataset_prunes_park(struct datasets *ds)
{
	while (ds->prunes && !ds->prunes->running)
		dataset_prune_cancel(ds->prunes);
	for (struct prune *p = ds->prunes, *next; p; p = next) {
		next = p->next;
		dataset_prune_cancel(p);
	}
}
