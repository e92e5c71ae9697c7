/*
 * The chunk table of compressors 2 and 3: where each chunk begins and how many points it has.
 *
 * Model: the table is an entropy-coded list of sizes; the place of a chunk is the sum of the sizes before it. The table is
 * decoded through a small window and not kept. laz_table_open decodes it once and checks everything that can be checked without
 * reading chunks; a table that fails is not used at all. Afterwards its places and sizes are trusted, and each chunk must end
 * where the table says.
 *
 * Not here: the hierarchy of COPC, which has the same information about chunks and more.
 */
#include "laz.h"

#include "err.h"
#include "laz_coder.h"
#include "laz_items.h"

#include <inttypes.h>
#include <stdalign.h>

enum { WINDOW = 2048, HEAD = 8 };

struct laz_table {
	struct laz_window window;
	uint64_t address, counter;
	uint64_t begin, points; /* of the first chunk; that the header claims */
	uint32_t n, i;          /* chunks; given so far */
	uint64_t at, left;      /* of the next chunk; points not yet in a chunk */
	uint32_t chunk_size, min_bytes;
	uint32_t last_points, last_bytes;
	bool variable, at_most;
	uint64_t end, size; /* behind the table; of the file */
	bool elsewhere;     /* its address is at the end of the file */
	alignas(16) uint8_t ints[LAZ_INT_BYTES(32, 2)];
	uint8_t buffer[WINDOW + LAZ_GUARD];
};

size_t laz_table_bytes(void)
{
	return sizeof(struct laz_table);
}

struct laz_chunk laz_table_whole(const struct laz_format *f, const struct laz_place *place)
{
	return (struct laz_chunk){
		.at = place->begin + (f->compressor == LAZ_COMPRESSOR_POINTWISE ? 0 : HEAD),
		.points = place->points,
		.at_most = place->at_most,
	};
}

/* Before the first chunk of the table. */
static int rewind_table(struct laz_table *t, struct err *err)
{
	uint8_t head[HEAD];
	int rc = laz_window_begin(&t->window, t->address, LAZ_OPEN, "chunk table", err);

	if (!rc)
		rc = laz_window_take(&t->window, head, HEAD, err);
	if (rc)
		return rc;
	t->n = laz_get32(head + 4);
	if (laz_get32(head) != 0) {
		err_set(err, ERR_INPUT, "a chunk table of version %" PRIu32, laz_get32(head));
		return err_add_place(err, t->address, "chunk table");
	}
	t->i = 0;
	t->at = t->begin;
	t->left = t->points;
	t->last_points = t->last_bytes = 0;
	laz_int_reset((struct laz_int *)t->ints, 32, 2);
	return t->n ? laz_coder_begin(&t->window, err) : 0;
}

static int bad_entry(const struct laz_table *t, struct err *err)
{
	err_set(err, ERR_INPUT, "chunk %" PRIu32 " of the chunk table, %" PRIu32 " bytes%s, cannot be", t->i + 1, t->last_bytes,
		t->variable && !t->last_points ? " without points" : "");
	return err_add_place(err, t->address, "chunk table");
}

int laz_table_next(struct laz_table *t, struct laz_chunk *ret, bool *ret_more, struct err *err)
{
	struct laz_coder c = t->window.coder;
	struct laz_int *ints = (struct laz_int *)t->ints;
	unsigned k;
	int rc;

	if (t->i == t->n) {
		*ret_more = false;
		return 0;
	}
	rc = laz_window_ready(&t->window, &c, err);
	if (rc)
		return rc;
	if (t->variable)
		t->last_points = (uint32_t)laz_int_read(&c, ints, 32, 2, (int32_t)t->last_points, 0, &k);
	else
		t->last_points = t->left < t->chunk_size ? (uint32_t)t->left : t->chunk_size;
	t->last_bytes = (uint32_t)laz_int_read(&c, ints, 32, 2, (int32_t)t->last_bytes, 1, &k);
	t->window.coder = c;
	rc = laz_window_check(&t->window, err);
	if (rc)
		return rc;
	if (t->last_bytes < t->min_bytes || t->last_bytes > t->address - t->at || (t->variable && !t->last_points))
		return bad_entry(t, err);
	*ret = (struct laz_chunk){
		.at = t->at, .bytes = t->last_bytes, .points = t->last_points, .at_most = t->at_most && t->i + 1 == t->n};
	*ret_more = true;
	t->at += t->last_bytes;
	t->left -= t->last_points < t->left ? t->last_points : t->left;
	t->i++;
	return 0;
}

