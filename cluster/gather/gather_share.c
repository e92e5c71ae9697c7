/*
 * All tasks write the same files: binary PLY and STL, whose records have a size.
 *
 * The model: a task has a range of domains, by prefix sums, and those bytes of each file that outputs_share.c says, about the
 * records of these domains. Domains at the borders of a range are read by two tasks. The numbers of vertices are a function of
 * the packs (gather_place.c), so every attempt writes the same bytes.
 *
 * Who makes the files: nobody may make one when the run is over, and a late attempt may do anything. So an attempt makes files
 * that have its number in their names, and a file `shared` of the work folder, which it links to a name that is the same for all:
 * the first link decides whose files are written. All others open them without O_CREAT, and find nothing after finish. An attempt
 * that is late writes what is there already, in a file that has its name or is gone.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cut.h"
#include "feed.h"
#include "gather_priv.h"
#include "io.h"
#include "outfile.h"

enum { BLOCK = 4 << 20, SOME = 1024, LOOK = 32, AGREED = GATHER_PART + (int)sizeof(struct digest) };

/* ---- which outputs ---- */

bool gather_shares(const struct ctl_fetch_options *a)
{
	struct err ignored = ERR_INIT;

	if (a->tile || a->levels || a->trim_hull || a->max_edge || a->cut[OUTPUTS_MASK].n || a->cut[OUTPUTS_ERASE].n)
		return false;
	for (unsigned i = 1; i <= ctl_fetch_count(a); i++) {
		const struct ctl_fetch_output o = ctl_fetch_output(a, i);
		const struct format *f = ctl_fetch_format(a, i, &ignored);

		if (!f || !f->fixed || o.canonical || o.sidecar)
			return false;
	}
	return ctl_fetch_count(a) > 0;
}

/* ---- whose files ---- */

static void agreed_name(const struct gather_params *p, char name[WORK_NAME])
{
	snprintf(name, WORK_NAME, "shared-0-%016" PRIx64, work_about(p->work)->id);
}

/* The name of parts by the file `fd`. */
static int read_agreed(int fd, const char *name, char part[GATHER_PART], struct err *err)
{
	uint8_t bytes[AGREED];
	struct digest sum;
	int r = io_read_at(fd, bytes, sizeof(bytes), 0, name, err);

	if (r)
		return r;
	memcpy(&sum, bytes + GATHER_PART, sizeof(sum));
	if (!digest_equal(sum, digest_hash(bytes, GATHER_PART)) || bytes[GATHER_PART - 1]) {
		err_set(err, ERR_CORRUPT, "it is damaged");
		return err_add_file(err, name);
	}
	memcpy(part, bytes, GATHER_PART);
	return 0;
}

static int need_agreed(const struct gather_params *p, char part[GATHER_PART], struct err *err)
{
	char name[WORK_NAME];
	int fd = -1, r;

	agreed_name(p, name);
	r = work_file_open(p->work, name, AGREED, &fd, err);
	if (!r)
		r = read_agreed(fd, name, part, err);
	io_close(fd);
	return r;
}

static bool is_agreed(const struct gather_params *p)
{
	char name[WORK_NAME];

	agreed_name(p, name);
	return !faccessat(work_fd(p->work), name, F_OK, 0);
}

static int write_agreed(const struct gather_params *p, const char *name, const char *own, struct err *err)
{
	uint8_t bytes[AGREED] = {0};
	struct digest sum;
	int fd = -1, r = io_open(work_fd(p->work), name, O_WRONLY | O_CREAT | O_EXCL, 0640, &fd, err);

	memcpy(bytes, own, strlen(own));
	sum = digest_hash(bytes, GATHER_PART);
	memcpy(bytes + GATHER_PART, &sum, sizeof(sum));
	if (!r)
		r = io_write_at(fd, bytes, sizeof(bytes), 0, name, err);
	if (!r)
		r = io_sync(fd, name, err);
	io_close(fd);
	return r;
}

static void drop_files(const struct gather_params *p, const char *part)
{
	for (unsigned i = 1; i <= ctl_fetch_count(p->outputs); i++)
		outfile_held_drop(ctl_fetch_output(p->outputs, i).path, part);
}

static int make_files(const struct gather_params *p, const char *part, struct err *err)
{
	int r = 0;

	for (unsigned i = 1; i <= ctl_fetch_count(p->outputs) && !r; i++)
		r = outfile_shared_make(ctl_fetch_output(p->outputs, i).path, p->outputs->no_clobber, part, err);
	if (r)
		drop_files(p, part);
	return r;
}

/* The answer of a link may be lost; the file that has the name tells. If there is none, or that is not known, `own` may still be
 * what others will find, and its files stay. */
