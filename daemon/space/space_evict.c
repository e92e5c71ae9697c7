/*
 * Eviction of stored domains and selections, least recently used first.
 *
 * The model: the time of the last use is the modification time of a domain's file, or of a selection's `manifest`. A pass reads
 * the folders and keeps the oldest few hundred entries in a heap of fixed size. They are removed, the oldest first, until there
 * is enough space and a reserve, so that the next writer need not read the folders again. If that was not enough, there is
 * another pass. Each pass counts everything, so it also corrects the accounts for files that somebody else removed. A selection
 * is renamed before it is removed, so nobody opens an incomplete one; readers that have it open continue.
 *
 * Entries in use are evicted last, and only for data that must be written: selections that are held (space_hold), and domains
 * that were used since the oldest running job began.
 */
#include <assert.h>
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

#define WRITTEN_NS (INT64_C(60) * 1000000000) /* writing a domain takes milliseconds */

struct old_entry {
	int64_t used_ns;
	uint64_t bytes;
	bool selection;
	char path[PATH_SIZE]; /* below `domains` or `selected` */
};

struct evict_pass {
	struct space *space;
	void *ctx;
	enum space_need need;
	const atomic_bool *stop; /* NULL: the pass does not end early */
	int64_t since_ns;        /* domains used since then are in use */
	int64_t before_ns;       /* temporary files changed since then are being written */
	size_t n;
	struct old_entry *heap;        /* the youngest is the first */
	uint64_t bytes[2], entries[2]; /* of domains, selections */
};

/* ---- the oldest ---- */

