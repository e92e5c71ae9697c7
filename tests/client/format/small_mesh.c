/* Small meshes for the steps between a stream and the writers (small_mesh.h). */
#include "small_mesh.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "err.h"
#include "random.h"

struct small_mesh small;

/* ---- a format that keeps what it gets ---- */

static struct {
	int32_t at[SMALL_TRIANGLES][3][3];
	unsigned n;
	uint64_t triangles;
	char digest[40], trimmed[256];
} got;

static int got_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	snprintf(got.trimmed, sizeof got.trimmed, "%s", opt->trimmed ? opt->trimmed : "");
	got.n = 0;
	*ret = &got;
	return 0;
}

static int got_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	return 0;
}

static int got_block(void *writer, const struct format_block *b, struct err *err)
{
	for (uint32_t i = 0; i < b->mesh->ntriangle; i++, got.n++) {
		assert_true(got.n < SMALL_TRIANGLES);
		for (unsigned j = 0; j < 3; j++) {
			uint32_t t = b->mesh->triangle[i][j];

			assert_true(t < b->mesh->nforeign + b->mesh->nnew);
			memcpy(got.at[got.n][j], b->position[t], 12);
		}
	}
	return 0;
}

static int got_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	snprintf(got.digest, sizeof got.digest, "%s", tail->digest);
	got.triangles = tail->triangles;
	return 0;
}

static void *got_free(void *writer)
{
	return NULL;
}

const struct format small_format = {.name = "got",
				    .extensions = "",
				    .help = "",
				    .kind = FORMAT_NOTHING,
				    .positions = true,
				    .open = got_open,
				    .head = got_head,
				    .block = got_block,
				    .finish = got_finish,
				    .free = got_free};

/* ---- meshes ---- */

void small_make(uint64_t *seed, int32_t step)
{
	unsigned spread = 1 + (unsigned)random_below(seed, 40);

	small.w = 2 + (unsigned)random_below(seed, SMALL_SIDE - 1);
	small.h = 2 + (unsigned)random_below(seed, SMALL_SIDE - 1);
	small.n = 0;
	for (unsigned i = 0; i < small.w * small.h; i++) {
		small.at[i][0] = step * (int32_t)(10 * (i % small.w) + random_below(seed, spread));
		small.at[i][1] = step * (int32_t)(10 * (i / small.w) + random_below(seed, spread));
		small.at[i][2] = (int32_t)i; /* also tells the points apart */
	}
	for (unsigned y = 0; y + 1 < small.h; y++)
		for (unsigned x = 0; x + 1 < small.w; x++) {
			uint32_t a = y * small.w + x, q[4] = {a, a + 1, a + small.w + 1, a + small.w},
				 turn = random_below(seed, 2) != 0;

			for (unsigned k = 0; k < 2; k++, small.n++)
				memcpy(small.triangle[small.n],
				       (uint32_t[3]){q[turn], q[(turn + 1 + k) % 4], q[(turn + 2 + k) % 4]}, 12);
		}
	for (unsigned i = small.n; i > 1; i--) {
		unsigned k = (unsigned)random_below(seed, i);
		uint32_t hold[3];

		memcpy(hold, small.triangle[i - 1], 12);
		memcpy(small.triangle[i - 1], small.triangle[k], 12);
		memcpy(small.triangle[k], hold, 12);
	}
}

struct digest small_digest(bool kept)
{
	struct digest sum = {0};

	for (unsigned t = 0; t < small.n; t++) {
		int64_t corner[3][2];

		for (unsigned j = 0; j < 3; j++)
			for (unsigned k = 0; k < 2; k++)
				corner[j][k] = small.at[small.triangle[t][j]][k] + SMALL_K * (int64_t)(k + 1);
		if (!kept || !small.gone[t])
			digest_add_triangle(&sum, corner);
	}
	return sum;
}

/* ---- the stream ---- */

bool small_is_piece(uint32_t a, uint32_t b)
{
	uint64_t low = a < b ? a : b, high = a < b ? b : a;

	return small.lines && ((low * SMALL_POINTS + high + 1) * small.lines >> 40) % 8 == 0;
}

