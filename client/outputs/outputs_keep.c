/*
 * The state of outputs that can be continued later: NAME.part.state beside the first output.
 *
 * The state is written between two blocks, when everything that it describes is on the disk: the options and the job, the
 * size and the hashes of each output's file (outfile_part.c), the counts of writers and edges, and the state
 * of the fetch. It replaces the last one as a whole, so however the process ends there is a state, and files that have at
 * least its bytes. format.md, "State of a fetch", describes the bytes.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "clock.h"
#include "cursor.h"
#include "err.h"
#include "outputs_priv.h"
#include "parse.h"

#define SYNC_SECONDS 5.0
#define SYNC_BYTES (64ull << 20)

enum { OPTIONS = 4096, TARGET_SAVED = 2 * 32 + 8 + FORMAT_SAVED };
static const uint32_t MAGIC = 0x534b4341; /* "ACKS" */
static const uint32_t VERSION = 6;

struct outputs_kept {
	char *options;
	uint64_t sync_bytes;
	uint64_t saved_ns, saved_size;
	bool saved;
	uint8_t *state;     /* that is continued */
	struct cursor rest; /* of it, after the state of the fetch */
	const uint8_t *fetch;
	size_t fetch_size;
};

struct outputs_kept *outputs_keep_free(struct outputs_kept *k)
{
	if (k) {
		free(k->options);
		free(k->state);
		free(k);
	}
	return NULL;
}

/* ---- options: the same run ---- */

static void put_decimal(FILE *f, const char *name, struct decimal d)
{
	fprintf(f, " %s=%lld:%d", name, (long long)d.mantissa, (int)d.exponent);
}

static void put_levels(FILE *f, const struct format_options *o)
{
	if (!o->interval.mantissa)
		return;
	put_decimal(f, "interval", o->interval);
	put_decimal(f, "base", o->base);
	fprintf(f, " %s %s index=%u", o->interval_unit ? o->interval_unit : "-", o->base_unit ? o->base_unit : "-",
		o->has_index ? o->index : FORMAT_INDEX_EACH);
}

static char *options_text(const struct outputs *run, uint64_t job, struct err *err)
{
	char *text = NULL;
	size_t size;
	FILE *f = open_memstream(&text, &size);

	if (f) {
		fprintf(f, "job %llu", (unsigned long long)job);
		if (run->opt.max_edge.given)
			put_decimal(f, "max-edge", run->opt.max_edge.value);
		if (run->opt.max_edge.given && run->opt.max_edge.unit)
			fprintf(f, " %s", run->opt.max_edge.unit);
		fprintf(f, " mask=%s erase=%s", outputs_mask_digest(run->mask, OUTPUTS_MASK),
			outputs_mask_digest(run->mask, OUTPUTS_ERASE));
		for (const struct outputs_target *t = run->target; t; t = t->next) {
			fprintf(f, "\n%s%s", t->format->name, t->opt.origin_auto ? " origin=auto" : "");
			for (int i = 0; i < 3 && t->opt.has_origin; i++)
				put_decimal(f, "origin", t->opt.origin[i]);
			if (t->opt.z_unit)
				fprintf(f, " z-unit=%s", t->opt.z_unit);
			put_levels(f, &t->opt);
			if (t->opt.simplify.mantissa) {
				put_decimal(f, "simplify", t->opt.simplify);
				fprintf(f, " %s", t->opt.simplify_unit ? t->opt.simplify_unit : "-");
			}
			fprintf(f, " %s", outfile_base(t->out));
		}
	}
	if (!f || fclose(f) || size >= OPTIONS) {
		free(text);
		err_set(err, ERR_LIMIT, "the names of the outputs are too long to go on with them later");
		return NULL;
	}
	return text;
}

/* NULL: all can be kept. */
static const struct outputs_target *first_not_kept(const struct outputs *run)
{
	for (const struct outputs_target *t = run->target; t; t = t->next)
		if (!t->out || t->opt.canonical || !t->format->save || !outfile_part_can(t->out))
			return t;
	return NULL;
}

static int cannot(const struct outputs *run, const struct outputs_target *t, struct err *err)
{
	const char *run_cannot = run->change ? "a fetch of changes cannot be resumed" :
				 run->tiles  ? "tiles are sorted at the end: a fetch cannot be resumed with --tile" :
				 run->levels ? "levels of detail are sorted at the end: a fetch cannot be resumed with --levels" :
				 run->hull   ? "--trim-hull decides at the end: a fetch cannot be resumed with it" :
					       NULL;

	if (run_cannot)
		err_set(err, ERR_USAGE, "%s", run_cannot);
	else if (!t)
		return err_set(err, ERR_USAGE, "there is no output to go on with");
	else if (t->opt.canonical)
		err_set(err, ERR_USAGE, "--canonical sorts at the end: a fetch cannot be resumed with it");
	else if (!t->format->save)
		err_set(err, ERR_USAGE, "a fetch into %s cannot be resumed", t->format->name);
	else
		err_set(err, ERR_USAGE, "only a fetch into a regular file can be resumed");
	if (!run_cannot && t->out)
		err_add_file(err, outfile_name(t->out));
	return err_add_hint(err, "fetch it again, without --resume");
}

