/*
 * What goes when there is too much: stored domains and selections, least recently used first.
 *
 * The model: last use is the time of change of a domain's file, or of a selection's `manifest`. A pass reads the folders
 * and keeps the oldest few hundred in a heap of fixed size, removes them oldest first until there is room and some
 * more (so that the next who asks need not read the folders again), and is repeated where these were not enough.
 * Each pass sees all that is there, so it also mends the accounts: what somebody else removed is not there any more.
 * A selection is renamed before it is removed, so nobody opens half of one; who has it open reads on.
 *
 * What is in use goes last, and only for what must be written: selections that are held (space_hold), and domains that
 * were used since the oldest running job began.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "log.h"
#include "space_priv.h"
#include "store.h"

enum { OLDEST_MAX = 320, PATH_SIZE = 176, DEPTH_MAX = 4, PASSES_MAX = 4096 };

#define WRITTEN_NS (INT64_C(60) * 1000000000) /* a domain takes a few milliseconds */

struct old {
	int64_t used_ns;
	uint64_t bytes;
	bool selection;
	char path[PATH_SIZE]; /* below `domains` or `selected` */
};

struct pass {
	struct space *space;
	void *ctx;
	enum space_need need;
	int64_t since_ns;  /* domains used since then are in use */
	int64_t before_ns; /* temporary files changed since then are being written */
	size_t n;
	struct old *heap;              /* the youngest first */
	uint64_t bytes[2], entries[2]; /* of domains, selections */
};

/* ---- the oldest ---- */

static void sift_down(struct pass *p, size_t i)
{
	for (;;) {
		size_t young = i;
		struct old o;

		for (size_t k = 2 * i + 1; k <= 2 * i + 2 && k < p->n; k++)
			if (p->heap[k].used_ns > p->heap[young].used_ns)
				young = k;
		if (young == i)
			return;
		o = p->heap[i];
		p->heap[i] = p->heap[young];
		p->heap[young] = o;
		i = young;
	}
}

static void remember(struct pass *p, const char *path, bool selection, int64_t used_ns, uint64_t bytes)
{
	struct old *to;

	if (!p->heap || strlen(path) >= PATH_SIZE)
		return;
	if (p->n == OLDEST_MAX && used_ns >= p->heap[0].used_ns)
		return;
	to = p->n < OLDEST_MAX ? &p->heap[p->n++] : &p->heap[0];
	*to = (struct old){.used_ns = used_ns, .bytes = bytes, .selection = selection};
	memcpy(to->path, path, strlen(path) + 1);
	if (p->n == OLDEST_MAX)
		for (size_t i = to == &p->heap[0] ? 1 : OLDEST_MAX / 2; i-- > 0;)
			sift_down(p, i);
}

static int oldest_first(const void *a, const void *b)
{
	int64_t x = ((const struct old *)a)->used_ns, y = ((const struct old *)b)->used_ns;

	return x < y ? -1 : x > y;
}

static int64_t used_of(const struct stat *st)
{
	return (int64_t)st->st_mtim.tv_sec * 1000000000 + st->st_mtim.tv_nsec;
}

/* ---- reading the folders ---- */

typedef void found_fn(struct pass *, int dirfd, const char *name, const char *path, const struct stat *);

enum { NAME_MOST = 170 }; /* of an entry; longer ones are nobody's */

struct reading {
	struct pass *pass;
	int fd;
	char path[2 * PATH_SIZE]; /* of that folder, below the one that was read first; then of one of its entries */
	size_t length;            /* of the folder's, with the / behind it */
	unsigned depth;           /* of folders that are read too */
	found_fn *found;
};

static int folder_read(struct pass *p, int parent, const char *name, const char *path, unsigned depth, found_fn *found,
		       struct err *err);

/* What goes away meanwhile is not there. */
static int entry_read(void *ctx, const struct dirent *e, struct err *err)
{
	struct reading *r = ctx;
	size_t n = strnlen(e->d_name, NAME_MOST);
	struct stat st;

	if (io->fstatat(r->fd, e->d_name, &st, AT_SYMLINK_NOFOLLOW) != 0)
		return 0;
	if (n >= sizeof r->path - r->length)
		n = sizeof r->path - r->length - 1;
	*(char *)mempcpy(r->path + r->length, e->d_name, n) = 0;
	if (S_ISDIR(st.st_mode) && r->depth)
		return folder_read(r->pass, r->fd, e->d_name, r->path, r->depth - 1, r->found, err);
	r->found(r->pass, r->fd, e->d_name, r->path, &st);
	return 0;
}