int small_send(const struct acut_mesh_sink *sink, uint64_t *seed)
{
	uint64_t number[SMALL_POINTS], next = 0;
	char hex[DIGEST_HEX_SIZE];
	struct acut_mesh_tail tail = {.triangles = small.n, .digest = digest_hex(small_digest(false), hex), .vertex_digest = hex};
	const struct acut_mesh_head head = {.lattice = "0.1 0.1 1000 2000 0",
					    .scale_xy = "0.1",
					    .scale_z = "0.1",
					    .crs = "EPSG:2154 + EPSG:5720",
					    .unit_xy = "metre",
					    .unit_z = "",
					    .view = "view 1",
					    .k = {SMALL_K, 2 * SMALL_K, 0}};
	int r = sink->head(sink->ctx, &head);

	memset(number, 0xff, sizeof number);
	for (unsigned from = 0; !r && from < small.n;) {
		unsigned n = 1 + (unsigned)random_below(seed, small.n - from);
		uint64_t foreign[SMALL_POINTS];
		int32_t at[SMALL_POINTS][3]; /* of all */
		uint8_t flags[SMALL_TRIANGLES] = {0};
		uint32_t triangle[SMALL_TRIANGLES][3], local[SMALL_POINTS], nforeign = 0, nnew = 0;
		struct acut_mesh_block b = {.index = from, .first = next, .box = {(int64_t)from, 0, 1, 1}, .ntriangle = n};

		for (unsigned pass = 0; pass < 2; pass++) /* foreign ones first */
			for (unsigned i = 0; i < small.w * small.h; i++) {
				bool used = false, old = number[i] < b.first;

				for (unsigned t = from; t < from + n; t++)
					used |= small.triangle[t][0] == i || small.triangle[t][1] == i ||
						small.triangle[t][2] == i;
				if (!used || old == (pass == 1))
					continue;
				local[i] = old ? nforeign : nforeign + nnew;
				memcpy(at[local[i]], small.at[i], 12);
				if (old) {
					foreign[nforeign++] = number[i];
				} else {
					nnew++;
					number[i] = next++;
				}
			}
		for (unsigned t = 0; t < n; t++)
			for (unsigned j = 0; j < 3; j++) {
				const uint32_t *c = small.triangle[from + t];

				triangle[t][j] = local[c[j]];
				flags[t] |= (uint8_t)(small_is_piece(c[(j + 1) % 3], c[(j + 2) % 3]) << j);
			}
		b.flags = small.lines ? flags : NULL;
		b.nforeign = nforeign;
		b.nnew = nnew;
		b.foreign = foreign;
		b.local = (const int32_t(*)[3])at;
		b.vertex = b.local + nforeign;
		b.triangle = (const uint32_t(*)[3])triangle;
		r = sink->block(sink->ctx, &b);
		from += n;
	}
	return r ? r : sink->tail(sink->ctx, &tail);
}

static bool is_got(const uint32_t *t)
{
	unsigned found = 0;

	for (unsigned i = 0; i < got.n; i++) {
		bool same = true;

		for (unsigned j = 0; j < 3; j++)
			same &= !memcmp(got.at[i][j], small.at[t[j]], 12);
		found += same;
	}
	assert_true(found < 2);
	return found;
}

unsigned small_check(const struct outputs_report *report)
{
	unsigned left = 0;
	char hex[DIGEST_HEX_SIZE];

	for (unsigned t = 0; t < small.n; t++) {
		assert_int_equal(is_got(small.triangle[t]), !small.gone[t]);
		left += small.gone[t];
	}
	assert_int_equal(got.n, small.n - left);
	assert_int_equal(got.triangles, got.n);
	assert_string_equal(got.digest, digest_hex(small_digest(true), hex));
	assert_int_equal(report->left_out.triangles, left);
	assert_string_equal(report->written, hex);
	return left;
}

const char *small_trimmed(void)
{
	return got.trimmed;
}
