/*
 * Reverts: a new generation that undoes an earlier one.
 *
 * The model: a generation is undone as a whole or not at all. The files that it added must still be there, those that it removed
 * must be absent, and no other file may have taken their place since. A file that comes back has the same records: its source
 * gets another life. Only the manifest is read and written; content sums follow from the sums that blocks keep of their sources.
 * Lines that are together afterwards and never were before get a line set first (dataset_lines.c).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dataset_change.h"
#include "dataset_lines.h"
#include "names.h"

struct revert {
	struct dataset_change change;
	struct dataset_lines lines;
	uint64_t generation;
	/* Line sets that ended by that generation are not restored: a prune removes them. No other one begins meanwhile. */
	uint64_t sets_to;
	bool owner; /* the peer is the owner or an administrator: it may see the paths of the files */
	revert_answer_fn *answer;
	void *token;
};

/* A life of the source began in generation `g`. Line vertices follow from the lines (dataset_lines_put). */
static bool life_began(const struct grid_source *s, uint64_t g)
{
	if (s->kind == GRID_LINE_VERTICES)
		return false;
	for (size_t i = 0; i < s->nearlier; i++)
		if (s->earlier[i].added == g)
			return true;
	return s->added == g && s->removed != g;
}

static bool life_ended(const struct grid_source *s, uint64_t g)
{
	if (s->kind == GRID_LINE_VERTICES)
		return false;
	for (size_t i = 0; i < s->nearlier; i++)
		if (s->earlier[i].removed == g)
			return true;
	return s->removed == g && s->added != g;
}

/* Only the owner and administrators may see the paths of files, as in a list of files. */
static int conflict(const struct grid_source *s, uint64_t g, uint64_t by, const char *what, bool owner, struct err *err)
{
	err_set(err, ERR_CONFLICT, "generation %llu cannot be undone: the file was %s in generation %llu", (unsigned long long)g,
		what, (unsigned long long)by);
	err_add_hint(err, "revert generation %llu first", (unsigned long long)by);
	return err_add_file(err, owner && *s->path ? s->path : s->name);
}

static const struct grid_generation *generation_note(const struct grid_manifest *m, uint64_t g)
{
	for (size_t i = 0; i < m->ngenerations; i++)
		if (m->generations[i].number == g)
			return &m->generations[i];
	return NULL;
}

static int check_number(const struct grid_manifest *m, uint64_t g, const char *name, struct err *err)
{
	const struct grid_generation *note = generation_note(m, g);
	uint64_t oldest = grid_manifest_oldest(m), first = oldest > 1 ? oldest + 1 : 1;

	if (g > m->generation)
		return err_set(err, ERR_NOTFOUND, "the dataset %s has no generation %llu, the newest is %llu", name,
			       (unsigned long long)g, (unsigned long long)m->generation);
	if (g < first)
		return err_set(err, ERR_NOTFOUND,
			       "generation %llu of %s cannot be undone: what was before generation %llu was pruned",
			       (unsigned long long)g, name, (unsigned long long)oldest);
	if (note && note->kind == GRID_PRUNE)
		return err_set(err, ERR_CONFLICT, "generation %llu of %s cannot be undone: what was pruned is gone",
			       (unsigned long long)g, name);
	return 0;
}

/* Files that the generation added are there, and files that it removed are not, whatever happened in between. */
static int check_source(const struct grid_source *s, uint64_t g, bool owner, struct err *err)
{
	if (life_began(s, g) && s->removed)
		return conflict(s, g, s->removed, "removed", owner, err);
	if (life_ended(s, g) && !s->removed)
		return conflict(s, g, s->added, "brought back", owner, err);
	return 0;
}

/* No other file has taken the place of one that comes back. Files that were beside it before may stay. */
static int check_place(const struct grid_manifest *m, const struct names *paths, const struct grid_source *s, uint64_t g,
		       bool owner, struct err *err)
{
	size_t at = NAMES_START;
	uint32_t i;

	while (*s->path && names_next(paths, s->path, &at, &i)) {
		const struct grid_source *other = &m->sources[i];

		if (other != s && other->added > g)
			return conflict(other, g, other->added, "pushed again", owner, err);
	}
	return 0;
}

static int check_sources(const struct grid_manifest *m, uint64_t g, bool owner, struct err *err)
{
	struct names paths = {0};
	bool any = false;
	int r = 0;

	for (size_t i = 0; !r && i < m->nsources; i++)
		if (!m->sources[i].removed && *m->sources[i].path && !life_began(&m->sources[i], g))
			r = names_put(&paths, m->sources[i].path, (uint32_t)i, err);
	for (size_t i = 0; !r && i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		any = any || life_began(s, g) || life_ended(s, g);
		r = check_source(s, g, owner, err);
		if (!r && life_ended(s, g))
			r = check_place(m, &paths, s, g, owner, err);
	}
	names_free(&paths);
	if (!r && !any)
		r = err_set(err, ERR_CONFLICT, "generation %llu changed nothing: there is nothing to undo",
			    (unsigned long long)g);
	return r;
}

