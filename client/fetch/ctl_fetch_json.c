/* The report of a mesh, as JSON. */
#include <stdlib.h>
#include <string.h>

#include "ctl_fetch.h"

/* A fetched job does not know what its pushes moved and left out: null. */
static void moved_json(struct term_json *j, const struct ctl_staged *staged)
{
	double shift[3];
	uint64_t moved = ctl_mesh_moved(staged, shift), left_out = 0;

	if (!staged) {
		term_json_null(j, "moved");
		term_json_null(j, "max_shift");
		term_json_null(j, "lines_left_out");
		return;
	}
	for (size_t i = 0; i < staged->nfile; i++)
		left_out += staged->file[i].refused ? 0 : staged->file[i].left_out;
	term_json_u64(j, "moved", moved);
	term_json_numbers(j, "max_shift", shift, 3);
	term_json_u64(j, "lines_left_out", left_out);
}

/* How much was read of each input. */
static void inputs_json(struct term_json *j, const struct ctl_staged *staged)
{
	term_json_open(j, "inputs", '[');
	for (size_t i = 0; staged && i < staged->nfile; i++) {
		const struct ctl_staged_file *f = &staged->file[i];

		if (f->refused)
			continue;
		term_json_open(j, NULL, '{');
		term_json_text(j, "file", f->name);
		term_json_u64(j, "points", f->points);
		term_json_u64(j, "bytes_read", f->bytes_read);
		term_json_u64(j, "bytes_total", f->bytes);
		term_json_bool(j, "partial", f->partial);
		term_json_text(j, "overridden", f->overridden);
		term_json_close(j, '}');
	}
	term_json_close(j, ']');
}

static void changes_json(struct term_json *j, const struct ctl_mesh *m)
{
	const struct outputs_changes_counts *c = &m->out->changes;

	if (!m->opt->since) {
		term_json_null(j, "changes");
		return;
	}
	term_json_open(j, "changes", '{');
	term_json_u64(j, "since", c->since);
	term_json_u64(j, "old_job", c->old_job);
	term_json_u64(j, "gone", c->gone);
	term_json_u64(j, "gone_triangles", c->gone_triangles);
	term_json_u64(j, "kept", c->kept);
	term_json_u64(j, "kept_triangles", c->kept_triangles);
	term_json_u64(j, "new", c->new_regions);
	term_json_u64(j, "new_triangles", c->new_triangles);
	term_json_close(j, '}');
}

static void tiles_json(struct term_json *j, const struct ctl_mesh *m)
{
	const char *dir = m->opt->output[1].path;
	size_t n = m->opt->tile || m->opt->levels ? strlen(dir) : 0;
	char *index;

	if (!m->opt->tile && !m->opt->levels) {
		term_json_null(j, "tiles");
		return;
	}
	if (asprintf(&index, "%s%s%s", dir, n && dir[n - 1] == '/' ? "" : "/", ctl_mesh_index(m->opt)) < 0)
		index = NULL;
	term_json_open(j, "tiles", '{');
	term_json_u64(j, "files", m->out->tiles);
	term_json_text(j, "size", m->opt->tile);
	term_json_text(j, "folder", dir);
	term_json_text(j, "index", index);
	term_json_close(j, '}');
	free(index);
}

static void count_json(struct term_json *j, const struct outputs_left_out *left)
{
	term_json_u64(j, "triangles", left->triangles);
	term_json_number(j, "area", left->area);
}

static void length_json(struct term_json *j, const char *name, const struct outputs_left_out *left)
{
	if (!left->given) {
		term_json_null(j, name);
		return;
	}
	term_json_open(j, name, '{');
	count_json(j, left);
	term_json_close(j, '}');
}

static void cut_json(struct term_json *j, const char *name, const struct outputs_left_out *left, const struct cli_texts *file,
		     const char *digest)
{
	if (!file->n) {
		term_json_null(j, name);
		return;
	}
	term_json_open(j, name, '{');
	term_json_open(j, "files", '[');
	for (unsigned i = 0; i < file->n; i++)
		term_json_text(j, NULL, file->text[i]);
	term_json_close(j, ']');
	term_json_text(j, "digest", digest);
	count_json(j, left);
	term_json_close(j, '}');
}

static void left_out_json(struct term_json *j, const struct ctl_mesh *m)
{
	const struct outputs_left_out *by = m->out->left_out_by;

	if (!ctl_mesh_trims(m->opt)) {
		term_json_null(j, "left_out");
		return;
	}
	term_json_open(j, "left_out", '{');
	count_json(j, &m->out->left_out);
	term_json_text(j, "written_digest", m->out->written);
	cut_json(j, "mask", &by[OUTPUTS_BY_MASK], &m->opt->cut[OUTPUTS_MASK], m->out->cut[OUTPUTS_MASK]);
	cut_json(j, "erase", &by[OUTPUTS_BY_ERASE], &m->opt->cut[OUTPUTS_ERASE], m->out->cut[OUTPUTS_ERASE]);
	length_json(j, "max_edge", &by[OUTPUTS_BY_EDGE]);
	length_json(j, "trim_hull", &by[OUTPUTS_BY_HULL]);
	term_json_close(j, '}');
}

static void simplified_json(struct term_json *j, const struct ctl_mesh *m)
{
	if (!ctl_mesh_simplifies(m->opt)) {
		term_json_null(j, "simplified");
		return;
	}
	term_json_open(j, "simplified", '{');
	term_json_u64(j, "vertices", m->out->simplified.vertices);
	term_json_u64(j, "left_out", m->out->simplified.left_out);
	term_json_close(j, '}');
}

void ctl_mesh_json(const struct ctl_mesh *m)
{
	const struct acut_job *job = m->job;
	const struct acut_report *p = &job->report;
	const char *z = ctl_fetch_z_unit(m->opt);
	struct term_json j = console_json(m->console);
	char note[CTL_MESH_NOTE], bound[CTL_MESH_NOTE];

	term_json_u64(&j, "job", job->id);
	term_json_known(&j, "dataset", job->dataset);
	term_json_u64(&j, "generation", job->generation);
	ctl_report_mesh(&j, p);
	ctl_report_lattice(&j, job->lattice);
	/* of what was written */
	ctl_report_units(&j, job->crs, job->unit_xy, z ? format_unit_of_word(z, strlen(z)) : job->unit_z);
	moved_json(&j, m->staged);
	ctl_report_heights_json(&j, m->staged, NULL);
	ctl_report_lines_json(&j, m->staged);
	inputs_json(&j, m->staged);
	term_json_u64(&j, "output_bytes", m->out->bytes);
	ctl_mesh_edges_json(&j, m);
	left_out_json(&j, m);
	simplified_json(&j, m);
	tiles_json(&j, m);
	changes_json(&j, m);
	term_json_open(&j, "refused", '[');
	for (size_t i = 0; m->staged && i < m->staged->nfile; i++)
		if (m->staged->file[i].refused)
			term_error_json(&j, NULL, &m->staged->file[i].err);
	term_json_close(&j, ']');
	ctl_report_notes(&j, p, ctl_mesh_no_lines(m, note), ctl_fetch_bound(job, m->opt->max_error, bound));
	term_json_open(&j, "warnings", '[');
	for (size_t i = 0; i < m->console->nwarning; i++)
		term_json_text(&j, NULL, m->console->warning[i]);
	term_json_close(&j, ']');
	term_json_end(&j);
}
