/*
 * Reusing finished domains.
 *
 * A domain is stored under two digests: its base (kernel, lattice with its offset, view, region), by which it is found,
 * and its list (the ranges of keys on which it depends, with their content sums), so that those of several generations
 * can be stored together. The file begins with its proof: that list, and its border chains. For a region, a domain of
 * the same content is used at once. Otherwise cut_valid tests each version; that costs some index pages and rarely a
 * cell, whereas making it again costs all of its points.
 *
 * A domain that is needed only to number later blocks is read up to its front: its counts and digests, the open
 * vertices and their links suffice, because closed vertices are in no other domain. If nobody reads the mesh, not even
 * that is needed: the header has the sums.
 *
 * Finding the lists of a base reads a folder, which is most of the cost if many domains are found. A caller that asks
 * for the same bases again and again can remember the list that was used last (`hint`); it is only tried first.
 *
 * If a push has changed a few of 240 regions, opening 240 files takes longer than anything else. So the caller can also
 * remember their summaries (`recall`): their numbers, and the part of their proofs that boxes need. The file is read
 * only if a summary is not sufficient. Its existence and size are always checked, with one fstatat, because it may have
 * been removed; so nobody has to report removals.
 */
#include <string.h>
#define XXH_STATIC_LINKING_ONLY /* for the hash state on the stack */
#include <xxhash.h>

#include "cursor.h"
#include "err.h"
#include "pipe.h"
#include "pipe_priv.h"
#include "store_pack.h"

enum { VERSIONS = 8, PROOF_HEAD = 24, PROOF_RANGE = 32, PROOF_SITE = 8, PROOF_PART = 24, PROOF_LINES = 72 };
#define PROOF_MOST                                                                                          \
	(PROOF_HEAD + (CUT_TRACE_RANGES + CUT_TRACE_OWN) * PROOF_RANGE + 4 * CUT_TRACE_SITES * PROOF_SITE + \
	 CUT_TRACE_PARTS * PROOF_PART + PROOF_LINES)
_Static_assert(sizeof(struct grid_sum) == PROOF_RANGE && offsetof(struct grid_sum, sum) == 16, "format.md");
_Static_assert(PROOF_MOST <= STORE_PROOF_MOST, "a proof can be stored");
_Static_assert((int)CUT_REGION_TEXT_SIZE <= (int)STORE_REGION, "a pack has room for the text of a region");

/* ---- keys ---- */

void pipe_key_init(struct pipe_key *key, const struct grid *grid, const struct view *view)
{
	char lattice[LATTICE_TEXT_SIZE];

	lattice_text(&grid_manifest(grid)->lattice, lattice);
	key->content = grid_content(grid);
	key->part[0] = digest_hash(lattice, strlen(lattice));
	/* Which records have which slot is in the content and in the sums, so numbers of sources are in no key. */
	key->part[1] = view_hash_slots(view);
	/* The origin decides what the numbers of regions and positions mean. */
	if (view->map.is.k)
		digest_add(&key->part[1], digest_hash(view->map.from, sizeof view->map.from));
}

static struct digest key_of(const struct digest parts[3], const struct cut_region *region)
{
	char text[CUT_REGION_TEXT_SIZE];
	XXH128_hash_t key;
	XXH3_state_t state;

	cut_region_text(region, text);
	XXH3_128bits_reset(&state);
	XXH3_128bits_update(&state, PIPE_KERNEL, sizeof PIPE_KERNEL);
	XXH3_128bits_update(&state, parts, 3 * sizeof *parts);
	XXH3_128bits_update(&state, text, strlen(text));
	key = XXH3_128bits_digest(&state);
	return (struct digest){key.high64, key.low64};
}

struct digest pipe_key_of(const struct pipe_key *key, const struct cut_region *region)
{
	const struct digest parts[3] = {{0, 0}, key->part[0], key->part[1]};

	return key_of(parts, region);
}

struct digest pipe_key_mesh(const struct pipe_key *key, const struct cut_region *root)
{
	const struct digest parts[3] = {key->content, key->part[0], key->part[1]};

	return key_of(parts, root);
}

/* ---- proofs ---- */

static size_t proof_size(uint32_t ranges, uint32_t sites, uint32_t parts)
{
	return PROOF_HEAD + (size_t)ranges * PROOF_RANGE + (size_t)sites * PROOF_SITE + (size_t)parts * PROOF_PART;
}

static bool is_zero(struct digest d)
{
	return !d.hi && !d.lo;
}

