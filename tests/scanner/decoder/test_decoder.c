/* Families: what was encoded is decoded; a changed telegram is invalid or another sweep; nothing else happens. */
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

static struct profile profile_of(const char *text)
{
	struct profile p;
	struct err err = ERR_INIT;

	if (profile_parse(text, strlen(text), "test", "test.conf", &p, &err) < 0 || decoder_check(&p, &err) < 0)
		fail_msg("%s: %s", text, err.message);
	return p;
}

static const char cola[] = "[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\n";

/* Without STX and ETX. In a copy of its exact size, so that a sanitizer sees an access beyond the end. */
static int decode(const struct profile *p, const uint8_t *at, size_t size, struct sweep *s, struct err *err)
{
	uint8_t *copy = malloc(size + !size);
	int rc;

	memcpy(copy, at, size);
	*err = ERR_INIT;
	rc = decoder_find(p->decoder)->decode(copy, size, p, s, err);
	if (rc < 0 && (rc != -ERR_INPUT || !*err->message || err->offset > size))
		fail_msg("%d %s", rc, err->message);
	free(copy);
	return rc;
}

static int decode_text(const struct profile *p, const char *text, struct sweep *s, struct err *err)
{
	return decode(p, (const uint8_t *)text, strlen(text), s, err);
}

/* ---- CoLa-A ---- */

static void check_scan(const struct cola_scan *c, const struct sweep *s, double ahead)
{
	float scale, offset;
	char serial[32];

	memcpy(&scale, &c->scale, 4);
	memcpy(&offset, &c->offset, 4);
	snprintf(serial, sizeof serial, "%.8u", c->serial);
	assert_string_equal(s->device_serial, serial);
	assert_int_equal(s->shots, c->shots);
	assert_int_equal(s->dirty, c->status[0] || c->status[1]);
	assert_true(s->has_counter && s->counter == c->telegram_counter && s->counter_bits == 16);
	assert_true(s->has_device_time && fabs(s->device_time_s - c->since_start_us / 1e6) < 1e-9);
	assert_true(fabs(s->first - (c->start_angle / 10000.0 - ahead) * M_PI / 180) < 1e-12);
	assert_true(fabs(s->period_s - 100.0 / c->scan_frequency) < 1e-12);
	for (unsigned i = 0; i < c->shots; i++) {
		float v = (c->range[i] * scale + offset) / 1000;

		if (c->range[i] < 16 || v <= 0)
			assert_true(isnan(s->range[i]));
		else
			assert_true(fabsf(s->range[i] - v) <= 1e-6F * v);
		if (!c->rssi_bits)
			assert_true(isnan(s->intensity[i]));
		else
			assert_true(fabsf(s->intensity[i] - (float)c->rssi[i] / (c->rssi_bits == 8 ? 255 : 65535)) < 1e-6F);
	}
}

static unsigned rnd(unsigned *seed)
{
	return (*seed = *seed * 1664525 + 1013904223) >> 8;
}

/* All forms of the telegram: firmwares, encoders, channels, optional blocks. */
static void test_cola_made(void **state)
{
	static const char *const texts[] = {NULL, "", "a", "not defined", "two  blanks ", "12345678 1 0 0 0"};
	static struct cola_scan c;
	static uint8_t bytes[COLA_TELEGRAM_MAX];
	struct profile p = profile_of(cola);
	struct sweep *s = sweep_new();
	struct err err;
	unsigned seed = 3;

	for (unsigned i = 0; i < 600; i++) {
		size_t n;

		cola_scan_tim551(&c);
		c.answer = i % 2;
		c.early = i % 3 == 0;
		c.encoders = rnd(&seed) % 4;
		c.rssi_bits = rnd(&seed) % 3 * 8;
		c.second_echo = rnd(&seed) % 2;
		c.position = rnd(&seed) % 2;
		c.time = rnd(&seed) % 2;
		c.name = texts[rnd(&seed) % 6];
		c.comment = texts[rnd(&seed) % 6];
		c.serial = rnd(&seed) * 77;
		c.status[1] = rnd(&seed) % 3;
		c.shots = (uint16_t)(i < 5 ? i + 1 : rnd(&seed) % 1200 + 1);
		c.step = (uint16_t)(rnd(&seed) % 9999 + 1);
		c.start_angle = (int32_t)(rnd(&seed) % 3600000) - 1800000;
		c.scan_frequency = rnd(&seed) % 20000 + 50;
		c.scale = i % 5 ? 0x3F800000 : 0x40000000;
		c.offset = i % 7 ? 0 : 0xC1200000; /* -10 */
		cola_scan_step(&c, rnd(&seed));
		n = cola_make(&c, bytes, sizeof bytes);
		assert_true(n > 2);
		if (decode(&p, bytes + 1, n - 2, s, &err))
			fail_msg("%u: %s at %llu: %.*s", i, err.message, (unsigned long long)err.offset, (int)n, bytes);
		check_scan(&c, s, 90);
		c.step = 10000;
	}
	sweep_free(s);
}

