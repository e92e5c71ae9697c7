/*
 * Damage: what a store holds is changed, and nothing wrong may come out of it. A bit is flipped, a file is cut short, a
 * sector is lost (zeros), two sectors are exchanged, a sector is what it was one version ago. Every file of the store in
 * turn, at random places. Two ways to look:
 *   - the readers of the rooms, thousands of times: manifests and segments (all points of all cells), stored domains, plan
 *     files: what is read is what was written, or an error is raised;
 *   - a service over the damaged store: its answers are right, or errors.
 * Data that is not served is not a failure; a crash or a wrong mesh is.
 *
 * ACUT_FAULT_FLIPS: how many for the readers (10000), a twentieth of it for houses; ACUT_FAULT_SEED.
 */
#include "scene.h"

#include <xxhash.h>

#include "grid.h"

static struct scene_digests want;
static uint64_t rng;

static uint64_t draw(uint64_t below)
{
	rng ^= rng << 13;
	rng ^= rng >> 7;
	rng ^= rng << 17;
	return below ? rng % below : 0;
}

/* ---- the files of the store ---- */

struct victim {
	char path[160];
	uint8_t *data, *old; /* as it is; as it was one version ago, or NULL */
	size_t size, old_size;
	char manifest[64]; /* of a segment: the one that names it */
};

static struct victim victims[256];
static unsigned nvictims;

static uint8_t *take(const char *path, size_t *ret_size)
{
	int fd = open(path, O_RDONLY | O_CLOEXEC);
	struct stat st;
	uint8_t *data;

	if (fd < 0 || fstat(fd, &st))
		abort();
	*ret_size = (size_t)st.st_size;
	data = malloc(*ret_size + 1);
	if (pread(fd, data, *ret_size, 0) != (ssize_t)*ret_size)
		abort();
	close(fd);
	return data;
}

static void put(const char *path, const uint8_t *data, size_t size)
{
	int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);

	if (fd < 0 || write(fd, data, size) != (ssize_t)size)
		abort();
	close(fd);
}

static int collect(const char *path, const struct stat *st, int kind, struct FTW *ftw)
{
	struct victim *v = &victims[nvictims];
	const char *name = path + ftw->base;

	if (kind != FTW_F || !st->st_size || !strcmp(name, "lock") || nvictims == sizeof victims / sizeof *victims)
		return 0;
	snprintf(v->path, sizeof v->path, "%s", path + strlen(h.folder) + 1);
	v->data = take(path, &v->size);
	nvictims++;
	return 0;
}

/* Finds for each victim another file of the same kind, as a source of old blocks. */
static void find_old(void)
{
	for (unsigned i = 0; i < nvictims; i++)
		for (unsigned k = 0; k < nvictims; k++) {
			struct victim *a = &victims[i], *b = &victims[k];
			const char *x = strrchr(a->path, '/'), *y = strrchr(b->path, '/');

			if (i != k && x && y && !strncmp(x, y, 6) && b->size >= 512) {
				a->old = b->data;
				a->old_size = b->size;
			}
		}
}

static const char *const kinds[] = {"bit", "byte", "cut", "zeros", "exchange", "old"};

/* True if the file is another one now. */
static bool damage(const struct victim *v, uint8_t *data, size_t *size, const char **ret_kind)
{
	size_t at = draw(v->size), sector = at / 512 * 512, n = v->size - sector < 512 ? v->size - sector : 512, other;
	unsigned kind = (unsigned)draw(10);

	memcpy(data, v->data, v->size);
	*size = v->size;
	kind = kind > 5 ? 0 : kind;
	*ret_kind = kinds[kind];
	switch (kind) {
	case 0:
		data[at] ^= (uint8_t)(1u << draw(8));
		break;
	case 1:
		data[at] = (uint8_t)draw(256);
		break;
	case 2:
		*size = at;
		return true;
	case 3:
		memset(data + sector, 0, n);
		break;
	case 4:
		other = draw(v->size) / 512 * 512;
		if (v->size - other < 512)
			return false;
		memcpy(data + sector, v->data + other, n);
		memcpy(data + other, v->data + sector, n);
		break;
	default:
		if (!v->old || sector + n > v->old_size)
			return false;
		memcpy(data + sector, v->old + sector, n);
	}
	return memcmp(data, v->data, v->size) != 0;
}

