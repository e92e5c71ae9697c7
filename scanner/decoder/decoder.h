/*
 * Telegrams to sweeps: one pure function for each family. No state, no clock, no I/O: the same bytes always give the
 * same sweep.
 */
#ifndef DECODER_H
#define DECODER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct profile;

enum { SWEEP_SHOTS = 65536 };

/* A sweep in polar form: shot i is at angle first + i * step in the scan plane, whose x is ahead (angle 0) and y to the
 * left (90 degrees). Radians; ranges in metres, NAN: no return. */
struct sweep {
	double first, step;
	uint32_t shots;
	float *range;     /* SWEEP_SHOTS entries, memory of the caller */
	float *intensity; /* 0 to 1; NAN: unknown */
	double period_s;  /* of one revolution; shot i is at + i * step / 2 pi * period; 0: unknown */
	bool has_device_time;
	double device_time_s; /* of the first shot, by the device's own clock with an arbitrary zero; may be negative */
	double device_wrap_s; /* that clock wraps to 0 after so many seconds */
	uint32_t counter;     /* the device's counter of sweeps */
	uint8_t counter_bits; /* the counter wraps to 0 after 2^bits - 1 */
	bool has_counter;
	char device_serial[32]; /* as on its label; "": unknown */
	bool dirty;             /* the device reports that its window is dirty or that it fails */
};

enum decoder_kind { DECODER_SWEEP, DECODER_POINTS }; /* POINTS: telegrams are the text or file itself (XYZ, LAS) */

struct decoder {
	const char *name, *title;
	enum decoder_kind kind;
	/* 0: *ret is set; 1 (DECODER_NOT_DATA): a valid telegram without a sweep (an answer, a state); -ERR_INPUT:
	 * invalid; err has the reason and the byte of the telegram. *ret keeps its arrays, whose content is undefined
	 * unless the result is 0. For POINTS: NULL for LAS; for XYZ it tests whether the line is one of points (ret may
	 * be NULL). */
	int (*decode)(const uint8_t *at, size_t size, const struct profile *, struct sweep *ret, struct err *);
	int (*check)(const struct profile *, struct err *); /* checks what the profile must have for it; may be NULL */
	const char *input_format;                           /* for POINTS: "las" or "xyz", as in acutctl; else NULL */
};
enum { DECODER_NOT_DATA = 1 };

const struct decoder *decoder_find(const char *name); /* NULL: there is none */
const struct decoder *decoder_at(size_t i);           /* in order of names; NULL at the end */

/* Whether the profile's decoder exists and the profile has what it needs: its framer, its keys. -ERR_INPUT. */
int decoder_check(const struct profile *, struct err *);

/* A sweep with its two arrays; NULL: no memory. */
struct sweep *sweep_new(void);
struct sweep *sweep_free(struct sweep *);
/* Seconds from the first shot to the last; 0 if the period is unknown. */
double sweep_duration(const struct sweep *);

#endif