static int read_u64(const struct laz_source *source, uint64_t at, uint64_t *ret, bool *ret_there, struct err *err)
{
	uint8_t b[8];
	size_t n = 0;
	int rc = source->read(source->ctx, at, b, sizeof b, &n, err);

	if (rc)
		return rc;
	*ret_there = n == sizeof b;
	if (*ret_there)
		*ret = laz_get64(b);
	return 0;
}

/* t->address, or why there is none. */
static int locate(struct laz_table *t, const struct laz_source *source, const struct laz_place *place, const char **ret_why,
		  struct err *err)
{
	bool there = place->begin <= place->size && place->size - place->begin >= HEAD;
	uint64_t address = 0;
	int rc = there ? read_u64(source, place->begin, &address, &there, err) : 0;

	t->elsewhere = there && address == UINT64_MAX;
	if (!rc && t->elsewhere)
		rc = read_u64(source, place->size - 8, &address, &there, err);
	if (rc)
		return rc;
	t->address = address;
	if (!there || (address > place->size - HEAD && address < UINT64_C(1) << 63))
		*ret_why = "the chunk table is missing: the file was cut short";
	else if (address == place->begin)
		*ret_why = "the chunk table is missing: the file's writer was interrupted";
	else if (address < place->begin + HEAD || address > place->size - HEAD)
		*ret_why = "the address of the chunk table cannot be";
	return 0;
}

/* Goes through the whole table. */
static int survey(struct laz_table *t, uint64_t *ret_points, struct err *err)
{
	struct laz_chunk chunk;
	uint64_t points = 0;
	bool more = true;
	int rc = rewind_table(t, err);

	if (!rc && t->n > (t->address - t->begin) / t->min_bytes) {
		err_set(err, ERR_INPUT, "%" PRIu32 " chunks do not fit the file", t->n);
		rc = err_add_place(err, t->address + 4, "chunk table");
	}
	while (!rc) {
		rc = laz_table_next(t, &chunk, &more, err);
		if (rc || !more)
			break;
		points += t->variable ? chunk.points : t->chunk_size;
	}
	if (!rc)
		*ret_points = points;
	/* an address in the last 8 bytes is behind the table */
	t->end = t->elsewhere ? t->size : laz_window_place(&t->window);
	return rc;
}

/* The table is sound; `points` is what its chunks hold (of a fixed chunk size: at most). */
static int check_points(const struct laz_table *t, uint64_t points, struct err *err)
{
	if (t->variable ? points == t->points : points >= t->points && points - t->points < t->chunk_size)
		return 0;
	err_set(err, ERR_INPUT, "the header says %" PRIu64 " points, the chunk table %s%" PRIu64, t->points,
		t->variable ? "" : "at most ", points);
	return err_add_place(err, t->address + 4, "chunk table");
}

static bool is_content(int rc)
{
	return rc == -ERR_INPUT || rc == -ERR_TRUNCATED;
}

/* No table, but it would be needed. */
static int needed(const struct laz_table *t, const struct err *cause, const char *why, struct err *err)
{
	err_set(err, cause->code ? cause->code : ERR_INPUT, "%s, and without it chunks of variable size cannot be found",
		cause->code ? cause->message : why);
	return err_add_place(err, cause->code ? cause->offset : t->begin - HEAD, "chunk table");
}

