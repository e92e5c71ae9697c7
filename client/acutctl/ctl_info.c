/* info: headers of files, as the daemon reads them, and (without --header) their records. Files of lines are read here. */
#include <math.h>
#include <string.h>

#include "ctl.h"
#include "ctl_info_lines.h"
#include "io.h"
#include "term.h"

static void print_system(FILE *out, const struct acut_probe *p)
{
	char epsg[48] = "unknown";

	if (p->epsg && p->epsg_z)
		snprintf(epsg, sizeof(epsg), "%u, heights %u", p->epsg, p->epsg_z);
	else if (p->epsg || p->epsg_z)
		snprintf(epsg, sizeof(epsg), p->epsg ? "%u" : "unknown, heights %u", p->epsg ? p->epsg : p->epsg_z);
	term_field(out, "  plane", "%s", p->plane);
	term_field(out, "  crs", *p->crs_name ? "%s (%s)" : "%s", p->crs, p->crs_name);
	term_field(out, "  epsg", "%s", epsg);
	term_field(out, "  datum", "%s", p->datum[0] ? p->datum : "unknown");
	term_field(out, "  units", "%s, heights %s", p->unit_xy, p->unit_z);
	if (*p->wkt)
		term_field(out, "  wkt", "%s", p->wkt);
}

/* A text without points has none. */
static void print_box(FILE *out, const struct acut_probe *p)
{
	if (isfinite(p->min[0]) && isfinite(p->min[1]) && isfinite(p->min[2]))
		term_field(out, "  box", "%.15g %.15g %.15g to %.15g %.15g %.15g", p->min[0], p->min[1], p->min[2], p->max[0],
			   p->max[1], p->max[2]);
	else
		term_field(out, "  box", "none");
}

static void print(FILE *out, const struct acut_probe *p)
{
	char a[32];

	term_line(out, "%s", p->name);
	term_field(out, "  format", "%s", p->variant[0] ? p->variant : p->format);
	term_field(out, "  points", "%s", term_count(p->points, a));
	print_box(out, p);
	term_field(out, "  scale", "%s %s %s", p->scale[0], p->scale[1], p->scale[2]);
	term_field(out, "  offset", "%s %s %s", p->offset[0], p->offset[1], p->offset[2]);
	print_system(out, p);
	if (p->warning[0])
		term_field(out, "  note", "%s", p->warning);
}

static void three_texts(struct term_json *j, const char *key, const char *const text[3])
{
	term_json_open(j, key, '[');
	for (int i = 0; i < 3; i++) {
		if (text[i][0])
			term_json_literal(j, NULL, text[i]);
		else
			term_json_null(j, NULL);
	}
	term_json_close(j, ']');
}

static void print_json(const struct console *c, const struct acut_probe *p, const struct acut_inspected *in)
{
	struct term_json j = console_json(c);

	term_json_text(&j, "file", p->name);
	term_json_text(&j, "format", p->format);
	term_json_known(&j, "variant", p->variant);
	term_json_u64(&j, "points", p->points);
	term_json_numbers(&j, "min", p->min, 3);
	term_json_numbers(&j, "max", p->max, 3);
	three_texts(&j, "scale", p->scale);
	three_texts(&j, "offset", p->offset);
	ctl_report_units(&j, p->crs, p->unit_xy, p->unit_z);
	term_json_known(&j, "plane", p->plane);
	term_json_known(&j, "crs_name", p->crs_name);
	term_json_known(&j, "datum", p->datum);
	term_json_known_u64(&j, "epsg", p->epsg);
	term_json_known_u64(&j, "epsg_z", p->epsg_z);
	term_json_known(&j, "wkt", p->wkt);
	term_json_u64(&j, "lines_left_out", p->left_out);
	term_json_known_u64(&j, "first_left_out", p->left_out ? p->left_out_line : 0);
	term_json_known(&j, "warning", p->warning);
	ctl_report_inspected_json(&j, in);
	term_json_end(&j);
}

static int info(struct ctl_inputs *inputs, struct ctl_input *in, bool header)
{
	struct session *session = inputs->session;
	const struct ctl_input_options *opt = inputs->opt;
	const struct acut_inspected *records = NULL;
	const struct acut_probe *p = NULL;
	struct err err = ERR_INIT;
	int fd, r = in->fd < 0 ? ctl_input_open(inputs, in, &fd, &err) : ctl_input_keep_pipe(inputs, in, &fd, &err);

	if (r)
		return session_error(session, &err);
	r = acut_decimal_comma(session->acut, opt->decimal_comma);
	if (!r && header) {
		r = acut_info(session->acut, fd, in->name, inputs->format, opt->columns, &p);
	} else if (!r) {
		r = acut_inspect(session->acut, fd, in->name, inputs->format, opt->columns, &records);
		p = r ? NULL : &records->header;
	}
	io_close(fd);
	ctl_input_drop(in);
	if (r) {
		session_failure(session, in->name, &err);
		return session_error(session, &err);
	}
	if (session->console.json)
		print_json(&session->console, p, records);
	else
		print(session->console.report, p);
	if (records && !session->console.json)
		ctl_report_inspected(&session->console, records);
	return SESSION_DONE;
}

/* Broken files among good ones: all are printed, status 3, as with a push. */
int ctl_info_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct ctl_inputs in = ctl_inputs_of(session, &ctl->input);
	struct err err = ERR_INIT;
	int status = 0, first = 0;
	bool connected = false;
	size_t good = 0;

	if (ctl_inputs_gather(&in, ctl->line.word, ctl->line.nword, &err))
		return session_error(session, &err);
	for (size_t i = 0; i < in.n && !status; i++) {
		bool lines = ctl_info_is_lines(ctl, &in.input[i]);
		int one;

		if (!lines && !connected && (status = session_connect(session)))
			break;
		connected |= !lines;
		if (!lines)
			ctl_info_may_be_lines(ctl, &in.input[i]);
		one = lines ? ctl_info_lines(ctl, &in.input[i]) : info(&in, &in.input[i], ctl->opt.header);
		first = first ? first : one;
		good += !one;
		if (one && session_interrupted(session))
			status = one;
	}
	ctl_inputs_done(&in);
	return status ? status : first && good ? SESSION_SOME_REFUSED : first;
}
