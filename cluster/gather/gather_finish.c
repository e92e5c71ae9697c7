/*
 * The phase finish: joins the parts of the outputs, gives them their names, and writes the report.
 *
 * The numbers of the mesh are those of the records, and the indexes of all packs must have them, too. Parts of tiles must have
 * all triangles between them: their sums are compared with these. Names are given after everything was read and compared; if that
 * is interrupted, the next attempt does it again. What parts leave beside the outputs is removed at the end.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "clock.h"
#include "feed.h"
#include "gather_priv.h"
#include "io.h"

struct finish {
	const struct gather_params *p;
	struct work_attempt *attempt; /* while it runs */
	struct gather_input in;
	struct outputs *run;
	struct feed feed;
	struct stream_head *head;
	char (*part)[GATHER_PART]; /* those that were joined */
	uint32_t nparts;
	int64_t begun_us; /* of the first task */
	uint64_t peak;
	bool shared;                      /* all tasks have written the same files */
	struct gather_share_sums written; /* by them */
	char own[GATHER_PART];
	char agreed[GATHER_PART]; /* if shared: the name of these files */
};

/* ---- the parts ---- */

int gather_list_read(const struct gather_params *p, const struct work_file *file, uint8_t **ret, size_t *ret_size,
		     struct err *err)
{
	uint8_t *bytes = file->size < SIZE_MAX ? malloc(file->size + 1) : NULL;
	struct digest sum;
	int fd = -1, r = bytes ? 0 : err_set(err, ERR_NOMEM, "no memory for a list of outputs");

	if (!r)
		r = work_file_open(p->work, file->name, file->size, &fd, err);
	if (!r)
		r = io_read_at(fd, bytes, file->size, 0, file->name, err);
	io_close(fd);
	if (!r && file->size >= sizeof(sum)) {
		*ret_size = file->size - sizeof(sum);
		memcpy(&sum, bytes + *ret_size, sizeof(sum));
	}
	if (!r && (file->size < sizeof(sum) || !digest_equal(sum, digest_hash(bytes, *ret_size)))) {
		err_set(err, ERR_CORRUPT, "the list of outputs is damaged");
		r = err_add_file(err, file->name);
	}
	if (r)
		free(bytes);
	else
		*ret = bytes;
	return r;
}

/* What a task has written of files that all of them write. */
static int add_written(struct finish *f, const struct work_record *record, struct err *err)
{
	const char *digest = work_record_text(record, "digest"), *vertex_digest = work_record_text(record, "vertex_digest");
	struct digest sum[2];
	uint64_t vertices = 0, triangles = 0;
	int r = work_record_u64(record, "vertices", &vertices, err);

	if (!r)
		r = work_record_u64(record, "triangles", &triangles, err);
	if (!r && !(digest && digest_parse(digest, &sum[0]) && vertex_digest && digest_parse(vertex_digest, &sum[1])))
		r = err_set(err, ERR_CORRUPT, "the record of gather %u has no digests", record->task);
	if (r)
		return r;
	f->written.vertices += vertices;
	f->written.triangles += triangles;
	digest_add(&f->written.digest, sum[0]);
	digest_add(&f->written.vertex_digest, sum[1]);
	return 0;
}

/* All tasks together have written the mesh of the packs. */
static int check_shared(const struct finish *f, struct err *err)
{
	const struct gather_share_sums *w = &f->written;
	const struct mesh_sums *s = &f->in.sums;

	if (w->vertices == s->vertices && w->triangles == s->triangles && digest_equal(w->digest, s->digest) &&
	    digest_equal(w->vertex_digest, s->vertex_digest))
		return 0;
	return err_set(
		err, ERR_DIGEST,
		"the tasks of gather have written %llu vertices and %llu triangles, or other ones, and the mesh has %llu and %llu",
		(unsigned long long)w->vertices, (unsigned long long)w->triangles, (unsigned long long)s->vertices,
		(unsigned long long)s->triangles);
}

static int join_one(struct finish *f, uint32_t task, struct err *err)
{
	struct work_record *record = NULL;
	const char *part = NULL;
	uint8_t *bytes = NULL;
	size_t size = 0;
	int r = work_record_need(f->p->work, WORK_GATHER, task, &record, err);

	if (!r) {
		f->peak = record->peak > f->peak ? record->peak : f->peak;
		part = work_record_text(record, "part");
	}
	if (!r && f->shared && strcmp(part ? part : "", f->agreed) != 0)
		r = err_set(err, ERR_GONE, "task %u of gather has written outputs that are not there any more", task);
	if (!r && f->shared)
		r = add_written(f, record, err);
	if (!r && record->nfile && !part)
		r = err_set(err, ERR_CORRUPT, "the record of task %u of gather has no part", task);
	if (!r && record->nfile)
		r = gather_list_read(f->p, &record->file[0], &bytes, &size, err);
	if (bytes)
		r = outputs_join(f->run, part, bytes, size, err);
	if (bytes && r)
		err_add_file(err, record->file[0].name);
	if (bytes && !r)
		snprintf(f->part[f->nparts++], GATHER_PART, "%s", part);
	free(bytes);
	work_record_free(record);
	return r;
}

