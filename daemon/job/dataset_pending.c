/* Interrupted pushes of a dataset. */
#include <stdlib.h>

#include "job_priv.h"

struct pending *pending_new(struct jobs *j, uint32_t uid, struct err *err)
{
	struct pending *q;

	THREAD_LOOP_ONLY();
	if (charge_lasting(j->core, CHARGE_JOB, uid, PENDING_BYTES, "another push", err))
		return NULL;
	q = calloc(1, sizeof *q);
	if (!q) {
		uncharge(j->core, PENDING_BYTES);
		err_set(err, ERR_NOMEM, "no memory for a push");
	}
	return q;
}

struct pending *pending_free(struct jobs *j, struct pending *q)
{
	THREAD_LOOP_ONLY();
	if (q)
		uncharge(j->core, PENDING_BYTES);
	free(q);
	return NULL;
}
