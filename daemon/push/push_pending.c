/*
 * Pending pushes: how a push leaves one, and how a later one continues it.
 *
 * The model: at each durable point a push writes its stage (grid_stage_suspend), and beside it a manifest without segments,
 * push-ID.pending, which says which files are staged whole, on which lattice, and how they were read. These files are all that is
 * needed: after a crash a push has them, or it never promised anything. When its connection or its daemon ends, the push is
 * pending: an entry of its dataset in memory, a row in the catalogue.
 *
 * A later push into the same dataset begins with a look at all pending pushes of its user: they are its offers. The first file
 * that it names and that an offer has decides: it takes that pending push, and goes on in its files, under its number
 * (push.stem). Nobody else can take it then. A push that names nothing of an offer leaves it alone.
 *
 * What the push commits is not pending any more. The other files are: the commit shortens the list in push-ID.pending, and the
 * next push that names one of them finds it there. If the push is interrupted, its new files are pending beside the old ones; if
 * it is aborted, the old ones alone. A crash between commit and shortening does no harm: sources that are in the dataset's
 * manifest do not count as pending.
 */
#include <assert.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "log.h"
#include "push_priv.h"

/* A hash of all assumptions: two systems may have one name, or differ only at the end of long names. */
static void assume_text(const struct crs_info *a, char ret[DIGEST_HEX_SIZE])
{
	const struct crs_system *s = &a->system;
	char all[CRS_TEXT_SIZE + 512];

	snprintf(all, sizeof all, "%s\n%s %d %d %u %u %a %a %a %a %a %a %a %a %a %a %a", a->text, s->datum, (int)a->plane,
		 (int)s->method, s->epsg, s->epsg_z, s->a, s->inverse_flattening, s->lat0, s->lon0, s->lat1, s->lat2, s->k0,
		 s->x0, s->y0, s->unit, s->unit_z);
	digest_hex(digest_hash(all, strlen(all)), ret);
}

#define READING " reading="

/* How the files were read; a push does not continue another that differs in it. The reading comes last, because a push does not
 * know it at its beginning. */
static void choices_text(const struct push *p, char *buf, size_t size)
{
	char assume[DIGEST_HEX_SIZE];

	assume_text(&p->agree.said, assume);
	snprintf(buf, size, "planar=%d accept-truncated=%d utm=%.15s geoid=%.45s %s=%s,%s,%s" READING "%s", p->agree.planar,
		 p->accept_truncated, p->agree.utm, p->agree.geoid_text, p->agree.overrides ? "override" : "assume",
		 p->agree.said.unit_xy, p->agree.said.unit_z, assume, p->reading);
}

/* ---- leaving ---- */

/* This source of the push that it continues is pending when it ends. */
static bool stays(const struct push *p, size_t i)
{
	return !p->committed || !p->taken->gone[i];
}

/* What is pending if the push ends now. */
static void count_pending(const struct push *p, uint32_t *ret_files, uint64_t *ret_points)
{
	uint32_t added = p->aborted || p->committed ? 0 : p->listed;

	*ret_files = 0;
	*ret_points = 0;
	for (size_t i = 0; p->adopt && i < p->adopt->nsources; i++) {
		*ret_files += stays(p, i);
		*ret_points += stays(p, i) ? pending_source_points(&p->adopt->sources[i]) : 0;
	}
	for (size_t i = 0; i < added; i++)
		*ret_points += pending_source_points(&p->sources[i]);
	*ret_files += added;
}

/* Files of the push that it continues, named again or not, but those of a commit; and the new ones, unless it was aborted or
 * committed. */
