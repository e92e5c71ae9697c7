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
#include <xxhash.h>

#include "err.h"
#include "io.h"
#include "store_format.h"

static int64_t time_of(const struct stat *st)
{
	return (int64_t)st->st_mtim.tv_sec * 1000000000 + st->st_mtim.tv_nsec;
}

/* ---- writing ---- */

/* In a folder that is made when it is first needed. */
int store_temp_open(int dirfd, const struct store_id *id, const void *who, char name[STORE_NAME], char temp[STORE_TEMP],
		    int *ret_fd, struct err *err)
{
	char folder[STORE_FOLDER] = {0};
	int fd, r;

	store_name(id, name);
	memcpy(folder, name, STORE_FOLDER - 1);
	/* Two jobs may finish the same domain at once: each has its own temporary name. */
	snprintf(temp, STORE_TEMP, "%s.%ld.%lx.tmp", name, (long)getpid(), (unsigned long)(uintptr_t)who);
	fd = io->openat(dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
	if (fd >= 0 || errno != ENOENT) {
		*ret_fd = fd;
		return fd >= 0 ? 0 : err_sys(err, errno, "cannot create %s", temp);
	}
	r = io_make_dir(dirfd, folder, 0700, err);
	return r ? r : io_open(dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC, 0600, ret_fd, err);
}

int store_temp_publish(int dirfd, int fd, const char *temp, const char *name, int r, struct err *err)
{
	if (!r && io->renameat(dirfd, temp, dirfd, name) < 0)
		r = err_sys(err, errno, "cannot publish %s", name);
	if (r)
		io->unlinkat(dirfd, temp, 0);
	io_close(fd);
	return r;
}

int store_put(int dirfd, const struct store_id *id, const struct store_beside *beside, const struct mesh_domain *d,
	      struct store_front *ret, struct err *err)
{
	struct store_front f = {.domain = *d, .beside = *beside};
	char name[STORE_NAME], temp[STORE_TEMP];
	int fd = -1, r;

	if (beside->proof_size > STORE_PROOF_MOST)
		return err_set(err, ERR_INTERNAL, "a proof of %zu bytes is too long to be stored", beside->proof_size);
	r = store_temp_open(dirfd, id, d, name, temp, &fd, err);
	if (r)
		return r;
	r = store_write(fd, temp, 0, id, &f, err);
	r = store_temp_publish(dirfd, fd, temp, name, r, err);
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
	if (XXH3_64bits(memory, f.beside.proof_size) != h.sums.proof || store_open_sum(&f.domain) != h.sums.open)
		return damaged(dirfd, name);
	*ret = f;
	return 0;
}

int store_get(int dirfd, const struct store_id *id, void *memory, size_t size, struct mesh_domain *ret, struct err *err)
{
	struct store_header h;
	struct store_front f;
	char name[STORE_NAME];
	bool whole = false;
	int fd = -1, r;

	r = open_checked(dirfd, id, name, &fd, &f, &h, err);
	if (r)
		return r;
	r = f.whole > size ? STORE_E_ABSENT : store_read(fd, name, 0, &f, &h, memory, &whole, err);
	io_close(fd);
	if (r)
		return r;
	if (!whole)
		return damaged(dirfd, name);
	*ret = f.domain;
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
