/* Replay: records to sweeps; sweeps that the device lost, repeated telegrams, gaps, and the time of each sweep. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "cola_make.h"
#include "decoder.h"
#include "err.h"
#include "profile.h"
#include "replay.h"
#include "spool.h"

enum { SWEEPS = 4000 };

struct seen {
	unsigned sweeps, faults, telegrams, points, framer_faults;
	double utc[SWEEPS], device[SWEEPS];
	uint64_t lost;
	bool repeated, after_gap;
	char sentence[600];
	int answer;
};

static int on_sweep(void *ctx, const struct replay_sweep *s)
{
	struct seen *seen = ctx;

	if (seen->sweeps < SWEEPS) {
		seen->utc[seen->sweeps] = s->utc_s;
		seen->device[seen->sweeps] = s->device_time_s;
	}
	seen->sweeps++;
	seen->lost = s->lost;
	seen->repeated = s->repeated;
	seen->after_gap = s->after_gap;
	return seen->answer;
}

static int on_telegram(void *ctx, const struct telegram *t)
{
	((struct seen *)ctx)->telegrams++;
	return 0;
}

static int on_points(void *ctx, const struct telegram *t)
{
	((struct seen *)ctx)->points++;
	return 0;
}

static void on_fault(void *ctx, const struct replay_fault *f)
{
	struct seen *s = ctx;

	s->faults++;
	s->framer_faults += f->by == REPLAY_BAD_FRAMER;
	snprintf(s->sentence, sizeof s->sentence, "%s %llu+%llu", f->err ? f->err->message : framer_reason_name(f->reason),
		 (unsigned long long)f->offset, (unsigned long long)f->size);
}

struct scene {
	struct replay *replay;
	struct profile p;
	struct seen seen;
	struct cola_scan scan;
	uint64_t seq;
	int64_t now; /* monotonic */
	uint8_t telegram[COLA_TELEGRAM_MAX];
	size_t size;
};

static const int64_t UTC = 1700000000000000000, BOOT = 5000000000;

static struct scene *scene_new(const char *profile)
{
	struct scene *s = calloc(1, sizeof *s);
	struct replay_clock clock = {.utc_ns = UTC, .monotonic_ns = BOOT};
	struct replay_sinks sinks = {&s->seen, on_telegram, on_sweep, on_points, on_fault};
	struct err err = ERR_INIT;

	s->now = BOOT;
	cola_scan_tim551(&s->scan);
	if (profile_parse(profile, strlen(profile), "p", "p.conf", &s->p, &err) < 0 ||
	    replay_new(&s->p, &clock, &sinks, &s->replay, &err) < 0)
		fail_msg("%s", err.message);
	return s;
}

static void scene_free(struct scene *s)
{
	replay_free(s->replay);
	free(s);
}

static int record(struct scene *s, enum spool_kind kind, unsigned flags, const void *at, size_t size)
{
	struct spool_record r = {.kind = kind, .flags = flags, .seq = s->seq++, .time_ns = s->now, .at = at, .size = size};

	return replay_record(s->replay, &r);
}

static void event(struct scene *s, const char *text)
{
	assert_int_equal(record(s, SPOOL_EVENT, 0, text, strlen(text)), 0);
}

static void make(struct scene *s, uint32_t i)
{
	cola_scan_step(&s->scan, i);
	s->size = cola_make(&s->scan, s->telegram, sizeof s->telegram);
	assert_true(s->size > 0);
}

static void send(struct scene *s, uint32_t i)
{
	make(s, i);
	assert_int_equal(record(s, SPOOL_DATA, 0, s->telegram, s->size), 0);
}

static struct replay_counts counts(struct scene *s)
{
	struct replay_counts c;

	replay_counts(s->replay, &c);
	return c;
}

static const char arrival[] = "[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\nstamp = last\n[time]\nlatency = 0.25\n";
static const char device[] =
	"[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\nstamp = last\n[time]\nsource = device\nlatency = 0.25\n";

