/*
 * A database file of SQLite (https://www.sqlite.org/fileformat2.html), written once, from its front to its end: the same rows are
 * the same bytes, whatever library there is. Tables whose rows come in the order of their numbers, and indexes of a few rows.
 * Pages that are known last (the first one, and the root of the table that is written first) are patched.
 */
#ifndef FORMAT_SQLITE_H
#define FORMAT_SQLITE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct outfile;

enum { SQLITE_PAGE = 4096, SQLITE_DEPTH = 10, SQLITE_LOCK_PAGE = (1 << 30) / SQLITE_PAGE + 1 };
#define SQLITE_ROW_MOST 1000000000ull /* bytes of a row that readers take (SQLITE_MAX_LENGTH) */

/* A record under construction: its header and its values. */
struct sqlite_record {
	uint8_t types[64], values[6000];
	size_t ntype, nvalue;
	uint64_t blob; /* bytes of the last value, which follow the values; 0: it is none */
	bool bad;
};
void sqlite_null(struct sqlite_record *);
void sqlite_integer(struct sqlite_record *, int64_t);
void sqlite_real(struct sqlite_record *, double);
void sqlite_text(struct sqlite_record *, const char *);
/* The last value that is not null; its bytes come with sqlite_bytes. */
void sqlite_text_later(struct sqlite_record *, const char *);
void sqlite_blob(struct sqlite_record *, uint64_t bytes); /* likewise */

struct sqlite_level {
	uint8_t page[SQLITE_PAGE];
	size_t head; /* where its header is: 100 on the first page of a file */
	unsigned ncell;
	size_t content; /* where cells begin */
	uint32_t child; /* the last one, which is in no cell; 0: none */
	uint64_t key;   /* its last row */
};
struct sqlite_table {
	uint32_t root; /* its page, which exists; 0: the next one, if there is only one */
	bool first;    /* the schema, of several pages: the root is the first one, behind the header of the file */
	uint64_t last; /* row */
	unsigned depth;
	struct sqlite_level *level[SQLITE_DEPTH]; /* leaves first */
};
struct sqlite_file {
	struct outfile *out; /* can seek */
	uint32_t pages;
	/* the row that is being written */
	uint64_t left;  /* of its bytes */
	size_t here;    /* of these, in the leaf */
	uint8_t *to;    /* there */
	size_t in_page; /* bytes in the page that overflows, after its pointer */
};

/* Room for `pages` pages, to be patched. */
int sqlite_reserve(struct sqlite_file *, uint32_t pages, struct err *err);
int sqlite_table_new(struct sqlite_table *, struct err *err);
/* A row with a number above that of the last; its blob's bytes follow. */
int sqlite_row(struct sqlite_file *, struct sqlite_table *, uint64_t number, const struct sqlite_record *, struct err *err);
int sqlite_bytes(struct sqlite_file *, const void *bytes, size_t n, struct err *err);
int sqlite_table_end(struct sqlite_file *, struct sqlite_table *, struct err *err); /* its root is known */
void sqlite_table_done(struct sqlite_table *);
/* An index on one page; entries in order, each with the number of its row as its last value. *ret: the page. */
int sqlite_index(struct sqlite_file *, const struct sqlite_record *entry, unsigned n, uint32_t *ret, struct err *err);
/* The schema, and the header of the file. */
int sqlite_end(struct sqlite_file *, struct sqlite_table *schema, uint32_t application, uint32_t version, struct err *err);

#endif
