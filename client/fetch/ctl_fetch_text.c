/*
 * The report of a mesh, for people. On a terminal: a page with a line for each subject: files and their sizes, points left
 * out by each rule, assumed units and coordinate systems, time, rate, memory and digest. Elsewhere: the sentences that logs
 * of scripts contain. Programs read --json.
 */
#include <math.h>
#include <stdarg.h>
#include <string.h>
#include <sys/stat.h>

#include "ctl_fetch.h"
#include "term.h"
#include "parse.h"

/* How many points of this command's inputs the lattice moved, and the largest shift an axis. */
uint64_t ctl_mesh_moved(const struct ctl_staged *staged, double ret_shift[3])
{
	uint64_t moved = 0;

	memset(ret_shift, 0, 3 * sizeof(*ret_shift));
	for (size_t i = 0; staged && i < staged->nfile; i++) {
		const struct ctl_staged_file *f = &staged->file[i];

		moved += f->refused ? 0 : f->moved;
		for (int k = 0; !f->refused && k < 3; k++)
			ret_shift[k] = f->shift[k] > ret_shift[k] ? f->shift[k] : ret_shift[k];
	}
	return moved;
}

/* One line for all that were not read whole. */
static void inputs_text(struct console *c, const struct ctl_staged *staged)
{
	uint64_t read = 0, bytes = 0;
	unsigned n = 0;
	char a[32], b[32];

	for (size_t i = 0; staged && i < staged->nfile; i++) {
		if (staged->file[i].refused || !staged->file[i].partial)
			continue;
		read += staged->file[i].bytes_read;
		bytes += staged->file[i].bytes;
		n++;
	}
	if (n)
		console_line(c, "%u COPC input%s read in part: %s of %s bytes", n, n == 1 ? "" : "s", term_count(read, a),
			     term_count(bytes, b));
	ctl_report_overridden(c, staged);
}

static void changes_text(const struct ctl_mesh *m)
{
	const struct outputs_changes_counts *c = &m->out->changes;
	unsigned long long since = m->opt->since;
	char a[32], b[32], d[32];

	if (!c->gone && !c->new_regions)
		console_line(m->console, "nothing has changed since generation %llu: all %s region%s", since,
			     term_count(c->kept, a), c->kept == 1 ? " holds" : "s hold");
	else
		console_line(m->console, "since generation %llu: %s region%s gone, with %s triangles; %s hold%s", since,
			     term_count(c->gone, a), c->gone == 1 ? " is" : "s are", term_count(c->gone_triangles, b),
			     term_count(c->kept, d), c->kept == 1 ? "s" : "");
	if (c->new_regions)
		console_line(m->console, "  new: %s region%s, with %s triangles", term_count(c->new_regions, a),
			     c->new_regions == 1 ? "" : "s", term_count(c->new_triangles, b));
}

bool ctl_mesh_trims(const struct ctl_fetch_options *o)
{
	return o->max_edge || o->trim_hull || o->cut[OUTPUTS_MASK].n || o->cut[OUTPUTS_ERASE].n;
}

struct reasons {
	unsigned n;
	struct {
		char text[160];
		const struct outputs_left_out *left;
	} row[OUTPUTS_REASONS];
};

__attribute__((format(printf, 3, 4))) static void add_reason(struct reasons *to, const struct outputs_left_out *left,
							     const char *fmt, ...)
{
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(to->row[to->n].text, sizeof(to->row->text), fmt, ap);
	va_end(ap);
	to->row[to->n++].left = left;
}

/* Why triangles were left out. */
static struct reasons reasons_of(const struct ctl_mesh *m)
{
	const struct ctl_fetch_options *o = m->opt;
	const struct cli_texts *mask = &o->cut[OUTPUTS_MASK], *erase = &o->cut[OUTPUTS_ERASE];
	const struct outputs_left_out *by = m->out->left_out_by;
	struct reasons why = {.n = 0};

	if (o->max_edge)
		add_reason(&why, &by[OUTPUTS_BY_EDGE], "with edges longer than %s", o->max_edge);
	if (o->trim_hull)
		add_reason(&why, &by[OUTPUTS_BY_HULL], "at the hull behind edges longer than %s", o->trim_hull);
	if (mask->n)
		add_reason(&why, &by[OUTPUTS_BY_MASK], "outside of %s%s", mask->text[0], mask->n > 1 ? " and other areas" : "");
	if (erase->n)
		add_reason(&why, &by[OUTPUTS_BY_ERASE], "inside of %s%s", erase->text[0], erase->n > 1 ? " or other areas" : "");
	return why;
}

/* "12 triangles with edges longer than 30m, at the hull behind edges longer than 60m, or outside of a.geojson". */
static const char *left_out_text(const struct ctl_mesh *m, const struct reasons *why, char buf[512])
{
	char count[32];
	int at = snprintf(buf, 512, "%s triangles", term_count(m->out->left_out.triangles, count));

	for (unsigned i = 0; i < why->n && at < 512; i++)
		at += snprintf(buf + at, 512 - (size_t)at, "%s%s%s", i && why->n > 2 ? "," : "",
			       i && i == why->n - 1 ? " or " : " ", why->row[i].text);
	return buf;
}