static void test_counts(void **state)
{
	struct scene *s = scene_new(arrival);
	struct replay_counts c;

	s->scan.status[1] = 2;
	for (uint32_t i = 0; i < 10; i++, s->now += 66666667) {
		make(s, i < 6 ? i : i + 3);
		if (i == 4)
			s->telegram[40] = 'Q';
		if (i == 8) /* divided by the bus, and nothing is missing */
			assert_int_equal(record(s, SPOOL_DATA, SPOOL_SHORT, s->telegram, 100) |
						 record(s, SPOOL_DATA, 0, s->telegram + 100, s->size - 100),
					 0);
		else
			assert_int_equal(record(s, SPOOL_DATA, 0, s->telegram, s->size), 0);
		if (i == 6)
			assert_int_equal(s->seen.lost, 3);
		event(s, "parked 100");
	}
	assert_int_equal(record(s, SPOOL_SENT, 0, "\2sEN\3", 5), 0);
	assert_int_equal(record(s, SPOOL_DATA, 0, "\2sEA LMDscandata 1\3", 19), 0);
	assert_int_equal(record(s, SPOOL_END, 0, "", 0), 0);
	assert_int_equal(replay_end(s->replay), 0);
	c = counts(s);
	assert_int_equal(s->seen.sweeps, 9);
	assert_int_equal(s->seen.telegrams, 11);
	assert_string_equal(s->seen.sentence, "not as the layout of LMDscandata has it, before this byte 4868+1216");
	assert_true(c.sweeps == 9 && c.dirty == 9 && c.shots == 9 * 271 && c.returns > 2000 && c.returns < c.shots);
	assert_true(c.lost == 4 && c.repeated == 0 && c.undecoded == 1 && c.not_data == 1 && c.gaps == 0 && c.restarts == 0);
	assert_true(c.records == 24 && c.transfers == 12 && c.bytes == c.framer.bytes && c.framer.skipped == 0);
	assert_string_equal(c.device_serial, "17271466");
	scene_free(s);
}

/* The effect of each kind of record on an incomplete telegram. */
static void test_gaps(void **state)
{
	static const struct {
		const char *event;
		unsigned flags;
		int gap;
	} rows[] = {
		{"overflow 600", 0, 1},
		{"overrun", 0, 1},
		{"left", 0, 1},
		{"back", 0, 1},
		{"error x", 0, 1},
		{"overflow 1", SPOOL_AFTER_GAP, 1},
		{NULL, SPOOL_AFTER_GAP, 1},
		{"parked 5", 0, 0},
		{"stall", 0, 0},
		{"cleared", 0, 0},
		{"overflowing", 0, 0},
		{NULL, SPOOL_SHORT, 0},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct scene *s = scene_new(arrival);

		send(s, 1);
		make(s, 2);
		assert_int_equal(record(s, SPOOL_DATA, 0, s->telegram, 300), 0);
		if (rows[i].event)
			event(s, rows[i].event);
		assert_int_equal(record(s, SPOOL_DATA, rows[i].flags, s->telegram + 300, s->size - 300), 0);
		send(s, 3);
		assert_int_equal(s->seen.sweeps, rows[i].gap ? 2 : 3);
		assert_int_equal(s->seen.after_gap, rows[i].gap);
		assert_int_equal(counts(s).gaps, rows[i].gap);
		assert_int_equal(counts(s).framer.by[FRAMER_GAP], rows[i].gap);
		assert_int_equal(counts(s).lost, rows[i].gap && !(rows[i].event && strstr("left back", rows[i].event)));
		scene_free(s);
	}
}

static void test_counter(void **state)
{
	struct scene *s = scene_new(arrival);

	send(s, 65535);
	s->now += 66666667;
	send(s, 65536); /* its counter is 0 again */
	assert_int_equal(counts(s).lost, 0);
	send(s, 65536);
	assert_true(s->seen.repeated && counts(s).repeated == 1);
	/* the same number, other bytes: it does not count */
	make(s, 65536);
	for (uint8_t *at = s->telegram + s->size / 2; *at != ' '; at++)
		*at = '1';
	assert_int_equal(record(s, SPOOL_DATA, 0, s->telegram, s->size), 0);
	assert_true(!s->seen.repeated && counts(s).repeated == 1 && counts(s).lost == 0 && counts(s).undecoded == 0);
	s->now += 66666667;
	send(s, 0); /* its clock went back: it was restarted */
	assert_true(counts(s).restarts == 1 && counts(s).lost == 0);
	event(s, "left");
	event(s, "back");
	send(s, 500);
	assert_true(counts(s).restarts == 1 && counts(s).lost == 0 && counts(s).gaps == 1);
	scene_free(s);
}

/* ARRIVAL: the transfer that began the telegram, minus latency and sweep; the wall clock as set by the records. */
static void test_arrival(void **state)
{
	struct scene *s = scene_new(arrival);
	uint8_t clock[8];
	int64_t utc = UTC + 100000000000;

	make(s, 1);
	s->now = BOOT + 2000000000;
	assert_int_equal(record(s, SPOOL_DATA, 0, s->telegram, 10), 0);
	s->now += 7000000;
	assert_int_equal(record(s, SPOOL_DATA, 0, s->telegram + 10, s->size - 10), 0);
	assert_true(fabs(s->seen.utc[0] - (UTC / 1e9 + 2 - 0.25 - 0.05)) < 1e-6);
	for (int i = 0; i < 8; i++)
		clock[i] = (uint8_t)((uint64_t)utc >> 8 * i);
	assert_int_equal(record(s, SPOOL_CLOCK, 0, clock, 8), 0);
	assert_int_equal(record(s, SPOOL_CLOCK, 0, clock, 3), 0);
	s->now += 1000000000;
	send(s, 2);
	assert_true(fabs(s->seen.utc[1] - (utc / 1e9 + 1 - 0.25 - 0.05)) < 1e-6);
	/* the clock was set by the difference to the elapsed time; not by the same value ten seconds later, nor if the
	 * boot may be another one */
	assert_true(counts(s).clock_sets == 1 &&
		    fabs(counts(s).clock_moved_s - (100 - (double)(s->now - 1000000000 - BOOT) / 1e9)) < 1e-6);
	for (int k = 0; k < 2; k++) {
		s->now += 10000000000 - (k ? 0 : 1000000000);
		utc += 10000000000 + (k ? 500000000000 : 0);
		for (int i = 0; i < 8; i++)
			clock[i] = (uint8_t)((uint64_t)utc >> 8 * i);
		if (k)
			event(s, "continued -");
		assert_int_equal(record(s, SPOOL_CLOCK, 0, clock, 8), 0);
		assert_int_equal(counts(s).clock_sets, 1);
	}
	scene_free(s);
}