/* ---- the readers ---- */

static XXH3_state_t *hash;

static int sum_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	*(uint64_t *)ctx += n;
	XXH3_64bits_update(hash, pts, n * sizeof *pts);
	return 0;
}

/* All points of the newest generation, as a hash; false: an error was raised. */
static bool read_all(int dirfd, const char *manifest, uint64_t *ret)
{
	struct grid_manifest *m = NULL;
	struct grid *g = NULL;
	struct grid_reader *r = NULL;
	struct err err = ERR_INIT;
	void *memory = NULL;
	uint64_t n = 0;
	int rc = grid_manifest_read(dirfd, manifest, &m, &err);

	XXH3_64bits_reset(hash);
	if (!rc) {
		/* What of it is used: texts and numbers too. */
		XXH3_64bits_update(hash, &m->lattice, sizeof m->lattice);
		XXH3_64bits_update(hash, &m->generation, sizeof m->generation);
		XXH3_64bits_update(hash, &m->nsources, sizeof m->nsources);
		XXH3_64bits_update(hash, m->crs, strlen(m->crs));
		rc = grid_open(dirfd, manifest, m->generation, NULL, 0, &g, &err);
	}
	if (!rc) {
		memory = malloc(grid_reader_bytes(g));
		rc = grid_reader_new(g, memory, grid_reader_bytes(g), &r, &err);
	}
	if (!rc)
		rc = grid_scan(r, 0, UINT64_MAX, sum_points, &n, &err);
	if (rc && !*err.message)
		abort();
	grid_close(g);
	grid_manifest_free(m);
	free(memory);
	XXH3_64bits_update(hash, &n, sizeof n);
	*ret = XXH3_64bits_digest(hash);
	return !rc;
}

static unsigned long flips, undetected, harmless, errors;

static void flip_grid(const struct victim *v, int dirfd, const char *manifest, uint64_t right, uint8_t *data, unsigned long n)
{
	char path[320];
	uint64_t got_hash;
	const char *kind;
	size_t size;

	snprintf(path, sizeof path, "%s/%s", h.folder, v->path);
	for (unsigned long i = 0; i < n; i++) {
		if (!damage(v, data, &size, &kind))
			continue;
		put(path, data, size);
		flips++;
		if (!read_all(dirfd, manifest, &got_hash)) {
			errors++;
		} else if (got_hash == right) {
			harmless++;
		} else {
			undetected++;
			printf("%s, %s: read as something else\n", v->path, kind);
		}
	}
	put(path, v->data, v->size);
}

static void flip_datasets(unsigned long n)
{
	char path[320], manifest[256];
	unsigned mine = 0;

	for (unsigned i = 0; i < nvictims; i++)
		mine += !strncmp(victims[i].path, "datasets/1/", 11);
	for (unsigned i = 0; mine && i < nvictims; i++) {
		const struct victim *v = &victims[i];
		uint8_t *data;
		uint64_t right;
		int dirfd;

		if (strncmp(v->path, "datasets/1/", 11))
			continue;
		snprintf(path, sizeof path, "%s/datasets/1", h.folder);
		dirfd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
		*manifest = 0;
		for (unsigned k = 0; k < nvictims; k++)
			if (!strncmp(victims[k].path, "datasets/1/manifest-", 20))
				snprintf(manifest, sizeof manifest, "%.200s", victims[k].path + 11);
		must(*manifest && read_all(dirfd, manifest, &right));
		data = malloc(v->size + 512);
		flip_grid(v, dirfd, manifest, right, data, n / mine);
		free(data);
		close(dirfd);
	}
}

/* ---- houses ---- */

