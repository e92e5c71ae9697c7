/* Spools for tests: records whose bytes follow from their number. */
#ifndef SPOOL_MAKE_H
#define SPOOL_MAKE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "err.h"
#include "spool.h"

enum { MAKE_SIZE_MAX = 400 };

/* A folder for each test, and names of spools in it; make_teardown also restores the file calls. */
extern char make_folder[64], make_path[96], make_other[96];
int make_setup(void **state);
int make_teardown(void **state);

void make_head(struct spool_head *ret);
/* Kind and payload of record `seq`. Every third is an event. */
enum spool_kind make_kind(uint64_t seq);
size_t make_payload(uint64_t seq, uint8_t at[MAKE_SIZE_MAX]);
void make_append(struct spool_writer *, uint64_t seq);
/* A complete spool with n such records, with or without END. */
void make_spool(const char *path, uint64_t n, bool end);
/* Fails unless it is record `seq` as made. */
void make_check(const struct spool_record *);

uint8_t *make_read(const char *path, size_t *ret_size);
void make_write(const char *path, const void *at, size_t size);

struct make_seen {
	uint64_t records;                              /* that were complete; each is checked if it is from make_append */
	uint64_t others;                               /* "continued", CLOCK, END */
	uint64_t prefix;                               /* records before the first lost one */
	uint64_t damages, first_damage, skipped, next; /* next: number after the last */
	struct spool_tail tail;
	int error;
};
/* Reads all of it, skipping damage. `base`: numbers from here on are not checked (after a continue). */
void make_read_all(const char *path, uint64_t base, struct make_seen *ret);

#endif
