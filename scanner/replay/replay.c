/*
 * Records to telegrams to sweeps (replay.h). The counts here are those that `replay`, `record` and `push` report.
 *
 * Gaps: a record that reports missing bytes before the next DATA ends the framer's incomplete telegram. An event that
 * only concerns the host (parked, a stall that was cleared without loss) does not: if it lost bytes, the next record
 * has the flag AFTER_GAP.
 */
#include "replay.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "decoder.h"
#include "digest.h"
#include "err.h"
#include "profile.h"
#include "replay_time.h"
#include "spool.h"

struct replay {
	struct profile p;
	const struct decoder *decoder;
	struct replay_sinks sinks;
	struct framer *framer;
	struct sweep *sweep;
	struct replay_counts counts;
	struct replay_time time;
	bool has_counter, after_gap, gap_counted, ended;
	bool boot_unknown;  /* monotonic times may be of another boot, until a CLOCK comes */
	uint32_t counter;   /* of the last sweep */
	struct digest hash; /* of its telegram */
};

/* ---- sweeps ---- */

static void report_fault(struct replay *r, const struct replay_fault *f)
{
	if (r->sinks.fault)
		r->sinks.fault(r->sinks.ctx, f);
}

static void on_bad_telegram(void *ctx, enum framer_reason reason, uint64_t offset, uint64_t size)
{
	report_fault(ctx, &(struct replay_fault){.by = REPLAY_BAD_FRAMER, .reason = reason, .offset = offset, .size = size});
}

/* Counts the sweeps that were lost since the previous one. A counter that goes back, or far ahead, was restarted. One
 * that stays the same means a repeated telegram only if the bytes are the same, because some devices do not count. */
static void count_sweep(struct replay *r, const struct sweep *s, struct replay_sweep *to)
{
	struct digest hash = digest_hash(to->telegram->at, to->telegram->size);
	uint64_t turn = s->counter_bits && s->counter_bits < 32 ? UINT64_C(1) << s->counter_bits : UINT64_C(1) << 32, ahead;

	if (s->has_counter && r->has_counter) {
		ahead = (s->counter + turn - r->counter) % turn;
		if (!ahead) {
			to->repeated = hash.hi == r->hash.hi && hash.lo == r->hash.lo;
			r->counts.repeated += to->repeated;
		} else if (ahead <= turn / 2) {
			to->lost = ahead - 1;
			r->counts.lost += to->lost;
		} else {
			r->counts.restarts++;
			replay_time_restart(&r->time);
		}
	}
	r->has_counter = s->has_counter;
	r->counter = s->counter;
	r->hash = hash;
}

static void count_shots(struct replay *r, const struct sweep *s)
{
	r->counts.sweeps++;
	r->counts.shots += s->shots;
	r->counts.dirty += s->dirty;
	for (uint32_t i = 0; i < s->shots; i++)
		r->counts.returns += !isnan(s->range[i]);
	if (*s->device_serial)
		memcpy(r->counts.device_serial, s->device_serial, sizeof r->counts.device_serial);
}

static void count_time(struct replay *r, double utc_s)
{
	if (!r->counts.has_times)
		r->counts.first_utc_s = utc_s;
	r->counts.has_times = true;
	r->counts.last_utc_s = utc_s;
}

static int emit_sweep(struct replay *r, const struct telegram *t)
{
	struct replay_sweep to = {.sweep = r->sweep, .telegram = t, .after_gap = r->after_gap};

	to.utc_s = replay_time_of(&r->time, &r->p, r->sweep, t->first_ns, &to.device_time_s);
	if (r->time.restarted) { /* the device was restarted, and its counter, too */
		r->has_counter = false;
		r->counts.restarts++;
	}
	count_sweep(r, r->sweep, &to);
	count_shots(r, r->sweep);
	r->counts.device_span_s = r->time.span_s;
	count_time(r, to.utc_s);
	r->after_gap = false;
	return r->sinks.sweep ? r->sinks.sweep(r->sinks.ctx, &to) : 0;
}

static int emit_points(struct replay *r, const struct telegram *t)
{
	r->counts.points++;
	count_time(r, replay_time_utc(&r->time, t->first_ns));
	return r->sinks.points ? r->sinks.points(r->sinks.ctx, t) : 0;
}

static int on_telegram(void *ctx, const struct telegram *t)
{
	struct replay *r = ctx;
	struct err err = ERR_INIT;
	int rc = r->sinks.telegram ? r->sinks.telegram(r->sinks.ctx, t) : 0;

	if (rc)
		return rc;
	rc = r->decoder->decode ? r->decoder->decode(t->at, t->size, &r->p, r->sweep, &err) : 0;
	if (rc == DECODER_NOT_DATA) {
		r->counts.not_data++;
		return 0;
	}
	if (rc < 0) {
		r->counts.undecoded++;
		report_fault(r,
			     &(struct replay_fault){.by = REPLAY_BAD_DECODER, .offset = t->offset, .size = t->size, .err = &err});
		return 0;
	}
	return r->decoder->kind == DECODER_POINTS ? emit_points(r, t) : emit_sweep(r, t);
}

