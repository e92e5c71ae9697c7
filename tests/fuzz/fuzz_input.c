/*
 * Shared by the targets: bytes as a file, read to its end as the daemon does; and the seeds, which each target
 * makes itself. With ACUT_FUZZ_SEEDS=DIR a target writes its seeds there and ends.
 */
#include "fuzz_input.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "input_reader.h"

int LLVMFuzzerInitialize(int *argc, char ***argv);

enum { BATCH = 512, SEEDS = 64, ROOM = 1 << 17, POINTS_MOST = 1 << 20, PARTS_MOST = 16 };

int LLVMFuzzerInitialize(int *argc, char ***argv)
{
	static uint8_t bytes[ROOM];
	const char *folder = getenv("ACUT_FUZZ_SEEDS");
	char path[4096];
	FILE *f;

	if (!folder)
		return 0;
	for (unsigned i = 0; i < SEEDS; i++) {
		size_t n = fuzz_seed(i, bytes, sizeof bytes);

		snprintf(path, sizeof path, "%s/seed-%02u", folder, i);
		f = n ? fopen(path, "wb") : NULL;
		if (f && fwrite(bytes, 1, n, f) != n)
			exit(1);
		if (f)
			fclose(f);
	}
	exit(0);
}

size_t fuzz_input_text(const char *const *texts, size_t n, unsigned i, uint8_t *bytes, size_t room)
{
	size_t size = i < n ? strlen(texts[i]) : 0;

	if (size > room)
		return 0;
	memcpy(bytes, i < n ? texts[i] : "", size);
	return size;
}

int fuzz_input_fd(const void *bytes, size_t size)
{
	static int fd = -1;

	if (fd < 0)
		fd = memfd_create("fuzz", MFD_CLOEXEC);
	if (fd < 0 || ftruncate(fd, 0) || pwrite(fd, bytes, size, 0) != (ssize_t)size)
		abort();
	return fd;
}

void fuzz_input_check(int rc, const struct err *err)
{
	if (rc < 0 && (!err->message[0] || (int)err->code != -rc || err->code == ERR_INTERNAL))
		abort();
}

static int read_all(struct input *in, uint64_t *ret_points, struct err *err)
{
	static int64_t raw[BATCH][3];
	static uint8_t cls[BATCH], ret[BATCH], flags[BATCH];
	struct input_points pts = {.raw = raw, .cls = cls, .ret = ret, .flags = flags, .cap = BATCH};
	int rc;

	*ret_points = 0;
	do {
		rc = input_read(in, &pts, err);
		if (pts.n > BATCH)
			abort();
		*ret_points += rc ? 0 : pts.n;
	} while (!rc && pts.n && *ret_points < POINTS_MOST);
	return rc;
}

static void read_parts(const struct input *whole, uint64_t points, bool good)
{
	uint64_t n = input_info(whole)->parts, sum = 0;
	bool all = true;

	for (uint64_t i = 0; i < n; i++) {
		struct err err = ERR_INIT;
		struct input *part;
		uint64_t of_part = 0;
		int rc = input_open_part(whole, i, i + 1, &part, &err);

		if (!rc) {
			rc = read_all(part, &of_part, &err);
			input_close(part);
		}
		fuzz_input_check(rc, &err);
		all &= !rc;
		sum += of_part;
	}
	if (all != good || (good && sum != points))
		abort();
}

void fuzz_input_read(const uint8_t *bytes, size_t size, const char *name, const struct input_options *options)
{
	struct err err = ERR_INIT;
	struct input *in = NULL;
	uint64_t points;
	int good = -1, rc = input_open(fuzz_input_fd(bytes, size), name, options, &in, &err);

	fuzz_input_check(rc, &err);
	if (rc) {
		if (err.code != ERR_USAGE && !err.file[0])
			abort();
		return;
	}
	if (input_info(in)->read_bytes > 4 << 20)
		abort();
	rc = read_all(in, &points, &err);
	fuzz_input_check(rc, &err);
	if (!rc && points > input_info(in)->claimed)
		abort();
	if (input_info(in)->parts > 1 && input_info(in)->parts <= PARTS_MOST && points < POINTS_MOST &&
	    !options->accept_truncated)
		good = rc ? 0 : 1;
	input_close(in);
	if (good < 0)
		return;
	/* one that was not read itself */
	err = ERR_INIT;
	if (input_open(fuzz_input_fd(bytes, size), name, options, &in, &err))
		abort();
	read_parts(in, points, good);
	input_close(in);
}
