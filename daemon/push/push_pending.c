/*
 * Pending pushes: how a push leaves one, and how a later one continues it.
 *
 * The model: at each durable point a push writes its stage (grid_stage_suspend), and beside it a manifest without segments,
 * push-ID.pending, which says which files are staged whole, on which lattice, and how they were read. These files are all that is
 * needed: after a crash a push has them, or it never promised anything. When its connection or its daemon ends, the push is
 * pending: an entry of its dataset in memory, a row in the catalogue.
 *
 * A later push of the same user into the same dataset takes over its number and continues it. Files that the client names again
 * count; the commit drops the others. After a commit the sources are in the dataset's manifest, which tells the next start that a
 * push with a remaining row was committed.
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

/* How the files were read; pushes that differ in it do not match. The reading comes last, because a push does not know it at its
 * beginning. */
static void choices_text(const struct push *p, char *buf, size_t size)
{
	char assume[DIGEST_HEX_SIZE];

	assume_text(&p->agree.said, assume);
	snprintf(buf, size, "planar=%d accept-truncated=%d utm=%.15s geoid=%.45s %s=%s,%s,%s reading=%s", p->agree.planar,
		 p->accept_truncated, p->agree.utm, p->agree.geoid_text, p->agree.overrides ? "override" : "assume",
		 p->agree.said.unit_xy, p->agree.said.unit_z, assume, p->reading);
}

/* ---- leaving ---- */

/* All adopted sources, named again or not, and the new ones. */
static int write_manifest(struct push *p, struct err *err)
{
	size_t old = p->adopt ? p->adopt->nsources : 0, added = p->aborted ? 0 : p->nsources;
	struct grid_manifest m = {.lattice = p->agree.lattice, .nsources = old + added};
	char name[64], *wkt;
	int r;

	m.sources = calloc(m.nsources + 1, sizeof *m.sources);
	if (!m.sources)
		return err_set(err, ERR_NOMEM, "no memory for a manifest");
	if (old)
		memcpy(m.sources, p->adopt->sources, old * sizeof *m.sources);
	if (added)
		memcpy(m.sources + old, p->sources, added * sizeof *m.sources);
	snprintf(m.crs, sizeof m.crs, "%s", p->agree.crs);
	snprintf(m.unit_xy, sizeof m.unit_xy, "%s", p->agree.unit_xy);
	snprintf(m.unit_z, sizeof m.unit_z, "%s", p->agree.unit_z);
	choices_text(p, m.choices, sizeof m.choices);
	pending_manifest_name(p->id, name);
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
	if (!r)
		p->on_disk = true;
	return r;
}

/* Worker: the end of a push. Sets p->kept if it stays as a pending one. */
void push_end_files(struct push *p)
{
	struct err err = ERR_INIT;
	bool named = !p->dataset->onestep;

	if (p->committed || !named || !p->opened) {
		p->stage = grid_stage_free(p->stage);
	} else if (p->aborted && p->adopt) {
		/* The pending push that it had adopted stays. */
		if (p->on_disk && write_manifest(p, &err))
			log_event_err(LOG_EVENT_PUSH_FAILED, ABOUT_PUSH(p), "an interrupted push", &err);
	} else if (!p->aborted && p->stage && p->has_row && !p->broken && (p->files > p->durable) &&
		   push_pending_write(p, &err)) {
		log_event_err(LOG_EVENT_PUSH_FAILED, ABOUT_PUSH(p), "the files that a push staged last cannot be kept", &err);
	}
	p->kept = named && !p->committed && p->on_disk && (!p->aborted || p->adopt) && (p->files || p->adopt || p->durable);
	if (p->kept) {
		p->stage = grid_stage_detach(p->stage);
		return;
	}
	p->stage = grid_stage_free(p->stage);
	err_clear(&err);
	/* Those of a commit have their final names, too. */
	if (p->lines.staged && p->opened && breaklines_discard(p->dataset->dirfd, p->id, &err))
		dataset_left(p->dataset, &err);
	err_clear(&err);
	if (p->on_disk && p->opened && pending_discard(p->dataset, p->id, &err))
		dataset_left(p->dataset, &err);
	p->on_disk = false;
}

/* Loop: the push has ended, and stays as a pending one. */
void push_pending_keep(struct push *p)
{
	struct pending *q = p->pending;

	assert(q && !p->has_claim);
	p->pending = NULL;
	q->id = p->id;
	q->uid = p->peer.uid;
	q->files = (uint32_t)(p->adopt ? p->adopt->nsources : 0);
	q->points = pending_points(p->adopt);
	for (size_t i = 0; !p->aborted && i < p->nsources; i++) {
		q->files++;
		q->points += p->sources[i].points + (p->sources[i].lines ? p->sources[i].lines->vertices : 0);
	}
	q->interrupted_us = clock_real_us();
	pending_add(p->dataset, q);
	log_event(LOG_EVENT_PUSH_PENDING, ABOUT_PENDING(q, p->dataset), "push %llu of user %u into %s is pending: %u files",
		  (unsigned long long)q->id, q->uid, p->dataset->name, q->files);
}

/* ---- continuing ---- */

/* Loop: takes the newest pending push of this user. */
void push_claim(struct push *p)
{
	struct pending *q;

	if (p->dataset->onestep)
		return;
	pending_expire(p->dataset);
	q = pending_take(p->dataset, p->peer.uid);
	if (!q)
		return;
	pending_free(p->pushes->datasets, p->pending);
	p->pending = q;
	p->has_claim = true;
	push_space_claim(p, q);
}