/* PREFIX and "12.5 square metres"; nothing where the unit is not a known length. Returns buf. */
static const char *area_text(const struct outputs_report *f, const struct outputs_left_out *left, const char *prefix,
			     char buf[64])
{
	buf[0] = 0;
	if (!isnan(left->area))
		snprintf(buf, 64, "%s%.6g square %s", prefix, left->area,
			 !strcmp(f->unit_xy, "metre") ? "metres" :
			 !strcmp(f->unit_xy, "foot")  ? "feet" :
							"US survey feet");
	return buf;
}

/* ---- on a terminal ---- */

static void files(const struct ctl_mesh *m, FILE *out)
{
	const struct outputs_report *f = m->out;
	char size[32], count[32];
	struct stat st;

	for (unsigned i = 1; i <= ctl_fetch_count(m->opt); i++) {
		const char *name = m->opt->output[i].path;

		if (m->opt->tile || m->opt->levels)
			term_field(out, i > 1 ? "" : "written", "%s: %s tile%s and %s, %s", name, term_count(f->tiles, count),
				   f->tiles == 1 ? "" : "s", ctl_mesh_index(m->opt), parse_size_text(f->bytes, size));
		else if (!strcmp(name, "-"))
			term_field(out, i > 1 ? "" : "written", "standard output, %s", parse_size_text(f->bytes, size));
		else if (!stat(name, &st) && S_ISREG(st.st_mode))
			term_field(out, i > 1 ? "" : "written", "%s, %s", name, parse_size_text((uint64_t)st.st_size, size));
		else
			term_field(out, i > 1 ? "" : "written", "%s", name);
	}
}

static void points(FILE *out, const struct acut_report *p, const struct ctl_staged *staged)
{
	char a[32], b[32];
	double shift[3];
	uint64_t moved = ctl_mesh_moved(staged, shift);
	bool first = true;

	if (p->window)
		term_field(out, "points", "%s read", term_count(p->points, a));
	else
		term_field(out, "points", "%s used of %s", term_count(p->used, a), term_count(p->points, b));
	for (size_t i = 0; i < p->nremoved; i++) {
		if (!p->removed[i].count)
			continue;
		term_field(out, first ? "left out" : "", "%s by %s", term_count(p->removed[i].count, a), p->removed[i].rule);
		first = false;
	}
	if (moved)
		term_field(out, "rounded", "%s points, by at most %.6g %.6g %.6g", term_count(moved, a), shift[0], shift[1],
			   shift[2]);
	if (staged && staged->refused)
		term_field(out, "refused", "%u input%s, named above", staged->refused, staged->refused == 1 ? "" : "s");
}

/* Coordinate system and units, and whether files or options declare them. */
static void place(const struct ctl_mesh *m, FILE *out)
{
	const struct acut_job *job = m->job;
	const struct ctl_staged *staged = m->staged;
	const struct ctl_stage_options *a = staged ? staged->opt : NULL;
	bool known = job->crs && *job->crs && strcmp(job->crs, "unknown");

	term_field(out, "crs", "%s%s", known ? job->crs : "unknown",
		   !known || !staged ? "" :
		   a->assume_crs     ? " (--assume-crs, for inputs without one)" :
		   a->override_crs   ? " (--override-crs)" :
				       "");
	term_field(out, "units", "%s, heights %s%s", job->unit_xy,
		   ctl_fetch_z_unit(m->opt) ? ctl_fetch_z_unit(m->opt) : job->unit_z,
		   !staged           ? "" :
		   a->assume_units   ? " (--assume-units, for inputs without any)" :
		   a->override_units ? " (--override-units)" :
				       "");
	if (staged && staged->zone[0])
		term_field(out, "projected", "degrees to zone %s", staged->zone);
}

static const char *simplified_text(const struct ctl_mesh *m, char buf[512])
{
	char all[32], left_out[32];

	snprintf(buf, 512, "%s of %s vertices of contours", term_count(m->out->simplified.left_out, left_out),
		 term_count(m->out->simplified.vertices, all));
	return buf;
}

static void times(FILE *out, const struct acut_report *p, const struct ctl_staged *staged)
{
	char rate[32], memory[32], all[24], text[64] = "";
	double seconds = p->seconds + (staged ? p->stage_seconds : 0);
	uint64_t n = p->window ? p->points : p->used;

	if (seconds > 0.001 && n)
		snprintf(text, sizeof(text), ", %s points a second", term_count((uint64_t)((double)n / seconds), rate));
	if (seconds < 60)
		snprintf(all, sizeof(all), "%.1f s", seconds);
	else
		session_progress_time(seconds, all);
	if (staged)
		term_field(out, "time", "%s: reading %.1f s, meshing %.1f s%s", all, p->stage_seconds, p->seconds, text);
	else
		term_field(out, "time", "%s of meshing%s", all, text);
	if (p->peak_rss_bytes)
		term_field(out, "memory", "%s at most", parse_size_text(p->peak_rss_bytes, memory));
}

