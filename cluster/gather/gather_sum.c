/*
 * The phase sum: what all records of the phase mesh say, in one file (format.md, "Work folders").
 *
 * A task of gather needs to know which packs meet its share, and what comes before it. If each read the records for that, tasks
 * times tasks files would be opened. So one task reads them all, once, and writes a row for each pack, with sums over its groups
 * of domains; behind all rows these groups, with a hash for each pack; and, for tiles, where the share of each task begins. A
 * task of gather reads the rows, and the groups of the packs that it may need.
 *
 * The file follows from the records, the manifest, the options and the memory alone. Of two attempts the record of the phase
 * counts, as everywhere.
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "digest_pack.h"
#include "gather_priv.h"
#include "io.h"

enum { MAGIC = 0x55534341, VERSION = 1, HEAD = 16, BORDER = 8, ROW = 112, HASH = 16, GROUP = 56 };

/* ---- names of packs ---- */

void gather_pack_name(const struct gather_input *in, uint32_t i, char ret[WORK_NAME])
{
	snprintf(ret, WORK_NAME, WORK_IN_MESH "/pack-%" PRIu32 "-%016" PRIx64, i, in->pack[i].attempt);
}

/* The number in the name of a pack: that of the attempt that made it. */
static int read_name(struct gather_input *in, uint32_t i, const char *name, struct err *err)
{
	char again[WORK_NAME];
	const char *number = strrchr(name, '-');

	in->pack[i].attempt = number ? strtoull(number + 1, NULL, 16) : 0;
	gather_pack_name(in, i, again);
	if (in->pack[i].attempt && !strcmp(name, again))
		return 0;
	err_set(err, ERR_CORRUPT, "the record of mesh %" PRIu32 " names no pack of it", i);
	return err_add_file(err, name);
}

/* ---- bytes ---- */

static void pack_group(struct packer *p, const struct mesh_group *g)
{
	packer_u64(p, g->vertices);
	packer_u64(p, g->triangles);
	packer_u64(p, g->area);
	for (int k = 0; k < 4; k++)
		packer_i32(p, g->box[k]);
	for (int k = 0; k < 4; k++)
		packer_i32(p, g->region[k]);
}

static void unpack_group(struct cursor *c, struct mesh_group *g)
{
	g->vertices = cursor_u64(c);
	g->triangles = cursor_u64(c);
	g->area = cursor_u64(c);
	for (int k = 0; k < 4; k++)
		g->box[k] = cursor_i32(c);
	for (int k = 0; k < 4; k++)
		g->region[k] = cursor_i32(c);
}

static void pack_row(struct packer *p, const struct gather_pack *of)
{
	packer_u64(p, of->attempt);
	packer_u64(p, of->size);
	packer_u64(p, of->domains);
	packer_u64(p, of->each);
	packer_u64(p, of->ngroup);
	digest_pack(p, of->hash);
	pack_group(p, &of->all);
}

static bool unpack_row(struct cursor *c, struct gather_pack *of)
{
	uint64_t n;

	of->attempt = cursor_u64(c);
	of->size = cursor_u64(c);
	of->domains = cursor_u64(c);
	of->each = cursor_u64(c);
	n = cursor_u64(c);
	of->ngroup = (uint32_t)n;
	of->hash = digest_unpack(c);
	unpack_group(c, &of->all);
	return n <= MESH_GROUPS && (!n || (of->attempt && of->each && (of->domains - 1) / of->each == n - 1)) &&
	       !of->domains == !n;
}

static size_t rows_size(uint32_t npacks, uint32_t tasks)
{
	return HEAD + ((size_t)tasks + 1) * BORDER + (size_t)npacks * ROW + HASH;
}

uint64_t gather_sum_bytes(uint32_t npacks, uint32_t tasks)
{
	return rows_size(npacks, tasks) + ((uint64_t)npacks + 1) * sizeof(struct gather_pack);
}

/* What is before each pack, and where its groups are. */
static void add_up(struct gather_input *in, uint32_t tasks)
{
	uint64_t at = rows_size(in->npacks, tasks), first = 0, triangles = 0, domains = 0;

	for (uint32_t i = 0; i < in->npacks; i++) {
		struct gather_pack *of = &in->pack[i];

		of->at = at;
		of->first = first;
		of->first_triangle = triangles;
		of->first_domain = domains;
		at += (uint64_t)of->ngroup * GROUP;
		first += of->all.vertices;
		triangles += of->all.triangles;
		domains += of->domains;
	}
}

/* ---- reading ---- */

static int damaged(const struct gather_input *in, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the sums of the phase mesh are damaged");
	return err_add_file(err, in->sum_name);
}

