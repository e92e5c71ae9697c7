/*
 * The store of finished domains.
 *
 * A file is a header, the proof (the data that the domain depends on, in the caller's encoding), and the domain: links
 * and open vertices as in memory, closed vertices and triangles in fewer bytes (store_format.c, format.md). Open
 * vertices come first, so everything that is needed without the mesh itself is one read from the start: the front.
 * Header, proof, front and rest each have a checksum. A file gets its name only when it is complete (rename), in one of
 * 256 folders by the first byte of its base. A damaged file is removed and reported as absent, because it can be made
 * again. A file of a newer version counts as absent and stays.
 */
#include "store.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>
#define XXH_STATIC_LINKING_ONLY /* for the hash state on the stack */
#include <xxhash.h>

#include "err.h"
#include "io.h"
#include "store_format.h"

enum { TEMP = STORE_NAME + 48 };

static int64_t time_of(const struct stat *st)
{
	return (int64_t)st->st_mtim.tv_sec * 1000000000 + st->st_mtim.tv_nsec;
}

/* ---- checksums ---- */

/* The checksum of two arrays as if they were one. */
static uint64_t two_sum(const void *a, size_t na, const void *b, size_t nb)
{
	XXH3_state_t state;

	XXH3_64bits_reset(&state);
	XXH3_64bits_update(&state, a, na);
	XXH3_64bits_update(&state, b, nb);
	return XXH3_64bits_digest(&state);
}

static uint64_t open_sum(const struct mesh_domain *d)
{
	return two_sum(d->link, (size_t)d->nopen * sizeof *d->link, d->vertex, (size_t)d->nopen * sizeof *d->vertex);
}

/* ---- writing ---- */

/* The part of a file that is written behind its header. `sum`: of packed bytes. */
struct piece {
	int fd;
	const char *name;
	uint64_t at; /* place in the file */
	size_t used;
	XXH3_state_t sum;
	uint8_t buf[32 << 10];
};

static int piece_flush(struct piece *p, struct err *err)
{
	int r = io_write_at(p->fd, p->buf, p->used, p->at, p->name, err);

	p->at += p->used;
	p->used = 0;
	return r;
}

static int piece_put(struct piece *p, const void *bytes, size_t n, struct err *err)
{
	int r = 0;

	for (const uint8_t *from = bytes; !r && n;) {
		size_t room = sizeof p->buf - p->used, some = n < room ? n : room;

		memcpy(p->buf + p->used, from, some);
		p->used += some;
		from += some;
		n -= some;
		if (p->used == sizeof p->buf)
			r = piece_flush(p, err);
	}
	return r;
}

/* Writes zeros up to `end`. */
static int piece_pad(struct piece *p, uint64_t end, struct err *err)
{
	static const uint8_t zero[8];

	return piece_put(p, zero, (size_t)(end - p->at - p->used), err);
}

/* How many elements of that size fit the buffer; writes the buffer out if none fits. */
static int piece_room(struct piece *p, size_t row, size_t *ret, struct err *err)
{
	int r = sizeof p->buf - p->used < row ? piece_flush(p, err) : 0;

	*ret = (sizeof p->buf - p->used) / row;
	return r;
}

static void piece_packed(struct piece *p, size_t n)
{
	XXH3_64bits_update(&p->sum, p->buf + p->used, n);
	p->used += n;
}

static int put_rest(struct piece *p, const struct mesh_domain *d, const struct store_code *c, const struct store_extent *e,
		    struct err *err)
{
	size_t some;
	int r = 0;

	for (size_t i = d->nopen; !r && i < d->nvertex; i += some) {
		r = piece_room(p, store_vertex_bytes(c), &some, err);
		some = some < d->nvertex - i ? some : d->nvertex - i;
		if (!r)
			piece_packed(p, store_pack_vertices(c, d->vertex + i, some, p->buf + p->used));
	}
	if (!r)
		r = piece_pad(p, e->triangle_at, err);
	for (size_t i = 0; !r && i < d->ntriangle; i += some) {
		r = piece_room(p, store_triangle_bytes(c), &some, err);
		some = some < d->ntriangle - i ? some : d->ntriangle - i;
		if (!r)
			piece_packed(p, store_pack_triangles(c, (const uint32_t(*)[3])d->triangle + i, some, p->buf + p->used));
	}
	if (!r && d->nedges) {
		XXH3_64bits_update(&p->sum, d->edges, d->nedges);
		r = piece_put(p, d->edges, d->nedges, err);
	}
	return r ? r : piece_pad(p, e->end, err);
}

