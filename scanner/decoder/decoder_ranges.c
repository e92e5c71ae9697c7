/*
 * Binary telegrams of a simple form: a head with some numbers, then consecutive ranges, with intensities between or
 * after them. The profile's keys describe it completely, so most vendor formats need no code. A telegram that is too
 * short for the described fields is invalid.
 */
#include <math.h>
#include <string.h>

#include "decoder_parts.h"
#include "err.h"
#include "profile.h"

static bool field_fits(struct profile_field f, size_t size)
{
	return (uint64_t)f.offset + f.size <= size;
}

static uint32_t field_value(const uint8_t *at, struct profile_field f)
{
	uint32_t v = 0;

	at += f.offset;
	for (unsigned i = 0; i < f.size; i++)
		v |= (uint32_t)at[i] << 8 * (f.big_endian ? f.size - 1U - i : i);
	return v;
}

static uint32_t all_ones(struct profile_field f)
{
	return UINT32_MAX >> (32 - 8 * f.size);
}

/* The number of shots; -ERR_INPUT if they do not fit. */
static int count_shots(const struct profile_ranges *r, const uint8_t *at, size_t size, uint32_t *ret, struct err *err)
{
	uint64_t stride = r->range_stride ? r->range_stride : r->range.size, room, n;

	room = field_fits(r->range, size) ? (size - (uint64_t)r->range.offset - r->range.size) / stride + 1 : 0;
	n = r->count.offset >= 0 ? field_value(at, r->count) : r->shots ? r->shots : room;
	if (n > SWEEP_SHOTS)
		return decoder_bad(err, (size_t)(r->count.offset >= 0 ? r->count.offset : 0), "%llu shots; %d are the most",
				   (unsigned long long)n, SWEEP_SHOTS);
	if (n > room)
		return decoder_bad(err, size, "%llu shots do not fit into %zu bytes", (unsigned long long)n, size);
	if (n && r->intensity.offset >= 0) {
		uint64_t step = r->intensity_stride ? r->intensity_stride : r->intensity.size;

		if ((uint64_t)r->intensity.offset + (n - 1) * step + r->intensity.size > size)
			return decoder_bad(err, size, "%llu intensities do not fit into %zu bytes", (unsigned long long)n, size);
	}
	*ret = (uint32_t)n;
	return 0;
}

static void read_shots(const struct profile_ranges *r, const uint8_t *at, struct sweep *s)
{
	struct profile_field range = r->range, intensity = r->intensity;
	uint32_t stride = r->range_stride ? r->range_stride : range.size;
	uint32_t step = r->intensity_stride ? r->intensity_stride : intensity.size;
	double full = r->intensity_full ? r->intensity_full : intensity.offset >= 0 ? all_ones(intensity) : 1;

	for (uint32_t i = 0; i < s->shots; i++, range.offset += (int32_t)stride) {
		uint32_t raw = field_value(at, range);

		s->range[i] = raw < r->range_least || raw > r->range_most ? NAN : (float)(raw * r->range_scale);
		s->intensity[i] = NAN;
		if (r->intensity.offset < 0)
			continue;
		s->intensity[i] = (float)fmin(field_value(at, intensity) / full, 1);
		intensity.offset += (int32_t)step;
	}
}

int decoder_ranges(const uint8_t *at, size_t size, const struct profile *p, struct sweep *ret, struct err *err)
{
	const struct profile_ranges *r = &p->ranges;
	const struct profile_field heads[] = {r->kind, r->count, r->counter, r->time};
	struct sweep s = {.range = ret->range, .intensity = ret->intensity};
	int rc;

	for (size_t i = 0; i < sizeof heads / sizeof *heads; i++) {
		if (heads[i].offset >= 0 && !field_fits(heads[i], size))
			return decoder_bad(err, size, "ends before its head does");
		if (!i && r->kind.offset >= 0 && field_value(at, r->kind) != r->data_kind)
			return DECODER_NOT_DATA;
	}
	if ((rc = count_shots(r, at, size, &s.shots, err)))
		return rc;
	if (!s.shots)
		return DECODER_NOT_DATA;
	s.first = r->angle_first * (M_PI / 180);
	s.step = r->angle_step * (M_PI / 180);
	s.period_s = r->period_s;
	if (r->counter.offset >= 0) {
		s.has_counter = true;
		s.counter = field_value(at, r->counter);
		s.counter_bits = (uint8_t)(8 * r->counter.size);
	}
	if (r->time.offset >= 0) {
		s.has_device_time = true;
		s.device_time_s = field_value(at, r->time) * r->time_scale;
		s.device_wrap_s = (all_ones(r->time) + 1.0) * r->time_scale;
		if (p->stamp == PROFILE_STAMP_LAST)
			s.device_time_s -= sweep_duration(&s);
	}
	read_shots(r, at, &s);
	*ret = s;
	return 0;
}

static int wrong(struct err *err, const char *key, const char *text)
{
	err_set(err, ERR_INPUT, "decoder ranges: %s", text);
	return err_add_place(err, ERR_NO_OFFSET, key);
}

int decoder_ranges_check(const struct profile *p, struct err *err)
{
	const struct profile_ranges *r = &p->ranges;

	if (r->range.offset < 0)
		return wrong(err, "range", "needs the place of the first range");
	if (r->range_stride && r->range_stride < r->range.size)
		return wrong(err, "range-stride", "ranges lie in one another");
	if (r->angle_step == 0 && r->shots != 1)
		return wrong(err, "angle-step", "needs the angle between shots");
	if (p->time == PROFILE_TIME_DEVICE && r->time.offset < 0)
		return wrong(err, "time", "[time] source = device needs the place of the device's time");
	if (p->framer == PROFILE_FRAMER_LINE)
		return wrong(err, "kind", "lines are no binary telegrams");
	return 0;
}