/* ---- records ---- */

struct replay_clock replay_clock_of(const struct spool_head *h)
{
	return (struct replay_clock){.utc_ns = h->utc_ns, .monotonic_ns = h->monotonic_ns};
}

int replay_new(const struct profile *p, const struct replay_clock *clock, const struct replay_sinks *sinks, struct replay **ret,
	       struct err *err)
{
	struct replay *r;
	int rc = decoder_check(p, err);

	if (rc < 0)
		return rc;
	r = calloc(1, sizeof *r);
	if (!r)
		return err_set(err, ERR_NOMEM, "no memory for a replay");
	r->p = *p;
	r->decoder = decoder_find(p->decoder);
	r->sinks = *sinks;
	r->sweep = sweep_new();
	if (!r->sweep)
		rc = err_set(err, ERR_NOMEM, "no memory for a sweep");
	else
		rc = framer_new(p, on_telegram, r, &r->framer, err);
	if (rc < 0) {
		replay_free(r);
		return rc;
	}
	framer_on_bad(r->framer, on_bad_telegram, r);
	replay_time_init(&r->time, clock);
	*ret = r;
	return 0;
}

struct replay *replay_free(struct replay *r)
{
	if (r) {
		framer_free(r->framer);
		sweep_free(r->sweep);
	}
	free(r);
	return NULL;
}

int replay_feed(struct replay *r, const void *at, size_t size, int64_t monotonic_ns)
{
	r->counts.transfers++;
	r->counts.bytes += size;
	r->gap_counted = false;
	return framer_feed(r->framer, at, size, monotonic_ns);
}

int replay_gap(struct replay *r)
{
	if (r->gap_counted) /* an event and the flag of the next record are the same gap */
		return 0;
	r->gap_counted = r->after_gap = true;
	r->counts.gaps++;
	return framer_gap(r->framer);
}

/* Whether the first word is one of these. */
static bool event_is(const struct spool_record *rec, const char *const *words)
{
	size_t n = 0;

	while (n < rec->size && rec->at[n] != ' ' && rec->at[n] != '\n')
		n++;
	for (; *words; words++)
		if (strlen(*words) == n && !memcmp(rec->at, *words, n))
			return true;
	return false;
}

static int on_event(struct replay *r, const struct spool_record *rec)
{
	static const char *const gaps[] = {"overflow", "overrun", "left", "back", "error", "continued", NULL},
				 *const anew[] = {"left", "back", "continued", NULL}, *const continued[] = {"continued", NULL};

	r->boot_unknown |= event_is(rec, continued);
	if (event_is(rec, anew)) { /* its clock and counter may have been restarted */
		r->has_counter = false;
		replay_time_restart(&r->time);
	}
	return event_is(rec, gaps) ? replay_gap(r) : 0;
}

/* What came before the clock was set keeps its time. */
static void set_clock(struct replay *r, const struct replay_clock *clock)
{
	double by = (double)clock->utc_ns / 1e9 - replay_time_utc(&r->time, clock->monotonic_ns);

	if (!r->boot_unknown && fabs(by) > REPLAY_CLOCK_SET_S) {
		r->counts.clock_sets++;
		r->counts.clock_moved_s += by;
		r->counts.clock_most_s = fmax(r->counts.clock_most_s, fabs(by));
	}
	r->boot_unknown = false;
	replay_time_clock(&r->time, clock);
}

int replay_record(struct replay *r, const struct spool_record *rec)
{
	int rc = 0;

	r->counts.records++;
	switch (rec->kind) {
	case SPOOL_DATA:
		if (rec->flags & SPOOL_AFTER_GAP)
			rc = replay_gap(r);
		return rc ? rc : replay_feed(r, rec->at, rec->size, rec->time_ns);
	case SPOOL_EVENT:
		return on_event(r, rec);
	case SPOOL_CLOCK:
		if (rec->size >= 8) {
			struct cursor c = cursor_of(rec->at, 8);
			struct replay_clock clock = {.utc_ns = cursor_i64(&c), .monotonic_ns = rec->time_ns};

			set_clock(r, &clock);
		}
		return 0;
	case SPOOL_END:
		return replay_end(r);
	case SPOOL_SENT:
		break;
	}
	return 0;
}

int replay_end(struct replay *r)
{
	if (r->ended)
		return 0;
	r->ended = true;
	return framer_end(r->framer);
}

void replay_counts(const struct replay *r, struct replay_counts *ret)
{
	*ret = r->counts;
	framer_counts(r->framer, &ret->framer);
}
