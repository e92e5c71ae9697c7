/*
 * Writing a pack: domains from the start of the file to its end, then the index, which is held in memory until then, and the end.
 * Of each domain the header is written last, as in a file of the store; all else is written in order.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "cursor.h"
#include "digest_pack.h"
#include "err.h"
#include "io.h"
#include "store_format.h"
#include "store_pack_format.h"

enum { FIRST_ROOM = 64, AT_ONCE = 64 };

struct store_packer {
	int fd;
	const char *name;
	struct digest of;
	uint64_t at; /* end of what was written */
	struct store_pack_entry *entry;
	size_t n, room;
};

/* Ends `bytes` of that size with its checksum. */
static void seal(struct packer *p, uint8_t *bytes, size_t size, uint64_t seed)
{
	packer_zero(p, size - 8 - packer_size(p));
	packer_u64(p, XXH3_64bits_withSeed(bytes, size - 8, seed));
}

static int head_write(const struct store_packer *k, struct err *err)
{
	uint8_t bytes[STORE_PACK_HEAD];
	struct packer p = packer_of(bytes, sizeof bytes);

	packer_u32(&p, STORE_PACK_MAGIC);
	packer_u32(&p, STORE_PACK_VERSION);
	digest_pack(&p, k->of);
	seal(&p, bytes, sizeof bytes, 0);
	return io_write_at(k->fd, bytes, sizeof bytes, 0, k->name, err);
}

int store_packer_new(int fd, const char *name, struct digest of, struct store_packer **ret, struct err *err)
{
	struct store_packer *k = calloc(1, sizeof *k);
	int r;

	if (!k)
		return err_set(err, ERR_NOMEM, "no memory for a pack");
	*k = (struct store_packer){.fd = fd, .name = name, .of = of, .at = STORE_PACK_HEAD};
	r = head_write(k, err);
	if (r)
		store_packer_free(k);
	else
		*ret = k;
	return r;
}

struct store_packer *store_packer_free(struct store_packer *k)
{
	if (k)
		free(k->entry);
	free(k);
	return NULL;
}

size_t store_packer_held(const struct store_packer *k)
{
	return sizeof *k + k->room * sizeof *k->entry;
}

static int make_room(struct store_packer *k, struct err *err)
{
	size_t room = k->room ? 2 * k->room : FIRST_ROOM;
	struct store_pack_entry *more;

	if (k->n < k->room)
		return 0;
	more = realloc(k->entry, room * sizeof *more);
	if (!more)
		return err_set(err, ERR_NOMEM, "no memory for the index of a pack of %zu domains", room);
	k->entry = more;
	k->room = room;
	return 0;
}

int store_packer_add(struct store_packer *k, const char *region, const struct store_id *id, const struct store_beside *beside,
		     bool flat, const struct mesh_domain *d, struct store_front *ret, struct err *err)
{
	struct store_front f = {.domain = *d, .beside = *beside};
	struct store_pack_entry e = {
		.id = *id,
		.at = store_pack_align(k->at),
		.own = d->counts.used,
		.nvertex = d->nvertex,
		.nopen = d->nopen,
		.ntriangle = d->ntriangle,
		.nedges = d->nedges,
		.nhull = d->nhull,
		.flat = flat,
		.digest = d->digest,
		.own_digest = d->own_digest,
	};
	int r;

	if (beside->proof_size > STORE_PROOF_MOST || strlen(region) >= sizeof e.region)
		return err_set(err, ERR_INTERNAL, "a proof of %zu bytes or the region %s is too long to be stored",
			       beside->proof_size, region);
	memcpy(e.region, region, strlen(region));
	memcpy(e.box, d->box, sizeof e.box);
	r = make_room(k, err);
	if (!r)
		r = store_write(k->fd, k->name, e.at, id, &f, err);
	if (r)
		return r;
	e.bytes = f.bytes;
	k->entry[k->n++] = e;
	k->at = e.at + e.bytes;
	*ret = f;
	return 0;
}

size_t store_packer_domains(const struct store_packer *k)
{
	return k->n;
}

int store_packer_keep(struct store_packer *k, size_t n, struct err *err)
{
	k->n = n;
	k->at = n ? k->entry[n - 1].at + k->entry[n - 1].bytes : STORE_PACK_HEAD;
	if (!io->ftruncate(k->fd, (off_t)k->at))
		return 0;
	err_sys(err, errno, "cannot shorten the file");
	return err_add_file(err, k->name);
}

static void entry_pack(const struct store_pack_entry *e, uint64_t at, uint8_t bytes[STORE_PACK_ENTRY])
{
	struct packer p = packer_of(bytes, STORE_PACK_ENTRY);

	packer_bytes(&p, e->region, sizeof e->region);
	digest_pack(&p, e->id.base);
	digest_pack(&p, e->id.list);
	packer_u64(&p, e->at);
	packer_u64(&p, e->bytes);
	packer_u64(&p, e->own);
	packer_u32(&p, e->nvertex);
	packer_u32(&p, e->nopen);
	packer_u32(&p, e->ntriangle);
	packer_u32(&p, e->nedges);
	packer_u32(&p, e->nhull);
	packer_u32(&p, e->flat);
	for (unsigned i = 0; i < 6; i++)
		packer_i32(&p, e->box[i]);
	digest_pack(&p, e->digest);
	digest_pack(&p, e->own_digest);
	seal(&p, bytes, STORE_PACK_ENTRY, at);
}

static int end_write(struct store_packer *k, uint64_t index, struct err *err)
{
	uint8_t bytes[STORE_PACK_END];
	struct packer p = packer_of(bytes, sizeof bytes);

	packer_u32(&p, STORE_PACK_END_MAGIC);
	packer_u32(&p, STORE_PACK_VERSION);
	digest_pack(&p, k->of);
	packer_u64(&p, k->n);
	packer_u64(&p, index);
	seal(&p, bytes, sizeof bytes, k->at);
	return io_write_at(k->fd, bytes, sizeof bytes, k->at, k->name, err);
}

int store_packer_finish(struct store_packer *k, uint64_t *ret_bytes, struct err *err)
{
	uint8_t bytes[AT_ONCE * STORE_PACK_ENTRY];
	const uint64_t index = store_pack_align(k->at);
	int r = 0;

	k->at = index;
	for (size_t done = 0, some; !r && done < k->n; done += some) {
		some = k->n - done < AT_ONCE ? k->n - done : AT_ONCE;
		for (size_t i = 0; i < some; i++)
			entry_pack(&k->entry[done + i], k->at + i * STORE_PACK_ENTRY, bytes + i * STORE_PACK_ENTRY);
		r = io_write_at(k->fd, bytes, some * STORE_PACK_ENTRY, k->at, k->name, err);
		k->at += some * STORE_PACK_ENTRY;
	}
	if (!r)
		r = end_write(k, index, err);
	if (!r)
		*ret_bytes = k->at + STORE_PACK_END;
	return r;
}