static int join_all(struct finish *f, struct err *err)
{
	const uint32_t n = work_about(f->p->work)->tasks[WORK_GATHER];
	int r;

	f->part = calloc(n + 1, sizeof(*f->part));
	r = f->part ? 0 : err_set(err, ERR_NOMEM, "no memory for the parts of the outputs");
	for (uint32_t i = 0; i < n && !r; i++)
		r = join_one(f, i, err);
	return r;
}

static int from_run(const struct finish *f, int r, struct err *err)
{
	if (r && outputs_error(f->run)->code)
		*err = *outputs_error(f->run);
	return r && err->code ? -(int)err->code : r;
}

/* An attempt that is late gives up before it changes an output that another one has finished: its user may have begun a new run
 * with the same outputs. */
static int given_up(void *ctx)
{
	const struct finish *f = ctx;
	struct err ignored = ERR_INIT;
	struct work_record *record = NULL;

	if (work_interrupted(f->p->work))
		return 1;
	if (work_record_look(f->p->work, WORK_FINISH, 0, &record, &ignored))
		return 0;
	work_record_free(record);
	return 1;
}

/* A file that another node made may be seen late, or be stale at first. Of tiles it is the folder that was looked at already. */
static int publish(struct finish *f, struct err *err)
{
	const bool files = !f->p->outputs->tile && !f->p->outputs->levels;
	double waited = 0;
	int r;

	while ((r = outputs_publish(f->run, err)) && files && (r == -ERR_GONE || err->sys == ESTALE) && !given_up(f) &&
	       work_wait(f->p->work, &waited))
		err_clear(err);
	return r;
}

/* Head, parts, tail: then the outputs have their names. */
static int join(struct finish *f, struct err *err)
{
	struct outputs_options opt = {.part = f->own,
				      .joins = true,
				      .tiles_most = UINT32_MAX,
				      /* gather has refused too many */ .interrupted = given_up,
				      .ctx = f};
	const struct stream_tail tail = gather_tail(&f->in);
	struct acut_mesh_sink sink;
	int r = ctl_fetch_make(f->p->outputs, &opt, &f->run, err);

	if (r)
		return r;
	sink = outputs_sink(f->run);
	f->feed.sink = &sink;
	gather_head(&f->in, f->head);
	r = feed_begin(&f->feed, f->head, err);
	if (!r)
		r = from_run(f, feed_head(&f->feed, f->head, err), err);
	if (!r && f->shared)
		r = gather_share_agreed(f->p, f->agreed, err);
	if (r == WORK_E_ABSENT)
		r = err_set(err, ERR_GONE, "nothing says which files the tasks have written");
	if (!r)
		r = join_all(f, err);
	if (!r && f->shared)
		r = check_shared(f, err);
	if (!r)
		r = from_run(f, feed_tail(&f->feed, &tail, err), err);
	outputs_about(f->run, 0, NULL, f->in.manifest->generation);
	return r ? r : publish(f, err);
}

/* ---- the report ---- */

/* When the first task began, and the most memory of one, as far as there are records. */
static int look_back(struct finish *f, struct err *err)
{
	const struct work_about *about = work_about(f->p->work);
	int r = 0;

	for (enum work_phase phase = 0; phase < WORK_GATHER && !r; phase++)
		for (uint32_t i = 0; i < about->tasks[phase] && !r; i++) {
			struct work_record *record = NULL;

			r = work_record_look(f->p->work, phase, i, &record, err);
			if (r == WORK_E_ABSENT)
				r = 0;
			if (r || !record)
				continue;
			if (!f->begun_us || record->begun_us < f->begun_us)
				f->begun_us = record->begun_us;
			f->peak = record->peak > f->peak ? record->peak : f->peak;
			work_record_free(record);
		}
	return r;
}

static int write_report(struct finish *f, const char *suffix, const char *text, size_t n, struct err *err)
{
	char name[WORK_NAME];
	int fd = -1, r = work_attempt_file(f->attempt, "", "report", suffix, name, err);

	if (!r)
		r = io_open(work_fd(f->p->work), name, O_WRONLY | O_CREAT | O_EXCL, 0640, &fd, err);
	if (!r)
		r = io_write_at(fd, text, n, 0, name, err);
	if (!r)
		r = io_sync(fd, name, err);
	io_close(fd);
	return r ? r : work_result_file(f->attempt, name, err);
}

