/*
 * A run for which there is no disk space.
 *
 * The model: space is reserved before it is written (space_take). A lack of space, there or in a write, does not end a run: it
 * releases its slot, memory, files and plan, as one that yields, and seeks a slot again when there is space. What it made is in
 * the store, and blocks that its reader has pass the emitter unsent, so it continues where it was. A run that a client waits for
 * fails after a while; a submitted job waits as long as it takes. A run whose cache was removed begins again at once.
 *
 * Data that need not be stored (finished domains) is not written then.
 */
#include <errno.h>
#include <stdio.h>

#include "clock.h"
#include "log.h"
#include "parse.h"
#include "run_priv.h"

/* Seconds between two checks for space; doubled after each failure. */
#define CHECK_SECONDS 2.0
#define CHECK_SECONDS_MAX 30.0
/* A run that lacks space again within this time has made no progress. */
#define SOON_SECONDS 10.0
enum { VANISHED_MAX = 5, UNKNOWN_BYTES = 1 << 20 };

/* A part of the cache was missing when it was needed. Pushed data lies elsewhere, and is not removed while it is used. */
static bool vanished(struct run *w, const struct err *why)
{
	bool cached = why->code == ERR_IO || (why->code == ERR_CORRUPT && w->dataset->onestep);

	return cached && why->sys == ENOENT && w->space.vanished < VANISHED_MAX;
}

bool run_space_suspend(struct run *w, const struct err *why)
{
	struct run_space *s = &w->space;

	if (s->given_up || (why->code != ERR_NOSPACE && !vanished(w, why)))
		return false;
	if (why->code != ERR_NOSPACE) {
		s->vanished++;
		s->missing = 0;
		s->wait = 0;
	} else {
		bool again = s->since_ns && clock_since(s->resumed_ns) < SOON_SECONDS;

		s->wait = again && s->wait > 0 ? s->wait * 2 : CHECK_SECONDS;
		s->wait = s->wait > CHECK_SECONDS_MAX ? CHECK_SECONDS_MAX : s->wait;
		s->need = atomic_exchange(&s->asked, 0);
		/* The file system or its quota refused: the number is unknown. */
		s->need = s->need ? s->need : UNKNOWN_BYTES;
		s->missing = why->need ? why->need : s->need;
		if (!again)
			s->since_ns = clock_mono_ns();
	}
	s->why = *why;
	s->checked_ns = clock_mono_ns();
	s->waits = true;
	if (s->missing)
		log_event_err(LOG_EVENT_JOB_WAITS_SPACE, ABOUT_RUN(w), "a job waits for space", why);
	else
		log_event_err(LOG_EVENT_JOB_AGAIN, ABOUT_RUN(w), "a job begins again: the cache was removed", why);
	return true;
}

bool run_space_waits(const struct run *w)
{
	return w->space.waits;
}

void run_space_give_up(struct run *w)
{
	w->space.waits = false;
	w->space.given_up = true;
}

/* It holds nothing, so this is the only place where it continues. */
void run_space_tick(struct run *w)
{
	struct run_space *s = &w->space;
	struct err why;
	uint64_t missing;

	if (!s->waits)
		return;
	if (w->client && s->missing && clock_since(s->since_ns) >= w->runs->core->p.limits.space_wait) {
		why = s->why;
		run_space_give_up(w);
		run_fail(w, &why);
		run_settle(w);
		return;
	}
	if (clock_since(s->checked_ns) < s->wait)
		return;
	s->checked_ns = clock_mono_ns();
	if (s->missing && !space_would_fit(w->runs->core->space, SPACE_TEMPORARY, s->need, &missing)) {
		s->missing = missing;
		if (w->calls->progressed)
			w->calls->progressed(w->ctx);
		return;
	}
	s->waits = false;
	s->resumed_ns = clock_mono_ns();
	slot_request(w->runs->admission, w->slot, 0);
}

uint64_t run_space_missing(const struct run *w)
{
	return w->space.waits ? w->space.missing : 0;
}

/* ---- space for its files ---- */

static int reserve(struct run *w, enum space_kind kind, uint64_t bytes, const char *what, struct err *err)
{
	int r = space_take(w->runs->core->space, kind, bytes, SPACE_MUST, what, err);

	if (r)
		atomic_store(&w->space.asked, bytes);
	return r;
}

/* For what earlier emissions have spilled, and as much again for the table to grow. */
int run_space_spill(struct run *w, struct err *err)
{
	uint64_t bytes = 2 * pipe_emitter_spilled(w->emitter);
	int r;

	if (bytes <= w->space.spilled)
		return 0;
	r = reserve(w, SPACE_TEMPORARY, bytes - w->space.spilled, "the table of unfinished vertices", err);
	if (!r)
		w->space.spilled = bytes;
	return r;
}

