/*
 * Disk space: what state and cache use, and what they may use. Whoever writes much takes the bytes first. Pushed data is never
 * evicted; derived data is evicted if there is too little space, least recently used first.
 *
 * Bytes are taken as from the ledger of the memory: before they are written, until the file is removed or was not written. All
 * functions may be called by any thread; those that read folders or query file systems may wait, and are for workers.
 */
#ifndef SPACE_H
#define SPACE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "digest.h"

struct err;
struct space;
struct store_id;

/* What the bytes are for. space_kind_text has the names in messages and JSON. */
enum space_kind {
	/* state */
	SPACE_DATASETS, /* segments of named datasets, as the catalogue says */
	SPACE_REMOVED,  /* of removed datasets that can be restored */
	SPACE_PENDING,  /* open and interrupted pushes */
	SPACE_MERGES,   /* segments that a merge or prune is making, line sets of a revert */
	SPACE_PLANS,    /* plans of jobs, geoid grids */
	/* cache */
	SPACE_DOMAINS,    /* finished domains: derived, evicted */
	SPACE_SELECTIONS, /* likewise */
	SPACE_ONESTEP,    /* one-step datasets with their domains */
	SPACE_TEMPORARY,  /* spools, emitters' tables, plans of bound jobs */
	SPACE_KINDS
};
const char *space_kind_text(enum space_kind);
bool space_kind_state(enum space_kind); /* true: below --state; false: below --cache */

/* Bytes, or per cent of the file system. */
struct space_limit {
	enum { SPACE_UNLIMITED, SPACE_BYTES, SPACE_PERCENT } unit;
	uint64_t n;
};
/* "20G" (parse_size) or "80%". most: per cent that are allowed. */
bool space_limit_parse(const char *text, unsigned most, struct space_limit *ret);
/* buf: 32 bytes. Returns buf. */
char *space_limit_text(const struct space_limit *, char *buf);

struct space_params {
	int statefd, cachefd; /* borrowed */
	/* The quota of state and cache together. Per cent: if they are on two file systems, each has that share of its own. */
	struct space_limit disk;
	struct space_limit keep_free; /* of each file system */
};
/* Queries the file systems. */
int space_new(const struct space_params *, struct space **ret, struct err *err);
struct space *space_free(struct space *); /* NULL is fine; returns NULL */
void space_set_limits(struct space *, struct space_limit disk, struct space_limit keep_free);

/* ---- accounts ---- */

/* What may be evicted for the bytes. */
enum space_need {
	SPACE_MAY,  /* for derived data, which need not be written: data that is not in use */
	SPACE_MUST, /* for pushed data, and what a job needs: domains and selections in use, too */
};
/*
 * Takes bytes if quota and keep-free allow it. Evicts first, if that helps. Queries the file system, and may read the cache's
 * folders: workers. -ERR_NOSPACE: "WHAT needs N, M are free: by which limit"; err->need has the missing bytes.
 */
int space_take(struct space *, enum space_kind, uint64_t bytes, enum space_need, const char *what, struct err *err);
void space_give(struct space *, enum space_kind, uint64_t bytes);
/* Replaces taken bytes by the size of the file that now has its final name; 0: nothing came of it. Must follow each taking of
 * domains and selections: until then a pass over the folders does not count them. */
void space_commit(struct space *, enum space_kind, uint64_t taken, uint64_t bytes);
void space_count_entries(struct space *, enum space_kind, int entries); /* added; negative: removed */
/* Taken bytes that are not written yet; negative: they were written or given back. For writing that takes long: others do not
 * count on the same free bytes meanwhile. */
void space_add_unwritten(struct space *, enum space_kind, int64_t bytes);
/* Bytes of a kind that another room counts, beside those that were taken. */
void space_set_counted(struct space *, enum space_kind, uint64_t bytes);
/*
 * Queries the free space of the file systems. One may never answer: workers. space_take and eviction query by themselves;
 * space_would_fit, space_is_exceeded and space_stat use the last answer, so the loop can call them.
 */
void space_query(struct space *);
/* Waits for the answers of a query that began at `since_ns` (clock_mono_ns) or later, until `until_ns` at most. */
void space_query_wait(struct space *, uint64_t since_ns, uint64_t until_ns);
/* Whether space_take would succeed, with eviction if necessary. *ret_missing: bytes, 0 if true. */
bool space_would_fit(struct space *, enum space_kind, uint64_t bytes, uint64_t *ret_missing);
/* Quota or keep-free are exceeded, and eviction helps. */
bool space_is_exceeded(struct space *);
/* The last pass over the folders met files that were being written, and may have counted some twice; none is written now, so
 * that space_measure would be exact. */
bool space_is_inexact(struct space *);

/* Temporary names in cache/selected, of selections that are being made or removed, begin so. */
#define SPACE_SELECTION_TEMP "tmp-"
/* "part-KEY": a simplification that is made, or was interrupted, and can be continued. While KEY is held its run counts it. */
#define SPACE_SELECTION_PART "part-"
/* Marks a selection as in use. Each hold needs a release. */
void space_hold(struct space *, struct digest selection);
void space_release(struct space *, struct digest selection);
/* Domains used since then (realtime, microseconds) are in use by running jobs. INT64_MAX: none. */
void space_running_since(struct space *, int64_t us);

/* ---- eviction and measuring: workers ---- */

/* Removes a stored domain from that folder. *ret_bytes: its size, 0: it was not there. */
int space_remove_domain(struct space *, int domainsfd, const struct store_id *, uint64_t *ret_bytes, struct err *err);
/* Evicts until quota and keep-free hold; all_derived: everything derived. *ret_bytes, *ret_files: what was removed. */
int space_evict(struct space *, bool all_derived, uint64_t *ret_bytes, uint64_t *ret_files, struct err *err);
/* Counts derived files. Until then the accounts have what was written since the start. -ERR_CANCELLED: `stop` was set meanwhile
 * (NULL: never), and the accounts are as before. */
int space_measure(struct space *, const atomic_bool *stop, struct err *err);
/* Removes temporary files that nobody has written to for a day. */
int space_sweep(struct space *, uint64_t *ret_bytes, uint64_t *ret_files, struct err *err);
/* Sum of the lengths of the files in a folder. */
uint64_t space_folder_bytes(int parent, const char *name);

/* ---- reports ---- */

struct space_side {
	uint64_t used, quota; /* quota UINT64_MAX: none */
	uint64_t total, free; /* of the file system */
	uint64_t keep_free;
};
struct space_stat {
	struct {
		uint64_t bytes, entries;
	} kind[SPACE_KINDS]; /* entries: of domains and selections, otherwise 0 */
	struct space_side state, cache;
	bool one_fs; /* both are on one file system, and have the same figures */
	bool measured;
	uint64_t evicted_bytes, evicted_files; /* since the start */
};
void space_stat(struct space *, struct space_stat *ret);

#endif
