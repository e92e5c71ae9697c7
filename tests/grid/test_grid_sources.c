/* Files of sources: chains of generations against a model, damage, forged bytes, failing calls, memory. */
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <xxhash.h>

#include "grid_fixture.h"
#include "io.h"
#include "ledger.h"

/* ---- a dataset of sources, in memory ---- */

enum { MOST = 6000, TEXT = 24 };
static struct {
	struct grid_source source[MOST];
	struct grid_span span[MOST][2];
	char name[MOST + 1][TEXT], path[MOST + 1][TEXT];
	size_t n;
	uint32_t last;
	uint64_t generation;
} model;

static const struct grid_lines some_lines = {{1, 0, 0, 0}, 1, 2, 8192, 0, {8, 9}};

static void model_add(size_t n, bool lines)
{
	for (; n && model.n < MOST && model.last < MOST; n--) {
		uint32_t id = ++model.last;
		struct grid_source *s = &model.source[model.n++];

		snprintf(model.name[id], TEXT, "tile %u.laz", id);
		snprintf(model.path[id], TEXT, "/survey/%u.laz", id);
		*s = (struct grid_source){.id = id,
					  .added = model.generation,
					  .points = lines ? 0 : id * 3,
					  .name = model.name[id],
					  .path = model.path[id],
					  .size = id * UINT64_C(1000),
					  .mtime_ns = -(int64_t)id,
					  .hash = {id, ~(uint64_t)id},
					  .overridden = id % 7 ? "" : "EPSG:4978",
					  .left_out = id % 5,
					  .reading = id % 3 ? "las" : "",
					  .kind = lines ? GRID_LINES : GRID_POINTS,
					  .lines = lines ? &some_lines : NULL};
	}
}

/* What a push, a replacement, a revert or a prune does. */
static void model_step(uint64_t *rng)
{
	uint64_t what = random_below(rng, 10);
	size_t n = 0;

	model.generation++;
	if (what < 6)
		model_add(1 + random_below(rng, what < 3 ? 8 : 300), false);
	else if (what == 6)
		model_add(1, true);
	for (size_t k = random_below(rng, 30); what == 7 && k; k--)
		model.source[random_below(rng, model.n)].removed = model.generation;
	for (size_t i = 0; what == 8 && i < model.n; i++) {
		struct grid_source *s = &model.source[i];
		struct err err = ERR_INIT;

		if (s->removed && s->removed > s->added && s->nearlier < 2 && random_below(rng, 2))
			CHECK(grid_source_restore(s, model.generation, model.span[s->id - 1], &err));
	}
	for (size_t i = 0; what == 9 && i < model.n; i++)
		if (!model.source[i].removed || i % 2 || model.source[i].id == model.last)
			model.source[n++] = model.source[i];
	model.n = what == 9 ? n : model.n;
}

static void assert_model(const struct grid_manifest *m)
{
	assert_int_equal(m->nsources, model.n);
	assert_int_equal(grid_manifest_all(m), model.n);
	for (size_t i = 0; i < model.n; i++) {
		const struct grid_source *s = &model.source[i], *t = &m->sources[i];

		assert_true(s->id == t->id && s->added == t->added && s->removed == t->removed && s->points == t->points);
		assert_string_equal(s->name, t->name);
		assert_string_equal(s->path, t->path);
		assert_string_equal(s->overridden, t->overridden);
		assert_string_equal(s->reading, t->reading);
		assert_true(s->size == t->size && s->mtime_ns == t->mtime_ns && s->left_out == t->left_out);
		assert_true(digest_equal(s->hash, t->hash) && s->kind == t->kind && s->nearlier == t->nearlier);
		for (size_t k = 0; k < s->nearlier; k++)
			assert_memory_equal(&s->earlier[k], &t->earlier[k], sizeof *s->earlier);
	}
}

/* As the model, on top of what was read; `base` NULL: nothing. */
static struct grid_manifest next_of(const struct grid_manifest *base)
{
	struct grid_manifest m = manifest_of(NULL, 0, 0);
	uint64_t file[MOST + 1] = {0};

