/*
 * Sources out of spools (scan_source.h).
 *
 * The model: the bytes depend on the records of the spool, its profile and the poses, and on nothing else: no clock, no
 * random number, no file name. So the same spool with the same poses is the same bytes, whose hash identifies it in a
 * dataset. Memory does not grow with the spool.
 */
#include "scan_source.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "digest_pack.h"
#include "err.h"
#include "grow.h"

enum { PIECE = 64 << 10, NAME_ROOM = 200 };

/* ---- bytes that come out ---- */

struct out {
	int (*put)(void *ctx, const void *, size_t);
	void *ctx;
	size_t n;
	uint8_t piece[PIECE];
};

static int out_flush(struct out *o)
{
	int r = o->n ? o->put(o->ctx, o->piece, o->n) : 0;

	o->n = 0;
	return r;
}

static int out_put(struct out *o, const void *bytes, size_t n)
{
	int r = o->n + n > sizeof o->piece ? out_flush(o) : 0;

	if (r || n > sizeof o->piece)
		return r ? r : o->put(o->ctx, bytes, n);
	memcpy(o->piece + o->n, bytes, n);
	o->n += n;
	return 0;
}

/* ---- a pass that makes points or takes them out ---- */

struct making {
	const struct scan_source *source;
	struct ground_counts ground;
	struct las_frame frame;
	struct las_summary summary;
	bool measures, has_frame; /* the first pass: only the summary */
	struct out *out;
	bool (*stop)(void *ctx);
	void *ctx; /* of the stop */
	struct err *err;
	struct err far; /* the first that is too far */
	uint64_t lines;
};

static int point(void *ctx, const struct ground_point *p)
{
	struct making *m = ctx;
	uint8_t record[LAS_RECORD];
	int32_t at[3];
	int r;

	struct err why = ERR_INIT;

	/* A pose or a range with a damaged digit: it has no place, as a shot without a pose has none, and is not used. */
	if (m->measures && !m->has_frame)
		m->frame = las_frame_of(p->at);
	r = las_place(&m->frame, p->at, at, &why);
	if (r) {
		if (!m->ground.too_far++)
			m->far = why;
		return 0;
	}
	m->has_frame = true;
	if (m->measures) {
		las_summary_add(&m->summary, at);
		return 0;
	}
	las_record(record, at, p->intensity, pose_gps_of_utc(p->utc_s));
	return out_put(m->out, record, sizeof record);
}

/* A telegram that came twice is one sweep. */
static int sweep(void *ctx, const struct replay_sweep *s)
{
	struct making *m = ctx;

	if (s->repeated)
		return 0;
	return ground_sweep(&m->source->spool->profile, m->source->track, s->sweep, s->utc_s, &m->ground, point, m, m->err);
}

static int line(void *ctx, const struct telegram *t)
{
	struct making *m = ctx;
	int r = 0;

	m->lines++;
	if (!m->measures)
		r = out_put(m->out, t->at, t->size);
	return r || m->measures ? r : out_put(m->out, "\n", 1);
}

enum { FILE_OVER = 1 };

static int las_piece(void *ctx, const struct telegram *t)
{
	struct making *m = ctx;
	int r;

	if (t->file != m->source->file)
		return t->file > m->source->file ? FILE_OVER : 0;
	r = out_put(m->out, t->at, t->size);
	return r ? r : t->file_ends ? FILE_OVER : 0;
}

static bool ask(void *ctx)
{
	const struct making *m = ctx;

	return m->stop ? m->stop(m->ctx) : scan_stopped();
}

static int pass(struct making *m)
{
	enum scan_kind kind = m->source->kind;
	const struct replay_sinks sinks = {
		.ctx = m,
		.sweep = kind == SCAN_GROUND ? sweep : NULL,
		.points = kind == SCAN_TEXT_LINES ? line :
			  kind == SCAN_LAS_FILE   ? las_piece :
						    NULL,
	};

	return scan_spool_pass(m->source->spool, &sinks, ask, m->err);
}

int scan_source_write(const struct scan_source *s, int (*put)(void *ctx, const void *, size_t), bool (*stop)(void *ctx),
		      void *ctx, struct err *err)
{
	struct out *out = malloc(sizeof *out);
	struct making m = {.source = s, .frame = s->las.frame, .out = out, .stop = stop, .ctx = ctx, .err = err};
	int r = 0;

	if (!out)
		return err_set(err, ERR_NOMEM, "no memory to write points");
	out->put = put;
	out->ctx = ctx;
	out->n = 0;
	if (s->kind == SCAN_GROUND)
		r = put(ctx, s->head, s->head_size);
	if (!r)
		r = pass(&m);
	if (r == FILE_OVER && s->kind == SCAN_LAS_FILE)
		r = 0;
	if (!r)
		r = out_flush(out);
	free(out);
	return r;
}

