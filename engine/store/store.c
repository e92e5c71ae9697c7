/*
 * The store of finished domains.
 *
 * A file is a header of HEADER bytes, the proof (what it was made of, in the words of whoever asks for it), and the
 * domain: links, vertices, triangles, each as they lie in memory (little-endian, FORMAT.md), padded to 8 bytes. Open
 * vertices come first, so that all that goes on without the mesh itself is one read from the start: the front. Header,
 * proof, front and rest have a checksum each. A file appears under its name only whole (rename), in one of 256 folders
 * by the first byte of its base; what does not check is removed and reported as absent, because it can always be made
 * again.
 */
#include "store.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>
#define XXH_STATIC_LINKING_ONLY /* the state on the stack */
#include <xxhash.h>

#include "cursor.h"
#include "err.h"
#include "io.h"

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "stored domains are written as they lie in memory: little-endian only"
#endif
_Static_assert(sizeof(struct mesh_link) == 24 && sizeof(struct mesh_vertex) == 12, "FORMAT.md");

/* NAME: "ab/d-BASE-LIST" */
enum { HEADER = 384, FOLDER = 3, NAME = FOLDER + 2 + 32 + 1 + 32 + 1, TEMP = NAME + 48 };
static const uint32_t MAGIC = 0x4d444341; /* "ACDM" */
static const uint32_t VERSION = 4;

/* Offsets in the domain's bytes, as they lie in the file and in memory. */
struct layout {
	size_t vertex, open_end, triangle, payload, final, total;
};

static size_t padded(size_t n)
{
	return (n + 7) & ~(size_t)7;
}

static struct layout layout_of(const struct mesh_domain *d)
{
	struct layout l = { 0 };

	l.vertex = (size_t)d->nopen * sizeof(struct mesh_link);
	l.open_end = l.vertex + (size_t)d->nopen * sizeof(struct mesh_vertex);
	l.triangle = l.vertex + padded((size_t)d->nvertex * sizeof(struct mesh_vertex));
	l.payload = l.triangle + padded((size_t)d->ntriangle * sizeof(uint32_t[3]));
	l.final = l.payload;
	l.total = l.final + padded(((size_t)d->nvertex + 7) / 8);
	return l;
}

static void name_of(const struct store_id *id, char name[NAME])
{
	char base[DIGEST_HEX_SIZE], list[DIGEST_HEX_SIZE];

	digest_hex(id->base, base);
	snprintf(name, NAME, "%.2s/d-%s-%s", base, base, digest_hex(id->list, list));
}

/* ---- checksums ---- */

struct sums {
	uint64_t proof, open, rest;
};

/* Links and open vertices; closed vertices and triangles. */
static uint64_t open_sum(const struct mesh_domain *d)
{
	XXH3_state_t state;

	XXH3_64bits_reset(&state);
	XXH3_64bits_update(&state, d->link, (size_t)d->nopen * sizeof(struct mesh_link));
	XXH3_64bits_update(&state, d->vertex, (size_t)d->nopen * sizeof(struct mesh_vertex));
	return XXH3_64bits_digest(&state);
}

static uint64_t rest_sum(const struct mesh_domain *d)
{
	XXH3_state_t state;

	XXH3_64bits_reset(&state);
	XXH3_64bits_update(&state, d->vertex + d->nopen, (size_t)(d->nvertex - d->nopen) * sizeof(struct mesh_vertex));
	XXH3_64bits_update(&state, d->triangle, (size_t)d->ntriangle * sizeof(uint32_t[3]));
	return XXH3_64bits_digest(&state);
}

/* ---- the header ---- */

static void digest_pack(struct packer *p, struct digest d)
{
	packer_u64(p, d.hi);
	packer_u64(p, d.lo);
}

static struct digest digest_unpack(struct cursor *c)
{
	struct digest d;

	d.hi = cursor_u64(c);
	d.lo = cursor_u64(c);
	return d;
}