	free(m.sources);
	for (size_t i = 0; base && i < base->nsources; i++)
		file[base->sources[i].id] = base->sources[i].file;
	for (size_t i = 0; i < model.n; i++)
		model.source[i].file = file[model.source[i].id];
	m.generation = model.generation;
	m.sources = model.source;
	m.nsources = model.n;
	m.files = base ? base->files : NULL;
	m.nfiles = base ? base->nfiles : 0;
	return m;
}

static void model_start(size_t sources)
{
	memset(&model, 0, sizeof model);
	model.generation = 1;
	model_add(sources, false);
}

static int write_next(const struct folder *f, const struct grid_manifest *base, const char *sources, struct grid_apart *a,
		      struct err *err)
{
	struct grid_manifest m = next_of(base);

	*a = (struct grid_apart){.name = sources};
	return grid_manifest_write_apart(f->fd, "m", a, &m, err);
}

/* ---- chains ---- */

static bool names(const struct grid_manifest *m, const char *file)
{
	for (size_t i = 0; i < m->nfiles; i++)
		if (!strcmp(m->files[i].name, file))
			return true;
	return false;
}

/* Each file is more than twice as large as the next smaller one, but for those that a prune made smaller. */
static void assert_few(const struct grid_manifest *m)
{
	size_t n = model.n, most = 2;

	for (; n; n /= 2)
		most++;
	assert_true(m->nfiles <= most);
}

/* What has just been written is the model; old files go. */
static struct grid_manifest *read_next(const struct folder *f, struct grid_manifest *base, const struct grid_apart *a)
{
	struct grid_manifest *m, *bare;
	struct err err = ERR_INIT;
	size_t apart = 0;

	CHECK(grid_manifest_read(f->fd, "m", &m, &err));
	assert_model(m);
	assert_few(m);
	CHECK(grid_manifest_load_bare(f->fd, "m", NULL, &bare, &err));
	assert_true(bare->nfiles == m->nfiles && bare->nall == model.n && bare->bare == (m->nfiles > 0));
	for (size_t i = 0; i < m->nfiles; i++)
		apart += m->files[i].n;
	assert_int_equal(bare->nsources, model.n - apart);
	for (size_t i = 0; i < bare->nsources; i++)
		assert_int_equal(bare->sources[i].file, 0);
	CHECK(grid_manifest_complete(f->fd, bare, &err));
	assert_model(bare);
	grid_manifest_free(bare);
	assert_int_equal(a->made, names(m, a->name));
	for (unsigned i = 0; i < a->ndropped; i++) {
		assert_true(names(base, a->dropped[i]) && !names(m, a->dropped[i]));
		assert_int_equal(unlinkat(f->fd, a->dropped[i], 0), 0);
	}
	assert_int_equal(folder_files(f, ""), 1 + m->nfiles);
	grid_manifest_free(base);
	return m;
}

static void test_chains(void **state)
{
	unsigned files = 0;

	for (uint64_t seed = 1; seed <= 6; seed++) {
		struct folder f = folder_new();
		struct grid_manifest *m = NULL;
		struct err err = ERR_INIT;
		struct grid_apart a;
		uint64_t rng = seed;
		char name[32];

		model_start(seed * 50);
		grid_sources_here = seed % 3 ? 128 : 0;
		for (int i = 0; i < 60; i++) {
			snprintf(name, sizeof name, "sources-%d", i);
			CHECK(write_next(&f, m, name, &a, &err));
			m = read_next(&f, m, &a);
			files = m->nfiles > files ? (unsigned)m->nfiles : files;
			assert_true(m->nfiles || model.n <= 128 + 60);
			model_step(&rng);
		}
		grid_manifest_free(m);
		folder_remove(&f);
	}
	grid_sources_here = 128;
	assert_true(files >= 3);
}

