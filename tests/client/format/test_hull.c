/*
 * --trim-hull against brute force: small meshes whose triangles come in any order and in blocks of any size, and limits that some
 * edges have exactly. What stays is told apart by flooding from outside over a list of all triangles.
 * ACUT_FUZZ_CASES: how many meshes (5,000).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "digest.h"
#include "err.h"
#include "outputs.h"
#include "random.h"
#include "repeat.h"

enum { SIDE = 7, POINTS = SIDE * SIDE, TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1) };

static struct {
	int32_t at[POINTS][3];
	uint32_t triangle[TRIANGLES][3];
	bool gone[TRIANGLES];
	unsigned w, h, n;
} mesh;

/* ---- a format that keeps what it gets ---- */

static struct {
	int32_t at[TRIANGLES][3][3];
	uint64_t number[TRIANGLES][3];
	unsigned n;
	char digest[40];
	uint64_t triangles;
} got;

static int got_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	assert_true(opt->trimmed && strstr(opt->trimmed, "trim-hull="));
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
		assert_true(got.n < TRIANGLES);
		for (unsigned j = 0; j < 3; j++) {
			uint32_t t = b->mesh->triangle[i][j];

			assert_true(t < b->mesh->nforeign + b->mesh->nnew);
			memcpy(got.at[got.n][j], b->position[t], 12);
			got.number[got.n][j] =
				t < b->mesh->nforeign ? b->mesh->foreign[t] : b->mesh->first + t - b->mesh->nforeign;
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

static const struct format format_got = {.name = "got",
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

static void make(uint64_t *seed)
{
	unsigned spread = 1 + (unsigned)random_below(seed, 40);

	mesh.w = 2 + (unsigned)random_below(seed, SIDE - 1);
	mesh.h = 2 + (unsigned)random_below(seed, SIDE - 1);
	mesh.n = 0;
	for (unsigned i = 0; i < mesh.w * mesh.h; i++) {
		mesh.at[i][0] = (int32_t)(10 * (i % mesh.w) + random_below(seed, spread));
		mesh.at[i][1] = (int32_t)(10 * (i / mesh.w) + random_below(seed, spread));
		mesh.at[i][2] = (int32_t)i; /* also tells the points apart */
	}
	for (unsigned y = 0; y + 1 < mesh.h; y++)
		for (unsigned x = 0; x + 1 < mesh.w; x++) {
			uint32_t a = y * mesh.w + x, q[4] = {a, a + 1, a + mesh.w + 1, a + mesh.w},
				 turn = random_below(seed, 2) != 0;

			for (unsigned k = 0; k < 2; k++, mesh.n++)
				memcpy(mesh.triangle[mesh.n],
				       (uint32_t[3]){q[turn], q[(turn + 1 + k) % 4], q[(turn + 2 + k) % 4]}, 12);
		}
	for (unsigned i = mesh.n; i > 1; i--) {
		unsigned k = (unsigned)random_below(seed, i);
		uint32_t hold[3];

		memcpy(hold, mesh.triangle[i - 1], 12);
		memcpy(mesh.triangle[i - 1], mesh.triangle[k], 12);
		memcpy(mesh.triangle[k], hold, 12);
	}
}

static int64_t square(uint32_t a, uint32_t b)
{
	int64_t x = mesh.at[a][0] - mesh.at[b][0], y = mesh.at[a][1] - mesh.at[b][1];

	return x * x + y * y;
}

/* The other triangle of an edge; -1: there is none. */
static int beyond(unsigned t, uint32_t a, uint32_t b)
{
	for (unsigned i = 0; i < mesh.n; i++) {
		unsigned shared = 0;

		for (unsigned j = 0; j < 3; j++)
			shared += mesh.triangle[i][j] == a || mesh.triangle[i][j] == b;
		if (i != t && shared == 2)
			return (int)i;
	}
	return -1;
}

static void flood(int64_t limit2)
{
	memset(mesh.gone, 0, sizeof mesh.gone);
	for (bool more = true; more;) {
		more = false;
		for (unsigned t = 0; t < mesh.n; t++)
			for (unsigned j = 0; j < 3 && !mesh.gone[t]; j++) {
				uint32_t a = mesh.triangle[t][j], b = mesh.triangle[t][(j + 1) % 3];
				int other = beyond(t, a, b);

				if (square(a, b) > limit2 && (other < 0 || mesh.gone[other]))
					mesh.gone[t] = more = true;
			}
	}
}

static struct digest digest_of(bool kept)
{
	struct digest sum = {0};

	for (unsigned t = 0; t < mesh.n; t++) {
		int64_t corner[3][2];

		for (unsigned j = 0; j < 3; j++)
			for (unsigned k = 0; k < 2; k++)
				corner[j][k] = mesh.at[mesh.triangle[t][j]][k] + 1000 * (int64_t)(k + 1);
		if (!kept || !mesh.gone[t])
			digest_add_triangle(&sum, corner);
	}
	return sum;
}

/* ---- the stream ---- */

static int send(const struct acut_mesh_sink *sink, uint64_t *seed)
{
	uint64_t number[POINTS], next = 0;
	char hex[DIGEST_HEX_SIZE];
	struct acut_mesh_tail tail = {.triangles = mesh.n, .digest = digest_hex(digest_of(false), hex), .vertex_digest = hex};
	const struct acut_mesh_head head = {.lattice = "0.1 0.1 1000 2000 0",
					    .scale_xy = "0.1",
					    .scale_z = "0.1",
					    .crs = "",
					    .unit_xy = "metre",
					    .unit_z = "",
					    .view = "view 1",
					    .k = {1000, 2000, 0}};
	int r = sink->head(sink->ctx, &head);

	memset(number, 0xff, sizeof number);
	for (unsigned from = 0; !r && from < mesh.n;) {
		unsigned n = 1 + (unsigned)random_below(seed, mesh.n - from);
		uint64_t foreign[POINTS];
		int32_t vertex[POINTS][3];
		uint32_t triangle[TRIANGLES][3], local[POINTS], nforeign = 0, nnew = 0;
		struct acut_mesh_block b = {.index = from, .first = next, .box = {(int64_t)from, 0, 1, 1}, .ntriangle = n};

		for (unsigned pass = 0; pass < 2; pass++) /* foreign ones first */
			for (unsigned i = 0; i < mesh.w * mesh.h; i++) {
				bool used = false, old = number[i] < b.first;

				for (unsigned t = from; t < from + n; t++)
					used |= mesh.triangle[t][0] == i || mesh.triangle[t][1] == i || mesh.triangle[t][2] == i;
				if (!used || old == (pass == 1))
					continue;
				local[i] = old ? nforeign : nforeign + nnew;
				if (old) {
					foreign[nforeign++] = number[i];
				} else {
					memcpy(vertex[nnew++], mesh.at[i], 12);
					number[i] = next++;
				}
			}
		for (unsigned t = 0; t < n; t++)
			for (unsigned j = 0; j < 3; j++)
				triangle[t][j] = local[mesh.triangle[from + t][j]];
		b.nforeign = nforeign;
		b.nnew = nnew;
		b.foreign = foreign;
		b.vertex = (const int32_t(*)[3])vertex;
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
			same &= !memcmp(got.at[i][j], mesh.at[t[j]], 12);
		found += same;
	}
	assert_true(found < 2);
	return found;
}

static uint64_t trimmed, stayed, inside;

static void one_case(uint64_t seed)
{
	struct outputs_options opt = {.trim_hull = {.given = true}, .edges = true};
	const struct format_options none = {0};
	struct outputs_report report;
	struct outputs *run;
	struct acut_mesh_sink sink;
	struct err err = ERR_INIT;
	unsigned left = 0;
	char hex[DIGEST_HEX_SIZE];
	int64_t limit;

	make(&seed);
	limit = 1 + (int64_t)random_below(&seed, 45);
	opt.trim_hull.value = (struct decimal){limit, -1};
	flood(limit * limit);
	assert_int_equal(outputs_new(&opt, &run, &err), 0);
	assert_int_equal(outputs_add(run, NULL, &format_got, &none, &err), 0);
	sink = outputs_sink(run);
	assert_int_equal(send(&sink, &seed), 0);
	for (unsigned t = 0; t < mesh.n; t++) {
		bool is_long = false;

		for (unsigned j = 0; j < 3; j++)
			is_long |= square(mesh.triangle[t][j], mesh.triangle[t][(j + 1) % 3]) > limit * limit;
		assert_int_equal(is_got(mesh.triangle[t]), !mesh.gone[t]);
		left += mesh.gone[t];
		inside += is_long && !mesh.gone[t];
	}
	assert_int_equal(got.n, mesh.n - left);
	assert_int_equal(got.triangles, got.n);
	assert_string_equal(got.digest, digest_hex(digest_of(true), hex));
	outputs_report(run, &report);
	assert_int_equal(report.left_out, left);
	assert_string_equal(report.written, hex);
	trimmed += left;
	stayed += got.n;
	outputs_free(run);
}

static void test_random(void **state)
{
	uint64_t n = repeat_cases(5000), first = repeat_first();

	for (uint64_t i = 0; i < n; i++)
		one_case((first + i) * UINT64_C(0x2545f4914f6cdd1d));
	print_message("%llu meshes: %llu triangles trimmed, %llu stayed, %llu of these with a long edge\n", (unsigned long long)n,
		      (unsigned long long)trimmed, (unsigned long long)stayed, (unsigned long long)inside);
	assert_true(trimmed && stayed && inside);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_random)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
