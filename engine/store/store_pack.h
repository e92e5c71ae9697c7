/*
 * Packs: finished domains in one file, one after the other, each byte for byte as it is in a file of the store
 * (format.md, "Packs"). A cluster's task makes thousands of domains and writes one pack. An index at the end says where each
 * domain is, and has what a reader needs to choose domains and to number their vertices. Everything has a checksum; what is
 * damaged is an error with the name of the file (-ERR_CORRUPT), and is never believed or removed.
 */
#ifndef STORE_PACK_H
#define STORE_PACK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "store.h"

struct err;

enum { STORE_REGION = 64 };

struct store_pack_entry {
	char region[STORE_REGION]; /* the region's text (cut_region_text), zeros behind it */
	struct store_id id;        /* the name that it has in a store */
	uint64_t at, bytes;        /* in the pack */
	uint64_t own;              /* positions of the region that are points of the mesh (counts.used) */
	uint32_t nvertex, nopen, ntriangle, nedges, nhull;
	bool flat;                /* of a survey without triangles: such domains are not for a store (pipe_flat.c) */
	int32_t box[6];           /* of the vertices, as in struct mesh_domain */
	struct digest digest;     /* of the triangles */
	struct digest own_digest; /* vertex digest of the positions of the region */
};

/* ---- writing ---- */

struct store_packer;
/* Writes to `fd` (empty; borrowed, as `name`, which is for messages). `of`: identifies what the domains belong to. */
int store_packer_new(int fd, const char *name, struct digest of, struct store_packer **ret, struct err *err);
/* Adds a domain; nothing of it is needed afterwards. *ret: its numbers, as of store_put. After a failure only
 * store_packer_free may follow. */
int store_packer_add(struct store_packer *, const char *region, const struct store_id *, const struct store_beside *, bool flat,
		     const struct mesh_domain *, struct store_front *ret, struct err *err);
/* Drops all domains but the first n. */
int store_packer_keep(struct store_packer *, size_t n, struct err *err);
size_t store_packer_domains(const struct store_packer *);
/* Writes the index. It does not fsync. *ret_bytes: of the file. */
int store_packer_finish(struct store_packer *, uint64_t *ret_bytes, struct err *err);
size_t store_packer_held(const struct store_packer *);         /* memory for the index, which grows by domain */
struct store_packer *store_packer_free(struct store_packer *); /* NULL is fine; returns NULL */

/* ---- reading ---- */

struct store_pack {
	int fd;           /* borrowed */
	const char *name; /* borrowed; for messages */
	struct digest of;
	uint64_t n;     /* domains */
	uint64_t index; /* place of the first entry */
	uint64_t bytes; /* of the file */
};
/* Reads and checks the head and the end of the file. -ERR_VERSION: a later version wrote it. */
int store_pack_open(int fd, const char *name, struct store_pack *ret, struct err *err);
/* Reads and checks n entries from number `first` on, in the order in which they were added. */
int store_pack_entries(const struct store_pack *, uint64_t first, size_t n, struct store_pack_entry *ret, struct err *err);
/* The numbers of a domain, from its header, which must agree with the entry; no pointer of *ret is valid. */
int store_pack_head(const struct store_pack *, const struct store_pack_entry *, struct store_front *ret, struct err *err);
/* Reads and checks the links and the open vertices alone, to `memory` (8-byte aligned) of store_pack_front_bytes; *ret has these
 * two arrays and no others. */
size_t store_pack_front_bytes(const struct store_pack_entry *);
int store_pack_front(const struct store_pack *, const struct store_pack_entry *, void *memory, struct mesh_domain *ret,
		     struct err *err);
/* Reads the whole domain to `memory` (8-byte aligned) of at least store_pack_memory bytes, and checks all of it. */
size_t store_pack_memory(const struct store_pack_entry *);
int store_pack_get(const struct store_pack *, const struct store_pack_entry *, void *memory, size_t size, struct mesh_domain *ret,
		   struct err *err);
/* Copies the domain into a store, under its id: through `memory` (some KiB at least), every byte checked, published when it
 * is complete. One that is there is replaced. *ret: its numbers. */
int store_pack_adopt(const struct store_pack *, const struct store_pack_entry *, int storefd, void *memory, size_t size,
		     struct store_front *ret, struct err *err);

#endif
