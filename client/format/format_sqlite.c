/*
 * Tables are trees of pages. Rows fill a leaf; a full one is appended to the file and becomes a child of the page above, which is
 * itself appended when it is full. What a leaf has no room for is in a chain of pages of its own, one behind the other. The last
 * page of the uppermost level is the root.
 */
#include "format_sqlite.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outfile.h"

enum {
	LEAF = 0x0d,
	INTERIOR = 0x05,
	INDEX = 0x0a,
	FILE_HEADER = 100,
	OVERFLOW = SQLITE_PAGE - 4,                       /* bytes of a row on such a page */
	LOCAL_MOST = SQLITE_PAGE - 35,                    /* bytes of a row in a leaf */
	LOCAL_LEAST = (SQLITE_PAGE - 12) * 32 / 255 - 23, /* the least, if it overflows */
	INDEX_MOST = (SQLITE_PAGE - 12) * 64 / 255 - 23,
};

static void put16(uint8_t *at, unsigned v)
{
	at[0] = (uint8_t)(v >> 8);
	at[1] = (uint8_t)v;
}

static void put32(uint8_t *at, uint32_t v)
{
	put16(at, v >> 16);
	put16(at + 2, v & 0xffff);
}

static void put64(uint8_t *at, uint64_t v)
{
	put32(at, (uint32_t)(v >> 32));
	put32(at + 4, (uint32_t)v);
}

/* Seven bits a byte, from the top; the ninth has eight. Returns how many. */
static size_t varint(uint8_t *at, uint64_t v)
{
	size_t n = 1;

	if (v >> 56) {
		for (size_t i = 0; i < 8; i++)
			at[i] = (uint8_t)(v >> (57 - 7 * i) | 0x80);
		at[8] = (uint8_t)v;
		return 9;
	}
	for (uint64_t rest = v >> 7; rest; rest >>= 7)
		n++;
	for (size_t i = 0; i < n; i++)
		at[i] = (uint8_t)((v >> 7 * (n - 1 - i) & 0x7f) | (i + 1 < n ? 0x80 : 0));
	return n;
}

/* ---- records ---- */

static void add(struct sqlite_record *r, uint64_t type, const void *value, size_t n)
{
	if (r->ntype + 9 > sizeof(r->types) || r->nvalue + n > sizeof(r->values)) {
		r->bad = true;
		return;
	}
	r->ntype += varint(r->types + r->ntype, type);
	if (n)
		memcpy(r->values + r->nvalue, value, n);
	r->nvalue += n;
}

void sqlite_null(struct sqlite_record *r)
{
	add(r, 0, NULL, 0);
}

void sqlite_integer(struct sqlite_record *r, int64_t v)
{
	uint8_t bytes[8];

	put64(bytes, (uint64_t)v);
	if (v == 0 || v == 1)
		add(r, v ? 9 : 8, NULL, 0);
	else if (v == (int8_t)v)
		add(r, 1, bytes + 7, 1);
	else if (v == (int16_t)v)
		add(r, 2, bytes + 6, 2);
	else if (v == (int32_t)v)
		add(r, 4, bytes + 4, 4);
	else
		add(r, 6, bytes, 8);
}

void sqlite_real(struct sqlite_record *r, double v)
{
	uint8_t bytes[8];
	uint64_t bits;

	memcpy(&bits, &v, sizeof(bits));
	put64(bytes, bits);
	add(r, 7, bytes, 8);
}

void sqlite_text(struct sqlite_record *r, const char *text)
{
	size_t n = strlen(text);

	add(r, 13 + 2 * n, text, n);
}

void sqlite_text_later(struct sqlite_record *r, const char *text)
{
	r->blob = strlen(text);
	add(r, 13 + 2 * r->blob, NULL, 0);
}

void sqlite_blob(struct sqlite_record *r, uint64_t bytes)
{
	add(r, 12 + 2 * bytes, NULL, 0);
	r->blob = bytes;
}

