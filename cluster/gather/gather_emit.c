/*
 * Domains of packs to a sink: read, numbered, and checked as a client checks a stream of acutd.
 *
 * The checks are independent: a pack has checksums; the emitter finds open links that nothing closes, and compares numbers with
 * Euler's formula; the feed computes both digests from the triangles and vertices that the sink gets; the records of the phase
 * mesh have sums of their own.
 */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "feed.h"
#include "gather_priv.h"
#include "io.h"
#include "mesh_stream.h"

/* What an open vertex takes at most in the table of the feed (libacut's check.c), which doubles. */
enum { OPEN_BYTES = 108, MEGA = 1 << 20 };

struct emission {
	const struct gather_input *in;
	struct pipe_emitter *emitter;
	struct mesh_sink sink;
	struct feed feed;
	void *memory;
	size_t size;
	uint64_t blocks, open_most; /* vertices that may be open at once */
	int temp;                   /* folder of the spill file; -1: that of the run */
};

/* Nearly all vertices are, where points are in convex position. */
static int check_open_vertices(const struct emission *e, struct err *err)
{
	const struct gather_params *p = e->in->p;

	if (check_open(e->feed.check) <= e->open_most)
		return 0;
	err_set(err, ERR_LIMIT,
		"more than %llu of %llu vertices are open at once, as in convex position, and their table does not fit a task",
		(unsigned long long)e->open_most, (unsigned long long)e->in->sums.vertices);
	err->need = p->memory + 4 * OPEN_BYTES * (e->in->sums.vertices - e->open_most);
	return err_add_hint(err, "make PLY or STL by several tasks (--task-points), or begin a new run with --task-memory %lluM",
			    (unsigned long long)((err->need + MEGA - 1) / MEGA));
}

static int take_block(void *ctx, const struct mesh_block *b, struct err *err)
{
	struct emission *e = ctx;
	const struct stream_block block = mesh_stream_block(b);
	int r;

	e->blocks++;
	r = feed_block(&e->feed, &block, err);
	return r ? r : check_open_vertices(e, err);
}

static int emit_one(void *ctx, const struct store_pack *pack, const struct store_pack_entry *entry, struct err *err)
{
	struct emission *e = ctx;
	struct cut_region region;
	struct mesh_domain domain;
	int r = work_check_interrupt(e->in->p->work, err);

	if (!r && !cut_region_parse(entry->region, &region)) {
		err_set(err, ERR_CORRUPT, "a pack has a domain of no region: \"%.64s\"", entry->region);
		r = err_add_file(err, pack->name);
	}
	if (!r)
		r = store_pack_get(pack, entry, e->memory, e->size, &domain, err);
	return r ? r : pipe_emit(e->emitter, &domain, &region, &e->sink, err);
}

/* The numbers of the mesh, from its domains and from the records. */
static int compare(const struct gather_input *in, const struct pipe_totals *t, struct err *err)
{
	const struct mesh_sums *s = &in->sums;

	if (s->domains == t->domains && s->vertices == t->vertices && s->triangles == t->triangles &&
	    digest_equal(s->digest, t->digest) && digest_equal(s->vertex_digest, t->vertex_digest) &&
	    (!t->vertices || !memcmp(in->box, t->box, sizeof(in->box))))
		return 0;
	return err_set(err, ERR_INTERNAL,
		       "the records have %llu vertices and %llu triangles, or other sums, the mesh %llu and %llu",
		       (unsigned long long)s->vertices, (unsigned long long)s->triangles, (unsigned long long)t->vertices,
		       (unsigned long long)t->triangles);
}

static int finish(struct emission *e, bool part, struct pipe_totals *t, struct err *err)
{
	struct stream_tail tail = {.blocks = e->blocks, .report = "{}"};
	int r = pipe_emitter_finish(e->emitter, t, err);

	if (!r && !part)
		r = compare(e->in, t, err);
	tail.vertices = t->vertices;
	tail.triangles = t->triangles;
	tail.hull = t->hull;
	tail.digest = t->digest;
	tail.vertex_digest = t->vertex_digest;
	memcpy(tail.box, e->in->box, sizeof(tail.box)); /* of all, also for a part: pictures have one range of heights */
	if (!r)
		r = check_tail(e->feed.check, &tail, !part, err);
	return r ? r : feed_tail(&e->feed, &tail, err);
}

static int begin(struct emission *e, const struct stream_head *head, bool part, size_t memory, struct err *err)
{
	const struct gather_params *p = e->in->p;
	int r = p->scratch ? io_open(AT_FDCWD, p->scratch, O_RDONLY | O_DIRECTORY, 0, &e->temp, err) : 0;

	if (!r)
		r = pipe_emitter_new(&e->in->manifest->lattice, memory, e->temp < 0 ? work_fd(p->work) : e->temp, &e->emitter,
				     err);
	if (!r && part)
		pipe_emitter_part(e->emitter);
	e->memory = aligned_alloc(64, (e->size + 63) & ~(size_t)63);
	if (!r && !e->memory)
		r = err_set(err, ERR_NOMEM, "no memory for a domain of %zu bytes", e->size);
	if (!r)
		r = feed_begin(&e->feed, head, err);
	return r ? r : feed_head(&e->feed, head, err);
}

int gather_emit(const struct gather_input *in, const struct gather_choice *choice, const struct acut_mesh_sink *sink,
		size_t memory, struct pipe_totals *ret, struct err *err)
{
	struct emission *e = calloc(1, sizeof(*e));
	struct stream_head *head = calloc(1, sizeof(*head));
	int r = e && head ? 0 : err_set(err, ERR_NOMEM, "no memory to emit a mesh");

	if (!r) {
		*e = (struct emission){.in = in,
				       .sink = {e, take_block},
				       .feed.sink = sink,
				       .size = in->memory + 64,
				       .open_most = memory / OPEN_BYTES,
				       .temp = -1};
		gather_head(in, head);
		r = begin(e, head, choice != NULL, memory, err);
	}
	if (!r)
		r = gather_walk(in, choice, emit_one, e, err);
	if (!r)
		r = finish(e, choice != NULL, ret, err);
	if (e) {
		feed_done(&e->feed);
		pipe_emitter_free(e->emitter);
		free(e->memory);
		io_close(e->temp);
	}
	free(e);
	free(head);
	return r;
}