static void sift_down(struct evict_pass *p, size_t i)
{
	for (;;) {
		size_t young = i;
		struct old_entry o;

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

static void keep_old(struct evict_pass *p, const char *path, bool selection, int64_t used_ns, uint64_t bytes)
{
	struct old_entry *to;

	if (!p->heap || strlen(path) >= PATH_SIZE)
		return;
	if (p->n == OLDEST_MAX && used_ns >= p->heap[0].used_ns)
		return;
	to = p->n < OLDEST_MAX ? &p->heap[p->n++] : &p->heap[0];
	*to = (struct old_entry){.used_ns = used_ns, .bytes = bytes, .selection = selection};
	memcpy(to->path, path, strlen(path) + 1);
	if (p->n == OLDEST_MAX)
		for (size_t i = to == &p->heap[0] ? 1 : OLDEST_MAX / 2; i-- > 0;)
			sift_down(p, i);
}

static int oldest_first(const void *a, const void *b)
{
	int64_t x = ((const struct old_entry *)a)->used_ns, y = ((const struct old_entry *)b)->used_ns;

	return x < y ? -1 : x > y;
}

static int64_t used_of(const struct stat *st)
{
	return (int64_t)st->st_mtim.tv_sec * 1000000000 + st->st_mtim.tv_nsec;
}

/* ---- reading the folders ---- */

typedef void found_fn(struct evict_pass *, int dirfd, const char *name, const char *path, const struct stat *);

enum { NAME_MOST = 170 }; /* of an entry; entries with longer names are not ours */

struct reading {
	struct evict_pass *pass;
	int fd;
	char path[2 * PATH_SIZE]; /* of the folder, below the one that the pass began with; then of one of its entries */
	size_t length;            /* of the folder's path, with its last / */
	unsigned depth;           /* of subfolders that are read */
	found_fn *found;
};

static int folder_read(struct evict_pass *p, int parent, const char *name, const char *path, unsigned depth, found_fn *found,
		       struct err *err);

/* An entry that is removed meanwhile is skipped. */
static int entry_read(void *ctx, const struct dirent *e, struct err *err)
{
	struct reading *r = ctx;
	size_t n = strnlen(e->d_name, NAME_MOST);
	struct stat st;

	if (r->pass->stop && atomic_load(r->pass->stop))
		return err_set(err, ERR_CANCELLED, "the reading of the cache was cancelled");
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

/* Calls `found` for every file below. */
static int folder_read(struct evict_pass *p, int parent, const char *name, const char *path, unsigned depth, found_fn *found,
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

static bool is_temporary(const char *name)
{
	size_t n = strlen(name);

	return n >= 4 && !strcmp(name + n - 4, ".tmp");
}

/* A file that is being written is in the accounts by what its writer took, so it is not counted. One that a crash left is counted
 * later. */
static void domain_found(struct evict_pass *p, int dirfd, const char *name, const char *path, const struct stat *st)
{
	if (!S_ISREG(st->st_mode) || (is_temporary(name) && used_of(st) >= p->before_ns))
		return;
	p->bytes[0] += (uint64_t)st->st_size;
	p->entries[0]++;
	if (p->need == SPACE_MUST || used_of(st) < p->since_ns)
		keep_old(p, path, false, used_of(st), (uint64_t)st->st_size);
}

static void selection_found(struct evict_pass *p, int dirfd, const char *name, const char *path, const struct stat *st)
{
	const size_t part = strlen(SPACE_SELECTION_PART);
	char manifest[PATH_SIZE + 16];
	struct stat last;
	uint64_t bytes;

	/* Selections that are being made are in the accounts by what was taken. */
	if (!S_ISDIR(st->st_mode) || !strncmp(name, SPACE_SELECTION_TEMP, strlen(SPACE_SELECTION_TEMP)))
		return;
	if (!strncmp(name, SPACE_SELECTION_PART, part) && space_is_held(p->space, name + part))
		return;
	snprintf(manifest, sizeof manifest, "%.170s/manifest", name);
	if (io->fstatat(dirfd, manifest, &last, AT_SYMLINK_NOFOLLOW) != 0)
		last = *st;
	bytes = space_folder_bytes(dirfd, name);
	p->bytes[1] += bytes;
	p->entries[1]++;
	if (p->need == SPACE_MUST || !space_is_held(p->space, name))
		keep_old(p, path, true, used_of(&last), bytes);
}

/* Reads all folders once, and corrects the accounts. */
static int read_all(struct evict_pass *p, struct err *err)
{
	struct space *s = p->space;
	uint64_t before[2];
	bool inexact = false;
	int r;

	assert(lock_held(LOCK_EVICT));
	p->n = 0;
	p->before_ns = clock_real_us() * 1000 - WRITTEN_NS;
	memset(p->bytes, 0, sizeof p->bytes);
	memset(p->entries, 0, sizeof p->entries);
	lock_take(&s->lock);
	for (int k = 0; k < 2; k++) {
		before[k] = s->committed[SPACE_DOMAINS + k];
		inexact |= s->uncommitted[SPACE_DOMAINS + k] > 0;
	}
	p->since_ns = s->running_since_us > INT64_MAX / 1000 ? INT64_MAX : s->running_since_us * 1000;
	lock_give(&s->lock);
	r = folder_read(p, s->p.cachefd, "domains", "", DEPTH_MAX, domain_found, err);
	if (!r)
		r = folder_read(p, s->p.cachefd, "selected", "", 0, selection_found, err);
	if (r)
		return r;
	lock_take(&s->lock);
	for (int k = 0; k < 2; k++) {
		/* Files that were committed meanwhile, or have their final name and are not committed, may or may not have been
		 * seen: they count here, and the next pass corrects that. Of others that are being written, their writers will
		 * give back all that they took. */
		s->taken[SPACE_DOMAINS + k] =
			p->bytes[k] + s->committed[SPACE_DOMAINS + k] - before[k] + s->uncommitted[SPACE_DOMAINS + k];
		s->entries[SPACE_DOMAINS + k] = p->entries[k];
		inexact |= s->uncommitted[SPACE_DOMAINS + k] || s->committed[SPACE_DOMAINS + k] != before[k];
	}
	s->measured = true;
	s->inexact = inexact;
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
	/* A failed attempt may have left that name. */
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

static void count_removed(struct space *s, enum space_kind kind, uint64_t bytes)
{
	space_give(s, kind, bytes);
	space_count_entries(s, kind, -1);
	lock_take(&s->lock);
	s->evicted_bytes += bytes;
	s->evicted_files++;
	lock_give(&s->lock);
}

int space_remove_domain(struct space *s, int domainsfd, const struct store_id *id, uint64_t *ret_bytes, struct err *err)
{
	int r = 0;

	lock_take(&s->evicting);
	*ret_bytes = store_size(domainsfd, id);
	if (*ret_bytes)
		r = store_remove(domainsfd, id, err);
	if (*ret_bytes && !r)
		count_removed(s, SPACE_DOMAINS, *ret_bytes);
	lock_give(&s->evicting);
	return r;
}

static int remove_old(struct space *s, const struct old_entry *o, struct err *err)
{
	enum space_kind kind = o->selection ? SPACE_SELECTIONS : SPACE_DOMAINS;
	int r = o->selection ? remove_selection(s, o->path, err) : remove_domain(s, o->path, err);

	if (r)
		return r;
	count_removed(s, kind, o->bytes);
	return 0;
}

/* Bytes to evict for `bytes` more; *ret_more: a reserve, so that not every writer reads the folders. */
static uint64_t bytes_to_evict(struct space *s, int side, uint64_t bytes, uint64_t *ret_more)
{
	struct space_shortage l;
	uint64_t missing;

	space_query_side(s, side);
	lock_take(&s->lock);
	l = space_shortage_of(s, side, bytes);
	missing = space_evictable(s, side, &l);
	lock_give(&s->lock);
	*ret_more = l.by_quota ? l.quota / 32 : l.keep_free / 8;
	return missing;
}

/* Removes the oldest entries, up to so many bytes. *ret_any: there was something that may be removed. */
static int evict_round(struct evict_pass *p, uint64_t goal, uint64_t *bytes, uint64_t *files, bool *ret_any, struct err *err)
{
	uint64_t gone = 0, before = *files;
	struct err why = ERR_INIT;
	int r = read_all(p, err);

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
	/* Entries that cannot be removed are an error only if nothing was removed. */
	if (why.code && *files == before) {
		*err = why;
		return -(int)why.code;
	}
	return 0;
}

static int evict_all(struct evict_pass *p, uint64_t *bytes, uint64_t *files, struct err *err)
{
	bool any = true;
	int r = 0;

	p->need = SPACE_MUST;
	while (!r && any)
		r = evict_round(p, UINT64_MAX, bytes, files, &any, err);
	return r;
}

/* First entries that are not in use, with a reserve. Then, if necessary and allowed, entries in use, without one. */
static int evict_on_side(struct evict_pass *p, int side, uint64_t need_bytes, enum space_need need, uint64_t *bytes,
			 uint64_t *files, struct err *err)
{
	uint64_t more, missing = bytes_to_evict(p->space, side, need_bytes, &more), all = missing + more;
	int r = 0;

	p->need = SPACE_MAY;
	while (!r && missing) {
		bool any, last = p->need == SPACE_MUST || *bytes >= all;

		r = evict_round(p, last ? missing : all - *bytes, bytes, files, &any, err);
		missing = bytes_to_evict(p->space, side, need_bytes, &more);
		if (!any && p->need == need)
			break;
		if (!any)
			p->need = SPACE_MUST;
	}
	if (!r) {
		lock_take(&p->space->lock);
		p->space->futile_ns[need] = missing ? clock_mono_ns() : 0;
		lock_give(&p->space->lock);
	}
	return r;
}

/* Allocates the heap, and takes the lock for reading the folders. */
static int begin_pass(struct evict_pass *p, struct space *s, struct err *err)
{
	*p = (struct evict_pass){.space = s, .heap = malloc(OLDEST_MAX * sizeof *p->heap)};
	if (!p->heap)
		return err_set(err, ERR_NOMEM, "no memory to find what can be evicted");
	lock_take(&s->evicting);
	return 0;
}

static void end_pass(struct evict_pass *p)
{
	lock_give(&p->space->evicting);
	free(p->heap);
}

int space_evict_for(struct space *s, int side, uint64_t bytes, enum space_need need, uint64_t *ret_bytes, uint64_t *ret_files,
		    struct err *err)
{
	struct evict_pass p;
	int r = begin_pass(&p, s, err);

	*ret_bytes = *ret_files = 0;
	if (r)
		return r;
	r = evict_on_side(&p, side, bytes, need, ret_bytes, ret_files, err);
	end_pass(&p);
	if (*ret_files)
		log_event(LOG_EVENT_EVICTED, NULL, "the cache makes room: %llu domains and selections of %llu bytes are removed",
			  (unsigned long long)*ret_files, (unsigned long long)*ret_bytes);
	return r;
}

int space_evict(struct space *s, bool all_derived, uint64_t *ret_bytes, uint64_t *ret_files, struct err *err)
{
	uint64_t bytes = 0, files = 0;
	struct evict_pass p;
	int r = 0;

	*ret_bytes = *ret_files = 0;
	if (all_derived) {
		r = begin_pass(&p, s, err);
		if (r)
			return r;
		r = evict_all(&p, ret_bytes, ret_files, err);
		end_pass(&p);
		return r;
	}
	for (int side = SPACE_SIDES; !r && side-- > 0;) {
		r = space_evict_for(s, side, 0, SPACE_MUST, &bytes, &files, err);
		*ret_bytes += bytes;
		*ret_files += files;
	}
	return r;
}

int space_measure(struct space *s, const atomic_bool *stop, struct err *err)
{
	struct evict_pass p;
	int r = begin_pass(&p, s, err);

	if (r)
		return r;
	p.need = SPACE_MUST;
	p.stop = stop;
	r = read_all(&p, err);
	end_pass(&p);
	return r;
}

/* ---- leftovers ---- */

#define LEFT_NS (INT64_C(86400) * 1000000000) /* a temporary file without writes for so long is a leftover */

struct leftovers {
	int64_t before_ns;
	uint64_t bytes, files;
	struct err err;
};

/* Removes temporary files of stored domains. */
static void sweep_domain(struct evict_pass *p, int dirfd, const char *name, const char *path, const struct stat *st)
{
	struct leftovers *left = p->ctx;

	if (!S_ISREG(st->st_mode) || !is_temporary(name) || used_of(st) >= left->before_ns)
		return;
	if (!io_remove(dirfd, name, &left->err)) {
		left->bytes += (uint64_t)st->st_size;
		left->files++;
	}
}

static void sweep_selection(struct evict_pass *p, int dirfd, const char *name, const char *path, const struct stat *st)
{
	struct leftovers *left = p->ctx;
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
	struct leftovers left = {.before_ns = clock_real_us() * 1000 - LEFT_NS, .err = ERR_INIT};
	struct evict_pass p;
	int r = begin_pass(&p, s, err);

	*ret_bytes = *ret_files = 0;
	if (r)
		return r;
	p.ctx = &left;
	r = folder_read(&p, s->p.cachefd, "domains", "", DEPTH_MAX, sweep_domain, err);
	if (!r)
		r = folder_read(&p, s->p.cachefd, "selected", "", 0, sweep_selection, err);
	end_pass(&p);
	*ret_bytes = left.bytes;
	*ret_files = left.files;
	return r;
}
