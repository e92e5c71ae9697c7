/*
 * Bounds-checked reading and writing of little-endian bytes, with a sticky error: after the first access out of bounds
 * every call does nothing (reads return 0), and `bad` stays true. Check it once, at the end.
 */
#ifndef CURSOR_H
#define CURSOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct cursor {
	const uint8_t *start, *at, *end;
	bool bad;
};

struct cursor cursor_of(const void *bytes, size_t size);
size_t cursor_left(const struct cursor *);
const uint8_t *cursor_bytes(struct cursor *, size_t n); /* NULL when bad */
void cursor_skip(struct cursor *, size_t n);
uint8_t cursor_u8(struct cursor *);
uint16_t cursor_u16(struct cursor *);
uint32_t cursor_u32(struct cursor *);
uint64_t cursor_u64(struct cursor *);
int32_t cursor_i32(struct cursor *);
int64_t cursor_i64(struct cursor *);
double cursor_f64(struct cursor *);

struct packer {
	uint8_t *start, *at, *end;
	bool bad;
};

struct packer packer_of(void *bytes, size_t size);
size_t packer_size(const struct packer *);
void packer_bytes(struct packer *, const void *, size_t n);
void packer_zero(struct packer *, size_t n);
void packer_u8(struct packer *, uint8_t);
void packer_u16(struct packer *, uint16_t);
void packer_u32(struct packer *, uint32_t);
void packer_u64(struct packer *, uint64_t);
void packer_i32(struct packer *, int32_t);
void packer_i64(struct packer *, int64_t);
void packer_f64(struct packer *, double);

#endif
