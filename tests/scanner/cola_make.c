/* Writes telegrams; independent of the code that reads them. */
#include "cola_make.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

struct writer {
	char *at;
	size_t left;
	bool full;
};

__attribute__((format(printf, 2, 3))) static void put(struct writer *w, const char *fmt, ...)
{
	va_list ap;
	int n;

	va_start(ap, fmt);
	n = vsnprintf(w->at, w->left, fmt, ap);
	va_end(ap);
	if (n < 0 || (size_t)n >= w->left) {
		w->full = true;
		return;
	}
	w->at += n;
	w->left -= (size_t)n;
}

void cola_scan_tim551(struct cola_scan *s)
{
	memset(s, 0, sizeof *s);
	s->serial = 0x1078AAA;
	s->scan_frequency = 1500;
	s->measure_frequency = 0x36;
	s->scale = 0x3F800000;
	s->start_angle = -450000;
	s->step = 10000;
	s->shots = 271;
	s->name = "not defined";
}

static uint32_t mix(uint32_t v)
{
	v = (v ^ v >> 16) * 0x7feb352dU;
	v = (v ^ v >> 15) * 0x846ca68bU;
	return v ^ v >> 16;
}

void cola_scan_step(struct cola_scan *s, uint32_t i)
{
	double turn = s->scan_frequency ? 1e8 / s->scan_frequency : 0; /* microseconds */

	s->telegram_counter = (uint16_t)i;
	s->scan_counter = (uint16_t)(i + 5);
	s->since_start_us = (uint32_t)(uint64_t)(1000000 + i * turn);
	s->transmission_us = s->since_start_us + 3939;
	for (unsigned j = 0; j < s->shots; j++) {
		double angle = (s->start_angle + (double)j * s->step) / 10000 * 3.14159265358979 / 180;
		double x = fabs(3000 / cos(angle)), y = fabs(2000 / sin(angle));
		uint32_t noise = mix(i * 8191 + j);

		s->range[j] = noise % 97 == 0 ? 0 : (uint16_t)((x < y ? x : y) + noise % 11);
		s->rssi[j] = s->rssi_bits == 16 ? (uint16_t)noise : (uint8_t)noise;
	}
}

static void channel(struct writer *w, const struct cola_scan *s, const char *name, bool rssi)
{
	const uint16_t *v = rssi ? s->rssi : s->range;

	put(w, " %s %08X %08X %X %X %X", name, rssi ? 0x3F800000 : s->scale, rssi ? 0 : s->offset, (uint32_t)s->start_angle,
	    s->step, s->shots);
	for (unsigned j = 0; j < s->shots; j++)
		put(w, " %X", v[j]);
}

static void text(struct writer *w, const char *t)
{
	if (t)
		put(w, " 1 %zX %s", strlen(t), t);
	else
		put(w, " 0");
}

size_t cola_make(const struct cola_scan *s, uint8_t *to, size_t room)
{
	struct writer w = {.at = (char *)to, .left = room};

	put(&w, "\x02%s LMDscandata 1 1 %X %X %X %X %X %X %X 0 0 8 0 0%s %X %X %X", s->answer ? "sRA" : "sSN", s->serial,
	    s->status[0], s->status[1], s->telegram_counter, s->scan_counter, s->since_start_us, s->transmission_us,
	    s->early ? " 0" : "", s->scan_frequency, s->measure_frequency, s->encoders);
	for (unsigned e = 0; e < s->encoders; e++)
		put(&w, " %X %X", 1000 + e, 20 + e);
	put(&w, " %X", 1 + s->second_echo + (s->rssi_bits == 16));
	channel(&w, s, "DIST1", false);
	if (s->rssi_bits == 16)
		channel(&w, s, "RSSI1", true);
	if (s->second_echo)
		channel(&w, s, "DIST2", false);
	put(&w, " %X", s->rssi_bits == 8);
	if (s->rssi_bits == 8)
		channel(&w, s, "RSSI1", true);
	put(&w, s->position ? " 1 0 0 0 0 0 0 0" : " 0");
	text(&w, s->name);
	text(&w, s->comment);
	put(&w, s->time ? " 1 7E7 6 1 C 0 0 0" : " 0");
	put(&w, " 0\x03");
	return w.full ? 0 : (size_t)(w.at - (char *)to);
}
