/* The keys of a profile, one row each: section, type, and place in struct profile. profile.h describes them. */
#include "profile_table.h"

#include <string.h>

#define AT(member) offsetof(struct profile, member), sizeof((struct profile *)0)->member
#define RANGES(member) AT(ranges.member)

static const struct profile_key keys[] = {
	{"", "title", PROFILE_TEXT, AT(title)},
	{"", "note", PROFILE_TEXT, AT(note)},
	{"match", "vendor", PROFILE_INT, AT(vendor), 0, 0xffff},
	{"match", "product", PROFILE_INT, AT(product), 0, 0xffff},
	{"match", "device-class", PROFILE_INT, AT(device_class), 0, 0xff},
	{"match", "interface-class", PROFILE_INT, AT(interface_class), 0, 0xff},
	{"match", "serial", PROFILE_PATTERN, AT(serial)},
	{"usb", "configuration", PROFILE_U32, AT(configuration), 0, 255},
	{"usb", "interface", PROFILE_U32, AT(interface), 0, 255},
	{"usb", "alternate", PROFILE_U32, AT(alternate), 0, 255},
	{"usb", "endpoint-in", PROFILE_U8, AT(endpoint_in), 0x81, 0x8f},
	{"usb", "endpoint-out", PROFILE_U8, AT(endpoint_out), 0, 0x0f},
	{"usb", "transfer-size", PROFILE_SIZE, AT(transfer_size), 512, 1 << 20},
	{"usb", "transfers", PROFILE_U32, AT(transfers), 1, 256},
	{"usb", "timeout", PROFILE_MS, AT(timeout_ms), 0.001, 600},
	{"start", "send", PROFILE_SEND, AT(start)},
	{"start", "answer", PROFILE_ANSWER, AT(start)},
	{"stop", "send", PROFILE_SEND, AT(stop)},
	{"stop", "answer", PROFILE_ANSWER, AT(stop)},
	{"framer", "kind", PROFILE_CHOICE, AT(framer), 0, 0, "stream|stx-etx|line|fixed|length|las"},
	{"framer", "telegram-max", PROFILE_SIZE, AT(telegram_max), 1, 1 << 20},
	{"framer", "size", PROFILE_SIZE, AT(fixed_size), 1, 1 << 20},
	{"framer", "sync", PROFILE_BYTES, AT(sync)},
	{"framer", "length", PROFILE_LENGTH, AT(length_offset)},
	{"framer", "length-add", PROFILE_U32, AT(length_add), 0, 65536},
	{"framer", "starts-torn", PROFILE_YES, AT(starts_torn)},
	{"decoder", "name", PROFILE_NAME, AT(decoder)},
	{"decoder", "columns", PROFILE_TEXT, AT(columns)},
	{"decoder", "ahead", PROFILE_REAL, AT(angle_ahead), -360, 360},
	{"decoder", "stamp", PROFILE_CHOICE, AT(stamp), 0, 0, "first|last"},
	{"decoder", "kind", PROFILE_FIELD, RANGES(kind)},
	{"decoder", "data-kind", PROFILE_U32, RANGES(data_kind), 0, UINT32_MAX},
	{"decoder", "count", PROFILE_FIELD, RANGES(count)},
	{"decoder", "shots", PROFILE_U32, RANGES(shots), 1, 65536},
	{"decoder", "range", PROFILE_FIELD, RANGES(range)},
	{"decoder", "range-stride", PROFILE_U32, RANGES(range_stride), 1, 4096},
	{"decoder", "range-scale", PROFILE_REAL, RANGES(range_scale), 1e-9, 1e6},
	{"decoder", "range-least", PROFILE_U32, RANGES(range_least), 0, UINT32_MAX},
	{"decoder", "range-most", PROFILE_U32, RANGES(range_most), 0, UINT32_MAX},
	{"decoder", "intensity", PROFILE_FIELD, RANGES(intensity)},
	{"decoder", "intensity-stride", PROFILE_U32, RANGES(intensity_stride), 1, 4096},
	{"decoder", "intensity-full", PROFILE_U32, RANGES(intensity_full), 1, UINT32_MAX},
	{"decoder", "angle-first", PROFILE_REAL, RANGES(angle_first), -720, 720},
	{"decoder", "angle-step", PROFILE_REAL, RANGES(angle_step), -360, 360},
	{"decoder", "period", PROFILE_REAL, RANGES(period_s), 0, 3600},
	{"decoder", "counter", PROFILE_FIELD, RANGES(counter)},
	{"decoder", "time", PROFILE_FIELD, RANGES(time)},
	{"decoder", "time-scale", PROFILE_REAL, RANGES(time_scale), 1e-12, 3600},
	{"geometry", "mount-roll", PROFILE_REAL, AT(mount_roll), -360, 360},
	{"geometry", "mount-pitch", PROFILE_REAL, AT(mount_pitch), -360, 360},
	{"geometry", "mount-heading", PROFILE_REAL, AT(mount_heading), -360, 360},
	{"geometry", "lever-x", PROFILE_REAL, AT(lever[0]), -1000, 1000},
	{"geometry", "lever-y", PROFILE_REAL, AT(lever[1]), -1000, 1000},
	{"geometry", "lever-z", PROFILE_REAL, AT(lever[2]), -1000, 1000},
	{"geometry", "range-min", PROFILE_REAL, AT(range_min), 0, 1e6},
	{"geometry", "range-max", PROFILE_REAL, AT(range_max), 0, 1e6},
	{"time", "source", PROFILE_CHOICE, AT(time), 0, 0, "arrival|device"},
	{"time", "latency", PROFILE_REAL, AT(latency_s), -60, 60},
};

enum { KEYS = sizeof keys / sizeof *keys };

const struct profile_key *profile_key_at(size_t i)
{
	return i < KEYS ? &keys[i] : NULL;
}

const struct profile_key *profile_key_find(const char *section, const char *name)
{
	for (size_t i = 0; i < KEYS; i++)
		if (!strcmp(keys[i].section, section) && !strcmp(keys[i].name, name))
			return &keys[i];
	return NULL;
}

bool profile_section_is(const char *name)
{
	for (size_t i = 0; i < KEYS; i++)
		if (*name && !strcmp(keys[i].section, name))
			return true;
	return false;
}

/* A distance of words: letters that differ, compared from both ends. Enough for "transfersize", "end-point-in", "vendr". */
static size_t word_distance(const char *a, const char *b)
{
	size_t n = strlen(a), m = strlen(b), head = 0, tail = 0, least = n < m ? n : m;

	while (head < least && a[head] == b[head])
		head++;
	while (tail < least - head && a[n - 1 - tail] == b[m - 1 - tail])
		tail++;
	return (n > m ? n : m) - head - tail;
}

const char *profile_key_near(const char *section, const char *name)
{
	const char *found = NULL;
	size_t best = 4;

	for (size_t i = 0; i < KEYS; i++) {
		size_t d = word_distance(name, keys[i].name);

		if (!strcmp(keys[i].section, section) && d < best && d < strlen(name)) {
			best = d;
			found = keys[i].name;
		}
	}
	return found;
}
