/*
 * The store of finished domains.
 *
 * A file is a header of HEADER bytes and a payload: links, vertices, triangles, each as they lie in
 * memory (little-endian, FORMAT.md), padded to 8 bytes. The header carries the XXH3-64 of the payload and
 * of itself. A file appears under its name only whole (rename); what does not check is removed and
 * reported as absent, because it can always be made again.
 */
#include "store.h"

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

enum { HEADER = 256, NAME = 2 + 32 + 1, TEMP = NAME + 48 };
static const uint32_t MAGIC = 0x4d444341; /* "ACDM" */
static const uint32_t VERSION = 2;

struct layout {
	size_t link, vertex, triangle, payload, final, total;
};

static size_t padded(size_t n)
{
	return (n + 7) & ~(size_t)7;
}

static struct layout layout_of(uint32_t nvertex, uint32_t nopen, uint32_t ntriangle)
{
	struct layout l = { 0 };

	l.vertex = l.link + (size_t)nopen * sizeof(struct mesh_link);
	l.triangle = l.vertex + padded((size_t)nvertex * sizeof(struct mesh_vertex));
	l.payload = l.triangle + padded((size_t)ntriangle * sizeof(uint32_t[3]));
	l.final = l.payload;
	l.total = l.final + padded(((size_t)nvertex + 7) / 8);
	return l;
}

static void name_of(struct digest key, char name[NAME])
{
	char hex[DIGEST_HEX_SIZE];

	snprintf(name, NAME, "d-%s", digest_hex(key, hex));
}

static void header_pack(const struct mesh_domain *d, struct digest key, uint64_t sum, uint8_t header[HEADER])
{
	struct packer p = packer_of(header, HEADER);
	size_t i;

	packer_u32(&p, MAGIC);
	packer_u32(&p, VERSION);
	packer_u64(&p, key.hi);
	packer_u64(&p, key.lo);
	packer_u32(&p, d->nvertex);
	packer_u32(&p, d->nopen);
	packer_u32(&p, d->ntriangle);
	packer_u32(&p, 0);
	packer_u64(&p, d->digest.hi);
	packer_u64(&p, d->digest.lo);
	packer_u64(&p, d->closed_digest.hi);
	packer_u64(&p, d->closed_digest.lo);
	for (i = 0; i < 6; i++)
		packer_i32(&p, d->box[i]);
	packer_u64(&p, d->counts.points);
	packer_u64(&p, d->counts.used);
	packer_u64(&p, d->counts.halo);
	for (i = 0; i < MESH_RULES; i++)
		packer_u64(&p, d->counts.removed[i]);
	packer_u64(&p, sum);
	packer_u64(&p, d->counts.cells_read);
	packer_u64(&p, d->counts.points_read);
	packer_zero(&p, HEADER - 8 - packer_size(&p));
	packer_u64(&p, XXH3_64bits(header, HEADER - 8));
}

/* False: not a header of this version, or damaged. */
static bool header_unpack(const uint8_t header[HEADER], struct digest key, struct mesh_domain *d, uint64_t *ret_sum)
{
	struct cursor c = cursor_of(header, HEADER);
	struct cursor last = cursor_of(header + HEADER - 8, 8);
	size_t i;

	if (cursor_u64(&last) != XXH3_64bits(header, HEADER - 8))
		return false;
	if (cursor_u32(&c) != MAGIC || cursor_u32(&c) != VERSION)
		return false;
	if (cursor_u64(&c) != key.hi || cursor_u64(&c) != key.lo)
		return false;
	d->nvertex = cursor_u32(&c);
	d->nopen = cursor_u32(&c);
	d->ntriangle = cursor_u32(&c);
	cursor_u32(&c);
	d->digest.hi = cursor_u64(&c);
	d->digest.lo = cursor_u64(&c);
	d->closed_digest.hi = cursor_u64(&c);
	d->closed_digest.lo = cursor_u64(&c);
	for (i = 0; i < 6; i++)
		d->box[i] = cursor_i32(&c);
	d->counts.points = cursor_u64(&c);
	d->counts.used = cursor_u64(&c);
	d->counts.halo = cursor_u64(&c);
	for (i = 0; i < MESH_RULES; i++)
		d->counts.removed[i] = cursor_u64(&c);
	*ret_sum = cursor_u64(&c);
	/* Zeros of a domain that was stored before these were counted. */
	d->counts.cells_read = cursor_u64(&c);
	d->counts.points_read = cursor_u64(&c);
	return !c.bad && d->nopen <= d->nvertex;
}

static uint64_t payload_sum(const struct mesh_domain *d)
{
	XXH3_state_t state;

	XXH3_64bits_reset(&state);
	XXH3_64bits_update(&state, d->link, (size_t)d->nopen * sizeof(struct mesh_link));
	XXH3_64bits_update(&state, d->vertex, (size_t)d->nvertex * sizeof(struct mesh_vertex));
	XXH3_64bits_update(&state, d->triangle, (size_t)d->ntriangle * sizeof(uint32_t[3]));
	return XXH3_64bits_digest(&state);
}

