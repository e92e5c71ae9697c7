/* Digests in files and messages: the high number, then the low one. */
#ifndef DIGEST_PACK_H
#define DIGEST_PACK_H

#include "cursor.h"
#include "digest.h"

static inline void digest_pack(struct packer *p, struct digest d)
{
	packer_u64(p, d.hi);
	packer_u64(p, d.lo);
}

static inline struct digest digest_unpack(struct cursor *c)
{
	struct digest d;

	d.hi = cursor_u64(c);
	d.lo = cursor_u64(c);
	return d;
}

#endif
