/*
 * Any bytes as a finished domain of the store. Checksums are made right first: a fuzzer does not guess them,
 * and what is behind them is looked at. Whatever is taken for a domain goes through the emitter, and every
 * number of the block is one that a reader can use.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "fuzz_input.h"
#include "pipe.h"
#include "store.h"
#include "store_format.h"

enum { ROOM = 1 << 16, SUMS = 264, TABLE = 64 << 10 };
static const struct store_id ID = {{1, 2}, {3, 4}};

static int folder(void)
{
	static int fd = -1;
	char path[] = "/dev/shm/acut-fuzz-XXXXXX";

	if (fd >= 0)
		return fd;
	if (!mkdtemp(path))
		abort();
	fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	if (fd < 0 || mkdirat(fd, "00", 0700))
		abort();
	return fd;
}

static void clear(void)
{
	char name[STORE_NAME];

	store_name(&ID, name);
	unlinkat(folder(), name, 0);
}

static void leave(void)
{
	char path[64], link[64];
	ssize_t n;

	clear();
	unlinkat(folder(), "00", AT_REMOVEDIR);
	snprintf(link, sizeof link, "/proc/self/fd/%d", folder());
	n = readlink(link, path, sizeof path - 1);
	if (n > 0) {
		path[n] = '\0';
		rmdir(path);
	}
}

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static struct mesh_vertex vertex[5] = {{0, 0, 1}, {9, 0, 2}, {0, 9, 3}, {9, 9, 4}, {4, 4, 5}};
	static struct mesh_link link[4] = {{1, 2, 1}, {3, 4, 2}, {5, 6, 1}, {0, 0, 3}};
	static uint32_t triangle[4][3] = {{0, 1, 4}, {1, 3, 4}, {3, 2, 4}, {2, 0, 4}};
	struct mesh_domain d = {.vertex = vertex, .link = link, .triangle = triangle, .nvertex = 5, .nopen = 4, .ntriangle = 4};
	const struct store_beside beside = {.proof = "proof", .proof_size = i & 1 ? 5 : 0};
	struct err err = ERR_INIT;
	struct store_front f;
	char name[STORE_NAME];
	ssize_t n;
	int fd;

	if (i >= 4)
		return 0;
	vertex[4].z = i & 2 ? INT32_MAX : 5;
	vertex[3].z = i & 2 ? INT32_MIN : 4;
	if (store_put(folder(), &ID, &beside, &d, &f, &err))
		abort();
	store_name(&ID, name);
	fd = openat(folder(), name, O_RDONLY | O_CLOEXEC);
	n = fd < 0 ? 0 : read(fd, bytes, room);
	close(fd);
	clear();
	return n < 0 ? 0 : (size_t)n;
}

static void seal(uint8_t *bytes)
{
	uint64_t sum = XXH3_64bits(bytes, STORE_HEADER - 8);

	memcpy(bytes + STORE_HEADER - 8, &sum, 8);
}

/* As long as its header says, and every checksum right. */
static size_t forge(uint8_t *bytes, size_t size)
{
	struct store_front f = {0};
	struct store_header h;
	struct store_extent e;
	XXH3_state_t *state;

	memcpy(bytes, "ACDM", 4);
	memset(bytes + 5, 0, 3);
	memcpy(bytes + 8, &ID, sizeof ID);
	seal(bytes);
	if (store_header_unpack(bytes, &ID, &f, &h) != STORE_HEADER_GOOD || f.bytes > ROOM)
		return size;
	e = store_extent_of(&f.domain, &h.code, f.beside.proof_size);
	h.sums.proof = XXH3_64bits(bytes + STORE_HEADER, f.beside.proof_size);
	h.sums.open = XXH3_64bits(bytes + e.open_at, e.open);
	state = XXH3_createState();
	XXH3_64bits_reset(state);
	XXH3_64bits_update(state, bytes + e.closed_at, e.closed);
	XXH3_64bits_update(state, bytes + e.triangle_at, e.triangle);
	h.sums.rest = XXH3_64bits_digest(state);
	XXH3_freeState(state);
	memcpy(bytes + SUMS, &h.sums, sizeof h.sums);
	seal(bytes);
	return f.bytes;
}