static int link_agreed(const struct gather_params *p, const char *temp, char part[GATHER_PART], struct err *err)
{
	char name[WORK_NAME];
	int failed;

	agreed_name(p, name);
	failed = io->linkat(work_fd(p->work), temp, work_fd(p->work), name, 0) ? errno : 0;
	if (failed && failed != EEXIST) {
		err_sys(err, failed, "cannot name %s", name);
		return err_add_file(err, name);
	}
	return failed ? need_agreed(p, part, err) : io_sync(work_fd(p->work), name, err);
}

/* The name of the files that all tasks write; made, if this attempt is the first. */
int gather_share_agree(const struct gather_params *p, struct work_attempt *attempt, const char *own, char part[GATHER_PART],
		       struct err *err)
{
	char temp[WORK_NAME];
	int r;

	if (is_agreed(p))
		return need_agreed(p, part, err);
	r = make_files(p, own, err);
	if (r)
		return r;
	memcpy(part, own, GATHER_PART);
	r = work_attempt_file(attempt, "", "shared", ".own", temp, err);
	if (!r)
		r = write_agreed(p, temp, own, err);
	if (r)
		drop_files(p, own); /* nobody knows of them */
	else
		r = link_agreed(p, temp, part, err);
	if (!r && strcmp(part, own))
		drop_files(p, own);
	io->unlinkat(work_fd(p->work), temp, 0);
	return r;
}

int gather_share_agreed(const struct gather_params *p, char part[GATHER_PART], struct err *err)
{
	return is_agreed(p) ? need_agreed(p, part, err) : WORK_E_ABSENT;
}

int gather_share_forget(const struct gather_params *p, const char *part, struct err *err)
{
	char name[WORK_NAME];
	int r;

	agreed_name(p, name);
	r = io_remove(work_fd(p->work), name, err);
	if (!r)
		drop_files(p, part);
	return r;
}

/* Whether the files were deleted, or have their names since finish, is not known here. */
void gather_share_gone(const struct gather_params *p, struct err *err)
{
	(void)p;
	err_add_hint(err, "if it was deleted while the run wrote it, 'acut-cluster resume' makes it again");
}

/* ---- domains ---- */

struct sharing {
	const struct gather_input *in;
	struct gather_places *places;
	struct outputs *run;
	uint64_t range[2]; /* of domains */
	void *memory;
	size_t size;
	uint64_t looks;
	struct gather_share_sums *sums;
	int (*given_up)(void *ctx);
	void *ctx;
};

static void count_vertices(struct sharing *s, const struct mesh_vertex *v, uint64_t n)
{
	digest_add_vertices(&s->sums->vertex_digest, s->in->manifest->lattice.k, (const int32_t(*)[3])v, n);
	s->sums->vertices += n;
}

static void count_triangles(struct sharing *s, const struct mesh_domain *d)
{
	uint64_t place[SOME][3];

	for (uint32_t at = 0, n; at < d->ntriangle; at += n) {
		n = d->ntriangle - at < SOME ? d->ntriangle - at : SOME;
		for (uint32_t i = 0; i < n; i++)
			for (int k = 0; k < 3; k++) {
				const struct mesh_vertex *v = &d->vertex[d->triangle[at + i][k]];

				place[i][k] = digest_place(v->x, v->y);
			}
		digest_add_triangles(&s->sums->digest, (const uint64_t(*)[3])place, n, s->in->manifest->lattice.k);
	}
	s->sums->triangles += d->ntriangle;
}

_Static_assert(sizeof(struct mesh_vertex) == sizeof(int32_t[3]), "vertices are given as they are");

/* `mine`: they count. */
static int give(struct sharing *s, uint64_t first, const struct mesh_vertex *v, uint64_t n, bool mine, struct err *err)
{
	if (mine)
		count_vertices(s, v, n);
	return n ? outputs_share_vertices(s->run, first, (const int32_t(*)[3])v, n, err) : 0;
}

/* All vertices that are the domain's. *ret_held: open ones. */
static int give_vertices(struct sharing *s, const struct gather_place *at, const struct mesh_domain *d, bool mine,
			 uint32_t *ret_held, struct err *err)
{
	struct mesh_vertex some[SOME];
	const struct mesh_vertex *extra = NULL;
	size_t nextra = 0;
	uint32_t n = 0, held = 0;
	int r = 0;

	for (uint32_t i = 0; i <= d->nopen && !r; i++) {
		if (n == SOME || i == d->nopen) {
			r = give(s, at->first + held - n, some, n, mine, err);
			n = 0;
		}
		if (i < d->nopen && cut_region_holds(&at->region, d->vertex[i].x, d->vertex[i].y)) {
			some[n++] = d->vertex[i];
			held++;
		}
	}
	*ret_held = held;
	if (!r)
		r = give(s, at->first + held, d->vertex + d->nopen, d->nvertex - d->nopen, mine, err);
	if (!r && at->own != held + (uint64_t)d->nvertex - d->nopen)
		r = gather_place_extras(s->places, at, &extra, &nextra, err);
	if (mine)
		s->sums->extra += nextra;
	return r ? r : give(s, at->first + at->own - nextra, extra, nextra, mine, err);
}