/* ---- reading ---- */

/* Its frame, its sum, and whether it is of this run. */
static int parse_state(struct outputs *run, size_t size, struct err *err)
{
	const struct outfile *first = run->target->out;
	struct outputs_kept *k = run->kept;
	struct cursor c = cursor_of(k->state, size), sum = cursor_of(k->state + size - 8, 8);
	const uint8_t *options;
	uint32_t n, version;

	if (cursor_u64(&sum) != XXH3_64bits(k->state, size - 8) || cursor_u32(&c) != MAGIC)
		return outfile_part_damaged(first, err);
	version = cursor_u32(&c);
	if (version != VERSION) {
		err_set(err, ERR_USAGE, "the kept part is of another version of acutctl");
		outfile_part_name_state(first, err);
		return err_add_hint(err, "fetch it again, without --resume");
	}
	n = cursor_u32(&c);
	options = cursor_bytes(&c, n);
	k->fetch_size = cursor_u64(&c);
	k->fetch = cursor_bytes(&c, k->fetch_size);
	k->rest = c;
	if (c.bad || !options)
		return outfile_part_damaged(first, err);
	if (n == strlen(k->options) && !memcmp(options, k->options, n))
		return 0;
	err_set(err, ERR_USAGE, "the kept part is of another job, or of other outputs or options");
	outfile_part_name_state(first, err);
	return err_add_hint(err, "resume with the outputs and options of the earlier fetch, or fetch without --resume");
}

static struct outfile_sum get_sum(struct cursor *c)
{
	struct outfile_sum s;

	s.from = cursor_u64(c);
	s.size = cursor_u64(c);
	s.chain = cursor_u64(c);
	s.part = cursor_u64(c);
	return s;
}

/* The files of the outputs, in their order. */
static int go_on(struct outputs *run, struct err *err)
{
	struct cursor *c = &run->kept->rest;
	int r = 0;

	for (struct outputs_target *t = run->target; t && !r; t = t->next) {
		struct outfile_sum sum = get_sum(c), annex = get_sum(c);

		r = c->bad ? outfile_part_damaged(run->target->out, err) : outfile_part_go_on(t->out, &sum, &annex, err);
	}
	return r;
}

static int begin(struct outputs *run, bool on, struct err *err)
{
	size_t size = 0;
	int r = 0;

	if (on)
		r = outfile_part_load(run->target->out, &run->kept->state, &size, err);
	if (on && !r)
		r = size < 64 ? outfile_part_damaged(run->target->out, err) : parse_state(run, size, err);
	for (struct outputs_target *t = run->target; t && !r; t = t->next)
		r = outfile_part_begin(t->out, on, err);
	return on && !r ? go_on(run, err) : r;
}

int outputs_keep(struct outputs *run, uint64_t job, bool on, struct err *err)
{
	const struct outputs_target *not = first_not_kept(run);
	const char *sync = getenv("ACUT_FETCH_SYNC");
	struct outputs_kept *k;
	int r;

	if (not || !run->target || run->change || run->hull)
		return on ? cannot(run, not, err) : 0;
	k = calloc(1, sizeof(*k));
	if (!k)
		return err_set(err, ERR_NOMEM, "no memory for outputs");
	run->kept = k;
	k->sync_bytes = SYNC_BYTES;
	if (sync && *sync && !parse_size(sync, &k->sync_bytes))
		return err_set(err, ERR_USAGE, "ACUT_FETCH_SYNC is not a size: \"%s\"", sync);
	k->options = options_text(run, job, err);
	r = k->options ? begin(run, on, err) : -(int)err->code;
	k->saved = on && !r;
	k->saved_ns = clock_mono_ns();
	return r;
}

bool outputs_keep_goes_on(const struct outputs *run)
{
	return run->kept && run->kept->state;
}

const void *outputs_kept(const struct outputs *run, size_t *ret_size)
{
	if (!outputs_keep_goes_on(run))
		return NULL;
	*ret_size = run->kept->fetch_size;
	return run->kept->fetch;
}

