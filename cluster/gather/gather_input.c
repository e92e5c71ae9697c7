/*
 * What gather reads: the manifest of the dataset, the record of the plan, the records and packs of the phase mesh. Records say
 * what is in a pack and where, so that a task opens only the packs that it needs; finish compares all of them with the indexes.
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
		r = grid_manifest_load_bare(work_fd(in->p->work), commit->file[0].name, in->ledger, &in->manifest, err);
	work_record_free(commit);
	in->held = ledger_held(in->ledger, LEDGER_MANIFEST) + ((uint64_t)in->npacks + 1) * sizeof(*in->pack);
	return r;
}

/* The record of a task of the phase mesh. */
static int task_of(struct gather_input *in, uint32_t task, struct mesh_task *about, struct err *err)
{
	struct gather_pack *pack = &in->pack[task];
	int r = mesh_task_about(in->p->work, task, about, err);

	if (r)
		return r;
	memcpy(pack->name, about->pack, sizeof(pack->name));
	pack->size = about->bytes;
	pack->domains = about->extent.domains;
	pack->each = about->extent.each;
	pack->ngroup = about->extent.n;
	pack->group = calloc((size_t)pack->ngroup + 1, sizeof(*pack->group));
	if (!pack->group)
		return err_set(err, ERR_NOMEM, "no memory for what is known of packs");
	memcpy(pack->group, about->extent.group, pack->ngroup * sizeof(*pack->group));
	in->held += ((uint64_t)pack->ngroup + 1) * sizeof(*pack->group);
	mesh_sums_add(&in->sums, &about->sums);
	mesh_box_add(in->box, about->extent.box);
	in->memory = about->extent.largest > in->memory ? about->extent.largest : in->memory;
	return 0;
}

static int read_records(struct gather_input *in, struct err *err)
{
	struct mesh_task *about = malloc(sizeof(*about));
	int r = about ? 0 : err_set(err, ERR_NOMEM, "no memory for a record");

	mesh_box_begin(in->box);
	for (uint32_t i = 0; i < in->npacks && !r; i++)
		r = task_of(in, i, about, err);
	if (in->box[0] > in->box[3])
		memset(in->box, 0, sizeof(in->box));
	free(about);
	return r;
}

/* Euler's formula, as of pipe_emitter_finish. */
static int check_whole(const struct mesh_sums *s, struct err *err)
{
	if (!s->triangles || s->triangles == 2 * s->vertices - 2 - s->hull)
		return 0;
	return err_set(err, ERR_INTERNAL, "the mesh is not whole: %llu vertices, %llu triangles, %llu on the hull",
		       (unsigned long long)s->vertices, (unsigned long long)s->triangles, (unsigned long long)s->hull);
}

int gather_input_read(struct gather_input *in, const struct gather_params *p, struct err *err)
{
	int r;

	*in = (struct gather_input){.p = p, .npacks = work_about(p->work)->tasks[WORK_MESH]};
	in->pack = calloc((size_t)in->npacks + 1, sizeof(*in->pack));
	in->ledger = ledger_new(INT64_MAX); /* which only counts: all else comes after the manifest */
	r = in->pack && in->ledger ? read_manifest(in, err) : err_set(err, ERR_NOMEM, "no memory for the names of packs");
	if (!r)
		r = mesh_plan_about(p->work, &in->plan, err);
	if (!r)
		r = read_records(in, err);
	return r ? r : check_whole(&in->sums, err);
}

void gather_input_done(struct gather_input *in)
{
	for (uint32_t i = 0; in->pack && i < in->npacks; i++)
		free(in->pack[i].group);
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

		r = gather_interrupted(w->in->p, err);
		if (!r)
			r = store_pack_entries(pack, first, n, w->entry, err);
		for (size_t i = 0; i < n && !r; i++)
			if (!w->choice || w->choice->domain(w->choice->ctx, &w->entry[i]))
				r = w->each(w->ctx, pack, &w->entry[i], err);
	}
	return r;
}

