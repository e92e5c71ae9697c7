/*
 * What a mesh has become, for people. On a terminal: a page, a line a subject, with files and their sizes, what was left
 * out by which rule, what was assumed of units and coordinate systems, time, rate, memory and digest. Anywhere else:
 * sentences, as scripts that keep logs know them. Programs read --json.
 */
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "ctl.h"
#include "term.h"
#include "parse.h"

/* How many points of this command's inputs the lattice moved, and the largest shift an axis. */
uint64_t ctl_summary_moved(const struct ctl_staged *staged, double ret_shift[3])
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
static void inputs_text(struct program *ctl, const struct ctl_staged *staged)
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
		console_line(&ctl->session.console, "%u COPC input%s read in part: %s of %s bytes", n, n == 1 ? "" : "s",
			     term_count(read, a), term_count(bytes, b));
	ctl_assume_text(ctl, staged);
}

static void changes_text(struct program *ctl, const struct format_changes *c)
{
	char a[32], b[32], d[32];

	if (!c->gone && !c->new_regions)
		console_line(&ctl->session.console, "nothing has changed since generation %llu: all %s region%s",
			     (unsigned long long)ctl->args.since, term_count(c->kept, a), c->kept == 1 ? " holds" : "s hold");
	else
		console_line(&ctl->session.console, "since generation %llu: %s region%s gone, with %s triangles; %s hold%s",
			     (unsigned long long)ctl->args.since, term_count(c->gone, a), c->gone == 1 ? " is" : "s are",
			     term_count(c->gone_triangles, b), term_count(c->kept, d), c->kept == 1 ? "s" : "");
	if (c->new_regions)
		console_line(&ctl->session.console, "  new: %s region%s, with %s triangles", term_count(c->new_regions, a),
			     c->new_regions == 1 ? "" : "s", term_count(c->new_triangles, b));
}

static void left_out_text(struct program *ctl, const struct format_report *out)
{
	char count[32];

	term_count(out->left_out, count);
	if (isnan(out->left_out_area))
		console_line(&ctl->session.console, "%s triangles with edges longer than %s were left out", count,
			     ctl->args.max_edge);
	else
		console_line(&ctl->session.console,
			     "%s triangles with edges longer than %s were left out, an area of %.6g square %s", count,
			     ctl->args.max_edge, out->left_out_area,
			     !strcmp(out->unit_xy, "metre") ? "metres" :
			     !strcmp(out->unit_xy, "foot")  ? "feet" :
							      "US survey feet");
}

/* ---- on a terminal ---- */

static void files(struct program *ctl, FILE *out, const struct format_report *f)
{
	char size[32], count[32];
	struct stat st;

	for (unsigned i = 0; i < ctl->args.out.n; i++) {
		const char *name = ctl->args.out.text[i];

		if (ctl->args.tile)
			term_field(out, i ? "" : "written", "%s: %s tile%s and " FORMAT_TILES_INDEX ", %s", name,
				   term_count(f->tiles, count), f->tiles == 1 ? "" : "s", parse_size_text(f->bytes, size));
		else if (!strcmp(name, "-"))
			term_field(out, i ? "" : "written", "standard output, %s", parse_size_text(f->bytes, size));
		else if (!stat(name, &st) && S_ISREG(st.st_mode))
			term_field(out, i ? "" : "written", "%s, %s", name, parse_size_text((uint64_t)st.st_size, size));
		else
			term_field(out, i ? "" : "written", "%s", name);
	}
}