/* A push of few files onto many writes few bytes. */
static void test_few_bytes(void **state)
{
	struct folder f = folder_new();
	struct grid_manifest *m = NULL;
	struct err err = ERR_INIT;
	uint64_t written = 0;
	struct grid_apart a;
	char name[32];

	model_start(5000);
	CHECK(write_next(&f, NULL, "sources-1", &a, &err));
	m = read_next(&f, NULL, &a);
	for (int i = 2; i < 92; i++) {
		model.generation++;
		model_add(10, false);
		snprintf(name, sizeof name, "sources-%d", i);
		CHECK(write_next(&f, m, name, &a, &err));
		m = read_next(&f, m, &a);
		for (size_t k = 0; a.made && k < m->nfiles; k++)
			written += !strcmp(m->files[k].name, name) ? m->files[k].bytes : 0;
		assert_true(names(m, "sources-1"));
		assert_int_equal(a.made, i == 14 || (i > 14 && a.made)); /* 128 wait in the manifest */
	}
	assert_true(written && written < m->files[0].bytes); /* 900 sources, each of them at most a few times */
	grid_manifest_free(m);
	folder_remove(&f);
}

/* Who changes a source in a file says so; a manifest by itself needs no file. */
static void test_changed(void **state)
{
	struct folder f = folder_new();
	struct grid_manifest *m, *back, next;
	struct err err = ERR_INIT;
	struct grid_apart a;

	model_start(500);
	CHECK(write_next(&f, NULL, "sources-1", &a, &err));
	m = read_next(&f, NULL, &a);
	model.source[7].points = 0;
	next = next_of(m);
	model.source[7].file = 0;
	a = (struct grid_apart){.name = "sources-2"};
	CHECK(grid_manifest_write_apart(f.fd, "m", &a, &next, &err));
	assert_true(a.made && a.ndropped == 1);
	m = read_next(&f, m, &a);
	CHECK(grid_manifest_write(f.fd, "alone", m, &err));
	assert_int_equal(unlinkat(f.fd, "sources-2", 0), 0);
	CHECK(grid_manifest_read(f.fd, "alone", &back, &err));
	assert_model(back);
	assert_int_equal(back->nfiles, 0);
	grid_manifest_free(back);
	CHECK(grid_manifest_load_bare(f.fd, "m", NULL, &back, &err));
	assert_int_equal(grid_manifest_write(f.fd, "again", back, &err), -ERR_INTERNAL); /* its sources are not known */
	grid_manifest_free(back);
	grid_manifest_free(m);
	folder_remove(&f);
}

/* ---- damage ---- */

struct damaged {
	struct folder f;
	struct set s;
	struct grid_segment_info info;
	uint8_t bytes[1 << 17];
	size_t n;
};

/* A dataset with points and a file of sources. */
static void damaged_start(struct damaged *d)
{
	struct grid_apart a = {.name = "sources-1"};
	struct err err = ERR_INIT;
	struct grid_manifest m;
	int fd;

	d->f = folder_new();
	d->s = set_make(SHAPE_UNIFORM, 3000, 300, 5);
	CHECK(stage_set(&d->f, "a", &d->s, 0, &d->info, &err));
	set_sort(&d->s);
	model_start(300);
	m = next_of(NULL);
	m.segments = &d->info;
	m.nsegments = 1;
	CHECK(grid_manifest_write_apart(d->f.fd, "m", &a, &m, &err));
	assert_true(a.made);
	fd = openat(d->f.fd, "sources-1", O_RDONLY);
	d->n = (size_t)read(fd, d->bytes, sizeof d->bytes);
	assert_true(d->n > 1000 && d->n < sizeof d->bytes);
	close(fd);
}

static void put_file(const struct damaged *d, const char *name, const void *bytes, size_t n)
{
	int fd = openat(d->f.fd, name, O_WRONLY | O_CREAT | O_TRUNC, 0600);

	assert_int_equal(write(fd, bytes, n), n);
	close(fd);
}

