/* What is odd about a mesh that was written: warnings, and the numbers of its edges. No triangle is left out for it. */
#include <math.h>

#include "ctl_fetch.h"

#define LONG_SHARE 0.5 /* of the area of the mesh */

/*
 * Views of the ground and the surface leave gaps, and a bridged gap is worth a warning. In other views a lake or a concave
 * border has long edges, too: there the warning is for meshes most of whose area is in triangles far above the spacing of the
 * survey, as with points far from the rest, or strips with nothing between them.
 */
void ctl_mesh_warn_edges(const struct ctl_mesh *m)
{
	const struct outputs_report *out = m->out;

	if (out->median_edge <= 0 || out->longest_edge <= OUTPUTS_LONG_EDGE * out->median_edge)
		return;
	if (out->long_share > LONG_SHARE)
		console_warn(
			m->console,
			"%.3g %% of the mesh's area are triangles with edges above %.3g, %d times the median; the longest edge is "
			"%.6g: there are points far from the rest, or gaps that are bridged; --crop takes the part that is meant, "
			"--max-edge LENGTH leaves such triangles out",
			floor(1000 * out->long_share) / 10, OUTPUTS_LONG_EDGE * out->median_edge, OUTPUTS_LONG_EDGE,
			out->longest_edge);
	else if (m->opt->gaps)
		console_warn(m->console,
			     "the longest edge is %.6g, %.0f times the median of %.3g: gaps are bridged; --max-edge LENGTH "
			     "leaves such triangles out",
			     out->longest_edge, out->longest_edge / out->median_edge, out->median_edge);
}

void ctl_mesh_warn_trimmed(const struct ctl_mesh *m)
{
	const struct ctl_fetch_options *o = m->opt;

	if (m->out->all_left_out)
		console_warn(m->console, "no triangle is left: all were left out%s",
			     o->cut[OUTPUTS_MASK].n || o->cut[OUTPUTS_ERASE].n ?
				     "; are the areas in the coordinate system of the dataset, and not in degrees?" :
				     "");
}

void ctl_mesh_edges_json(struct term_json *j, const struct ctl_mesh *m)
{
	if (m->opt->since || m->out->median_edge <= 0) {
		term_json_null(j, "edges");
		return;
	}
	term_json_open(j, "edges", '{');
	term_json_number(j, "longest", m->out->longest_edge);
	term_json_number(j, "median", m->out->median_edge);
	term_json_number(j, "long_share", m->out->long_share);
	term_json_close(j, '}');
}
