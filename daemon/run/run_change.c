/*
 * The difference between the mesh of a run's job and an older mesh, from the records of finished domains in their plan files.
 *
 * The model: each leaf of a plan is a region, and the last record of a domain that was finished there identifies its triangles. A
 * region is kept if both meshes have it with the same content, heights included. All other regions of the old plan are removed,
 * all others of the new plan are sent; the run skips what is kept. The sums of the old records must give the old job's digest, so
 * missing or damaged records there cannot make a wrong stream. A region of the new plan without a record is sent, which is always
 * right.
 *
 * Worker, except run_change_skips, run_change_fails_split and run_change_agrees.
 */
#include <stdlib.h>
#include <string.h>

#include "run_priv.h"

/* The leaves of one plan, and their records. */
struct leaves {
	const struct cut_plan *plan;
	uint32_t *order; /* numbers of leaves, sorted by region */
	struct record {
		struct digest digest, base, list;
		uint64_t payload, triangles;
		bool known;
	} * record; /* by leaf */
};

static int compare(const struct cut_region *a, const struct cut_region *b)
{
	const uint64_t ka[] = {a->x, a->y, a->wx, a->wy, a->inf}, kb[] = {b->x, b->y, b->wx, b->wy, b->inf};

	for (unsigned i = 0; i < 5; i++)
		if (ka[i] != kb[i])
			return ka[i] < kb[i] ? -1 : 1;
	return 0;
}

static int compare_leaves(const void *a, const void *b, void *ctx)
{
	const struct cut_plan *plan = ctx;

	return compare(&plan->leaf[*(const uint32_t *)a].region, &plan->leaf[*(const uint32_t *)b].region);
}

/* The number of the leaf; SIZE_MAX: there is none. */
static size_t find_leaf(const struct leaves *l, const struct cut_region *region)
{
	size_t low = 0, high = l->plan->n;

	while (low < high) {
		size_t mid = (low + high) / 2;
		int c = compare(region, &l->plan->leaf[l->order[mid]].region);

		if (!c)
			return l->order[mid];
		if (c < 0)
			high = mid;
		else
			low = mid + 1;
	}
	return SIZE_MAX;
}

static int read_record(void *ctx, const struct plan_done *done, struct err *err)
{
	struct leaves *l = ctx;
	size_t at = find_leaf(l, &done->region);

	if (at != SIZE_MAX)
		l->record[at] = (struct record){done->digest, done->base, done->list, done->payload, done->triangles, true};
	return 0;
}

static void leaves_done(struct leaves *l)
{
	free(l->order);
	free(l->record);
}

static int leaves_read(struct leaves *l, const struct cut_plan *plan, int plansfd, uint64_t job, struct err *err)
{
	*l = (struct leaves){plan, calloc(plan->n + 1, sizeof *l->order), calloc(plan->n + 1, sizeof *l->record)};
	if (!l->order || !l->record)
		return err_set(err, ERR_NOMEM, "no memory to compare two meshes");
	for (size_t i = 0; i < plan->n; i++)
		l->order[i] = (uint32_t)i;
	qsort_r(l->order, plan->n, sizeof *l->order, compare_leaves, (void *)plan);
	return plan_file_each_done(plansfd, job, read_record, l, err);
}

/* ---- memory ---- */

/* The two lists of leaves are freed soon, the result stays with the run. All is charged at once. */
static uint64_t bytes_of(size_t n, size_t old)
{
	return sizeof(struct run_change) + (n + old + 2) * (sizeof(uint32_t) + sizeof(struct record)) + n +
	       old * sizeof(struct run_region);
}

static struct run_change *change_new(struct run *w, size_t old, struct err *err)
{
	struct ledger *ledger = w->runs->core->p.ledger;
	uint64_t bytes = bytes_of(w->plan.n, old);
	struct run_change *c;

	if (!ledger_take(ledger, LEDGER_PLAN, bytes)) {
		if (bytes > ledger_total(ledger) / 4)
			err_set(err, ERR_LIMIT, "%zu and %zu regions do not fit the memory to be compared", w->plan.n, old);
		else
			err_set(err, ERR_BUSY, "there is no memory to compare two meshes now");
		return NULL;
	}
	c = calloc(1, sizeof *c);
	if (c) {
		c->charged = bytes;
		c->skip = calloc(w->plan.n + 1, 1);
		c->region = calloc(old + 1, sizeof *c->region);
	}
	if (!c || !c->skip || !c->region) {
		err_set(err, ERR_NOMEM, "no memory to compare two meshes");
		if (!c)
			ledger_give(ledger, LEDGER_PLAN, bytes);
		return run_change_free(w, c);
	}
	return c;
}

