/* Reports of a push: a sentence or two a spool for people, an object a spool in JSON. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "scan_source.h"

static const char *const states[] = {
	[SCAN_STAGED] = "staged",   [SCAN_KNOWN] = "known",     [SCAN_ADOPTED] = "adopted",
	[SCAN_REFUSED] = "refused", [SCAN_WRITTEN] = "written",
};

/* "1 234 567" */
static const char *count(uint64_t n, char buf[32])
{
	char digits[24];
	int len = snprintf(digits, sizeof digits, "%" PRIu64, n), at = 0;

	for (int i = 0; i < len; i++) {
		if (i && (len - i) % 3 == 0)
			buf[at++] = ' ';
		buf[at++] = digits[i];
	}
	buf[at] = 0;
	return buf;
}

static const char *plural(uint64_t n)
{
	return n == 1 ? "" : "s";
}

/* ---- programs ---- */

static void shots_json(struct term_json *j, const struct scan_source *s)
{
	const struct ground_counts *g = &s->ground;

	if (s->kind != SCAN_GROUND) {
		term_json_null(j, "shots");
		term_json_null(j, "dropped");
		return;
	}
	term_json_u64(j, "shots", g->shots);
	term_json_open(j, "dropped", '{');
	term_json_u64(j, "no_return", g->no_return);
	term_json_u64(j, "out_of_range", g->out_of_range);
	term_json_u64(j, "before_poses", g->before);
	term_json_u64(j, "after_poses", g->after);
	term_json_u64(j, "in_gaps", g->gap);
	term_json_u64(j, "too_far", g->too_far);
	term_json_close(j, '}');
}

static void spool_json(struct term_json *j, const struct scan_spool *s)
{
	const struct replay_counts *c = &s->counts;

	term_json_text(j, "spool", s->id);
	term_json_text(j, "profile", s->profile.name);
	term_json_bool(j, "ended", s->tail.ended);
	term_json_u64(j, "torn_bytes", s->tail.torn);
	term_json_u64(j, "damaged_bytes", s->damaged);
	term_json_u64(j, "telegrams", c->framer.telegrams);
	term_json_u64(j, "bad_telegrams", c->framer.bad + c->undecoded);
	term_json_u64(j, "answers", c->not_data);
	term_json_u64(j, "sweeps", c->sweeps);
	term_json_u64(j, "repeated_sweeps", c->repeated);
	term_json_u64(j, "lost_sweeps", c->lost);
	term_json_u64(j, "clock_sets", c->clock_sets);
	term_json_number(j, "clock_moved_s", c->clock_moved_s);
}

static void plane_json(struct term_json *j, const struct scan_source *s)
{
	const struct crs_info *c = s->kind == SCAN_GROUND ? pose_track_system(s->track) : NULL;
	const struct pose_span *span = c ? pose_track_span(s->track) : NULL;

	term_json_known(j, "crs", c ? c->text : NULL);
	term_json_known(j, "zone", span ? span->zone : NULL);
	term_json_text(j, "heights", !span ? NULL : span->ellipsoidal ? "ellipsoidal" : "as-posed");
}

static void print_json(struct program *args, const struct scan_result *r)
{
	const struct scan_source *s = r->source;
	struct term_json j = {.out = args->console.report};
	bool refused = r->state == SCAN_REFUSED;

	term_json_open(&j, NULL, '{');
	term_json_text(&j, "file", s->spool->file);
	term_json_text(&j, "name", s->name);
	term_json_text(&j, "dataset", args->into);
	term_json_text(&j, "state", states[r->state]);
	if (r->generation && !refused)
		term_json_u64(&j, "generation", r->generation);
	else
		term_json_null(&j, "generation");
	term_json_u64(&j, "points", refused ? 0 : r->points);
	term_json_u64(&j, "moved", r->moved);
	term_json_u64(&j, "replaced", r->replaced);
	term_json_text(&j, "hash", s->hash);
	term_json_u64(&j, "bytes", s->size);
	spool_json(&j, s->spool);
	shots_json(&j, s);
	plane_json(&j, s);
	term_json_text(&j, "warning", r->warning);
	if (refused)
		term_error_json(&j, "error", &r->err);
	else
		term_json_null(&j, "error");
	term_json_end(&j);
}

/* ---- people ---- */

/* "~" is the "s" of more than one. */
static void add(char *text, size_t size, uint64_t n, const char *what)
{
	size_t at = strlen(text);
	const char *mark = strchr(what, '~');
	int head = mark ? (int)(mark - what) : (int)strlen(what);
	char buf[32];

	if (n)
		snprintf(text + at, size - at, "%s%s %.*s%s%s", at ? ", " : "", count(n, buf), head, what,
			 mark && n > 1 ? "s" : "", mark ? mark + 1 : "");
}

