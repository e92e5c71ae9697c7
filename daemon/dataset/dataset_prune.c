/*
 * Prune: generations before one go, and with them the points that no remaining one has.
 *
 * The model: a source whose lives all end by the oldest generation that stays is dead. Segments that hold records of dead
 * sources are made anew without them, or go if they hold nothing else; the next manifest lacks these sources, and says
 * which generation is the oldest that can be read; what each of the others did is told still. Nothing that can be read afterwards
 * has changed: the same records, and the same sums of contents. A job of a generation that would go, and is not done, stops it:
 * nobody takes away what somebody waits for.
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
	uint64_t keep, before; /* as asked */
	uint64_t oldest;       /* that stays */
	uint64_t bytes;        /* of the dataset's segments, before */
	uint32_t *dead;
	size_t ndead;
	struct pruned done;
	bool running;
	prune_answer_fn *answer;
	void *token;
};

/* ---- which ---- */

static bool ends_by(uint64_t added, uint64_t removed, uint64_t oldest)
{
	return removed && (removed <= oldest || removed <= added);
}

/* Whether it is in none of the generations from `oldest` on. Its last life comes last. */
static bool is_dead(const struct grid_source *s, uint64_t oldest)
{
	return ends_by(s->added, s->removed, oldest) &&
	       (!s->nearlier || ends_by(s->earlier[s->nearlier - 1].added, s->earlier[s->nearlier - 1].removed, oldest));
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
		if (is_dead(&m->sources[i], p->oldest))
			p->dead[p->ndead++] = m->sources[i].id;
	if (p->ndead)
		qsort(p->dead, p->ndead, sizeof *p->dead, by_number);
	return 0;
}

static int choose(struct dataset_rewrite *w, const struct grid_manifest *m, struct err *err)
{
	struct prune *p = (struct prune *)w;
	int r = find_dead(p, m, err);

	p->bytes = 0;
	p->done.points = 0;
	for (size_t i = 0; !r && i < m->nsegments; i++) {
		const struct grid_segment_info *s = &m->segments[i];
		uint64_t points = 0;

		p->bytes += s->bytes;
		if (p->ndead)
			r = grid_segment_count_sources(w->dataset->dirfd, s, p->dead, p->ndead, &points, err);
		if (!r && points)
			r = rewrite_add(w, &s, 1, points == s->points, err);
		p->done.points += points;
	}
	w->drop = p->dead;
	w->ndrop = p->ndead;
	if (!r && rewrite_bytes(w) > w->most) {
		err_set(err, ERR_LIMIT, "pruning %s takes %llu KiB of memory, it may have %llu KiB", w->dataset->name,
			(unsigned long long)(rewrite_bytes(w) >> 10), (unsigned long long)(w->most >> 10));
		return err_add_hint(err, "run with memory=%lluM or more", (unsigned long long)(rewrite_bytes(w) >> 17) + 1);
	}
	return r;
}

/* ---- the manifest ---- */

static bool dropped(const struct prune *p, uint32_t id)
{
	return p->ndead && bsearch(&id, p->dead, p->ndead, sizeof id, by_number);
}

/* Lives that ended before what can be read are not told any more. */
static void forget_lives(struct grid_source *s, uint64_t oldest)
{
	while (s->nearlier && ends_by(s->earlier->added, s->earlier->removed, oldest)) {
		s->earlier++;
		s->nearlier--;
	}
}

static int alter(struct dataset_rewrite *w, const struct grid_manifest *base, struct grid_manifest *m, struct err *err)
{
	struct prune *p = (struct prune *)w;
	uint32_t last = 0;
	size_t n = 0;

	for (size_t i = 0; i < m->nsources; i++)
		last = m->sources[i].id > last ? m->sources[i].id : last;
	p->done.files = 0;
	for (size_t i = 0; i < m->nsources; i++)
		if (dropped(p, m->sources[i].id) && !is_dead(&m->sources[i], p->oldest))
			return err_set(err, ERR_INTERNAL, "source %u of %s came back while it was pruned", m->sources[i].id,
				       w->dataset->name);
	for (size_t i = 0; i < m->nsources; i++) {
		struct grid_source *s = &m->sources[i];

		p->done.files += dropped(p, s->id);
		/* A number is never given twice: the last one stays, without points. */
		if (dropped(p, s->id) && s->id != last)
			continue;
		if (dropped(p, s->id))
			s->points = 0;
		forget_lives(s, p->oldest);
		m->sources[n++] = *s;
	}
	m->nsources = n;
	p->done.generations = p->oldest - grid_manifest_oldest(base);
	m->oldest = p->oldest;
	return 0;
}

/* ---- who needs it ---- */

static int check_needed(const struct prune *p, struct err *err)
{
	const struct dataset *d = p->rewrite.dataset;
	const struct datasets *ds = d->datasets;

	return ds->calls ? ds->calls->needed(ds->ctx, d, p->oldest, err) : 0;
}

static int last_look(struct dataset_rewrite *w, struct err *err)
{
	return check_needed((struct prune *)w, err);
}

