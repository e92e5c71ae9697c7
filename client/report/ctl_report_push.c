/* The report of a push, file by file. */
#include <math.h>
#include <string.h>

#include "ctl_report.h"

/* How far data may still extend on each side before it does not fit on the lattice: west, south, east, north. */
struct room {
	bool known;
	double scale, left[4];
};

static void measure_room(void *ctx, const struct acut_dataset *d)
{
	struct room *room = ctx;
	long long k[2];

	if (sscanf(d->lattice, "%lf %*s %lld %lld", &room->scale, &k[0], &k[1]) != 3 || !isfinite(d->min[0]) ||
	    !isfinite(d->max[1]))
		return;
	for (int i = 0; i < 2; i++) {
		room->left[i] = d->min[i] - ((double)k[i] - 0x1p31) * room->scale;
		room->left[2 + i] = ((double)k[i] + 0x1p31 - 1) * room->scale - d->max[i];
	}
	room->known = true;
}

static void room_json(struct term_json *j, const struct room *room)
{
	if (room->known)
		term_json_numbers(j, "room_left", room->left, 4);
	else
		term_json_null(j, "room_left");
}

/* Where it may soon be too little: less than a sixteenth of what the lattice spans. */
static bool is_tight(const struct room *room)
{
	bool tight = false;

	for (int i = 0; i < 4; i++)
		tight |= room->left[i] < 0x1p28 * room->scale;
	return tight;
}

/* Passes over a folder are frequent: they print it only when it matters. */
static void room_text(struct console *c, const struct room *room, bool always)
{
	if (room->known && (always || is_tight(room)))
		console_line(c, "room left on the lattice of %.10g: %.10g west, %.10g south, %.10g east, %.10g north",
			     room->scale, room->left[0], room->left[1], room->left[2], room->left[3]);
}

/* A file without a point, in a push that made no generation for it. */
static bool is_empty(const struct ctl_staged_file *f)
{
	return !f->refused && f->known != ACUT_KNOWN && !f->points && !f->has_lines && !f->replaced;
}

/* Files came, points did not, nor went: nothing to commit. The daemon's word: older ones make a generation of it. */
static bool is_nothing(const struct ctl_staged *s)
{
	bool empty = false;

	for (size_t i = 0; i < s->nfile; i++)
		empty |= is_empty(&s->file[i]);
	return s->committed && s->unchanged && empty;
}

static void lines_json(struct term_json *j, const struct ctl_staged_file *f)
{
	if (!f->has_lines || f->refused) {
		term_json_null(j, "lines");
		return;
	}
	term_json_open(j, "lines", '{');
	for (unsigned i = 0; i < LINES_KINDS; i++)
		term_json_u64(j, lines_kind_text[i], f->lines.features[i]);
	term_json_u64(j, "soft", f->lines.soft);
	term_json_u64(j, "lines", f->lines.lines);
	term_json_u64(j, "vertices", f->lines.vertices);
	term_json_u64(j, "left_out", f->lines.left_out);
	term_json_close(j, '}');
}

static void file_json(struct console *c, const struct ctl_staged *s, const struct ctl_staged_file *f, const struct room *room,
		      bool nothing, const char *const *moved_to)
{
	static const char *const state[] = {"staged", "known", "adopted", "refused"};
	struct term_json j = console_json(c);

	term_json_text(&j, "file", f->name);
	term_json_text(&j, "dataset", s->dataset);
	term_json_text(&j, "state", nothing && is_empty(f) ? "empty" : state[f->refused ? 3 : f->known]);
	if (f->refused) {
		term_json_null(&j, "generation");
		term_json_null(&j, "points");
		term_json_null(&j, "moved");
		term_json_null(&j, "max_shift");
		term_json_null(&j, "lines_left_out");
		term_json_null(&j, "replaced");
		ctl_report_heights_json(&j, NULL, NULL);
		term_json_null(&j, "overridden");
		term_json_null(&j, "warning");
		term_error_json(&j, "error", &f->err);
	} else {
		term_json_known_u64(&j, "generation", s->generation);
		term_json_u64(&j, "points", f->points);
		term_json_u64(&j, "moved", f->moved);
		term_json_numbers(&j, "max_shift", f->shift, 3);
		term_json_u64(&j, "lines_left_out", f->left_out);
		term_json_u64(&j, "replaced", f->replaced);
		ctl_report_heights_json(&j, s, f);
		term_json_text(&j, "overridden", f->overridden);
		term_json_text(&j, "warning", f->warning);
		term_json_null(&j, "error");
	}
	lines_json(&j, f);
	ctl_report_lines_json(&j, s);
	room_json(&j, room);
	if (moved_to)
		term_json_text(&j, "moved_to", moved_to[f - s->file]);
	term_json_end(&j);
}

static void file_text(struct console *c, const struct ctl_staged_file *f)
{
	char a[32], b[32], lines[256];

	if (f->refused)
		return;
	if (f->has_lines)
		console_line(c, "%s: %s%s", f->name,
			     ctl_report_lines_text(f->lines.features, f->lines.lines, f->lines.vertices, lines, sizeof lines),
			     f->known == ACUT_KNOWN ? ", there already, skipped" :
			     f->known               ? ", taken up from the push that was interrupted" :
						      "");
	else if (f->known == ACUT_KNOWN)
		console_line(c, "%s: there already, skipped", f->name);
	else if (f->known)
		console_line(c, "%s: %s points, taken up from the push that was interrupted, not read again", f->name,
			     term_count(f->points, a));
	else if (f->moved)
		console_line(c, "%s: %s points, %s of them rounded to the lattice, by at most %.6g %.6g %.6g", f->name,
			     term_count(f->points, a), term_count(f->moved, b), f->shift[0], f->shift[1], f->shift[2]);
	else
		console_line(c, "%s: %s points", f->name, term_count(f->points, a));
	if (f->overridden)
		console_line(c, "%s: overridden: its records have %s", f->name, f->overridden);
	if (f->replaced)
		console_line(c, "%s: in place of %u file%s of the dataset", f->name, f->replaced, f->replaced == 1 ? "" : "s");
}

int ctl_report_push(struct session *session, const struct ctl_staged *s, const char *const *moved_to)
{
	struct console *c = &session->console;
	struct room room = {0};
	char count[32];
	bool nothing = is_nothing(s);
	int status = 0;

	/* not asked for if it is not printed */
	if (s->generation && (c->json || !c->quiet) && acut_datasets(session->acut, s->dataset, measure_room, &room))
		status = session_error_acut(session);
	for (size_t i = 0; i < s->nfile; i++) {
		if (c->json)
			file_json(c, s, &s->file[i], &room, nothing, moved_to);
		else
			file_text(c, &s->file[i]);
	}
	if (nothing && s->generation)
		console_line(c, "%s: nothing to commit, no file brought a point: it stays at generation %llu", s->dataset,
			     (unsigned long long)s->generation);
	else if (nothing)
		console_line(c, "%s: nothing to commit, no file brought a point: there is no generation", s->dataset);
	if (!s->generation || nothing)
		return status;
	ctl_report_heights(c, s);
	ctl_report_lines(c, s);
	console_line(c, "%s: generation %llu, %s points, %.1f s", s->dataset, (unsigned long long)s->generation,
		     term_count(s->points, count), s->seconds);
	room_text(c, &room, !moved_to);
	return status;
}
