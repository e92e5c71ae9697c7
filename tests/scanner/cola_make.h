/*
 * LMDscandata telegrams of CoLa-A as a SICK scanner writes them, for tests and for the fake device. Layout after the
 * manuals of TiM55x (8015883) and TiM51x (8016425), chapter "Measured value output", and of LMS1xx/5xx.
 */
#ifndef COLA_MAKE_H
#define COLA_MAKE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { COLA_SHOTS_MAX = 4096, COLA_TELEGRAM_MAX = 64 << 10 };

/* Raw values, as they stand in the telegram. */
struct cola_scan {
	bool answer; /* sRA, of sRN; else sSN, of a running stream */
	bool early;  /* firmware of TiM310 1130000M01: one field more before the scanning frequency */
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
	bool second_echo;           /* a channel DIST2 as well */
	const char *name, *comment; /* NULL: not said */
	bool position, time;        /* their blocks, zeros */
};

/* A TiM551: 271 shots of a degree from -45, 15 Hz, no RSSI, ranges 0. */
void cola_scan_tim551(struct cola_scan *);
/* Sweep number i of a device that stands in a room 6 by 4 m, with a little noise and some shots without return;
 * the same i is the same sweep. Counters, times and ranges are set, the rest stays. */
void cola_scan_step(struct cola_scan *, uint32_t i);
/* With STX and ETX; bytes, at most COLA_TELEGRAM_MAX; 0: there is no room. */
size_t cola_make(const struct cola_scan *, uint8_t *to, size_t room);

#endif