/* Reading all names the file; the points are read as ever. */
static void assert_refused(const struct damaged *d, int code)
{
	struct err err = ERR_INIT;
	struct grid_manifest *m = NULL;
	struct reader r;

	assert_int_equal(grid_manifest_read(d->f.fd, "m", &m, &err), -code);
	assert_string_equal(err.file, "sources-1");
	CHECK(grid_manifest_load_bare(d->f.fd, "m", NULL, &m, (err_clear(&err), &err)));
	assert_int_equal(grid_sources_verify(d->f.fd, m, 0, &err), -code);
	grid_manifest_free(m);
	r = reader_open(&d->f, "m", 1, 1 << 20);
	reader_check(&r, &d->s, 0, UINT64_MAX, true);
	reader_close(&r);
}

static void test_damage(void **state)
{
	struct damaged d;
	struct grid_manifest *m;
	struct err err = ERR_INIT;
	uint64_t rng = 1, check;
	uint32_t version = 2;

	damaged_start(&d);
	for (int i = 0; i < 60; i++) {
		size_t at = i < 24 ? (size_t)i : random_below(&rng, d.n);

		d.bytes[at] ^= 1 << i % 8;
		put_file(&d, "sources-1", d.bytes, d.n);
		assert_refused(&d, ERR_CORRUPT);
		d.bytes[at] ^= 1 << i % 8;
	}
	put_file(&d, "sources-1", d.bytes, d.n - 1);
	assert_refused(&d, ERR_CORRUPT);
	put_file(&d, "sources-1", d.bytes, 0);
	assert_refused(&d, ERR_CORRUPT);
	assert_int_equal(unlinkat(d.f.fd, "sources-1", 0), 0);
	assert_refused(&d, ERR_CORRUPT);
	/* another one, which is whole */
	memcpy(d.bytes + 28, &rng, sizeof rng);
	check = XXH3_64bits(d.bytes, d.n - 8);
	put_file(&d, "sources-1", memcpy(d.bytes + d.n - 8, &check, sizeof check) ? d.bytes : NULL, d.n);
	assert_refused(&d, ERR_CORRUPT);
	memcpy(d.bytes + 8, &version, sizeof version);
	check = XXH3_64bits(d.bytes, d.n - 8);
	put_file(&d, "sources-1", memcpy(d.bytes + d.n - 8, &check, sizeof check) ? d.bytes : NULL, d.n);
	assert_refused(&d, ERR_VERSION);
	assert_int_equal(grid_manifest_read(d.f.fd, "m", &m, &err), -ERR_VERSION);
	assert_non_null(strstr(err.message, "version 2"));
	set_free(&d.s);
	folder_remove(&d.f);
}

/* Puts the check of the file of sources right, there and in the manifest. */
static void forge(const struct damaged *d, uint8_t *sources, size_t n, const uint8_t *manifest, size_t size, size_t place)
{
	static uint8_t copy[1 << 16];
	uint64_t check = XXH3_64bits(sources, n - 8);

	memcpy(sources + n - 8, &check, sizeof check);
	memcpy(copy, manifest, size);
	memcpy(copy + place, &check, sizeof check);
	check = XXH3_64bits(copy, size - 8);
	memcpy(copy + size - 8, &check, sizeof check);
	put_file(d, "sources-1", sources, n);
	put_file(d, "m", copy, size);
}

