/*
 * Summaries of finished domains that are kept in memory: they say what the file says, without opening it; they do not
 * hide a file that was used, damaged or removed.
 */
#include <sys/stat.h>

#include "io.h"
#include "reuse_fixture.h"

enum { MEMORY_MOST = 64 };

static struct {
	struct pipe_summary summary[MEMORY_MOST];
	size_t n;
	unsigned noted, opened, damaged;
	uint32_t cap;
	bool light, whole; /* not only sums are wanted */
} memory;

static struct pipe_summary *remembered(struct digest base)
{
	for (size_t i = 0; i < memory.n; i++)
		if (digest_equal(memory.summary[i].id.base, base))
			return &memory.summary[i];
	return NULL;
}

static bool recall(void *ctx, struct digest base, struct pipe_summary *ret)
{
	const struct pipe_summary *k = remembered(base);

	(void)ctx;
	if (k)
		*ret = *k;
	return k;
}

static void remember(void *ctx, const struct pipe_summary *k)
{
	struct pipe_summary *at = remembered(k->id.base);

	(void)ctx;
	assert_true(at || memory.n < MEMORY_MOST);
	*(at ? at : &memory.summary[memory.n++]) = *k;
	memory.noted++;
}

static int count_openat(int dirfd, const char *name, int flags, mode_t mode)
{
	memory.opened++;
	return io_system.openat(dirfd, name, flags, mode);
}

static int reuse_recalled(struct generation *g, int store, const struct cut_region *r, struct mesh_domain *ret,
			  struct pipe_stored *ret_stored)
{
	const struct pipe_reuse_params p = {.storefd = store,
					    .grid = g->reader.grid,
					    .view = &view,
					    .key = &g->key,
					    .region = r,
					    .cap = memory.cap,
					    .memory = g->memory,
					    .size = g->budget.domain_bytes,
					    .sums = !memory.whole,
					    .light = memory.light,
					    .recall = recall,
					    .remember = remember,
					    .damaged = &memory.damaged};
	const struct io_table *before = io;
	struct io_table counting = *io;
	struct err err = ERR_INIT;
	size_t held;
	int rc;

	counting.openat = count_openat;
	memory.opened = memory.noted = memory.damaged = 0;
	io = &counting;
	rc = pipe_reuse(&p, ret, ret_stored, &held, &err);
	io = before;
	assert_true(rc >= 0);
	/* Its arrays are in the returned memory. */
	if (!rc && memory.whole && !memory.light)
		assert_ptr_equal((uint8_t *)g->memory + held, ret->final + (((size_t)ret->nvertex + 7) / 8 + 7) / 8 * 8);
	else if (!rc && !memory.whole)
		assert_int_equal(held, 0);
	return rc;
}

static void check_numbers(const struct mesh_domain *a, const struct mesh_domain *b)
{
	assert_true(a->nvertex == b->nvertex && a->nopen == b->nopen && a->ntriangle == b->ntriangle && a->nhull == b->nhull);
	assert_true(digest_equal(a->digest, b->digest) && digest_equal(a->closed_digest, b->closed_digest) &&
		    digest_equal(a->own_digest, b->own_digest));
	assert_memory_equal(a->box, b->box, sizeof a->box);
	assert_memory_equal(&a->counts, &b->counts, sizeof a->counts);
	assert_true(!a->link && !a->vertex && !a->triangle && !a->final);
}

/* As without a summary: the same file, the same numbers. */
static int check_recalled(struct generation *g, int store, const struct cut_region *r)
{
	struct pipe_stored as = {.used_ns = 0}, want = {.used_ns = 0};
	struct mesh_domain d, wanted;
	int got = reuse_recalled(g, store, r, &d, &as);

	assert_int_equal(reuse_sums(g, store, r, g->memory, &wanted, &want), got);
	if (got)
		return got;
	assert_memory_equal(&as, &want, sizeof as);
	check_numbers(&d, &wanted);
	return 0;
}

static void keep_remembered(struct generation *g, int store, const struct cut_region *r)
{
	struct pipe_summary k;
	struct pipe_stored as;
	struct mesh_domain d;
	struct err err = ERR_INIT;

	make(g, r, &d);
	CHECK(pipe_store(store, &g->key, r, &d, g->memory, &as, &k, &err));
	assert_true(digest_equal(k.front.beside.content, g->key.content));
	remember(NULL, &k);
}

/* The summary of what was written is that of what was read. */
static void check_read(struct generation *g, int store, const struct cut_region *r)
{
	struct pipe_summary *at = remembered(pipe_key_of(&g->key, r)), was = *at;
	struct pipe_stored as;
	struct mesh_domain d;

	at->id.base = (struct digest){0, 0};
	assert_int_equal(reuse_recalled(g, store, r, &d, &as), 0);
	assert_true(memory.opened >= 1 && memory.noted == 1);
	at->id.base = was.id.base;
	memory.n--;
	at = &memory.summary[memory.n];
	assert_memory_equal(&at->id, &was.id, sizeof was.id);
	assert_memory_equal(&at->reach, &was.reach, sizeof was.reach);
	assert_int_equal(at->live.n, was.live.n);
	assert_memory_equal(at->live.part, was.live.part, was.live.n * sizeof *was.live.part);
	assert_true(digest_equal(at->front.beside.content, was.front.beside.content) && at->front.payload == was.front.payload &&
		    at->front.bytes == was.front.bytes && at->front.whole == was.front.whole);
	check_numbers(&at->front.domain, &was.front.domain);
}

