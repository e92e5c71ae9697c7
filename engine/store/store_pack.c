/*
 * Reading a pack. Nothing of the file is believed: every number is checked before it is used as a place or a size, and a domain
 * must have what its entry of the index says of it.
 */
#include <errno.h>
#include <string.h>
#include <xxhash.h>

#include "cursor.h"
#include "digest_pack.h"
#include "err.h"
#include "io.h"
#include "store_format.h"
#include "store_pack_format.h"

enum { AT_ONCE = 64 };

static int wrong(const struct store_pack *k, uint64_t at, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "a pack of finished domains is damaged: %s", what);
	err_add_file(err, k->name);
	return err_add_place(err, at, NULL);
}

static bool sealed(const uint8_t *bytes, size_t size, uint64_t seed)
{
	struct cursor last = cursor_of(bytes + size - 8, 8);

	return cursor_u64(&last) == XXH3_64bits_withSeed(bytes, size - 8, seed);
}

/* Head and end begin alike. */
static int part_read(const struct store_pack *k, uint64_t at, size_t size, uint32_t magic, uint8_t *bytes, struct cursor *ret,
		     struct err *err)
{
	uint32_t version;
	int r = io_read_at(k->fd, bytes, size, at, k->name, err);

	if (r)
		return r;
	*ret = cursor_of(bytes, size - 8);
	if (cursor_u32(ret) != magic || !sealed(bytes, size, at))
		return wrong(k, at, at ? "it has no end" : "it has no head", err);
	version = cursor_u32(ret);
	if (version <= STORE_PACK_VERSION)
		return 0;
	err_set(err, ERR_VERSION, "a pack of version %u; this acut is too old to read it", version);
	return err_add_file(err, k->name);
}

int store_pack_open(int fd, const char *name, struct store_pack *ret, struct err *err)
{
	struct store_pack k = {.fd = fd, .name = name};
	uint8_t bytes[STORE_PACK_HEAD > STORE_PACK_END ? STORE_PACK_HEAD : STORE_PACK_END];
	struct digest of = {0, 0};
	struct cursor c;
	struct stat st;
	uint64_t end;
	int r;

	if (io->fstat(fd, &st) < 0) {
		err_sys(err, errno, "cannot look at a pack");
		return err_add_file(err, name);
	}
	if (st.st_size < STORE_PACK_HEAD + STORE_PACK_END)
		return wrong(&k, (uint64_t)st.st_size, "it ends too early", err);
	k.bytes = (uint64_t)st.st_size;
	end = k.bytes - STORE_PACK_END;
	r = part_read(&k, 0, STORE_PACK_HEAD, STORE_PACK_MAGIC, bytes, &c, err);
	if (!r) {
		k.of = digest_unpack(&c);
		r = part_read(&k, end, STORE_PACK_END, STORE_PACK_END_MAGIC, bytes, &c, err);
	}
	if (r)
		return r;
	of = digest_unpack(&c);
	k.n = cursor_u64(&c);
	k.index = cursor_u64(&c);
	if (!digest_equal(k.of, of) || k.index < STORE_PACK_HEAD || k.index % STORE_PACK_ALIGN || k.index > end ||
	    (end - k.index) % STORE_PACK_ENTRY || (end - k.index) / STORE_PACK_ENTRY != k.n)
		return wrong(&k, end, "its end does not agree with its head or its size", err);
	*ret = k;
	return 0;
}

static bool counts_fit(const struct store_pack_entry *e)
{
	return e->nopen <= e->nvertex && e->nvertex <= INT32_MAX && e->ntriangle <= INT32_MAX &&
	       (!e->nedges || e->nedges == e->ntriangle);
}

static bool entry_unpack(const struct store_pack *k, const uint8_t bytes[STORE_PACK_ENTRY], uint64_t at,
			 struct store_pack_entry *e)
{
	struct cursor c = cursor_of(bytes, STORE_PACK_ENTRY - 8);
	uint32_t flags;

	if (!sealed(bytes, STORE_PACK_ENTRY, at))
		return false;
	memcpy(e->region, cursor_bytes(&c, sizeof e->region), sizeof e->region);
	e->id.base = digest_unpack(&c);
	e->id.list = digest_unpack(&c);
	e->at = cursor_u64(&c);
	e->bytes = cursor_u64(&c);
	e->own = cursor_u64(&c);
	e->nvertex = cursor_u32(&c);
	e->nopen = cursor_u32(&c);
	e->ntriangle = cursor_u32(&c);
	e->nedges = cursor_u32(&c);
	e->nhull = cursor_u32(&c);
	flags = cursor_u32(&c);
	e->flat = flags == 1;
	for (unsigned i = 0; i < 6; i++)
		e->box[i] = cursor_i32(&c);
	e->digest = digest_unpack(&c);
	e->own_digest = digest_unpack(&c);
	return !e->region[STORE_REGION - 1] && flags <= 1 && counts_fit(e) && e->at >= STORE_PACK_HEAD &&
	       e->at % STORE_PACK_ALIGN == 0 && e->at <= k->index && e->bytes >= STORE_HEADER && e->bytes <= k->index - e->at;
}

int store_pack_entries(const struct store_pack *k, uint64_t first, size_t n, struct store_pack_entry *ret, struct err *err)
{
	uint8_t bytes[AT_ONCE * STORE_PACK_ENTRY];
	int r = 0;

	if (first > k->n || n > k->n - first)
		return err_set(err, ERR_INTERNAL, "domains beyond the end of a pack");
	for (size_t done = 0, some; !r && done < n; done += some) {
		uint64_t at = k->index + (first + done) * STORE_PACK_ENTRY;

		some = n - done < AT_ONCE ? n - done : AT_ONCE;
		r = io_read_at(k->fd, bytes, some * STORE_PACK_ENTRY, at, k->name, err);
		for (size_t i = 0; !r && i < some; i++, at += STORE_PACK_ENTRY)
			if (!entry_unpack(k, bytes + i * STORE_PACK_ENTRY, at, &ret[done + i]))
				r = wrong(k, at, "an entry of its index is invalid", err);
	}
	return r;
}

