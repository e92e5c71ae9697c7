/*
 * The reader: chunks one after the other, by compressor.
 *
 * Model: the caller gives one chunk of the file, which must end where the table says, or all points of a file without a table,
 * which are read chunk by chunk. Records are returned after the decoder of the chunk has checked them. The last records of a
 * chunk are only returned if its end is right, too.
 */
#include "laz.h"

#include "err.h"
#include "laz_parts.h"

#include <string.h>

struct laz_reader {
	unsigned length;
	uint32_t chunk_size;
	uint64_t counter;                /* bytes read */
	struct laz_pointwise *pointwise; /* one of these two */
	struct laz_layered *layered;
	uint64_t at, end; /* of the next chunk of the file; LAZ_OPEN */
	uint64_t left;    /* points to be read */
	uint64_t inner;   /* of them in the chunk that was begun */
	bool at_most;     /* they end where the chunk's bytes do */
	size_t good;
};

static size_t head_bytes(void)
{
	return (sizeof(struct laz_reader) + 63) & ~(size_t)63;
}

size_t laz_reader_bytes(const struct laz_format *f, enum laz_fields fields)
{
	return head_bytes() + (f->compressor == LAZ_COMPRESSOR_LAYERED ? laz_layered_bytes(f, fields) : laz_pointwise_bytes(f));
}

int laz_reader_new(void *memory, const struct laz_format *f, enum laz_fields fields, const struct laz_source *source,
		   struct laz_reader **ret, struct err *err)
{
	struct laz_reader *r = memory;
	void *rest = (uint8_t *)memory + head_bytes();

	for (unsigned i = 0; i < f->nitems; i++) {
		if (fields != LAZ_ALL || f->item[i].type != LAZ_BYTE14 || f->item[i].size <= LAZ_EXTRA_MAX)
			continue;
		err_set(err, ERR_UNSUPPORTED, "%u extra bytes in a record: this version decodes %d at most", f->item[i].size,
			LAZ_EXTRA_MAX);
		return err_add_place(err, ERR_NO_OFFSET, "item size");
	}
	memset(r, 0, sizeof *r);
	r->length = f->length;
	r->chunk_size = f->compressor == LAZ_COMPRESSOR_POINTWISE || f->chunk_size == LAZ_VARIABLE ? 0 : f->chunk_size;
	if (f->compressor == LAZ_COMPRESSOR_LAYERED)
		r->layered = laz_layered_new(rest, f, fields, source, &r->counter);
	else
		r->pointwise = laz_pointwise_new(rest, f, source, &r->counter);
	*ret = r;
	return 0;
}

int laz_reader_chunk(struct laz_reader *r, const struct laz_chunk *chunk, struct err *err)
{
	r->at = chunk->at;
	r->end = chunk->bytes ? chunk->at + chunk->bytes : LAZ_OPEN;
	r->left = chunk->points;
	r->inner = 0;
	r->at_most = chunk->at_most && (r->pointwise || !chunk->bytes);
	return 0;
}

static int begin(struct laz_reader *r, struct err *err)
{
	bool whole = r->end != LAZ_OPEN || !r->chunk_size || r->left < r->chunk_size;
	uint64_t most = whole ? r->left : r->chunk_size;
	int rc;

	r->inner = most;
	if (r->pointwise)
		return laz_pointwise_begin(r->pointwise, r->at, r->end, most, err);
	rc = laz_layered_begin(r->layered, r->at, r->end, r->at_most, &r->inner, err);
	if (rc)
		r->inner = 0;
	else if (r->chunk_size && r->inner < most)
		r->left = r->inner; /* only the last chunk is not full */
	return rc;
}

static int read_some(struct laz_reader *r, uint8_t *records, size_t n, struct err *err)
{
	int rc = r->layered ? laz_layered_read(r->layered, records, n, err) : laz_pointwise_read(r->pointwise, records, n, err);

	if (rc) {
		r->good += r->pointwise ? laz_pointwise_good(r->pointwise) : 0;
		return rc;
	}
	r->inner -= n;
	r->left -= n;
	if (r->at_most && r->pointwise && laz_pointwise_used(r->pointwise))
		r->inner = r->left = 0;
	if (!r->inner)
		rc = r->layered ? laz_layered_end(r->layered, &r->at, err) : laz_pointwise_end(r->pointwise, &r->at, err);
	if (!rc)
		r->good += n;
	return rc;
}

int laz_reader_read(struct laz_reader *r, uint8_t *records, size_t cap, size_t *ret_n, struct err *err)
{
	size_t n = 0;

	r->good = 0;
	while (n < cap && r->left) {
		int rc = r->inner ? 0 : begin(r, err);
		size_t m = cap - n;

		if (!rc) {
			m = m < r->inner ? m : (size_t)r->inner;
			m = r->at_most && r->pointwise ? 1 : m;
			rc = read_some(r, records + n * r->length, m, err);
		}
		if (rc)
			return rc;
		n += m;
	}
	*ret_n = n;
	return 0;
}

size_t laz_reader_good(const struct laz_reader *r)
{
	return r->good;
}

uint64_t laz_reader_place(const struct laz_reader *r)
{
	return r->at;
}

uint64_t laz_reader_bytes_read(const struct laz_reader *r)
{
	return r->counter;
}