struct run_change *run_change_free(struct run *w, struct run_change *c)
{
	if (!c)
		return NULL;
	ledger_give(w->runs->core->p.ledger, LEDGER_PLAN, c->charged);
	free(c->skip);
	free(c->region);
	free(c);
	return NULL;
}

/* ---- comparing ---- */

/* The records hold all triangles of the old mesh. */
static bool is_whole(const struct leaves *old, struct digest digest)
{
	struct digest sum = {0};

	for (size_t i = 0; i < old->plan->n; i++)
		digest_add(&sum, old->record[i].digest);
	return digest_equal(sum, digest);
}

/* Both were made of the same points under the same view, whatever the version of the store's format. */
static bool same_input(const struct record *a, const struct record *b)
{
	return !digest_is_zero(a->base) && digest_equal(a->base, b->base) && digest_equal(a->list, b->list);
}

/* The digest does not include heights; the checksum of the stored arrays, and the input, do. */
static bool is_same(const struct record *a, const struct record *b)
{
	return a->known && b->known && a->triangles == b->triangles && digest_equal(a->digest, b->digest) &&
	       (a->payload == b->payload || same_input(a, b));
}

/* Regions of mapped points are comparable if they have one origin, which the digests of their domains' names include. */
static int check_origin(const struct run *w, const struct leaves *old, struct err *err)
{
	struct pipe_key key;

	if (!w->grid_view.map.is.k)
		return 0;
	pipe_key_init(&key, w->grid, &w->grid_view);
	for (size_t i = 0; i < old->plan->n; i++) {
		if (!old->record[i].known || digest_is_zero(old->record[i].base) ||
		    digest_equal(old->record[i].base, pipe_key_of(&key, &old->plan->leaf[i].region)))
			continue;
		err_set(err, ERR_GONE, "the plane of the metric has another origin since generation %llu",
			(unsigned long long)w->since->generation);
		return err_add_hint(err, "fetch the whole mesh, without --changed-since");
	}
	return 0;
}

static void add_removed(const struct run *w, struct run_change *c, const struct cut_region *region, const struct record *record)
{
	struct run_region *r = &c->region[c->summary.removed++];

	cut_region_box(region, r->box);
	pipe_region_box(&w->grid_view.map, r->box);
	r->triangles = record->triangles;
	r->digest = record->digest;
	c->summary.removed_triangles += record->triangles;
	digest_add(&c->removed, record->digest);
}

static void compare_plans(const struct run *w, struct run_change *c, const struct leaves *new, const struct leaves *old)
{
	struct digest id;

	for (size_t i = 0; i < old->plan->n; i++) {
		const struct record *was = &old->record[i];
		size_t at = find_leaf(new, &old->plan->leaf[i].region);

		if (!was->triangles)
			continue;
		if (at == SIZE_MAX || !is_same(was, &new->record[at])) {
			add_removed(w, c, &old->plan->leaf[i].region, was);
			continue;
		}
		c->skip[at] = true;
		c->summary.kept++;
		c->summary.kept_triangles += was->triangles;
	}
	for (size_t i = 0; i < new->plan->n; i++)
		c->skip[i] |= new->plan->leaf[i].flat || (new->record[i].known && !new->record[i].triangles);
	c->summary.region = c->region;
	/* With another base, or other kept regions, it is another stream. */
	c->id = digest_hash(c->skip, new->plan->n);
	id = digest_hash(&c->summary.old_digest, sizeof c->summary.old_digest);
	digest_add(&c->id, id);
	digest_add(&c->id, digest_hash(&c->summary.generation, sizeof c->summary.generation));
	digest_add(&c->id, c->removed);
}

