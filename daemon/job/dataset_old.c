/*
 * Files that a newer manifest does not name any more.
 *
 * The model: a manifest is opened by name, and then the segments that it names; what is open stays good whatever becomes
 * of the name. So old files go when nobody is between taking the name and having opened all: neither a walk that opens,
 * nor whoever said so by dataset_read_begin.
 */
#include <assert.h>

#include "job_priv.h"

void dataset_read_begin(struct dataset *d)
{
	d->readers++;
}

void dataset_read_end(struct dataset *d)
{
	assert(d->readers);
	d->readers--;
}
