/*
 * LMDscandata telegrams of CoLa-A as a SICK scanner writes them, for tests and for the fake device. Layout from the
 * manuals of TiM55x (8015883) and TiM51x (8016425), chapter "Measured value output", and of LMS1xx/5xx.
 */
#ifndef COLA_MAKE_H
#define COLA_MAKE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { COLA_SHOTS_MAX = 4096, COLA_TELEGRAM_MAX = 64 << 10 };

/* Raw values, as in the telegram. */
struct cola_scan {
	bool answer; /* sRA, of sRN; else sSN, of a running stream */
	bool early;  /* firmware of TiM310 1130000M01: one more field before the scanning frequency */
	uint32_t serial;
	uint8_t status[2]; /* 0 0 good, 0 1 error, 0 2 dirty */
	uint16_t telegram_counter, scan_counter;
	uint32_t since_start_us, transmission_us;
	uint32_t scan_frequency;    /* 1/100 Hz */
	uint32_t measure_frequency; /* 100 Hz */
	unsigned encoders;          /* 0 to 3 */
	uint32_t scale, offset;     /* the bits of two floats: 3F800000, 0 */
	int32_t start_angle;        /* 1/10000 degree, 90 ahead */
	uint16_t step;              /* 1/10000 degree */
	uint16_t shots;
	uint16_t range[COLA_SHOTS_MAX];
	unsigned rssi_bits; /* 0: none; 8, 16 */
	uint16_t rssi[COLA_SHOTS_MAX];
	bool second_echo;           /* also a channel DIST2 */
	const char *name, *comment; /* NULL: absent */
	bool position, time;        /* these blocks, zeros */
};

/* A TiM551: 271 shots of a degree from -45, 15 Hz, no RSSI, ranges 0. */
void cola_scan_tim551(struct cola_scan *);
/* Sweep number i of a device in a room of 6 by 4 m, with some noise and some shots without return; the same i gives the
 * same sweep. Sets counters, times and ranges only. */
void cola_scan_step(struct cola_scan *, uint32_t i);
/* With STX and ETX; returns its size, at most COLA_TELEGRAM_MAX; 0: it does not fit. */
size_t cola_make(const struct cola_scan *, uint8_t *to, size_t room);

#endif
