/*
 * Verification of a stored domain, for `cache verify`: reads all of it through little memory, without unpacking. A file
 * of a newer version cannot be checked, and does not count as damaged.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#define XXH_STATIC_LINKING_ONLY /* for the hash state on the stack */
#include <xxhash.h>

#include "cursor.h"
#include "err.h"
#include "io.h"
#include "store_format.h"

static int wrong(const char *name, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "a finished domain is damaged: %s", what);
	return err_add_file(err, name);
}

/* The checksum of n bytes from `at` on, read through `memory`. */
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

/* Padding is between the arrays, and in no checksum. */
static int check_sums(int fd, const char *name, uint64_t at, const struct store_front *f, const struct store_header *h,
		      void *memory, size_t size, struct err *err)
{
	const struct store_extent e = store_extent_of(&f->domain, &h->code, f->beside.proof_size);
	const struct {
		uint64_t sum, at;
		size_t n;
		uint64_t then; /* of the second piece */
		size_t more;
	} part[] = {
		{h->sums.proof, STORE_HEADER, f->beside.proof_size, 0, 0},
		{h->sums.open, e.open_at, e.open, 0, 0},
		{h->sums.rest, e.closed_at, e.closed, e.triangle_at, e.triangle + e.edges},
	};

	for (size_t i = 0; i < 3; i++) {
		XXH3_state_t state;
		int r;

		XXH3_64bits_reset(&state);
		r = piece_sum(fd, name, at + part[i].at, part[i].n, memory, size, &state, err);
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

	return sscanf(name, "d-%32[0-9a-f]-%32[0-9a-f]", base, list) == 2 && strlen(name) == STORE_NAME - STORE_FOLDER - 1 &&
	       digest_parse(base, &ret->base) && digest_parse(list, &ret->list);
}

static int newer(const char *name, const uint8_t header[STORE_HEADER], struct err *err)
{
	struct cursor c = cursor_of(header, STORE_HEADER);

	cursor_skip(&c, 4);
	err_set(err, ERR_VERSION, "a finished domain of version %u; this acut is too old to read it", cursor_u32(&c));
	return err_add_file(err, name);
}

/* `size`: room for some corners at least. */
static int check_corners(int fd, const char *name, uint64_t at, const struct store_front *f, const struct store_header *h,
			 void *memory, size_t size, struct err *err)
{
	const struct store_extent e = store_extent_of(&f->domain, &h->code, f->beside.proof_size);
	int r = 0;

	size -= size % h->code.triangle;
	for (size_t done = 0, some; !r && done < e.triangle; done += some) {
		some = e.triangle - done < size ? e.triangle - done : size;
		r = io_read_at(fd, memory, some, at + e.triangle_at + done, name, err);
		if (!r && !store_corners_fit(&h->code, memory, some / h->code.triangle, f->domain.nvertex))
			r = wrong(name, "a corner of a triangle is not a vertex", err);
	}
	return r;
}

int store_check_at(int fd, const char *name, uint64_t at, const struct store_front *f, const struct store_header *h, void *memory,
		   size_t size, struct err *err)
{
	int r = check_sums(fd, name, at, f, h, memory, size, err);

	return r ? r : check_corners(fd, name, at, f, h, memory, size, err);
}

int store_check(int dirfd, const char *name, void *memory, size_t size, struct err *err)
{
	struct store_front f = {0};
	uint8_t header[STORE_HEADER];
	enum store_header_is is = STORE_HEADER_DAMAGED;
	struct store_header h;
	struct store_id id;
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
	} else if (st.st_size < STORE_HEADER) {
		r = wrong(name, "it has no header", err);
	} else {
		r = io_read_at(fd, header, STORE_HEADER, 0, name, err);
	}
	if (!r)
		is = store_header_unpack(header, &id, &f, &h);
	if (!r && (is == STORE_HEADER_OLD || is == STORE_HEADER_DAMAGED))
		r = wrong(name, "its header is invalid", err);
	if (!r && is == STORE_HEADER_NEWER)
		r = newer(name, header, err);
	if (!r && (uint64_t)st.st_size != f.bytes)
		r = wrong(name, "its size differs from its header", err);
	if (!r)
		r = store_check_at(fd, name, 0, &f, &h, memory, size, err);
	io_close(fd);
	return r;
}
