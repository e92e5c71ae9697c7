/* Any bytes as what the cache has on disk: a manifest (FUZZ_MANIFEST), or a block of a cell. Checksums are made
 * right first: a fuzzer does not guess them, and what is behind them is looked at. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "fuzz_input.h"
#include "grid.h"
#include "grid_block.h"
#include "io.h"

#if FUZZ_MANIFEST
static struct io_table quick;

static int no_sync(int fd)
{
	return 0;
}

static int folder(void)
{
	static int fd = -1;
	char path[] = "/dev/shm/acut-fuzz-XXXXXX";

	if (fd >= 0)
		return fd;
	quick = *io;
	quick.fsync = no_sync;
	io = &quick;
	if (!mkdtemp(path))
		abort();
	fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	if (fd < 0)
		abort();
	rmdir(path); /* usable no more */
	fd = open("/dev/shm", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	return fd;
}

static const char *name(void)
{
	static char text[64];

	snprintf(text, sizeof text, "acut-fuzz-%d", (int)getpid());
	return text;
}

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	struct grid_segment_info segment = {.points = 9,
					    .cells = 1,
					    .bytes = 8192,
					    .file = "a.segment",
					    .classes = {[2] = 9},
					    .lo = UINT64_C(3) << 62,
					    .hi = UINT64_C(3) << 62};
	struct grid_span life = {.added = 1, .removed = 2};
	const struct grid_lines lines = {{1, 0, 0, 1}, 2, 7, 8192, 0, {1, 2}},
				set = {.bytes = 8192, .places = 1, .content = {1, 2}};
	struct grid_source source[4] = {
		{.id = 1, .added = 1, .points = 3, .name = "a.las", .path = "/a.las", .size = 9},
		{.id = 2, .added = 4, .points = 4, .name = "b", .path = "", .earlier = &life, .nearlier = 1},
		{.id = 3, .added = 4, .name = "r", .path = "/r", .kind = GRID_LINES, .lines = &lines},
		{.id = 4, .added = 4, .points = 2, .name = "", .path = "", .kind = GRID_LINE_VERTICES, .lines = &set}};
	struct grid_generation all[3] = {
		{.number = 1, .time_us = 5, .uid = 1000, .user = "ann", .kind = GRID_PUSH, .files = 2, .points_added = 7},
		{.number = 2, .kind = GRID_REVERT, .undoes = 1, .files_removed = 1, .points_removed = 4},
		{.number = 4, .kind = GRID_REVERT, .undoes = 2, .files = 1, .points_added = 4}};
	struct grid_manifest m = {.lattice = {.scale_xy = {1, -2}, .scale_z = {1, -2}},
				  .crs = "unknown",
				  .unit_xy = "unknown",
				  .unit_z = "metre",
				  .generation = 4,
				  .oldest = i & 1,
				  .segments = &segment,
				  .nsegments = i & 1,
				  .sources = source,
				  .generations = all,
				  .ngenerations = i & 1 ? 3 : 0};
	struct grid_apart apart = {.name = "sources-fuzz"};
	struct err err = ERR_INIT;
	ssize_t n;
	int fd;

	m.nsources = i ? 4 : 0;
	grid_sources_here = 0;
	if (i >= 3 || (i == 2 ? grid_manifest_write_apart(folder(), name(), &apart, &m, &err) :
				grid_manifest_write(folder(), name(), &m, &err)))
		return 0;
	unlinkat(folder(), apart.name, 0);
	fd = openat(folder(), name(), O_RDONLY | O_CLOEXEC);
	n = fd < 0 ? 0 : read(fd, bytes, room);
	close(fd);
	unlinkat(folder(), name(), 0);
	return n < 0 ? 0 : (size_t)n;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	uint8_t *copy = malloc(size + 1);
	struct grid_manifest *m = NULL;
	struct err err = ERR_INIT;
	uint64_t check, length = size;
	int fd = openat(folder(), name(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600), rc;

	if (!copy || fd < 0)
		abort();
	memcpy(copy, bytes, size);
	if (size > 40) {
		memcpy(copy, DISK_MANIFEST_MAGIC, 8);
		memcpy(copy + 16, &length, 8);
		check = grid_check(copy, size - 8, 0);
		memcpy(copy + size - 8, &check, 8);
	}
	if (write(fd, copy, size) != (ssize_t)size)
		abort();
	close(fd);
	rc = grid_manifest_load_bare(folder(), name(), NULL, &m, &err);
	fuzz_input_check(rc, &err);
	if (!rc)
		grid_manifest_free(m);
	unlinkat(folder(), name(), 0);
	free(copy);
	return 0;
}
#else
enum { PLACE = 4096 };

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static _Alignas(16) uint8_t block[DISK_BLOCK_MAX];
	struct point pts[8];
	uint32_t ids[8] = {1, 2, 2, 1, 3, 3, 3, 9};
	struct grid_block_info info;

	if (i >= 8)
		return 0;
	for (int k = 0; k < 8; k++)
		pts[k] = (struct point){.x = 5, .y = 7, .z = k, .cls = (uint8_t)(k / 3), .ret = 0x11};
	grid_block_make(pts, i + 1, ids, NULL, block, &info);
	grid_block_place(block, PLACE);
	memcpy(bytes, block, info.bytes);
	return info.bytes;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	uint8_t *copy = aligned_alloc(16, (size + 16) & ~(size_t)15);
	struct disk_block head;
	struct grid_block block;
	size_t n;

	if (!copy)
		abort();
	memcpy(copy, bytes, size);
	if (size >= sizeof head) {
		n = grid_block_head_bytes(copy);
		memcpy(&head, copy, sizeof head);
		if (n && n <= size && head.records <= (size - n) / sizeof(struct point)) {
			head.records_check = grid_check(copy + n, head.records * sizeof(struct point), PLACE);
			memcpy(copy, &head, sizeof head);
		}
		if (n && n <= size) {
			head.check = grid_check(copy + 8, n - 8, PLACE);
			memcpy(copy, &head, 8);
		}
		for (int whole = 0; whole < 2; whole++)
			if (grid_block_open(copy, size, PLACE, whole, &block) && block.bytes > size && whole)
				abort();
	}
	free(copy);
	return 0;
}
#endif