static void test_cola_angles(void **state)
{
	static const struct {
		uint16_t raw;
		double degrees;
	} steps[] = {
		{10000, 1},      {5000, 0.5},     {3333, 1 / 3.0}, {3334, 1 / 3.0}, {3332, 0.3332},  {1667, 1 / 6.0},
		{1666, 1 / 6.0}, {833, 1 / 12.0}, {2500, 0.25},    {1, 0.0001},     {65535, 6.5535},
	};
	static struct cola_scan c;
	static uint8_t bytes[COLA_TELEGRAM_MAX];
	struct profile p = profile_of(cola);
	struct sweep *s = sweep_new();
	struct err err;
	size_t n;

	cola_scan_tim551(&c);
	c.shots = 811;
	for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
		c.step = steps[i].raw;
		n = cola_make(&c, bytes, sizeof bytes);
		assert_int_equal(decode(&p, bytes + 1, n - 2, s, &err), 0);
		assert_true(fabs(s->step - steps[i].degrees * M_PI / 180) < 1e-12);
	}
	/* 811 shots of a third of a degree are from 135 degrees right to 135 left */
	c.step = 3333;
	n = cola_make(&c, bytes, sizeof bytes);
	assert_int_equal(decode(&p, bytes + 1, n - 2, s, &err), 0);
	assert_true(fabs(s->first + 135 * M_PI / 180) < 1e-9 && fabs(s->first + 810 * s->step - 135 * M_PI / 180) < 1e-9);
	assert_true(fabs(sweep_duration(s) - 0.75 / 15) < 1e-9);
	p.angle_ahead = 0;
	p.stamp = PROFILE_STAMP_LAST;
	c.since_start_us = 2000000;
	n = cola_make(&c, bytes, sizeof bytes);
	assert_int_equal(decode(&p, bytes + 1, n - 2, s, &err), 0);
	assert_true(fabs(s->first + 45 * M_PI / 180) < 1e-9);
	assert_true(fabs(s->device_time_s - (2 - 0.05)) < 1e-9);
	sweep_free(s);
}