/* Every entry below. */
static int folder_read(struct pass *p, int parent, const char *name, const char *path, unsigned depth, found_fn *found,
		       struct err *err)
{
	struct reading reading = {.pass = p, .depth = depth, .found = found};
	struct err why = ERR_INIT;
	int r = io_open(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, &reading.fd, &why);

	if (r && why.sys == ENOENT)
		return 0;
	if (r) {
		*err = why;
		return r;
	}
	if (*path)
		reading.length = (size_t)snprintf(reading.path, sizeof reading.path, "%.*s/", PATH_SIZE, path);
	r = io_list(reading.fd, ".", entry_read, &reading, err);
	io_close(reading.fd);
	return r;
}

struct sum {
	int fd;
	uint64_t bytes;
};

static int sum_entry(void *ctx, const struct dirent *e, struct err *err)
{
	struct sum *sum = ctx;
	struct stat st;

	if (io->fstatat(sum->fd, e->d_name, &st, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(st.st_mode))
		sum->bytes += (uint64_t)st.st_size;
	return 0;
}

uint64_t space_folder_bytes(int parent, const char *name)
{
	struct err ignored = ERR_INIT;
	struct sum sum = {0};

	if (io_open(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, &sum.fd, &ignored))
		return 0;
	io_list(sum.fd, ".", sum_entry, &sum, &ignored);
	io_close(sum.fd);
	return sum.bytes;
}

static bool temporary(const char *name)
{
	size_t n = strlen(name);

	return n >= 4 && !strcmp(name + n - 4, ".tmp");
}

/* What is being written is in the accounts by what its writer took, and is not there yet. What a crash left counts later. */
static void domain_found(struct pass *p, int dirfd, const char *name, const char *path, const struct stat *st)
{
	if (!S_ISREG(st->st_mode) || (temporary(name) && used_of(st) >= p->before_ns))
		return;
	p->bytes[0] += (uint64_t)st->st_size;
	p->entries[0]++;
	if (p->need == SPACE_MUST || used_of(st) < p->since_ns)
		remember(p, path, false, used_of(st), (uint64_t)st->st_size);
}

static void selection_found(struct pass *p, int dirfd, const char *name, const char *path, const struct stat *st)
{
	char manifest[PATH_SIZE + 16];
	struct stat last;
	uint64_t bytes;

	/* What is being made is not in the accounts of what is there. */
	if (!S_ISDIR(st->st_mode) || !strncmp(name, SPACE_SELECTION_TEMP, strlen(SPACE_SELECTION_TEMP)))
		return;
	snprintf(manifest, sizeof manifest, "%.170s/manifest", name);
	if (io->fstatat(dirfd, manifest, &last, AT_SYMLINK_NOFOLLOW) != 0)
		last = *st;
	bytes = space_folder_bytes(dirfd, name);
	p->bytes[1] += bytes;
	p->entries[1]++;
	if (p->need == SPACE_MUST || !space_is_held(p->space, name))
		remember(p, path, true, used_of(&last), bytes);
}

/* One look at all that is there, which the accounts then say. */
static int look(struct pass *p, struct err *err)
{
	struct space *s = p->space;
	uint64_t before[2];
	int r;

	p->n = 0;
	p->before_ns = clock_real_us() * 1000 - WRITTEN_NS;
	memset(p->bytes, 0, sizeof p->bytes);
	memset(p->entries, 0, sizeof p->entries);
	lock_take(&s->lock);
	for (int k = 0; k < 2; k++)
		before[k] = s->come[SPACE_DOMAINS + k];
	p->since_ns = s->since_us > INT64_MAX / 1000 ? INT64_MAX : s->since_us * 1000;
	lock_give(&s->lock);
	r = folder_read(p, s->p.cachefd, "domains", "", DEPTH_MAX, domain_found, err);
	if (!r)
		r = folder_read(p, s->p.cachefd, "selected", "", 0, selection_found, err);
	if (r)
		return r;
	lock_take(&s->lock);
	for (int k = 0; k < 2; k++) {
		/* What came meanwhile may or may not have been seen: the next pass knows. What is being written was not,
		 * and its writer will give back all that it took. */
		s->taken[SPACE_DOMAINS + k] = p->bytes[k] + s->come[SPACE_DOMAINS + k] - before[k] + s->open[SPACE_DOMAINS + k];
		s->entries[SPACE_DOMAINS + k] = p->entries[k];
	}
	s->measured = true;
	lock_give(&s->lock);
	return 0;
}

/* ---- removing ---- */

static int remove_selection(struct space *s, const char *name, struct err *err)
{
	char temp[PATH_SIZE + 16];
	int fd, r = io_open(s->p.cachefd, "selected", O_RDONLY | O_DIRECTORY, 0, &fd, err);

	if (r)
		return r;
	snprintf(temp, sizeof temp, "%sgone-%.160s", SPACE_SELECTION_TEMP, name);
	/* What an attempt that failed has left there. */
	r = io_folder_remove(fd, temp, err);
	if (!r && io->renameat(fd, name, fd, temp) != 0)
		r = errno == ENOENT ? 0 : err_sys(err, errno, "cannot rename a selection");
	else if (!r)
		r = io_folder_remove(fd, temp, err);
	io_close(fd);
	return r;
}

static int remove_domain(struct space *s, const char *path, struct err *err)
{
	int fd, r = io_open(s->p.cachefd, "domains", O_RDONLY | O_DIRECTORY, 0, &fd, err);

	if (r)
		return r;
	r = io_remove(fd, path, err);
	io_close(fd);
	return r;
}

static void removed(struct space *s, enum space_kind kind, uint64_t bytes)
{
	space_give(s, kind, bytes);
	space_count(s, kind, -1);
	lock_take(&s->lock);
	s->evicted_bytes += bytes;
	s->evicted_files++;
	lock_give(&s->lock);
}

int space_drop_domain(struct space *s, int domainsfd, const struct store_id *id, uint64_t *ret_bytes, struct err *err)
{
	int r = 0;

	lock_take(&s->evicting);
	*ret_bytes = store_size(domainsfd, id);
	if (*ret_bytes)
		r = store_remove(domainsfd, id, err);
	if (*ret_bytes && !r)
		removed(s, SPACE_DOMAINS, *ret_bytes);
	lock_give(&s->evicting);
	return r;
}

static int remove_old(struct space *s, const struct old *o, struct err *err)
{
	enum space_kind kind = o->selection ? SPACE_SELECTIONS : SPACE_DOMAINS;
	int r = o->selection ? remove_selection(s, o->path, err) : remove_domain(s, o->path, err);

	if (r)
		return r;
	removed(s, kind, o->bytes);
	return 0;
}

/* What has to go so that there is room; *ret_more: and some more, so that not each who asks reads the folders. */
static uint64_t to_go(struct space *s, int side, uint64_t bytes, uint64_t *ret_more)
{
	struct space_lack l;
	uint64_t lacks;

	space_ask_side(s, side);
	lock_take(&s->lock);
	l = space_lack_of(s, side, bytes);
	lacks = space_by_cache(s, side, &l);
	lock_give(&s->lock);
	*ret_more = l.by_quota ? l.quota / 32 : l.keep_free / 8;
	return lacks;
}

/* The oldest, up to so many bytes. *ret_any: something was there that may go. */
static int round_of(struct pass *p, uint64_t goal, uint64_t *bytes, uint64_t *files, bool *ret_any, struct err *err)
{
	uint64_t gone = 0, before = *files;
	struct err why = ERR_INIT;
	int r = look(p, err);

	*ret_any = !r && p->n > 0;
	if (r)
		return r;
	qsort(p->heap, p->n, sizeof *p->heap, oldest_first);
	for (size_t i = 0; i < p->n && gone < goal; i++) {
		struct err failed = ERR_INIT;

		if (!remove_old(p->space, &p->heap[i], &failed)) {
			gone += p->heap[i].bytes;
			(*files)++;
		} else if (!why.code) {
			why = failed;
		}
	}
	*bytes += gone;
	/* One that cannot be removed keeps the others' place only when there are no others. */
	if (why.code && *files == before) {
		*err = why;
		return -(int)why.code;
	}
	return 0;
}

static int evict_all(struct pass *p, uint64_t *bytes, uint64_t *files, struct err *err)
{
	bool any = true;
	int r = 0;

	p->need = SPACE_MUST;
	while (!r && any)
		r = round_of(p, UINT64_MAX, bytes, files, &any, err);
	return r;
}

/* First what nobody uses, and some more; then, if it must be, what is in use, as much as is lacking. */
static int evict(struct pass *p, int side, uint64_t need_bytes, enum space_need need, uint64_t *bytes, uint64_t *files,
		 struct err *err)
{
	uint64_t more, lacks = to_go(p->space, side, need_bytes, &more), all = lacks + more;
	int r = 0;

	p->need = SPACE_MAY;
	while (!r && lacks) {
		bool any, last = p->need == SPACE_MUST || *bytes >= all;

		r = round_of(p, last ? lacks : all - *bytes, bytes, files, &any, err);
		lacks = to_go(p->space, side, need_bytes, &more);
		if (!any && p->need == need)
			break;
		if (!any)
			p->need = SPACE_MUST;
	}
	if (!r) {
		lock_take(&p->space->lock);
		p->space->in_vain_ns[need] = lacks ? clock_mono_ns() : 0;
		lock_give(&p->space->lock);
	}
	return r;
}

/* A heap's worth of memory, and the turn to read the folders. */
static int begin(struct pass *p, struct space *s, struct err *err)
{
	*p = (struct pass){.space = s, .heap = malloc(OLDEST_MAX * sizeof *p->heap)};
	if (!p->heap)
		return err_set(err, ERR_NOMEM, "no memory to look for what can be evicted");
	lock_take(&s->evicting);
	return 0;
}

static void end(struct pass *p)
{
	lock_give(&p->space->evicting);
	free(p->heap);
}

int space_evict_for(struct space *s, int side, uint64_t bytes, enum space_need need, uint64_t *ret_bytes, uint64_t *ret_files,
		    struct err *err)
{
	struct pass p;
	int r = begin(&p, s, err);

	*ret_bytes = *ret_files = 0;
	if (r)
		return r;
	r = evict(&p, side, bytes, need, ret_bytes, ret_files, err);
	end(&p);
	if (*ret_files)
		log_event(LOG_EVENT_EVICTED, NULL, "the cache makes room: %llu domains and selections of %llu bytes are removed",
			  (unsigned long long)*ret_files, (unsigned long long)*ret_bytes);
	return r;
}

int space_evict(struct space *s, bool all_derived, uint64_t *ret_bytes, uint64_t *ret_files, struct err *err)
{
	uint64_t bytes = 0, files = 0;
	struct pass p;
	int r = 0;

	*ret_bytes = *ret_files = 0;
	if (all_derived) {
		r = begin(&p, s, err);
		if (r)
			return r;
		r = evict_all(&p, ret_bytes, ret_files, err);
		end(&p);
		return r;
	}
	for (int side = SPACE_SIDES; !r && side-- > 0;) {
		r = space_evict_for(s, side, 0, SPACE_MUST, &bytes, &files, err);
		*ret_bytes += bytes;
		*ret_files += files;
	}
	return r;
}

int space_measure(struct space *s, struct err *err)
{
	struct pass p;
	int r = begin(&p, s, err);

	if (r)
		return r;
	p.need = SPACE_MUST;
	r = look(&p, err);
	end(&p);
	return r;
}

/* ---- what was cut short ---- */

#define LEFT_NS (INT64_C(86400) * 1000000000) /* nobody has written to it for so long */

struct left {
	int64_t before_ns;
	uint64_t bytes, files;
	struct err err;
};

/* Temporary names of stored domains. */
static void left_domain(struct pass *p, int dirfd, const char *name, const char *path, const struct stat *st)
{
	struct left *left = p->ctx;

	if (!S_ISREG(st->st_mode) || !temporary(name) || used_of(st) >= left->before_ns)
		return;
	if (!io_remove(dirfd, name, &left->err)) {
		left->bytes += (uint64_t)st->st_size;
		left->files++;
	}
}

static void left_selection(struct pass *p, int dirfd, const char *name, const char *path, const struct stat *st)
{
	struct left *left = p->ctx;
	uint64_t bytes;

	if (!S_ISDIR(st->st_mode) || strncmp(name, SPACE_SELECTION_TEMP, strlen(SPACE_SELECTION_TEMP)) ||
	    used_of(st) >= left->before_ns)
		return;
	bytes = space_folder_bytes(dirfd, name);
	if (!io_folder_remove(dirfd, name, &left->err)) {
		left->bytes += bytes;
		left->files++;
	}
}

int space_sweep(struct space *s, uint64_t *ret_bytes, uint64_t *ret_files, struct err *err)
{
	struct left left = {.before_ns = clock_real_us() * 1000 - LEFT_NS, .err = ERR_INIT};
	struct pass p;
	int r = begin(&p, s, err);

	*ret_bytes = *ret_files = 0;
	if (r)
		return r;
	p.ctx = &left;
	r = folder_read(&p, s->p.cachefd, "domains", "", DEPTH_MAX, left_domain, err);
	if (!r)
		r = folder_read(&p, s->p.cachefd, "selected", "", 0, left_selection, err);
	end(&p);
	*ret_bytes = left.bytes;
	*ret_files = left.files;
	return r;
}