/* ---- asking ---- */

static struct prune *prune_free(struct prune *p)
{
	dataset_rewrite_clear(&p->rewrite);
	uncharge(p->rewrite.dataset->datasets->core, sizeof *p);
	free(p->dead);
	free(p);
	return NULL;
}

static void answer(struct prune *p, const struct err *why)
{
	struct dataset *d = p->rewrite.dataset;
	struct prune **at;

	for (at = &d->datasets->prunes; *at != p; at = &(*at)->next)
		;
	*at = p->next;
	if (!why) {
		p->done.dataset = d;
		p->done.oldest = d->oldest;
		log_event(LOG_EVENT_DATASET_PRUNED, ABOUT_DATASET(d),
			  "%s: %llu generations before %llu went, with %llu points of %llu files, %llu bytes", d->name,
			  (unsigned long long)p->done.generations, (unsigned long long)d->oldest,
			  (unsigned long long)p->done.points, (unsigned long long)p->done.files,
			  (unsigned long long)p->done.bytes);
	}
	p->answer(p->token, why, why ? NULL : &p->done);
	dataset_release(d);
	prune_free(p);
}

static void prune_over(struct dataset_rewrite *w, const struct err *why)
{
	struct prune *p = (struct prune *)w;
	uint64_t old = 0;

	w->dataset->prune_to = 0;
	for (size_t i = 0; i < w->nold; i++)
		old += w->old[i].bytes;
	p->done.bytes = old > w->written ? old - w->written : 0;
	p->done.segments = w->nold;
	answer(p, why);
}

static int decide(struct prune *p, struct err *err)
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
		return err_set(err, ERR_USAGE, "either how many generations stay, or before which they go");
	if (p->keep)
		oldest = p->keep < d->generation ? d->generation - p->keep + 1 : 1;
	if (oldest > d->generation) {
		err_set(err, ERR_NOTFOUND, "generation %llu of %s is not there, the newest is %llu", (unsigned long long)oldest,
			d->name, (unsigned long long)d->generation);
		return err_add_hint(err, "the newest generation always stays");
	}
	p->oldest = oldest > d->oldest ? oldest : d->oldest;
	return check_needed(p, err);
}

/* Its turn has come: nobody else rewrites. */
static void begin(struct prune *p)
{
	struct dataset_rewrite *w = &p->rewrite;
	struct err err = ERR_INIT;

	if (decide(p, &err)) {
		answer(p, &err);
		return;
	}
	if (p->oldest == w->dataset->oldest) {
		answer(p, NULL);
		return;
	}
	p->running = true;
	w->dataset->prune_to = p->oldest;
	dataset_rewrite_start(w);
}

void dataset_prune_settle(struct datasets *ds)
{
	struct prune *p = ds->prunes;

	if (!p)
		return;
	if (p->running)
		dataset_rewrite_settle(&p->rewrite);
	else if (ds->merge)
		dataset_rewrite_cancel(ds->merge);
	/* What a revert brings back is not dead: which files are is looked at when it is over. */
	else if (!p->rewrite.dataset->reverting)
		begin(p);
}

void dataset_prune_tick(struct datasets *ds)
{
	if (ds->prunes && ds->prunes->running)
		dataset_rewrite_tick(&ds->prunes->rewrite);
}

struct prune *dataset_prune(struct dataset *d, uint64_t keep, uint64_t before, const struct peer *peer, prune_answer_fn *fn,
			    void *token)
{
	struct datasets *ds = d->datasets;
	struct err err = ERR_INIT;
	struct prune *p = NULL, **at;

	THREAD_LOOP_ONLY();
	if (ds->core->stopping)
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	else if (!dataset_rights(d, peer, RIGHT_OWN, &err) && !charge(ds->core, sizeof *p, "a prune", &err) &&
		 !(p = calloc(1, sizeof *p))) {
		uncharge(ds->core, sizeof *p);
		err_set(&err, ERR_NOMEM, "no memory for a request");
	}
	if (!p) {
		fn(token, &err, NULL);
		return NULL;
	}
	p->rewrite.dataset = dataset_hold(d);
	p->rewrite.peer = rights_without_groups(peer);
	p->rewrite.what = "a prune";
	p->rewrite.choose = choose;
	p->rewrite.alter = alter;
	p->rewrite.last_look = last_look;
	p->rewrite.over = prune_over;
	p->rewrite.priority = SCHED_NORMAL;
	p->rewrite.patient = p->rewrite.always = true;
	p->keep = keep;
	p->before = before;
	p->answer = fn;
	p->token = token;
	for (at = &ds->prunes; *at; at = &(*at)->next)
		;
	*at = p;
	return p;
}

void dataset_prune_cancel(struct prune *p)
{
	struct err err = ERR_INIT;

	if (p->running) {
		dataset_rewrite_cancel(&p->rewrite);
		return;
	}
	err_set(&err, ERR_CANCELLED, "it was ended");
	answer(p, &err);
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
