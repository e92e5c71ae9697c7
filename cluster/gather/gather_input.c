/*
 * What gather reads: the manifest of the dataset, the record of the plan, the records and packs of the phase mesh.
 *
 * Tasks of the phase mesh have ranges of the plan, in order, and the domains in a pack are in order, so all packs in the order of
 * their tasks are the plan. Packs are opened one at a time. Everything is named by records, and waited for.
 */
#include <stdlib.h>
#include <string.h>

#include "frame.h"
#include "gather_priv.h"
#include "io.h"
#include "ledger.h"

enum { ENTRIES = 128 };

int gather_interrupted(const struct gather_params *p, struct err *err)
{
	return p->interrupted && p->interrupted(p->ctx) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

static int read_manifest(struct gather_input *in, struct err *err)
{
	struct work_record *commit = NULL;
	int fd = -1, r = work_record_need(in->p->work, WORK_COMMIT, 0, &commit, err);

	if (!r && !commit->nfile)
		r = err_set(err, ERR_CORRUPT, "the record of the task commit names no manifest");
	/* it is waited for */
	if (!r)
		r = work_file_open(in->p->work, commit->file[0].name, commit->file[0].size, &fd, err);
	io_close(fd);
	if (!r)
		r = grid_manifest_load(work_fd(in->p->work), commit->file[0].name, in->ledger, &in->manifest, err);
	work_record_free(commit);
	in->held = ledger_held(in->ledger, LEDGER_MANIFEST) + ((uint64_t)in->npacks + 1) * sizeof(*in->pack);
	return r;
}

/* The record and the pack of a task of the phase mesh. */
static int task_of(struct gather_input *in, uint32_t task, struct err *err)
{
	struct mesh_sums sums;
	int r = mesh_task_about(in->p->work, task, &sums, in->pack[task].name, &in->pack[task].size, err);

	if (!r)
		mesh_sums_add(&in->recorded, &sums);
	return r;
}

static void box_add(int32_t box[6], const int32_t more[6], bool first)
{
	for (int i = 0; i < 3; i++) {
		box[i] = first || more[i] < box[i] ? more[i] : box[i];
		box[i + 3] = first || more[i + 3] > box[i + 3] ? more[i + 3] : box[i + 3];
	}
}

static void add_sums(struct gather_sums *s, const struct store_pack_entry *e)
{
	size_t memory = store_pack_memory(e);

	s->domains++;
	s->vertices += e->own;
	s->hull += e->nhull;
	digest_add(&s->vertex_digest, e->own_digest);
	s->memory = memory > s->memory ? memory : s->memory;
	if (!e->nvertex)
		return;
	box_add(s->box, e->box, s->box[0] > s->box[3]);
	s->triangles += e->ntriangle;
	digest_add(&s->digest, e->digest);
}

/* The sums of the indexes are those of the records, and Euler's formula holds, as of pipe_emitter_finish. */
static int check_sums(const struct gather_input *in, struct err *err)
{
	const struct gather_sums *s = &in->sums;
	const struct mesh_sums *m = &in->recorded;

	if (s->domains != m->domains || s->vertices != m->vertices || s->triangles != m->triangles || s->hull != m->hull ||
	    !digest_equal(s->digest, m->digest) || !digest_equal(s->vertex_digest, m->vertex_digest))
		return err_set(err, ERR_INTERNAL,
			       "the packs have %llu domains with %llu triangles, or other sums, the records %llu with %llu",
			       (unsigned long long)s->domains, (unsigned long long)s->triangles, (unsigned long long)m->domains,
			       (unsigned long long)m->triangles);
	if (!s->triangles || s->triangles == 2 * s->vertices - 2 - s->hull)
		return 0;
	return err_set(err, ERR_INTERNAL, "the mesh is not whole: %llu vertices, %llu triangles, %llu on the hull",
		       (unsigned long long)s->vertices, (unsigned long long)s->triangles, (unsigned long long)s->hull);
}

struct counting {
	struct gather_input *in;
	gather_entry_fn each;
	void *ctx;
};

/* Nothing of a domain is read yet. */
static bool count_entry(void *ctx, const struct store_pack_entry *e)
{
	struct counting *c = ctx;

	add_sums(&c->in->sums, e);
	return c->each != NULL;
}

static int give_entry(void *ctx, const struct store_pack *pack, const struct store_pack_entry *e, struct err *err)
{
	struct counting *c = ctx;

	return c->each(c->ctx, e, err);
}

int gather_input_read(struct gather_input *in, const struct gather_params *p, gather_entry_fn each, void *ctx, struct err *err)
{
	struct counting counting = {in, each, ctx};
	const struct gather_walk walk = {count_entry, give_entry, &counting};
	int r;

	*in = (struct gather_input){.p = p, .npacks = work_about(p->work)->tasks[WORK_MESH], .sums.box = {1, 0, 0, 0, 0, 0}};
	in->pack = calloc((size_t)in->npacks + 1, sizeof(*in->pack));
	in->ledger = ledger_new(INT64_MAX); /* which only counts: all else comes after the manifest */
	r = in->pack && in->ledger ? read_manifest(in, err) : err_set(err, ERR_NOMEM, "no memory for the names of packs");
	if (!r)
		r = mesh_plan_about(p->work, &in->plan, err);
	for (uint32_t i = 0; i < in->npacks && !r; i++)
		r = task_of(in, i, err);
	if (!r)
		r = gather_walk(in, &walk, err);
	if (!r)
		r = check_sums(in, err);
	if (in->sums.box[0] > in->sums.box[3])
		memset(in->sums.box, 0, sizeof(in->sums.box));
	return r;
}

void gather_input_done(struct gather_input *in)
{
	free(in->pack);
	grid_manifest_free(in->manifest);
	ledger_free(in->ledger);
	mesh_plan_about_done(&in->plan);
	*in = (struct gather_input){.p = NULL};
}

static int walk_pack(const struct gather_input *in, const struct store_pack *pack, const struct gather_walk *w,
		     struct store_pack_entry *entry, struct err *err)
{
	int r = 0;

	for (uint64_t first = 0; first < pack->n && !r; first += ENTRIES) {
		size_t n = pack->n - first < ENTRIES ? (size_t)(pack->n - first) : ENTRIES;

		r = gather_interrupted(in->p, err);
		if (!r)
			r = store_pack_entries(pack, first, n, entry, err);
		for (size_t i = 0; i < n && !r; i++)
			if (!w->wanted || w->wanted(w->ctx, &entry[i]))
				r = w->each(w->ctx, pack, &entry[i], err);
	}
	return r;
}

int gather_pack_open(const struct gather_input *in, uint32_t i, int *ret_fd, struct store_pack *ret, struct err *err)
{
	int fd = -1, r = work_file_open(in->p->work, in->pack[i].name, in->pack[i].size, &fd, err);

	if (!r)
		r = store_pack_open(fd, in->pack[i].name, ret, err);
	if (!r && !digest_equal(ret->of, in->plan.of)) {
		err_set(err, ERR_CORRUPT, "the pack is of another mesh");
		r = err_add_file(err, in->pack[i].name);
	}
	if (r)
		io_close(fd);
	else
		*ret_fd = fd;
	return r;
}

int gather_walk(const struct gather_input *in, const struct gather_walk *w, struct err *err)
{
	struct store_pack_entry *entry = calloc(ENTRIES, sizeof(*entry));
	int r = entry ? 0 : err_set(err, ERR_NOMEM, "no memory for the index of a pack");

	for (uint32_t i = 0; i < in->npacks && !r; i++) {
		struct store_pack pack;
		int fd = -1;

		if (!*in->pack[i].name)
			continue;
		r = gather_pack_open(in, i, &fd, &pack, err);
		if (!r)
			r = walk_pack(in, &pack, w, entry, err);
		io_close(fd);
	}
	free(entry);
	return r;
}

static void text_copy(char *to, size_t size, const char *from)
{
	size_t n = strnlen(from, size - 1);

	memcpy(to, from, n);
	to[n] = 0;
}

/* As the daemon's stream has it (stream.md). */
void gather_head(const struct gather_input *in, struct stream_head *head)
{
	const struct grid_manifest *m = in->manifest;
	char lattice[LATTICE_TEXT_SIZE];
	bool any = false;

	*head = (struct stream_head){.kind = STREAM_WHOLE, .system = true, .view = in->plan.view, .wkt = m->wkt ? m->wkt : ""};
	text_copy(head->lattice, sizeof(head->lattice), lattice_text(&m->lattice, lattice));
	text_copy(head->crs, sizeof(head->crs), m->crs);
	text_copy(head->unit_xy, sizeof(head->unit_xy), m->unit_xy);
	text_copy(head->unit_z, sizeof(head->unit_z), m->unit_z);
	text_copy(head->geoid, sizeof(head->geoid), m->geoid);
	frame_text_clean(head->geoid);
	for (size_t i = 0; i < m->nsegments; i++) {
		const int32_t *box = m->segments[i].box;

		if (!m->segments[i].points)
			continue;
		for (int k = 0; k < 2; k++) {
			head->box[k] = !any || box[k] < head->box[k] ? box[k] : head->box[k];
			head->box[k + 3] = !any || box[k + 2] > head->box[k + 3] ? box[k + 2] : head->box[k + 3];
		}
		any = true;
	}
	head->box[2] = any ? INT32_MIN : 0;
	head->box[5] = any ? INT32_MAX : 0;
	head->id = in->plan.of;
}

struct stream_tail gather_tail(const struct gather_sums *s)
{
	struct stream_tail tail = {.vertices = s->vertices,
				   .triangles = s->triangles,
				   .hull = s->hull,
				   .digest = s->digest,
				   .vertex_digest = s->vertex_digest,
				   .report = "{}"};

	memcpy(tail.box, s->box, sizeof(tail.box));
	return tail;
}