static bool group_wanted(const struct walk *w, const struct gather_pack *of, uint32_t group)
{
	return !w->choice || w->choice->group(w->choice->ctx, &of->group[group]);
}

/* Groups that are wanted and follow each other are read together. */
static int walk_pack(const struct walk *w, const struct store_pack *pack, const struct gather_pack *of, struct err *err)
{
	int r = 0;

	for (uint32_t i = 0, end; i < of->ngroup && !r; i = end + 1) {
		for (end = i; end < of->ngroup && group_wanted(w, of, end);)
			end++;
		r = walk_some(w, pack, i * of->each, end * of->each < pack->n ? end * of->each : pack->n, err);
	}
	return r;
}

static bool pack_wanted(const struct walk *w, const struct gather_pack *of)
{
	uint32_t i = 0;

	while (i < of->ngroup && !group_wanted(w, of, i))
		i++;
	return *of->name && i < of->ngroup;
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
	if (!r && ret->n != in->pack[i].domains) {
		err_set(err, ERR_CORRUPT, "the pack has %llu domains, and its task has recorded %llu", (unsigned long long)ret->n,
			(unsigned long long)in->pack[i].domains);
		r = err_add_file(err, in->pack[i].name);
	}
	if (r)
		io_close(fd);
	else
		*ret_fd = fd;
	return r;
}

int gather_walk(const struct gather_input *in, const struct gather_choice *choice, gather_domain_fn each, void *ctx,
		struct err *err)
{
	const struct walk w = {in, choice, each, ctx, calloc(ENTRIES, sizeof(struct store_pack_entry))};
	int r = w.entry ? 0 : err_set(err, ERR_NOMEM, "no memory for the index of a pack");

	for (uint32_t i = 0; i < in->npacks && !r; i++) {
		struct store_pack pack;
		int fd = -1;

		if (!pack_wanted(&w, &in->pack[i]))
			continue;
		r = gather_pack_open(in, i, &fd, &pack, err);
		if (!r)
			r = walk_pack(&w, &pack, &in->pack[i], err);
		io_close(fd);
	}
	free(w.entry);
	return r;
}

/* ---- records and indexes ---- */

struct checking {
	const struct gather_input *in;
	const char *name; /* of the pack */
	uint32_t pack;
	struct mesh_sums sums;
	int32_t box[6];
	struct mesh_extent extent; /* of this pack */
};

static int check_groups(const struct checking *c, struct err *err)
{
	const struct gather_pack *of = &c->in->pack[c->pack];
	const struct mesh_extent *x = &c->extent;
	struct mesh_extent said = *x;

	said.n = of->ngroup;
	said.each = of->each;
	memcpy(said.group, of->group, of->ngroup * sizeof(*of->group));
	if (mesh_extent_same(x, &said))
		return 0;
	err_set(err, ERR_CORRUPT, "the record of the pack says of other places where its domains are");
	return err_add_file(err, of->name);
}

static int check_domain(void *ctx, const struct store_pack *pack, const struct store_pack_entry *e, struct err *err)
{
	struct checking *c = ctx;
	int r = 0;

	if (pack->name != c->name) {
		r = c->name ? check_groups(c, err) : 0;
		mesh_extent_begin(&c->extent);
		c->name = pack->name;
		while (pack->name != c->in->pack[c->pack].name)
			c->pack++;
	}
	mesh_extent_add(&c->extent, e);
	c->sums.domains++;
	c->sums.vertices += e->own;
	c->sums.hull += e->nhull;
	digest_add(&c->sums.vertex_digest, e->own_digest);
	if (e->nvertex) {
		c->sums.triangles += e->ntriangle;
		digest_add(&c->sums.digest, e->digest);
		mesh_box_add(c->box, e->box);
	}
	return r;
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
	int r;

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for the sums of packs");
	c->in = in;
	mesh_box_begin(c->box);
	r = gather_walk(in, NULL, check_domain, c, err);
	if (!r && c->name)
		r = check_groups(c, err);
	if (!r)
		r = check_sums(c, err);
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
