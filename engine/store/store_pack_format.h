/*
 * The bytes of a pack around its domains. Internal. format.md, "Packs".
 */
#ifndef STORE_PACK_FORMAT_H
#define STORE_PACK_FORMAT_H

#include <stdint.h>

#include "store_pack.h"

enum { STORE_PACK_HEAD = 64, STORE_PACK_ENTRY = 256, STORE_PACK_END = 64, STORE_PACK_ALIGN = 64 };
#define STORE_PACK_MAGIC UINT32_C(0x4b504341)     /* "ACPK" */
#define STORE_PACK_END_MAGIC UINT32_C(0x45504341) /* "ACPE" */
enum { STORE_PACK_VERSION = 1 };

static inline uint64_t store_pack_align(uint64_t at)
{
	return (at + STORE_PACK_ALIGN - 1) & ~(uint64_t)(STORE_PACK_ALIGN - 1);
}

#endif