static void points(struct program *ctl, FILE *out, const struct acut_report *p, const struct ctl_staged *staged)
{
	char a[32], b[32];
	double shift[3];
	uint64_t moved = ctl_summary_moved(staged, shift);
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

/* Who says what the coordinates are in: the files, or the options, or nobody. */
static void place(struct program *ctl, FILE *out, const struct acut_job *job, const struct ctl_staged *staged)
{
	const struct ctl_args *a = &ctl->args;
	bool known = job->crs && *job->crs && strcmp(job->crs, "unknown");

	term_field(out, "crs", "%s%s", known ? job->crs : "unknown",
		   !known || !staged ? "" :
		   a->assume_crs     ? " (--assume-crs, where the inputs say none)" :
		   a->override_crs   ? " (--override-crs)" :
				       "");
	term_field(out, "units", "%s, heights %s%s", job->unit_xy, a->z_unit ? a->z_unit : job->unit_z,
		   !staged           ? "" :
		   a->assume_units   ? " (--assume-units, where the inputs say none)" :
		   a->override_units ? " (--override-units)" :
				       "");
	if (staged && staged->zone[0])
		term_field(out, "projected", "degrees to zone %s", staged->zone);
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

static void left_out(struct program *ctl, FILE *out, const struct format_report *f)
{
	char count[32];

	if (isnan(f->left_out_area))
		term_field(out, "max-edge", "%s triangles with edges above %s are not in the file",
			   term_count(f->left_out, count), ctl->args.max_edge);
	else
		term_field(out, "max-edge", "%s triangles with edges above %s are not in the file, %.6g square %s",
			   term_count(f->left_out, count), ctl->args.max_edge, f->left_out_area,
			   !strcmp(f->unit_xy, "metre") ? "metres" :
			   !strcmp(f->unit_xy, "foot")  ? "feet" :
							  "US survey feet");
}

static void mesh(FILE *out, const struct acut_report *p)
{
	char a[32], b[32], domains[96];

	term_field(out, "mesh", "%s vertices, %s triangles in %s", term_count(p->vertices, a), term_count(p->triangles, b),
		   ctl_job_domains(p, domains, sizeof(domains)));
}

static void page(struct program *ctl, const struct acut_job *job, const struct format_report *f, const struct ctl_staged *staged)
{
	const struct acut_report *p = &job->report;
	FILE *out = ctl->session.console.report;

	if (ctl->session.console.quiet)
		return;
	files(ctl, out, f);
	if (ctl->args.since)
		changes_text(ctl, &f->changes);
	points(ctl, out, p, staged);
	mesh(out, p);
	if (ctl->args.max_edge)
		left_out(ctl, out, f);
	place(ctl, out, job, staged);
	if (staged)
		ctl_height_text(ctl, staged);
	times(out, p, staged);
	term_field(out, "digest", "%s", p->digest);
	inputs_text(ctl, staged);
	console_note(&ctl->session.console, "%s", p->note);
}

/* ---- anywhere else ---- */

static void lines(struct program *ctl, const struct acut_job *job, const struct format_report *out,
		  const struct ctl_staged *staged)
{
	const struct acut_report *p = &job->report;
	char a[32], b[96], c[32];
	double shift[3];
	uint64_t moved = ctl_summary_moved(staged, shift);

	for (unsigned i = 0; i < ctl->args.out.n; i++)
		if (ctl->args.tile)
			console_line(&ctl->session.console, "wrote %s tile%s and " FORMAT_TILES_INDEX " into %s",
				     term_count(out->tiles, a), out->tiles == 1 ? "" : "s", ctl->args.out.text[i]);
		else if (strcmp(ctl->args.out.text[i], "-"))
			console_line(&ctl->session.console, "wrote %s", ctl->args.out.text[i]);
	if (ctl->args.since)
		changes_text(ctl, &out->changes);
	if (p->window)
		console_line(&ctl->session.console, "%s points read: %s vertices", term_count(p->points, b),
			     term_count(p->vertices, c));
	else
		console_line(&ctl->session.console, "%s points used of %s: %s vertices", term_count(p->used, a),
			     term_count(p->points, b), term_count(p->vertices, c));
	inputs_text(ctl, staged);
	if (moved)
		console_line(&ctl->session.console, "  rounded to the lattice: %s, by at most %.6g %.6g %.6g",
			     term_count(moved, a), shift[0], shift[1], shift[2]);
	if (staged)
		ctl_height_text(ctl, staged);
	for (size_t i = 0; i < p->nremoved; i++)
		if (p->removed[i].count)
			console_line(&ctl->session.console, "  left out by %s: %s", p->removed[i].rule,
				     term_count(p->removed[i].count, a));
	console_line(&ctl->session.console, "%s triangles in %s, %.1f s; digest %s", term_count(p->triangles, a),
		     ctl_job_domains(p, b, sizeof b), p->seconds, p->digest);
	console_note(&ctl->session.console, "%s", p->note);
	if (ctl->args.max_edge)
		left_out_text(ctl, out);
}

void ctl_summary(struct program *ctl, const struct acut_job *job, const struct format_report *out,
		 const struct ctl_staged *staged)
{
	if (term_of(ctl->session.console.report).on)
		page(ctl, job, out, staged);
	else
		lines(ctl, job, out, staged);
}

void ctl_summary_job(struct program *ctl, const struct acut_job *job)
{
	FILE *out = ctl->session.console.report;

	if (ctl->session.console.quiet || ctl->session.console.json || !job->has_report || job->has_error || !term_of(out).on)
		return;
	points(ctl, out, &job->report, NULL);
	mesh(out, &job->report);
	times(out, &job->report, NULL);
	term_field(out, "digest", "%s", job->report.digest);
	term_field(out, "next", "acutctl fetch %llu -o mesh.ply", (unsigned long long)job->id);
}
