/* The records of a plan's file (format.md, "Plans"), shared by the files of this room. */
#ifndef PLAN_RECORD_H
#define PLAN_RECORD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "plan_file.h"

enum { PLAN_RECORD = 104, PLAN_NAME = 32 };
enum { PLAN_HEAD = 1, PLAN_LEAF, PLAN_WHOLE, PLAN_HALF, PLAN_DONE };
#define PLAN_MAGIC UINT32_C(0x4e504341) /* "ACPN" */
#define PLAN_VERSION UINT16_C(1)

struct plan_head {
	uint64_t job, generation, n;
	struct plan_kept kept;
	struct digest leaves;
};

bool plan_record_sealed(const uint8_t record[PLAN_RECORD]); /* its checksum agrees */
void plan_head_pack(const struct plan_head *, uint8_t record[PLAN_RECORD]);
bool plan_head_unpack(const uint8_t record[PLAN_RECORD], struct plan_head *ret);
/* `kind`: PLAN_LEAF, PLAN_WHOLE or PLAN_HALF. */
void plan_leaf_pack(unsigned kind, const struct cut_leaf *, uint8_t record[PLAN_RECORD]);
bool plan_leaf_unpack(unsigned kind, const uint8_t record[PLAN_RECORD], struct cut_leaf *ret);
void plan_done_pack(const struct plan_done *, uint8_t record[PLAN_RECORD]);
bool plan_done_unpack(const uint8_t record[PLAN_RECORD], struct plan_done *ret);
/* Reads what follows the leaves at offset `at`: one record of a finished domain, or the three records of a split.
 * *ret_size 0: no complete record follows. */
int plan_record_next(const char *name, int fd, uint64_t at, uint8_t record[3 * PLAN_RECORD], size_t *ret_size, struct err *err);

#endif
