/*
 * Compressed LAS (LAZ): reads the chunks, and gives their records to input_las.c.
 *
 * Model: when the file is opened, only the chunk table is read, in the read buffer; it determines the number of parts. The first
 * read allocates the memory for decoder and table (info.read_bytes) and goes to the first chunk of its part. Then batches of
 * records are put into the read buffer as if they came from a LAS file. Without a usable table all points are one part.
 *
 * A decoding error is an error of the file. With --accept-truncated a truncated file gives the points before the cut.
 */
#include "input_las_parts.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"

enum { BATCH = 1024 }; /* records, so that they stay in the cache between decoder and points */

enum { AT_FORMAT = 104 };

struct input_laz_reading {
	struct laz_source source;
	struct laz_reader *reader;
	struct laz_table *table;      /* NULL: all is one chunk */
	struct input_copc_walk *walk; /* NULL: chunks come from the table */
	uint64_t chunk;               /* the next one of the table, or node of the walk */
	bool open;                    /* a chunk was begun */
	bool cut;                     /* the points end with the file, and not where they should */
};

/* The file, up to place.end. */
static int read_source(void *ctx, uint64_t at, void *buf, size_t n, size_t *ret_n, struct err *err)
{
	struct input *in = ctx;
	uint64_t end = input_las_of(in)->place.end;

	*ret_n = 0;
	if (at >= end)
		return 0;
	return io_read_some(in->fd, buf, n < end - at ? n : (size_t)(end - at), at, in->name, ret_n, err);
}

static size_t up64(size_t n)
{
	return (n + 63) & ~(size_t)63;
}

static enum laz_fields fields(const struct input_las *las)
{
	return las->watch ? LAZ_ALL : LAZ_TERRAIN;
}

/* Memory for the chunk table or the hierarchy of COPC: always the larger of both. */
static size_t table_bytes(void)
{
	return sizeof(struct input_copc_walk) > laz_table_bytes() ? sizeof(struct input_copc_walk) : laz_table_bytes();
}

static size_t read_bytes(const struct input_las *las)
{
	return up64(sizeof(struct input_laz_reading)) + up64(table_bytes()) + up64(laz_reader_bytes(&las->laz, fields(las))) + 64;
}

/* Counts the points by the chunks, since the header has no count. The table is in the read buffer; without a table, only reading
 * the points gives their number. *end: the end of the points. */
static int find_uncounted(struct input *in, const struct laz_source *source, uint64_t *end, struct err *err)
{
	struct input_las *las = input_las_of(in);
	struct laz_place place = las->place;
	int rc;

	place.end = *end;
	rc = laz_table_count(in->buffer, &las->laz, source, &place, err);
	if (rc || !place.points)
		return rc;
	if (place.points == LAZ_UNCOUNTED)
		input_las_tell_uncounted(in, "", place.end - laz_table_whole(&las->laz, &place).at, " bytes of points");
	else
		input_las_tell_uncounted(in, place.at_most ? "up to " : "", place.points, "");
	if (!in->accept_truncated)
		return 0;
	*end = place.end;
	las->place.points = place.points;
	las->place.at_most = place.at_most;
	if (place.points != LAZ_UNCOUNTED)
		in->info.claimed = place.points;
	return 0;
}

int input_laz_open(struct input *in, uint64_t points, uint64_t end, struct err *err)
{
	struct input_las *las = input_las_of(in);
	const struct laz_source source = {in, read_source};
	struct laz_table *table;
	uint64_t chunks;
	const char *why;
	int rc;

	if (!las->has_laszip)
		return input_fail(in, err, ERR_INPUT, AT_FORMAT, "point format",
				  "the point format says that the points are compressed (LAZ), but no record says how");
	rc = laz_format_parse(las->laszip, las->laszip_size, las->format, las->length, &las->laz, err);
	if (rc) {
		err->offset = err->offset == ERR_NO_OFFSET ? las->laszip_at : err->offset + las->laszip_at;
		return err_add_file(err, in->name);
	}
	/* the table may come after other records, the points may not */
	las->place = (struct laz_place){.begin = las->point_offset, .end = in->size, .points = points, .size = in->size};
	_Static_assert(offsetof(struct input, buffer) % 16 == 0, "the table may lie in the buffer");
	if (laz_table_bytes() > sizeof in->buffer)
		return err_set(err, ERR_INTERNAL, "no room for a chunk table");
	rc = points ? 0 : find_uncounted(in, &source, &end, err);
	if (!rc)
		rc = laz_table_open(in->buffer, &las->laz, &source, &las->place, &table, &chunks, &why, err);
	if (rc)
		return err_add_file(err, in->name);
	las->left = las->place.points;
	las->chunks = chunks;
	las->chunks_end = chunks ? laz_table_end(table) : 0;
	if (chunks)
		rc = input_copc_open(in, table, err);
	if (rc)
		return err_add_file(err, in->name);
	las->place.end = end;
	if (las->copc.selects) {
		las->left = in->info.claimed;
		las->chunks = las->copc.nodes;
	}
	las->part_last = las->chunks ? las->chunks : 1;
	in->info.parts = las->part_last;
	in->info.read_bytes = read_bytes(las);
	if (why && las->place.points != LAZ_UNCOUNTED)
		input_warn(in, "%s; the points are read without it", why);
	return 0;
}