int outputs_keep_head(struct outputs *run, const struct acut_mesh_head *head, struct err *err)
{
	struct cursor c = run->kept->rest;
	struct outputs_left none;
	int r = 0;

	for (struct outputs_target *t = run->target; t && !r; t = t->next) {
		struct cursor saved;
		const uint8_t *bytes;

		cursor_u64(&c); /* room for more */
		bytes = cursor_bytes(&c, FORMAT_SAVED);
		if (!bytes)
			break;
		saved = cursor_of(bytes, FORMAT_SAVED);
		r = t->format->resume(t->writer, head, &saved, err);
	}
	if (!r) {
		outputs_edge_add(&run->edge, &c);
		for (enum outputs_cut k = 0; k < OUTPUTS_CUTS; k++)
			outputs_left_load(run->mask ? outputs_mask_left(run->mask, k) : &none, &c);
	}
	if (!r && (c.bad || cursor_left(&c) != 8))
		r = outfile_part_damaged(run->target->out, err);
	return r;
}

/* ---- writing ---- */

static uint64_t size_of(const struct outputs *run)
{
	uint64_t size = 0;

	for (const struct outputs_target *t = run->target; t; t = t->next)
		size += outfile_part_size(t->out);
	return size;
}

bool outputs_due(const struct outputs *run)
{
	const struct outputs_kept *k = run->kept;

	if (!k || run->err.code)
		return false;
	return !k->saved || size_of(run) - k->saved_size >= k->sync_bytes || clock_since(k->saved_ns) >= SYNC_SECONDS;
}

/* Nothing can go on with outputs that are too small for the mesh. */
bool outputs_saved(const struct outputs *run)
{
	return run->kept && run->kept->saved && run->err.code != ERR_LIMIT;
}

static void put_sum(struct packer *p, const struct outfile_sum *s)
{
	packer_u64(p, s->from);
	packer_u64(p, s->size);
	packer_u64(p, s->chain);
	packer_u64(p, s->part);
}

static void pack(const struct outputs *run, const void *state, size_t size, struct packer *p)
{
	const struct outputs_left none = {.triangles = 0};
	const char *options = run->kept->options;

	packer_u32(p, MAGIC);
	packer_u32(p, VERSION);
	packer_u32(p, (uint32_t)strlen(options));
	packer_bytes(p, options, strlen(options));
	packer_u64(p, size);
	packer_bytes(p, state, size);
	for (const struct outputs_target *t = run->target; t; t = t->next) {
		struct outfile_sum sum, annex;

		outfile_part_sums(t->out, &sum, &annex);
		put_sum(p, &sum);
		put_sum(p, &annex);
	}
	for (const struct outputs_target *t = run->target; t; t = t->next) {
		uint8_t bytes[FORMAT_SAVED] = {0};
		struct packer saved = packer_of(bytes, sizeof(bytes));

		t->format->save(t->writer, &saved);
		packer_u64(p, 0);
		packer_bytes(p, bytes, sizeof(bytes));
	}
	outputs_edge_save(&run->edge, p);
	for (enum outputs_cut k = 0; k < OUTPUTS_CUTS; k++)
		outputs_left_save(run->mask ? outputs_mask_left(run->mask, k) : &none, p);
	packer_u64(p, XXH3_64bits(p->start, packer_size(p)));
}

int outputs_save(struct outputs *run, const void *state, size_t size, struct err *err)
{
	size_t room = 64 + OPTIONS + size + sizeof(run->edge) + OUTPUTS_CUTS * sizeof(struct outputs_left);
	struct packer p;
	uint8_t *bytes;
	int r = 0;

	if (!run->kept)
		return 0;
	for (struct outputs_target *t = run->target; t && !r; t = t->next) {
		r = outfile_part_sync(t->out, err);
		room += TARGET_SAVED;
	}
	if (r)
		return r;
	bytes = malloc(room);
	if (!bytes)
		return err_set(err, ERR_NOMEM, "no memory to keep the state of a fetch");
	p = packer_of(bytes, room);
	pack(run, state, size, &p);
	r = p.bad ? err_set(err, ERR_INTERNAL, "the state of a fetch does not fit its place") :
		    outfile_part_store(run->target->out, bytes, packer_size(&p), err);
	free(bytes);
	if (r)
		return r;
	run->kept->saved = true;
	run->kept->saved_ns = clock_mono_ns();
	run->kept->saved_size = size_of(run);
	return 0;
}

void outputs_keep_discard(struct outputs *run)
{
	for (const struct outputs_target *t = run->target; t && run->kept && !outputs_saved(run); t = t->next)
		if (t->out)
			outfile_part_discard(t->out);
}

void outputs_keep_done(struct outputs *run)
{
	for (const struct outputs_target *t = run->target; t && run->kept; t = t->next)
		outfile_part_clean(t->out);
	if (run->kept)
		run->kept->saved = false;
}
