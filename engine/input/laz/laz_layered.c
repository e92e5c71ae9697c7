/*
 * Chunks of compressor 3: the first record raw, the number of points, the size of each layer, then the layers. Each layer is an
 * entropy-coded stream of its own.
 *
 * Model: each layer that is wanted has a window; the others are skipped by their size. Records are decoded in batches, one layer
 * after the other, so that the models and the coder of one layer stay in the processor's cache. In a layer of size 0 all records
 * have the value of the first one.
 *
 * The number of points in the chunk must be that of the chunk table. Different parts of an encoder write them, and if they differ
 * it is not known which is right.
 */
#include "laz_layers.h"
#include "laz_parts.h"

#include <inttypes.h>

#include "err.h"

enum { POINT_LAYERS = 9, AT_INTENSITY = 4 };

struct layer {
	const struct laz_layer_row *row;
	struct laz_window window;
	void *state;
	unsigned at;           /* of its item in the record */
	bool fixed;            /* its item is of version 4 */
	uint64_t begin, bytes; /* in the file */
};

struct laz_layered {
	const struct laz_format *format;
	const struct laz_source *source;
	uint64_t *counter;
	enum laz_fields fields;
	unsigned nlayers; /* wanted ones; the first is that of x and y */
	bool first;       /* the first record is still to be given */
	uint64_t end;     /* of the chunk */
	struct laz_step *steps;
	uint8_t *record; /* the first one */
	struct layer *layer;
};

static size_t up64(size_t n)
{
	return (n + 63) & ~(size_t)63;
}

/* The i-th layer of an item; NULL behind its last. */
static const struct laz_layer_row *item_layer(const struct laz_item *item, unsigned i)
{
	static const struct laz_layer_row *const point[POINT_LAYERS + 1] = {
		&laz_layer_xy,    &laz_layer_z,    &laz_layer_class,  &laz_layer_flags, &laz_layer_intensity,
		&laz_layer_angle, &laz_layer_user, &laz_layer_source, &laz_layer_time,  NULL,
	};

	switch (item->type) {
	case LAZ_POINT14:
		return point[i];
	case LAZ_RGB14:
		return i ? NULL : &laz_layer_rgb;
	case LAZ_RGBNIR14:
		return i > 1 ? NULL : i ? &laz_layer_nir : &laz_layer_rgb;
	case LAZ_WAVEPACKET14:
		return i ? NULL : &laz_layer_wavepacket;
	default:
		return i < item->size ? &laz_layer_byte : NULL;
	}
}

static bool wanted(const struct laz_layer_row *row, enum laz_fields fields)
{
	return row->terrain || fields == LAZ_ALL;
}

/* All layers of a record, and of the wanted ones how many, and the bytes of their states and windows. */
static unsigned count_layers(const struct laz_format *f, enum laz_fields fields, unsigned *ret_wanted, size_t *ret_bytes)
{
	const struct laz_layer_row *row;
	unsigned n = 0;

	*ret_wanted = 0;
	*ret_bytes = 0;
	for (unsigned i = 0; i < f->nitems; i++) {
		for (unsigned k = 0; (row = item_layer(&f->item[i], k)); k++, n++) {
			if (!wanted(row, fields))
				continue;
			++*ret_wanted;
			*ret_bytes += up64(row->bytes) + up64(laz_window_bytes(LAZ_LAYER_WINDOW));
		}
	}
	return n;
}

size_t laz_layered_bytes(const struct laz_format *f, enum laz_fields fields)
{
	unsigned layers;
	size_t n;

	count_layers(f, fields, &layers, &n);
	return n + up64(sizeof(struct laz_layered)) + up64(LAZ_BATCH * sizeof(struct laz_step)) + up64(f->length) +
	       up64(layers * sizeof(struct layer));
}

static void *take(uint8_t **at, size_t n)
{
	uint8_t *taken = *at;

	*at += up64(n);
	return taken;
}

