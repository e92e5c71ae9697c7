/* The room's state. */
#include <stdlib.h>

#include "maintenance_priv.h"

int maintenance_new(struct core *core, struct datasets *datasets, struct jobs *jobs, struct maintenance **ret, struct err *err)
{
	struct maintenance *m = calloc(1, sizeof *m);

	if (!m)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	*m = (struct maintenance){.core = core, .datasets = datasets, .jobs = jobs};
	verified_load(m);
	*ret = m;
	return 0;
}

struct maintenance *maintenance_free(struct maintenance *m)
{
	free(m);
	return NULL;
}

void maintenance_tick(struct maintenance *m)
{
	cache_verify_tick(m);
	cache_adopt_tick(m);
}

const struct verified *maintenance_verified(const struct maintenance *m)
{
	return &m->verified;
}
