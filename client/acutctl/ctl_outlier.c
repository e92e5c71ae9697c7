/*
 * What is far from the rest of a mesh: long edges, and many points at one position. Told once, when a mesh was written; no
 * point is left out for it.
 */
#include <math.h>
#include <string.h>

#include "ctl.h"

#define LONG_SHARE 0.5 /* of the area of the mesh */

/*
 * Long edges. With --ground and --surface gaps are made by the view itself, and any is worth a word. Else a lake, or the
 * bay of a concave border, is nothing to warn of: what is told is when triangles far above the spacing of the survey make up
 * most of the mesh, as where points lie far from the rest, or of strips with nothing between them.
 */
static void warn_edges(struct program *ctl, const struct format_report *out)
{
	bool gaps = ctl->view.ground || ctl->view.surface;

	if (out->median_edge <= 0 || out->longest_edge <= FORMAT_LONG_EDGE * out->median_edge)
		return;
	if (out->long_share > LONG_SHARE)
		console_warn(
			&ctl->session.console,
			"%.3g %% of the mesh's area are triangles with edges above %.3g, %d times the median; the longest edge is "
			"%.6g: there are points far from the rest, or gaps that are bridged; --crop takes the part that is meant, "
			"--max-edge LENGTH leaves such triangles out",
			floor(1000 * out->long_share) / 10, FORMAT_LONG_EDGE * out->median_edge, FORMAT_LONG_EDGE,
			out->longest_edge);
	else if (gaps)
		console_warn(&ctl->session.console,
			     "the longest edge is %.6g, %.0f times the median of %.3g: gaps are bridged; --max-edge LENGTH "
			     "leaves such triangles out",
			     out->longest_edge, out->longest_edge / out->median_edge, out->median_edge);
}

/*
 * Many points at one position, as of scanners that write 0,0,0 where nothing came back: one vertex comes of them, and the
 * triangles to it span all that lies between. A hundred are no coincidence where that is a hundredth of the points, or a
 * thousand times what other positions have.
 */
bool ctl_outlier_many(uint64_t at_one, uint64_t points, uint64_t positions)
{
	double all = (double)points, one = (double)at_one;

	return at_one >= 100 && positions && (one >= all / 100 || one >= 1000 * all / (double)positions);
}

void ctl_outlier_most(struct program *ctl, const struct acut_report *p)
{
	char count[32], points[32];
	uint64_t all = p->used;

	for (size_t i = 0; i < p->nremoved; i++)
		all += strcmp(p->removed[i].rule, "duplicate") ? 0 : p->removed[i].count;
	if (p->window || !ctl_outlier_many(p->most_points, all, p->used))
		return;
	console_warn(&ctl->session.console,
		     "%s of %s points (%.3g %%) are at one position, %.15g %.15g: one vertex comes of them; if they are no "
		     "measurements, leave them out with --crop or an option of the view (--not-class, --zmin)",
		     term_count(p->most_points, count), term_count(all, points),
		     floor(1000 * (double)p->most_points / (double)all) / 10, p->most_at[0], p->most_at[1]);
}

void ctl_outlier_warn(struct program *ctl, const struct acut_report *p, const struct format_report *out)
{
	warn_edges(ctl, out);
	ctl_outlier_most(ctl, p);
}

void ctl_outlier_json(struct program *ctl, struct term_json *j, const struct format_report *out)
{
	if (ctl->args.since || out->median_edge <= 0) {
		term_json_text(j, "edges", NULL);
		return;
	}
	term_json_open(j, "edges", '{');
	term_json_number(j, "longest", out->longest_edge);
	term_json_number(j, "median", out->median_edge);
	term_json_number(j, "long_share", out->long_share);
	term_json_close(j, '}');
}
