/*
 * replay: reads spools again. Always all of it is checked: records, the hash of the END record, telegrams, sweeps. Damage is
 * reported with its place and skipped; it never ends a replay, since field data cannot be recorded again.
 *
 * Raw bytes need no profile, so that a spool with a broken profile still gives them.
 */
#include "scan_replay.h"

#include <errno.h>
#include <fcntl.h>
#include <nettle/sha2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"
#include "decoder.h"
#include "parse.h"

enum { LOOK_EVERY = 256, PIPE = 141 };

struct run {
	struct program *args;
	struct scan_found *found;
	struct scan_out *out;
	struct spool_reader *reader;
	struct replay *replay; /* NULL: raw bytes only */
	struct replay_clock clock;
	struct sha256_ctx sha;
	uint64_t shown; /* when progress was */
	uint64_t size;  /* of the file; 0: not known */
};

/* ---- sinks ---- */

static int on_telegram(void *ctx, const struct telegram *t)
{
	struct run *r = ctx;
	double utc = r->clock.utc_ns / 1e9 + (double)(t->first_ns - r->clock.monotonic_ns) / 1e9;

	return scan_out_to(r->out) == SCAN_TO_TELEGRAMS ? scan_out_telegram(r->out, t, utc) : 0;
}

static int on_sweep(void *ctx, const struct replay_sweep *s)
{
	struct run *r = ctx;
	enum scan_to to = scan_out_to(r->out);

	return to == SCAN_TO_SWEEPS || to == SCAN_TO_CSV ? scan_out_sweep(r->out, s) : 0;
}

static int on_points(void *ctx, const struct telegram *t)
{
	struct run *r = ctx;

	return scan_out_to(r->out) == SCAN_TO_POINTS ? scan_out_points(r->out, &r->found->profile, t) : 0;
}

static void add_fault(struct scan_found *f, uint64_t offset, uint64_t size, const char *text)
{
	struct scan_fault *to = f->n_faults < SCAN_FAULTS ? &f->faults[f->n_faults] : NULL;

	f->n_faults++;
	if (!to)
		return;
	to->offset = offset;
	to->size = size;
	snprintf(to->text, sizeof to->text, "%.150s", text);
}

static void on_fault(void *ctx, const struct replay_fault *fault)
{
	struct run *r = ctx;

	char text[200];

	if (fault->err && fault->err->offset != ERR_NO_OFFSET) /* of the telegram, as --to telegrams gives it */
		snprintf(text, sizeof text, "%.120s (byte %lld of it)", fault->err->message, (long long)fault->err->offset);
	else
		snprintf(text, sizeof text, "%.150s", fault->err ? fault->err->message : framer_reason_name(fault->reason));
	add_fault(r->found, fault->offset, fault->size, text);
	if (fault->by == REPLAY_BAD_FRAMER && fault->reason != FRAMER_GARBAGE)
		scan_out_broken(r->out);
}

/* ---- records ---- */

static void count_event(struct scan_found *f, const struct spool_record *rec)
{
	char word[sizeof f->events[0].word];
	size_t n = 0, i;

	while (n < rec->size && n + 1 < sizeof word && rec->at[n] > ' ' && rec->at[n] <= '~')
		n++;
	memcpy(word, rec->at, n);
	word[n] = '\0';
	for (i = 0; i < f->n_events && strcmp(f->events[i].word, word); i++)
		;
	if (i == SCAN_EVENTS)
		i--; /* the last counts all others */
	if (i == f->n_events) {
		memcpy(f->events[i].word, i + 1 == SCAN_EVENTS ? "others" : word, i + 1 == SCAN_EVENTS ? 7 : n + 1);
		f->n_events++;
	}
	f->events[i].n++;
}

static void hex(const uint8_t *at, char to[65])
{
	for (int i = 0; i < 32; i++)
		sprintf(to + 2 * i, "%02x", at[i]);
}

static void hash_so_far(const struct run *r, char to[65])
{
	struct sha256_ctx copy = r->sha;
	uint8_t digest[SHA256_DIGEST_SIZE];

	sha256_digest(&copy, sizeof(digest), digest);
	hex(digest, to);
}

static void check_end(struct run *r, const struct spool_record *rec)
{
	struct spool_totals totals;
	struct err err = ERR_INIT;
	char said[65], is[65];

	if (spool_totals_read(rec, &totals, &err))
		return;
	hex(totals.sha256, said);
	hash_so_far(r, is);
	r->found->sha_differs = strcmp(said, is) != 0;
}

static int take(struct run *r, const struct spool_record *rec)
{
	struct scan_found *f = r->found;

	f->records++;
	if (rec->kind == SPOOL_DATA) {
		if (!f->transfers++)
			f->first_ns = rec->time_ns;
		f->last_ns = rec->time_ns;
		f->bytes += rec->size;
		sha256_update(&r->sha, rec->size, rec->at);
		if (scan_out_to(r->out) == SCAN_TO_RAW && scan_out_raw(r->out, rec->at, rec->size))
			return -1;
	} else if (rec->kind == SPOOL_EVENT) {
		count_event(f, rec);
	} else if (rec->kind == SPOOL_END) {
		check_end(r, rec);
	}
	return r->replay ? replay_record(r->replay, rec) : 0;
}

