/*
 * A fetch that the caller drives: a step a frame. Between two steps nothing is read, so the pipe fills and the daemon
 * waits; progress and signs of an end of the connection are seen by the next step.
 */
#include "fetch.h"

int acut_fetch_begin(struct acut *a, uint64_t job, uint64_t since, const void *state, size_t size,
		     const struct acut_changes_sink *sink)
{
	int r = call_begin(a);
	struct fetch *f = r < 0 ? NULL : fetch_new(a, &sink->mesh);

	if (!f)
		return -(int)a->err.code;
	f->over = true;
	if (state && since)
		return err_set(&a->err, ERR_USAGE, "a fetch of changes cannot be gone on with");
	r = state ? fetch_read_state(f, state, size, &a->err) : 0;
	if (r < 0)
		return r;
	if (!state)
		f->job = job;
	f->since = since;
	f->changes = since ? sink : NULL;
	f->stepped = true;
	f->over = false;
	r = fetch_begin(f);
	return r < 0 ? fetch_end(f, r) : 0;
}

int acut_fetch_step(struct acut *a)
{
	struct fetch *f = a->fetch;
	int r;

	err_clear(&a->err);
	if (!f || !f->stepped || f->over)
		return err_set(&a->err, ERR_USAGE, "there is no fetch that could go on");
	r = fetch_stream(f);
	return r > 0 ? r : fetch_end(f, r);
}

void acut_fetch_end(struct acut *a)
{
	a->fetch = fetch_free(a->fetch);
	a->progress = NULL;
}