/* Bytes that agree with their checksums: refused, or all is as the manifest says. */
static void test_rubbish(void **state)
{
	static uint8_t manifest[1 << 16], changed[1 << 17];
	static struct damaged d;
	uint64_t rng = 2, check;
	size_t size, place, good = 0, bad = 0;
	int fd;

	damaged_start(&d);
	fd = openat(d.f.fd, "m", O_RDONLY);
	size = (size_t)read(fd, manifest, sizeof manifest);
	close(fd);
	memcpy(&check, d.bytes + d.n - 8, sizeof check);
	place = (size_t)((uint8_t *)memmem(manifest, size, &check, sizeof check) - manifest);
	for (int i = 0; i < 4000; i++) {
		struct grid_manifest *m = NULL;
		struct err err = ERR_INIT;

		memcpy(changed, d.bytes, d.n);
		for (uint64_t k = 1 + random_below(&rng, 2); k; k--) {
			/* often near the number of a source, or a length */
			size_t at = 24 + random_below(&rng, random_below(&rng, 2) ? 120 : d.n - 32);

			changed[at] = (uint8_t)(random_below(&rng, 2) ? random_next(&rng) : changed[at] + 1u);
		}
		forge(&d, changed, d.n, manifest, size, place);
		if (grid_manifest_read(d.f.fd, "m", &m, &err)) {
			assert_int_equal(err.code, ERR_CORRUPT);
			assert_string_equal(err.file, "sources-1");
			bad++;
			continue;
		}
		for (size_t k = 0; k < m->nsources; k++)
			assert_true(m->sources[k].id == k + 1 && m->sources[k].added == 1 && m->sources[k].kind == GRID_POINTS);
		good++;
		grid_manifest_free(m);
	}
	assert_true(good > 100 && bad > 100);
	set_free(&d.s);
	folder_remove(&d.f);
}

/* A file with a source that is not one of its own. */
static void test_foreign(void **state)
{
	static uint8_t bytes[1 << 17], manifest[1 << 16], copy[1 << 17];
	static const uint32_t foreign[] = {300, 441, 442}; /* another file's, the manifest's, nobody's */
	struct damaged d = {.f = folder_new()};
	struct grid_manifest *m;
	struct err err = ERR_INIT;
	struct grid_apart a;
	uint64_t check;
	size_t size, place, n;
	int fd;

	model_start(300);
	CHECK(write_next(&d.f, NULL, "sources-0", &a, &err));
	m = read_next(&d.f, NULL, &a);
	model_add(140, false);
	CHECK(write_next(&d.f, m, "sources-1", &a, &err));
	m = read_next(&d.f, m, &a);
	model_add(1, false);
	CHECK(write_next(&d.f, m, "sources-2", &a, &err));
	assert_true(!a.made && m->nfiles == 2);
	grid_manifest_free(m);
	fd = openat(d.f.fd, "m", O_RDONLY);
	size = (size_t)read(fd, manifest, sizeof manifest);
	close(fd);
	fd = openat(d.f.fd, "sources-1", O_RDONLY);
	n = (size_t)read(fd, bytes, sizeof bytes);
	close(fd);
	memcpy(&check, bytes + n - 8, sizeof check);
	place = (size_t)((uint8_t *)memmem(manifest, size, &check, sizeof check) - manifest);
	for (int i = -1; i < 3; i++) {
		/* the first or the last, as they are ascending */
		size_t at = i < 1 ? 24 : (size_t)((uint8_t *)memmem(bytes, n, &(uint32_t){440}, 4) - bytes);

		memcpy(copy, bytes, n);
		if (i >= 0)
			memcpy(copy + at, &foreign[i], sizeof foreign[i]);
		forge(&d, copy, n, manifest, size, place);
		err_clear(&err);
		if (i < 0) {
			CHECK(grid_manifest_read(d.f.fd, "m", &m, &err));
			grid_manifest_free(m);
			continue;
		}
		assert_int_equal(grid_manifest_read(d.f.fd, "m", &m, &err), -ERR_CORRUPT);
		assert_string_equal(err.file, "sources-1");
	}
	folder_remove(&d.f);
}

/* ---- calls and memory ---- */

static struct io_table table;
static unsigned long calls, fail_at;

static bool fails(void)
{
	errno = EIO;
	return ++calls == fail_at;
}

static int bad_fsync(int fd)
{
	return fails() ? -1 : 0;
}

static ssize_t bad_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	return fails() ? -1 : io_system.pwrite(fd, buf, n, off);
}

static int bad_renameat(int fd, const char *from, int tofd, const char *to)
{
	return fails() ? -1 : io_system.renameat(fd, from, tofd, to);
}

