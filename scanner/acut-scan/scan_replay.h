/* Shared by the files of replay: scan_replay.c reads the records, scan_replay_out.c writes their content,
 * scan_replay_report.c reports the findings. */
#ifndef SCAN_REPLAY_H
#define SCAN_REPLAY_H

#include "err.h"
#include "replay.h"
#include "scan.h"
#include "scan_source.h"
#include "spool.h"

enum { SCAN_FAULTS = 20, SCAN_EVENTS = 16 };

struct scan_fault {
	uint64_t offset, size;
	char text[160];
};

/* The findings in one spool. */
struct scan_found {
	const char *file;
	struct spool_head head;
	struct profile profile;
	bool decoded; /* there is a profile with a decoder; why not: */
	struct err why;
	struct replay_counts counts; /* of decoded ones */
	uint64_t records, transfers, bytes, damaged, damaged_bytes;
	struct {
		char word[16];
		uint64_t n;
	} events[SCAN_EVENTS];
	size_t n_events;
	int64_t first_ns, last_ns; /* of DATA */
	char sha256[65];           /* of the payloads of DATA */
	bool sha_differs;          /* the END record has another one */
	struct spool_tail tail;
	struct scan_fault faults[SCAN_FAULTS];
	uint64_t n_faults; /* all */
	double seconds;    /* that it took */
};
void scan_replay_report(struct program *, const struct scan_found *);

/* ---- writing out ---- */

enum scan_to { SCAN_TO_NOTHING, SCAN_TO_RAW, SCAN_TO_TELEGRAMS, SCAN_TO_SWEEPS, SCAN_TO_CSV, SCAN_TO_POINTS };
struct scan_out;
/* By args->to and args->output ("-" or NULL: standard output); a file is never written over. */
int scan_out_new(struct program *, struct scan_out **ret, struct err *);
enum scan_to scan_out_to(const struct scan_out *);
/* 0, or -1: scan_out_free has the error. */
int scan_out_raw(struct scan_out *, const void *, size_t);
int scan_out_telegram(struct scan_out *, const struct telegram *, double utc_s);
int scan_out_sweep(struct scan_out *, const struct replay_sweep *);
int scan_out_points(struct scan_out *, const struct profile *, const struct telegram *);
/* The LAS file that was begun has no end: it is taken away. */
void scan_out_broken(struct scan_out *);
/* Sees to it that all is written; what is not whole, or was not good, is removed. */
int scan_out_free(struct scan_out *, bool good, struct err *);

#endif