static void header_pack(const struct mesh_domain *d, const struct store_id *id, const struct store_beside *b,
			const struct sums *sums, uint8_t header[HEADER])
{
	struct packer p = packer_of(header, HEADER);
	size_t i;

	packer_u32(&p, MAGIC);
	packer_u32(&p, VERSION);
	digest_pack(&p, id->base);
	digest_pack(&p, id->list);
	digest_pack(&p, b->content);
	packer_u32(&p, d->nvertex);
	packer_u32(&p, d->nopen);
	packer_u32(&p, d->ntriangle);
	packer_u32(&p, (uint32_t)b->proof_size);
	digest_pack(&p, d->digest);
	digest_pack(&p, d->closed_digest);
	for (i = 0; i < 6; i++)
		packer_i32(&p, d->box[i]);
	packer_u64(&p, d->counts.points);
	packer_u64(&p, d->counts.used);
	packer_u64(&p, d->counts.halo);
	for (i = 0; i < MESH_RULES; i++)
		packer_u64(&p, d->counts.removed[i]);
	packer_u64(&p, d->counts.cells_read);
	packer_u64(&p, d->counts.points_read);
	packer_u64(&p, sums->proof);
	packer_u64(&p, sums->open);
	packer_u64(&p, sums->rest);
	digest_pack(&p, d->own_digest);
	packer_u32(&p, d->nhull);
	packer_zero(&p, HEADER - 8 - packer_size(&p));
	packer_u64(&p, XXH3_64bits(header, HEADER - 8));
}

/* False: not a header of this version and name, or damaged. */
static bool header_unpack(const uint8_t header[HEADER], const struct store_id *id, struct store_front *f,
			  struct sums *ret_sums)
{
	struct cursor c = cursor_of(header, HEADER), last = cursor_of(header + HEADER - 8, 8);
	struct mesh_domain *d = &f->domain;
	size_t i;

	if (cursor_u64(&last) != XXH3_64bits(header, HEADER - 8))
		return false;
	if (cursor_u32(&c) != MAGIC || cursor_u32(&c) != VERSION)
		return false;
	if (!digest_equal(digest_unpack(&c), id->base) || !digest_equal(digest_unpack(&c), id->list))
		return false;
	f->beside.content = digest_unpack(&c);
	d->nvertex = cursor_u32(&c);
	d->nopen = cursor_u32(&c);
	d->ntriangle = cursor_u32(&c);
	f->beside.proof_size = cursor_u32(&c);
	d->digest = digest_unpack(&c);
	d->closed_digest = digest_unpack(&c);
	for (i = 0; i < 6; i++)
		d->box[i] = cursor_i32(&c);
	d->counts.points = cursor_u64(&c);
	d->counts.used = cursor_u64(&c);
	d->counts.halo = cursor_u64(&c);
	for (i = 0; i < MESH_RULES; i++)
		d->counts.removed[i] = cursor_u64(&c);
	d->counts.cells_read = cursor_u64(&c);
	d->counts.points_read = cursor_u64(&c);
	ret_sums->proof = cursor_u64(&c);
	ret_sums->open = cursor_u64(&c);
	ret_sums->rest = cursor_u64(&c);
	d->own_digest = digest_unpack(&c);
	d->nhull = cursor_u32(&c);
	return !c.bad && d->nopen <= d->nvertex && f->beside.proof_size <= STORE_PROOF_MOST;
}

/* What follows from the header's numbers. */
static void sizes_fill(struct store_front *f, const struct sums *sums)
{
	struct layout l = layout_of(&f->domain);
	size_t proof = padded(f->beside.proof_size);

	f->payload = XXH3_64bits_withSeed(&sums->rest, sizeof sums->rest, sums->open);
	f->bytes = HEADER + proof + l.payload;
	f->front = proof + padded(l.open_end);
	f->whole = l.total;
}

/* ---- writing ---- */

static int write_all(int fd, const char *name, const struct store_id *id, const struct store_beside *b,
		     const struct mesh_domain *d, const struct sums *sums, struct err *err)
{
	size_t at = HEADER + padded(b->proof_size);
	struct layout l = layout_of(d);
	uint8_t header[HEADER];
	int r;

	header_pack(d, id, b, sums, header);
	r = io_write_at(fd, header, HEADER, 0, name, err);
	if (!r)
		r = io_write_at(fd, b->proof, b->proof_size, HEADER, name, err);
	if (!r)
		r = io_write_at(fd, d->link, l.vertex, at, name, err);
	if (!r)
		r = io_write_at(fd, d->vertex, (size_t)d->nvertex * sizeof(struct mesh_vertex), at + l.vertex, name, err);
	if (!r)
		r = io_write_at(fd, d->triangle, (size_t)d->ntriangle * sizeof(uint32_t[3]), at + l.triangle, name, err);
	if (!r && io->ftruncate(fd, (off_t)(at + l.payload)) < 0)
		r = err_sys(err, errno, "cannot set the length of %s", name);
	return r;
}