/* DEVICE: telegrams are up to 80 ms late, and the times are correct to half a millisecond, over a wrap of the device's
 * clock, with an oscillator that is 50 ppm off. */
static void test_device(void **state)
{
	struct scene *s = scene_new(device);
	unsigned seed = 1, first = 64000; /* the 32-bit clock wraps after 64410 sweeps */
	double worst = 0, begun = 0;

	for (unsigned i = 0; i < SWEEPS; i++) {
		double true_s = i / 15.0 * (1 + 50e-6), late;

		seed = seed * 1664525 + 1013904223;
		late = seed >> 30 == 0 ? 0 : (seed >> 8) % 80000 * 1e-6;
		s->now = BOOT + (int64_t)((true_s + 0.25 + late) * 1e9); /* of the last shot */
		make(s, first + i);
		assert_int_equal(record(s, SPOOL_DATA, 0, s->telegram, s->size), 0);
		if (i == 100)
			begun = s->seen.device[i];
		if (i >= 100)
			worst = fmax(worst, fabs(s->seen.utc[i] - (UTC / 1e9 + true_s - 0.05)));
	}
	print_message("worst %.3g ms\n", worst * 1e3);
	assert_true(worst < 0.5e-3);
	assert_true(fabs(s->seen.device[SWEEPS - 1] - begun - (SWEEPS - 101) / 15.0) < 1e-3);
	assert_true(fabs(counts(s).device_span_s - (SWEEPS - 1) / 15.0) < 1e-3);
	assert_true(counts(s).lost == 0 && counts(s).restarts == 0);
	/* unplugged for two hours, and its clock starts at zero */
	event(s, "left");
	s->now += 7200000000000;
	event(s, "back");
	s->seen.sweeps = 0;
	send(s, 0);
	assert_true(fabs(s->seen.utc[0] - (UTC / 1e9 + (s->now - BOOT) / 1e9 - 0.25 - 0.05)) < 1e-6);
	/* silent for three periods of its clock */
	s->now += (int64_t)(3 * 4294.967296e9) + 1000000000;
	send(s, 15);
	assert_true(fabs(s->seen.device[1] - s->seen.device[0] - 3 * 4294.967296 - 1) < 1e-3);
	assert_int_equal(counts(s).restarts, 0);
	scene_free(s);
}

static void test_points(void **state)
{
	struct scene *s = scene_new("[framer]\nkind = line\n[decoder]\nname = xyz\n");
	struct replay_counts c;

	assert_int_equal(record(s, SPOOL_DATA, 0, "x y z\n1 2 3\n4 5", 15), 0);
	assert_int_equal(record(s, SPOOL_DATA, 0, " 6\n7 8\n9 9 9", 12), 0);
	assert_int_equal(replay_end(s->replay), 0);
	c = counts(s);
	assert_true(s->seen.points == 3 && c.points == 3 && c.not_data == 1 && c.undecoded == 1 && c.has_times);
	assert_string_equal(s->seen.sentence, "ends before column z 18+3");
	scene_free(s);
}

static void test_stop(void **state)
{
	struct scene *s = scene_new(arrival);

	s->seen.answer = -7;
	make(s, 1);
	assert_int_equal(record(s, SPOOL_DATA, 0, s->telegram, s->size), -7);
	scene_free(s);
}

static void test_no_decoder(void **state)
{
	struct profile p;
	struct replay_clock clock = {0};
	struct replay_sinks sinks = {0};
	struct replay *r;
	struct err err = ERR_INIT;

	assert_int_equal(profile_parse("[decoder]\nname = tim\n", 21, "p", "p.conf", &p, &err), 0);
	assert_int_equal(replay_new(&p, &clock, &sinks, &r, &err), -ERR_INPUT);
	assert_non_null(strstr(err.message, "no decoder tim"));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_counts),  cmocka_unit_test(test_gaps),       cmocka_unit_test(test_counter),
		cmocka_unit_test(test_arrival), cmocka_unit_test(test_device),     cmocka_unit_test(test_points),
		cmocka_unit_test(test_stop),    cmocka_unit_test(test_no_decoder),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
