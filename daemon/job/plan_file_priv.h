/* The records of a plan's file, shared by plan_file.c and plan_done.c (FORMAT.md, "Plans"). */
#ifndef PLAN_FILE_PRIV_H
#define PLAN_FILE_PRIV_H

#include <stddef.h>

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

void plan_record_seal(uint8_t record[PLAN_RECORD]);
bool plan_record_sealed(const uint8_t record[PLAN_RECORD]);
bool plan_head_unpack(const uint8_t record[PLAN_RECORD], struct plan_head *ret);
void plan_done_pack(const struct plan_done *, uint8_t record[PLAN_RECORD]);
/* Behind the leaves: one record of a finished domain, or the three of a split; *ret_size 0: nothing whole comes any
 * more. */
int plan_record_next(const char *name, int fd, uint64_t at, uint8_t record[3 * PLAN_RECORD], size_t *ret_size, struct err *err);

#endif
