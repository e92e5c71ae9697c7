/*
 * Little-endian bytes with bounds (cursor.h). The host is little-endian (asserted below), so values are copied; bytes
 * can have any alignment. The bytes belong to the caller.
 */
#include "cursor.h"

#include <string.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "values are copied as they lie in memory");

struct cursor cursor_of(const void *bytes, size_t size)
{
	const uint8_t *b = bytes;

	return (struct cursor){b, b, b ? b + size : NULL, false};
}

size_t cursor_left(const struct cursor *c)
{
	return c->bad ? 0 : (size_t)(c->end - c->at);
}

const uint8_t *cursor_bytes(struct cursor *c, size_t n)
{
	if (c->bad || n > (size_t)(c->end - c->at)) {
		c->bad = true;
		return NULL;
	}
	const uint8_t *at = c->at;

	if (n)
		c->at += n;
	return at;
}

void cursor_skip(struct cursor *c, size_t n)
{
	cursor_bytes(c, n);
}

#define READ(name, type)                                      \
	type cursor_##name(struct cursor *c)                  \
	{                                                     \
		type v = 0;                                   \
		const uint8_t *b = cursor_bytes(c, sizeof v); \
                                                              \
		if (b)                                        \
			memcpy(&v, b, sizeof v);              \
		return v;                                     \
	}

READ(u8, uint8_t)
READ(u16, uint16_t)
READ(u32, uint32_t)
READ(u64, uint64_t)
READ(i32, int32_t)
READ(i64, int64_t)
READ(f64, double)

struct packer packer_of(void *bytes, size_t size)
{
	uint8_t *b = bytes;

	return (struct packer){b, b, b ? b + size : NULL, false};
}

size_t packer_size(const struct packer *p)
{
	return (size_t)(p->at - p->start);
}

void packer_bytes(struct packer *p, const void *bytes, size_t n)
{
	if (p->bad || n > (size_t)(p->end - p->at)) {
		p->bad = true;
		return;
	}
	if (n) {
		memcpy(p->at, bytes, n);
		p->at += n;
	}
}

void packer_zero(struct packer *p, size_t n)
{
	if (p->bad || n > (size_t)(p->end - p->at)) {
		p->bad = true;
		return;
	}
	if (n) {
		memset(p->at, 0, n);
		p->at += n;
	}
}

#define WRITE(name, type)                            \
	void packer_##name(struct packer *p, type v) \
	{                                            \
		packer_bytes(p, &v, sizeof v);       \
	}

WRITE(u8, uint8_t)
WRITE(u16, uint16_t)
WRITE(u32, uint32_t)
WRITE(u64, uint64_t)
WRITE(i32, int32_t)
WRITE(i64, int64_t)
WRITE(f64, double)
