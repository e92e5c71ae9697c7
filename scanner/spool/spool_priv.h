/* The bytes of a spool (spool.md), and the writer, as several files share them. */
#ifndef SPOOL_PRIV_H
#define SPOOL_PRIV_H

#include <pthread.h>

#include <nettle/sha2.h>

#include "err.h"
#include "spool.h"

#define SPOOL_MAGIC \
	"\x89"      \
	"ACUTSP\n"

enum {
	SPOOL_VERSION = 1,
	SPOOL_BLOCK = 4096,         /* heads are multiples of it */
	SPOOL_HEAD_MAX = 128 << 10, /* of one of the two heads */
	SPOOL_HEAD_FIXED = 24,      /* magic, version, size, check: the same in every version */
	SPOOL_MARK = 0x1e434552,    /* "REC" and a record separator */
	SPOOL_RECORD_HEAD = 40,
	SPOOL_END_SIZE = 64,
};

/* ---- spool_head.c ---- */

/* A copy of the head, allocated. -ERR_LIMIT: the profile is too long. */
int spool_head_encode(const struct spool_head *, uint8_t **ret, size_t *ret_size, struct err *);
/* Whether `size` bytes are a complete head with a valid check, of any version. */
bool spool_head_whole(const uint8_t *at, size_t size);
int spool_head_decode(const uint8_t *at, size_t size, struct spool_head *ret, struct err *);
void spool_head_fill(struct spool_head *); /* sets id, boot and times that are zero; sanitizes texts */
int spool_head_copy(const struct spool_head *, struct spool_head *ret, struct err *err);
void spool_boot_id(char ret[40]);

/* ---- spool_record.c ---- */

struct spool_mark { /* head of a record */
	enum spool_kind kind;
	unsigned flags;
	uint32_t size;
	uint64_t seq;
	int64_t time_ns;
	uint64_t check; /* of the payload */
};
uint64_t spool_seed(const uint8_t id[16]);
uint64_t spool_check(uint64_t seed, const void *at, size_t size);
void spool_mark_encode(uint64_t seed, const struct spool_mark *, uint8_t ret[SPOOL_RECORD_HEAD]);
bool spool_mark_decode(uint64_t seed, const uint8_t at[SPOOL_RECORD_HEAD], struct spool_mark *ret);

/* ---- spool_writer.c, spool_flush.c ---- */

struct spool_writer {
	int fd;
	char *path;
	uint64_t seed, offset; /* offset of the next record */
	struct spool_totals totals;
	struct sha256_ctx sha;
	uint8_t *buf; /* for a record of ordinary size, so that it is one write */
	bool ended, failed;
	struct err why; /* if failed */

	/* The flusher. `lock` guards what both threads use. */
	pthread_mutex_t lock;
	pthread_cond_t changed;
	pthread_t thread;
	bool running, quit, flush_failed, dirty;
	struct err flush_why;
	uint64_t written, durable; /* bytes of DATA payloads */
	uint64_t due_ns;           /* if dirty: when it must be durable */
	uint64_t every_ns, batch;
	pthread_mutex_t syncing; /* one fsync at a time, so that the second sees that the first has failed */
};
/* A writer at the end of a file; the descriptor belongs to the writer, also on failure. */
int spool_writer_new(int fd, const char *path, const uint8_t id[16], uint64_t offset, struct spool_writer **ret, struct err *);
int spool_writer_count(struct spool_writer *, const struct spool_record *, struct err *); /* counts an existing record */
int spool_flush_init(struct spool_writer *, struct err *);
void spool_flush_stop(struct spool_writer *);
/* After a record was appended: wakes the flusher, and waits for it if too much is not durable. */
int spool_flush_appended(struct spool_writer *, size_t data, struct err *);

#endif
