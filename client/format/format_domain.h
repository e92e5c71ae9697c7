/* Domains as numbers. */
#ifndef FORMAT_DOMAIN_H
#define FORMAT_DOMAIN_H

#include <stdint.h>

/* A hash of the region of a domain: pieces of one have the same, neighbours different ones. */
static inline uint32_t format_domain(const int64_t box[4])
{
	uint64_t h = 0x243f6a8885a308d3u;

	for (int i = 0; i < 4; i++) {
		h = (h ^ (uint64_t)box[i]) * 0x9e3779b97f4a7c15u;
		h ^= h >> 29;
	}
	return (uint32_t)(h ^ h >> 32);
}

#endif
