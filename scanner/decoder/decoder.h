/*
 * Telegrams to sweeps: one pure function a family, a row each. No state, no clock, no I/O: the same bytes are the
 * same sweep, today and from a spool in ten years.
 */
#ifndef DECODER_H
#define DECODER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct profile;

enum { SWEEP_SHOTS = 65536 };

/* One sweep in polar form: shot i at angle first + i * step in the scan plane, the plane's x ahead (angle 0), y to
 * the left (90 degrees); radians; ranges in metres, NAN: no return. */
struct sweep {
	double first, step;
	uint32_t shots;
	float *range;     /* SWEEP_SHOTS places, the caller's */
	float *intensity; /* 0 to 1; NAN: not said */
	double period_s;  /* of one revolution, so that shot i is at + i * step / 2 pi * period; 0: not known */
	bool has_device_time;
	double device_time_s; /* of the first shot, the device's own clock, an arbitrary zero; may be below 0 */
	double device_wrap_s; /* that clock begins again at 0 after as many seconds */
	uint32_t counter;     /* of sweeps, as the device counts them */
	uint8_t counter_bits; /* begins again at 0 behind 2^bits - 1 */
	bool has_counter;
	char device_serial[32]; /* as its label has it; "": not said */
	bool dirty;             /* the device says that its window is dirty or that it fails */
};

enum decoder_kind { DECODER_SWEEP, DECODER_POINTS }; /* POINTS: telegrams are the text or file itself (XYZ, LAS) */

struct decoder {
	const char *name, *title;
	enum decoder_kind kind;
	/* 0: *ret is filled; 1 (DECODER_NOT_DATA): a good telegram that carries no sweep (an answer, a state);
	 * -ERR_INPUT: bad, err says what, with the byte of the telegram. *ret keeps its pointers; what they point at is
	 * undefined after anything but 0. POINTS: NULL for LAS; of XYZ says whether the line is one (ret may be NULL). */
	int (*decode)(const uint8_t *at, size_t size, const struct profile *, struct sweep *ret, struct err *);
	int (*check)(const struct profile *, struct err *); /* what the profile must say for it; NULL: nothing */
	const char *input_format;                           /* POINTS: "las", "xyz" as acutctl names them; NULL */
};
enum { DECODER_NOT_DATA = 1 };

const struct decoder *decoder_find(const char *name); /* NULL: there is none */
const struct decoder *decoder_at(size_t i);           /* in order of names; NULL: no more */

/* Whether the profile's decoder is there and the profile has what it needs: its framer, its keys. -ERR_INPUT. */
int decoder_check(const struct profile *, struct err *);

/* A sweep with its two arrays; NULL: no memory. */
struct sweep *sweep_new(void);
struct sweep *sweep_free(struct sweep *);
/* Seconds from the first shot to the last; 0 if the period is not known. */
double sweep_duration(const struct sweep *);

#endif