static void init(struct laz_table *t, const struct laz_format *f, const struct laz_source *source, const struct laz_place *place)
{
	memset(t, 0, offsetof(struct laz_table, ints));
	laz_window_init(&t->window, t->buffer, WINDOW, source, &t->counter);
	t->begin = place->begin + HEAD;
	t->size = place->size;
	t->points = place->points;
	t->chunk_size = f->chunk_size;
	t->variable = f->chunk_size == LAZ_VARIABLE || f->chunk_size == 0;
	t->at_most = place->at_most && !t->variable;
	t->min_bytes = f->length + 4;
}

/* A layered chunk says behind its first record how many points it has. */
static int count_last(const struct laz_table *t, const struct laz_format *f, const struct laz_source *source,
		      struct laz_place *place, struct err *err)
{
	uint64_t count = 0;
	bool there = false;
	int rc;

	place->at_most = !t->variable;
	if (t->variable || f->compressor != LAZ_COMPRESSOR_LAYERED)
		return 0;
	rc = read_u64(source, t->at - t->last_bytes + f->length, &count, &there, err);
	count &= UINT32_MAX;
	if (rc || !there || !count || count > t->chunk_size)
		return rc;
	place->points -= t->chunk_size - count;
	place->at_most = false;
	return 0;
}

/* Less than a first record and what begins its stream is no point. */
static void count_without_table(const struct laz_format *f, struct laz_place *place)
{
	uint64_t first = laz_table_whole(f, place).at;

	place->at_most = place->end >= first && place->end - first >= f->length + 4;
	place->points = place->at_most ? LAZ_UNCOUNTED : 0;
}

int laz_table_count(void *memory, const struct laz_format *f, const struct laz_source *source, struct laz_place *place,
		    struct err *err)
{
	struct laz_table *t = memory;
	struct err cause = ERR_INIT;
	const char *why = NULL;
	bool has_table = f->compressor != LAZ_COMPRESSOR_POINTWISE;
	int rc;

	init(t, f, source, place);
	rc = has_table ? locate(t, source, place, &why, err) : 0;
	if (rc)
		return rc;
	if (has_table && !why) {
		rc = survey(t, &place->points, &cause);
		if (!rc)
			return place->points ? count_last(t, f, source, place, err) : 0;
		if (!is_content(rc)) {
			*err = cause;
			return rc;
		}
		place->end = t->address < place->end ? t->address : place->end;
	}
	count_without_table(f, place);
	return 0;
}

uint64_t laz_table_end(const struct laz_table *t)
{
	return t->end;
}

int laz_table_open(void *memory, const struct laz_format *f, const struct laz_source *source, const struct laz_place *place,
		   struct laz_table **ret, uint64_t *ret_chunks, const char **ret_why, struct err *err)
{
	struct laz_table *t = memory;
	struct err cause = ERR_INIT;
	const char *why = NULL;
	uint64_t points = 0;
	int rc;

	init(t, f, source, place);
	if (f->compressor != LAZ_COMPRESSOR_POINTWISE && place->points) {
		rc = locate(t, source, place, &why, err);
		if (rc)
			return rc;
		rc = why ? 0 : survey(t, &points, &cause);
		if (rc && !is_content(rc)) {
			*err = cause;
			return rc;
		}
		if (rc)
			why = "the chunk table cannot be used";
		else if (!why && !(f->chunk_size == 0 && points != t->points))
			rc = check_points(t, points, err);
		else if (!why)
			why = "the chunk table cannot be used"; /* of chunk size 0 */
		if (rc && !why)
			return rc;
		if (why && f->chunk_size == LAZ_VARIABLE)
			return needed(t, &cause, why, err);
		rc = why ? 0 : rewind_table(t, err);
		if (rc)
			return rc;
	}
	if (why)
		t->n = t->i = 0;
	*ret = t;
	*ret_chunks = t->n;
	*ret_why = why;
	return 0;
}
