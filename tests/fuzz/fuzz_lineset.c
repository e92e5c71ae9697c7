/*
 * Any bytes as a line set, or as a file of lines. Checksums are made right first, from the leaves to the root, since a fuzzer
 * does not guess them. Whatever is taken is asked for pieces, states, sums and marks; all vertices of a file of lines are read.
 */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "breakline_file.h"
#include "fuzz_input.h"
#include "grid_block.h"
#include "lineset_file.h"

enum { ROOM = 1 << 16 };

/* ---- seeds ---- */

static size_t read_back(int dirfd, const char *path, uint8_t *bytes, size_t room)
{
	int fd = openat(dirfd, "f", O_RDONLY | O_CLOEXEC);
	ssize_t n = fd < 0 ? 0 : read(fd, bytes, room);

	close(fd);
	unlinkat(dirfd, "f", 0);
	close(dirfd);
	rmdir(path);
	return n < 0 ? 0 : (size_t)n;
}

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static const size_t pieces[] = {0, 1, 12, 500};
	static struct lineset_piece p[500];
	char path[] = "/dev/shm/acut-fuzz-XXXXXX";
	struct breakline_writer *w;
	struct breakline_totals t;
	struct err err = ERR_INIT;
	int dirfd;

	if (i >= 6 || !mkdtemp(path))
		return 0;
	dirfd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	for (int32_t k = 0; k < 500; k++)
		p[k] = (struct lineset_piece){
			{k % 20 * 9, k / 20 * 9}, {k % 20 * 9 + 5, k / 20 * 9 + k % 7 - 3}, (uint32_t)k % 4};
	if (i < 4) {
		if (lineset_write(dirfd, "f", p, pieces[i], i & 1 ? LINESET_OUT : 0, &err))
			abort();
		return read_back(dirfd, path, bytes, room);
	}
	if (breakline_writer_new(dirfd, "f", &w, &err))
		abort();
	for (int32_t k = 0; k < (i == 4 ? 3 : 300); k++) {
		const struct breakline_vertex v = {.x = k, .bits = k % 10 ? 0 : 7, .kind = (uint8_t)(k / 10 % 4)};

		if (breakline_write(w, &v, 1, &err))
			abort();
	}
	if (breakline_writer_finish(w, &t, &err))
		abort();
	breakline_writer_free(w);
	return read_back(dirfd, path, bytes, room);
}

/* ---- checksums ---- */

static void seal(uint8_t *page, uint64_t place)
{
	uint64_t check = grid_check(page + 8, LINESET_PAGE - 8, place);

	memcpy(page, &check, sizeof check);
}

static void forge_set(uint8_t *bytes, size_t size)
{
	struct lineset_head *h = (struct lineset_head *)bytes;
	struct lineset_shape s;

	if (!lineset_shape(h->pieces, &s) || lineset_place(s.all) != size)
		return;
	for (unsigned level = 0; level < s.height; level++)
		for (uint64_t i = 0; i < s.pages[level]; i++) {
			uint64_t place = lineset_place(s.first[level] + i);
			struct lineset_inner *above;

			seal(bytes + place, place);
			if (level + 1 == s.height) {
				memcpy(&h->root_check, bytes + place, 8);
				continue;
			}
			above = (struct lineset_inner *)(bytes + lineset_place(s.first[level + 1] + i / LINESET_ENTRIES) +
							 sizeof(struct lineset_page));
			memcpy(&above[i % LINESET_ENTRIES].check, bytes + place, 8);
		}
}

/* ---- use ---- */

static int take_piece(void *ctx, const struct lineset_piece *p, struct err *err)
{
	++*(uint64_t *)ctx;
	return 0;
}

static void use_set(struct lineset *set, const uint8_t *bytes, size_t size, struct err *err)
{
	void *memory = malloc(lineset_reader_bytes());
	struct lineset_reader *r = lineset_reader_init(memory, set);
	struct point pts[8] = {{0}};
	struct digest sum;
	int32_t box[4];
	unsigned state;
	uint64_t n = 0;
	int rc;

	memcpy(box, bytes + size - sizeof box, sizeof box);
	if (box[0] > box[2] || box[1] > box[3])
		memcpy(box, lineset_info(set)->box, sizeof box);
	rc = lineset_find(r, box, take_piece, &n, err);
	for (int32_t i = 0; !rc && i < 8; i++) {
		pts[i] =
			(struct point){.x = (int32_t)(box[0] + ((int64_t)box[2] - box[0]) * i / 7), .y = i & 1 ? box[1] : box[3]};
		rc = lineset_state(r, (int64_t)pts[i].x * 3 + 1, (int64_t)pts[i].y * 3 - 1, 3, &state, err);
	}
	if (!rc)
		rc = lineset_sum(r, box, &sum, err);
	if (!rc)
		rc = lineset_sum_range(r, n, UINT64_MAX - n, (int64_t)n, &sum, err);
	if (!rc)
		rc = lineset_mark(r, box, (double)(n % 5), pts, 8, err);
	if (rc)
		fuzz_input_check(rc, err);
	free(memory);
}

static int take_vertices(void *ctx, const struct breakline_vertex *v, size_t n, struct err *err)
{
	*(uint64_t *)ctx += n;
	return 0;
}

static void use_lines(const char *name, struct err *err)
{
	struct breakline_totals t;
	uint64_t n = 0;
	int rc = breakline_totals(AT_FDCWD, name, &t, err);

	if (!rc)
		rc = breakline_read(AT_FDCWD, name, take_vertices, &n, err);
	if (rc)
		fuzz_input_check(rc, err);
	else if (n != t.vertices)
		abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t size)
{
	_Alignas(8) static uint8_t bytes[ROOM];
	struct lineset *set = NULL;
	struct err err = ERR_INIT;
	char name[32];
	int rc;

	if (size < LINESET_PAGE || size > ROOM)
		return 0;
	memcpy(bytes, input, size);
	if (memcmp(bytes + 8, BREAKLINE_MAGIC, 8) == 0)
		for (size_t at = BREAKLINE_PAGE; at + BREAKLINE_PAGE <= size; at += BREAKLINE_PAGE)
			seal(bytes + at, at);
	else
		forge_set(bytes, size);
	seal(bytes, 0);
	snprintf(name, sizeof name, "/proc/self/fd/%d", fuzz_input_fd(bytes, size));
	if (memcmp(bytes + 8, BREAKLINE_MAGIC, 8) == 0) {
		use_lines(name, &err);
		return 0;
	}
	rc = lineset_open(AT_FDCWD, name, NULL, size % 3 * 8192, &set, &err);
	if (rc)
		fuzz_input_check(rc, &err);
	else
		use_set(set, bytes, size, &err);
	lineset_close(set);
	return 0;
}