static void add_layers(struct laz_layered *l, const struct laz_item *item, unsigned place, uint8_t **memory)
{
	const struct laz_layer_row *row;

	for (unsigned i = 0; (row = item_layer(item, i)); i++) {
		struct layer *layer = &l->layer[l->nlayers];

		if (!wanted(row, l->fields))
			continue;
		memset(layer, 0, sizeof *layer);
		layer->row = row;
		layer->at = place + (item->type == LAZ_BYTE14 ? i : 0);
		layer->fixed = item->version >= 4;
		layer->state = take(memory, row->bytes);
		laz_window_init(&layer->window, take(memory, laz_window_bytes(LAZ_LAYER_WINDOW)), LAZ_LAYER_WINDOW, l->source,
				l->counter);
		l->nlayers++;
	}
}

struct laz_layered *laz_layered_new(void *memory, const struct laz_format *f, enum laz_fields fields,
				    const struct laz_source *source, uint64_t *counter)
{
	uint8_t *at = memory;
	struct laz_layered *l = take(&at, sizeof *l);
	unsigned layers, place = 0;
	size_t bytes;

	memset(l, 0, sizeof *l);
	l->format = f;
	l->source = source;
	l->counter = counter;
	l->fields = fields;
	count_layers(f, fields, &layers, &bytes);
	l->steps = take(&at, LAZ_BATCH * sizeof *l->steps);
	l->record = take(&at, f->length);
	l->layer = take(&at, layers * sizeof *l->layer);
	for (unsigned i = 0; i < f->nitems; i++) {
		add_layers(l, &f->item[i], place, &at);
		place += f->item[i].size;
	}
	return l;
}

static int read_u32(struct laz_window *w, uint32_t *ret, struct err *err)
{
	uint8_t b[4];
	int rc = laz_window_take(w, b, sizeof b, err);

	if (!rc)
		*ret = laz_get32(b);
	return rc;
}

/* The next layer's size, through `head`; *at moves from its begin to its end. */
static int place_layer(struct laz_layered *l, const struct laz_layer_row *row, struct laz_window *head, uint64_t *at,
		       struct layer **layer, struct err *err)
{
	uint32_t bytes;
	int rc = read_u32(head, &bytes, err);

	if (rc)
		return rc;
	if (l->end != LAZ_OPEN && bytes > l->end - *at) {
		err_set(err, ERR_INPUT, "a layer of %" PRIu32 " bytes, but only %" PRIu64 " are left of the chunk", bytes,
			l->end - *at);
		return err_add_place(err, laz_window_place(head) - 4, row->field);
	}
	if (wanted(row, l->fields)) {
		(*layer)->begin = *at;
		(*layer)->bytes = bytes;
		++*layer;
	}
	*at += bytes;
	return 0;
}

/* Everything before the layers, which begin at byte `at`. */
static int read_head(struct laz_layered *l, struct laz_window *head, uint64_t at, bool at_most, uint64_t *points, struct err *err)
{
	const struct laz_format *f = l->format;
	const struct laz_layer_row *row;
	struct layer *layer = l->layer;
	uint32_t count;
	int rc = laz_window_take(head, l->record, f->length, err);

	if (!rc)
		rc = read_u32(head, &count, err);
	if (rc)
		return rc;
	if (at_most && count && count < *points)
		*points = count;
	if (count != *points) {
		err_set(err, ERR_INPUT, "a chunk of %" PRIu64 " points that says of itself that it has %" PRIu32, *points, count);
		return err_add_place(err, laz_window_place(head) - 4, "points of the chunk");
	}
	for (unsigned i = 0; !rc && i < f->nitems; i++)
		for (unsigned k = 0; !rc && (row = item_layer(&f->item[i], k)); k++)
			rc = place_layer(l, row, head, &at, &layer, err);
	if (rc)
		return rc;
	if (l->end != LAZ_OPEN && at != l->end) {
		err_set(err, ERR_INPUT, "the chunk ends %" PRIu64 " bytes behind its last layer", l->end - at);
		return err_add_place(err, at, "compressed points");
	}
	l->end = at;
	return 0;
}

