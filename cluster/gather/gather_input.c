/*
 * What gather reads: the manifest of the dataset, the record of the plan, the sums of the phase mesh (gather_sum.c), and packs.
 * The sums say what is in a pack and where, so that a task opens only the packs that it needs; finish compares all of them with
 * the indexes.
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

int gather_input_needs(const struct gather_input *in, uint64_t *ret, struct err *err)
{
	const uint64_t held = GATHER_PROCESS + in->held + in->memory, need = held + GATHER_LEAST;

	if (in->p->memory < need) {
		err->need = need;
		err_set(err, ERR_LIMIT,
			"a task has %llu bytes of memory, and needs %llu with %sthe manifest and what is known of packs",
			(unsigned long long)in->p->memory, (unsigned long long)need, in->memory ? "the largest domain, " : "");
		return err_add_hint(err, "give tasks more memory (--task-memory)");
	}
	*ret = in->p->memory - held;
	return 0;
}

static int read_manifest(struct gather_input *in, struct err *err)
{
	const uint64_t packs = gather_sum_bytes(in->npacks, work_about(in->p->work)->tasks[WORK_GATHER]);
	uint64_t left;
	struct work_record *commit = NULL;
	int fd = -1, r = work_record_need(in->p->work, WORK_COMMIT, 0, &commit, err);

	if (!r && !commit->nfile)
		r = err_set(err, ERR_CORRUPT, "the record of the task commit names no manifest");
	if (!r) {
		in->held = packs + commit->file[0].size; /* before it is read */
		r = gather_input_needs(in, &left, err);
	}
	/* it is waited for */
	if (!r)
		r = work_file_open(in->p->work, commit->file[0].name, commit->file[0].size, &fd, err);
	io_close(fd);
	if (!r)
		r = grid_manifest_load_bare(work_fd(in->p->work), commit->file[0].name, in->ledger, &in->manifest, err);
	work_record_free(commit);
	in->held = packs + ledger_held(in->ledger, LEDGER_MANIFEST);
	return r ? r : gather_input_needs(in, &left, err);
}

int gather_input_packs(struct gather_input *in, const struct gather_params *p, struct err *err)
{
	*in = (struct gather_input){.p = p, .npacks = work_about(p->work)->tasks[WORK_MESH], .sum_fd = -1};
	in->pack = calloc((size_t)in->npacks + 1, sizeof(*in->pack));
	return in->pack ? 0 : err_set(err, ERR_NOMEM, "no memory for the names of packs");
}

int gather_input_begin(struct gather_input *in, const struct gather_params *p, struct err *err)
{
	int r = gather_input_packs(in, p, err);

	in->ledger = ledger_new(INT64_MAX); /* which only counts: all else comes after the manifest */
	if (!r && !in->ledger)
		r = err_set(err, ERR_NOMEM, "no memory for a manifest");
	if (!r)
		r = read_manifest(in, err);
	return r ? r : mesh_plan_about(p->work, &in->plan, err);
}

int gather_input_read(struct gather_input *in, const struct gather_params *p, uint32_t task, struct err *err)
{
	int r = gather_input_begin(in, p, err);

	return r ? r : gather_sum_read(in, task, err);
}

void gather_input_done(struct gather_input *in)
{
	if (!in->p)
		return;
	io_close(in->sum_fd);
	free(in->pack);
	grid_manifest_free(in->manifest);
	ledger_free(in->ledger);
	mesh_plan_about_done(&in->plan);
	*in = (struct gather_input){.p = NULL};
}

struct walk {
	const struct gather_input *in;
	const struct gather_choice *choice; /* NULL: all */
	gather_domain_fn each;
	void *ctx;
	struct store_pack_entry *entry; /* ENTRIES of them */
};

/* Domains `first` to `last` - 1 of a pack. */
static int walk_some(const struct walk *w, const struct store_pack *pack, uint64_t first, uint64_t last, struct err *err)
{
	int r = 0;

	for (; first < last && !r; first += ENTRIES) {
		size_t n = last - first < ENTRIES ? (size_t)(last - first) : ENTRIES;

		r = work_check_interrupt(w->in->p->work, err);
		if (!r)
			r = store_pack_entries(pack, first, n, w->entry, err);
		for (size_t i = 0; i < n && !r; i++)
			if (!w->choice || w->choice->domain(w->choice->ctx, &w->entry[i]))
				r = w->each(w->ctx, pack, &w->entry[i], err);
	}
	return r;
}

/* Groups that are wanted and follow each other are read together. */
static int walk_pack(const struct walk *w, uint32_t i, struct err *err)
{
	const struct gather_pack *of = &w->in->pack[i];
	bool wanted[MESH_GROUPS + 1] = {false}, any = !w->choice;
	struct mesh_group group[MESH_GROUPS];
	struct gather_opened o = {.fd = -1};
	int r = w->choice ? gather_groups(w->in, i, group, err) : 0;

	for (uint32_t k = 0; k < of->ngroup && !r; k++) {
		wanted[k] = !w->choice || w->choice->group(w->choice->ctx, &group[k]);
		any |= wanted[k];
	}
	if (!r && any)
		r = gather_pack_open(w->in, i, &o, err);
	for (uint32_t k = 0, end; any && k < of->ngroup && !r; k = end + 1) {
		for (end = k; wanted[end];)
			end++;
		r = walk_some(w, &o.of, k * of->each, end * of->each < of->domains ? end * of->each : of->domains, err);
	}
	io_close(o.fd);
	return r;
}