/* Written by hand after telegrams of real scanners. */
static void test_cola_texts(void **state)
{
	static const struct {
		const char *text;
		int rc;
	} rows[] = {
		{"sSN LMDscandata 1 1 1078AAA 0 0 BFD BFF CFACE0D CFAE156 0 0 1 0 0 5DC A2 0 1 DIST1 3F800000 00000000 FFF92230 D05 3 32B 0 FFFF 0 0 1 B not defined 0 0 0",
		 0},
		{"sRA LMDscandata 1 1 89A27F 0 0 343 347 27477BA9 2747813B 0 0 7 0 0 1388 168 0 1 DIST1 3F800000 00000000 186A0 1388 2 8A1 8A5 0 0 0 0 0 0",
		 0},
		{"sSN LMDscandata 1 1 89A27F 0 0 343 347 1 2 0 0 7 0 0 1388 168 1 0 3E8 1 DIST1 3F800000 0 186A0 1388 2 8A1 8A5 0 0 0 0 0 0",
		 0},
		/* nothing after the channels; an event; a time, twice with two words missing */
		{"sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 0 1 DIST1 3F800000 0 186A0 1388 1 8A1 0", 0},
		{"sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 0 1 DIST1 3F800000 0 186A0 1388 1 8A1 0 0 0 0 0 1 3 FF",
		 0},
		{"sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 0 1 RSSI1 3F800000 0 186A0 1388 1 8A1 0",
		 DECODER_NOT_DATA},
		{"sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 0 0 0 0 0 0 0 0", DECODER_NOT_DATA},
		{"sEA LMDscandata 1", DECODER_NOT_DATA},
		{"sFA 3", DECODER_NOT_DATA},
		{"sAN", DECODER_NOT_DATA},
		{"sSN LMDscandatamon 1 1", DECODER_NOT_DATA},
		{"", -ERR_INPUT},
		{"s", -ERR_INPUT},
		{"hello", -ERR_INPUT},
		{"sEA \x01", -ERR_INPUT},
		{"sSN LMDscandata ", -ERR_INPUT},
		{"sSN LMDscandata 1 1", -ERR_INPUT},
		{"sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 0 1",
		 -ERR_INPUT}, /* a channel is announced, and missing */
			      /* as the first valid one, except: */
#define HEAD "sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 0 1 DIST1 "
		{HEAD "7F800000 0 186A0 1388 1 8A1 0", -ERR_INPUT}, /* infinite */
		{HEAD "7FC00000 0 186A0 1388 1 8A1 0", -ERR_INPUT}, /* NaN */
		{HEAD "BF800000 0 186A0 1388 1 8A1 0", -ERR_INPUT}, /* -1 */
		{HEAD "0 0 186A0 1388 1 8A1 0", -ERR_INPUT},
		{HEAD "3F800000 FF800000 186A0 1388 1 8A1 0", -ERR_INPUT},
		{HEAD "3F800000 0 186A0 1388 2 8A1 0", -ERR_INPUT}, /* one value missing */
		{HEAD "3F800000 0 186A0 1388 FFFF 8A1 0", -ERR_INPUT},
		{HEAD "3F800000 0 186A0 1388 10000 8A1 0", -ERR_INPUT},
		{HEAD "3F800000 0 186A0 0 2 8A1 8A1 0", -ERR_INPUT},  /* no step */
		{HEAD "3F800000 0 186A0 1388 0 0", -ERR_INPUT},       /* no shots */
		{HEAD "3F800000 0 186A0 1388 1 8A1FF 0", -ERR_INPUT}, /* five digits */
		{HEAD "3F800000 0 186A0 1388 1 8G1 0", -ERR_INPUT},
		{HEAD "3F800000 0 186A0 1388 1 -1 0", -ERR_INPUT},
		{HEAD "3F800000 0 186A0 1388 1  8A1 0", -ERR_INPUT}, /* two blanks */
		{HEAD "3F800000 0 186A0 1388 1 8A1 0 ", -ERR_INPUT}, /* one at the end */
		{HEAD "3F800000 0 186A0 1388 1 8A1 0 2", -ERR_INPUT},
		{HEAD "3F800000 0 186A0 1388 1 8A1 0 0 0 0 0 0 0", -ERR_INPUT}, /* a word too many */
		{HEAD "3F800000 0 186A0 1388 1 8A1 0 0 1 FF name 0 0 0", -ERR_INPUT},
		{HEAD "3F800000 0 186A0 1388 1 8A1 0 0 1 3 name 0 0 0", -ERR_INPUT},
		{HEAD "3F800000 0 186A0 1388 1 8A1 1 RSSI1 3F800000 0 186A0 1388 1 100 0 0 0 0 0", -ERR_INPUT}, /* over 8 bits */
		{HEAD "3F800000 0 186A0 1388 1 8A1 1 RSSI1 3F800000 0 186A0 1388 2 1 2 0 0 0 0 0", -ERR_INPUT}, /* not as many */
		{HEAD "3F800000 0 186A0 1388 1 8A1", -ERR_INPUT}, /* number of 8-bit channels missing */
		{"sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 0 2 DIST1 3F800000 0 186A0 1388 1 8A1 DIST1 3F800000 0 186A0 1388 1 8A1 0",
		 -ERR_INPUT},
		{"sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 FFFF 1 DIST1 3F800000 0 186A0 1388 1 8A1 0", -ERR_INPUT},
		{"sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 FFFFFFFF 168 0 1 DIST1 3F800000 0 186A0 1388 1 8A1 0", -ERR_INPUT},
		{"sSN LMDscandata 1 1 123456789 0 0 1 1 1 2 0 0 7 0 0 1388 168 0 1 DIST1 3F800000 0 186A0 1388 1 8A1 0",
		 -ERR_INPUT},
	};
	struct profile p = profile_of(cola);
	struct sweep *s = sweep_new();
	struct err err;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		int rc = decode_text(&p, rows[i].text, s, &err);

		if (rc != rows[i].rc)
			fail_msg("%s: %d %s (%llu)", rows[i].text, rc, err.message, (unsigned long long)err.offset);
	}
	assert_int_equal(decode_text(&p, rows[0].text, s, &err), 0);
	assert_string_equal(s->device_serial, "17271466");
	assert_true(s->shots == 3 && fabsf(s->range[0] - 0.811F) < 1e-6F && isnan(s->range[1]) &&
		    fabsf(s->range[2] - 65.535F) < 1e-5F);
	assert_true(s->counter == 0xbfd && fabs(s->device_time_s - 217.763341) < 1e-6 && fabs(s->period_s - 1 / 15.0) < 1e-12);
	sweep_free(s);
}

