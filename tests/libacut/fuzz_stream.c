/* Any bytes as a mesh stream: read and checked as acut_fetch does. Checksums are made right first, since a
 * fuzzer does not guess them and the checks behind them are what is looked at. */
#include <stdlib.h>
#include <string.h>

#include <xxhash.h>

#include "check.h"
#include "err.h"
#include "fuzz.h"
#include "stream.h"

static size_t put(uint8_t *bytes, const struct stream_piece *piece, unsigned n)
{
	size_t size = 0;

	for (unsigned i = 0; i < n; i++) {
		memcpy(bytes + size, piece[i].bytes, piece[i].size);
		size += piece[i].size;
	}
	return size;
}

/* A strip of triangles, three vertices a block but for the first. */
size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static uint8_t scratch[STREAM_SCRATCH];
	struct stream_head head = {
		.kind = i % 3 ? STREAM_WHOLE : STREAM_CHANGES, .lattice = "0.01 0.01 5 -7 0", .box = {-99, -99, -99, 99, 99, 99}};
	struct stream_tail tail = {.box = {0, 0, 0, 0, 1, 0}};
	struct stream_piece piece[STREAM_PIECES];
	struct stream_base base = {.generation = 1, .job = 1, .gone = 2, .gone_triangles = 7};
	const struct stream_region gone[2] = {{{-9, 1, -7, 3}, 3, {1, 2}}, {{INT64_MIN, 1, 1, INT64_MAX}, 4, {3, 4}}};
	size_t size = put(bytes, piece, stream_put_head(&head, scratch, piece));

	if (head.kind == STREAM_CHANGES) {
		size += put(bytes + size, piece, stream_put_base(&base, scratch, piece));
		size += put(bytes + size, piece, stream_put_gone(gone, 2, scratch, piece));
	}

	for (unsigned b = 0; b < 1 + i % 5; b++) {
		const uint64_t foreign[2] = {2 * b, 2 * b + 1};
		const int32_t vertex[4][3] = {
			{(int32_t)b, 0, 0}, {(int32_t)b, 1, 0}, {(int32_t)b + 1, 0, 0}, {(int32_t)b + 1, 1, 0}};
		const uint32_t triangle[2][3] = {{0, 2, 1}, {1, 2, 3}};
		const uint8_t final = b % 2 ? 3 : 0, flags[2] = {1, 2};
		struct stream_block block = {.index = b,
					     .first = b > 0 ? 2 + 2 * b : 0,
					     .nforeign = b > 0 ? 2 : 0,
					     .nnew = b > 0 ? 2 : 4,
					     .ntriangle = 2,
					     .foreign = foreign,
					     .vertex = b > 0 ? vertex + 2 : vertex,
					     .triangle = triangle,
					     .final = &final,
					     .flags = i % 2 ? flags : NULL};

		size += put(bytes + size, piece, stream_put_block(&block, scratch, piece));
		tail.blocks++;
		tail.triangles += 2;
		tail.vertices += block.nnew;
		tail.box[3] = (int32_t)b + 1;
	}
	return size + put(bytes + size, piece, stream_put_tail(&tail, scratch, piece));
}

static void fix_checksums(uint8_t *bytes, size_t size)
{
	for (size_t at = 0; at + 32 <= size;) {
		uint64_t length, sum;

		memcpy(&length, bytes + at + 8, 8);
		if (length > size - at - 32)
			length = size - at - 32;
		sum = XXH3_64bits(bytes + at + 32, length);
		memcpy(bytes + at + 16, &sum, 8);
		sum = XXH3_64bits(bytes + at, 24);
		memcpy(bytes + at + 24, &sum, 8);
		at += 32 + length;
	}
}

static int on_event(struct stream_reader *r, struct check **check, enum stream_event event, struct err *err)
{
	static const int64_t k[3] = {5, -7, 0};
	const int32_t(*position)[3];

	if (event == STREAM_HEAD)
		*check = check_new(k);
	if (event == STREAM_BLOCK)
		return check_block(*check, stream_reader_block(r), &position, err);
	if (event == STREAM_GONE) {
		size_t n;
		const struct stream_region *region = stream_reader_gone(r, &n);

		check_gone(*check, region, n);
	}
	if (event == STREAM_TAIL && stream_reader_head(r)->kind == STREAM_CHANGES)
		return check_changes(*check, stream_reader_base(r), stream_reader_tail(r), err);
	if (event == STREAM_TAIL)
		return check_tail(*check, stream_reader_tail(r), true, err);
	return 0;
}

static int run(const uint8_t *bytes, size_t size, struct stream_reader *r, struct check **check, struct err *err)
{
	int e = 0;

	for (size_t at = 0, room; at < size && e == 0; at += room) {
		enum stream_event event;
		void *to;

		e = stream_reader_space(r, &to, &room, err);
		if (e < 0)
			break;
		room = room < size - at ? room : size - at;
		memcpy(to, bytes + at, room);
		e = stream_reader_feed(r, room, &event, err);
		if (e == 0)
			e = on_event(r, check, event, err);
	}
	return e;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct stream_reader *r = stream_reader_new();
	struct err err = ERR_INIT;
	struct check *check = NULL;
	uint8_t *copy = malloc(size + 1);

	if (!r || !copy)
		abort();
	memcpy(copy, bytes, size);
	fix_checksums(copy, size);
	if (run(copy, size, r, &check, &err) < 0 && !err.message[0])
		abort(); /* a failure without a sentence */
	check_free(check);
	stream_reader_free(r);
	free(copy);
	return 0;
}