static uint64_t size_of(const struct sqlite_record *r)
{
	return 1 + r->ntype + r->nvalue + r->blob;
}

/* ---- pages ---- */

/* SQLite locks bytes of one page, which has nothing else. */
static uint32_t page_after(uint32_t page)
{
	return page + 1 + (page + 1 == SQLITE_LOCK_PAGE);
}

static int next_page(struct sqlite_file *f, struct err *err)
{
	static const uint8_t zero[SQLITE_PAGE];
	uint32_t last = f->pages;

	if (last >= UINT32_MAX - 2)
		return err_set(err, ERR_LIMIT, "a database of SQLite cannot be more than 16 TiB");
	f->pages = page_after(last);
	return f->pages == last + 1 ? 0 : outfile_write(f->out, zero, SQLITE_PAGE, err);
}

static int append(struct sqlite_file *f, const uint8_t page[SQLITE_PAGE], uint32_t *ret, struct err *err)
{
	int r = next_page(f, err);

	*ret = f->pages;
	return r ? r : outfile_write(f->out, page, SQLITE_PAGE, err);
}

int sqlite_reserve(struct sqlite_file *f, uint32_t pages, struct err *err)
{
	static const uint8_t zero[SQLITE_PAGE];
	uint32_t number = 0;
	int r = 0;

	while (pages-- && !r)
		r = append(f, zero, &number, err);
	return r;
}

static void level_clear(struct sqlite_level *l, unsigned type)
{
	size_t head = l->head;

	memset(l->page, 0, sizeof(l->page));
	l->page[head] = (uint8_t)type;
	l->ncell = 0;
	l->content = SQLITE_PAGE;
	l->child = 0;
}

static size_t head_size(const struct sqlite_level *l)
{
	return l->page[l->head] == INTERIOR ? 12 : 8;
}

/* Room for a cell, NULL: the page is full. */
static uint8_t *cell(struct sqlite_level *l, size_t n)
{
	size_t pointers = l->head + head_size(l) + 2 * ((size_t)l->ncell + 1);

	if (pointers + n > l->content)
		return NULL;
	l->content -= n;
	put16(l->page + pointers - 2, (unsigned)l->content);
	l->ncell++;
	return l->page + l->content;
}

static void level_close(struct sqlite_level *l)
{
	put16(l->page + l->head + 3, l->ncell);
	put16(l->page + l->head + 5, (unsigned)l->content);
	if (l->page[l->head] == INTERIOR)
		put32(l->page + l->head + 8, l->child);
}

static int level_new(struct sqlite_table *t, unsigned type, struct err *err)
{
	struct sqlite_level *l = t->depth < SQLITE_DEPTH ? calloc(1, sizeof(*l)) : NULL;

	if (!l)
		return err_set(err, ERR_NOMEM, "no memory for a database");
	l->head = t->first && type == INTERIOR ? FILE_HEADER : 0;
	level_clear(l, type);
	t->level[t->depth++] = l;
	return 0;
}

int sqlite_table_new(struct sqlite_table *t, struct err *err)
{
	return level_new(t, LEAF, err);
}

void sqlite_table_done(struct sqlite_table *t)
{
	while (t->depth)
		free(t->level[--t->depth]);
}

static size_t child_cell(uint8_t *to, uint32_t child, uint64_t key)
{
	put32(to, child);
	return 4 + varint(to + 4, key);
}

/* The child of the last cell, which is the lowest one, becomes the page's last child. */
static void pop(struct sqlite_level *l)
{
	const uint8_t *at = l->page + l->content;
	size_t n = 4;

	l->child = (uint32_t)at[0] << 24 | (uint32_t)at[1] << 16 | (uint32_t)at[2] << 8 | at[3];
	for (l->key = 0; at[n] & 0x80; n++)
		l->key = l->key << 7 | (at[n] & 0x7f);
	l->key = l->key << 7 | at[n];
	memset(l->page + l->content, 0, n + 1);
	l->content += n + 1;
	l->ncell--;
	put16(l->page + l->head + head_size(l) + 2 * (size_t)l->ncell, 0);
}

