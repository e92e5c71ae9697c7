/*
 * The marker of a folder: 64 bytes, little-endian, checked as a whole before it is used.
 *
 * The marker tells a store from an empty mount point. It never changes: the versions of other files are in those files. Its own
 * version is raised if an older acutd must not use the folder at all.
 */
#include "marker.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include "clock.h"
#include "digest.h"
#include "err.h"
#include "io.h"

enum { MARKER_VERSION = 1, MARKER_BYTE_ORDER = 0x01020304 };

static const struct {
	const char *name, *temp, *what;
	char magic[9];
} kinds[] = {
	[MARKER_STATE] = {"acut-state", "acut-state.tmp", "state", "ACUTSTA1"},
	[MARKER_CACHE] = {"acut-cache", "acut-cache.tmp", "cache", "ACUTCCH1"},
};

struct disk_marker {
	char magic[8];
	uint32_t version, byte_order; /* byte_order: native, so a reader of the other order sees it swapped */
	uint8_t id[16];
	int64_t made_us;
	uint8_t zero[16];
	uint64_t check; /* low half of the digest of the bytes before it */
};
_Static_assert(sizeof(struct disk_marker) == 64, "format.md");

static uint64_t check_of(const struct disk_marker *d)
{
	return digest_hash(d, offsetof(struct disk_marker, check)).lo;
}

static int damaged(enum marker_kind kind, const char *reason, struct err *err)
{
	err_set(err, ERR_CORRUPT, "%s", reason);
	return err_add_hint(err, "take the file %s from a backup", kinds[kind].name);
}

static int judge(const struct disk_marker *d, enum marker_kind kind, size_t n, struct err *err)
{
	/* A newer version may differ in everything behind its number. */
	if (n < 16 || memcmp(d->magic, kinds[kind].magic, sizeof d->magic) != 0)
		return damaged(kind, "this is no marker of a store", err);
	if (d->byte_order == __builtin_bswap32(MARKER_BYTE_ORDER)) {
		err_set(err, ERR_VERSION, "the %s folder was written on a machine of another byte order", kinds[kind].what);
		return err_add_hint(err, "acut keeps its files little-endian: run it on such a machine");
	}
	if (d->version > MARKER_VERSION) {
		err_set(err, ERR_VERSION,
			"the %s folder was made by a newer acutd: its marker has version %u, this one (%s) knows up to %d",
			kinds[kind].what, d->version, ACUT_VERSION, MARKER_VERSION);
		return err_add_hint(err, "use that acutd, or another folder (--%s)", kinds[kind].what);
	}
	if (n < sizeof *d || !d->version || d->byte_order != MARKER_BYTE_ORDER || d->check != check_of(d))
		return damaged(kind, "the marker of the store is damaged", err);
	return 0;
}

int marker_read(int dirfd, enum marker_kind kind, struct marker *ret, struct err *err)
{
	const char *name = kinds[kind].name;
	struct disk_marker d;
	struct err why = ERR_INIT;
	size_t n = 0;
	int fd, r = io_open(dirfd, name, O_RDONLY | O_NOFOLLOW, 0, &fd, &why);

	if (r && why.sys == ENOENT)
		return MARKER_E_ABSENT;
	if (r) {
		*err = why;
		return r;
	}
	r = io_read_some(fd, &d, sizeof d, 0, name, &n, err);
	io_close(fd);
	if (!r && judge(&d, kind, n, err))
		r = err_add_file(err, name);
	if (r)
		return r;
	memcpy(ret->id, d.id, sizeof ret->id);
	ret->made_us = d.made_us;
	return 0;
}

int marker_write(int dirfd, enum marker_kind kind, const struct marker *m, struct err *err)
{
	const char *name = kinds[kind].name, *temp = kinds[kind].temp;
	struct disk_marker d = {.version = MARKER_VERSION, .byte_order = MARKER_BYTE_ORDER, .made_us = m->made_us};
	int fd, r;

	memcpy(d.magic, kinds[kind].magic, sizeof d.magic);
	memcpy(d.id, m->id, sizeof d.id);
	d.check = check_of(&d);
	r = io_open(dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW, 0600, &fd, err);
	if (r)
		return r;
	r = io_write_at(fd, &d, sizeof d, 0, name, err);
	if (r)
		io->unlinkat(dirfd, temp, 0);
	else
		r = io_publish(dirfd, fd, temp, name, err);
	io_close(fd);
	return r;
}

int marker_new(struct marker *ret, struct err *err)
{
	struct marker m = {.made_us = clock_real_us()};

	if (getrandom(m.id, sizeof m.id, 0) != sizeof m.id)
		return err_sys(err, errno, "the system gives no random numbers");
	*ret = m;
	return 0;
}
