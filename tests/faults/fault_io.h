/*
 * The disk as tests want it: a table of file calls (base/io.h) and a file system for SQLite (a shim VFS) over the same
 * switchboard. Both do what the system does in a real folder, and beside that
 *   - any call fails as asked: the N-th of all or of some kinds, once or for ever, with an error, or half done;
 *   - all that changes files and folders below one root is written into a log, from which disk_states.h makes what a disk
 *     may hold after a power cut at any of its entries.
 * fsync itself costs nothing here: the log knows it.
 */
#ifndef FAULT_IO_H
#define FAULT_IO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum fault_call {
	FAULT_OPEN,
	FAULT_CLOSE,
	FAULT_READ,
	FAULT_WRITE,
	FAULT_SYNC,
	FAULT_RENAME,
	FAULT_UNLINK,
	FAULT_TRUNCATE,
	FAULT_STAT, /* and faccessat, fstatvfs */
	FAULT_MKDIR,
	FAULT_PUNCH,
	FAULT_LINK,
	FAULT_TIMES,
	FAULT_LIST, /* readdir */
	FAULT_COPY,
	FAULT_LOCK,
	/* SQLite's */
	FAULT_SQL_OPEN,
	FAULT_SQL_READ,
	FAULT_SQL_WRITE,
	FAULT_SQL_SYNC,
	FAULT_SQL_OTHER,
	FAULT_CALLS
};

#define FAULT_ALL (~0u)
#define FAULT_OURS ((1u << FAULT_SQL_OPEN) - 1)
#define FAULT_SQL (FAULT_ALL & ~FAULT_OURS)

/* From here on `io` and SQLite's default VFS are these. Once a process. */
void fault_io_start(void);

struct fault_plan {
	unsigned kinds;      /* bits of fault_call */
	unsigned long at;    /* counted over these kinds from 1; 0: none fails */
	bool for_ever, half; /* half: a transfer is done by half first */
	int error;
};
void fault_plan(const struct fault_plan *); /* counting begins anew; NULL: nothing fails */
unsigned long fault_calls(void);            /* of the plan's kinds, since then */
unsigned long fault_failed(void);           /* how many of them failed */
enum fault_call fault_first(void);          /* which kind failed first */
/* Files whose fsync failed and that were synced again or got their final name all the same; while the log is on. */
unsigned long fault_distrusted(void);
const char *fault_call_text(enum fault_call);

/* ---- the log ---- */

enum disk_op { DISK_CREATE, DISK_WRITE, DISK_SIZE, DISK_SYNC, DISK_RENAME, DISK_UNLINK, DISK_LINK, DISK_MARK };
struct disk_entry {
	enum disk_op op;
	unsigned node;      /* of the file or folder; 0 is the root */
	unsigned dir, dir2; /* CREATE, UNLINK, LINK: where; RENAME: from dir to dir2 */
	char *name, *name2;
	bool folder;
	uint64_t at, n; /* WRITE; SIZE: n; MARK: n is the mark */
	uint8_t *data;
};
/* Logs what changes below `root`, an absolute path. What is there already counts as safe. */
void fault_log_start(const char *root);
void fault_log_stop(void);
void fault_mark(uint64_t mark); /* something was acknowledged */
size_t fault_log(const struct disk_entry **ret);

#endif
