/* Writes a small mesh stream to standard output, for readers in other languages: a fan of four triangles in
 * two blocks, the second with flags. With an argument: the same, but with an error for a tail, or ("changes") as changes
 * against another mesh. */
#include <stdio.h>
#include <string.h>

#include "digest.h"
#include "stream.h"

static const int32_t vertex[5][3] = {{0, 0, 1}, {10, 0, 2}, {10, 10, 3}, {0, 10, 4}, {5, 5, -5}};
static const int64_t k[3] = {4000000000, -7, 0};

static void write_pieces(const struct stream_piece *piece, unsigned n)
{
	for (unsigned i = 0; i < n; i++)
		fwrite(piece[i].bytes, 1, piece[i].size, stdout);
}

static void add(struct stream_tail *tail, const int32_t *a, const int32_t *b, const int32_t *c)
{
	const int64_t corner[3][2] = {{a[0] + k[0], a[1] + k[1]}, {b[0] + k[0], b[1] + k[1]}, {c[0] + k[0], c[1] + k[1]}};

	digest_add_triangle(&tail->digest, corner);
}

int main(int argc, char **argv)
{
	static uint8_t scratch[STREAM_SCRATCH];
	static const int32_t first_vertex[4][3] = {{0, 0, 1}, {10, 0, 2}, {5, 5, -5}, {0, 10, 4}};
	static const uint32_t first[2][3] = {{0, 1, 2}, {2, 3, 0}}, second[2][3] = {{0, 3, 2}, {3, 1, 2}};
	static const uint64_t foreign[3] = {1, 3, 2};
	static const uint8_t none = 0, centre = 4, flags[2] = {0, 9};
	struct stream_head head = {.kind = STREAM_WHOLE,
				   .lattice = "0.01 0.01 4000000000 -7 0",
				   .crs = "EPSG:25832",
				   .unit_xy = "m",
				   .unit_z = "m",
				   .view = "all",
				   .id = {1, 2},
				   .box = {0, 0, -5, 10, 10, 5}};
	struct stream_block block[2] = {
		{.index = 0,
		 .box = {INT64_MIN, INT64_MIN, 9, INT64_MAX},
		 .nnew = 4,
		 .ntriangle = 2,
		 .vertex = first_vertex,
		 .triangle = first,
		 .final = &none},
		{.index = 2,
		 .box = {9, INT64_MIN, INT64_MAX, INT64_MAX},
		 .first = 4,
		 .nforeign = 3,
		 .nnew = 1,
		 .ntriangle = 2,
		 .foreign = foreign,
		 .vertex = &vertex[2],
		 .triangle = second,
		 .final = &centre,
		 .flags = flags},
	};
	struct stream_tail tail = {
		.blocks = 2, .vertices = 5, .triangles = 4, .hull = 4, .box = {0, 0, -5, 10, 10, 4}, .report = "{\"points\":5}"};
	const struct stream_base base = {.generation = 3,
					 .job = 7,
					 .gone = 2,
					 .gone_triangles = 9,
					 .kept = 1,
					 .kept_triangles = 4,
					 .old_digest = {1, 2},
					 .old_vertex_digest = {3, 4},
					 .digest = {5, 6},
					 .vertex_digest = {7, 8}};
	const struct stream_region gone[2] = {{{INT64_MIN, -3, 5, 7}, 4, {1, 1}}, {{5, -3, INT64_MAX, 7}, 5, {2, 2}}};
	struct stream_piece piece[STREAM_PIECES];
	bool changes;

	for (unsigned i = 0; i < 5; i++)
		digest_add_vertex(&tail.vertex_digest, vertex[i][0] + k[0], vertex[i][1] + k[1], vertex[i][2] + k[2]);
	for (unsigned i = 0; i < 4; i++)
		add(&tail, vertex[i], vertex[(i + 1) % 4], vertex[4]);
	changes = argc > 1 && !strcmp(argv[1], "changes");
	if (argc > 1 && !changes) {
		tail.failed = true;
		strcpy(tail.error_code, argv[1]);
		strcpy(tail.error_message, "as was asked for");
	}
	head.kind = changes ? STREAM_CHANGES : STREAM_WHOLE;
	write_pieces(piece, stream_put_head(&head, scratch, piece));
	if (changes) {
		write_pieces(piece, stream_put_base(&base, scratch, piece));
		write_pieces(piece, stream_put_gone(gone, 1, scratch, piece));
		write_pieces(piece, stream_put_gone(gone + 1, 1, scratch, piece));
	}
	write_pieces(piece, stream_put_block(&block[0], scratch, piece));
	write_pieces(piece, stream_put_block(&block[1], scratch, piece));
	write_pieces(piece, stream_put_tail(&tail, scratch, piece));
	return 0;
}