static void show(struct run *r, const struct spool_record *rec)
{
	char done[32], all[32];

	if (!console_progress_on(&r->args->console) || clock_since(r->shown) < 0.2)
		return;
	r->shown = clock_mono_ns();
	console_progress(&r->args->console, "%s: %s of %s", r->found->file, parse_size_text(rec->offset, done),
			 parse_size_text(r->size, all));
}

/* 0; -1: scan_out has the error. */
static int go_over(struct run *r, struct err *err)
{
	struct spool_record rec;
	uint64_t skipped;
	int rc;

	for (;;) {
		rc = spool_next(r->reader, &rec, err);
		if (rc == -ERR_INPUT) {
			add_fault(r->found, err->offset, 0, err->message);
			r->found->damaged++;
			err_clear(err);
			if ((rc = spool_skip(r->reader, &skipped, err)))
				return rc;
			r->found->damaged_bytes += skipped;
			if (r->replay && (rc = replay_gap(r->replay)))
				return rc;
			continue;
		}
		if (rc <= 0)
			return rc;
		if ((rc = take(r, &rec)))
			return rc;
		if (r->found->records % LOOK_EVERY)
			continue;
		if (scan_stopped())
			return err_set(err, ERR_CANCELLED, "interrupted");
		show(r, &rec);
	}
}

/* ---- a spool ---- */

static int open_reader(struct run *r, const char *file, struct err *err)
{
	int fd = open(file, O_RDONLY | O_CLOEXEC), rc;

	if (fd < 0) {
		rc = err_sys(err, errno, "it cannot be opened");
		err_add_file(err, file);
		return rc;
	}
	r->size = (uint64_t)lseek(fd, 0, SEEK_END);
	lseek(fd, 0, SEEK_SET);
	return spool_open(fd, file, &r->reader, err);
}

/* Without a profile only raw bytes are there; any other request fails. */
static int open_replay(struct run *r, struct err *err)
{
	struct replay_sinks sinks = {r, on_telegram, on_sweep, on_points, on_fault};
	struct scan_found *f = r->found;
	struct scan_spool spool;
	enum scan_to to = scan_out_to(r->out);
	int rc;

	f->why = ERR_INIT;
	rc = scan_spool_open(r->args, f->file, &spool, &f->why);
	if (!rc) {
		f->profile = spool.profile;
		r->clock = replay_clock_of(&spool.head);
		rc = replay_new(&f->profile, &r->clock, &sinks, &r->replay, &f->why);
		f->head = spool.head;
		spool.head.profile = NULL;
		scan_spool_clear(&spool);
	}
	f->decoded = !rc;
	if (rc && (to > SCAN_TO_RAW || r->args->profile)) {
		*err = f->why;
		return rc;
	}
	if (!rc && to == SCAN_TO_POINTS && decoder_find(f->profile.decoder)->kind != DECODER_POINTS) {
		err_set(err, ERR_USAGE, "decoder %s gives sweeps, not points", f->profile.decoder);
		return err_add_hint(err,
				    "push --pose puts sweeps on the ground; --to sweeps and --to csv write them as they are");
	}
	if (!rc && (to == SCAN_TO_SWEEPS || to == SCAN_TO_CSV) && decoder_find(f->profile.decoder)->kind != DECODER_SWEEP)
		return err_set(err, ERR_USAGE, "decoder %s gives points, not sweeps: --to points", f->profile.decoder);
	return 0;
}

static int run_spool(struct run *r, struct err *err)
{
	struct scan_found *f = r->found;
	uint64_t start = clock_mono_ns();
	int rc = open_reader(r, f->file, err);

	if (!rc)
		rc = open_replay(r, err);
	sha256_init(&r->sha);
	if (!rc)
		rc = go_over(r, err);
	if (!rc && r->replay)
		rc = replay_end(r->replay);
	if (!rc) {
		hash_so_far(r, f->sha256);
		spool_tail(r->reader, &f->tail);
		if (r->replay)
			replay_counts(r->replay, &f->counts);
		f->seconds = clock_since(start);
	}
	replay_free(r->replay);
	spool_reader_free(r->reader);
	return rc;
}

/* Status of a spool that was gone over. */
static int judge(struct program *args, const struct scan_found *f)
{
	if (!f->damaged && !f->sha_differs)
		return 0;
	console_warn(&args->console, "%s: %s", f->file,
		     f->damaged ? "records in its middle are damaged" : "its bytes are not those of the hash at its end");
	return err_exit_status(ERR_CORRUPT);
}

int scan_replay(struct program *args)
{
	struct scan_out *out = NULL;
	struct err err = ERR_INIT;
	int status = 0, rc = scan_out_new(args, &out, &err);

	if (args->to && !args->output)
		args->console.report = stderr; /* standard output is taken */
	for (size_t i = 0; !rc && i < args->line.nword; i++) {
		struct scan_found *f = calloc(1, sizeof *f);
		struct run r = {.args = args, .found = f, .out = out};
		int bad;

		if (!f) {
			rc = err_set(&err, ERR_NOMEM, "no memory for a replay");
			break;
		}
		f->file = args->line.word[i];
		rc = run_spool(&r, &err);
		console_progress_clear(&args->console);
		if (!rc) {
			scan_replay_report(args, f);
			bad = judge(args, f);
			status = status ? status : bad;
		}
		spool_head_clear(&f->head);
		free(f);
	}
	if (out && scan_out_free(out, !rc, &err) < 0)
		rc = -1;
	if (rc && err.sys == EPIPE) /* the reader has enough */
		return PIPE;
	return rc ? scan_fail(args, &err) : status;
}
