/* Any bytes as a file of sources. Its size and checksum are made right first, there and in the manifest that names it. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fuzz_input.h"
#include "grid.h"
#include "grid_block.h"
#include "grid_disk.h"
#include "io.h"

enum { SOURCES = 4, ROOM = 1 << 16 };

static struct io_table quick;

static int no_sync(int fd)
{
	return 0;
}

static char manifest_name[64], sources_name[64];

static int folder(void)
{
	static int fd = -1;

	if (fd >= 0)
		return fd;
	quick = *io;
	quick.fsync = no_sync;
	io = &quick;
	snprintf(manifest_name, sizeof manifest_name, "acut-fuzz-%d", (int)getpid());
	snprintf(sources_name, sizeof sources_name, "sources-fuzz-%d", (int)getpid());
	fd = open("/dev/shm", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	if (fd < 0)
		abort();
	return fd;
}

static size_t take(const char *name, uint8_t *bytes, size_t room)
{
	int fd = openat(folder(), name, O_RDONLY | O_CLOEXEC);
	ssize_t n = fd < 0 ? 0 : read(fd, bytes, room);

	close(fd);
	unlinkat(folder(), name, 0);
	return n < 0 ? 0 : (size_t)n;
}

static void put(const char *name, const uint8_t *bytes, size_t n)
{
	int fd = openat(folder(), name, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);

	if (fd < 0 || write(fd, bytes, n) != (ssize_t)n)
		abort();
	close(fd);
}

/* A manifest and its file of sources; false: it has not worked. */
static bool make(uint8_t *manifest, size_t *ret_manifest, uint8_t *sources, size_t *ret_sources)
{
	struct grid_source source[SOURCES] = {
		{.id = 1, .added = 1, .points = 3, .name = "a.las", .path = "/a.las", .size = 9},
		{.id = 2, .added = 1, .points = 4, .name = "b", .path = "", .reading = "xyz", .left_out = 1},
		{.id = 3, .added = 2, .removed = 3, .name = "", .path = "", .overridden = "x"},
		{.id = 9, .added = 2, .points = 2, .name = "c", .path = "/c", .hash = {1, 2}}};
	struct grid_manifest m = {.lattice = {.scale_xy = {1, -2}, .scale_z = {1, -2}},
				  .crs = "unknown",
				  .unit_xy = "unknown",
				  .unit_z = "metre",
				  .generation = 4,
				  .sources = source,
				  .nsources = SOURCES};
	struct grid_apart apart = {.name = sources_name};
	struct err err = ERR_INIT;

	folder();
	grid_sources_here = 0;
	if (grid_manifest_write_apart(folder(), manifest_name, &apart, &m, &err))
		return false;
	*ret_manifest = take(manifest_name, manifest, ROOM);
	*ret_sources = take(sources_name, sources, ROOM);
	return *ret_manifest && *ret_sources;
}

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static uint8_t manifest[ROOM], sources[ROOM];
	size_t m, n;

	if (i || !make(manifest, &m, sources, &n) || n > room)
		return 0;
	memcpy(bytes, sources, n);
	return n;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static uint8_t manifest[ROOM], sources[ROOM], copy[ROOM];
	static size_t nmanifest, nsources;
	struct grid_manifest *m = NULL;
	struct err err = ERR_INIT;
	uint64_t check, length = size;
	uint32_t count = SOURCES;
	uint8_t *named;
	int rc;

	if (!nmanifest && !make(manifest, &nmanifest, sources, &nsources))
		abort();
	if (size < 40 || size > ROOM)
		return 0;
	memcpy(copy, bytes, size);
	memcpy(copy, DISK_SOURCES_MAGIC, 8);
	memcpy(copy + 12, &count, 4);
	memcpy(copy + 16, &length, 8);
	check = grid_check(copy, size - 8, 0);
	memcpy(copy + size - 8, &check, 8);
	put(sources_name, copy, size);
	/* name, bytes, sources, check */
	memcpy(copy, manifest, nmanifest);
	named = memmem(copy, nmanifest, sources + nsources - 8, 8);
	memcpy(named - 12, &length, 8);
	memcpy(named, &check, 8);
	check = grid_check(copy, nmanifest - 8, 0);
	memcpy(copy + nmanifest - 8, &check, 8);
	put(manifest_name, copy, nmanifest);
	rc = grid_manifest_read(folder(), manifest_name, &m, &err);
	fuzz_input_check(rc, &err);
	if (!rc && m->nsources != SOURCES)
		abort();
	if (!rc)
		grid_manifest_free(m);
	unlinkat(folder(), manifest_name, 0);
	unlinkat(folder(), sources_name, 0);
	return 0;
}
