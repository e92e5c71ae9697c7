/* info of a file of lines: acutctl reads it itself, without the daemon, and counts its features. */
#include <inttypes.h>
#include <string.h>

#include "ctl.h"
#include "ctl_info_lines.h"
#include "lines_survey.h"
#include "term.h"

/* ---- for people ---- */

static void list_text(FILE *out, const char *key, const struct lines_survey_list *list, uint64_t none)
{
	char text[LINES_SURVEY_ROWS * (LINES_SURVEY_NAME + 40)] = "", a[32];
	size_t n = 0;

	for (size_t i = 0; i < list->n && n < sizeof text; i++)
		n += (size_t)snprintf(text + n, sizeof text - n, "%s%s: %s", n ? ", " : "", list->row[i].name,
				      term_count(list->row[i].features, a));
	if (list->others && n < sizeof text)
		n += (size_t)snprintf(text + n, sizeof text - n, ", others: %s", term_count(list->others, a));
	if (none && n < sizeof text)
		snprintf(text + n, sizeof text - n, "%snone: %s", n ? ", " : "", term_count(none, a));
	term_field(out, key, "%s", text);
}

static void reasons_text(FILE *out, const char *key, const struct lines_survey_list *list, const char *place)
{
	char a[32];

	for (size_t i = 0; i < list->n; i++)
		term_field(out, key, "%s: %s (the first is feature %" PRIu64 ", at %s %" PRIu64 ")", list->row[i].name,
			   term_count(list->row[i].features, a), list->row[i].first, place, list->row[i].place);
	if (list->others)
		term_field(out, key, "for other reasons: %s", term_count(list->others, a));
}

static void crs_text(FILE *out, const struct lines_crs *c)
{
	char epsg[64] = "";
	bool known = c->epsg || *c->name || *c->wkt;

	if (c->epsg && c->epsg_z)
		snprintf(epsg, sizeof epsg, "EPSG:%" PRIu32 ", heights EPSG:%" PRIu32, c->epsg, c->epsg_z);
	else if (c->epsg)
		snprintf(epsg, sizeof epsg, "EPSG:%" PRIu32, c->epsg);
	term_field(out, "  crs", "%s%s%s%s%s%s%s", known ? epsg : "unknown", *epsg && *c->name ? ", " : "", c->name,
		   known && !*epsg && !*c->name ? "a text without a name" : "", *c->from ? " (" : "", c->from,
		   *c->from ? ")" : "");
	term_field(out, "  units", "%s%s%s",
		   c->degrees ? "degree" :
		   *c->unit   ? c->unit :
				"unknown",
		   *c->unit_z ? ", heights " : "", c->unit_z);
}

static void counts_text(FILE *out, const char *key, const char *name, const struct lines_counts *c)
{
	char a[32], b[32], d[32], e[32];

	term_field(out, key, "%s%s%s (closed: %s), rings: %s, vertices: %s", name, *name ? ": " : "", term_count(c->lines, a),
		   term_count(c->closed, b), term_count(c->rings, d), term_count(c->vertices, e));
}

static void print(FILE *out, const char *name, const struct lines_info *info, const struct lines_survey *s, bool kinds)
{
	const struct lines_crs *shown = NULL;
	char a[32], b[32], d[32];

	term_line(out, "%s", name);
	term_field(out, "  format", "%s%s%s", info->title, *info->variant ? ", " : "", info->variant);
	term_field(out, "  features", "%s: %s usable, %s refused", term_count(s->all.features, a), term_count(s->all.usable, b),
		   term_count(s->all.refused, d));
	counts_text(out, "  lines", "", &s->all);
	if (s->geometry.n)
		list_text(out, "  geometry", &s->geometry, 0);
	if (kinds)
		list_text(out, "  kinds", &s->kinds, s->without_kind);
	if (s->all.usable) {
		term_field(out, "  box", "%.15g %.15g %.15g to %.15g %.15g %.15g", s->min[0], s->min[1], s->min[2], s->max[0],
			   s->max[1], s->max[2]);
		term_field(out, "  z", "%.15g to %.15g", s->min[2], s->max[2]);
	} else {
		term_field(out, "  box", "none");
		term_field(out, "  z", "none");
	}
	for (size_t i = 0; i < s->nlayers; i++) {
		if (!s->layer[i].layer)
			continue;
		counts_text(out, "  layer", *s->layer[i].layer->name ? s->layer[i].layer->name : "without a name",
			    &s->layer[i].counts);
		/* Layers of one system follow each other: it is shown once. Layers without features are not shown. */
		if (!shown || memcmp(&s->layer[i].layer->crs, shown, sizeof *shown) != 0)
			crs_text(out, &s->layer[i].layer->crs);
		shown = &s->layer[i].layer->crs;
	}
	reasons_text(out, "  refused", &s->refused, info->place);
	if (s->left_out.n)
		list_text(out, "  left out", &s->left_out, 0);
	if (s->left_out.n && !s->all.usable && !strcmp(s->left_out.row[0].name, "points"))
		term_field(out, "  hint", "its points are read after: ogr2ogr -f CSV -lco GEOMETRY=AS_XYZ points.csv FILE");
	if (s->empty)
		term_field(out, "  empty", "%s without geometry", term_count(s->empty, a));
}