static bool other_scale(const char *text, struct decimal scale)
{
	struct decimal d;

	return *text && (!decimal_parse(text, &d) || decimal_compare(d, scale));
}

/* NULL, or why the pending push cannot be continued. */
static const char *mismatch(const struct push *p, const struct grid_manifest *m)
{
	const char *reading = strstr(m->choices, " reading=");
	char choices[sizeof m->choices];

	choices_text(p, choices, sizeof choices);
	if (p->base && !lattice_equal(&p->base->lattice, &m->lattice))
		return "the dataset now has another lattice";
	if (other_scale(p->agree.scale_xy, m->lattice.scale_xy) || other_scale(p->agree.scale_z, m->lattice.scale_z))
		return "another --scale is wanted now";
	if (!reading || strncmp(choices, m->choices, (size_t)(reading - m->choices) + strlen(" reading=")))
		return "its files were read with other options";
	return NULL;
}

static void adopt_manifest(struct push *p, struct grid_manifest *m)
{
	p->adopt = m;
	p->lines.staged = true;
	p->id = p->pending->id;
	p->on_disk = true;
	snprintf(p->reading, sizeof p->reading, "%s", strstr(m->choices, " reading=") + strlen(" reading="));
	snprintf(
		p->note, sizeof p->note,
		"the push that was interrupted is taken up: of its files (%u) those that are named again count, the others go with the commit",
		p->pending->files);
}

/* Worker, with the dataset open and its manifest read. */
int push_adopt(struct push *p, struct err *err)
{
	struct grid_manifest *m = NULL;
	struct err ignored = ERR_INIT;
	const char *why = NULL;
	char name[64], stage[48];
	int r = 0;

	if (!p->has_claim)
		return 0;
	pending_manifest_name(p->pending->id, name);
	pending_stage_name(p->pending->id, stage);
	r = grid_manifest_load(p->dataset->dirfd, name, p->pushes->core->p.ledger, &m, &ignored);
	if (!r)
		r = grid_stage_check(p->dataset->dirfd, stage, &p->adopt_last, &ignored);
	/* A push that cannot be read now, or not by this version, is kept; only a damaged one is dropped. */
	if (r && r != -ERR_CORRUPT && r != -ERR_TRUNCATED && ignored.sys != ENOENT) {
		grid_manifest_free(m);
		*err = ignored;
		return r;
	}
	if (r) {
		log_event_err(LOG_EVENT_DAMAGE, ABOUT_PUSH(p), "an interrupted push", &ignored);
		why = "its files are damaged";
		r = 0;
	} else {
		why = mismatch(p, m);
	}
	if (!why) {
		r = push_known_index(m, &p->adopt_paths, err);
		p->adopt_named = calloc(m->nsources + 1, sizeof *p->adopt_named);
		if (!r && !p->adopt_named)
			r = err_set(err, ERR_NOMEM, "no memory for a push");
		if (!r) {
			adopt_manifest(p, m);
			return 0;
		}
	} else {
		snprintf(p->note, sizeof p->note, "the push that was interrupted is dropped with its %u files: %s",
			 p->pending->files, why);
		p->has_claim = false;
		p->dropped = p->pending->id;
		p->dropped_row = !pending_discard(p->dataset, p->pending->id, &ignored);
		if (!p->dropped_row)
			log_event_err(LOG_EVENT_LEFTOVER, NULL, "files of an interrupted push cannot be removed", &ignored);
	}
	grid_manifest_free(m);
	return r;
}

/* Loop, after push_adopt. */
void push_adopt_done(struct push *p)
{
	const struct grid_manifest *m = p->adopt;

	if (p->dropped) {
		log_event(LOG_EVENT_PUSH_DROPPED, ABOUT_PUSH(p), "%s: %s", p->dataset->name, p->note);
		if (p->dropped_row)
			dataset_drop_row(p->dataset, p->dropped);
	}
	if (p->dropped || m)
		dataset_release(p->dataset); /* the reference of the pending push; this push has its own */
	if (!m)
		return;
	push_space_adopted(p);
	p->agree.has_lattice = true;
	p->agree.lattice = m->lattice;
	if (!*p->dataset->manifest)
		dataset_plan_begin(p->dataset, p);
	if (!p->agree.has_crs)
		agree_fix(&p->agree, m->crs, m->unit_xy, m->unit_z);
	/* The stage may also have points of files that were not read whole, and their numbers are not given again. */
	dataset_sources_from(p->dataset, p->adopt_last + 1);
	p->has_claim = false;
}

/* Loop, when all files are probed. If none of the pending push's files was named again, neither its lattice nor its system
 * counts; the commit drops its points. */
void push_adopt_drop(struct push *p)
{
	if (!p->adopt || p->nadopt_named || p->base)
		return;
	log_event(LOG_EVENT_PUSH_DROPPED, ABOUT_PUSH(p),
		  "%s: nothing of the interrupted push %llu is pushed again: its %zu files are dropped", p->dataset->name,
		  (unsigned long long)p->id, p->adopt->nsources);
	names_free(&p->adopt_paths);
	p->adopt = grid_manifest_free(p->adopt);
	agree_unfix(&p->agree);
	p->reading[0] = 0;
}

/* Loop: the push ends before it could continue it. */
void push_unclaim(struct push *p)
{
	if (!p->has_claim)
		return;
	p->has_claim = false;
	pending_put_back(p->dataset, p->pending);
	p->pending = NULL;
	push_space_unclaim(p);
}