static int write_manifest(struct push *p, struct err *err)
{
	size_t old = p->adopt ? p->adopt->nsources : 0;
	struct grid_manifest m = {.lattice = p->agree.lattice};
	char name[64], *wkt;
	int r;

	m.sources = calloc(old + p->nsources + 1, sizeof *m.sources);
	if (!m.sources)
		return err_set(err, ERR_NOMEM, "no memory for a manifest");
	for (size_t i = 0; i < old; i++)
		if (stays(p, i))
			m.sources[m.nsources++] = p->adopt->sources[i];
	if (p->aborted || p->committed) {
		memcpy(m.choices, p->adopt->choices, sizeof m.choices);
	} else {
		choices_text(p, m.choices, sizeof m.choices);
		for (size_t i = 0; i < p->nsources; i++)
			m.sources[m.nsources++] = p->sources[i];
	}
	snprintf(m.crs, sizeof m.crs, "%s", p->agree.crs);
	snprintf(m.unit_xy, sizeof m.unit_xy, "%s", p->agree.unit_xy);
	snprintf(m.unit_z, sizeof m.unit_z, "%s", p->agree.unit_z);
	pending_manifest_name(p->stem, name);
	wkt = push_wkt_put(p, &m);
	m.wkt_since = 0;
	r = grid_manifest_write(p->dataset->dirfd, name, &m, err);
	free(wkt);
	free(m.sources);
	return r;
}

/* Worker. From here on, whatever becomes of the push, all files that were staged so far can be continued. */
int push_pending_write(struct push *p, struct err *err)
{
	int r = grid_stage_suspend(p->stage, err);

	if (!r && !p->dataset->onestep)
		r = write_manifest(p, err);
	if (!r) {
		p->on_disk = true;
		p->listed = p->files;
	}
	return r;
}

/* Nothing of it is pending. */
static void remove_files(struct push *p)
{
	struct err err = ERR_INIT;

	p->stage = grid_stage_free(p->stage);
	/* Those of a commit have their final names, too. */
	if (p->lines.staged && p->opened && breaklines_discard(p->dataset->dirfd, p->stem, &err))
		dataset_left(p->dataset, &err);
	err_clear(&err);
	if (p->on_disk && p->opened && pending_discard(p->dataset, p->stem, &err))
		dataset_left(p->dataset, &err);
	p->on_disk = false;
}

/* Worker: the end of a push. Sets p->kept if something of it is pending. */
void push_end_files(struct push *p)
{
	bool named = !p->dataset->onestep && p->opened, ended = p->committed || p->aborted;
	struct err err = ERR_INIT;
	uint32_t files;
	uint64_t points;

	if (named && !ended && p->stage && p->has_row && !p->broken && p->files > p->durable && push_pending_write(p, &err))
		log_event_err(LOG_EVENT_PUSH_FAILED, ABOUT_PUSH(p), "the files that a push staged last cannot be kept", &err);
	err_clear(&err);
	count_pending(p, &files, &points);
	p->kept = named && p->on_disk && files && (p->taken || !ended);
	if (!p->kept) {
		remove_files(p);
		return;
	}
	/* A list with files of the commit does no harm: the dataset's manifest has them, too. */
	if (ended && write_manifest(p, &err))
		log_event_err(LOG_EVENT_PUSH_FAILED, ABOUT_PUSH(p), "an interrupted push", &err);
	p->stage = grid_stage_detach(p->stage);
	p->kept_bytes = pending_bytes(p->dataset->dirfd, p->stem, points);
}