/* Whether the proof has what it depends on beside points. Without lines in the dataset it does not, as before there were any. */
static bool has_lines(const struct cut_trace *t)
{
	return t->lines.cap || !is_zero(t->lines.sum) || !is_zero(t->live.lines);
}

static void lines_pack(struct packer *p, const struct cut_trace *t)
{
	for (unsigned i = 0; i < 4; i++)
		packer_i32(p, t->lines.box[i]);
	for (unsigned i = 0; i < 4; i++)
		packer_i32(p, t->lines.disc[i]);
	packer_u64(p, t->lines.sum.hi);
	packer_u64(p, t->lines.sum.lo);
	packer_u64(p, t->live.lines.hi);
	packer_u64(p, t->live.lines.lo);
	packer_u32(p, t->lines.cap);
	packer_u32(p, 0);
}

static void lines_unpack(struct cursor *c, struct cut_trace *t)
{
	for (unsigned i = 0; i < 4; i++)
		t->lines.box[i] = cursor_i32(c);
	for (unsigned i = 0; i < 4; i++)
		t->lines.disc[i] = cursor_i32(c);
	t->lines.sum.hi = cursor_u64(c);
	t->lines.sum.lo = cursor_u64(c);
	t->live.lines.hi = cursor_u64(c);
	t->live.lines.lo = cursor_u64(c);
	t->lines.cap = cursor_u32(c);
	cursor_u32(c);
}

/* The list of a domain: of its ranges, and of its pieces if it has some. A domain without a trace depends on everything. */
static struct digest list_of(const struct cut_trace *t, const uint8_t *proof, struct digest content)
{
	struct digest list[2];

	if (!t->nrange)
		return content;
	list[0] = digest_hash(proof + PROOF_HEAD, (size_t)t->nrange * PROOF_RANGE);
	if (is_zero(t->lines.sum))
		return list[0];
	list[1] = t->lines.sum;
	return digest_hash(list, sizeof list);
}

static size_t proof_pack(const struct cut_trace *t, uint8_t *out)
{
	uint32_t sites = t->nsite[0] + t->nsite[1] + t->nsite[2] + t->nsite[3];
	size_t size = proof_size(t->nrange, sites, t->live.n) + (has_lines(t) ? PROOF_LINES : 0);
	struct packer p = packer_of(out, size);

	packer_u32(&p, t->nrange);
	for (unsigned i = 0; i < 4; i++)
		packer_u32(&p, t->nsite[i]);
	packer_u32(&p, t->live.n);
	for (uint32_t i = 0; i < t->nrange; i++) {
		packer_u64(&p, t->range[i].lo);
		packer_u64(&p, t->range[i].hi);
		packer_u64(&p, t->range[i].sum.hi);
		packer_u64(&p, t->range[i].sum.lo);
	}
	for (uint32_t i = 0; i < sites; i++) {
		packer_i32(&p, t->site[i].x);
		packer_i32(&p, t->site[i].y);
	}
	for (uint32_t i = 0; i < t->live.n; i++) {
		packer_u64(&p, t->live.part[i].points);
		packer_u64(&p, t->live.part[i].sum.hi);
		packer_u64(&p, t->live.part[i].sum.lo);
	}
	if (has_lines(t))
		lines_pack(&p, t);
	return size;
}

/* What a domain without pieces depends on: that none comes to its triangles. */
static void lines_of(const struct mesh_domain *d, const struct view_map *map, struct cut_trace *t)
{
	const int64_t box[4] = {d->box[0], d->box[1], d->box[3], d->box[4]};
	int64_t mapped[4];

	if (!d->nvertex)
		return;
	memcpy(mapped, box, sizeof mapped);
	if (map->is.k)
		view_map_box(map, box, mapped);
	for (unsigned i = 0; i < 4; i++)
		t->lines.box[i] = (int32_t)(mapped[i] < INT32_MIN ? INT32_MIN : mapped[i] > INT32_MAX ? INT32_MAX : mapped[i]);
}

/* False: it is not a proof for that region. `trace` is initialized. */
static bool proof_unpack(const struct store_front *f, const struct view_map *map, const struct cut_region *region,
			 struct cut_trace *t)
{
	const struct store_beside *b = &f->beside;
	struct cursor c = cursor_of(b->proof, b->proof_size);
	const uint8_t *site;
	uint32_t sites = 0;
	size_t size;

