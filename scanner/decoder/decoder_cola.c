/*
 * SICK CoLa-A, telegram LMDscandata: words between single blanks, numbers in upper-case hexadecimal.
 *
 * Layout: manuals of TiM55x/56x/57x (8015883) and TiM51x (8016425), chapter 5.3, and of LMS4000, LMS5xx. After command,
 * version, device number, serial number, status (2), telegram and scan counter, time since start, time of transmission,
 * inputs (2), outputs (2) and a reserved word come scanning frequency (1/100 Hz), measuring frequency, encoders
 * (position and speed each), the 16-bit channels, the 8-bit channels, and optional blocks: position, name, comment,
 * time, event. The firmware of TiM310 part 1130000M01 has one more word before the scanning frequency. There is no
 * checksum, so everything that can be checked is checked; any deviation from the layout makes the telegram invalid.
 *
 * Angles are degrees, counter-clockwise seen from above, 90 is ahead (-45 to 225 for a TiM), in 1/10000; the profile
 * can set another angle for ahead. A raw range below 16 is a code and not a range (LMS4000, 12.1: 0 no return, 1
 * dazzled).
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "decoder_parts.h"
#include "err.h"
#include "profile.h"

enum { RANGE_LEAST = 16, CHANNELS_MAX = 16, ENCODERS_MAX = 8 };

/* Words of the telegram; after an error all further words are empty. */
struct words {
	const uint8_t *start, *at, *end;
	bool bad;
};

struct word {
	const uint8_t *at;
	size_t size;
};

/* There is one blank between words, and none after the last. */
static struct word next_word(struct words *w)
{
	struct word r = {w->at, 0};
	const uint8_t *p = w->at;

	if (w->bad)
		return r;
	while (p < w->end && *p != ' ')
		p++;
	r.size = (size_t)(p - w->at);
	w->bad = !r.size;
	w->at = p < w->end ? p + 1 : p;
	w->bad |= p < w->end && w->at == w->end;
	return r;
}

static const int8_t hex[256] = {
	['0'] = 1,  ['1'] = 2,  ['2'] = 3,  ['3'] = 4,  ['4'] = 5,  ['5'] = 6,  ['6'] = 7,  ['7'] = 8,
	['8'] = 9,  ['9'] = 10, ['A'] = 11, ['B'] = 12, ['C'] = 13, ['D'] = 14, ['E'] = 15, ['F'] = 16,
	['a'] = 11, ['b'] = 12, ['c'] = 13, ['d'] = 14, ['e'] = 15, ['f'] = 16,
};

/* A number of at most `digits` hexadecimal digits (with leading zeros). */
static uint32_t read_number(struct words *w, size_t digits)
{
	struct word t = next_word(w);
	uint32_t v = 0;

	if (t.size > digits)
		w->bad = true;
	for (size_t i = 0; i < t.size && !w->bad; i++) {
		int d = hex[t.at[i]];

		w->bad = !d;
		v = v << 4 | (uint32_t)(d - 1);
	}
	return w->bad ? 0 : v;
}

static float read_real(struct words *w)
{
	uint32_t bits = read_number(w, 8);
	float v;

	memcpy(&v, &bits, sizeof v);
	if (!isfinite(v))
		w->bad = true;
	return w->bad ? 0 : v;
}

static bool word_is(struct word t, const char *text)
{
	return t.size == strlen(text) && !memcmp(t.at, text, t.size);
}

static void skip(struct words *w, unsigned n)
{
	while (n--)
		read_number(w, 8);
}

/* The step before it was rounded: a multiple of a third, sixth or twelfth of a degree; 811 shots of 3333 are 270 degrees. */
static double step_degrees(uint32_t raw)
{
	static const unsigned parts[] = {3, 6, 12};

	for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
		if (raw == 10000 / parts[i] || raw == 10000 / parts[i] + 1)
			return 1.0 / parts[i];
	return raw / 10000.0;
}

struct channel {
	struct word name;
	float scale, offset;
	int32_t start;
	uint32_t step, n;
};

static void channel_head(struct words *w, struct channel *c)
{
	c->name = next_word(w);
	c->scale = read_real(w);
	c->offset = read_real(w);
	c->start = (int32_t)read_number(w, 8);
	c->step = read_number(w, 4);
	c->n = read_number(w, 4);
}