/* A temporary file beside `name`, in a folder that is made when it is first needed. */
static int temp_open(int dirfd, const char *name, const char *temp, int *ret_fd, struct err *err)
{
	char folder[FOLDER] = { name[0], name[1] };
	int fd = io->openat(dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600), r;

	if (fd >= 0 || errno != ENOENT) {
		*ret_fd = fd;
		return fd >= 0 ? 0 : err_sys(err, errno, "cannot create %s", temp);
	}
	r = io_make_dir(dirfd, folder, 0700, err);
	return r ? r : io_open(dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC, 0600, ret_fd, err);
}

int store_put(int dirfd, const struct store_id *id, const struct store_beside *beside, const struct mesh_domain *d,
	      struct store_front *ret, struct err *err)
{
	char name[NAME], temp[TEMP];
	struct sums sums;
	int fd = -1, r;

	if (beside->proof_size > STORE_PROOF_MOST)
		return err_set(err, ERR_INTERNAL, "a proof of %zu bytes is too long to be stored", beside->proof_size);
	name_of(id, name);
	/* Two jobs may finish the same domain at once: each has a temp name of its own. */
	snprintf(temp, sizeof temp, "%s.%ld.%lx.tmp", name, (long)getpid(), (unsigned long)(uintptr_t)d);
	r = temp_open(dirfd, name, temp, &fd, err);
	if (r)
		return r;
	sums = (struct sums){ XXH3_64bits(beside->proof, beside->proof_size), open_sum(d), rest_sum(d) };
	r = write_all(fd, temp, id, beside, d, &sums, err);
	if (!r && io->renameat(dirfd, temp, dirfd, name) < 0)
		r = err_sys(err, errno, "cannot publish %s", name);
	if (r)
		io->unlinkat(dirfd, temp, 0);
	io_close(fd);
	if (!r) {
		*ret = (struct store_front){ .domain = *d, .beside = *beside };
		sizes_fill(ret, &sums);
	}
	return r;
}

/* ---- looking ---- */

struct looking {
	int dirfd;
	char folder[FOLDER], prefix[2 + 32 + 2];
	struct store_version *version;
	size_t n, most;
};