/* In a chunk of one point all layers are empty. */
static int begin_layer(struct laz_layered *l, struct layer *layer, uint64_t points, struct err *err)
{
	int rc;

	layer->row->begin(layer->state, l->record + layer->at, l->record[LAZ_AT_FLAGS] >> 4 & 3, layer->fixed);
	if (!layer->bytes) {
		if (layer->row != &laz_layer_xy || points == 1)
			return 0;
		err_set(err, ERR_INPUT, "the layer is empty");
		return err_add_place(err, layer->begin, layer->row->field);
	}
	rc = laz_window_begin(&layer->window, layer->begin, layer->begin + layer->bytes, layer->row->field, err);
	return rc ? rc : laz_coder_begin(&layer->window, err);
}

int laz_layered_begin(struct laz_layered *l, uint64_t at, uint64_t end, bool at_most, uint64_t *points, struct err *err)
{
	struct laz_window *head = &l->layer[0].window;
	uint64_t layers_at;
	unsigned wanted_layers;
	size_t bytes;
	int rc;

	layers_at = at + l->format->length + 4 + 4 * count_layers(l->format, l->fields, &wanted_layers, &bytes);
	l->end = end;
	l->first = true;
	rc = laz_window_begin(head, at, layers_at < end ? layers_at : end, "compressed points", err);
	if (!rc)
		rc = read_head(l, head, layers_at, at_most, points, err);
	for (unsigned i = 0; !rc && i < l->nlayers; i++)
		rc = begin_layer(l, &l->layer[i], *points, err);
	return rc;
}

/* The layers that are read at once: x and y, z, and intensity if it is there. *ret_done: bit i: layer i was read. */
static int read_beside(struct laz_layered *l, uint8_t *records, size_t n, unsigned *ret_done, struct err *err)
{
	struct laz_stream stream[AT_INTENSITY + 1];
	bool light = l->fields == LAZ_ALL && l->layer[AT_INTENSITY].bytes;
	int rc;

	for (unsigned i = 0; i < l->nlayers && i <= AT_INTENSITY; i++)
		stream[i] = (struct laz_stream){l->layer[i].state, &l->layer[i].window};
	rc = laz_xyz_read(&stream[0], &stream[1], light ? &stream[AT_INTENSITY] : NULL, l->steps, records, l->format->length, n,
			  err);
	for (unsigned i = 0; !rc && i < 2; i++)
		rc = laz_window_check(&l->layer[i].window, err);
	if (!rc && light)
		rc = laz_window_check(&l->layer[AT_INTENSITY].window, err);
	*ret_done = light ? 3 | 1u << AT_INTENSITY : 3;
	return rc;
}

static int read_batch(struct laz_layered *l, uint8_t *records, size_t n, struct err *err)
{
	size_t length = l->format->length;
	unsigned done = 0;
	int rc;

	for (size_t i = 0; i < n; i++)
		memcpy(records + i * length, l->record, length);
	if (l->layer[0].bytes && l->layer[1].bytes) {
		rc = read_beside(l, records, n, &done, err);
		if (rc)
			return rc;
	}
	for (unsigned i = 0; i < l->nlayers; i++) {
		struct layer *layer = &l->layer[i];

		if (!layer->bytes || (i < POINT_LAYERS && done >> i & 1) || i == 1)
			continue;
		rc = layer->row->read(layer->state, &layer->window, l->steps, records + layer->at, length, n, err);
		if (!rc)
			rc = laz_window_check(&layer->window, err);
		if (rc)
			return rc;
	}
	return 0;
}

int laz_layered_read(struct laz_layered *l, uint8_t *records, size_t n, struct err *err)
{
	if (n && l->first) {
		memcpy(records, l->record, l->format->length);
		records += l->format->length;
		l->first = false;
		n--;
	}
	while (n) {
		size_t batch = n < LAZ_BATCH ? n : LAZ_BATCH;
		int rc = read_batch(l, records, batch, err);

		if (rc)
			return rc;
		records += batch * l->format->length;
		n -= batch;
	}
	return 0;
}

int laz_layered_end(struct laz_layered *l, uint64_t *ret_end, struct err *err)
{
	for (unsigned i = 0; i < l->nlayers; i++) {
		int rc = l->layer[i].bytes ? laz_window_finish(&l->layer[i].window, err) : 0;

		if (rc)
			return rc;
	}
	*ret_end = l->end;
	return 0;
}
