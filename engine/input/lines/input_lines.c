/*
 * Lines as text, "acut-lines" (docs/formats/lines.md): breaklines, lakes, boundaries and holes, as acutctl writes them of the
 * files that surveyors have. Its points are the vertices.
 *
 * Model: the text is read twice, as a text of points is: opening finds every bad row, the digits and the extent; reading gives
 * the vertices, each with the place that it has in its feature (input_points.vertex). Rows, numbers and units of raw numbers are
 * those of input/text.
 *
 * Not here: what lines mean, points added along them, levels of lakes.
 */
#include "input_lines_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

enum { VERSION = 1, ROW_MOST = CRS_WKT_MAX + 64 };

static const char signature[] = "acut-lines";
static const char *const kinds[INPUT_LINE_KINDS] = {"hard", "lake", "boundary", "hole"};

int input_lines_bad(struct input *in, const struct input_lines_row *row, const char *what, const char *hint, struct err *err)
{
	input_bad_line(in, err, ERR_INPUT, what, row->line);
	return err_add_hint(err, "%s", hint ? hint : "docs/formats/lines.md has the rows that there are");
}

static bool is_blank(char c)
{
	return c == ' ' || c == '\t';
}

static struct input_lines_row divide(struct input_line line)
{
	struct input_lines_row row = {.line = line};
	const char *p = line.at, *end = line.end;

	while (p < end && is_blank(*p))
		p++;
	while (end > p && is_blank(end[-1]))
		end--;
	row.word.at = p;
	while (p < end && !is_blank(*p))
		p++;
	row.word.end = p;
	while (p < end && is_blank(*p))
		p++;
	row.rest = (struct input_line){p, end};
	return row;
}

static bool matches(const uint8_t *bytes, size_t n)
{
	const char *at = (const char *)bytes;

	if (n >= 3 && !memcmp(at, "\xef\xbb\xbf", 3)) {
		at += 3;
		n -= 3;
	}
	return n > sizeof signature - 1 && !memcmp(at, signature, sizeof signature - 1) && is_blank(at[sizeof signature - 1]);
}

/* ---- rows ---- */

static int read_signature(struct input *in, const struct input_lines_row *row, struct err *err)
{
	uint64_t version;

	if (!input_lines_is(row->word, signature) || !input_line_is_count(row->rest, &version))
		return input_lines_bad(in, row, "this is no text of lines", "its first row is \"acut-lines 1\"", err);
	if (version != VERSION)
		return input_lines_bad(in, row, "a version that this acut does not know", "update acut, or write version 1", err);
	input_lines_of(in)->begun = true;
	return 0;
}

/* A line or ring ends where another one, a feature or the file does. */
static int end_line(struct input *in, struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);
	bool ring = s->next.bits & INPUT_IN_RING;
	uint64_t least = ring ? 3 : 2;

	if (!s->in_line || s->vertices >= least)
		return 0;
	input_fail(in, err, ERR_INPUT, s->line_row, "line", "line %" PRIu64 ": a %s of feature %u with %" PRIu64 " %s",
		   s->line_row, ring ? "ring" : "line", s->next.feature, s->vertices, s->vertices == 1 ? "vertex" : "vertices");
	return err_add_hint(err,
			    ring ? "a ring has three at least, and the first one is not repeated" : "a line has two at least");
}

static int end_feature(struct input *in, struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);
	int rc = end_line(in, err);

	if (rc || !s->in_feature || s->lines)
		return rc;
	input_fail(in, err, ERR_INPUT, s->feature_row, "line", "line %" PRIu64 ": feature %u has no lines", s->feature_row,
		   s->next.feature);
	return err_add_hint(err, "leave it out");
}