/* Writes everything behind the header, then the header. Sets the sums and the payload of *f. */
static int write_all(int fd, const char *name, const struct store_id *id, struct store_front *f, struct err *err)
{
	const struct mesh_domain *d = &f->domain;
	struct store_header h = {.code = store_code_of(d)};
	const struct store_extent e = store_extent_of(d, &h.code, f->beside.proof_size);
	struct piece p;
	uint8_t header[STORE_HEADER];
	int r;

	p.fd = fd;
	p.name = name;
	p.at = STORE_HEADER;
	p.used = 0;
	XXH3_64bits_reset(&p.sum);
	r = piece_put(&p, f->beside.proof, f->beside.proof_size, err);
	if (!r)
		r = piece_pad(&p, e.open_at, err);
	if (!r)
		r = piece_put(&p, d->link, (size_t)d->nopen * sizeof *d->link, err);
	if (!r)
		r = piece_put(&p, d->vertex, (size_t)d->nopen * sizeof *d->vertex, err);
	if (!r)
		r = put_rest(&p, d, &h.code, &e, err);
	if (!r)
		r = piece_flush(&p, err);
	if (r)
		return r;
	h.sums = (struct store_sums){XXH3_64bits(f->beside.proof, f->beside.proof_size), open_sum(d), XXH3_64bits_digest(&p.sum)};
	store_sizes(f, &h);
	store_header_pack(f, id, &h, header);
	return io_write_at(fd, header, STORE_HEADER, 0, name, err);
}

/* A temporary file beside `name`, in a folder that is made when it is first needed. */
static int temp_open(int dirfd, const char *name, const char *temp, int *ret_fd, struct err *err)
{
	char folder[STORE_FOLDER] = {name[0], name[1]};
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
	struct store_front f = {.domain = *d, .beside = *beside};
	char name[STORE_NAME], temp[TEMP];
	int fd = -1, r;

	if (beside->proof_size > STORE_PROOF_MOST)
		return err_set(err, ERR_INTERNAL, "a proof of %zu bytes is too long to be stored", beside->proof_size);
	store_name(id, name);
	/* Two jobs may finish the same domain at once: each has its own temporary name. */
	snprintf(temp, sizeof temp, "%s.%ld.%lx.tmp", name, (long)getpid(), (unsigned long)(uintptr_t)d);
	r = temp_open(dirfd, name, temp, &fd, err);
	if (r)
		return r;
	r = write_all(fd, temp, id, &f, err);
	if (!r && io->renameat(dirfd, temp, dirfd, name) < 0)
		r = err_sys(err, errno, "cannot publish %s", name);
	if (r)
		io->unlinkat(dirfd, temp, 0);
	io_close(fd);
	if (!r)
		*ret = f;
	return r;
}

/* ---- finding ---- */

struct search {
	int dirfd;
	char folder[STORE_FOLDER], prefix[2 + 32 + 2];
	struct store_version *version;
	size_t n, most;
};