/* ---- what it will be ---- */

struct hashing {
	struct digest_stream *hash;
	uint64_t size;
};

static int hash_put(void *ctx, const void *bytes, size_t n)
{
	struct hashing *h = ctx;

	digest_stream_add(h->hash, bytes, n);
	h->size += n;
	return 0;
}

static int hash_source(struct scan_source *s, struct err *err)
{
	struct hashing h = {.hash = digest_stream_new()};
	int r;

	if (!h.hash)
		return err_set(err, ERR_NOMEM, "no memory to hash points");
	r = scan_source_write(s, hash_put, NULL, &h, err);
	if (!r) {
		digest_hex(digest_stream_end(h.hash), s->hash);
		s->size = h.size;
	}
	digest_stream_free(h.hash);
	return r;
}

/* ---- points on the ground ---- */

/* Poses that are all elsewhere in time: times of GPS are known by how far. */
static int no_time(const struct scan_source *s, struct err *err)
{
	const double day = 86400, week = 7 * day, adjust = 1e9, epoch = 315964800;
	const struct pose_span *span = pose_track_span(s->track);
	double gps = pose_gps_of_utc(span->first), apart = span->first - s->spool->counts.first_utc_s;

	if ((span->first >= 0 && span->first <= week) || (gps >= 0 && gps <= week))
		return err_add_hint(
			err,
			"they look like seconds of a GPS week: add 604800 for each week since 1980-01-06, take 1000000000 away, and "
			"say --pose-clock gps");
	if (fabs(apart - adjust) < 30 * day || fabs(apart + epoch) < 30 * day)
		return err_add_hint(err,
				    "they look like seconds since 1980-01-06: take 1000000000 away, and give --pose-clock gps");
	return err_add_hint(err, "--pose-clock gps if their times are GPS time; --pose-offset if one of the clocks was wrong");
}

static int no_points(const struct scan_source *s, struct err *err)
{
	const struct replay_counts *c = &s->spool->counts;
	const struct pose_span *span = pose_track_span(s->track);
	const struct ground_counts *g = &s->ground;

	if (!c->sweeps) {
		err_set(err, ERR_INPUT, "there is no sweep in it: %llu telegrams, %llu bad",
			(unsigned long long)c->framer.telegrams, (unsigned long long)(c->framer.bad + c->undecoded));
		err_add_hint(err, "acut-scan replay reports its content; --profile decodes it by another profile");
	} else if (g->before + g->after + g->gap) {
		err_set(err, ERR_INPUT,
			"no shot has a pose: its sweeps are from %.3f to %.3f, the poses from %.3f to %.3f (UTC, seconds "
			"since 1970)",
			c->first_utc_s, c->last_utc_s, span->first, span->last);
		no_time(s, err);
	} else {
		err_set(err, ERR_INPUT, "none of its %llu shots is a point: %llu had no return, %llu were out of range",
			(unsigned long long)g->shots, (unsigned long long)g->no_return, (unsigned long long)g->out_of_range);
	}
	return err_add_file(err, s->spool->file);
}

static void make_id(const struct scan_source *s, uint8_t ret[16])
{
	const struct pose_span *span = pose_track_span(s->track);
	uint8_t both[32];
	struct packer p = packer_of(both + 16, 16);

	memcpy(both, s->spool->head.id, 16);
	digest_pack(&p, span->hash);
	p = packer_of(ret, 16);
	digest_pack(&p, digest_hash(both, sizeof both));
}

static int find_ground(struct scan_source *s, struct err *err)
{
	struct making m = {.source = s, .measures = true, .err = err};
	int r = pass(&m);

	m.ground.points -= m.ground.too_far;
	s->ground = m.ground;
	/* More than a few are no accident: which of them are wrong is not known. */
	if (!r && m.ground.too_far > m.ground.points) {
		*err = m.far;
		err_add_file(err, s->spool->file);
		return -(int)err->code;
	}
	if (!r && !m.summary.points)
		r = no_points(s, err);
	if (r)
		return r;
	s->points = m.summary.points;
	s->las = (struct las_params){
		.system = pose_track_system(s->track),
		.made_s = s->spool->head.utc_ns / 1000000000,
		.frame = m.frame,
		.summary = m.summary,
	};
	make_id(s, s->las.id);
	r = las_head(&s->las, s->head, &s->head_size, err);
	return r ? r : hash_source(s, err);
}