static void put(const uint8_t *bytes, size_t size)
{
	char name[STORE_NAME];
	int fd;

	store_name(&ID, name);
	fd = openat(folder(), name, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
	if (fd < 0 || write(fd, bytes, size) != (ssize_t)size)
		abort();
	close(fd);
}

static int take_block(void *ctx, const struct mesh_block *b, struct err *err)
{
	const uint32_t n = b->nforeign + b->nnew;
	volatile int32_t all = 0;

	(void)ctx;
	(void)err;
	for (uint32_t i = 0; i < b->ntriangle; i++)
		for (unsigned k = 0; k < 3; k++)
			if (b->triangle[i][k] >= n)
				abort();
	for (uint32_t i = 0; i < b->nforeign; i++)
		all ^= (int32_t)b->foreign[i];
	for (uint32_t i = 0; i < b->nnew; i++)
		all ^= b->vertex[i].x ^ b->vertex[i].y ^ b->vertex[i].z;
	for (uint32_t i = 0; i < n; i++)
		all ^= b->final[i / 8];
	return 0;
}

static void emit(struct mesh_domain *d, bool whole)
{
	const struct lattice lattice = {.scale_xy = {1, -2}, .scale_z = {1, -2}};
	const struct mesh_sink sink = {.block = take_block};
	const int32_t box[4] = {0, 0, 9, 9};
	struct pipe_emitter *e = NULL;
	struct pipe_totals totals;
	struct cut_region region;
	struct err err = ERR_INIT;
	int r;

	cut_region_root(box, &region);
	if (pipe_emitter_new(&lattice, TABLE, folder(), &e, &err))
		abort();
	r = pipe_emit(e, d, &region, whole ? &sink : NULL, &err);
	if (!r)
		r = pipe_emitter_finish(e, &totals, &err);
	if (r && (!*err.message || (int)err.code != -r)) /* a mesh that is not whole is -ERR_INTERNAL */
		abort();
	pipe_emitter_free(e);
}

/* Conditions of the store are no errors. */
static int judged(int r, const struct err *err)
{
	if (r < 0)
		fuzz_input_check(r, err);
	return r;
}

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t size)
{
	static bool told;
	uint8_t *bytes = calloc(1, ROOM), *memory;
	struct store_front f, head;
	struct mesh_domain d;
	struct err err = ERR_INIT;
	int checked, fd;
	char name[STORE_NAME];

	if (!bytes)
		abort();
	if (!told)
		atexit(leave);
	told = true;
	memcpy(bytes, input, size < ROOM ? size : ROOM);
	if (size >= STORE_HEADER)
		size = forge(bytes, size < ROOM ? size : ROOM);
	put(bytes, size < ROOM ? size : ROOM);
	store_name(&ID, name);
	fd = openat(folder(), "00", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	memory = malloc(600);
	checked = store_check(fd, name + STORE_FOLDER, memory, 600, &err);
	fuzz_input_check(checked, &err);
	free(memory);
	close(fd);
	err_clear(&err);
	if (judged(store_head(folder(), &ID, &head, &err), &err) == 0) {
		memory = malloc(STORE_HEADER + head.beside.proof_size);
		judged(store_proof(folder(), &ID, memory, STORE_HEADER + head.beside.proof_size, &f, &err), &err);
		free(memory);
		memory = malloc(head.front + 1);
		if (judged(store_front(folder(), &ID, memory, head.front, &f, &err), &err) == 0)
			emit(&f.domain, false);
		free(memory);
		memory = malloc(head.whole + 1);
		if ((judged(store_get(folder(), &ID, memory, head.whole, &d, &err), &err) == 0) != !checked)
			abort(); /* one of two took it */
		if (!checked)
			emit(&d, true);
		free(memory);
	}
	clear();
	free(bytes);
	return 0;
}