static int look_at(void *ctx, const struct dirent *e, struct err *err)
{
	struct looking *l = ctx;
	struct store_version v;
	char name[NAME];
	struct stat st;
	size_t at;

	(void)err;
	if (strncmp(e->d_name, l->prefix, sizeof l->prefix - 1) || strlen(e->d_name) != NAME - FOLDER - 1 ||
	    !digest_parse(e->d_name + sizeof l->prefix - 1, &v.list))
		return 0;
	snprintf(name, sizeof name, "%s/%.*s", l->folder, NAME - FOLDER - 1, e->d_name);
	if (io->fstatat(l->dirfd, name, &st, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(st.st_mode))
		return 0; /* it may have been evicted just now */
	v.mtime_ns = (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec;
	if (l->n < l->most)
		at = l->n++;
	else if (l->version[at = l->most - 1].mtime_ns >= v.mtime_ns)
		return 0;
	for (; at > 0 && l->version[at - 1].mtime_ns < v.mtime_ns; at--)
		l->version[at] = l->version[at - 1];
	l->version[at] = v;
	return 0;
}

int store_versions(int dirfd, struct digest base, struct store_version *ret, size_t most, size_t *ret_n, struct err *err)
{
	struct looking l = { .dirfd = dirfd, .version = ret, .most = most };
	char hex[DIGEST_HEX_SIZE];
	struct stat st;
	int r;

	*ret_n = 0;
	digest_hex(base, hex);
	snprintf(l.folder, sizeof l.folder, "%.2s", hex);
	snprintf(l.prefix, sizeof l.prefix, "d-%s-", hex);
	memset(ret, 0, most * sizeof *ret);
	if (!most || (io->fstatat(dirfd, l.folder, &st, 0) != 0 && errno == ENOENT))
		return 0;
	r = io_list(dirfd, l.folder, look_at, &l, err);
	if (!r)
		*ret_n = l.n;
	return r;
}

static int damaged(int dirfd, const char *name)
{
	io->unlinkat(dirfd, name, 0);
	return STORE_E_DAMAGED;
}

static bool other_format(const uint8_t header[HEADER])
{
	struct cursor c = cursor_of(header, HEADER);

	return cursor_u32(&c) == MAGIC && cursor_u32(&c) != VERSION;
}

/* Opens and checks the header. STORE_E_ABSENT as in store.h. */
static int open_checked(int dirfd, const struct store_id *id, char name[NAME], int *ret_fd, struct store_front *ret,
			struct sums *ret_sums, struct err *err)
{
	uint8_t header[HEADER];
	struct stat st;
	int fd, r;

	memset(ret, 0, sizeof *ret);
	name_of(id, name);
	fd = io->openat(dirfd, name, O_RDONLY | O_CLOEXEC, 0);
	if (fd < 0)
		return errno == ENOENT ? STORE_E_ABSENT : err_sys(err, errno, "cannot open %s", name);
	if (io->fstat(fd, &st) < 0) {
		r = err_sys(err, errno, "cannot look at %s", name);
	} else if (st.st_size < HEADER) {
		r = damaged(dirfd, name);
	} else {
		r = io_read_at(fd, header, HEADER, 0, name, err);
		if (!r && !header_unpack(header, id, ret, ret_sums))
			r = damaged(dirfd, name) == STORE_E_DAMAGED && other_format(header) ? STORE_E_ABSENT : STORE_E_DAMAGED;
		if (!r)
			sizes_fill(ret, ret_sums);
		if (!r && (uint64_t)st.st_size != ret->bytes)
			r = damaged(dirfd, name);
	}
	if (r)
		io_close(fd);
	else
		*ret_fd = fd;
	return r;
}

int store_head(int dirfd, const struct store_id *id, struct store_front *ret, struct err *err)
{
	struct sums sums;
	char name[NAME];
	int fd, r;

	r = open_checked(dirfd, id, name, &fd, ret, &sums, err);
	if (!r)
		io_close(fd);
	return r;
}

int store_proof(int dirfd, const struct store_id *id, void *memory, size_t size, struct store_front *ret, struct err *err)
{
	struct store_front f;
	struct sums sums;
	char name[NAME];
	int fd, r;

	r = open_checked(dirfd, id, name, &fd, &f, &sums, err);
	if (r)
		return r;
	r = f.beside.proof_size > size ? STORE_E_ABSENT : io_read_at(fd, memory, f.beside.proof_size, HEADER, name, err);
	io_close(fd);
	if (r)
		return r;
	if (XXH3_64bits(memory, f.beside.proof_size) != sums.proof)
		return damaged(dirfd, name);
	f.beside.proof = memory;
	*ret = f;
	return 0;
}

int store_front(int dirfd, const struct store_id *id, void *memory, size_t size, struct store_front *ret, struct err *err)
{
	struct store_front f;
	struct sums sums;
	struct layout l;
	char name[NAME];
	size_t proof;
	int fd, r;

	r = open_checked(dirfd, id, name, &fd, &f, &sums, err);
	if (r)
		return r;
	l = layout_of(&f.domain);
	proof = padded(f.beside.proof_size);
	r = f.front > size ? STORE_E_ABSENT : io_read_at(fd, memory, proof + l.open_end, HEADER, name, err);
	io_close(fd);
	if (r)
		return r;
	f.beside.proof = memory;
	f.domain.link = (void *)((uint8_t *)memory + proof);
	f.domain.vertex = (void *)((uint8_t *)memory + proof + l.vertex);
	if (XXH3_64bits(memory, f.beside.proof_size) != sums.proof || open_sum(&f.domain) != sums.open)
		return damaged(dirfd, name);
	*ret = f;
	return 0;
}

int store_get(int dirfd, const struct store_id *id, void *memory, size_t size, struct mesh_domain *ret, struct err *err)
{
	struct mesh_domain *d;
	struct store_front f;
	uint8_t *at = memory;
	struct sums sums;
	struct layout l;
	char name[NAME];
	int fd, r;

	r = open_checked(dirfd, id, name, &fd, &f, &sums, err);
	if (r)
		return r;
	d = &f.domain;
	l = layout_of(d);
	r = l.total > size ? STORE_E_ABSENT :
			     io_read_at(fd, at, l.payload, HEADER + padded(f.beside.proof_size), name, err);
	io_close(fd);
	if (r)
		return r;
	d->link = (void *)at;
	d->vertex = (void *)(at + l.vertex);
	d->triangle = (void *)(at + l.triangle);
	d->final = at + l.final;
	if (open_sum(d) != sums.open || rest_sum(d) != sums.rest)
		return damaged(dirfd, name);
	*ret = *d;
	return 0;
}

/* ---- the rest ---- */

void store_touch(int dirfd, const struct store_id *id, int64_t before_ns)
{
	char name[NAME];
	struct stat st;

	name_of(id, name);
	if (io->fstatat(dirfd, name, &st, AT_SYMLINK_NOFOLLOW) == 0 &&
	    (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec < before_ns)
		io->utimensat(dirfd, name, NULL, AT_SYMLINK_NOFOLLOW);
}

uint64_t store_size(int dirfd, const struct store_id *id)
{
	char name[NAME];
	struct stat st;

	name_of(id, name);
	return io->fstatat(dirfd, name, &st, AT_SYMLINK_NOFOLLOW) ? 0 : (uint64_t)st.st_size;
}

int store_remove(int dirfd, const struct store_id *id, struct err *err)
{
	char name[NAME];

	name_of(id, name);
	return io_remove(dirfd, name, err);
}

static int sweep_entry(void *ctx, const struct dirent *e, struct err *err)
{
	const int *dirfd = ctx;

	return strncmp(e->d_name, "d-", 2) ? 0 : io_remove(*dirfd, e->d_name, err);
}

int store_sweep(int dirfd, struct err *err)
{
	return io_list(dirfd, ".", sweep_entry, &dirfd, err);
}

/* ---- reading all of a file ---- */

static int wrong(const char *name, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "a finished domain is damaged: %s", what);
	return err_add_file(err, name);
}

/* Of n bytes from `at` on, through `memory`. */
static int piece_sum(int fd, const char *name, uint64_t at, size_t n, void *memory, size_t size, XXH3_state_t *state,
		     struct err *err)
{
	int r = 0;

	for (size_t done = 0; !r && done < n;) {
		size_t some = n - done < size ? n - done : size;

		r = io_read_at(fd, memory, some, at + done, name, err);
		if (!r)
			XXH3_64bits_update(state, memory, some);
		done += some;
	}
	return r;
}

/* Padding stands between the arrays, and is in no checksum. */
static int check_sums(int fd, const char *name, const struct store_front *f, const struct sums *sums, void *memory,
		      size_t size, struct err *err)
{
	struct layout l = layout_of(&f->domain);
	uint64_t at = HEADER + padded(f->beside.proof_size);
	const struct {
		uint64_t sum, at;
		size_t n, then, more; /* a second piece, behind */
	} part[] = {
		{ sums->proof, HEADER, f->beside.proof_size, 0, 0 },
		{ sums->open, at, l.open_end, 0, 0 },
		{ sums->rest, at + l.open_end, (size_t)(f->domain.nvertex - f->domain.nopen) * sizeof(struct mesh_vertex),
		  l.triangle, (size_t)f->domain.ntriangle * sizeof(uint32_t[3]) },
	};

	for (size_t i = 0; i < 3; i++) {
		XXH3_state_t state;
		int r;

		XXH3_64bits_reset(&state);
		r = piece_sum(fd, name, part[i].at, part[i].n, memory, size, &state, err);
		if (!r)
			r = piece_sum(fd, name, at + part[i].then, part[i].more, memory, size, &state, err);
		if (r)
			return r;
		if (XXH3_64bits_digest(&state) != part[i].sum)
			return wrong(name, "a checksum does not agree", err);
	}
	return 0;
}

static bool id_of(const char *name, struct store_id *ret)
{
	char base[DIGEST_HEX_SIZE], list[DIGEST_HEX_SIZE];

	return sscanf(name, "d-%32[0-9a-f]-%32[0-9a-f]", base, list) == 2 && strlen(name) == NAME - FOLDER - 1 &&
	       digest_parse(base, &ret->base) && digest_parse(list, &ret->list);
}

int store_check(int dirfd, const char *name, void *memory, size_t size, struct err *err)
{
	struct store_front f = { 0 };
	uint8_t header[HEADER];
	struct store_id id;
	struct sums sums;
	struct stat st;
	int fd, r;

	if (!id_of(name, &id))
		return wrong(name, "no finished domain has such a name", err);
	r = io_open(dirfd, name, O_RDONLY, 0, &fd, err);
	if (r)
		return r;
	if (io->fstat(fd, &st) < 0) {
		err_sys(err, errno, "cannot look at");
		r = err_add_file(err, name);
	} else if (st.st_size < HEADER) {
		r = wrong(name, "it has no header", err);
	} else {
		r = io_read_at(fd, header, HEADER, 0, name, err);
	}
	if (!r && !header_unpack(header, &id, &f, &sums))
		r = wrong(name, "its header is not one", err);
	if (!r) {
		sizes_fill(&f, &sums);
		if ((uint64_t)st.st_size != f.bytes)
			r = wrong(name, "it has another size than its header says", err);
	}
	if (!r)
		r = check_sums(fd, name, &f, &sums, memory, size, err);
	io_close(fd);
	return r;
}