static ssize_t bad_pread(int fd, void *buf, size_t n, off_t off)
{
	return fails() ? -1 : io_system.pread(fd, buf, n, off);
}

/* A write that fails leaves no file; one that was read before is still whole. */
static void test_failing_calls(void **state)
{
	const struct io_table *before = io;
	struct folder f = folder_new();
	struct grid_manifest *m, *back = NULL;
	struct err err = ERR_INIT;
	struct grid_apart a;
	unsigned failed = 0, read_failed = 0;

	model_start(200);
	CHECK(write_next(&f, NULL, "sources-1", &a, &err));
	m = read_next(&f, NULL, &a);
	model_add(180, false);
	table = *io;
	table.fsync = bad_fsync;
	table.pwrite = bad_pwrite;
	table.renameat = bad_renameat;
	table.pread = bad_pread;
	io = &table;
	for (fail_at = 1;; fail_at++) {
		struct grid_manifest next = next_of(m);

		calls = 0;
		a = (struct grid_apart){.name = "sources-2"};
		if (!grid_manifest_write_apart(f.fd, "next", &a, &next, (err_clear(&err), &err)))
			break;
		failed++;
		assert_true(!a.made && err.code == ERR_IO);
		assert_int_equal(folder_files(&f, ""), 2);
	}
	assert_true(failed >= 6 && a.made);
	for (fail_at = 1;; fail_at++) {
		calls = 0;
		if (!grid_manifest_read(f.fd, "next", &back, (err_clear(&err), &err)))
			break;
		read_failed++;
	}
	io = before;
	assert_true(read_failed >= 2);
	assert_model(back);
	grid_manifest_free(back);
	grid_manifest_free(m);
	folder_remove(&f);
}

static void test_memory(void **state)
{
	enum { ALL = 4 << 20 };
	struct folder f = folder_new();
	struct ledger *ledger = ledger_new(ALL);
	struct grid_manifest *m;
	struct err err = ERR_INIT;
	struct grid_apart a;
	uint64_t bare;

	model_start(3000);
	CHECK(write_next(&f, NULL, "sources-1", &a, &err));
	CHECK(grid_manifest_load_bare(f.fd, "m", ledger, &m, &err));
	bare = ledger_held(ledger, LEDGER_MANIFEST);
	assert_true(bare == m->charged && bare < 4000); /* whatever the number of sources */
	CHECK(grid_manifest_complete(f.fd, m, &err));
	assert_int_equal(ledger_held(ledger, LEDGER_MANIFEST), m->charged);
	assert_true(m->charged >= 3000 * sizeof *m->sources + m->files[0].bytes && m->charged < ALL / 2);
	assert_true(ledger_peak(ledger, LEDGER_MANIFEST) >= m->charged + m->files[0].bytes);
	grid_manifest_free(m);
	assert_true(ledger_left(ledger) == ALL);
	assert_true(ledger_take(ledger, LEDGER_STAGE, ALL - 100000));
	assert_int_equal(grid_manifest_load(f.fd, "m", ledger, &m, &err), -ERR_BUSY);
	CHECK(grid_manifest_load_bare(f.fd, "m", ledger, &m, (err_clear(&err), &err)));
	grid_manifest_free(m);
	ledger_give(ledger, LEDGER_STAGE, ALL - 100000);
	assert_true(ledger_left(ledger) == ALL);
	ledger_free(ledger);
	folder_remove(&f);
}