static int begin_feature(struct input *in, const struct input_lines_row *row, struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);
	struct input_lines_row words = divide(row->rest);
	static const char hint[] = "feature NUMBER KIND; the kinds are hard, lake, boundary and hole";
	uint64_t number;
	uint8_t kind = 0;
	int rc = end_feature(in, err);

	if (rc)
		return rc;
	if (!input_line_is_count(words.word, &number) || number > UINT32_MAX)
		return input_lines_bad(in, row, "the number of a feature is a whole number below 2^32", hint, err);
	while (kind < INPUT_LINE_KINDS && !input_lines_is(words.rest, kinds[kind]))
		kind++;
	if (kind == INPUT_LINE_KINDS)
		return input_lines_bad(in, row, "this is no kind of feature", hint, err);
	s->next = (struct input_vertex){(uint32_t)number, kind, INPUT_FEATURE_BEGINS};
	s->in_feature = true;
	s->in_line = false;
	s->lines = 0;
	s->feature_row = s->text.line;
	if (s->probing)
		in->info.lines.features[kind]++;
	return 0;
}

static int begin_line(struct input *in, const struct input_lines_row *row, bool ring, struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);
	int rc;

	if (!s->in_feature)
		return input_lines_bad(in, row, "it belongs to no feature", "a row \"feature NUMBER KIND\" comes first", err);
	if (row->rest.at < row->rest.end)
		return input_lines_bad(in, row, "nothing stands behind this word", "the vertices follow, one a row: x y z", err);
	rc = end_line(in, err);
	if (rc)
		return rc;
	if (!ring && s->next.kind != INPUT_HARD)
		return input_lines_bad(in, row, "lakes, boundaries and holes have rings, no lines",
				       "ring; its last vertex is joined with its first", err);
	s->next.bits = (uint8_t)((s->next.bits & INPUT_FEATURE_BEGINS) | INPUT_LINE_BEGINS | (ring ? INPUT_IN_RING : 0));
	s->in_line = true;
	s->lines++;
	s->vertices = 0;
	s->line_row = s->text.line;
	in->info.lines.lines += s->probing;
	return 0;
}

static int bad_number(struct input *in, const struct input_lines_row *row, enum input_number_state state, struct err *err)
{
	static const char *const what[] = {
		[INPUT_NUMBER_BAD] = "neither a row that begins with a word, nor x y z of a vertex",
		[INPUT_NUMBER_NOT_FINITE] = "a number that is not finite",
		[INPUT_NUMBER_TOO_LONG] = "a number that is too large",
	};

	return input_lines_bad(in, row, what[state], NULL, err);
}

static int read_vertex(struct input *in, const struct input_lines_row *row, struct input_number n[3], struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);
	const char *p = row->word.at;

	for (int i = 0; i < 3; i++) {
		enum input_number_state state =
			p == row->rest.end ? INPUT_NUMBER_BAD : input_number_read(&p, row->rest.end, &n[i]);

		if (state == INPUT_NUMBER_OK && p < row->rest.end && !is_blank(*p))
			state = INPUT_NUMBER_BAD;
		if (state != INPUT_NUMBER_OK)
			return bad_number(in, row, state, err);
		while (p < row->rest.end && is_blank(*p))
			p++;
	}
	if (p < row->rest.end)
		return input_lines_bad(in, row, "a vertex has x, y and z, and nothing else", NULL, err);
	if (!s->in_line)
		return input_lines_bad(in, row, "the vertex belongs to no line", "a row \"line\" or \"ring\" comes first", err);
	s->vertices++;
	return 0;
}

/* The next vertex; *ret false: the text ends. */
static int next_vertex(struct input *in, struct input_number n[3], bool *ret, struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);

	for (;;) {
		struct input_line line;
		struct input_lines_row row;
		bool known = true;
		int rc = input_line_next(in, &line, err);

		*ret = false;
		if (rc || !line.at)
			return rc ? rc : end_feature(in, err);
		row = divide(line);
		if (row.word.at == row.word.end || *row.word.at == '#')
			continue;
		if (!s->begun)
			rc = read_signature(in, &row, err);
		else if (input_lines_is(row.word, "feature"))
			rc = begin_feature(in, &row, err);
		else if (input_lines_is(row.word, "line") || input_lines_is(row.word, "ring"))
			rc = begin_line(in, &row, *row.word.at == 'r', err);
		else
			rc = input_lines_head(in, &row, &known, err);
		if (!rc && !known) {
			rc = read_vertex(in, &row, n, err);
			*ret = !rc;
		}
		if (rc || *ret)
			return rc;
	}
}