/* The values of a channel: ranges in metres, intensities, or ignored. `digits`: of a value. */
static int channel_values(struct words *w, const struct channel *c, const char *content, size_t digits, float full, float *to,
			  struct err *err)
{
	if (to && !strcmp(content, "DIST1") && !(c->scale > 0))
		return decoder_bad(err, (size_t)(c->name.at - w->start), "DIST1 with a scale of %g", (double)c->scale);
	for (uint32_t i = 0; i < c->n && !w->bad; i++) {
		uint32_t raw = read_number(w, digits);
		float v = (float)raw * c->scale + c->offset;

		if (!to)
			continue;
		if (full > 0)
			to[i] = fminf(fmaxf(v / full, 0), 1);
		else
			to[i] = raw < RANGE_LEAST || !(v > 0) || !isfinite(v) ? NAN : v / 1000;
	}
	return 0;
}

struct seen {
	bool dist, rssi;
	uint32_t rssi_n;
};

static int channels(struct words *w, unsigned n, size_t digits, const struct profile *p, struct sweep *ret, struct seen *seen,
		    struct err *err)
{
	for (unsigned i = 0; i < n && !w->bad; i++) {
		size_t at = (size_t)(w->at - w->start);
		struct channel c;
		bool dist, rssi;
		int rc;

		channel_head(w, &c);
		dist = !w->bad && digits == 4 && word_is(c.name, "DIST1");
		rssi = !w->bad && word_is(c.name, "RSSI1");
		if (w->bad)
			return 0;
		if ((dist && seen->dist) || (rssi && seen->rssi))
			return decoder_bad(err, at, "%.5s stands twice", (const char *)c.name.at);
		if (c.name.at[0] < 'A' || c.name.at[0] > 'Z' || c.name.size > 16)
			return decoder_bad(err, at, "the name of a channel is wanted");
		if (dist && (!c.n || (!c.step && c.n > 1)))
			return decoder_bad(err, at, "DIST1 with %u values in steps of %u", c.n, c.step);
		if (dist) {
			seen->dist = true;
			ret->shots = c.n;
			ret->step = step_degrees(c.step) * (M_PI / 180);
			ret->first = (c.start / 10000.0 - p->angle_ahead) * (M_PI / 180);
		} else if (rssi) {
			seen->rssi = true;
			seen->rssi_n = c.n;
		}
		rc = channel_values(w, &c, dist ? "DIST1" : "", digits, rssi ? digits == 4 ? 65535.0F : 255.0F : 0,
				    dist ? ret->range :
				    rssi ? ret->intensity :
					   NULL,
				    err);
		if (rc)
			return rc;
	}
	return 0;
}

/* Skips a text with its length, which may contain blanks. */
static void skip_text(struct words *w, size_t most)
{
	uint32_t present = read_number(w, 4), n;

	if (w->bad || !present)
		return;
	n = present == 1 ? read_number(w, 4) : 0;
	if (present != 1 || n > most || n > (size_t)(w->end - w->at))
		w->bad = true;
	if (w->bad || (!n && (w->at == w->end || *w->at != ' ')))
		return; /* an empty text is missing, or is between two blanks */
	w->at += n;
	if (w->at < w->end)
		w->bad = *w->at++ != ' ' || w->at == w->end;
}

/* Skips an optional block of n words; if it is the last, it may be missing entirely. */
static void skip_block(struct words *w, unsigned n)
{
	uint32_t present = w->at < w->end ? read_number(w, 4) : 0;

	if (present == 1)
		skip(w, n);
	else if (present)
		w->bad = true;
}

static void skip_optional(struct words *w)
{
	skip_block(w, 7); /* position: x y z, three rotations, their kind */
	if (w->at < w->end)
		skip_text(w, 16 * 4);
	if (w->at < w->end)
		skip_text(w, 128 * 4);
	skip_block(w, 7);                        /* time: year month day hour minute second microseconds */
	if (w->at < w->end && read_number(w, 4)) /* event: it has several forms, and nothing follows */
		w->at = w->end;
	if (w->at < w->end)
		w->bad = true;
}

