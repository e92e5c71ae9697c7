/* Any bytes as a gzip file or a zip archive: what comes out is at most what a member claims, and a failure says something. */
#include <stdlib.h>
#include <string.h>

#include "ctl_unpack.h"
#include "fuzz_input.h"

enum { MOST = 1 << 20, MEMBERS = 16 };

/* "1 2 3\n" as gzip, stored and deflated in a zip archive with a folder. */
static const uint8_t gz[] = {31, 139, 8, 0, 0, 0, 0, 0, 2, 3, 51, 84, 48, 82, 48, 230, 2, 0, 12, 207, 68, 224, 6, 0, 0, 0};
static const uint8_t zip[] =
	"PK\3\4\24\0\0\0\0\0\0\0\41\0\14\317\104\340\6\0\0\0\6\0\0\0\3\0\0\0d/a1 2 3\n"
	"PK\3\4\24\0\0\0\10\0\0\0\41\0\14\317\104\340\10\0\0\0\6\0\0\0\1\0\0\0b3T0R0\346\2\0"
	"PK\1\2\24\3\24\0\0\0\0\0\0\0\41\0\14\317\104\340\6\0\0\0\6\0\0\0\3\0\0\0\0\0\0\0\0\0\0\0\200\1\0\0\0\0d/a"
	"PK\1\2\24\3\24\0\0\0\10\0\0\0\41\0\14\317\104\340\10\0\0\0\6\0\0\0\1\0\0\0\0\0\0\0\0\0\0\0\200\1\47\0\0\0b"
	"PK\5\6\0\0\0\0\2\0\2\0\140\0\0\0\116\0\0\0\0";

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	const void *at = i ? (const void *)zip : gz;
	size_t n = i ? sizeof zip : sizeof gz;

	if (i > 1 || n > room)
		return 0;
	memcpy(bytes, at, n);
	return n;
}

static int take(void *ctx, const void *bytes, size_t n, struct err *err)
{
	uint64_t *done = ctx;

	*done += n;
	return *done > MOST ? err_set(err, ERR_NOSPACE, "too much") : 0;
}

struct list {
	struct ctl_unpack_member m[MEMBERS];
	size_t n;
};

static int note(void *ctx, const struct ctl_unpack_member *m, struct err *err)
{
	struct list *l = ctx;

	if (!*m->name || m->name[strlen(m->name) - 1] == '/')
		abort();
	if (l->n < MEMBERS)
		l->m[l->n++] = *m;
	return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	int fd = fuzz_input_fd(bytes, size);
	struct err err = ERR_INIT;
	struct list l = {.n = 0};
	uint64_t done = 0, trailing;
	bool cut;

	switch (ctl_unpack_kind_of(fd)) {
	case CTL_UNPACK_GZIP:
		fuzz_input_check(ctl_unpack_gzip(fd, take, &done, &cut, &trailing, &err), &err);
		break;
	case CTL_UNPACK_ZIP:
		fuzz_input_check(ctl_unpack_list(fd, note, &l, &err), &err);
		break;
	default:
		break;
	}
	for (size_t i = 0; i < l.n; i++) {
		int r;

		err = ERR_INIT;
		done = 0;
		r = ctl_unpack_zip(fd, &l.m[i], take, &done, &err);
		fuzz_input_check(r, &err);
		if (!r && done != l.m[i].size)
			abort();
	}
	return 0;
}
