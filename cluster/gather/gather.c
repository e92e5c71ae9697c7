/*
 * The phase gather: a task makes a part of the outputs.
 *
 * Files of a mesh with triangles, in tiles, are divided among all tasks: each has some tiles, reads the domains that meet these,
 * and gives the outputs their triangles. Binary PLY and STL are written by all tasks at once (gather_share.c), if no option looks
 * at more than a record at a time. Whatever else needs the whole mesh is made by the first task alone: one file, rasters and
 * lines (which divide themselves after they are drawn), and what is trimmed from the hull. The other tasks then have nothing to
 * do.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "feed.h"
#include "gather_priv.h"
#include "io.h"

/* ---- options ---- */

static const struct format *tile_format(const struct ctl_fetch_options *a)
{
	const struct ctl_fetch_output o = ctl_fetch_output(a, ctl_fetch_count(a) ? 1 : 0);

	return format_find(o.format ? o.format : "ply");
}

bool gather_divides_tiles(const struct ctl_fetch_options *a)
{
	const struct format *f = a->tile ? tile_format(a) : NULL;

	return f && !a->trim_hull && (f->kind == FORMAT_MESH || (f->kind == FORMAT_PICTURE && !ctl_fetch_output(a, 1).cell));
}

bool gather_divides(const struct ctl_fetch_options *a)
{
	return gather_divides_tiles(a) || gather_shares(a);
}

/* One that is written as PLY, without --tile. */
static const char *one_ply(const struct ctl_fetch_options *a)
{
	for (unsigned i = 1; i <= ctl_fetch_count(a) && !a->tile; i++) {
		const struct ctl_fetch_output o = ctl_fetch_output(a, i);
		const struct format *f = o.format ? format_find(o.format) : format_by_path(o.path);

		if (f && !strcmp(f->name, "ply"))
			return o.path;
	}
	return NULL;
}

int gather_check_ply(const struct ctl_fetch_options *a, uint64_t vertices, const char *what, struct err *err)
{
	const char *path = one_ply(a);

	if (!path || vertices <= 1ull << 31)
		return 0;
	err_set(err, ERR_LIMIT, "one PLY has at most 2^31 vertices, and the %s %llu", what, (unsigned long long)vertices);
	err_add_hint(err, "write tiles, as in --tile 1000 -o tiles/");
	return err_add_file(err, path);
}

int gather_check(const struct ctl_fetch_options *a, uint64_t claimed_points, struct err *err)
{
	for (unsigned i = 1; i <= ctl_fetch_count(a); i++)
		if (!strcmp(ctl_fetch_output(a, i).path, "-")) {
			err_set(err, ERR_USAGE, "the outputs of a run are files, and standard output is none");
			return err_add_hint(err, "name a file, as in -o mesh.ply");
		}
	if (a->since)
		return err_set(err, ERR_USAGE, "--changed-since has no meaning for a run: it makes the whole mesh");
	if (a->window)
		return err_set(err, ERR_USAGE, "--%s has no meaning for a run: it makes the whole mesh", a->window);
	return gather_check_ply(a, claimed_points, "inputs claim", err);
}

int gather_check_run(const struct work *w, struct err *err)
{
	const struct work_about *about = work_about(w);

	if (!about->tasks[WORK_GATHER] || (about->tasks[WORK_SUM] && about->kernel && !strcmp(about->kernel, PIPE_KERNEL)))
		return 0;
	err_set(err, ERR_VERSION, "another version of acut began the run");
	err_add_hint(err, "end it with that version, or begin a new run");
	return err_add_file(err, work_folder(w));
}

/* ---- a task ---- */

enum division { BY_NOTHING, BY_TILES, BY_RECORDS };

struct task {
	const struct gather_params *p;
	uint32_t index;
	enum division divides;
	struct work_attempt *attempt; /* while it runs */
	struct gather_input in;
	struct gather_tiles *tiles; /* NULL: they are not divided */
	uint64_t share[2];
	struct outputs *run;
	struct gather_places *places; /* NULL: no file is written by all tasks */
	struct stream_head *head;
	struct feed feed;
	bool published;
	char part[GATHER_PART];
};