static void mesh(FILE *out, const struct acut_report *p)
{
	char a[32], b[32], domains[96], bound[512];

	if (*p->max_error)
		term_field(out, "bound", "%s", ctl_report_bound(p, bound, sizeof(bound)));
	term_field(out, "mesh", "%s vertices, %s triangles in %s", term_count(p->vertices, a), term_count(p->triangles, b),
		   ctl_report_domains(p, domains, sizeof(domains)));
}

static void page(const struct ctl_mesh *m)
{
	const struct acut_report *p = &m->job->report;
	FILE *out = m->console->report;
	struct reasons why = reasons_of(m);
	char area[64], text[512];

	if (m->console->quiet)
		return;
	files(m, out);
	if (m->opt->since)
		changes_text(m);
	points(out, p, m->staged);
	mesh(out, p);
	if (ctl_mesh_trims(m->opt))
		term_field(out, "trimmed", "%s%s", left_out_text(m, &why, text),
			   area_text(m->out, &m->out->left_out, ", ", area));
	for (unsigned i = 0; i < why.n && why.n > 1; i++)
		term_field(out, "", "%s %s%s", term_count(why.row[i].left->triangles, text), why.row[i].text,
			   area_text(m->out, why.row[i].left, ", ", area));
	if (ctl_mesh_simplifies(m->opt))
		term_field(out, "simplified", "%s", simplified_text(m, text));
	place(m, out);
	if (m->staged) {
		ctl_report_heights(m->console, m->staged);
		ctl_report_lines(m->console, m->staged);
	}
	times(out, p, m->staged);
	term_field(out, "digest", "%s", p->digest);
	inputs_text(m->console, m->staged);
	console_note(m->console, "%s", p->note);
}

/* ---- anywhere else ---- */

static void written(const struct ctl_mesh *m)
{
	char count[32];

	for (unsigned i = 1; i <= ctl_fetch_count(m->opt); i++)
		if (m->opt->tile || m->opt->levels)
			console_line(m->console, "wrote %s tile%s and %s into %s", term_count(m->out->tiles, count),
				     m->out->tiles == 1 ? "" : "s", ctl_mesh_index(m->opt), m->opt->output[i].path);
		else if (strcmp(m->opt->output[i].path, "-"))
			console_line(m->console, "wrote %s", m->opt->output[i].path);
}

static void lines(const struct ctl_mesh *m)
{
	const struct acut_report *p = &m->job->report;
	struct console *c = m->console;
	struct reasons why = reasons_of(m);
	char a[32], b[96], d[64], text[512];
	double shift[3];
	uint64_t moved = ctl_mesh_moved(m->staged, shift);

	written(m);
	if (m->opt->since)
		changes_text(m);
	if (p->window)
		console_line(c, "%s points read: %s vertices", term_count(p->points, b), term_count(p->vertices, d));
	else
		console_line(c, "%s points used of %s: %s vertices", term_count(p->used, a), term_count(p->points, b),
			     term_count(p->vertices, d));
	if (*p->max_error)
		console_line(c, "  no point further from the mesh than %s", ctl_report_bound(p, text, sizeof(text)));
	inputs_text(c, m->staged);
	if (moved)
		console_line(c, "  rounded to the lattice: %s, by at most %.6g %.6g %.6g", term_count(moved, a), shift[0],
			     shift[1], shift[2]);
	if (m->staged) {
		ctl_report_heights(c, m->staged);
		ctl_report_lines(c, m->staged);
	}
	for (size_t i = 0; i < p->nremoved; i++)
		if (p->removed[i].count)
			console_line(c, "  left out by %s: %s", p->removed[i].rule, term_count(p->removed[i].count, a));
	console_line(c, "%s triangles in %s, %.1f s; digest %s", term_count(p->triangles, a), ctl_report_domains(p, b, sizeof b),
		     p->seconds, p->digest);
	console_note(c, "%s", p->note);
	if (ctl_mesh_trims(m->opt))
		console_line(c, "%s were left out%s", left_out_text(m, &why, text),
			     area_text(m->out, &m->out->left_out, ", an area of ", d));
	for (unsigned i = 0; i < why.n && why.n > 1; i++)
		console_line(c, "  %s: %s triangles%s", why.row[i].text, term_count(why.row[i].left->triangles, a),
			     area_text(m->out, why.row[i].left, ", an area of ", d));
	if (ctl_mesh_simplifies(m->opt))
		console_line(c, "%s were left out by --simplify", simplified_text(m, text));
}

void ctl_mesh_text(const struct ctl_mesh *m)
{
	if (term_of(m->console->report).on)
		page(m);
	else
		lines(m);
}

void ctl_fetch_summary(struct console *c, const struct acut_job *job)
{
	FILE *out = c->report;

	if (c->quiet || c->json || !job->has_report || job->has_error || !term_of(out).on)
		return;
	points(out, &job->report, NULL);
	mesh(out, &job->report);
	times(out, &job->report, NULL);
	term_field(out, "digest", "%s", job->report.digest);
	term_field(out, "next", "acutctl fetch %llu -o mesh.ply", (unsigned long long)job->id);
}
