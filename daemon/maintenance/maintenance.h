/*
 * Maintenance of the disk: its use, verification of all files, removal of what is not needed. All functions belong to the loop;
 * workers read the files.
 */
#ifndef MAINTENANCE_H
#define MAINTENANCE_H

#include "core.h"

struct datasets;
struct jobs;
struct maintenance;

/* Reads the result of the last verification. */
int maintenance_new(struct core *, struct datasets *, struct jobs *, struct maintenance **ret, struct err *err);
struct maintenance *maintenance_free(struct maintenance *); /* NULL is fine; returns NULL */
void maintenance_tick(struct maintenance *);

/* The last verification that was completed; kept over restarts. */
struct verified {
	int64_t at_us;                                  /* real time; 0: never */
	uint64_t files, bytes, damaged, derived, newer; /* newer: pushed files of a newer version */
};
const struct verified *maintenance_verified(const struct maintenance *);

struct cache_stat {
	struct space_stat space;      /* with the numbers of datasets, pending pushes and one-step datasets */
	char disk[32], keep_free[32]; /* the limits as they were configured; "none" */
};
void cache_stat(struct maintenance *, struct cache_stat *ret);

/* One damaged file; or one of a newer version (err.code is ERR_VERSION), which stays as it is. */
struct cache_damage {
	const char *what;     /* "manifest", "segment", "push", "plan", "domain", "selection", "catalogue" */
	char dataset[64 + 1]; /* "": none */
	struct err err;       /* file, place, reason */
	bool derived;         /* it can be made again */
	bool removed;         /* because it is derived */
};
struct cache_verified {
	uint64_t files, bytes, damaged, derived;
	uint64_t newer, derived_newer; /* of a newer version; not counted as damaged */
};
struct cache_verify_calls {
	void (*damage)(void *token, const struct cache_damage *);
	void (*progress)(void *token, const char *phase, uint64_t bytes, uint64_t total); /* total: as far as it is known */
	/* Called once. `why`: it was ended, or could not go on. */
	void (*over)(void *token, const struct err *why, const struct cache_verified *);
};
struct cache_verify;
/* Reads all of state and cache, at the lowest priority. -ERR_PERM: not an administrator; -ERR_BUSY: a verification is running
 * already. */
int cache_verify(struct maintenance *, const struct peer *, const struct cache_verify_calls *, void *token,
		 struct cache_verify **ret, struct err *err);
void cache_verify_end(struct cache_verify *); /* ends it soon; `over` is called all the same */
/* What came of a pack (store_pack.h). */
struct cache_adopted {
	uint64_t domains, bytes; /* that are in the store now */
	uint64_t there;          /* were in it already */
	uint64_t flat;           /* are of a survey without triangles, which no store has */
};
struct cache_adopt_calls {
	void (*progress)(void *token, const char *phase, uint64_t bytes, uint64_t total);
	/* Called once. `why`: not all was taken. */
	void (*over)(void *token, const struct err *why, const struct cache_adopted *);
};
struct cache_adopt;
/* Takes the finished domains of a pack into the store; takes `fd` if it succeeds. -ERR_PERM: not an administrator. No call comes
 * before it has returned. */
int cache_adopt(struct maintenance *, const struct peer *, int fd, const char *name, const struct cache_adopt_calls *,
		void *token, struct cache_adopt **ret, struct err *err);
void cache_adopt_end(struct cache_adopt *); /* ends it soon; `over` is called all the same, perhaps at once */
/* Removes what is not needed; all: everything derived. -ERR_PERM as above. */
void cache_gc(struct maintenance *, const struct peer *, bool all,
	      void (*freed)(void *token, const struct err *why, uint64_t bytes, uint64_t entries), void *token);

#endif