/* A changed byte: the telegram is invalid, or it is another sweep, or the byte does not matter for a sweep. */
static void test_cola_mutated(void **state)
{
	static struct cola_scan c;
	static uint8_t bytes[COLA_TELEGRAM_MAX], changed[COLA_TELEGRAM_MAX];
	struct profile p = profile_of(cola);
	struct sweep *s = sweep_new(), *t = sweep_new();
	struct err err;
	unsigned seed = 9, bad = 0, differ = 0, other = 0, same = 0;
	size_t n;

	cola_scan_tim551(&c);
	c.shots = 40;
	c.rssi_bits = 8;
	cola_scan_step(&c, 77);
	n = cola_make(&c, bytes, sizeof bytes) - 2;
	assert_int_equal(decode(&p, bytes + 1, n, s, &err), 0);
	for (unsigned i = 0; i < 20000; i++) {
		size_t at = rnd(&seed) % n, size = n;
		int rc;

		memcpy(changed, bytes + 1, n);
		if (i % 4 == 0)
			memmove(changed + at, changed + at + 1, --size - at);
		else if (i % 4 == 1)
			size = at;
		else
			changed[at] = i % 4 == 2 ? (uint8_t)rnd(&seed) : (uint8_t) "0123456789ABCDEF "[rnd(&seed) % 17];
		rc = decode(&p, changed, size, t, &err);
		bad += rc < 0;
		other += rc > 0;
		if (rc)
			continue;
		assert_true(t->shots <= SWEEP_SHOTS && t->shots > 0);
		if (t->shots != s->shots || memcmp(s->range, t->range, s->shots * sizeof *s->range) ||
		    memcmp(s->intensity, t->intensity, s->shots * sizeof *s->intensity) || s->first != t->first ||
		    s->step != t->step || s->period_s != t->period_s || s->counter != t->counter || s->dirty != t->dirty ||
		    s->device_time_s != t->device_time_s || strcmp(s->device_serial, t->device_serial))
			differ++;
		else
			same++;
	}
	print_message("bad %u, another sweep %u, no sweep %u, same %u\n", bad, differ, other, same);
	assert_true(bad > 8000 && differ > 1000);
	assert_true(same < 3500); /* counters, times of transmission, inputs and outputs, names, the same byte again */
	sweep_free(s);
	sweep_free(t);
}

/* ---- binary ranges ---- */

static const char le16[] =
	"[framer]\nkind = fixed\nsize = 24\nsync = RS\n[decoder]\nname = ranges\ncounter = u16le@2\ntime = u32le@4\ntime-scale = 0.001\n"
	"range = u16le@8\nrange-stride = 4\nintensity = u16le@10\nintensity-stride = 4\nintensity-full = 1000\nrange-scale = 0.002\n"
	"range-least = 5\nrange-most = 60000\nshots = 4\nangle-first = 90\nangle-step = -45\nperiod = 0.5\nstamp = last\n";

static void test_ranges(void **state)
{
	static const uint8_t bytes[] = {'R', 'S', 7, 1, 0xe8, 3,    0,   0, 100,  0,    244, 1,
					4,   0,   0, 0, 0x61, 0xea, 208, 7, 0x60, 0xea, 0,   1};
	struct profile p = profile_of(le16);
	struct sweep *s = sweep_new();
	struct err err;

	assert_int_equal(decode(&p, bytes, sizeof bytes, s, &err), 0);
	assert_true(s->shots == 4 && s->counter == 263 && s->counter_bits == 16 && s->has_counter);
	assert_true(fabsf(s->range[0] - 0.2F) < 1e-6F && isnan(s->range[1]) && isnan(s->range[2]) &&
		    fabsf(s->range[3] - 120) < 1e-4F);
	assert_true(s->intensity[0] == 0.5F && s->intensity[1] == 0 && s->intensity[2] == 1 &&
		    fabsf(s->intensity[3] - 0.256F) < 1e-6F);
	assert_true(fabs(s->first - M_PI / 2) < 1e-12 && fabs(s->step + M_PI / 4) < 1e-12);
	/* three eighths of a turn of half a second before the last shot */
	assert_true(fabs(s->device_time_s - (1 - 0.1875)) < 1e-12 && fabs(s->device_wrap_s - 4294967.296) < 1e-6);
	for (size_t n = 0; n < sizeof bytes; n++)
		assert_int_equal(decode(&p, bytes, n, s, &err), -ERR_INPUT);
	sweep_free(s);
}