/* ACUT_FAULT_ONLY: those alone whose name has that in it. Else every fourth is the catalogue. */
static const struct victim *victim_of(unsigned long i)
{
	const char *only = getenv("ACUT_FAULT_ONLY");
	unsigned k = (unsigned)(i % nvictims);

	if (!only && i % 4 == 0)
		only = "catalogue.db";
	for (unsigned tries = 0; only && !strstr(victims[k].path, only) && tries < nvictims; tries++)
		k = (k + 1) % nvictims;
	return &victims[k];
}

/* The same mesh, or an error that says something; a start that refuses is one. */
static void one_house(unsigned long i)
{
	const struct victim *v = victim_of(i);
	uint8_t *data = malloc(v->size + 512);
	const char *kind;
	struct dataset *a;
	char path[320], digest[DIGEST_HEX_SIZE];
	struct err err = ERR_INIT;
	size_t size;
	struct job *job;

	rng = (i + 1) * UINT64_C(0x9e3779b97f4a7c15) + (uint64_t)setting("ACUT_FAULT_SEED", 1);
	for (int k = 0; k < 8; k++)
		draw(2);
	if (!damage(v, data, &size, &kind))
		_exit(0);
	new_folder(i);
	for (unsigned k = 0; k < nvictims; k++) {
		snprintf(path, sizeof path, "%s/%s", h.folder, victims[k].path);
		for (char *at = path + strlen(h.folder) + 1; (at = strchr(at, '/')); at++) {
			*at = 0;
			mkdir(path, 0700);
			*at = '/';
		}
		put(path, &victims[k] == v ? data : victims[k].data, &victims[k] == v ? size : victims[k].size);
	}
	if (service_try_open(SCENE_MEMORY, 2, &err)) {
		must(*err.message);
		_exit(0);
	}
	a = dataset_find(h.service->datasets, "a", &me);
	for (int view = 0; a && view < 4; view++) {
		static struct reader r;
		char hex[DIGEST_HEX_SIZE];

		job = submit_at(a, view == 1, view >= 2 ? OTHER_VIEW : VIEW);
		if (!job) {
			must(*accepted_err.message);
			continue;
		}
		turn_until_final(job);
		if (info_of(job).state != JOB_done) {
			must(*info_of(job).err->message);
			continue;
		}
		snprintf(digest, sizeof digest, "%s", info_of(job).report->digest);
		must(!strcmp(digest, view >= 2 ? want.selected : view == 1 ? want.one : want.all));
		r = (struct reader){.output.calls = &reader_calls};
		job_fetch(job, &r.output);
		turn_until(r.ends);
		must(r.failed || !strcmp(digest_hex(r.totals.digest, hex), digest));
	}
	turn_until(!service_active(h.service));
	close_service();
	drop_folder();
}

static void tell(unsigned long i, int status)
{
	printf("flip %lu of %s: status %x\n", i, victim_of(i)->path, status);
}

int main(void)
{
	unsigned long n = (unsigned long)setting("ACUT_FAULT_FLIPS", 10000), bad;
	double begun = seconds(), then;

	log_init("flips", LOG_LEVEL_ERROR);
	rng = (uint64_t)setting("ACUT_FAULT_SEED", 1) * UINT64_C(0x9e3779b97f4a7c15);
	hash = XXH3_createState();
	scene_begin();
	new_folder(0);
	open_service(SCENE_MEMORY, 2);
	play(&want);
	close_service();
	nftw(h.folder, collect, 16, FTW_PHYS);
	find_old();
	flip_datasets(n);
	then = seconds();
	printf("%lu flips before readers: %lu errors raised, %lu without effect, %lu undetected, %.1f s\n", flips, errors,
	       harmless, undetected, then - begun);
	drop_folder();
	n = n / 20;
	if (!freopen("/dev/null", "w", stderr))
		abort();
	bad = each_apart(n, one_house, tell);
	printf("%lu flips in %u files before houses: %lu undetected, %.1f s\n", n, nvictims, bad, seconds() - then);
	scene_end();
	return undetected || bad || !errors; /* no error: nothing was damaged */
}