static int revert_make(struct dataset_change *c, const struct grid_manifest *base, struct grid_manifest *m, struct err *err)
{
	struct revert *v = (struct revert *)c;
	uint64_t g = v->generation;
	size_t lives = 0, used = 0, sets = 0;
	int r = check_number(base, g, c->dataset->name, err);

	if (!r)
		r = check_sources(base, g, v->owner, err);
	if (r)
		return r;
	for (size_t i = 0; i < base->nsources; i++)
		lives += life_ended(&base->sources[i], g) ? base->sources[i].nearlier + 1 : 0;
	for (size_t i = 0; i < base->nsources; i++)
		if (base->sources[i].kind == GRID_LINE_VERTICES && base->sources[i].nearlier >= sets)
			sets = base->sources[i].nearlier + 1;
	m->spans = calloc(lives + sets + 1, sizeof *m->spans);
	if (!m->spans)
		return err_set(err, ERR_NOMEM, "no memory for a manifest");
	m->generation = base->generation + 1;
	for (size_t i = 0; !r && i < m->nsources; i++) {
		struct grid_source *s = &m->sources[i];

		if (life_began(s, g)) {
			s->removed = m->generation;
		} else if (life_ended(s, g)) {
			used += s->nearlier + 1;
			r = grid_source_restore(s, m->generation, m->spans + used - s->nearlier - 1, err);
		}
	}
	return r ? r : dataset_lines_put(&v->lines, m, v->sets_to, m->spans + lives, err);
}

static struct revert *of_lines(struct dataset_lines *l)
{
	return (struct revert *)((char *)l - offsetof(struct revert, lines));
}

static void revert_finish(struct revert *v, const struct err *why)
{
	struct dataset *d = v->lines.dataset;
	struct reverted done = {
		.dataset = d,
		.generation = d->generation,
		.undone = v->generation,
		.points = d->points,
		.made = &v->change.made_generation,
	};

	d->reverts--;
	dataset_lines_end(&v->lines, !why);
	if (!why)
		log_event(LOG_EVENT_DATASET_REVERTED,
			  &(struct log_about){.dataset = d->name,
					      .generation = done.generation,
					      ABOUT_USER(v->lines.peer.uid),
					      .pid = v->lines.peer.pid},
			  "%s: generation %llu undoes generation %llu", d->name, (unsigned long long)done.generation,
			  (unsigned long long)done.undone);
	v->answer(v->token, why, why ? NULL : &done);
	uncharge(d->datasets->core, sizeof *v);
	free(v);
	dataset_release(d);
}

static void revert_undo(struct dataset_change *c)
{
	dataset_lines_undo(&((struct revert *)c)->lines);
}

static void revert_done(struct dataset_change *c, const struct err *why)
{
	struct revert *v = (struct revert *)c;

	if (why && dataset_lines_lacks(&v->lines))
		dataset_lines_wait(&v->lines);
	else
		revert_finish(v, why);
}

static void revert_start(struct revert *v)
{
	v->change = (struct dataset_change){
		.dataset = v->lines.dataset,
		.peer = v->lines.peer,
		.make = revert_make,
		.undo = revert_undo,
		.done = revert_done,
		.kind = GRID_REVERT,
		.undoes = v->generation,
		.lengthy = v->lines.have > 0,
	};
	dataset_change_start(&v->change);
}

static void lines_ready(struct dataset_lines *l, const struct err *why)
{
	if (why)
		revert_finish(of_lines(l), why);
	else
		revert_start(of_lines(l));
}

/* Refuses to revive what a running prune removes. */
static int check_prune(const struct dataset *d, uint64_t generation, struct err *err)
{
	generation = generation ? generation : d->generation;
	if (!d->prune_to || generation > d->prune_to)
		return 0;
	return err_set(err, ERR_NOTFOUND,
		       "generation %llu of %s cannot be undone: what was before generation %llu is being pruned",
		       (unsigned long long)generation, d->name, (unsigned long long)d->prune_to);
}

void dataset_revert(struct dataset *d, uint64_t generation, const struct peer *peer, revert_answer_fn *answer, void *token)
{
	struct revert *v = NULL;
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (d->onestep)
		err_set(&err, ERR_USAGE, "a one-step dataset has exactly one generation");
	else if (!dataset_rights(d, peer, RIGHT_WRITE, &err) && !check_prune(d, generation, &err) &&
		 !charge(d->datasets->core, sizeof *v, "a revert", &err)) {
		v = calloc(1, sizeof *v);
		if (!v) {
			uncharge(d->datasets->core, sizeof *v);
			err_set(&err, ERR_NOMEM, "no memory for a request");
		}
	}
	if (!v) {
		answer(token, &err, NULL);
		return;
	}
	v->lines.dataset = dataset_hold(d);
	v->lines.peer = rights_without_groups(peer);
	v->lines.what = "a revert";
	v->lines.ready = lines_ready;
	v->owner = rights_allow(peer, RIGHT_OWN, d->uid, d->gid, d->mode);
	v->generation = generation ? generation : d->generation;
	v->sets_to = d->drops_sets ? UINT64_MAX : d->prune_to;
	v->answer = answer;
	v->token = token;
	d->reverts++;
	revert_start(v);
}