/* Loop: the push has ended, and what is left of it is pending. */
void push_pending_keep(struct push *p)
{
	struct pending *q = p->pending;
	struct catalogue_push row = {.id = p->stem, .dataset = p->dataset->id, .uid = p->peer.uid};
	struct err err = ERR_INIT;

	assert(q);
	p->pending = NULL;
	q->id = p->stem;
	q->uid = p->peer.uid;
	count_pending(p, &q->files, &q->points);
	q->bytes = p->kept_bytes;
	/* Only an interruption begins its 7 days anew. */
	if (!p->committed && !p->aborted)
		q->interrupted_us = clock_real_us();
	row.files = q->files;
	row.begun_us = q->interrupted_us;
	if (catalogue_put_push(p->pushes->core->p.catalogue, &row, NULL, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
	pending_add(p->dataset, q);
	log_event(LOG_EVENT_PUSH_PENDING, ABOUT_PENDING(q, p->dataset), "push %llu of user %u into %s is pending: %u files",
		  (unsigned long long)q->id, q->uid, p->dataset->name, q->files);
}

/* ---- offers ---- */

void push_offers_forget(struct push *p)
{
	for (size_t i = 0; i < p->noffers; i++) {
		struct push_offer *o = &p->offers[i];

		names_free(&o->paths);
		o->manifest = grid_manifest_free(o->manifest);
		free(o->gone);
		o->gone = NULL;
		o->useless = NULL;
	}
}

void push_offers_free(struct push *p)
{
	push_offers_forget(p);
	free(p->offers);
	p->offers = NULL;
	p->noffers = 0;
}

/* The first push into a dataset also looks at the newest one of another user, for its lattice. */
static bool is_offer(const struct push *p, const struct pending *q)
{
	return q->uid == p->peer.uid || (!*p->dataset->manifest && q == p->dataset->pending);
}

int push_offers_list(struct push *p, struct err *err)
{
	struct dataset *d = p->dataset;
	size_t n = 0;

	push_offers_free(p);
	if (d->onestep)
		return 0;
	pending_expire(d);
	for (const struct pending *q = d->pending; q; q = q->next)
		n += is_offer(p, q);
	p->offers = calloc(n + 1, sizeof *p->offers);
	if (!p->offers)
		return err_set(err, ERR_NOMEM, "no memory for a push");
	for (const struct pending *q = d->pending; q; q = q->next)
		if (is_offer(p, q))
			p->offers[p->noffers++] = (struct push_offer){
				.id = q->id, .stamp = q->stamp, .files = q->files, .own = q->uid == p->peer.uid};
	return 0;
}

static bool other_scale(const char *text, struct decimal scale)
{
	struct decimal d;

	return *text && (!decimal_parse(text, &d) || decimal_compare(d, scale));
}

static const char *useless(const struct push *p, const struct grid_manifest *m)
{
	struct agree base = p->agree;

	if (!p->base)
		return NULL;
	if (!lattice_equal(&p->base->lattice, &m->lattice))
		return "the dataset now has another lattice";
	agree_fix(&base, p->base->crs, p->base->unit_xy, p->base->unit_z);
	return agree_is(&base, m->crs, m->unit_xy, m->unit_z) ? NULL : "the dataset now has another coordinate system";
}

/* Sets offer->reading if this push wants the same of its files. */
static void compare_choices(const struct push *p, struct push_offer *o)
{
	const struct grid_manifest *m = o->manifest;
	const char *reading = strstr(m->choices, READING);
	char choices[sizeof m->choices];

	choices_text(p, choices, sizeof choices);
	if (reading && !strncmp(choices, m->choices, (size_t)(reading - m->choices) + strlen(READING)) &&
	    !other_scale(p->agree.scale_xy, m->lattice.scale_xy) && !other_scale(p->agree.scale_z, m->lattice.scale_z))
		snprintf(o->reading, sizeof o->reading, "%s", reading + strlen(READING));
}

static int read_offer(struct push *p, struct push_offer *o, struct err *err)
{
	struct grid_manifest *m = NULL;
	struct err why = ERR_INIT;
	char name[64], stage[48];
	uint64_t bytes;
	int r;

	pending_manifest_name(o->id, name);
	pending_stage_name(o->id, stage);
	r = grid_manifest_load(p->dataset->dirfd, name, p->pushes->core->p.ledger, &m, &why);
	if (!r)
		r = grid_stage_check(p->dataset->dirfd, stage, &o->last, &bytes, &why);
	if (r) {
		grid_manifest_free(m);
		if (r == -ERR_BUSY || r == -ERR_NOMEM) {
			*err = why;
			return r;
		}
		/* One that cannot be read now, or not by this version, stays. */
		if (r == -ERR_CORRUPT || r == -ERR_TRUNCATED || why.sys == ENOENT) {
			o->useless = "its files are damaged";
		} else {
			snprintf(o->unread, sizeof o->unread, "%.159s", why.message);
			log_event_err(LOG_EVENT_UNREADABLE, ABOUT_PUSH(p),
				      "files of an interrupted push cannot be read: they stay", &why);
		}
		return 0;
	}
	o->manifest = m;
	pending_leave_out(m, p->base);
	o->useless = useless(p, m);
	compare_choices(p, o);
	o->gone = calloc(m->nsources + 1, sizeof *o->gone);
	return o->gone ? push_known_index(m, &o->paths, err) : err_set(err, ERR_NOMEM, "no memory for a push");
}

int push_offers_read(struct push *p, struct err *err)
{
	int r = 0;

	for (size_t i = 0; !r && i < p->noffers; i++)
		r = read_offer(p, &p->offers[i], err);
	return r;
}

const struct lattice *push_offers_near(const struct push *p)
{
	for (size_t i = 0; !p->base && i < p->noffers; i++) {
		const struct grid_manifest *m = p->offers[i].manifest;

		if (m && agree_is(&p->agree, m->crs, m->unit_xy, m->unit_z))
			return &m->lattice;
	}
	return NULL;
}

uint64_t push_offers_bytes(const struct push *p)
{
	uint64_t bytes = 0;

	for (size_t i = 0; i < p->noffers; i++)
		bytes += names_bytes(&p->offers[i].paths) + (p->offers[i].manifest ? p->offers[i].manifest->nsources : 0);
	return bytes;
}

static void drop_useless(struct push *p, struct push_offer *o)
{
	struct pending *q = pending_take(p->dataset, o->id, o->stamp);

	/* Otherwise another push has changed it meanwhile. */
	if (!q)
		return;
	snprintf(p->note, sizeof p->note, "an interrupted push is dropped with its %u files: %s", q->files, o->useless);
	pending_drop(p->dataset, q, o->useless);
}

/* The note of one offer, of several the last one's. */
static void note_unread(struct push *p, const struct push_offer *o)
{
	snprintf(p->note, sizeof p->note, "%u files of an interrupted push cannot be read and stay: %s", o->files, o->unread);
}

/* Loop, after push_offers_read. */
void push_offers_settle(struct push *p)
{
	unsigned same = 0, other = 0;
	size_t n;

	for (size_t i = 0; i < p->noffers; i++) {
		struct push_offer *o = &p->offers[i];

		if (o->own && o->useless)
			drop_useless(p, o);
		else if (o->own && *o->unread)
			note_unread(p, o);
		else if (o->own && o->manifest && *o->reading)
			same += o->files;
		else if (o->own && o->manifest)
			other += o->files;
	}
	n = strlen(p->note);
	if (same)
		snprintf(p->note + n, sizeof p->note - n,
			 "%s%u files of an interrupted push are here: those that are named again are taken over, the others stay",
			 n ? "; " : "", same);
	else if (other)
		snprintf(
			p->note + n, sizeof p->note - n,
			"%s%u files of an interrupted push are here, read with other options: those that are named again are read again",
			n ? "; " : "", other);
}

/* ---- continuing ---- */

/* It has staged nothing yet, so it can go on in the files of that one. */
static bool can_take(const struct push *p, const struct push_offer *o)
{
	const struct grid_manifest *m = o->manifest;

	return !p->taken && !p->stage && !p->on_disk && !p->files &&
	       (!p->agree.has_lattice || lattice_equal(&p->agree.lattice, &m->lattice)) &&
	       (!p->agree.has_crs || agree_is(&p->agree, m->crs, m->unit_xy, m->unit_z));
}

void push_offers_find(struct push *p, struct push_request *rq)
{
	for (size_t i = 0; rq->known == PUSH_NEW && i < p->noffers; i++) {
		struct push_offer *o = &p->offers[i];
		const struct grid_source *s = NULL;

		if (!o->own || !o->manifest || o->useless || !push_same_reading(o, rq) || !(o == p->taken || can_take(p, o)))
			continue;
		s = push_known_find(p, o->manifest, &o->paths, rq);
		if (!s)
			continue;
		rq->offer = o;
		rq->adopted = (size_t)(s - o->manifest->sources);
		rq->known = o == p->taken && p->adopt_named[rq->adopted] ? PUSH_KNOWN : PUSH_ADOPTED;
		rq->in.points = s->points;
	}
}

static void take(struct push *p, struct push_offer *o, struct pending *q)
{
	const struct grid_manifest *m = o->manifest;

	dataset_release(p->dataset); /* the reference of the pending push; this push has its own */
	pending_free(p->pushes->datasets, p->pending);
	p->pending = q;
	p->taken = o;
	p->adopt = o->manifest;
	p->stem = q->id;
	p->on_disk = p->lines.staged = true;
	memcpy(p->reading, o->reading, sizeof p->reading);
	push_space_claim(p, q);
	p->agree.has_lattice = true;
	p->agree.lattice = m->lattice;
	if (!*p->dataset->manifest)
		dataset_plan_begin(p->dataset, p);
	if (!p->agree.has_crs)
		agree_fix(&p->agree, m->crs, m->unit_xy, m->unit_z);
	/* The stage may also have points of files that were not read whole, and their numbers are not given again. */
	dataset_sources_from(p->dataset, o->last + 1);
}

int push_adopt(struct push *p, struct push_request *rq, struct err *err)
{
	struct push_offer *o = rq->offer;
	const struct grid_manifest *m = o->manifest;
	struct pending *q;
	int r = 0;

	if (!p->taken) {
		/* What the commit makes of its manifest. */
		r = push_table_reserve(p, 3 * (m->nsources * sizeof *m->sources + m->texts_bytes), err);
		if (!r && !p->adopt_named)
			p->adopt_named = calloc(m->nsources + 1, sizeof *p->adopt_named);
		if (!r && !p->adopt_named)
			r = err_set(err, ERR_NOMEM, "no memory for a push");
		if (r)
			return r;
		q = pending_take(p->dataset, o->id, o->stamp);
		if (!q) {
			free(p->adopt_named);
			p->adopt_named = NULL;
			o->own = false;
			return PUSH_AGAIN;
		}
		take(p, o, q);
	}
	p->adopt_named[rq->adopted] = true;
	p->nadopt_named++;
	return 0;
}

/* ---- after the commit ---- */

static void mark_gone(struct push *p, const char *path)
{
	for (size_t k = 0; k < p->noffers; k++) {
		struct push_offer *o = &p->offers[k];
		size_t at = NAMES_START;
		uint32_t i;

		while (o->own && o->gone && names_next(&o->paths, path, &at, &i))
			o->gone[i] = true;
	}
}

void push_offers_known(struct push *p, const char *path)
{
	if (*path)
		mark_gone(p, path);
}

static bool all_gone(const struct push_offer *o)
{
	size_t n = 0;

	while (n < o->manifest->nsources && o->gone[n])
		n++;
	return n == o->manifest->nsources;
}

void push_offers_committed(struct push *p)
{
	struct pending *q;

	for (size_t i = 0; i < p->nsources; i++)
		push_offers_known(p, p->sources[i].path);
	for (size_t i = 0; p->taken && i < p->adopt->nsources; i++)
		p->taken->gone[i] |= p->adopt_named[i];
	for (size_t k = 0; k < p->noffers; k++) {
		struct push_offer *o = &p->offers[k];

		q = o->own && o != p->taken && o->gone && all_gone(o) ? pending_take(p->dataset, o->id, o->stamp) : NULL;
		if (q)
			pending_drop(p->dataset, q, "the dataset has all of them now");
	}
}