/* A page that is full leaves its last cell's child as its last one, so that the next page begins with a cell: a page without one
 * is no page. */
static int add_child(struct sqlite_file *f, struct sqlite_table *t, unsigned depth, uint32_t child, uint64_t key, struct err *err)
{
	struct sqlite_level *l;
	uint8_t bytes[16], *to;
	uint32_t number = 0;
	uint64_t up;
	size_t n;
	int r = depth == t->depth ? level_new(t, INTERIOR, err) : 0;

	if (r)
		return r;
	l = t->level[depth];
	n = l->child ? child_cell(bytes, l->child, l->key) : 0;
	to = n ? cell(l, n) : bytes;
	if (to) {
		if (n)
			memcpy(to, bytes, n);
		l->child = child;
		l->key = key;
		return 0;
	}
	pop(l);
	level_close(l);
	up = l->key;
	r = append(f, l->page, &number, err);
	level_clear(l, INTERIOR);
	memcpy(cell(l, n), bytes, n);
	l->child = child;
	l->key = key;
	return r ? r : add_child(f, t, depth + 1, number, up, err);
}

/* ---- rows ---- */

static size_t local_of(uint64_t size)
{
	size_t least = LOCAL_LEAST + (size_t)((size - LOCAL_LEAST) % OVERFLOW);

	return size <= LOCAL_MOST ? (size_t)size : least <= LOCAL_MOST ? least : LOCAL_LEAST;
}

static int leaf_end(struct sqlite_file *f, struct sqlite_table *t, struct err *err)
{
	struct sqlite_level *leaf = t->level[0];
	uint32_t number = 0;
	int r;

	level_close(leaf);
	r = append(f, leaf->page, &number, err);
	level_clear(leaf, LEAF);
	return r ? r : add_child(f, t, 1, number, t->last, err);
}

static int overflow_begin(struct sqlite_file *f, struct err *err)
{
	uint8_t next[4] = {0};
	int r = next_page(f, err);

	put32(next, f->left > OVERFLOW ? page_after(f->pages) : 0);
	f->in_page = 0;
	return r ? r : outfile_write(f->out, next, sizeof(next), err);
}

/* The rest of the last page of a chain. */
static int overflow_end(struct sqlite_file *f, struct err *err)
{
	static const uint8_t zero[OVERFLOW];

	return f->in_page ? outfile_write(f->out, zero, OVERFLOW - f->in_page, err) : 0;
}

int sqlite_bytes(struct sqlite_file *f, const void *bytes, size_t n, struct err *err)
{
	const uint8_t *from = bytes;
	int r = 0;

	while (n && !r) {
		size_t k = f->here ? f->here : OVERFLOW - f->in_page;

		k = k < n ? k : n;
		if (f->here) {
			memcpy(f->to, from, k);
			f->to += k;
			f->here -= k;
		} else {
			if (!f->in_page || f->in_page == OVERFLOW) {
				r = overflow_begin(f, err);
				k = n < OVERFLOW ? n : OVERFLOW;
			}
			if (!r)
				r = outfile_write(f->out, from, k, err);
			f->in_page += k;
		}
		f->left -= k;
		from += k;
		n -= k;
		if (!r && !f->left)
			r = overflow_end(f, err);
	}
	return r;
}

