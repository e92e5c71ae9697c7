/*
 * Chunks of compressors 1 and 2: the first record raw, then all items of each record in one entropy-coded
 * stream.
 *
 * Model: one window, then the states of the items, in the memory of the caller. A chunk does not have its number of records; the
 * caller knows it. A record is only decoded if the previous one took no byte after the end of the stream. So if a batch fails,
 * the records before the failure are good.
 */
#include "laz_gpstime11.h"
#include "laz_items.h"
#include "laz_parts.h"
#include "laz_point10.h"
#include "laz_rgb12.h"

#include "err.h"

struct part {
	const struct laz_item_row *row;
	unsigned at, size; /* in the record */
	void *state;
};

/* The items of a record, for a loop over records that is made for them. */
enum shape { ANY, POINT_TIME_V1, POINT_TIME, POINT_COLOUR, POINT_TIME_COLOUR };

struct laz_pointwise {
	struct laz_window window;
	uint64_t end;
	unsigned nparts, length;
	bool first; /* the first record is still to be read */
	size_t good;
	enum shape shape;
	struct part part[LAZ_ITEMS];
};

const struct laz_item_row *laz_item_find(unsigned type, unsigned version)
{
	static const struct laz_item_row *const rows[] = {
		&laz_point10_v1, &laz_point10_v2,      &laz_gpstime11_v1, &laz_gpstime11_v2, &laz_rgb12_v1,
		&laz_rgb12_v2,   &laz_wavepacket13_v1, &laz_byte_v1,      &laz_byte_v2,
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		if (rows[i]->type == type && rows[i]->version == version)
			return rows[i];
	return NULL;
}

static size_t up64(size_t n)
{
	return (n + 63) & ~(size_t)63;
}

size_t laz_pointwise_bytes(const struct laz_format *f)
{
	size_t n = up64(sizeof(struct laz_pointwise)) + up64(laz_window_bytes(LAZ_STREAM_WINDOW));

	for (unsigned i = 0; i < f->nitems; i++)
		n += up64(laz_item_find(f->item[i].type, f->item[i].version)->bytes(f->item[i].size));
	return n;
}

static enum shape shape_of(const struct laz_pointwise *p)
{
	const struct part *part = p->part;

	if (p->nparts == 2 && part[0].row == &laz_point10_v1 && part[1].row == &laz_gpstime11_v1)
		return POINT_TIME_V1;
	if (p->nparts < 2 || p->nparts > 3 || part[0].row != &laz_point10_v2 || (p->nparts == 3 && part[2].row != &laz_rgb12_v2))
		return ANY;
	if (part[1].row == &laz_gpstime11_v2)
		return p->nparts == 2 ? POINT_TIME : POINT_TIME_COLOUR;
	return p->nparts == 2 && part[1].row == &laz_rgb12_v2 ? POINT_COLOUR : ANY;
}

struct laz_pointwise *laz_pointwise_new(void *memory, const struct laz_format *f, const struct laz_source *source,
					uint64_t *counter)
{
	struct laz_pointwise *p = memory;
	uint8_t *at = (uint8_t *)memory + up64(sizeof *p);

	memset(p, 0, sizeof *p);
	laz_window_init(&p->window, at, LAZ_STREAM_WINDOW, source, counter);
	at += up64(laz_window_bytes(LAZ_STREAM_WINDOW));
	p->length = f->length;
	p->nparts = f->nitems;
	for (unsigned i = 0, place = 0; i < f->nitems; i++) {
		struct part *part = &p->part[i];

		part->row = laz_item_find(f->item[i].type, f->item[i].version);
		part->at = place;
		part->size = f->item[i].size;
		part->state = at;
		at += up64(part->row->bytes(part->size));
		place += part->size;
	}
	p->shape = shape_of(p);
	return p;
}

int laz_pointwise_begin(struct laz_pointwise *p, uint64_t at, uint64_t end, uint64_t points, struct err *err)
{
	p->end = end;
	p->first = true;
	return laz_window_begin(&p->window, at, end, "points", err);
}

static int read_first(struct laz_pointwise *p, uint8_t *record, struct err *err)
{
	int rc = laz_window_take(&p->window, record, p->length, err);

	if (!rc)
		rc = laz_coder_begin(&p->window, err);
	if (rc)
		return rc;
	for (unsigned i = 0; i < p->nparts; i++)
		p->part[i].row->begin(p->part[i].state, record + p->part[i].at, p->part[i].size);
	p->first = false;
	return 0;
}

/* The items of one record. With a constant shape all is inlined, and the coder stays in registers from one item to the next. */
LAZ_INLINE int read_items(struct laz_pointwise *p, enum shape shape, struct laz_coder *c, uint8_t *record, struct err *err)
{
	const struct part *part = p->part;
	struct laz_window *w = &p->window;
	int rc = 0;

	for (unsigned k = 0; shape == ANY && !rc && k < p->nparts; k++)
		rc = part[k].row->read(part[k].state, w, c, record + part[k].at, part[k].size, err);
	if (shape == POINT_TIME_V1) {
		laz_point10_read_v1(part[0].state, w, c, record, 20, err);
		laz_gpstime11_read_v1(part[1].state, w, c, record + 20, 8, err);
	} else if (shape != ANY) {
		laz_point10_read_v2(part[0].state, w, c, record, 20, err);
		if (shape != POINT_COLOUR)
			laz_gpstime11_read_v2(part[1].state, w, c, record + 20, 8, err);
		if (shape == POINT_COLOUR)
			laz_rgb12_read_v2(part[1].state, w, c, record + 20, 6, err);
		if (shape == POINT_TIME_COLOUR)
			laz_rgb12_read_v2(part[2].state, w, c, record + 28, 6, err);
	}
	return rc;
}

LAZ_INLINE int read_shape(struct laz_pointwise *p, enum shape shape, uint8_t *record, size_t n, struct err *err)
{
	struct laz_coder c = p->window.coder;
	int rc = 0;

	for (size_t i = 0; i < n; i++, record += p->length) {
		rc = laz_window_ready(&p->window, &c, err);
		if (rc) {
			p->good -= p->good > 0; /* the one before took more than there is */
			break;
		}
		rc = read_items(p, shape, &c, record, err);
		if (rc)
			return rc;
		p->good++;
	}
	p->window.coder = c;
	return rc;
}

static int read_records(struct laz_pointwise *p, uint8_t *record, size_t n, struct err *err)
{
	switch (p->shape) {
	case POINT_TIME_V1:
		return read_shape(p, POINT_TIME_V1, record, n, err);
	case POINT_TIME:
		return read_shape(p, POINT_TIME, record, n, err);
	case POINT_COLOUR:
		return read_shape(p, POINT_COLOUR, record, n, err);
	case POINT_TIME_COLOUR:
		return read_shape(p, POINT_TIME_COLOUR, record, n, err);
	default:
		return read_shape(p, ANY, record, n, err);
	}
}

int laz_pointwise_read(struct laz_pointwise *p, uint8_t *records, size_t n, struct err *err)
{
	int rc;

	p->good = 0;
	if (n && p->first) {
		rc = read_first(p, records, err);
		if (rc)
			return rc;
		p->good = 1;
		records += p->length;
		n--;
	}
	rc = read_records(p, records, n, err);
	if (rc)
		return rc;
	rc = laz_window_check(&p->window, err);
	if (rc)
		p->good -= p->good > 0;
	return rc;
}

bool laz_pointwise_used(const struct laz_pointwise *p)
{
	return laz_window_place(&p->window) == p->window.end;
}

size_t laz_pointwise_good(const struct laz_pointwise *p)
{
	return p->window.truncated && !p->window.coder.bad ? p->good : 0;
}

int laz_pointwise_end(struct laz_pointwise *p, uint64_t *ret_end, struct err *err)
{
	int rc = p->end == LAZ_OPEN ? laz_window_check(&p->window, err) : laz_window_finish(&p->window, err);

	if (!rc)
		*ret_end = laz_window_place(&p->window);
	return rc;
}