void gather_part_name(const struct gather_params *p, uint32_t index, uint64_t attempt, char buf[GATHER_PART])
{
	snprintf(buf, GATHER_PART, "%016llx-%u-%016llx", (unsigned long long)work_about(p->work)->id, index,
		 (unsigned long long)attempt);
}

static bool group_wanted(void *ctx, const struct mesh_group *g)
{
	const struct task *t = ctx;

	return gather_tiles_meets_group(t->tiles, g, t->share);
}

static bool domain_wanted(void *ctx, const struct store_pack_entry *e)
{
	const struct task *t = ctx;

	return gather_tiles_meets(t->tiles, e, t->share);
}

static int write_outputs(struct task *t, struct err *err)
{
	struct outputs_options opt = {.part = t->part,
				      .tiles_most = gather_tiles_part(t->p),
				      .share = {0, UINT64_MAX},
				      .interrupted = work_interrupted,
				      .ctx = t->p->work};
	const struct gather_choice choice = {group_wanted, domain_wanted, t};
	struct acut_mesh_sink sink;
	struct pipe_totals totals;
	uint64_t memory = 0;
	int r = gather_input_needs(&t->in, &memory, err);

	if (r)
		return r;
	if (t->tiles)
		memcpy(opt.share, t->share, sizeof(opt.share));
	opt.sort_memory = memory / 2;
	r = ctl_fetch_make(t->p->outputs, &opt, &t->run, err);
	if (r)
		return r;
	outputs_about(t->run, 0, NULL, t->in.manifest->generation);
	sink = outputs_sink(t->run);
	r = gather_emit(&t->in, t->tiles ? &choice : NULL, &sink, (size_t)(memory / 4), &totals, err);
	if (r && outputs_error(t->run)->code) {
		*err = *outputs_error(t->run);
		r = -(int)err->code;
	}
	if (!r)
		r = outputs_publish(t->run, err);
	t->published = !r;
	return r;
}

/* The list of what was made, for the task finish: its bytes and their hash. */
static int write_list(struct task *t, struct err *err)
{
	char name[WORK_NAME];
	uint8_t *bytes = NULL;
	struct digest sum;
	size_t n = 0;
	int fd = -1, r = outputs_part(t->run, &bytes, &n, err);

	if (!r)
		r = work_attempt_file(t->attempt, "", "gather", "", name, err);
	if (!r)
		r = io_open(work_fd(t->p->work), name, O_WRONLY | O_CREAT | O_EXCL, 0640, &fd, err);
	if (!r) {
		sum = digest_hash(bytes, n);
		r = io_write_at(fd, bytes, n, 0, name, err);
	}
	if (!r)
		r = io_write_at(fd, &sum, sizeof(sum), n, name, err);
	if (!r)
		r = io_sync(fd, name, err);
	io_close(fd);
	free(bytes);
	if (!r)
		r = work_result_file(t->attempt, name, err);
	return r ? r : work_result(t->attempt, "part", t->part, err);
}

/* ---- files that all tasks write ---- */

static int given_up(void *ctx)
{
	const struct task *t = ctx;
	struct err ignored = ERR_INIT;
	struct work_record *record = NULL;

	if (work_record_look(t->p->work, WORK_GATHER, t->index, &record, &ignored))
		return 0;
	work_record_free(record);
	return 1;
}

static int record_shared(const struct task *t, const struct gather_share_sums *s, struct err *err)
{
	const struct {
		const char *key;
		uint64_t value;
	} of[] = {{"vertices", s->vertices},         {"triangles", s->triangles}, {"domains", s->domains},    {"extra", s->extra},
		  {"looked_up", s->place.looked_up}, {"tables", s->place.tables}, {"fronts", s->place.fronts}};
	char text[DIGEST_HEX_SIZE];
	int r = 0;

	for (size_t i = 0; i < sizeof(of) / sizeof(of[0]) && !r; i++)
		r = work_result_u64(t->attempt, of[i].key, of[i].value, err);
	if (!r)
		r = work_result(t->attempt, "digest", digest_hex(s->digest, text), err);
	return r ? r : work_result(t->attempt, "vertex_digest", digest_hex(s->vertex_digest, text), err);
}

/* Head, records, tail. */
static int write_shared(struct task *t, const struct stream_tail *tail, const uint64_t range[2], struct gather_share_sums *sums,
			struct err *err)
{
	struct acut_mesh_sink sink = outputs_sink(t->run);
	int r;

