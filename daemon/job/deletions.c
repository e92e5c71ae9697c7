/*
 * Rows of jobs that were dropped while the catalogue was loaded.
 *
 * The model: with little memory a start keeps fewer jobs than the catalogue has. It may drop thousands, and the deletion of each
 * row waits for the disk. So their numbers are collected (charged as queued changes are), and rows are deleted in small groups
 * when the catalogue has nothing else to write. After a crash the next start drops the rest again. Their plans are removed with
 * those of all jobs that do not exist (job_plan_file_sweep).
 */
#include <stdlib.h>

#include "job_priv.h"

enum { CHUNK = 512, AT_ONCE = 64 };

int deletions_add(struct jobs *j, uint64_t id, struct err *err)
{
	uint64_t *more;

	if (j->ndeletions == j->deletions_room) {
		if (!ledger_take(j->core->p.ledger, LEDGER_CATALOGUE, CHUNK * sizeof *more))
			return err_set(err, ERR_BUSY, "there is no memory for the numbers of dropped jobs");
		more = realloc(j->deletions, (j->deletions_room + CHUNK) * sizeof *more);
		if (!more) {
			ledger_give(j->core->p.ledger, LEDGER_CATALOGUE, CHUNK * sizeof *more);
			return err_set(err, ERR_NOMEM, "no memory for the numbers of dropped jobs");
		}
		j->deletions = more;
		j->deletions_room += CHUNK;
	}
	j->deletions[j->ndeletions++] = id;
	return 0;
}

void deletions_settle(struct jobs *j)
{
	struct err ignored = ERR_INIT; /* it is tried again in the next round */

	if (!j->ndeletions || catalogue_busy(j->core->p.catalogue))
		return;
	for (unsigned n = 0; n < AT_ONCE && j->ndeletions; n++) {
		if (catalogue_drop_job(j->core->p.catalogue, j->deletions[j->ndeletions - 1], NULL, NULL, &ignored))
			return;
		j->ndeletions--;
	}
	if (!j->ndeletions)
		deletions_free(j);
}

void deletions_free(struct jobs *j)
{
	free(j->deletions);
	if (j->deletions_room)
		ledger_give(j->core->p.ledger, LEDGER_CATALOGUE, j->deletions_room * sizeof *j->deletions);
	j->deletions = NULL;
	j->ndeletions = j->deletions_room = 0;
}