/* Compares with the mesh of one job. RUN_E_ABSENT: its records are incomplete. */
static int compare_with(struct run *w, const struct run_base *base, struct err *err)
{
	struct plan_file *file = plan_file_new(w->runs->core->plansfd, base->job, w->since->generation, false, NULL);
	struct cut_plan plan = {.ledger = w->runs->core->p.ledger};
	struct leaves new = {0}, old = {0};
	struct run_change *c = NULL;
	struct plan_kept kept;
	size_t seen;
	int r = file ? plan_file_read(file, &plan, &kept, &seen, err) : err_set(err, ERR_NOMEM, "no memory for a plan");

	if (r == PLAN_FILE_ABSENT)
		r = digest_is_zero(base->digest) ? 0 : RUN_E_ABSENT; /* a mesh without points has no plan */
	if (!r) {
		c = change_new(w, plan.n, err);
		r = c ? 0 : -(int)err->code;
	}
	if (!r)
		r = leaves_read(&old, &plan, w->runs->core->plansfd, base->job, err);
	if (!r && !is_whole(&old, base->digest))
		r = RUN_E_ABSENT;
	if (!r)
		r = check_origin(w, &old, err);
	if (!r)
		r = leaves_read(&new, &w->plan, w->runs->core->plansfd, w->since->job, err);
	if (!r) {
		c->summary = (struct run_changes){.generation = w->since->generation,
						  .job = base->job,
						  .old_digest = base->digest,
						  .old_vertex_digest = base->vertex_digest,
						  .digest = w->since->digest,
						  .vertex_digest = w->since->vertex_digest};
		compare_plans(w, c, &new, &old);
		w->change = c;
	} else {
		run_change_free(w, c);
	}
	leaves_done(&old);
	leaves_done(&new);
	cut_plan_done(&plan);
	plan_file_free(file);
	return r;
}

/* None of the jobs will do; the hint names what can be had. */
static int refuse_base(const struct run_since *s, struct err *err)
{
	const unsigned long long wanted = s->generation, near = s->near, oldest = s->oldest, newest = s->newest;

	if (s->generation < s->oldest) {
		err_set(err, ERR_GONE,
			"generation %llu of %s was pruned, and no job of it with the same view has kept the regions of its "
			"mesh: the dataset has generations %llu to %llu",
			wanted, s->dataset, oldest, newest);
		return near ? err_add_hint(err, "--changed-since %llu can be had, or the whole mesh without it", near) :
			      err_add_hint(err, "fetch the whole mesh, without --changed-since");
	}
	err_set(err, ERR_GONE, "no job of generation %llu with the same view has kept the regions of its mesh", wanted);
	return near ? err_add_hint(
			      err,
			      "acutctl submit %.200s --at %llu --new, with the options of that view, makes one; --changed-since "
			      "%llu has one",
			      s->dataset, wanted, near) :
		      err_add_hint(err, "acutctl submit %.200s --at %llu --new, with the options of that view, makes one",
				   s->dataset, wanted);
}

int run_change_read(struct run *w, struct err *err)
{
	int r = RUN_E_ABSENT;

	if (!w->since)
		return 0;
	if (w->view.window)
		return err_set(err, ERR_USAGE, "changes exist for whole meshes, not for areas");
	pipe_emitter_part(w->emitter);
	/* It has begun again, and its head was sent already. */
	if (w->change)
		return 0;
	if (!w->planned && !digest_is_zero(w->since->digest)) {
		err_set(err, ERR_GONE, "the plan of job %llu is not kept any more", (unsigned long long)w->since->job);
		return err_add_hint(err, "fetch the whole mesh");
	}
	for (unsigned i = 0; i < w->since->n && r == RUN_E_ABSENT; i++)
		r = compare_with(w, &w->since->base[i], err);
	if (r != RUN_E_ABSENT)
		return r;
	return refuse_base(w->since, err);
}

bool run_change_skips(const struct run *w, size_t index)
{
	return w->change && w->change->skip[index];
}

bool run_change_fails_split(struct run *w)
{
	struct err err = ERR_INIT;

	if (!w->since || w->stopping)
		return false;
	err_set(&err, ERR_GONE, "the regions of the job's mesh do not fit the memory any more, and others were not compared");
	err_add_hint(&err, "fetch the whole mesh, or start the daemon with more memory");
	run_fail(w, &err);
	return true;
}

int run_change_agrees(const struct run *w, struct err *err)
{
	struct digest sum = w->change->summary.old_digest;
	char have[DIGEST_HEX_SIZE], want[DIGEST_HEX_SIZE];

	digest_sub(&sum, w->change->removed);
	digest_add(&sum, w->totals.digest);
	if (digest_equal(sum, w->change->summary.digest))
		return 0;
	return err_set(err, ERR_DIGEST, "the mesh of job %llu with the changes has digest %s, the job had %s",
		       (unsigned long long)w->change->summary.job, digest_hex(sum, have),
		       digest_hex(w->change->summary.digest, want));
}