/* The fields before the channels; false: there are not `extra` words before the scanning frequency. */
static bool read_parameters(struct words *w, unsigned extra, struct sweep *ret, unsigned *ret_channels)
{
	struct words look;
	struct word name;
	uint32_t frequency, encoders;

	skip(w, extra);
	frequency = read_number(w, 8);
	read_number(w, 8); /* measuring frequency, 100 Hz */
	encoders = read_number(w, 4);
	if (encoders > ENCODERS_MAX)
		return false;
	skip(w, 2 * encoders);
	*ret_channels = read_number(w, 4);
	look = *w;
	name = next_word(&look);
	if (w->bad || *ret_channels > CHANNELS_MAX || (*ret_channels && (!name.size || name.at[0] < 'A')))
		return false;
	/* 0.5 to 600 revolutions a second are plausible; 0: unknown */
	ret->period_s = frequency >= 50 && frequency <= 60000 ? 100.0 / frequency : 0;
	return !frequency || ret->period_s > 0;
}

static int is_answer(const uint8_t *at, size_t size, struct err *err)
{
	/* s, two letters, a blank or the end: sEA, sRA, sAN, sWA, sFA; or an event of another name */
	if (size >= 3 && at[0] == 's' && at[1] >= 'A' && at[1] <= 'Z' && at[2] >= 'A' && at[2] <= 'Z' &&
	    (size == 3 || at[3] == ' ')) {
		for (size_t i = 0; i < size; i++)
			if (at[i] < ' ')
				return decoder_bad(err, i, "a control character in an answer");
		return DECODER_NOT_DATA;
	}
	return decoder_bad(err, 0, "no telegram of CoLa-A");
}

/* The label has the serial number as eight decimal digits. */
static void read_head(struct words *w, struct sweep *ret)
{
	skip(w, 2); /* version of the telegram, number of the device */
	snprintf(ret->device_serial, sizeof ret->device_serial, "%.8u", read_number(w, 8));
	ret->dirty = read_number(w, 4);
	ret->dirty |= read_number(w, 4) != 0;
	ret->counter = read_number(w, 4); /* of telegrams: scans that were not requested are not lost */
	ret->counter_bits = 16;
	ret->has_counter = true;
	read_number(w, 4);
	ret->device_time_s = read_number(w, 8) * 1e-6;
	ret->device_wrap_s = 4294.967296;
	ret->has_device_time = true;
	skip(w, 6); /* time of transmission, inputs, outputs, reserved */
}

static void clear(struct sweep *s)
{
	float *range = s->range, *intensity = s->intensity;

	memset(s, 0, sizeof *s);
	s->range = range;
	s->intensity = intensity;
}

int decoder_cola(const uint8_t *at, size_t size, const struct profile *p, struct sweep *ret, struct err *err)
{
	static const char command[] = " LMDscandata ";
	struct words w = {at, at, at + size, false}, again;
	struct seen seen = {0};
	unsigned n = 0;
	int rc;

	if (size < 16 || memcmp(at + 3, command, sizeof command - 1) || (memcmp(at, "sSN", 3) && memcmp(at, "sRA", 3)))
		return is_answer(at, size, err);
	w.at += 16;
	clear(ret);
	read_head(&w, ret);
	again = w;
	if (!w.bad && !read_parameters(&w, 0, ret, &n)) {
		w = again;
		if (!read_parameters(&w, 1, ret, &n))
			return decoder_bad(err, (size_t)(again.at - at),
					   "frequencies, encoders and channels are not as they should be");
	}
	if (!w.bad && (rc = channels(&w, n, 4, p, ret, &seen, err)))
		return rc;
	n = read_number(&w, 4);
	if (n > CHANNELS_MAX)
		w.bad = true;
	if ((rc = channels(&w, n, 2, p, ret, &seen, err)))
		return rc;
	if (!w.bad)
		skip_optional(&w);
	if (w.bad)
		return decoder_bad(err, (size_t)(w.at - at), "not as the layout of LMDscandata has it, before this byte");
	if (!seen.dist)
		return DECODER_NOT_DATA;
	if (seen.rssi && seen.rssi_n != ret->shots)
		return decoder_bad(err, 0, "%u ranges with %u intensities", ret->shots, seen.rssi_n);
	for (uint32_t i = 0; !seen.rssi && i < ret->shots; i++)
		ret->intensity[i] = NAN;
	if (p->stamp == PROFILE_STAMP_LAST)
		ret->device_time_s -= sweep_duration(ret);
	return 0;
}

int decoder_cola_check(const struct profile *p, struct err *err)
{
	if (p->framer == PROFILE_FRAMER_STX_ETX)
		return 0;
	err_set(err, ERR_INPUT, "decoder cola-a needs [framer] kind = stx-etx");
	return err_add_place(err, ERR_NO_OFFSET, "kind");
}