	t->nrange = cursor_u32(&c);
	for (unsigned i = 0; i < 4; i++) {
		t->nsite[i] = cursor_u32(&c);
		if (t->nsite[i] > CUT_TRACE_SITES)
			return false;
		sites += t->nsite[i];
	}
	t->live.n = cursor_u32(&c);
	if (c.bad || t->nrange > CUT_TRACE_RANGES + CUT_TRACE_OWN || t->live.n > CUT_TRACE_PARTS)
		return false;
	size = proof_size(t->nrange, sites, t->live.n);
	if (b->proof_size != size && b->proof_size != size + PROOF_LINES)
		return false;
	/* Many regions have many sites: as they are in the file, little-endian. */
	memcpy(t->range, cursor_bytes(&c, (size_t)t->nrange * PROOF_RANGE), (size_t)t->nrange * PROOF_RANGE);
	site = cursor_bytes(&c, (size_t)sites * PROOF_SITE);
	for (uint32_t i = 0; i < sites; i++, site += PROOF_SITE) {
		memcpy(&t->site[i].x, site, 4);
		memcpy(&t->site[i].y, site + 4, 4);
	}
	for (uint32_t i = 0; i < t->live.n; i++) {
		t->live.part[i].points = cursor_u64(&c);
		t->live.part[i].sum.hi = cursor_u64(&c);
		t->live.part[i].sum.lo = cursor_u64(&c);
	}
	if (b->proof_size != size)
		lines_unpack(&c, t);
	else
		lines_of(&f->domain, map, t);
	return !c.bad && cut_trace_fits(t, region);
}

/* ---- storing ---- */

static void stored_of(const struct store_front *f, const struct store_id *id, struct pipe_stored *ret)
{
	*ret = (struct pipe_stored){.id = *id,
				    .digest = f->domain.digest,
				    .payload = f->payload,
				    .triangles = f->domain.ntriangle,
				    .bytes = f->bytes,
				    .used_ns = f->used_ns};
}

/* It is valid in the generation of the key. Without a trace it is valid only for identical content. */
static void summary_of(const struct store_front *f, const struct store_id *id, const struct pipe_key *key,
		       const struct cut_region *region, const struct cut_trace *trace, struct pipe_summary *ret)
{
	*ret = (struct pipe_summary){.id = *id, .front = *f, .cap = trace->lines.cap};
	ret->front.beside = (struct store_beside){.content = key->content};
	ret->front.domain.vertex = NULL;
	ret->front.domain.link = NULL;
	ret->front.domain.triangle = NULL;
	ret->front.domain.final = NULL;
	ret->front.domain.edges = NULL;
	if (!trace->nrange)
		return;
	cut_reach_of(trace, region, &ret->reach);
	ret->live = trace->live;
}

/* What is stored of a domain that pipe_domain made in `memory`. */
struct storing {
	struct store_id id;
	struct store_beside beside;
	uint8_t proof[PROOF_MOST];
};

static void storing_of(const struct pipe_key *key, const struct cut_region *region, const struct cut_trace *trace,
		       struct storing *ret)
{
	ret->beside = (struct store_beside){key->content, ret->proof, proof_pack(trace, ret->proof)};
	ret->id = (struct store_id){pipe_key_of(key, region), list_of(trace, ret->proof, key->content)};
}

int pipe_store(int storefd, const struct pipe_key *key, const struct cut_region *region, const struct mesh_domain *domain,
	       const void *memory, struct pipe_stored *ret, struct pipe_summary *ret_summary, struct err *err)
{
	const struct cut_trace *trace = &((const struct pipe_trace *)memory)->trace;
	struct store_front front;
	struct storing s;
	int r;

	storing_of(key, region, trace, &s);
	r = store_put(storefd, &s.id, &s.beside, domain, &front, err);
	if (r)
		return r;
	stored_of(&front, &s.id, ret);
	if (ret_summary)
		summary_of(&front, &s.id, key, region, trace, ret_summary);
	return 0;
}

int pipe_pack(struct store_packer *packer, const struct pipe_key *key, const struct cut_region *region,
	      const struct mesh_domain *domain, const void *memory, bool flat, struct pipe_stored *ret, struct err *err)
{
	char text[CUT_REGION_TEXT_SIZE];
	struct store_front front;
	struct storing s;
	int r;

	storing_of(key, region, &((const struct pipe_trace *)memory)->trace, &s);
	r = store_packer_add(packer, cut_region_text(region, text), &s.id, &s.beside, flat, domain, &front, err);
	if (!r)
		stored_of(&front, &s.id, ret);
	return r;
}

