/*
 * LAZ: compressed point records back to the records of LAS, bit for bit. Compressors 1 (one stream), 2
 * (chunks) and 3 (chunks of layers), all items of LAS 1.0 to 1.5.
 *
 * Total: any bytes give records or an error, in memory that the item list alone determines. Nothing is
 * allocated by a count or size of the file; a chunk is read through one window per layer, never whole.
 */
#ifndef LAZ_H
#define LAZ_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum laz_item_type {
	LAZ_BYTE = 0,
	LAZ_POINT10 = 6,
	LAZ_GPSTIME11 = 7,
	LAZ_RGB12 = 8,
	LAZ_WAVEPACKET13 = 9,
	LAZ_POINT14 = 10,
	LAZ_RGB14 = 11,
	LAZ_RGBNIR14 = 12,
	LAZ_WAVEPACKET14 = 13,
	LAZ_BYTE14 = 14,
};
enum { LAZ_COMPRESSOR_POINTWISE = 1, LAZ_COMPRESSOR_CHUNKED = 2, LAZ_COMPRESSOR_LAYERED = 3 };
enum { LAZ_ITEMS = 6, LAZ_VARIABLE = 0xffffffff };

struct laz_item {
	uint16_t type, size, version;
};

/* The content of the VLR "laszip encoded"/22204, checked: the items make up a record of `length` bytes. */
struct laz_format {
	unsigned compressor;
	uint32_t chunk_size;     /* points of a chunk; LAZ_VARIABLE: the chunk table says; 0: the same, but where the
				  * table cannot be used all points are one chunk */
	unsigned nitems, length; /* bytes of a record */
	struct laz_item item[LAZ_ITEMS];
};

/* `point_format` and `length` are the header's. ERR_INPUT or ERR_UNSUPPORTED name the field; the offset is
 * that in the VLR's body (the caller adds where it lies). */
int laz_format_parse(const void *vlr, size_t n, unsigned point_format, unsigned length, struct laz_format *ret, struct err *err);

/* Source of the bytes: `read` fills up to n bytes of place `at` of the file, as pread. */
struct laz_source {
	void *ctx;
	int (*read)(void *ctx, uint64_t at, void *buf, size_t n, size_t *ret_n, struct err *err);
};

/* The chunk table of a file, read forwards; it is never held whole. */
struct laz_chunk {
	uint64_t at, bytes; /* bytes 0: not known (no table) */
	uint64_t points;
	bool at_most; /* they may be fewer: as many as its bytes hold */
};
struct laz_place {           /* of the points in the file */
	uint64_t begin, end; /* the compressed points, from the place of the chunk table's address on; end: the
			      * file's, or where the header says that something else begins */
	uint64_t points;     /* that the header claims */
	bool at_most;        /* the last chunk may have fewer: see laz_table_count */
	uint64_t size;       /* of the file: a writer that could not seek put the address into the last 8 bytes */
};
struct laz_table;
size_t laz_table_bytes(void);
/* *ret_chunks: how many there are; 0 of compressor 1, and where the table is missing or cannot be used: then
 * the points can only be read forwards, and *ret_why (static text, or NULL) says why. */
int laz_table_open(void *memory, const struct laz_format *, const struct laz_source *, const struct laz_place *,
		   struct laz_table **ret, uint64_t *ret_chunks, const char **ret_why, struct err *err);
/* How many points the chunks hold, where the header counts none: to place->points. place->at_most: pointwise chunks of a
 * fixed size, the last of which may have fewer. What is decoded of that one then ends where its bytes do; points at its end
 * that took no byte at all are not found. Without a table that can be used, but with bytes of points, it is LAZ_UNCOUNTED,
 * and at_most: then all of them end where their bytes do, which is at place->end or before. */
#define LAZ_UNCOUNTED (UINT64_MAX / 2)
int laz_table_count(void *memory, const struct laz_format *, const struct laz_source *, struct laz_place *place, struct err *err);
/* The end of an open table with chunks, or a later byte (its decoder reads ahead). */
uint64_t laz_table_end(const struct laz_table *);
/* All points as one chunk of unknown size, for laz_reader_chunk where there are no chunks. */
struct laz_chunk laz_table_whole(const struct laz_format *, const struct laz_place *);
/* The next chunk; false at the end. Place, size and points are checked against the file's. */
int laz_table_next(struct laz_table *, struct laz_chunk *ret, bool *ret_more, struct err *err);

/* The fields that are wanted. Only layered chunks can skip fields; skipped fields have any value. */
enum laz_fields { LAZ_TERRAIN, /* x, y, z, returns, class, flags */ LAZ_ALL };

/* Decodes one chunk after the other. */
struct laz_reader;
size_t laz_reader_bytes(const struct laz_format *, enum laz_fields);
int laz_reader_new(void *memory, const struct laz_format *, enum laz_fields, const struct laz_source *, struct laz_reader **ret,
		   struct err *err);
/* From now on the points of this chunk. Compressor 1, or no table: the whole of the points as one chunk with
 * bytes 0 (compressor 2 and 3 then go on over the ends of chunks of format.chunk_size). */
int laz_reader_chunk(struct laz_reader *, const struct laz_chunk *, struct err *err);
/* Up to `cap` records of format.length bytes; *ret_n is 0 at the end of the chunk. ERR_TRUNCATED, ERR_INPUT name
 * the byte. A chunk whose bytes do not end where its table says is an error as well. */
int laz_reader_read(struct laz_reader *, uint8_t *records, size_t cap, size_t *ret_n, struct err *err);
/* After a read that failed with ERR_TRUNCATED: how many of its records are good nevertheless. */
size_t laz_reader_good(const struct laz_reader *);
/* Behind the last chunk that was read whole. */
uint64_t laz_reader_place(const struct laz_reader *);
/* Bytes of the file that were read so far. */
uint64_t laz_reader_bytes_read(const struct laz_reader *);

#endif