/* The memory, and the table at the first chunk of the part. */
static int start(struct input *in, struct err *err)
{
	struct input_las *las = input_las_of(in);
	struct input_laz_reading *r;
	uint64_t chunks, end = las->place.end;
	const char *why;
	uint8_t *at;
	int rc;

	las->memory = malloc(read_bytes(las));
	if (!las->memory) {
		err_set(err, ERR_NOMEM, "no memory to decode compressed points");
		return err_add_file(err, in->name);
	}
	at = (uint8_t *)up64((uintptr_t)las->memory);
	r = las->reading = (struct input_laz_reading *)at;
	*r = (struct input_laz_reading){.source = {in, read_source}};
	at += up64(sizeof *r);
	if (las->copc.selects) {
		r->walk = (struct input_copc_walk *)at;
		input_copc_walk_begin(r->walk, &las->copc, false);
	} else if (las->chunks) {
		las->place.end = in->size;
		rc = laz_table_open(at, &las->laz, &r->source, &las->place, &r->table, &chunks, &why, err);
		las->place.end = end;
		if (!rc && (why || chunks != las->chunks))
			rc = input_fail(in, err, ERR_CHANGED, las->point_offset, "chunk table",
					"the file changed while it was read");
		if (rc)
			return err_add_file(err, in->name);
	}
	return laz_reader_new(at + up64(table_bytes()), &las->laz, fields(las), &r->source, &r->reader, err);
}

static int next_place(struct input *in, struct laz_chunk *ret, bool *ret_more, struct err *err)
{
	struct input_laz_reading *r = input_las_of(in)->reading;
	const char *why = NULL;
	bool meets;
	int rc;

	if (!r->walk)
		return laz_table_next(r->table, ret, ret_more, err);
	rc = input_copc_walk_next(in, r->walk, ret, &meets, ret_more, &why, err);
	if (!rc && why)
		return input_fail(in, err, ERR_CHANGED, input_las_of(in)->copc.at, "COPC hierarchy",
				  "the file changed while it was read");
	return rc;
}

/* *ret_more: another chunk of the part was begun. */
static int next_chunk(struct input *in, bool *ret_more, struct err *err)
{
	struct input_las *las = input_las_of(in);
	struct input_laz_reading *r = las->reading;
	struct laz_chunk chunk;

	if (!r->table && !r->walk) {
		*ret_more = !r->open;
		r->open = true;
		chunk = laz_table_whole(&las->laz, &las->place);
		return *ret_more ? laz_reader_chunk(r->reader, &chunk, err) : 0;
	}
	for (; r->chunk < las->part_last; r->chunk++) {
		int rc = next_place(in, &chunk, ret_more, err);

		if (rc || !*ret_more)
			return rc;
		if (r->chunk < las->part_first) {
			in->info.first_point += chunk.points;
			continue;
		}
		r->chunk++;
		r->open = true;
		return laz_reader_chunk(r->reader, &chunk, err);
	}
	*ret_more = false;
	return 0;
}

static void tell_read(struct input *in, uint64_t points)
{
	input_warn(in, "%" PRIu64 " points were read", points);
}

/* A file that was cut short: the `good` records in the buffer are the last ones. */
static int settle_cut(struct input *in, size_t good, struct err *err)
{
	struct input_las *las = input_las_of(in);
	bool uncounted = las->place.points == LAZ_UNCOUNTED;
	uint64_t there = (uncounted ? LAZ_UNCOUNTED : in->info.claimed) - las->left + good;

	err_clear(err);
	las->reading->cut = true;
	in->info.miscounted = true;
	if (uncounted)
		tell_read(in, there);
	else
		input_warn(in, "%" PRIu64 " of %" PRIu64 " points are there", there, in->info.claimed);
	las->n_buffered = las->left = good;
	return 0;
}

static int fail(struct input *in, int rc, struct err *err)
{
	struct input_las *las = input_las_of(in);
	struct err changed = ERR_INIT;

	err_add_file(err, in->name);
	if (rc != -ERR_TRUNCATED && rc != -ERR_INPUT)
		return rc;
	if (input_check_unchanged(in, &changed)) {
		*err = changed;
		return -changed.code;
	}
	if (rc == -ERR_TRUNCATED && in->accept_truncated && in->info.parts == 1)
		return settle_cut(in, laz_reader_good(las->reading->reader), err);
	if (rc == -ERR_TRUNCATED)
		err_add_hint(err, "copy it again, or take what is there with --accept-truncated");
	return rc;
}

int input_laz_refill(struct input *in, struct err *err)
{
	struct input_las *las = input_las_of(in);
	size_t cap = sizeof in->buffer / las->length, n = 0;
	int rc = las->memory ? 0 : start(in, err);
	bool more = true;

	las->n_buffered = las->i_buffered = 0;
	if (rc)
		return rc;
	cap = cap < BATCH ? cap : BATCH;
	while (!rc && !n && more) {
		if (las->reading->open)
			rc = laz_reader_read(las->reading->reader, in->buffer, cap, &n, err);
		if (!rc && !n)
			rc = next_chunk(in, &more, err);
	}
	in->bytes_read = laz_reader_bytes_read(las->reading->reader);
	if (rc)
		return fail(in, rc, err);
	las->n_buffered = n;
	if (!more && las->place.points == LAZ_UNCOUNTED)
		tell_read(in, LAZ_UNCOUNTED - las->left);
	if (!more)
		las->left = 0;
	return 0;
}

void input_laz_finish(struct input *in)
{
	const struct input_laz_reading *r = input_las_of(in)->reading;

	if (r && !r->table && !r->walk)
		input_las_account(in, r->cut ? input_las_of(in)->place.end : laz_reader_place(r->reader));
}

void input_laz_part(struct input *in, uint64_t first, uint64_t last)
{
	struct input_las *las = input_las_of(in);

	las->memory = NULL;
	las->reading = NULL;
	las->part_first = first;
	las->part_last = last;
}

void input_laz_close(struct input *in)
{
	free(input_las_of(in)->memory);
}