/* ---- finding ---- */

static uint8_t *front_of(const struct pipe_reuse_params *p)
{
	return pipe_domain_arena(p->grid, p->memory);
}

static size_t front_room(const struct pipe_reuse_params *p)
{
	size_t before = (size_t)(front_of(p) - (uint8_t *)p->memory);

	return p->size > before ? p->size - before : 0;
}

/* Includes the header of a store's file (store_proof). */
size_t pipe_refine_bytes(const struct grid *grid)
{
	return PIPE_TRACE + align_line(grid_reader_bytes(grid)) + align_line(STORE_PROOF_FRONT + PROOF_MOST);
}

static int valid_here(const struct pipe_reuse_params *p, const struct cut_trace *trace, struct err *err)
{
	struct grid_reader *reader = p->reader;
	bool valid = false;
	int r = 0;

	if (!reader)
		r = grid_reader_new(p->grid, (uint8_t *)p->memory + PIPE_TRACE, grid_reader_bytes(p->grid), &reader, err);
	if (r)
		return r;
	r = cut_valid(reader, p->view, p->region, trace, &valid, err);
	if (!p->reader)
		grid_reader_free(reader);
	return r ? r : valid ? 0 : PIPE_E_ABSENT;
}

static int check_version(const struct pipe_reuse_params *p, const struct pipe_found *f, struct err *err)
{
	const bool same = digest_equal(f->front.beside.content, p->key->content);
	struct cut_trace *trace = &((struct pipe_trace *)p->memory)->trace;
	struct pipe_summary summary;
	int r;

	cut_trace_init(trace, (struct pipe_trace *)p->memory + 1);
	if (!proof_unpack(&f->front, &p->view->map, p->region, trace))
		return same ? 0 : PIPE_E_ABSENT;
	if (trace->lines.cap > p->cap)
		return PIPE_E_ABSENT;
	r = same ? 0 : valid_here(p, trace, err);
	if (!r && p->remember) {
		summary_of(&f->front, &f->id, p->key, p->region, trace, &summary);
		p->remember(p->ctx, &summary);
	}
	return r;
}

/* Conditions of the store are conditions of this room. */
static int absent(const struct pipe_reuse_params *p, int r)
{
	if (r == STORE_E_DAMAGED && p->damaged)
		++*p->damaged;
	return r > 0 ? PIPE_E_ABSENT : r;
}

/* In the other cases the whole file is read afterwards, and checked then. */
static bool front_wanted(const struct pipe_reuse_params *p)
{
	return p->light && !p->sums;
}

/* A domain that was made with more memory would be split with this budget: only the plan's cap decides. One with pieces needs
 * more than its positions say: it must have been made with no larger cap. */
static bool fits_cap(const struct pipe_reuse_params *p, const struct mesh_domain *d)
{
	return d->counts.used + d->counts.halo <= p->cap;
}

/* Reads its front, and tests whether it is valid for the region. If the whole file is read afterwards, the proof suffices. */
static int read_version(const struct pipe_reuse_params *p, struct pipe_found *f, struct err *err)
{
	int r = (front_wanted(p) ? store_front : store_proof)(p->storefd, &f->id, front_of(p), front_room(p), &f->front, err);

	if (r)
		return absent(p, r);
	if (!fits_cap(p, &f->front.domain))
		return PIPE_E_ABSENT;
	f->fits = true;
	return check_version(p, f, err);
}

/* Whether it is remembered, valid, and its file exists. */
static bool is_recalled(const struct pipe_reuse_params *p, struct pipe_found *f)
{
	struct pipe_summary s;

	if (!p->recall || front_wanted(p) || p->after_ns || !p->recall(p->ctx, f->id.base, &s) || !fits_cap(p, &s.front.domain) ||
	    s.cap > p->cap)
		return false;
	if (!digest_equal(s.front.beside.content, p->key->content) && !cut_additions_far(p->grid, p->region, &s.reach, &s.live))
		return false;
	if (!store_there(p->storefd, &s.id, s.front.bytes, &s.front.used_ns))
		return false;
	*f = (struct pipe_found){.id = s.id, .front = s.front, .versions = 1, .fits = true};
	return true;
}

static int return_found(const struct pipe_reuse_params *p, const struct store_id *id, const struct store_front *front,
			struct mesh_domain *ret, struct pipe_stored *ret_stored, size_t *ret_held, struct err *err)
{
	struct mesh_domain d = front->domain;
	size_t held = front->whole;
	int r = 0;