	t->feed.sink = &sink;
	gather_head(&t->in, t->head);
	r = feed_begin(&t->feed, t->head, err);
	if (!r)
		r = feed_head(&t->feed, t->head, err);
	if (!r)
		r = gather_share_write(&t->in, t->places, range, t->run, given_up, t, sums, err);
	if (!r)
		r = feed_tail(&t->feed, tail, err);
	if (r && outputs_error(t->run)->code) {
		*err = *outputs_error(t->run);
		r = -(int)err->code;
	}
	return r ? r : outputs_publish(t->run, err);
}

static int share_outputs(struct task *t, uint32_t tasks, struct err *err)
{
	const struct stream_tail tail = gather_tail(&t->in);
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	struct outputs_share share = {.block = gather_share_block(t->p),
				      .tail = {.vertices = tail.vertices,
					       .triangles = tail.triangles,
					       .digest = digest_hex(tail.digest, digest),
					       .vertex_digest = digest_hex(tail.vertex_digest, vertex_digest)}};
	const struct outputs_options opt = {
		.part = t->part, .share_of = &share, .interrupted = work_interrupted, .ctx = t->p->work};
	struct gather_share_sums sums = {.vertices = 0};
	char own[GATHER_PART];
	uint64_t memory = 0;
	double waited = 0;
	uint64_t range[2];
	int r = gather_input_needs(&t->in, &memory, err);

	memcpy(own, t->part, sizeof(own));
	t->head = calloc(1, sizeof(*t->head));
	if (!r && !t->head)
		r = err_set(err, ERR_NOMEM, "no memory to write a mesh");
	if (!r)
		r = gather_places_new(&t->in, memory / 2, &t->places, err);
	if (!r)
		r = gather_share_of(t->places, t->index, tasks, range, &share, err);
	if (!r)
		r = gather_share_agree(t->p, t->attempt, own, t->part, err);
	if (r)
		return r;
	while ((r = ctl_fetch_make(t->p->outputs, &opt, &t->run, err)) && (r == -ERR_GONE || err->sys == ESTALE) &&
	       work_wait(t->p->work, &waited))
		err_clear(err); /* a file that another node made is seen late */
	if (!r)
		r = write_shared(t, &tail, range, &sums, err);
	if (r == -ERR_GONE)
		gather_share_gone(t->p, err);
	return r ? r : record_shared(t, &sums, err);
}

static int run(struct task *t, struct err *err)
{
	const uint32_t tasks = work_about(t->p->work)->tasks[WORK_GATHER];
	bool any = true;
	int r;

	if (tasks > 1)
		t->divides = gather_divides_tiles(t->p->outputs) ? BY_TILES :
			     gather_shares(t->p->outputs)        ? BY_RECORDS :
								   BY_NOTHING;
	if (!t->divides && t->index)
		return 0;
	r = gather_input_read(&t->in, t->p, t->index, err);
	if (!r && t->divides == BY_TILES)
		r = gather_tiles_new(&t->in, &t->tiles, err);
	if (!r && t->divides == BY_TILES)
		any = gather_tiles_share(t->in.border, t->index, t->index + 1 == tasks, t->in.sums.triangles, t->share);
	if (!r && any)
		r = t->divides == BY_RECORDS ? share_outputs(t, tasks, err) : write_outputs(t, err);
	return r || !any ? r : write_list(t, err);
}

static int make(void *ctx, struct work_attempt *attempt, uint32_t index, struct err *err)
{
	struct task *t = ctx;
	int r;

	t->attempt = attempt;
	gather_part_name(t->p, index, work_attempt_number(attempt), t->part);
	r = run(t, err);
	if (r && t->published)
		outputs_part_drop(t->run);
	t->published &= !r;
	return r;
}

int gather_task(const struct gather_params *p, uint32_t index, struct err *err)
{
	struct task t = {.p = p, .index = index};
	int r = work_run(p->work, WORK_GATHER, index, make, &t, err);

	if (r == WORK_E_LOST && t.published)
		outputs_part_drop(t.run);
	feed_done(&t.feed);
	outputs_free(t.run);
	gather_places_free(t.places);
	free(t.head);
	gather_tiles_free(t.tiles);
	gather_input_done(&t.in);
	return r > 0 ? 0 : r;
}