/* ---- domains ---- */

static bool agrees(const struct store_pack_entry *e, const struct store_front *f)
{
	const struct mesh_domain *d = &f->domain;

	return f->bytes == e->bytes && d->counts.used == e->own && d->nvertex == e->nvertex && d->nopen == e->nopen &&
	       d->ntriangle == e->ntriangle && d->nedges == e->nedges && d->nhull == e->nhull &&
	       !memcmp(d->box, e->box, sizeof e->box) && digest_equal(d->digest, e->digest) &&
	       digest_equal(d->own_digest, e->own_digest);
}

static int header_read(const struct store_pack *k, const struct store_pack_entry *e, struct store_front *ret,
		       struct store_header *ret_header, struct err *err)
{
	uint8_t bytes[STORE_HEADER];
	int r = io_read_at(k->fd, bytes, sizeof bytes, e->at, k->name, err);

	if (r)
		return r;
	*ret = (struct store_front){0};
	switch (store_header_unpack(bytes, &e->id, ret, ret_header)) {
	case STORE_HEADER_GOOD:
		return agrees(e, ret) ? 0 : wrong(k, e->at, "a domain differs from the index", err);
	case STORE_HEADER_NEWER:
		err_set(err, ERR_VERSION, "a pack with finished domains of a later version; this acut is too old to read them");
		return err_add_file(err, k->name);
	case STORE_HEADER_OLD:
	case STORE_HEADER_DAMAGED:
		break;
	}
	return wrong(k, e->at, "the header of a domain is invalid", err);
}

int store_pack_head(const struct store_pack *k, const struct store_pack_entry *e, struct store_front *ret, struct err *err)
{
	struct store_header h;

	return header_read(k, e, ret, &h, err);
}

size_t store_pack_memory(const struct store_pack_entry *e)
{
	const struct mesh_domain d = {.nvertex = e->nvertex, .nopen = e->nopen, .ntriangle = e->ntriangle, .nedges = e->nedges};

	return store_layout_of(&d).total;
}

size_t store_pack_front_bytes(const struct store_pack_entry *e)
{
	const struct mesh_domain d = {.nvertex = e->nvertex, .nopen = e->nopen};

	return store_layout_of(&d).open_end;
}

int store_pack_front(const struct store_pack *k, const struct store_pack_entry *e, void *memory, struct mesh_domain *ret,
		     struct err *err)
{
	struct store_header h;
	struct store_front f;
	struct store_extent extent;
	int r = header_read(k, e, &f, &h, err);

	if (r)
		return r;
	extent = store_extent_of(&f.domain, &h.code, f.beside.proof_size);
	r = io_read_at(k->fd, memory, extent.open, e->at + extent.open_at, k->name, err);
	f.domain.link = memory;
	f.domain.vertex = (struct mesh_vertex *)((uint8_t *)memory + store_layout_of(&f.domain).vertex);
	if (!r && store_open_sum(&f.domain) != h.sums.open)
		r = wrong(k, e->at, "a checksum of a domain does not agree", err);
	if (!r)
		*ret = f.domain;
	return r;
}

int store_pack_get(const struct store_pack *k, const struct store_pack_entry *e, void *memory, size_t size,
		   struct mesh_domain *ret, struct err *err)
{
	struct store_header h;
	struct store_front f;
	bool whole = false;
	int r = header_read(k, e, &f, &h, err);

	if (!r && f.whole > size)
		return err_set(err, ERR_INTERNAL, "a domain of %zu bytes does not fit %zu", f.whole, size);
	if (!r)
		r = store_read(k->fd, k->name, e->at, &f, &h, memory, &whole, err);
	if (!r && !whole)
		r = wrong(k, e->at, "a checksum of a domain does not agree", err);
	if (!r)
		*ret = f.domain;
	return r;
}

/* ---- into a store ---- */

static int copy(const struct store_pack *k, const struct store_pack_entry *e, int fd, const char *name, void *memory, size_t size,
		struct err *err)
{
	int r = 0;

	for (uint64_t done = 0, some; !r && done < e->bytes; done += some) {
		some = e->bytes - done < size ? e->bytes - done : size;
		r = io_read_at(k->fd, memory, some, e->at + done, k->name, err);
		if (!r)
			r = io_write_at(fd, memory, some, done, name, err);
	}
	return r;
}

/* The domain is checked where it was read, and is copied afterwards: a pack never changes. */
int store_pack_adopt(const struct store_pack *k, const struct store_pack_entry *e, int storefd, void *memory, size_t size,
		     struct store_front *ret, struct err *err)
{
	char name[STORE_NAME], temp[STORE_TEMP];
	struct store_header h;
	struct store_front f;
	int fd = -1, r = header_read(k, e, &f, &h, err);

	if (!r && e->flat)
		r = err_set(err, ERR_INTERNAL, "a domain of a survey without triangles is not for a store");
	if (!r)
		r = store_check_at(k->fd, k->name, e->at, &f, &h, memory, size, err);
	if (!r)
		r = store_temp_open(storefd, &e->id, k, name, temp, &fd, err);
	if (r)
		return r;
	r = copy(k, e, fd, temp, memory, size, err);
	r = store_temp_publish(storefd, fd, temp, name, r, err);
	if (!r)
		*ret = f;
	return r;
}
