/* Lines of a dataset: what became of them, and the places where they cross or have several heights. */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "ctl_report.h"
#include "decimal.h"
#include "outfile.h"

char *ctl_report_lines_text(const uint64_t features[4], uint64_t lines, uint64_t vertices, char *buf, size_t size)
{
	char a[32], b[32];
	size_t n = 0;

	for (unsigned i = 0; i < LINES_KINDS && n < size; i++)
		if (features[i])
			n += (size_t)snprintf(buf + n, size - n, "%s%s %s", n ? ", " : "", term_count(features[i], a),
					      lines_kind_text[i]);
	if (n < size)
		snprintf(buf + n, size - n, ": %s line%s, %s vertices", term_count(lines, a), lines == 1 ? "" : "s",
			 term_count(vertices, b));
	return buf;
}

void ctl_report_lines_keys(struct term_json *j, const uint64_t features[4], uint64_t lines, uint64_t vertices)
{
	for (unsigned i = 0; i < LINES_KINDS; i++)
		term_json_u64(j, lines_kind_text[i], features[i]);
	term_json_u64(j, "lines", lines);
	term_json_u64(j, "vertices", vertices);
}

void ctl_report_lines(struct console *c, const struct ctl_staged *staged)
{
	const struct acut_line_set *s = &staged->line_set;
	char a[32], b[32], d[32];

	if (!staged->has_line_set)
		return;
	console_line(c, "lines of the dataset: %s, as %s edge%s between %s positions", term_count(s->lines, a),
		     term_count(s->pieces, b), s->pieces == 1 ? "" : "s", term_count(s->positions, d));
	if (s->crossings)
		console_line(c, "  they cross each other at %s place%s", term_count(s->crossings, a),
			     s->crossings == 1 ? "" : "s");
	if (s->widest > 0 && !s->uneven)
		console_line(c, "  heights differ there by at most %.6g, at %.10g %.10g", s->widest, s->widest_at[0],
			     s->widest_at[1]);
	else if (s->widest > 0)
		console_line(c, "  heights differ at %s of their vertices, and by at most %.6g in all, at %.10g %.10g",
			     term_count(s->uneven, a), s->widest, s->widest_at[0], s->widest_at[1]);
	if (s->left_out)
		console_line(c, "  outside of the boundary or in holes, so left out: %s edge%s", term_count(s->left_out, a),
			     s->left_out == 1 ? "" : "s");
	if (s->doubled || s->points)
		console_line(c, "  segments that lie on others: %s, without length: %s", term_count(s->doubled, a),
			     term_count(s->points, b));
}

void ctl_report_lines_json(struct term_json *j, const struct ctl_staged *staged)
{
	const struct acut_line_set *s = staged ? &staged->line_set : NULL;

	if (!staged || !staged->has_line_set) {
		term_json_null(j, "line_set");
		return;
	}
	term_json_open(j, "line_set", '{');
	ctl_report_lines_keys(j, s->features, s->lines, s->vertices);
	term_json_u64(j, "positions", s->positions);
	term_json_u64(j, "edges", s->pieces);
	term_json_u64(j, "crossings", s->crossings);
	term_json_u64(j, "uneven", s->uneven);
	term_json_number(j, "widest", s->widest);
	term_json_numbers(j, "widest_at", s->widest_at, 2);
	term_json_u64(j, "left_out", s->left_out);
	term_json_u64(j, "doubled", s->doubled);
	term_json_u64(j, "without_length", s->points);
	term_json_close(j, '}');
}

/* ---- places, as GeoJSON ---- */

struct writing {
	struct outfile *out;
	struct err *err;
	uint64_t n;
	int r; /* of the first failure */
};

static void put(struct writing *w, const char *text, int n)
{
	if (!w->r)
		w->r = outfile_write(w->out, text, (size_t)n, w->err);
}

/* The shortest decimal that is read back as the number. */
static const char *number(double v, char buf[DECIMAL_TEXT_SIZE])
{
	struct decimal d = {0, 0};

	decimal_from_double(v, &d);
	return decimal_text(d, buf);
}

static void place(void *ctx, const struct acut_line_place *p)
{
	struct writing *w = ctx;
	char text[512], a[4][DECIMAL_TEXT_SIZE];

	put(w, text,
	    snprintf(text, sizeof text,
		     "%s\n{\"type\":\"Feature\",\"properties\":{\"kind\":\"%s\",\"lower\":%s,\"upper\":%s},"
		     "\"geometry\":{\"type\":\"Point\",\"coordinates\":[%s,%s]}}",
		     w->n++ ? "," : "", strcmp(p->kind, "crossing") ? "uneven" : "crossing", number(p->lower, a[0]),
		     number(p->upper, a[1]), number(p->x, a[2]), number(p->y, a[3])));
}

static int put_head(struct session *session, const struct ctl_staged *staged, struct outfile *out, struct err *err)
{
	struct acut_dataset d;

	/* Without a generation there are no places. */
	if (!staged->generation || acut_dataset_at(session->acut, staged->dataset, staged->generation, &d))
		return ctl_report_geojson_head(out, 0, "", err);
	return ctl_report_geojson_head(out, d.epsg, d.unit_xy, err);
}

int ctl_report_line_places(struct session *session, const struct ctl_staged *staged, const char *path)
{
	static const char end[] = "\n]}\n";
	struct err err = ERR_INIT;
	struct writing w = {.err = &err};
	int status = 0;

	if (outfile_new(path, false, &w.out, &err))
		return session_error(session, &err);
	w.r = put_head(session, staged, w.out, &err);
	if (staged->generation && acut_line_places(session->acut, staged->dataset, staged->generation, place, &w))
		status = session_error_acut(session);
	put(&w, end, sizeof end - 1);
	if (!status && !w.r)
		w.r = outfile_publish(w.out, &err);
	outfile_free(w.out);
	if (!status && w.r) {
		err_add_file(&err, path);
		status = session_error(session, &err);
	}
	return status;
}