int sqlite_row(struct sqlite_file *f, struct sqlite_table *t, uint64_t number, const struct sqlite_record *rec, struct err *err)
{
	uint64_t size = size_of(rec);
	size_t local = local_of(size), n;
	uint8_t head[20], types = (uint8_t)(rec->ntype + 1), *to;
	int r = 0;

	if (rec->bad || (rec->ntype + 1) > 127)
		return err_set(err, ERR_INTERNAL, "a row of a database does not fit its place");
	if (size > SQLITE_ROW_MOST)
		return err_set(err, ERR_LIMIT, "a row of a GeoPackage cannot be more than a thousand million bytes");
	n = varint(head, size);
	n += varint(head + n, number);
	to = cell(t->level[0], n + local + (local < size ? 4 : 0));
	if (!to) {
		r = leaf_end(f, t, err);
		to = r ? NULL : cell(t->level[0], n + local + (local < size ? 4 : 0));
	}
	if (!to)
		return r ? r : err_set(err, ERR_INTERNAL, "a row of a database does not fit its place");
	t->last = number;
	memcpy(to, head, n);
	if (local < size)
		put32(to + n + local, page_after(f->pages));
	f->to = to + n;
	f->here = local;
	f->left = size;
	f->in_page = 0;
	r = sqlite_bytes(f, &types, 1, err);
	if (!r)
		r = sqlite_bytes(f, rec->types, rec->ntype, err);
	return r ? r : sqlite_bytes(f, rec->values, rec->nvalue, err);
}

int sqlite_table_end(struct sqlite_file *f, struct sqlite_table *t, struct err *err)
{
	struct sqlite_level *top;
	int r = 0;

	if (t->depth > 1)
		r = leaf_end(f, t, err);
	for (unsigned i = 1; i + 1 < t->depth && !r; i++) {
		uint32_t number = 0;

		level_close(t->level[i]);
		r = append(f, t->level[i]->page, &number, err);
		if (!r)
			r = add_child(f, t, i + 1, number, t->level[i]->key, err);
	}
	if (r)
		return r;
	top = t->level[t->depth - 1];
	level_close(top);
	if (t->first)
		return 0;
	return t->root ? outfile_patch(f->out, (uint64_t)(t->root - 1) * SQLITE_PAGE, top->page, SQLITE_PAGE, err) :
			 append(f, top->page, &t->root, err);
}

int sqlite_index(struct sqlite_file *f, const struct sqlite_record *entry, unsigned n, uint32_t *ret, struct err *err)
{
	struct sqlite_level l = {.head = 0};

	level_clear(&l, INDEX);
	for (unsigned i = 0; i < n; i++) {
		const struct sqlite_record *e = &entry[i];
		uint8_t head[10];
		size_t size = (size_t)size_of(e), k = varint(head, size);
		uint8_t *to = e->bad || size > INDEX_MOST ? NULL : cell(&l, k + size);

		if (!to)
			return err_set(err, ERR_INTERNAL, "an index of a database does not fit its page");
		memcpy(to, head, k);
		to[k] = (uint8_t)(e->ntype + 1);
		memcpy(to + k + 1, e->types, e->ntype);
		memcpy(to + k + 1 + e->ntype, e->values, e->nvalue);
	}
	level_close(&l);
	return append(f, l.page, ret, err);
}

int sqlite_end(struct sqlite_file *f, struct sqlite_table *schema, uint32_t application, uint32_t version, struct err *err)
{
	uint8_t *at;
	int r = sqlite_table_end(f, schema, err);

	if (r)
		return r;
	if (schema->depth != 2 || !schema->level[1]->ncell)
		return err_set(err, ERR_INTERNAL, "the schema of a database does not fit its pages");
	at = schema->level[1]->page;
	memcpy(at, "SQLite format 3", 16);
	put16(at + 16, SQLITE_PAGE);
	at[18] = at[19] = 1; /* a rollback journal */
	at[21] = 64;
	at[22] = at[23] = 32;
	put32(at + 24, 1); /* changes */
	put32(at + 28, f->pages);
	put32(at + 40, 1); /* of the schema */
	put32(at + 44, 4); /* its format */
	put32(at + 56, 1); /* UTF-8 */
	put32(at + 60, version);
	put32(at + 68, application);
	put32(at + 92, 1); /* changes, when the next number was written */
	put32(at + 96, 3040000);
	return outfile_patch(f->out, 0, at, SQLITE_PAGE, err);
}
