/*
 * A track of poses: a file that is read and checked completely once, and read again in blocks when times are requested.
 *
 * Both poses and shots are ordered by time, so one block of rows around the current time suffices. An index with one
 * entry for each block finds it after a jump (a clock that was set back). The index has at most POSE_INDEX_MAX entries:
 * when it is full, every second entry is removed, and the blocks become twice as long. If the file has changed since
 * the first reading, that is an error.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "err.h"
#include "grow.h"
#include "pose_parts.h"

enum { BLOCK_ROWS = 64 };

struct place {
	double time;
	uint64_t offset, line;
};

struct pose_track {
	int fd;
	char *name;
	struct stat st;
	struct pose_form form;
	struct pose_plane plane;
	double gap;
	struct pose_span span;
	struct place *place;
	size_t nplace, places_room;
	uint64_t rows;          /* of a block */
	struct pose_node *node; /* of block `block`, and the first one after it */
	size_t nnode, block, hint;
	struct pose_lines lines;
};

/* ---- the file ---- */

static int check_file(int fd, const char *name, struct stat *ret, struct err *err)
{
	if (fstat(fd, ret))
		err_sys(err, errno, "cannot look at the file");
	else if (!S_ISREG(ret->st_mode))
		err_add_hint((err_set(err, ERR_INPUT, "poses must be a regular file: they are read more than once"), err),
			     "write them to a file first");
	return err->code ? err_add_file(err, name) : 0;
}

static int changed(const struct pose_track *t, struct err *err)
{
	err_clear(err);
	err_set(err, ERR_CHANGED, "the poses changed while they were used");
	err_add_hint(err, "push again when nobody writes to them");
	return err_add_file(err, t->name);
}

static bool unchanged(const struct pose_track *t)
{
	struct stat st;

	return !fstat(t->fd, &st) && st.st_size == t->st.st_size && st.st_mtim.tv_sec == t->st.st_mtim.tv_sec &&
	       st.st_mtim.tv_nsec == t->st.st_mtim.tv_nsec && st.st_ino == t->st.st_ino;
}

/* Adds the line's number; the column is in the message. */
static int in_line(uint64_t line, struct err *err)
{
	struct err was = *err;

	snprintf(err->message, sizeof err->message, "line %llu%s%s: %.400s", (unsigned long long)line, *was.field ? ", " : "",
		 was.field, was.message);
	snprintf(err->field, sizeof err->field, "line");
	err->offset = line;
	return -(int)err->code;
}

/* ---- the first reading ---- */

static int place_add(struct pose_track *t, const struct pose_row *row, uint64_t offset, struct err *err)
{
	if (t->span.poses % t->rows)
		return 0;
	if (t->nplace == POSE_INDEX_MAX) {
		for (size_t i = 0; i < t->nplace / 2; i++)
			t->place[i] = t->place[2 * i];
		t->nplace /= 2;
		t->rows *= 2;
	}
	if (!grow(&t->place, &t->places_room, t->nplace + 1, 16, sizeof *t->place))
		return err_set(err, ERR_NOMEM, "no memory for an index of poses");
	t->place[t->nplace++] = (struct place){.time = row->time, .offset = offset, .line = t->lines.line};
	return 0;
}

static int row_check(struct pose_track *t, const struct pose_row *row, struct pose_box *box, struct err *err)
{
	struct pose_span *s = &t->span;

	if (s->poses && !(row->time > s->last)) {
		err_set(err, ERR_INPUT, "its time is not behind that of the pose before");
		err_add_place(err, ERR_NO_OFFSET, "time");
		return err_add_hint(err, "poses must be in order of time, each once");
	}
	if (!s->poses)
		s->first = row->time;
	else
		s->gaps += row->time - s->last > t->gap;
	s->last = row->time;
	for (int i = 0; i < 2; i++) {
		box->min[i] = fmin(box->min[i], row->at[i]);
		box->max[i] = fmax(box->max[i], row->at[i]);
	}
	return 0;
}

/* Longitudes may be from -180 to 360: of the two possible ranges the narrower one is used (crs_zone_choose takes one box). */
struct boxes {
	struct pose_box low, high;
};