/* As acutctl mesh prints it. */
static int report_as(struct finish *f, const struct acut_job *job, const struct outputs_report *out, bool json, struct err *err)
{
	struct console console = {.program = "acut-cluster", .json = json, .no_progress = true, .keeps_warnings = true};
	const struct ctl_mesh mesh = {&console, f->p->outputs, job, out, NULL};
	char *text = NULL;
	size_t n = 0;
	int r;

	console.report = open_memstream(&text, &n);
	if (!console.report)
		return err_set(err, ERR_NOMEM, "no memory for a report");
	ctl_mesh_warn_edges(&mesh);
	ctl_mesh_warn_trimmed(&mesh);
	ctl_report_warn_crowded(&console, &job->report);
	if (json)
		ctl_mesh_json(&mesh);
	else
		ctl_mesh_text(&mesh);
	for (size_t i = 0; i < console.nwarning; i++) {
		if (!json)
			fprintf(console.report, "warning: %s\n", console.warning[i]);
		free(console.warning[i]);
	}
	free(console.warning);
	r = fclose(console.report) ? err_set(err, ERR_NOMEM, "no memory for a report") : 0;
	if (!r)
		r = write_report(f, json ? ".json" : ".txt", text, n, err);
	free(text);
	return r;
}

static void add_counts(const struct gather_input *in, struct acut_report *p, struct acut_removed *removed)
{
	const struct lattice *l = &in->manifest->lattice;
	const struct mesh_counts *c = in->sums.domains ? &in->sums.counts : &in->plan.empty;

	p->points = c->points;
	p->halo = c->halo;
	p->cells_read = c->cells_read;
	p->points_read = c->points_read;
	p->most_points = c->most.points;
	if (c->most.points) {
		p->most_at[0] = decimal_scaled_double(l->scale_xy, c->most.x + l->k[0]);
		p->most_at[1] = decimal_scaled_double(l->scale_xy, c->most.y + l->k[1]);
	}
	for (int i = 1; i < VIEW_RULES; i++)
		removed[p->nremoved++] = (struct acut_removed){view_rule_text((enum view_rule)i), c->removed[i]};
}

static int report(struct finish *f, struct err *err)
{
	const struct mesh_sums *s = &f->in.sums;
	const struct grid_manifest *m = f->in.manifest;
	char lattice[LATTICE_TEXT_SIZE], digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	struct acut_removed removed[MESH_RULES];
	struct outputs_report out;
	struct acut_job job = {.generation = m->generation,
			       .dataset = "",
			       .view = f->head->view,
			       .state = "done",
			       .lattice = lattice_text(&m->lattice, lattice),
			       .crs = m->crs,
			       .unit_xy = m->unit_xy,
			       .unit_z = m->unit_z,
			       .final = true,
			       .has_report = true};
	struct acut_report *p = &job.report;
	int r = look_back(f, err);

	*p = (struct acut_report){.used = s->vertices,
				  .vertices = s->vertices,
				  .triangles = s->triangles,
				  .hull = s->hull,
				  .domains = s->domains,
				  .digest = digest_hex(s->digest, digest),
				  .vertex_digest = digest_hex(s->vertex_digest, vertex_digest),
				  .note = "",
				  .max_error = "",
				  .removed = removed,
				  .peak_rss_bytes = f->peak};
	if (f->begun_us)
		p->seconds = (double)(clock_real_us() - f->begun_us) / 1e6;
	add_counts(&f->in, p, removed);
	outputs_report(f->run, &out);
	if (!r)
		r = report_as(f, &job, &out, true, err);
	if (!r)
		r = report_as(f, &job, &out, false, err);
	if (!r)
		r = work_result(f->attempt, "digest", p->digest, err);
	if (!r)
		r = work_result(f->attempt, "vertex_digest", p->vertex_digest, err);
	if (!r)
		r = work_result_u64(f->attempt, "vertices", s->vertices, err);
	if (!r)
		r = work_result_u64(f->attempt, "triangles", s->triangles, err);
	return r ? r : work_result_u64(f->attempt, "output_bytes", out.bytes, err);
}

/* ---- the task ---- */

static int run(struct finish *f, struct err *err)
{
	int r = gather_input_read(&f->in, f->p, 0, err);

	f->head = calloc(1, sizeof(*f->head));
	f->shared = work_about(f->p->work)->tasks[WORK_GATHER] > 1 && gather_shares(f->p->outputs);
	if (!r && !f->head)
		r = err_set(err, ERR_NOMEM, "no memory to finish a run");
	if (!r)
		r = gather_input_check(&f->in, err);
	if (!r)
		r = join(f, err);
	if (r == -ERR_GONE && f->shared)
		gather_share_gone(f->p, err);
	return r ? r : report(f, err);
}

/* The folders of the parts are empty now, and parts of other attempts at them are not needed any more. */
static void sweep(struct finish *f)
{
	struct err ignored = ERR_INIT;

	gather_sweep(f->p, true, &ignored);
}

static int make(void *ctx, struct work_attempt *attempt, uint32_t index, struct err *err)
{
	struct finish *f = ctx;

	f->attempt = attempt;
	gather_part_name(f->p, GATHER_FINISH, work_attempt_number(attempt), f->own);
	return run(f, err);
}

int gather_finish(const struct gather_params *p, struct err *err)
{
	struct finish f = {.p = p};
	int r = work_run(p->work, WORK_FINISH, 0, make, &f, err);

	f.run = outputs_free(f.run);
	if (!r || r == WORK_E_LOST)
		sweep(&f);
	feed_done(&f.feed);
	gather_input_done(&f.in);
	free(f.head);
	free(f.part);
	return r > 0 ? 0 : r;
}