/* With the bare manifest it takes more than half of the memory, without it less: no waiting helps. */
static void test_never_fits(void **state)
{
	struct folder f = folder_new();
	struct ledger *ledger = ledger_new(1 << 24);
	struct grid_manifest *m;
	struct err err = ERR_INIT;
	struct grid_apart a;
	uint64_t bare, more, all, held;

	model_start(3000);
	for (size_t i = 1; i < model.n; i += 2)
		model.source[i].removed = 1; /* as many batches as sources */
	CHECK(write_next(&f, NULL, "sources-1", &a, &err));
	CHECK(grid_manifest_load_bare(f.fd, "m", ledger, &m, &err));
	bare = m->charged;
	held = ledger_peak(ledger, LEDGER_MANIFEST);
	CHECK(grid_manifest_complete(f.fd, m, &err));
	more = ledger_peak(ledger, LEDGER_MANIFEST) - bare;
	assert_true(bare > 100000 && more > bare);
	grid_manifest_free(m);
	ledger_free(ledger);
	all = 2 * more + bare;
	ledger = ledger_new(all);
	assert_true(ledger_take(ledger, LEDGER_STAGE, all - held));
	CHECK(grid_manifest_load_bare(f.fd, "m", ledger, &m, &err));
	assert_int_equal(grid_manifest_complete(f.fd, m, &err), -ERR_LIMIT);
	assert_true(m->bare && m->nsources == 0 && m->charged == bare);
	grid_manifest_free(m);
	ledger_give(ledger, LEDGER_STAGE, all - held);
	CHECK(grid_manifest_load(f.fd, "m", ledger, &m, (err_clear(&err), &err)));
	grid_manifest_free(m);
	ledger_free(ledger);
	folder_remove(&f);
}

/* Sorting the batches takes memory only until the grid is open. */
static void test_open_memory(void **state)
{
	struct folder f = folder_new();
	struct ledger *ledger = ledger_new(1 << 24);
	uint64_t charged[2], peak[2];

	for (int i = 0; i < 2; i++) {
		struct err err = ERR_INIT;
		struct grid_apart a;
		struct grid *g;

		model_start(3000);
		for (size_t k = 1; i && k < model.n; k += 2)
			model.source[k].removed = 1;
		CHECK(write_next(&f, NULL, "sources-1", &a, &err));
		CHECK(grid_open(f.fd, "m", GRID_NEWEST, ledger, 1 << 20, &g, &err));
		charged[i] = grid_charged(g);
		peak[i] = ledger_peak(ledger, LEDGER_INDEX);
		assert_int_equal(ledger_held(ledger, LEDGER_INDEX), charged[i]);
		grid_close(g);
		assert_true(ledger_left(ledger) == 1 << 24);
	}
	assert_true(peak[1] - peak[0] >= 2999 * 2 * sizeof(struct grid_batch));
	assert_true(charged[1] - charged[0] < 2999 * sizeof(struct grid_batch));
	ledger_free(ledger);
	folder_remove(&f);
}

static size_t largest;

static ssize_t large_pread(int fd, void *buf, size_t n, off_t off)
{
	largest = n > largest ? n : largest;
	return io_system.pread(fd, buf, n, off);
}

static ssize_t large_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	largest = n > largest ? n : largest;
	return io_system.pwrite(fd, buf, n, off);
}

/* Writing and verifying a file take the memory of a piece. */
static void test_pieces(void **state)
{
	const struct io_table *before = io;
	struct folder f = folder_new();
	struct grid_manifest *m;
	struct err err = ERR_INIT;
	struct grid_apart a;

	model_start(5000);
	table = *io;
	table.pread = large_pread;
	table.pwrite = large_pwrite;
	io = &table;
	CHECK(write_next(&f, NULL, "sources-1", &a, &err));
	CHECK(grid_manifest_load_bare(f.fd, "m", NULL, &m, &err));
	assert_true(m->files[0].bytes > 300000);
	CHECK(grid_sources_verify(f.fd, m, 0, &err));
	assert_true(largest && largest <= 64 << 10);
	io = before;
	grid_manifest_free(m);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_chains),      cmocka_unit_test(test_few_bytes), cmocka_unit_test(test_changed),
		cmocka_unit_test(test_damage),      cmocka_unit_test(test_rubbish),   cmocka_unit_test(test_failing_calls),
		cmocka_unit_test(test_memory),      cmocka_unit_test(test_foreign),   cmocka_unit_test(test_never_fits),
		cmocka_unit_test(test_open_memory), cmocka_unit_test(test_pieces),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid: files of sources", tests, NULL, NULL);
}