/* ---- points as they are ---- */

static int find_text(struct scan_source *s, struct err *err)
{
	struct making m = {.source = s, .measures = true, .err = err};
	int r = pass(&m);

	if (!r && !m.lines) {
		err_set(err, ERR_INPUT, "there is no line of points in it (%llu lines were none)",
			(unsigned long long)(s->spool->counts.undecoded + s->spool->counts.not_data));
		r = err_add_file(err, s->spool->file);
	}
	s->points = m.lines;
	return r ? r : hash_source(s, err);
}

struct files {
	uint64_t *number;
	size_t n, room;
	bool no_memory;
};

static int las_seen(void *ctx, const struct telegram *t)
{
	struct files *f = ctx;

	if (!t->file_ends)
		return 0;
	f->no_memory = !grow(&f->number, &f->room, f->n + 1, 16, sizeof *f->number);
	if (!f->no_memory)
		f->number[f->n++] = t->file;
	return f->no_memory;
}

static int find_files(struct scan_spool *spool, struct files *ret, struct err *err)
{
	const struct replay_sinks sinks = {.ctx = ret, .points = las_seen};
	int r = scan_spool_pass(spool, &sinks, NULL, err);

	if (ret->no_memory)
		return err_set(err, ERR_NOMEM, "no memory for a list of files");
	if (!r && !ret->n) {
		uint64_t laz = spool->counts.framer.by[FRAMER_LAZ];

		err_set(err, ERR_INPUT,
			laz ? "its LAS files are compressed (LAZ, %llu of them), and where one ends only its reader knows" :
			      "there is no whole LAS file in it (%llu were not)",
			(unsigned long long)(laz ? laz : spool->counts.framer.bad));
		if (laz)
			err_add_hint(
				err,
				"have the scanner send LAS; acut-scan replay SPOOL --to raw -o FILE.laz writes what came, and acutctl push "
				"takes that if it is one file");
		r = err_add_file(err, spool->file);
	}
	return r;
}

/* ---- all ---- */

static void name_source(struct program *args, struct scan_source *s, size_t i, size_t n)
{
	const char *slash = strrchr(s->spool->file, '/'), *base = args->name ? args->name : slash ? slash + 1 : s->spool->file;

	snprintf(s->name, sizeof s->name, "%.*s", NAME_ROOM, base);
	snprintf(s->path, sizeof s->path, "spool:%s", s->spool->id);
	if (n == 1)
		return;
	snprintf(s->name + strlen(s->name), sizeof s->name - strlen(s->name), ".%zu", i + 1);
	snprintf(s->path + strlen(s->path), sizeof s->path - strlen(s->path), "/%zu", i + 1);
}

static int needs_pose(const struct scan_spool *s, struct err *err)
{
	err_set(err, ERR_USAGE,
		"it holds sweeps of a scanner (%.60s): ranges without a pose are no points on the ground; they stay "
		"recorded, raw",
		*s->profile.title ? s->profile.title : s->profile.name);
	err_add_hint(
		err,
		"give the places of the scanner with --pose FILE, see acut-pose(5); acut-scan replay --to sweeps shows the ranges");
	return err_add_file(err, s->file);
}

int scan_source_find(struct program *args, struct scan_spool *spool, struct pose_track *track, struct scan_source **ret,
		     size_t *ret_n, struct err *err)
{
	bool las = spool->decoder->input_format && !strcmp(spool->decoder->input_format, "las");
	struct scan_source *list;
	struct files files = {0};
	size_t n = 1;
	int r = 0;

	if (spool->decoder->kind == DECODER_SWEEP && !track)
		return needs_pose(spool, err);
	if (las) {
		r = find_files(spool, &files, err);
		n = files.n;
	}
	list = r ? NULL : calloc(n, sizeof *list);
	if (!r && !list)
		r = err_set(err, ERR_NOMEM, "no memory for %zu inputs", n);
	for (size_t i = 0; !r && i < n; i++) {
		list[i].spool = spool;
		list[i].track = track;
		list[i].kind = spool->decoder->kind == DECODER_SWEEP ? SCAN_GROUND : las ? SCAN_LAS_FILE : SCAN_TEXT_LINES;
		list[i].file = las ? files.number[i] : 0;
		name_source(args, &list[i], i, n);
		r = list[i].kind == SCAN_GROUND ? find_ground(&list[i], err) :
		    las                         ? hash_source(&list[i], err) :
						  find_text(&list[i], err);
	}
	free(files.number);
	if (r) {
		free(list);
		return r;
	}
	*ret = list;
	*ret_n = n;
	return 0;
}