static void test_ranges_counted(void **state)
{
	struct profile p =
		profile_of("[framer]\nkind = length\nlength = u16be@0\n[decoder]\nname = ranges\nkind = u8@2\ndata-kind = 0x10\n"
			   "count = u16be@3\nrange = u32be@5\nangle-step = 1\nintensity = u8@21\n");
	uint8_t bytes[] = {0, 25, 0x10, 0, 4, 0, 0, 0, 0, 0, 0, 4, 0, 0, 1, 0, 0, 255, 255, 255, 255, 0, 255, 51, 1};
	struct sweep *s = sweep_new();
	struct err err;

	assert_int_equal(decode(&p, bytes, sizeof bytes, s, &err), 0);
	assert_true(s->shots == 4 && isnan(s->range[0]) && fabsf(s->range[1] - 1.024F) < 1e-6F && s->range[3] > 4e6F);
	assert_true(s->intensity[0] == 0 && s->intensity[1] == 1 && fabsf(s->intensity[2] - 0.2F) < 1e-6F);
	assert_false(s->has_counter || s->has_device_time);
	bytes[2] = 0x11;
	assert_int_equal(decode(&p, bytes, sizeof bytes, s, &err), DECODER_NOT_DATA);
	bytes[2] = 0x10;
	bytes[4] = 0;
	assert_int_equal(decode(&p, bytes, sizeof bytes, s, &err), DECODER_NOT_DATA);
	bytes[4] = 5; /* the fifth intensity is missing */
	assert_int_equal(decode(&p, bytes, sizeof bytes, s, &err), -ERR_INPUT);
	bytes[3] = 255;
	assert_int_equal(decode(&p, bytes, sizeof bytes, s, &err), -ERR_INPUT);
	/* as many as fit */
	p = profile_of("[framer]\nkind = stream\n[decoder]\nname = ranges\nrange = u16le@1\nangle-step = 1\n");
	assert_int_equal(decode(&p, bytes, 8, s, &err), 0);
	assert_int_equal(s->shots, 3);
	assert_int_equal(decode(&p, bytes, 2, s, &err), DECODER_NOT_DATA);
	/* one more than fits */
	p = profile_of("[framer]\nkind = stream\n[decoder]\nname = ranges\ncount = u8@0\nrange = u16le@1\nangle-step = 1\n");
	bytes[0] = 3;
	assert_int_equal(decode(&p, bytes, 7, s, &err), 0);
	assert_int_equal(decode(&p, bytes, 6, s, &err), -ERR_INPUT);
	sweep_free(s);
}

/* ---- lines ---- */

