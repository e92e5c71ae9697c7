/*
 * The frames of a stream of changes between its head and its blocks (stream.md, "Changes"). The changes are copied from the run,
 * so the run does not wait for a slow pipe. They are sent through one frame, which is filled again and again.
 */
#include "stream_priv.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "ledger.h"

int out_changes_new(const struct run_changes *in, struct ledger *ledger, size_t *charged, struct out_changes **ret,
		    struct err *err)
{
	size_t size = sizeof(struct out_changes) + in->removed * sizeof(struct stream_region);
	const struct stream_base base = {
		.generation = in->generation,
		.job = in->job,
		.old_digest = in->old_digest,
		.old_vertex_digest = in->old_vertex_digest,
		.digest = in->digest,
		.vertex_digest = in->vertex_digest,
		.gone = in->removed,
		.gone_triangles = in->removed_triangles,
		.kept = in->kept,
		.kept_triangles = in->kept_triangles,
	};
	struct out_changes *c;

	if (!ledger_take(ledger, LEDGER_PIPE, size))
		return err_set(err, ERR_BUSY, "no memory for the regions of a stream");
	*charged += size;
	c = calloc(1, size);
	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for the regions of a stream");
	c->n = in->removed;
	for (uint64_t i = 0; i < c->n; i++) {
		memcpy(c->region[i].box, in->region[i].box, sizeof c->region[i].box);
		c->region[i].triangles = in->region[i].triangles;
		c->region[i].digest = in->region[i].digest;
	}
	c->frame.n = stream_put_base(&base, c->frame.scratch, c->frame.piece);
	*ret = c;
	return 0;
}

struct out_changes *out_changes_next(struct out_changes *c)
{
	struct out_frame *f = &c->frame;
	uint32_t n = c->n - c->at < STREAM_REGIONS ? (uint32_t)(c->n - c->at) : STREAM_REGIONS;

	if (!n) {
		free(c);
		return NULL;
	}
	f->n = stream_put_gone(c->region + c->at, n, f->scratch, f->piece);
	f->at = 0;
	f->done = 0;
	c->at += n;
	return c;
}