static int read_rows(struct gather_input *in, const uint8_t *bytes, size_t size, uint32_t task, uint32_t tasks, struct err *err)
{
	struct cursor c = cursor_of(bytes, size), hash = cursor_of(bytes + size - HASH, HASH);
	bool good;

	if (!digest_equal(digest_unpack(&hash), digest_hash(bytes, size - HASH)))
		return damaged(in, err);
	good = cursor_u32(&c) == MAGIC;
	if (good && cursor_u32(&c) > VERSION) {
		err_set(err, ERR_VERSION, "sums of a later version; this acut is too old to read them");
		return err_add_file(err, in->sum_name);
	}
	good = good && cursor_u32(&c) == in->npacks && cursor_u32(&c) == tasks;
	for (uint32_t i = 0; i <= tasks; i++) {
		const uint64_t code = cursor_u64(&c);

		if (i == task || i == task + 1)
			in->border[i - task] = code;
	}
	for (uint32_t i = 0; i < in->npacks && good; i++)
		good = unpack_row(&c, &in->pack[i]);
	return good && !c.bad ? 0 : damaged(in, err);
}

/* Opens the file that the record names. */
static int open_file(struct gather_input *in, const struct work_record *record, struct err *err)
{
	if (record->nfile != 1 || strlen(record->file[0].name) >= sizeof(in->sum_name))
		return err_set(err, ERR_CORRUPT, "the record of sum 0 names no file");
	strcpy(in->sum_name, record->file[0].name);
	return work_file_open(in->p->work, in->sum_name, record->file[0].size, &in->sum_fd, err);
}

int gather_sum_read(struct gather_input *in, uint32_t task, struct err *err)
{
	const uint32_t tasks = work_about(in->p->work)->tasks[WORK_GATHER];
	const size_t size = rows_size(in->npacks, tasks);
	struct mesh_extent *x = calloc(1, sizeof(*x));
	struct work_record *record = NULL;
	uint8_t *bytes = malloc(size);
	int r = x && bytes ? 0 : err_set(err, ERR_NOMEM, "no memory for what is known of packs");

	if (!r)
		r = work_record_need(in->p->work, WORK_SUM, 0, &record, err);
	if (!r)
		r = mesh_sums_read(record, &in->sums, err);
	if (!r)
		r = mesh_extent_read(record, x, err);
	if (!r)
		r = open_file(in, record, err);
	if (!r)
		r = io_read_at(in->sum_fd, bytes, size, 0, in->sum_name, err);
	if (!r)
		r = read_rows(in, bytes, size, task, tasks, err);
	if (!r) {
		memcpy(in->box, x->box, sizeof(in->box));
		in->memory = x->largest;
		add_up(in, tasks);
	}
	free(bytes);
	free(x);
	work_record_free(record);
	return r;
}

bool gather_sum_is_of(const struct gather_input *in, uint32_t i, const struct work_record *record)
{
	char name[WORK_NAME];

	if (!record->nfile || !in->pack[i].attempt)
		return !record->nfile && !in->pack[i].attempt;
	gather_pack_name(in, i, name);
	return !strcmp(name, record->file[0].name) && in->pack[i].size == record->file[0].size;
}

int gather_groups(const struct gather_input *in, uint32_t i, struct mesh_group ret[MESH_GROUPS], struct err *err)
{
	const struct gather_pack *of = &in->pack[i];
	const size_t size = (size_t)of->ngroup * GROUP;
	uint8_t bytes[MESH_GROUPS * GROUP] = {0};
	struct cursor c = cursor_of(bytes, size);
	int r = size ? io_read_at(in->sum_fd, bytes, size, of->at, in->sum_name, err) : 0;

	if (!r && !digest_equal(of->hash, digest_hash(bytes, size)))
		r = damaged(in, err);
	for (uint32_t k = 0; k < of->ngroup && !r; k++)
		unpack_group(&c, &ret[k]);
	return r;
}

/* ---- making ---- */

struct summing {
	struct gather_input in;
	struct work_attempt *attempt;
	struct gather_tiles *tiles; /* NULL: they are not divided */
	struct mesh_task about;     /* of the record that was read last */
	uint64_t largest, at;       /* at: the next groups */
	uint64_t *border;
	int fd;
};

/* A record: its groups are written, its row is kept. */
static int add_record(struct summing *s, uint32_t i, struct err *err)
{
	struct gather_input *in = &s->in;
	struct gather_pack *of = &in->pack[i];
	const struct mesh_extent *x = &s->about.extent;
	uint8_t bytes[MESH_GROUPS * GROUP];
	struct packer p = packer_of(bytes, sizeof(bytes));
	int r = mesh_task_about(in->p->work, i, &s->about, err);

	of->all = mesh_group_none();
	if (r)
		return r;
	if (*s->about.pack) {
		r = read_name(in, i, s->about.pack, err);
		of->size = s->about.bytes;
		of->domains = x->domains;
		of->each = x->each;
		of->ngroup = x->n;
	}
	for (uint32_t k = 0; k < of->ngroup && !r; k++) {
		mesh_group_add(&of->all, &x->group[k]);
		pack_group(&p, &x->group[k]);
		r = s->tiles ? gather_tiles_add(s->tiles, &x->group[k], err) : 0;
	}
	of->hash = digest_hash(bytes, packer_size(&p));
	if (!r && of->ngroup)
		r = io_write_at(s->fd, bytes, packer_size(&p), s->at, in->sum_name, err);
	s->at += packer_size(&p);
	mesh_sums_add(&in->sums, &s->about.sums);
	mesh_box_add(in->box, x->box);
	s->largest = x->largest > s->largest ? x->largest : s->largest;
	return r;
}