static void box_longitudes(struct boxes *b, const struct pose_row *row)
{
	double lon = row->at[0];

	b->low.min[0] = fmin(b->low.min[0], lon > 180 ? lon - 360 : lon);
	b->low.max[0] = fmax(b->low.max[0], lon > 180 ? lon - 360 : lon);
	b->high.min[0] = fmin(b->high.min[0], lon < 0 ? lon + 360 : lon);
	b->high.max[0] = fmax(b->high.max[0], lon < 0 ? lon + 360 : lon);
}

/* After each block of the file. */
static int tell(const struct pose_track *t, const struct pose_params *p, uint64_t *told, struct err *err)
{
	if (!p->told || t->lines.at == *told)
		return 0;
	*told = t->lines.at;
	return p->told(p->ctx, t->lines.at, (uint64_t)t->st.st_size) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

static int read_rows(struct pose_track *t, const struct pose_params *p, struct pose_box *box, struct err *err)
{
	struct boxes wide = {.low = *box, .high = *box};
	struct pose_row row;
	uint64_t offset, told = 0;
	char *line;
	int r;

	while ((r = pose_lines_next(&t->lines, &line, &offset, err)) > 0) {
		if (tell(t, p, &told, err))
			return -(int)err->code;
		r = pose_row_read(&t->form, line, &row, err);
		if (!r)
			r = row_check(t, &row, box, err);
		if (!r)
			r = place_add(t, &row, offset, err);
		if (r)
			return in_line(t->lines.line, err);
		if (t->form.degrees)
			box_longitudes(&wide, &row);
		t->span.poses++;
	}
	if (r < 0)
		return r;
	if (t->span.poses < 2) {
		err_set(err, ERR_INPUT,
			t->span.poses ? "it has one pose: between one and nothing there is no time" :
					"it has no poses, only the names of columns");
		return -(int)err->code;
	}
	if (t->form.degrees) {
		const struct pose_box *narrow =
			wide.high.max[0] - wide.high.min[0] < wide.low.max[0] - wide.low.min[0] ? &wide.high : &wide.low;

		box->min[0] = narrow->min[0];
		box->max[0] = narrow->max[0];
	}
	return 0;
}

static int read_all(struct pose_track *t, const struct pose_params *p, struct err *err)
{
	struct pose_box box = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
	struct digest_stream *hash = digest_stream_new();
	uint64_t offset;
	char *line;
	int r;

	if (!hash)
		return err_set(err, ERR_NOMEM, "no memory to read poses");
	pose_lines_start(&t->lines, t->fd, t->name, 0);
	t->lines.hash = hash;
	r = pose_lines_next(&t->lines, &line, &offset, err);
	if (r == 0)
		r = err_set(err, ERR_INPUT, "it is empty");
	else if (r > 0 && (r = pose_form_read(line, &t->form, err)))
		in_line(t->lines.line, err);
	if (!r)
		r = read_rows(t, p, &box, err);
	if (!r)
		r = pose_plane_choose(p, &t->form, &box, t->name, &t->plane, err);
	t->span.hash = digest_stream_end(hash);
	digest_stream_free(hash);
	t->lines.hash = NULL;
	return r;
}

int pose_track_read(int fd, const char *name, const struct pose_params *p, struct pose_track **ret, struct err *err)
{
	struct pose_track *t = calloc(1, sizeof *t);
	int r = 0;

	if (!t || !(t->name = strdup(name))) {
		free(t);
		return err_set(err, ERR_NOMEM, "no memory for poses");
	}
	t->fd = fd;
	t->gap = p->gap_s > 0 ? p->gap_s : POSE_GAP_S;
	t->form.clock = p->clock;
	t->form.offset_s = p->offset_s;
	t->rows = BLOCK_ROWS;
	t->block = SIZE_MAX;
	r = check_file(fd, name, &t->st, err);
	if (!r)
		r = read_all(t, p, err);
	if (!r)
		t->node = calloc(t->rows + 1, sizeof *t->node);
	if (!r && !t->node)
		r = err_set(err, ERR_NOMEM, "no memory for %llu poses", (unsigned long long)t->rows);
	if (!r && !unchanged(t))
		r = changed(t, err);
	if (r) {
		err_add_file(err, name);
		pose_track_free(t);
		return r;
	}
	t->span.degrees = t->form.degrees;
	t->span.ellipsoidal = t->form.ellipsoidal;
	memcpy(t->span.zone, t->plane.zone, sizeof t->span.zone);
	*ret = t;
	return 0;
}

struct pose_track *pose_track_free(struct pose_track *t)
{
	if (!t)
		return NULL;
	pose_plane_clear(&t->plane);
	free(t->node);
	free(t->place);
	free(t->name);
	free(t);
	return NULL;
}

const struct crs_info *pose_track_system(const struct pose_track *t)
{
	return &t->plane.system;
}

const struct pose_span *pose_track_span(const struct pose_track *t)
{
	return &t->span;
}

/* ---- lookup ---- */

static int load_block(struct pose_track *t, size_t block, struct err *err)
{
	const struct place *from = &t->place[block];
	struct pose_row row;
	uint64_t offset;
	char *line;
	int r = 1;

	t->block = SIZE_MAX;
	t->nnode = t->hint = 0;
	pose_lines_start(&t->lines, t->fd, t->name, from->offset);
	t->lines.line = from->line - 1;
	while (t->nnode <= t->rows && (r = pose_lines_next(&t->lines, &line, &offset, err)) > 0) {
		if (pose_row_read(&t->form, line, &row, err) || (!t->nnode && row.time != from->time) ||
		    (t->nnode && !(row.time > t->node[t->nnode - 1].time)))
			return changed(t, err);
		r = pose_plane_put(&t->plane, &row, &t->node[t->nnode], err);
		if (r) {
			in_line(t->lines.line, err);
			return err_add_file(err, t->name);
		}
		t->nnode++;
	}
	if (r < 0)
		return err_add_file(err, t->name);
	/* The rows have moved, or there are more than before. */
	if (!unchanged(t) || (block + 1 < t->nplace ? t->nnode != t->rows + 1 : t->nnode < 1) ||
	    (block + 1 < t->nplace && t->node[t->rows].time != t->place[block + 1].time))
		return changed(t, err);
	t->block = block;
	return 0;
}

/* The last block that begins at or before the time. */
static size_t block_of(const struct pose_track *t, double time)
{
	size_t low = 0, high = t->nplace;

	while (high - low > 1) {
		size_t middle = low + (high - low) / 2;

		if (t->place[middle].time <= time)
			low = middle;
		else
			high = middle;
	}
	return low;
}

/* The last node at or before the time; there is one, usually that of the previous lookup or the next. */
static size_t node_of(struct pose_track *t, double time)
{
	size_t low = 0, high = t->nnode;

	if (t->node[t->hint].time <= time) {
		low = t->hint;
		if (low + 2 < high && t->node[low + 2].time > time)
			high = low + 2;
	} else {
		high = t->hint;
	}
	while (high - low > 1) {
		size_t middle = low + (high - low) / 2;

		if (t->node[middle].time <= time)
			low = middle;
		else
			high = middle;
	}
	return t->hint = low;
}

static void interpolate(const struct pose_track *t, const struct pose_node *a, const struct pose_node *b, double u,
			struct pose *ret)
{
	double q[4], ned[3][3], scale = a->scale + (b->scale - a->scale) * u;
	double xy = scale / t->plane.metres[0], z = 1 / t->plane.metres[1];

	for (int i = 0; i < 3; i++)
		ret->at[i] = a->at[i] + (b->at[i] - a->at[i]) * u;
	pose_turn_between(a->turn, b->turn, u, q);
	pose_turn_matrix(q, ned);
	for (int i = 0; i < 3; i++) {
		ret->body[0][i] = ned[1][i] * xy;
		ret->body[1][i] = ned[0][i] * xy;
		ret->body[2][i] = -ned[2][i] * z;
	}
}

int pose_track_at(struct pose_track *t, double time, struct pose *ret, struct err *err)
{
	const struct pose_node *a;
	size_t i;

	if (!(time >= t->span.first))
		return POSE_BEFORE;
	if (time > t->span.last)
		return POSE_AFTER;
	if (t->block == SIZE_MAX || time < t->node[0].time || (t->block + 1 < t->nplace && time >= t->place[t->block + 1].time)) {
		int r = load_block(t, block_of(t, time), err);

		if (r)
			return r;
	}
	i = node_of(t, time);
	a = &t->node[i];
	if (a->time == time) {
		interpolate(t, a, a, 0, ret);
		return POSE_HERE;
	}
	if (i + 1 >= t->nnode)
		return POSE_AFTER;
	if (a[1].time - a->time > t->gap)
		return POSE_GAP;
	interpolate(t, a, a + 1, (time - a->time) / (a[1].time - a->time), ret);
	return POSE_HERE;
}
