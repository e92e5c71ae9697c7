/*
 * Any bytes as a pack of finished domains. Checksums are made right first. Whatever is taken for a domain has the corners that it
 * says, and what is refused says why.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "fuzz_input.h"
#include "store_format.h"
#include "store_pack.h"
#include "store_pack_format.h"

enum { ROOM = 1 << 16, DOMAIN_MOST = 1 << 20 };

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static struct mesh_vertex vertex[5] = {{0, 0, 1}, {9, 0, 2}, {0, 9, 3}, {9, 9, 4}, {4, 4, 5}};
	static struct mesh_link link[4] = {{1, 2, 1}, {3, 4, 2}, {5, 6, 1}, {0, 0, 3}};
	static uint32_t triangle[4][3] = {{0, 1, 4}, {1, 3, 4}, {3, 2, 4}, {2, 0, 4}};
	const struct mesh_domain d = {
		.vertex = vertex, .link = link, .triangle = triangle, .nvertex = 5, .nopen = 4, .ntriangle = 4};
	const struct store_beside beside = {.proof = "proof", .proof_size = 5};
	const struct store_id id = {{1, 2}, {3, 4}};
	int fd = fuzz_input_fd(NULL, 0);
	struct store_packer *k = NULL;
	struct err err = ERR_INIT;
	struct store_front f;
	uint64_t size = 0;

	if (i >= 3)
		return 0;
	if (store_packer_new(fd, "pack", (struct digest){5, 6}, &k, &err))
		abort();
	for (unsigned n = 0; n < i; n++)
		if (store_packer_add(k, "a region", &id, &beside, n == 1, &d, &f, &err))
			abort();
	if (store_packer_finish(k, &size, &err) || size > room || pread(fd, bytes, size, 0) != (ssize_t)size)
		abort();
	store_packer_free(k);
	return size;
}

static void seal(uint8_t *bytes, size_t size, uint64_t seed)
{
	uint64_t sum = XXH3_64bits_withSeed(bytes, size - 8, seed);

	memcpy(bytes + size - 8, &sum, 8);
}

static void forge(uint8_t *bytes, size_t size)
{
	uint8_t *end = bytes + size - STORE_PACK_END;
	uint64_t index, at;

	memcpy(bytes, "ACPK", 4);
	memcpy(end, "ACPE", 4);
	memcpy(end + 8, bytes + 8, 16);
	memcpy(&index, end + 32, 8);
	seal(bytes, STORE_PACK_HEAD, 0);
	seal(end, STORE_PACK_END, size - STORE_PACK_END);
	for (; index >= STORE_PACK_HEAD && index <= size && size - index >= STORE_PACK_ENTRY + STORE_PACK_END;
	     index += STORE_PACK_ENTRY) {
		seal(bytes + index, STORE_PACK_ENTRY, index);
		memcpy(&at, bytes + index + 96, 8);
		if (at > size || size - at < STORE_HEADER)
			continue;
		memcpy(bytes + at, "ACDM", 4);
		memcpy(bytes + at + 8, bytes + index + 64, 32);
		seal(bytes + at, STORE_HEADER, 0);
	}
}

static void read_domain(const struct store_pack *k, const struct store_pack_entry *e)
{
	size_t size = store_pack_memory(e);
	struct err err = ERR_INIT;
	struct mesh_domain d;
	uint8_t *memory;
	int r;

	if (size > DOMAIN_MOST)
		return;
	memory = malloc(size + 1);
	r = store_pack_get(k, e, memory, size, &d, &err);
	fuzz_input_check(r, &err);
	for (uint32_t i = 0; !r && i < d.ntriangle; i++)
		for (unsigned c = 0; c < 3; c++)
			if (d.triangle[i][c] >= d.nvertex)
				abort();
	free(memory);
}

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t size)
{
	uint8_t *bytes = calloc(1, ROOM);
	struct store_pack_entry e;
	struct err err = ERR_INIT;
	struct store_front f;
	struct store_pack k;
	int fd, r;

	if (!bytes)
		abort();
	size = size < ROOM ? size : ROOM;
	memcpy(bytes, input, size);
	if (size >= STORE_PACK_HEAD + STORE_PACK_END)
		forge(bytes, size);
	fd = fuzz_input_fd(bytes, size);
	r = store_pack_open(fd, "pack", &k, &err);
	fuzz_input_check(r, &err);
	for (uint64_t i = 0; !r && i < k.n; i++) {
		err_clear(&err);
		r = store_pack_entries(&k, i, 1, &e, &err);
		fuzz_input_check(r, &err);
		if (r)
			break;
		read_domain(&k, &e);
		fuzz_input_check(store_pack_head(&k, &e, &f, &err), &err);
	}
	free(bytes);
	return 0;
}