static int write_rows(struct summing *s, uint32_t tasks, struct err *err)
{
	const size_t size = rows_size(s->in.npacks, tasks);
	uint8_t *bytes = malloc(size);
	struct packer p = packer_of(bytes, bytes ? size : 0);
	int r;

	if (!bytes)
		return err_set(err, ERR_NOMEM, "no memory for what is known of packs");
	packer_u32(&p, MAGIC);
	packer_u32(&p, VERSION);
	packer_u32(&p, s->in.npacks);
	packer_u32(&p, tasks);
	for (uint32_t i = 0; i <= tasks; i++)
		packer_u64(&p, s->border[i]);
	for (uint32_t i = 0; i < s->in.npacks; i++)
		pack_row(&p, &s->in.pack[i]);
	digest_pack(&p, digest_hash(bytes, packer_size(&p)));
	r = io_write_at(s->fd, bytes, size, 0, s->in.sum_name, err);
	free(bytes);
	return r;
}

/* Euler's formula, as of pipe_emitter_finish. */
static int check_whole(const struct mesh_sums *s, struct err *err)
{
	if (!s->triangles || s->triangles == 2 * s->vertices - 2 - s->hull)
		return 0;
	return err_set(err, ERR_INTERNAL, "the mesh is not whole: %llu vertices, %llu triangles, %llu on the hull",
		       (unsigned long long)s->vertices, (unsigned long long)s->triangles, (unsigned long long)s->hull);
}

static int check(struct summing *s, uint32_t tasks, struct err *err)
{
	int r = check_whole(&s->in.sums, err);

	if (!r)
		r = gather_check_ply(s->in.p->outputs, s->in.sums.vertices, "mesh has", err);
	if (!r && s->tiles)
		r = gather_tiles_check(s->tiles, err);
	if (!r && s->tiles)
		gather_tiles_divide(s->tiles, tasks, s->border);
	return r;
}

static int record(struct summing *s, struct err *err)
{
	struct gather_input *in = &s->in;
	struct mesh_extent *x = &s->about.extent;
	int r = work_result_file(s->attempt, in->sum_name, err);

	if (in->box[0] > in->box[3])
		memset(in->box, 0, sizeof(in->box));
	memcpy(x->box, in->box, sizeof(x->box));
	x->largest = s->largest;
	if (!r)
		r = mesh_sums_record(s->attempt, &in->sums, err);
	return r ? r : mesh_extent_record(s->attempt, x, err);
}

static int add_all(struct summing *s, uint32_t tasks, struct err *err)
{
	struct gather_input *in = &s->in;
	int r = 0;

	s->border = calloc((size_t)tasks + 1, sizeof(*s->border));
	if (!s->border)
		return err_set(err, ERR_NOMEM, "no memory for the shares of tasks");
	s->at = rows_size(in->npacks, tasks);
	mesh_box_begin(in->box);
	for (uint32_t i = 0; i < in->npacks && !r; i++) {
		r = work_check_interrupt(in->p->work, err);
		if (!r)
			r = add_record(s, i, err);
	}
	return r ? r : check(s, tasks, err);
}

static int sum(struct summing *s, struct err *err)
{
	const struct gather_params *p = s->in.p;
	const uint32_t tasks = work_about(p->work)->tasks[WORK_GATHER];
	int r = gather_input_begin(&s->in, p, err);

	if (!r && tasks > 1 && gather_divides_tiles(p->outputs))
		r = gather_tiles_new(&s->in, &s->tiles, err);
	if (!r)
		r = work_attempt_file(s->attempt, "", "sum", "", s->in.sum_name, err);
	if (!r)
		r = io_open(work_fd(p->work), s->in.sum_name, O_WRONLY | O_CREAT | O_EXCL, 0640, &s->fd, err);
	if (!r)
		r = add_all(s, tasks, err);
	if (!r)
		r = write_rows(s, tasks, err);
	if (!r)
		r = io_sync(s->fd, s->in.sum_name, err);
	return r ? r : record(s, err);
}

static int make(void *ctx, struct work_attempt *attempt, uint32_t index, struct err *err)
{
	const struct gather_params *p = ctx;
	struct summing *s = calloc(1, sizeof(*s));
	int r;

	(void)index;
	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for a record");
	s->in.p = p;
	s->attempt = attempt;
	s->fd = -1;
	r = sum(s, err);
	io_close(s->fd);
	gather_tiles_free(s->tiles);
	gather_input_done(&s->in);
	free(s->border);
	free(s);
	return r;
}

int gather_sum(const struct gather_params *p, struct err *err)
{
	int r = work_run(p->work, WORK_SUM, 0, make, (void *)p, err);

	return r > 0 ? 0 : r;
}