/* ---- the input ---- */

static void rewind_text(struct input *in, bool probing)
{
	struct input_lines_state *s = input_lines_of(in);
	struct input_place place[2];

	memcpy(place, s->text.place, sizeof place);
	memset(s, 0, sizeof *s);
	memcpy(s->text.place, place, sizeof place);
	s->probing = probing;
	s->text.line_most = ROW_MOST;
	input_line_rewind(in);
}

static void describe(struct input *in)
{
	const struct input_lines *lines = &in->info.lines;
	uint64_t features = 0;
	char text[96];
	size_t n = 0;

	for (unsigned k = 0; k < INPUT_LINE_KINDS; k++) {
		features += lines->features[k];
		if (lines->features[k])
			n += (size_t)snprintf(text + n, sizeof text - n, "%s%" PRIu64 " %s", n ? ", " : "", lines->features[k],
					      kinds[k]);
	}
	snprintf(in->info.variant, sizeof in->info.variant, "%" PRIu64 " feature%s%s%s%s, %" PRIu64 " line%s", features,
		 features == 1 ? "" : "s", n ? " (" : "", n ? text : "", n ? ")" : "", lines->lines,
		 lines->lines == 1 ? "" : "s");
}

static int open_lines(struct input *in, struct err *err)
{
	struct input_extent axis[3];
	struct input_number n[3];
	bool more = true;
	int rc = 0;

	in->decimal_comma = false; /* a name of a system may have a comma */
	rewind_text(in, true);
	in->info.lines.are = true;
	crs_info_clear(&in->info.crs);
	input_extents_begin(axis);
	while (!rc && more) {
		rc = next_vertex(in, n, &more, err);
		if (!rc && more) {
			input_extents_add(axis, n, input_lines_of(in)->text.line);
			in->info.claimed++;
			input_lines_of(in)->next.bits &= INPUT_IN_RING;
		}
	}
	if (!rc && !input_lines_of(in)->begun) {
		input_fail(in, err, ERR_TRUNCATED, 0, NULL, "it is empty: a text of lines has a first row at least");
		rc = err_add_hint(err, "its first row is \"acut-lines 1\"");
	}
	if (rc)
		return rc;
	input_lines_head_end(in);
	rc = input_check_plane(in, err);
	if (!rc)
		rc = input_places_choose(in, axis, err);
	describe(in);
	if (in->info.lines.level != INPUT_LEVEL_NONE)
		in->info.read_bytes = INPUT_RING_MOST * sizeof(int32_t[4]);
	rewind_text(in, false);
	return rc;
}

static int changed(struct input *in, struct err *err)
{
	input_fail(in, err, ERR_CHANGED, input_xyz_of(in)->line, "line", "the file changed while it was read");
	return err_add_hint(err, "wait until it is completely written, then push it again");
}

static int read_vertices(struct input *in, struct input_points *pts, struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);
	struct input_number n[3];
	bool more = true;

	while (pts->n < pts->cap && s->text.points < in->info.claimed) {
		int rc = next_vertex(in, n, &more, err);

		for (int i = 0; !rc && more && i < 3; i++)
			more = input_place_raw(&s->text.place[i / 2], &n[i], &pts->raw[pts->n][i]);
		if (rc || !more)
			return rc ? rc : changed(in, err);
		pts->cls[pts->n] = pts->flags[pts->n] = 0;
		pts->ret[pts->n] = 0x11;
		if (pts->vertex)
			pts->vertex[pts->n] = s->next;
		s->next.bits &= INPUT_IN_RING;
		pts->n++;
		s->text.points++;
	}
	if (s->text.points < in->info.claimed || in->checked)
		return 0;
	in->checked = true;
	return input_check_unchanged(in, err);
}

const struct input_reader input_lines_reader = {
	.state_bytes = sizeof(struct input_lines_state),
	.matches = matches,
	.open = open_lines,
	.read = read_vertices,
};