static int inspect_entry(void *ctx, const struct dirent *e, struct err *err)
{
	struct search *l = ctx;
	struct store_version v;
	char name[STORE_NAME];
	struct stat st;
	size_t at;

	(void)err;
	if (strncmp(e->d_name, l->prefix, sizeof l->prefix - 1) || strlen(e->d_name) != STORE_NAME - STORE_FOLDER - 1 ||
	    !digest_parse(e->d_name + sizeof l->prefix - 1, &v.list))
		return 0;
	snprintf(name, sizeof name, "%s/%.*s", l->folder, STORE_NAME - STORE_FOLDER - 1, e->d_name);
	if (io->fstatat(l->dirfd, name, &st, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(st.st_mode))
		return 0; /* it may have been evicted meanwhile */
	v.mtime_ns = time_of(&st);
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
	struct search l = {.dirfd = dirfd, .version = ret, .most = most};
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
	r = io_list(dirfd, l.folder, inspect_entry, &l, err);
	if (!r)
		*ret_n = l.n;
	return r;
}

static int damaged(int dirfd, const char *name)
{
	io->unlinkat(dirfd, name, 0);
	return STORE_E_DAMAGED;
}

static int header_judge(int dirfd, const char *name, enum store_header_is is)
{
	switch (is) {
	case STORE_HEADER_GOOD:
		return 0;
	case STORE_HEADER_NEWER:
		return STORE_E_ABSENT;
	case STORE_HEADER_OLD:
		io->unlinkat(dirfd, name, 0);
		return STORE_E_ABSENT;
	case STORE_HEADER_DAMAGED:
		break;
	}
	return damaged(dirfd, name);
}

/* Opens the file, reads at most its first `room` bytes (at least a header) to `start`, and checks the header.
 * STORE_E_ABSENT as in store.h. */
static int open_start(int dirfd, const struct store_id *id, char name[STORE_NAME], uint8_t *start, size_t room, int *ret_fd,
		      struct store_front *ret, struct store_header *ret_header, struct err *err)
{
	struct stat st;
	size_t got;
	int fd, r;

	memset(ret, 0, sizeof *ret);
	store_name(id, name);
	fd = io->openat(dirfd, name, O_RDONLY | O_CLOEXEC, 0);
	if (fd < 0)
		return errno == ENOENT ? STORE_E_ABSENT : err_sys(err, errno, "cannot open %s", name);
	if (io->fstat(fd, &st) < 0) {
		r = err_sys(err, errno, "cannot look at %s", name);
	} else if (st.st_size < STORE_HEADER) {
		r = damaged(dirfd, name);
	} else {
		ret->used_ns = time_of(&st);
		r = io_read_some(fd, start, (uint64_t)st.st_size < room ? (size_t)st.st_size : room, 0, name, &got, err);
		if (!r)
			r = got < STORE_HEADER ? damaged(dirfd, name) :
						 header_judge(dirfd, name, store_header_unpack(start, id, ret, ret_header));
		if (!r && (uint64_t)st.st_size != ret->bytes)
			r = damaged(dirfd, name);
	}
	if (r)
		io_close(fd);
	else
		*ret_fd = fd;
	return r;
}

static int open_checked(int dirfd, const struct store_id *id, char name[STORE_NAME], int *ret_fd, struct store_front *ret,
			struct store_header *ret_header, struct err *err)
{
	uint8_t header[STORE_HEADER];

	return open_start(dirfd, id, name, header, sizeof header, ret_fd, ret, ret_header, err);
}

int store_head(int dirfd, const struct store_id *id, struct store_front *ret, struct err *err)
{
	struct store_header h;
	char name[STORE_NAME];
	int fd = -1, r;

	r = open_checked(dirfd, id, name, &fd, ret, &h, err);
	if (!r)
		io_close(fd);
	return r;
}

/* Most proofs are read together with the header. */
int store_proof(int dirfd, const struct store_id *id, void *memory, size_t size, struct store_front *ret, struct err *err)
{
	enum { AT_ONCE = 8 << 10 };
	const size_t room = size < AT_ONCE ? size : AT_ONCE;
	uint8_t *proof = (uint8_t *)memory + STORE_HEADER;
	struct store_header h;
	struct store_front f;
	char name[STORE_NAME];
	size_t end;
	int fd = -1, r;

	if (room < STORE_HEADER)
		return STORE_E_ABSENT;
	r = open_start(dirfd, id, name, memory, room, &fd, &f, &h, err);
	if (r)
		return r;
	end = STORE_HEADER + f.beside.proof_size;
	if (end > size)
		r = STORE_E_ABSENT;
	else if (end > room)
		r = io_read_at(fd, (uint8_t *)memory + room, end - room, room, name, err);
	io_close(fd);
	if (r)
		return r;
	if (XXH3_64bits(proof, f.beside.proof_size) != h.sums.proof)
		return damaged(dirfd, name);
	f.beside.proof = proof;
	*ret = f;
	return 0;
}

int store_front(int dirfd, const struct store_id *id, void *memory, size_t size, struct store_front *ret, struct err *err)
{
	struct store_header h;
	struct store_layout l;
	struct store_front f;
	char name[STORE_NAME];
	size_t proof;
	int fd = -1, r;

	r = open_checked(dirfd, id, name, &fd, &f, &h, err);
	if (r)
		return r;
	l = store_layout_of(&f.domain);
	proof = store_padded(f.beside.proof_size);
	r = f.front > size ? STORE_E_ABSENT : io_read_at(fd, memory, proof + l.open_end, STORE_HEADER, name, err);
	io_close(fd);
	if (r)
		return r;
	f.beside.proof = memory;
	f.domain.link = (void *)((uint8_t *)memory + proof);
	f.domain.vertex = (void *)((uint8_t *)memory + proof + l.vertex);
	if (XXH3_64bits(memory, f.beside.proof_size) != h.sums.proof || open_sum(&f.domain) != h.sums.open)
		return damaged(dirfd, name);
	*ret = f;
	return 0;
}

static uint64_t rest_sum(const struct mesh_domain *d, const void *closed, const void *triangle, const struct store_extent *e)
{
	XXH3_state_t state;

	XXH3_64bits_reset(&state);
	XXH3_64bits_update(&state, closed, e->closed);
	XXH3_64bits_update(&state, triangle, e->triangle);
	if (e->edges)
		XXH3_64bits_update(&state, d->edges, e->edges);
	return XXH3_64bits_digest(&state);
}

/* Reads each array to where it is unpacked; packed ones to the end of their memory. */
static int read_domain(int fd, const char *name, const struct store_front *f, const struct store_header *h, uint8_t *memory,
		       bool *ret_whole, struct err *err)
{
	const struct mesh_domain *d = &f->domain;
	const struct store_extent e = store_extent_of(d, &h->code, f->beside.proof_size);
	uint8_t *closed = (uint8_t *)(d->vertex + d->nvertex) - e.closed;
	uint8_t *triangle = (uint8_t *)(d->triangle + d->ntriangle) - e.triangle;
	int r = io_read_at(fd, memory, e.open, e.open_at, name, err);

	if (!r)
		r = io_read_at(fd, closed, e.closed, e.closed_at, name, err);
	if (!r)
		r = io_read_at(fd, triangle, e.triangle, e.triangle_at, name, err);
	if (!r && e.edges)
		r = io_read_at(fd, d->edges, e.edges, e.triangle_at + e.triangle, name, err);
	if (!r)
		*ret_whole = open_sum(d) == h->sums.open && rest_sum(d, closed, triangle, &e) == h->sums.rest &&
			     store_corners_fit(&h->code, triangle, 3 * (size_t)d->ntriangle, d->nvertex);
	return r;
}

int store_get(int dirfd, const struct store_id *id, void *memory, size_t size, struct mesh_domain *ret, struct err *err)
{
	struct mesh_domain *d;
	struct store_header h;
	struct store_layout l;
	struct store_front f;
	uint8_t *at = memory;
	char name[STORE_NAME];
	bool whole = false;
	int fd = -1, r;

	r = open_checked(dirfd, id, name, &fd, &f, &h, err);
	if (r)
		return r;
	d = &f.domain;
	l = store_layout_of(d);
	d->link = (void *)at;
	d->vertex = (void *)(at + l.vertex);
	d->triangle = (void *)(at + l.triangle);
	d->final = at + l.final;
	d->edges = d->nedges ? at + l.edges : NULL;
	r = l.total > size ? STORE_E_ABSENT : read_domain(fd, name, &f, &h, at, &whole, err);
	io_close(fd);
	if (r)
		return r;
	if (!whole)
		return damaged(dirfd, name);
	store_unpack_vertices(&h.code, d->vertex + d->nopen, d->nvertex - d->nopen);
	store_unpack_triangles(&h.code, d->triangle, d->ntriangle);
	*ret = *d;
	return 0;
}

/* ---- other calls ---- */

void store_touch(int dirfd, const struct store_id *id, int64_t before_ns)
{
	char name[STORE_NAME];
	struct stat st;

	store_name(id, name);
	if (io->fstatat(dirfd, name, &st, AT_SYMLINK_NOFOLLOW) == 0 && time_of(&st) < before_ns)
		io->utimensat(dirfd, name, NULL, AT_SYMLINK_NOFOLLOW);
}

uint64_t store_size(int dirfd, const struct store_id *id)
{
	char name[STORE_NAME];
	struct stat st;

	store_name(id, name);
	return io->fstatat(dirfd, name, &st, AT_SYMLINK_NOFOLLOW) ? 0 : (uint64_t)st.st_size;
}

bool store_there(int dirfd, const struct store_id *id, uint64_t bytes, int64_t *ret_used_ns)
{
	char name[STORE_NAME];
	struct stat st;

	store_name(id, name);
	if (io->fstatat(dirfd, name, &st, AT_SYMLINK_NOFOLLOW) || !S_ISREG(st.st_mode) || (uint64_t)st.st_size != bytes)
		return false;
	*ret_used_ns = time_of(&st);
	return true;
}

int store_remove(int dirfd, const struct store_id *id, struct err *err)
{
	char name[STORE_NAME];

	store_name(id, name);
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
