/*
 * The disk: what state and cache hold, what they may hold, and the one question that everybody asks before writing
 * much. What was pushed is never evicted; what is derived goes, least recently used first, when there is too much.
 *
 * Whoever is about to write takes the bytes (space_take), as of the ledger: they stay taken as long as what was written
 * lies there, and are given back when it goes or was never written. Any thread may call all of it.
 */
#ifndef SPACE_H
#define SPACE_H

#include <stdbool.h>
#include <stdint.h>

#include "digest.h"

struct err;
struct space;

/* What it is for. Wire and JSON names: space_kind_text. */
enum space_kind {
	/* state */
	SPACE_DATASETS, /* segments of named datasets, as the catalogue says */
	SPACE_REMOVED,  /* of datasets that were removed and can be restored */
	SPACE_PENDING,  /* pushes that go on or were interrupted */
	SPACE_MERGES,   /* segments that a merge or prune is making */
	SPACE_PLANS,    /* plans of jobs, geoid grids */
	/* cache */
	SPACE_DOMAINS,    /* finished domains: derived, evicted */
	SPACE_SELECTIONS, /* likewise */
	SPACE_ONESTEP,    /* one-step datasets with their domains */
	SPACE_TEMPORARY,  /* spools, emitters' tables, plans of bound jobs */
	SPACE_KINDS
};
const char *space_kind_text(enum space_kind);
bool space_kind_state(enum space_kind); /* below --state; else below --cache */

/* A size, or hundredths of the file system. */
struct space_limit {
	enum { SPACE_UNLIMITED, SPACE_BYTES, SPACE_PERCENT } unit;
	uint64_t n;
};
/* "20G" (parse_size) or "80%", of at most `most` percent. */
bool space_limit_parse(const char *text, unsigned most, struct space_limit *ret);
char *space_limit_text(const struct space_limit *, char *buf); /* 32 bytes */

struct space_params {
	int statefd, cachefd; /* borrowed */
	/* Of state and cache together. Percent: of each one's file system, where these differ a share for each. */
	struct space_limit disk;
	struct space_limit keep_free; /* of each file system */
};
int space_new(const struct space_params *, struct space **ret, struct err *err);
struct space *space_free(struct space *);
void space_set_limits(struct space *, struct space_limit disk, struct space_limit keep_free);

/* ---- asking ---- */

/* How much it matters: what may be evicted to make room. */
enum space_need {
	SPACE_MAY,  /* derived data that can be left out: evicts what nobody uses now */
	SPACE_MUST, /* pushed data, and what a job cannot go on without: evicts domains and selections in use too */
};
/*
 * Takes `bytes` if quota and keep-free allow it, after evicting if that helps (reads the cache's folders then: workers
 * only). -ERR_NOSPACE: "WHAT needs N, M are free: by which limit"; err->need is what is lacking, in bytes.
 */
int space_take(struct space *, enum space_kind, uint64_t bytes, enum space_need, const char *what, struct err *err);
void space_give(struct space *, enum space_kind, uint64_t bytes);
/* What was taken so has come to so many, under its name. To be called for all that is taken of domains and selections,
 * also when nothing comes of it: until then it is not looked for in the folders. */
void space_change(struct space *, enum space_kind, uint64_t taken, uint64_t bytes);
void space_count(struct space *, enum space_kind, int entries); /* that came, or went */
/* Bytes that were taken and are not on the disk yet: to be called with what was taken, and with less (negative) as it
 * is written or given back. Only of what takes long, so that others do not count on the same free bytes. */
void space_promise(struct space *, enum space_kind, int64_t bytes);
/*
 * What the file systems have is asked by workers, and kept: a file system may never answer. Whoever takes or evicts has just
 * asked; space_would, space_over and space_stat go by the last answer, so the loop can call them.
 */
void space_ask(struct space *);
/* Waits until a question that began at `since_ns` (clock_mono_ns) or later is answered, or that time has come. */
void space_ask_wait(struct space *, uint64_t since_ns, uint64_t until_ns);
/* Beside what was taken there is so much of it that others keep count of. */
void space_set(struct space *, enum space_kind, uint64_t bytes);
/* Whether space_take would succeed, without evicting anything yet; *ret_lacks: bytes that it lacks, 0 if so. */
bool space_would(struct space *, enum space_kind, uint64_t bytes, uint64_t *ret_lacks);

/* Folders in which a selection is being made, or removed, have names that begin so. */
#define SPACE_SELECTION_TEMP "tmp-"
/* A selection that somebody reads is evicted last. Balanced. */
void space_hold(struct space *, struct digest selection);
void space_release(struct space *, struct digest selection);
/* Domains that were used since then (realtime, microseconds) are of jobs that run: they go last. INT64_MAX: none. */
void space_running_since(struct space *, int64_t us);

/* ---- evicting and measuring: workers ---- */

/* A stored domain in that folder goes. *ret_bytes: 0 = it was not there. */
struct store_id;
int space_drop_domain(struct space *, int domainsfd, const struct store_id *, uint64_t *ret_bytes, struct err *err);
/* Evicts until quota and keep-free hold again, if they do not; all_derived: everything derived goes.
 * *ret_bytes, *ret_files: what went. */
int space_evict(struct space *, bool all_derived, uint64_t *ret_bytes, uint64_t *ret_files, struct err *err);
/* Reads sizes and numbers of what is derived; until then it counts as far as it was written since the start. */
int space_measure(struct space *, struct err *err);
bool space_over(struct space *); /* quota or keep-free do not hold: space_evict has work */

/* Removes what was cut short and nobody works at any more. */
int space_sweep(struct space *, uint64_t *ret_bytes, uint64_t *ret_files, struct err *err);
/* Lengths of the files in a folder. */
uint64_t space_folder_bytes(int parent, const char *name);

/* ---- telling ---- */

struct space_side {
	uint64_t used, quota; /* of what counts there; quota UINT64_MAX: none */
	uint64_t total, free; /* of the file system */
	uint64_t keep_free;
};
struct space_stat {
	struct {
		uint64_t bytes, entries;
	} kind[SPACE_KINDS]; /* entries: of DOMAINS and SELECTIONS; else 0 */
	struct space_side state, cache;
	bool one; /* both lie on one file system: the two are the same */
	bool measured;
	uint64_t evicted_bytes, evicted_files; /* since the start */
};
void space_stat(struct space *, struct space_stat *ret);

#endif