/* ---- JSON ---- */

static void counts_json(struct term_json *j, const struct lines_counts *c)
{
	term_json_u64(j, "features", c->features);
	term_json_u64(j, "usable", c->usable);
	term_json_u64(j, "refused", c->refused);
	term_json_u64(j, "lines", c->lines);
	term_json_u64(j, "closed", c->closed);
	term_json_u64(j, "rings", c->rings);
	term_json_u64(j, "vertices", c->vertices);
}

static void list_json(struct term_json *j, const char *key, const struct lines_survey_list *list, const char *place)
{
	term_json_open(j, key, '[');
	for (size_t i = 0; i < list->n; i++) {
		term_json_open(j, NULL, '{');
		term_json_text(j, "name", list->row[i].name);
		term_json_u64(j, "features", list->row[i].features);
		if (place) {
			term_json_u64(j, "first", list->row[i].first);
			term_json_text(j, "place", place);
			term_json_u64(j, "at", list->row[i].place);
		}
		term_json_close(j, '}');
	}
	term_json_close(j, ']');
}

static void layers_json(struct term_json *j, const struct lines_survey *s)
{
	term_json_open(j, "layers", '[');
	for (size_t i = 0; i < s->nlayers; i++) {
		const struct lines_crs *c = s->layer[i].layer ? &s->layer[i].layer->crs : NULL;

		if (!c)
			continue;
		term_json_open(j, NULL, '{');
		term_json_text(j, "name", s->layer[i].layer->name);
		counts_json(j, &s->layer[i].counts);
		term_json_known(j, "crs_from", c->from);
		term_json_known(j, "crs_name", c->name);
		term_json_known_u64(j, "epsg", c->epsg);
		term_json_known_u64(j, "epsg_z", c->epsg_z);
		term_json_known(j, "wkt", c->wkt);
		/* a number alone does not say it */
		if (c->degrees || *c->unit)
			term_json_bool(j, "degrees", c->degrees);
		else
			term_json_null(j, "degrees");
		term_json_known(j, "unit", c->unit);
		term_json_known(j, "unit_z", c->unit_z);
		term_json_close(j, '}');
	}
	term_json_close(j, ']');
}

static void print_json(const struct console *console, const char *name, const struct lines_info *info,
		       const struct lines_survey *s)
{
	struct term_json j = console_json(console);

	term_json_text(&j, "file", name);
	term_json_text(&j, "format", info->format);
	term_json_known(&j, "variant", info->variant);
	counts_json(&j, &s->all);
	term_json_u64(&j, "empty", s->empty);
	term_json_bool(&j, "has_z", s->all.usable > 0);
	term_json_numbers(&j, "min", s->min, 3);
	term_json_numbers(&j, "max", s->max, 3);
	list_json(&j, "geometries", &s->geometry, NULL);
	list_json(&j, "line_kinds", &s->kinds, NULL);
	term_json_u64(&j, "without_kind", s->without_kind);
	layers_json(&j, s);
	list_json(&j, "reasons", &s->refused, info->place);
	list_json(&j, "left_out", &s->left_out, NULL);
	term_json_end(&j);
}

/* ---- the command ---- */

bool ctl_info_is_lines(const struct program *ctl, const struct ctl_input *in)
{
	if (ctl->opt.lines || ctl->input.layer || ctl->input.kind_field)
		return true;
	return in->fd < 0 && !in->archive && !ctl->input.format && lines_recognise(in->name);
}

void ctl_info_may_be_lines(struct program *ctl, const struct ctl_input *in)
{
	if (in->fd < 0 && !in->archive && !ctl->input.format && !ctl->input.columns && lines_may_be(in->name))
		console_note(&ctl->session.console,
			     "%s may be lines, as its rows have the names of some: if it is, see acutctl info --lines", in->name);
}

int ctl_info_lines(struct program *ctl, const struct ctl_input *in)
{
	struct lines_options opt = {.layer = ctl->input.layer,
				    .kind_field = ctl->input.kind_field,
				    .csv = ctl->opt.lines,
				    .interrupted = session_interrupted,
				    .ctx = &ctl->session};
	struct session *session = &ctl->session;
	struct lines_survey survey = {.nlayers = 0};
	struct err err = ERR_INIT;
	struct lines *lines = NULL;
	int r;

	if (in->fd >= 0 || in->archive) {
		err_set(&err, ERR_USAGE, "files of lines are read as they are, not from pipes or archives");
		err_add_file(&err, in->name);
		return session_error(session, &err);
	}
	r = lines_open(in->name, &opt, &lines, &err);
	if (!r)
		r = lines_survey(lines, &survey, &err);
	if (!r && session->console.json)
		print_json(&session->console, in->name, lines_info(lines), &survey);
	else if (!r)
		print(session->console.report, in->name, lines_info(lines), &survey, opt.kind_field);
	lines_survey_done(&survey);
	lines_close(lines);
	return r ? session_error(session, &err) : SESSION_DONE;
}