static int truncateat(const struct folder *store, const char *name)
{
	int fd = openat(store->fd, name, O_RDWR | O_CLOEXEC), r = ftruncate(fd, 200);

	close(fd);
	return r;
}

/* The file was used, damaged, or removed: the summary does not hide it. */
static void check_file(struct generation *g, const struct folder *store, const struct cut_region *r)
{
	struct pipe_summary *k = remembered(pipe_key_of(&g->key, r));
	const struct timespec times[2] = {{1000, 0}, {1000, 5}};
	struct pipe_stored as;
	struct mesh_domain d;
	char name[128];

	name_of(&k->id, name);
	assert_int_equal(check_recalled(g, store->fd, r), 0);
	assert_int_equal(memory.opened, 0);
	assert_int_equal(utimensat(store->fd, name, times, 0), 0);
	assert_int_equal(check_recalled(g, store->fd, r), 0);
	assert_int_equal(memory.opened, 0);
	/* The time of its last use is that of the file, whoever used it. */
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), 0);
	assert_true(memory.opened == 0 && as.used_ns == INT64_C(1000000000005));
	/* Callers that need triangles get them. */
	memory.whole = true;
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), 0);
	assert_true(memory.opened == 1 && d.triangle && d.vertex && d.link);
	memory.light = true;
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), 0);
	assert_true(memory.opened >= 1 && !d.triangle && d.vertex && d.link);
	memory.light = memory.whole = false;
	memory.cap = (uint32_t)(k->front.domain.counts.used + k->front.domain.counts.halo) - 1;
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), PIPE_E_ABSENT);
	memory.cap = CAP;
	/* A truncated file is not the same. */
	assert_int_equal(truncateat(store, name), 0);
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), PIPE_E_ABSENT);
	assert_true(memory.opened >= 1);
	keep_remembered(g, store->fd, r);
	assert_int_equal(check_recalled(g, store->fd, r), 0);
	name_of(&k->id, name); /* it may have another list in this generation */
	assert_int_equal(unlinkat(store->fd, name, 0), 0);
	assert_int_equal(check_recalled(g, store->fd, r), PIPE_E_ABSENT);
	/* If a file is damaged, the summary still has its numbers; reading its triangles finds the damage, and removes it. */
	keep_remembered(g, store->fd, r);
	flip(store, name, 100);
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), 0);
	assert_true(memory.opened == 0 && digest_equal(d.digest, k->front.domain.digest));
	memory.whole = true;
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), PIPE_E_ABSENT);
	assert_int_equal(memory.damaged, 1);
	memory.whole = false;
	assert_int_equal(check_recalled(g, store->fd, r), PIPE_E_ABSENT);
}

/* A push into a corner: most stored domains are found without opening a file, the others as before. */
static void test_remembered(void **state)
{
	struct folder store = folder_new();
	unsigned unread = 0, there = 0, reads = 0;
	struct generation g[2];
	struct cut_plan plan;
	struct set s;

	(void)state;
	memset(&memory, 0, sizeof memory);
	memory.cap = CAP;
	rng = 13;
	s = points_of(8000, 20000);
	g[0] = generation_of(&s, 4, 1 << 3);
	g[1] = generation_of(&s, 4, 0);
	plan = plan_of(&g[0]);
	assert_in_range(plan.n, 8, MEMORY_MOST);
	for (size_t i = 0; i < plan.n; i++) {
		keep_remembered(&g[0], store.fd, &plan.leaf[i].region);
		check_read(&g[0], store.fd, &plan.leaf[i].region);
	}
	for (unsigned round = 0; round < 2; round++)
		for (size_t i = 0; i < plan.n; i++) {
			const struct cut_region *r = &plan.leaf[i].region;
			struct pipe_summary *k = remembered(pipe_key_of(&g[1].key, r));
			int is = check_recalled(&g[1], store.fd, r);

			there += !is;
			unread += !is && !memory.opened;
			reads += round && !is && memory.opened;
			/* What was read is remembered for this generation. */
			assert_int_equal(memory.noted, !is && memory.opened);
			assert_true(!memory.noted || digest_equal(k->front.beside.content, g[1].key.content));
		}
	printf("%u of %zu leaves are there, %u found without a file\n", there / 2, plan.n, unread);
	assert_true(there < 2 * plan.n && unread > there * 3 / 4);
	assert_int_equal(reads, 0);
	for (size_t i = 0; i < plan.n; i++)
		if (!check_recalled(&g[1], store.fd, &plan.leaf[i].region))
			check_file(&g[1], &store, &plan.leaf[i].region);
	cut_plan_done(&plan);
	for (unsigned i = 0; i < 2; i++)
		generation_end(&g[i]);
	folder_remove(&store);
	set_free(&s);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_remembered)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