static void test_xyz(void **state)
{
	static const struct {
		const char *columns, *line;
		int rc;
	} rows[] = {
		{"xyz", "1 2 3", 0},
		{"xyz", "1,2,3", 0},
		{"xyz", " 1.5e3\t-2  +3.25 9 9", 0},
		{"xyz", "1;2 ; +3.25 9 9", 0},
		/* acut's reader would reject the whole text because of it */
		{"xyz", "1.5e3\t-2 ; 3", -1},
		{"xyz", "13,.358 -387.77 -785.771", -1},
		{"xyz", "1,5;2,5;3,5", -1},
		{"xyz", "1 2,3 4", -1},
		{"xyz", "1,5, 2,5, 3,5", -1},
		{"xyz", "1\r 2 3", -1},
		{"xyz", "% 1 2 3", 1},
		{"xyz", "1 2 1e99", -1},
		{"xyz", "1 2 3e-20", -1},
		{"_xyz", "\"a b\" 1 2 3", 0},
		{"xyz", "", 1},
		{"xyz", "  ", 1},
		{"xyz", "# 1", 1},
		{"xyz", "//X Y Z", 1},
		{"xyz", "easting northing height", 1},
		{"xyz", "1 2", -1},
		{"xyz", "1 2 x", -1},
		{"xyz", "1,,3", -1},
		{"xyz", "nan nan nan", -1},
		{"xyz", "-inf 1 2", -1},
		{"xyz", " NaN,1,2", -1},
		{"xyz", "nancy 1 2", 1},
		{"xyz", "laser off", 1},
		{"xyz", "1 2 nan", -1},
		{"xyz", "1 2 0x3", -1},
		{"xyz", "1 2 3\x01", -1},
		{"xyz", "a\x01", -1},
		{"_xyz", "7;a 2 3", -1},
		{"_xyz", "7;1;2;3", 0},
		{"_xyz", "7 1 2", -1},
		{"xyzi", "1 2 3 4", 0},
		{"xyzi", "1 2 3", -1},
		{"_xyz", "_A7 1 2 3", 0},
		{"_xyz", "A7 1 2 3", 0},
		{"_xyz", "A7 1 2", -1},
		{"_xyz", "id x y z", 1},
		{"_xyz", "stop", 1},
		{"__xyz", "a b c", 1},
		{"__xyz", "a b 1 2 3", 0},
		{"xyz", "1. .2 -.3", 0},
		{"xyz", "1 2 .", -1},
		{"xyz", "1 2 -", -1},
		{"xyz", "1 2 1.2.3", -1},
		{"xyz", "1 2 1e400", -1},
		{"xyz", "1 2 -.", -1},
	};
	struct err err;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		char text[200];
		struct profile p;
		int rc;

		snprintf(text, sizeof text, "[framer]\nkind = line\n[decoder]\nname = xyz\ncolumns = %s\n", rows[i].columns);
		p = profile_of(text);
		rc = decode_text(&p, rows[i].line, NULL, &err);
		if (rc != rows[i].rc)
			fail_msg("%s as %s: %d %s", rows[i].line, rows[i].columns, rc, err.message);
	}
}

/* ---- the table ---- */

static void test_table(void **state)
{
	static const struct {
		const char *text, *field, *part;
	} faults[] = {
		{"[decoder]\nname = none\n", "name", "no decoder none"},
		{"[decoder]\nname = cola-a\n", "kind", "stx-etx"},
		{"[decoder]\nname = las\n", "kind", "kind = las"},
		{"[decoder]\nname = xyz\n", "kind", "kind = line"},
		{"[framer]\nkind = line\n[decoder]\nname = xyz\ncolumns = xy\n", "columns", "needed"},
		{"[framer]\nkind = line\n[decoder]\nname = xyz\ncolumns = xyzx\n", "columns", "twice"},
		{"[framer]\nkind = line\n[decoder]\nname = xyz\ncolumns = xyzr\n", "columns", "together"},
		{"[framer]\nkind = line\n[decoder]\nname = xyz\ncolumns = xyz?\n", "columns", "no such letter"},
		{"[framer]\nkind = las\n[decoder]\nname = ranges\n", "kind", "goes with decoder las"},
		{"[decoder]\nname = ranges\n", "range", "first range"},
		{"[decoder]\nname = ranges\nrange = u16le@0\n", "angle-step", "angle"},
		{"[decoder]\nname = ranges\nrange = u16le@0\nangle-step = 1\nrange-stride = 1\n", "range-stride",
		 "in one another"},
		{"[decoder]\nname = ranges\nrange = u16le@0\nangle-step = 1\n[time]\nsource = device\n", "time", "device's time"},
	};

	for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
		struct profile p;
		struct err err = ERR_INIT;

		assert_int_equal(profile_parse(faults[i].text, strlen(faults[i].text), "a", "a.conf", &p, &err), 0);
		if (decoder_check(&p, &err) != -ERR_INPUT || strcmp(err.field, faults[i].field) ||
		    !strstr(err.message, faults[i].part))
			fail_msg("%s: %s %s", faults[i].text, err.field, err.message);
	}
	for (size_t i = 0; decoder_at(i); i++) {
		assert_true(i == 0 || strcmp(decoder_at(i - 1)->name, decoder_at(i)->name) < 0);
		assert_ptr_equal(decoder_find(decoder_at(i)->name), decoder_at(i));
		assert_int_equal(decoder_at(i)->kind == DECODER_POINTS, decoder_at(i)->input_format != NULL);
	}
	assert_null(decoder_find("tim"));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_cola_made),    cmocka_unit_test(test_cola_angles), cmocka_unit_test(test_cola_texts),
		cmocka_unit_test(test_cola_mutated), cmocka_unit_test(test_ranges),      cmocka_unit_test(test_ranges_counted),
		cmocka_unit_test(test_xyz),          cmocka_unit_test(test_table),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