int run_space_spool(struct run *w, uint64_t bytes, struct err *err)
{
	int r = space_take(w->runs->core->space, SPACE_TEMPORARY, bytes, SPACE_MUST, "a block for a slow reader", err);

	if (!r)
		w->space.spooled = bytes;
	return r;
}

void run_space_unspool(struct run *w)
{
	if (w->space.spooled)
		space_give(w->runs->core->space, SPACE_TEMPORARY, w->space.spooled);
	w->space.spooled = 0;
}

void run_space_release(struct run *w)
{
	run_space_unspool(w);
	if (w->space.spilled)
		space_give(w->runs->core->space, SPACE_TEMPORARY, w->space.spilled);
	w->space.spilled = 0;
	if (w->space.holds)
		space_release(w->runs->core->space, w->select.key);
	w->space.holds = false;
}

/* ---- space in the store ---- */

static enum space_kind kind_of(const struct run *w, enum space_kind kind)
{
	return w->dataset->onestep ? SPACE_ONESTEP : kind;
}

bool run_space_domain(struct run *w, uint64_t bytes)
{
	struct err err = ERR_INIT;

	if (!space_take(w->runs->core->space, kind_of(w, SPACE_DOMAINS), bytes, SPACE_MAY, "a finished domain", &err))
		return true;
	if (!atomic_exchange(&w->space.reported, true))
		log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_RUN(w), "finished domains are not stored", &err);
	return false;
}

void run_space_stored(struct run *w, uint64_t taken, uint64_t bytes)
{
	space_commit(w->runs->core->space, kind_of(w, SPACE_DOMAINS), taken, bytes);
	if (w->dataset->onestep)
		atomic_fetch_add(&w->dataset->derived, bytes);
	else if (bytes)
		space_count_entries(w->runs->core->space, SPACE_DOMAINS, 1);
}

/* ---- space for a selection ---- */

#define SELECT_SECONDS 0.2

int run_space_select_begin(struct run *w, uint64_t memory, struct err *err)
{
	uint64_t most = grid_points(w->grid) * sizeof(struct point);
	int r;

	/* It is in memory at first, and written at the end. */
	w->space.selecting = most < memory ? most : memory;
	r = reserve(w, kind_of(w, SPACE_SELECTIONS), w->space.selecting, "the selection of points", err);
	if (r)
		w->space.selecting = 0;
	w->space.checked_ns = clock_mono_ns();
	return r;
}

/* What is there was counted when its last run ended, or the cache was measured. */
int run_space_part_begin(struct run *w, int parent, const char *name, struct err *err)
{
	uint64_t bytes = space_folder_bytes(parent, name);
	int r;

	run_space_select_hold(w);
	if (bytes && !w->dataset->onestep) {
		space_give(w->runs->core->space, SPACE_SELECTIONS, bytes);
		space_count_entries(w->runs->core->space, SPACE_SELECTIONS, -1);
	}
	w->space.selecting = bytes > UNKNOWN_BYTES ? bytes : UNKNOWN_BYTES;
	r = reserve(w, kind_of(w, SPACE_SELECTIONS), w->space.selecting, "the selection of points", err);
	if (r)
		w->space.selecting = 0;
	w->space.checked_ns = clock_mono_ns();
	return r;
}

/* Its runs exist twice while they are sealed. */
int run_space_select_grow(struct run *w, int parent, const char *name, bool sealed, struct err *err)
{
	uint64_t bytes;
	int r;

	if (!sealed && clock_since(w->space.checked_ns) < SELECT_SECONDS)
		return 0;
	w->space.checked_ns = clock_mono_ns();
	bytes = space_folder_bytes(parent, name) * (sealed ? 1 : 2);
	if (bytes <= w->space.selecting)
		return 0;
	r = reserve(w, kind_of(w, SPACE_SELECTIONS), bytes - w->space.selecting, "the selection of points", err);
	if (!r)
		w->space.selecting = bytes;
	return r;
}

void run_space_select_end(struct run *w, uint64_t bytes)
{
	/* At most what was reserved: it may have been evicted already. */
	bytes = bytes < w->space.selecting ? bytes : w->space.selecting;
	space_commit(w->runs->core->space, kind_of(w, SPACE_SELECTIONS), w->space.selecting, bytes);
	w->space.selecting = 0;
	if (bytes && w->dataset->onestep)
		atomic_fetch_add(&w->dataset->derived, bytes);
	else if (bytes)
		space_count_entries(w->runs->core->space, SPACE_SELECTIONS, 1);
}

void run_space_select_hold(struct run *w)
{
	if (!w->space.holds)
		space_hold(w->runs->core->space, w->select.key);
	w->space.holds = true;
}

char *run_space_text(const struct run *w, char *buf, size_t size)
{
	if (w->space.waits && w->space.missing)
		snprintf(buf, size, "waiting-space: %llu", (unsigned long long)w->space.missing);
	else if (w->space.waits)
		snprintf(buf, size, "the cache, which was removed");
	return buf;
}