static int write_all(int fd, const char *name, struct digest key, const struct mesh_domain *d, struct err *err)
{
	struct layout l = layout_of(d->nvertex, d->nopen, d->ntriangle);
	uint8_t header[HEADER];
	int r;

	header_pack(d, key, payload_sum(d), header);
	r = io_write_at(fd, header, HEADER, 0, name, err);
	if (!r)
		r = io_write_at(fd, d->link, l.vertex - l.link, HEADER + l.link, name, err);
	if (!r)
		r = io_write_at(fd, d->vertex, (size_t)d->nvertex * sizeof(struct mesh_vertex), HEADER + l.vertex,
				name, err);
	if (!r)
		r = io_write_at(fd, d->triangle, (size_t)d->ntriangle * sizeof(uint32_t[3]),
				HEADER + l.triangle, name, err);
	if (!r && io->ftruncate(fd, (off_t)(HEADER + l.payload)) < 0)
		r = err_sys(err, errno, "cannot set the length of %s", name);
	return r;
}

int store_put(int dirfd, struct digest key, const struct mesh_domain *d, struct err *err)
{
	char name[NAME], temp[TEMP];
	int fd = -1, r;

	name_of(key, name);
	/* Two jobs may finish the same domain at once: each has a temp name of its own. */
	snprintf(temp, sizeof temp, "%s.%ld.%lx.tmp", name, (long)getpid(), (unsigned long)(uintptr_t)d);
	r = io_open(dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC, 0600, &fd, err);
	if (r)
		return r;
	r = write_all(fd, temp, key, d, err);
	if (!r && io->renameat(dirfd, temp, dirfd, name) < 0)
		r = err_sys(err, errno, "cannot publish %s", name);
	if (r)
		io->unlinkat(dirfd, temp, 0);
	io_close(fd);
	return r;
}

bool store_has(int dirfd, struct digest key)
{
	char name[NAME];

	name_of(key, name);
	return io->faccessat(dirfd, name, R_OK, 0) == 0;
}

static int damaged(int dirfd, struct digest key)
{
	char name[NAME];

	name_of(key, name);
	io->unlinkat(dirfd, name, 0);
	return STORE_E_ABSENT;
}

/* Opens and checks the header. STORE_E_ABSENT as in store.h. */
static int open_checked(int dirfd, struct digest key, int *ret_fd, struct mesh_domain *d, uint64_t *ret_sum,
			struct err *err)
{
	uint8_t header[HEADER];
	char name[NAME];
	struct stat st;
	int fd, r;

	name_of(key, name);
	fd = io->openat(dirfd, name, O_RDONLY | O_CLOEXEC, 0);
	if (fd < 0)
		return errno == ENOENT ? STORE_E_ABSENT : err_sys(err, errno, "cannot open %s", name);
	if (io->fstat(fd, &st) < 0) {
		r = err_sys(err, errno, "cannot look at %s", name);
		io_close(fd);
		return r;
	}
	if (st.st_size < HEADER) {
		io_close(fd);
		return damaged(dirfd, key);
	}
	r = io_read_at(fd, header, HEADER, 0, name, err);
	if (!r && (!header_unpack(header, key, d, ret_sum) ||
		   (uint64_t)st.st_size != HEADER + layout_of(d->nvertex, d->nopen, d->ntriangle).payload))
		r = damaged(dirfd, key);
	if (r)
		io_close(fd);
	else
		*ret_fd = fd;
	return r;
}

int store_size(int dirfd, struct digest key, size_t *ret, struct err *err)
{
	struct mesh_domain d = { 0 };
	uint64_t sum;
	int fd, r;

	r = open_checked(dirfd, key, &fd, &d, &sum, err);
	if (r)
		return r;
	io_close(fd);
	*ret = layout_of(d.nvertex, d.nopen, d.ntriangle).total;
	return 0;
}

int store_get(int dirfd, struct digest key, void *memory, size_t size, struct mesh_domain *ret, struct err *err)
{
	struct mesh_domain d = { 0 };
	uint8_t *at = memory;
	struct layout l;
	char name[NAME];
	uint64_t sum;
	int fd, r;

	name_of(key, name);
	r = open_checked(dirfd, key, &fd, &d, &sum, err);
	if (r)
		return r;
	l = layout_of(d.nvertex, d.nopen, d.ntriangle);
	if (l.total > size) {
		io_close(fd);
		return err_set(err, ERR_INTERNAL, "%s needs %zu bytes, %zu were given", name, l.total, size);
	}
	r = io_read_at(fd, at, l.payload, HEADER, name, err);
	io_close(fd);
	if (r)
		return r;
	d.link = (void *)(at + l.link);
	d.vertex = (void *)(at + l.vertex);
	d.triangle = (void *)(at + l.triangle);
	d.final = at + l.final;
	if (payload_sum(&d) != sum)
		return damaged(dirfd, key);
	*ret = d;
	return 0;
}

int store_remove(int dirfd, struct digest key, struct err *err)
{
	char name[NAME];

	name_of(key, name);
	return io_remove(dirfd, name, err);
}
