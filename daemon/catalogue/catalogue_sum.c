/*
 * Checksums of rows. SQLite's pages have none, so a changed bit in a digest or a view would not be noticed. A row that an older
 * version wrote has no checksum until it is written again.
 */
#include "catalogue_priv.h"

#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "digest.h"
#include "err.h"

/* As digest_hash, compiled in for a constant length: a start checks ten thousand rows of twenty values. */
static inline struct digest hash(const void *bytes, size_t size)
{
	XXH128_hash_t h = XXH3_128bits(bytes, size);

	return (struct digest){h.high64, h.low64};
}

/* Each value is hashed by itself, with its kind, so that bytes cannot move between columns. */
static void add(struct digest *sum, int kind, struct digest value, size_t n)
{
	struct {
		struct digest before, value;
		uint64_t kind, n;
	} all = {*sum, value, (uint64_t)kind, n};

	*sum = hash(&all, sizeof all);
}

static void add_number(struct digest *sum, int64_t number)
{
	add(sum, VALUE_NUMBER, hash(&number, sizeof number), sizeof number);
}

static void add_text(struct digest *sum, const char *text, size_t n)
{
	add(sum, VALUE_TEXT, digest_hash(text, n), n);
}

static int64_t fold(const struct digest *sum)
{
	int64_t folded;

	memcpy(&folded, sum, sizeof folded);
	return folded;
}

int64_t catalogue_sum(const struct value *v, unsigned n)
{
	struct digest sum = {0};

	for (unsigned i = 0; i < n; i++) {
		if (v[i].kind == VALUE_TEXT)
			add_text(&sum, v[i].text, strlen(v[i].text));
		else
			add_number(&sum, v[i].number);
	}
	return fold(&sum);
}

/* Numbers as numbers, everything else as texts, as for the columns of a row. */
static void row_sum(sqlite3_context *ctx, int n, sqlite3_value **v)
{
	struct digest sum = {0};

	for (int i = 0; i < n; i++) {
		if (sqlite3_value_type(v[i]) == SQLITE_INTEGER) {
			add_number(&sum, sqlite3_value_int64(v[i]));
		} else {
			const char *text = (const char *)sqlite3_value_text(v[i]);

			add_text(&sum, text ? text : "", (size_t)sqlite3_value_bytes(v[i]));
		}
	}
	sqlite3_result_int64(ctx, fold(&sum));
}

int catalogue_sum_function(struct catalogue *c, struct err *err)
{
	if (sqlite3_create_function(c->db, "row_sum", -1, SQLITE_UTF8 | SQLITE_DETERMINISTIC, NULL, row_sum, NULL, NULL) !=
	    SQLITE_OK)
		return catalogue_failed(c, err, "the catalogue");
	return 0;
}

int catalogue_sum_check(const struct column *c, unsigned n, const char *table, struct err *err)
{
	const struct column *last = &c[n - 1];
	const struct digest nothing = digest_hash("", 0); /* most texts of a job are empty */
	struct digest sum = {0};

	if (last->type == SQLITE_NULL)
		return 0;
	for (unsigned i = 0; i + 1 < n; i++) {
		if (c[i].type == SQLITE_INTEGER)
			add_number(&sum, c[i].number);
		else if (c[i].bytes)
			add_text(&sum, c[i].text, c[i].bytes);
		else
			add(&sum, VALUE_TEXT, nothing, 0);
	}
	if (last->type == SQLITE_INTEGER && last->number == fold(&sum))
		return 0;
	err_set(err, ERR_CORRUPT, "the catalogue is damaged: %s number %lld is not what was written", table,
		(long long)c->number);
	return err_add_hint(err, "take the state from a backup");
}
