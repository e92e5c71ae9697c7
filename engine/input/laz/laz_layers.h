/*
 * The layers of a layered chunk (compressor 3): each field, or group of fields, is a stream of its own, so that
 * one can be decoded without the others. Only the first, of channel, returns, x and y, stands alone; it tells
 * the others in a struct laz_step for each record what they go by.
 *
 * Every layer has one state for each of the four scanner channels. That of a channel's first record opens with
 * what the record before it ended with.
 */
#ifndef LAZ_LAYERS_H
#define LAZ_LAYERS_H

#include <stdalign.h>

#include "laz_items.h"

enum { LAZ_CHANNELS = 4, LAZ_BATCH = 256 };

/* Places in a record of the item POINT14. */
enum {
	LAZ_AT_X = 0,
	LAZ_AT_Y = 4,
	LAZ_AT_Z = 8,
	LAZ_AT_INTENSITY = 12,
	LAZ_AT_RETURNS = 14,
	LAZ_AT_FLAGS = 15,
	LAZ_AT_CLASS = 16,
	LAZ_AT_USER = 17,
	LAZ_AT_ANGLE = 18,
	LAZ_AT_SOURCE = 20,
	LAZ_AT_TIME = 22,
};

enum {
	LAZ_NEW_ANGLE = 1,
	LAZ_NEW_TIME = 2,
	LAZ_NEW_SOURCE = 4, /* differ from the channel's record before */
	LAZ_OPENS = 8,      /* the first record of its channel in the chunk */
};

struct laz_step {
	uint8_t channel;
	uint8_t item_channel; /* what the items other than POINT14 take for the channel: see laz_turn */
	uint8_t changes;
	uint8_t place;     /* 0 a return between others, 1 the last, 2 the first, 3 the only one of its pulse */
	uint8_t level;     /* returns that the pulse had after it, up to 7 */
	uint8_t z_context; /* whether the only one; bits of the steps in x and y */
};

struct laz_layer_row {
	const char *field;
	size_t bytes; /* of its state */
	bool terrain; /* LAZ_TERRAIN wants it */
	/* A new chunk; `first` is the item of its first record, `fixed` whether the item is of version 4. */
	void (*begin)(void *state, const uint8_t *first, unsigned channel, bool fixed);
	/* The field of the next n records, up to LAZ_BATCH; `item` is the place of the item in the first one.
	 * The steps are written by the first layer (laz_layer_xy) and read by the others. */
	int (*read)(void *state, struct laz_window *, struct laz_step *, uint8_t *item, size_t length, size_t n, struct err *err);
};

/* The layers of x and y, z, and intensity (NULL: without it) at once: their streams do not wait for each other, so that the
 * processor decodes them side by side. The row of z has no `read` of its own. */
struct laz_stream {
	void *state;
	struct laz_window *window;
};
int laz_xyz_read(const struct laz_stream *xy, const struct laz_stream *z, const struct laz_stream *light, struct laz_step *step,
		 uint8_t *item, size_t length, size_t n, struct err *err);

extern const struct laz_layer_row laz_layer_xy, laz_layer_z, laz_layer_class, laz_layer_flags, laz_layer_intensity,
	laz_layer_angle, laz_layer_user, laz_layer_source, laz_layer_time, laz_layer_rgb, laz_layer_nir, laz_layer_wavepacket,
	laz_layer_byte;

/*
 * Which channel's state decodes an item other than POINT14. Writers of version 3 made two mistakes that became
 * its definition: the channel is only known to the items in the very record in which it changes and counts as 0
 * in all others (laz_step.item_channel has this); and where an item comes back to a channel that it knows, it
 * takes, and replaces, the last value of the channel that it leaves. Version 4 does neither.
 */
struct laz_turns {
	uint8_t now, known; /* channel; bit i: channel i is open */
	bool fixed;
};

static inline void laz_turns_begin(struct laz_turns *t, unsigned channel, bool fixed)
{
	*t = (struct laz_turns){.now = (uint8_t)channel, .known = (uint8_t)(1u << channel), .fixed = fixed};
}

/* To another channel. Gives the channel whose last value counts; *ret_open: the new one must be opened first. */
static inline unsigned laz_turn(struct laz_turns *t, unsigned channel, bool *ret_open)
{
	unsigned left = t->now;

	t->now = (uint8_t)channel;
	*ret_open = !(t->known >> channel & 1);
	t->known |= (uint8_t)(1u << channel);
	return *ret_open || t->fixed ? channel : left;
}

#endif