static void print_shots(struct program *args, const struct scan_source *s)
{
	const struct ground_counts *g = &s->ground;
	char why[256] = "", a[32], b[32], c[32];

	add(why, sizeof why, g->no_return, "without a return");
	add(why, sizeof why, g->out_of_range, "out of range");
	add(why, sizeof why, g->before, "before the first pose");
	add(why, sizeof why, g->after, "after the last pose");
	add(why, sizeof why, g->gap, "in gaps of the poses");
	add(why, sizeof why, g->too_far, "too far from the others for one file");
	console_note(&args->console, "%s: %s sweep%s, %s shot%s, %s point%s%s%s", s->spool->file, count(g->sweeps, a),
		     plural(g->sweeps), count(g->shots, b), plural(g->shots), count(g->points, c), plural(g->points),
		     *why ? "; dropped: " : "", why);
}

static void print_spool(struct program *args, const struct scan_spool *s)
{
	const struct replay_counts *c = &s->counts;
	char why[256] = "";

	add(why, sizeof why, c->framer.bad + c->undecoded, "bad telegram~ skipped");
	if (s->decoder->kind == DECODER_POINTS)
		add(why, sizeof why, c->not_data, "line~ that hold no point (names, comments, words, nothing) left out");
	add(why, sizeof why, c->repeated, "sweep~ that came twice left out");
	add(why, sizeof why, c->lost, "sweep~ missing by the device's counter");
	add(why, sizeof why, s->damaged, "damaged byte~ skipped");
	add(why, sizeof why, s->tail.torn, "byte~ torn off its end");
	if (*why)
		console_note(&args->console, "%s: %s", s->file, why);
	if (c->clock_sets && s->decoder->kind == DECODER_SWEEP)
		console_warn(&args->console,
			     "%s: the computer's clock was set %" PRIu64
			     " time%s while it was captured, by up to %.3f s: what came before has the "
			     "time of then",
			     s->file, c->clock_sets, plural(c->clock_sets), c->clock_most_s);
	if (!s->tail.ended && !s->tail.torn)
		console_note(&args->console, "%s: it has no end yet: the points until now were taken", s->file);
}

void scan_push_print(struct program *args, const struct scan_result *r)
{
	const struct scan_source *s = r->source;
	char a[32], b[32];

	if (args->console.json) {
		print_json(args, r);
		return;
	}
	if (r->state == SCAN_REFUSED) {
		scan_fail(args, &r->err);
		return;
	}
	if (r->first)
		print_spool(args, s->spool);
	if (s->kind == SCAN_GROUND)
		print_shots(args, s);
	if (r->warning)
		console_warn(&args->console, "%s: %s", s->name, r->warning);
	if (r->state == SCAN_KNOWN)
		console_note(&args->console, "%s: the dataset has it already, nothing was sent", s->name);
	else if (r->state == SCAN_ADOPTED)
		console_note(&args->console, "%s: %s point%s, taken up from the push that was interrupted, not sent again",
			     s->name, count(r->points, a), plural(r->points));
	else if (r->state == SCAN_WRITTEN)
		console_note(&args->console, "%s: %s point%s, %s bytes", args->output, count(r->points, a), plural(r->points),
			     count(s->size, b));
	else if (r->moved)
		console_note(&args->console, "%s: %s point%s, %s of them rounded to the dataset's lattice", s->name,
			     count(r->points, a), plural(r->points), count(r->moved, b));
	else
		console_note(&args->console, "%s: %s point%s", s->name, count(r->points, a), plural(r->points));
	if (r->replaced)
		console_note(&args->console, "%s: in place of %u file%s of the dataset", s->name, r->replaced,
			     r->replaced == 1 ? "" : "s");
}

void scan_push_print_all(struct program *args, uint64_t generation, uint64_t points, double seconds)
{
	char a[32];

	console_note(&args->console, "%s: generation %" PRIu64 ", %s point%s, %.1f s", args->into, generation, count(points, a),
		     plural(points), seconds);
}

void scan_push_print_poses(struct program *args, const struct pose_track *t)
{
	const struct pose_span *s = pose_track_span(t);
	const struct crs_info *c = pose_track_system(t);
	char a[32], b[32], zone[64] = "", gaps[64] = "", unnamed[96];

	if (*s->zone)
		snprintf(zone, sizeof zone, ", projected to %s%s", strncmp(s->zone, "UPS", 3) ? "UTM zone " : "", s->zone);
	if (s->gaps)
		snprintf(gaps, sizeof gaps, ", %s gap%s", count(s->gaps, b), plural(s->gaps));
	snprintf(unnamed, sizeof unnamed, "a plane that is not named (unit: %s)", c->unit_xy);
	console_note(&args->console, "%s: %s poses over %.1f s%s%s; points in %s, heights %s", args->pose, count(s->poses, a),
		     s->last - s->first, gaps, zone, strcmp(c->text, "unknown") ? c->text : unnamed,
		     s->ellipsoidal ? "above the ellipsoid" : "as the poses have them");
	if (s->degrees && *s->zone && !args->crs)
		console_note(&args->console, "%s: its degrees are taken as WGS 84; --crs sets another datum", args->pose);
}