int gather_pack_open(const struct gather_input *in, uint32_t i, struct gather_opened *ret, struct err *err)
{
	const struct gather_pack *of = &in->pack[i];
	int r;

	gather_pack_name(in, i, ret->name);
	r = work_file_open(in->p->work, ret->name, of->size, &ret->fd, err);
	if (r)
		return r;
	r = store_pack_open(ret->fd, ret->name, &ret->of, err);
	if (!r && !digest_equal(ret->of.of, in->plan.of)) {
		err_set(err, ERR_CORRUPT, "the pack is of another mesh");
		r = err_add_file(err, ret->name);
	}
	if (!r && ret->of.n != of->domains) {
		err_set(err, ERR_CORRUPT, "the pack has %llu domains, and its task has recorded %llu",
			(unsigned long long)ret->of.n, (unsigned long long)of->domains);
		r = err_add_file(err, ret->name);
	}
	if (r)
		ret->fd = io_close(ret->fd);
	return r;
}

int gather_walk(const struct gather_input *in, const struct gather_choice *choice, gather_domain_fn each, void *ctx,
		struct err *err)
{
	const struct walk w = {in, choice, each, ctx, calloc(ENTRIES, sizeof(struct store_pack_entry))};
	int r = w.entry ? 0 : err_set(err, ERR_NOMEM, "no memory for the index of a pack");

	for (uint32_t i = 0; i < in->npacks && !r; i++)
		if (in->pack[i].ngroup && (!choice || choice->group(choice->ctx, &in->pack[i].all)))
			r = walk_pack(&w, i, err);
	free(w.entry);
	return r;
}

/* ---- sums and indexes ---- */

struct checking {
	const struct gather_input *in;
	struct mesh_sums sums;
	int32_t box[6];
	struct mesh_extent extent, said; /* of one pack, by its index and by the sums */
};

static int check_domain(void *ctx, const struct store_pack *pack, const struct store_pack_entry *e, struct err *err)
{
	struct checking *c = ctx;
	const struct mesh_sums own = {.domains = 1,
				      .vertices = e->own,
				      .triangles = e->ntriangle,
				      .hull = e->nhull,
				      .digest = e->digest,
				      .vertex_digest = e->own_digest};

	(void)pack;
	(void)err;
	mesh_sums_add(&c->sums, &own);
	mesh_extent_add(&c->extent, e);
	return 0;
}

static int check_pack(struct checking *c, const struct walk *w, uint32_t i, struct err *err)
{
	const struct gather_pack *of = &c->in->pack[i];
	int r;

	mesh_extent_begin(&c->extent);
	r = walk_pack(w, i, err);
	c->said = c->extent; /* what the sums do not have of one pack alone is the same */
	c->said.each = of->each;
	c->said.n = of->ngroup;
	if (!r)
		r = gather_groups(c->in, i, c->said.group, err);
	mesh_box_add(c->box, c->extent.box);
	if (r || mesh_extent_same(&c->extent, &c->said))
		return r;
	err_set(err, ERR_CORRUPT, "the record of mesh %u says of other places where its domains are", i);
	return err_add_file(err, c->in->sum_name);
}

static int check_sums(const struct checking *c, struct err *err)
{
	const struct mesh_sums *m = &c->in->sums, *s = &c->sums;

	if (s->domains == m->domains && s->vertices == m->vertices && s->triangles == m->triangles && s->hull == m->hull &&
	    digest_equal(s->digest, m->digest) && digest_equal(s->vertex_digest, m->vertex_digest) &&
	    (c->box[0] > c->box[3] || !memcmp(c->box, c->in->box, sizeof(c->box))))
		return 0;
	return err_set(err, ERR_INTERNAL,
		       "the packs have %llu domains with %llu triangles, or other sums, the records %llu with %llu",
		       (unsigned long long)s->domains, (unsigned long long)s->triangles, (unsigned long long)m->domains,
		       (unsigned long long)m->triangles);
}

int gather_input_check(const struct gather_input *in, struct err *err)
{
	struct checking *c = calloc(1, sizeof(*c));
	const struct walk w = {in, NULL, check_domain, c, calloc(ENTRIES, sizeof(struct store_pack_entry))};
	int r = c && w.entry ? 0 : err_set(err, ERR_NOMEM, "no memory for the sums of packs");

	if (c) {
		c->in = in;
		mesh_box_begin(c->box);
	}
	for (uint32_t i = 0; i < in->npacks && !r; i++)
		if (in->pack[i].ngroup)
			r = check_pack(c, &w, i, err);
	if (!r)
		r = check_sums(c, err);
	free(w.entry);
	free(c);
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

struct stream_tail gather_tail(const struct gather_input *in)
{
	const struct mesh_sums *s = &in->sums;
	struct stream_tail tail = {.vertices = s->vertices,
				   .triangles = s->triangles,
				   .hull = s->hull,
				   .digest = s->digest,
				   .vertex_digest = s->vertex_digest,
				   .report = "{}"};

	memcpy(tail.box, in->box, sizeof(tail.box));
	return tail;
}