	if (p->sums) {
		d.link = NULL;
		d.vertex = NULL;
		held = 0;
	} else if (p->light) {
		/* Moves the links and then the open vertices to the start. */
		uint8_t *at = memmove(p->memory, d.link, (size_t)d.nopen * (sizeof *d.link + sizeof *d.vertex));

		d.link = (void *)at;
		d.vertex = (void *)(at + (size_t)d.nopen * sizeof *d.link);
		held = (size_t)d.nopen * (sizeof *d.link + sizeof *d.vertex);
	} else {
		r = store_get(p->storefd, id, p->memory, p->size, &d, err);
	}
	if (r)
		return absent(p, r);
	stored_of(front, id, ret_stored);
	*ret = d;
	*ret_held = held;
	return 0;
}

int pipe_find(const struct pipe_reuse_params *p, struct pipe_found *ret, struct err *err)
{
	struct store_version version[VERSIONS];
	int r, is = PIPE_E_ABSENT;
	struct digest hint;
	bool hinted;

	*ret = (struct pipe_found){.id.base = pipe_key_of(p->key, p->region)};
	if (is_recalled(p, ret))
		return 0;
	hinted = p->hint && !p->after_ns && p->hint(p->ctx, ret->id.base, &hint);
	if (hinted) {
		ret->id.list = hint;
		ret->versions = 1;
		is = read_version(p, ret, err);
		if (is != PIPE_E_ABSENT)
			return is;
	}
	r = store_versions(p->storefd, ret->id.base, version, VERSIONS, &ret->versions, err);
	if (r)
		return r;
	for (size_t i = 0; is == PIPE_E_ABSENT && i < ret->versions && version[i].mtime_ns >= p->after_ns; i++) {
		if (hinted && digest_equal(version[i].list, hint))
			continue;
		ret->id.list = version[i].list;
		is = read_version(p, ret, err);
	}
	return is;
}

int pipe_reuse(const struct pipe_reuse_params *p, struct mesh_domain *ret, struct pipe_stored *ret_stored, size_t *ret_held,
	       struct err *err)
{
	struct pipe_found f;
	int r = pipe_find(p, &f, err);

	return r ? r : return_found(p, &f.id, &f.front, ret, ret_stored, ret_held, err);
}

/* The stored version of the region that was used last, or else the latest. */
static bool last_version(const struct pipe_reuse_params *p, struct store_id *ret)
{
	struct store_version version;
	struct err err = ERR_INIT;
	size_t n;

	ret->base = pipe_key_of(p->key, p->region);
	if (p->hint && p->hint(p->ctx, ret->base, &ret->list))
		return true;
	if (store_versions(p->storefd, ret->base, &version, 1, &n, &err) || !n)
		return false;
	ret->list = version.list;
	return true;
}

/* Reads its trace to the start of `memory`. A file that cannot be read counts as unknown; the code that needs it reports the
 * error. */
static bool read_trace(const struct pipe_reuse_params *p, struct cut_trace **ret)
{
	struct pipe_trace *trace = p->memory;
	struct store_front front;
	struct err err = ERR_INIT;
	struct store_id id;

	*ret = &trace->trace;
	if (!last_version(p, &id) || store_proof(p->storefd, &id, front_of(p), front_room(p), &front, &err))
		return false;
	cut_trace_init(&trace->trace, trace + 1);
	return proof_unpack(&front, &p->view->map, p->region, &trace->trace);
}

bool pipe_before(const struct pipe_reuse_params *p, struct pipe_before *ret)
{
	struct grid_reader *reader;
	struct cut_trace *trace;
	struct err err = ERR_INIT;
	uint32_t sites;
	bool stands;

	if (!read_trace(p, &trace) ||
	    grid_reader_new(p->grid, (uint8_t *)p->memory + PIPE_TRACE, grid_reader_bytes(p->grid), &reader, &err))
		return false;
	stands = cut_trace_still_live(reader, trace);
	grid_reader_free(reader);
	if (!stands)
		return false;
	sites = trace->nsite[0] + trace->nsite[1] + trace->nsite[2] + trace->nsite[3];
	ret->trace = *trace;
	ret->trace.range = NULL;
	ret->trace.nrange = 0;
	ret->trace.site = ret->site;
	memcpy(ret->site, trace->site, sites * sizeof *ret->site);
	return true;
}

void pipe_found_stored(const struct pipe_found *f, struct pipe_stored *ret)
{
	stored_of(&f->front, &f->id, ret);
}