/* In the memory of the links, which nobody needs. */
static int number_open(struct sharing *s, const struct gather_place *at, const struct mesh_domain *d, uint64_t *number,
		       struct err *err)
{
	uint64_t next = at->first;
	int r = 0;

	for (uint32_t i = 0; i < d->nopen && !r; i++) {
		if (cut_region_holds(&at->region, d->vertex[i].x, d->vertex[i].y))
			number[i] = next++;
		else
			r = gather_place_number(s->places, &d->vertex[i], &number[i], err);
	}
	return r;
}

static int write_domain(struct sharing *s, const struct gather_place *at, bool mine, struct err *err)
{
	const struct store_pack *pack;
	struct store_pack_entry e;
	struct mesh_domain d = {.nvertex = 0};
	uint32_t held = 0;
	uint64_t *number;
	int r = gather_place_entry(s->places, at, &pack, &e, err);

	s->sums->domains++;
	if (!r)
		r = store_pack_get(pack, &e, s->memory, s->size, &d, err);
	if (!r)
		r = give_vertices(s, at, &d, mine, &held, err);
	if (r || !d.ntriangle)
		return r;
	if (mine)
		count_triangles(s, &d);
	number = (uint64_t *)d.link;
	r = number_open(s, at, &d, number, err);
	if (!r) {
		const struct format_piece piece = {.position = (const int32_t(*)[3])d.vertex,
						   .number = number,
						   .nnumber = d.nopen,
						   .shift = at->first + held - d.nopen,
						   .triangle = (const uint32_t(*)[3])d.triangle,
						   .flags = d.nedges ? d.edges : NULL};

		r = outputs_share_triangles(s->run, at->first_triangle, &piece, d.ntriangle, mine, err);
	}
	return r;
}

/* Another attempt at the task is asked for now and then: if it has made everything, this one need not write any more. */
static int go_on(struct sharing *s, struct err *err)
{
	int r = work_check_interrupt(s->in->p->work, err);

	if (r || s->looks++ % LOOK || !s->given_up(s->ctx))
		return r;
	return err_set(err, ERR_CANCELLED, "another attempt has done the task");
}

static bool wants(void *ctx, uint64_t domain, uint64_t n, uint64_t first, uint64_t vertices, uint64_t first_triangle,
		  uint64_t triangles)
{
	const struct sharing *s = ctx;

	return (domain < s->range[1] && domain + n > s->range[0]) ||
	       outputs_share_wants(s->run, (const uint64_t[]){first, vertices}, (const uint64_t[]){first_triangle, triangles});
}

static int write_one(void *ctx, uint64_t domain, const struct gather_place *at, struct err *err)
{
	struct sharing *s = ctx;
	int r = go_on(s, err);

	return r ? r : write_domain(s, at, domain >= s->range[0] && domain < s->range[1], err);
}

/* ---- a task ---- */

int gather_share_of(struct gather_places *places, uint32_t index, uint32_t tasks, uint64_t range[2], struct outputs_share *ret,
		    struct err *err)
{
	int r = 0;

	ret->index = index;
	ret->tasks = tasks;
	for (uint32_t i = 0; i < 2 && !r; i++) {
		struct gather_border at;

		r = gather_places_border(places, index + i, tasks, &at, err);
		range[i] = at.domain;
		ret->vertices[i] = at.first;
		ret->triangles[i] = at.first_triangle;
	}
	return r;
}

int gather_share_write(const struct gather_input *in, struct gather_places *places, const uint64_t range[2], struct outputs *run,
		       int (*given_up)(void *ctx), void *ctx, struct gather_share_sums *ret, struct err *err)
{
	struct sharing s = {.in = in,
			    .places = places,
			    .run = run,
			    .range = {range[0], range[1]},
			    .size = in->memory + 64,
			    .sums = ret,
			    .given_up = given_up,
			    .ctx = ctx};
	const struct gather_places_choice choice = {wants, &s};
	int r;

	s.memory = aligned_alloc(64, (s.size + 63) & ~(size_t)63);
	r = s.memory ? gather_places_walk(places, &choice, write_one, &s, err) :
		       err_set(err, ERR_NOMEM, "no memory for a domain of %zu bytes", s.size);
	free(s.memory);
	ret->place = gather_place_counts(places);
	return r;
}

uint64_t gather_share_block(const struct gather_params *p)
{
	return p->block ? p->block : BLOCK;
}
