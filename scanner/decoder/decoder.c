/* The table of decoders, one row for each family of scanners. A new family is a function from bytes to a sweep, and a row. */
#include "decoder.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "decoder_parts.h"
#include "err.h"
#include "profile.h"

static int no_data(const uint8_t *at, size_t size, const struct profile *p, struct sweep *ret, struct err *err)
{
	return DECODER_NOT_DATA;
}

static int las_check(const struct profile *p, struct err *err)
{
	if (p->framer == PROFILE_FRAMER_LAS)
		return 0;
	err_set(err, ERR_INPUT, "decoder las needs [framer] kind = las");
	return err_add_place(err, ERR_NO_OFFSET, "kind");
}

static const struct decoder decoders[] = {
	{"cola-a", "SICK CoLa-A: LMDscandata telegrams (TiM, LMS)", DECODER_SWEEP, decoder_cola, decoder_cola_check, NULL},
	{"las", "LAS files, one behind the other", DECODER_POINTS, NULL, las_check, "las"},
	{"ranges", "binary telegrams with ranges in a row, as the profile says", DECODER_SWEEP, decoder_ranges,
	 decoder_ranges_check, NULL},
	{"raw", "nothing is decoded: captured now, decoded by a later acut", DECODER_SWEEP, no_data, NULL, NULL},
	{"xyz", "lines of numbers", DECODER_POINTS, decoder_xyz, decoder_xyz_check, "xyz"},
};

enum { DECODERS = sizeof decoders / sizeof *decoders };

const struct decoder *decoder_at(size_t i)
{
	return i < DECODERS ? &decoders[i] : NULL;
}

const struct decoder *decoder_find(const char *name)
{
	for (size_t i = 0; i < DECODERS; i++)
		if (!strcmp(decoders[i].name, name))
			return &decoders[i];
	return NULL;
}

int decoder_check(const struct profile *p, struct err *err)
{
	const struct decoder *d = decoder_find(p->decoder);
	char names[128] = "";
	size_t n = 0;

	if (!d) {
		for (size_t i = 0; i < DECODERS; i++)
			n += (size_t)snprintf(names + n, sizeof names - n, "%s%s", i ? ", " : "", decoders[i].name);
		err_set(err, ERR_INPUT, "there is no decoder %s", p->decoder);
		err_add_place(err, ERR_NO_OFFSET, "name");
		return err_add_hint(err, "there are %s", names);
	}
	if (p->framer == PROFILE_FRAMER_LAS && strcmp(d->name, "las") && strcmp(d->name, "raw")) {
		err_set(err, ERR_INPUT, "[framer] kind = las goes with decoder las, not with %s", d->name);
		return err_add_place(err, ERR_NO_OFFSET, "kind");
	}
	return d->check ? d->check(p, err) : 0;
}

int decoder_bad(struct err *err, size_t at, const char *fmt, ...)
{
	char text[200];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	err_set(err, ERR_INPUT, "%s", text);
	return err_add_place(err, at, NULL);
}

struct sweep *sweep_new(void)
{
	struct sweep *s = calloc(1, sizeof *s);

	if (!s)
		return NULL;
	s->range = malloc(SWEEP_SHOTS * sizeof *s->range);
	s->intensity = malloc(SWEEP_SHOTS * sizeof *s->intensity);
	return s->range && s->intensity ? s : sweep_free(s);
}

struct sweep *sweep_free(struct sweep *s)
{
	if (s) {
		free(s->range);
		free(s->intensity);
	}
	free(s);
	return NULL;
}

double sweep_duration(const struct sweep *s)
{
	return s->shots ? fabs((s->shots - 1) * s->step) / (2 * M_PI) * s->period_s : 0;
}
