/*
 * The item BYTE: extra bytes of a record, each a difference to the same byte of the record before; versions 1
 * (integer compressor, a context for each byte) and 2 (a model for each byte).
 */
#include "laz_items.h"

#include "laz_parts.h"

/* Bytes between two looks at the window. */
enum { STEP = 16 };

struct extra {
	uint8_t last[LAZ_EXTRA_MAX];
	/* models follow */
};

_Static_assert(sizeof(struct extra) % 16 == 0, "models are aligned");
_Static_assert(STEP * 10 <= LAZ_GUARD, "what laz_int_read takes at most");

static uint8_t *models(struct extra *e)
{
	return (uint8_t *)(e + 1);
}

static size_t bytes_v1(unsigned size)
{
	return sizeof(struct extra) + LAZ_INT_BYTES(8, size);
}

static size_t bytes_v2(unsigned size)
{
	return sizeof(struct extra) + size * LAZ_MODEL_BYTES(256);
}

static void begin_v1(void *state, const uint8_t *first, unsigned size)
{
	struct extra *e = state;

	memcpy(e->last, first, size);
	laz_int_reset((struct laz_int *)models(e), 8, size);
}

static void begin_v2(void *state, const uint8_t *first, unsigned size)
{
	struct extra *e = state;

	memcpy(e->last, first, size);
	laz_models_reset((struct laz_model *)models(e), 256, size);
}

static int read_v1(void *state, struct laz_window *w, struct laz_coder *c, uint8_t *item, unsigned size, struct err *err)
{
	struct extra *e = state;

	for (unsigned i = 0; i < size; i++) {
		unsigned k;
		int rc = i % STEP == 0 ? laz_window_ready(w, c, err) : 0;

		if (rc)
			return rc;
		e->last[i] = (uint8_t)laz_int_read(c, (struct laz_int *)models(e), 8, size, e->last[i], i, &k);
	}
	memcpy(item, e->last, size);
	return 0;
}

static int read_v2(void *state, struct laz_window *w, struct laz_coder *coder, uint8_t *item, unsigned size, struct err *err)
{
	struct extra *e = state;
	struct laz_coder c = laz_coder_copy(coder);

	for (unsigned i = 0; i < size; i++) {
		int rc = i % STEP == 0 ? laz_window_ready(w, &c, err) : 0;

		if (rc)
			return rc;
		e->last[i] =
			(uint8_t)(e->last[i] + laz_symbol_lazy(&c, laz_model_at((struct laz_model *)models(e), 256, i), 256));
	}
	memcpy(item, e->last, size);
	*coder = c;
	return 0;
}

const struct laz_item_row laz_byte_v1 = {LAZ_BYTE, 1, bytes_v1, begin_v1, read_v1};
const struct laz_item_row laz_byte_v2 = {LAZ_BYTE, 2, bytes_v2, begin_v2, read_v2};
