/*
 * The bytes of a stored domain: header, layout, and the packing of closed vertices and triangles.
 *
 * A closed vertex is in the region, so two bytes for each coordinate suffice if the region is small, and two bytes for
 * each corner if the domain has few vertices. Otherwise they are written as in memory. The widths depend only on the
 * domain, so the same domain gives the same bytes. Unpacking works in place: the bytes are read to the end of the
 * memory of the array, and writing never overtakes reading.
 *
 * Version 4 wrote everything as in memory: the same with other widths. Versions up to 5 do not record how many points
 * share a position; their domains are not used if points were removed, because then there may have been such positions.
 * Version 6 has no edges, and no counts of rules from RULES_BEFORE on.
 */
#include "store_format.h"

#include <string.h>
#include <xxhash.h>

#include "cursor.h"
#include "digest_pack.h"

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "stored domains are written as they lie in memory: little-endian only"
#endif
_Static_assert(sizeof(struct mesh_link) == 24 && sizeof(struct mesh_vertex) == 12, "format.md");

enum { RULES_BEFORE = 12 };               /* counted in the place of versions up to 6; the others are at the end of the header */
static const uint32_t MAGIC = 0x4d444341; /* "ACDM" */
enum { VERSION = 7, NO_EDGES = 6, NO_MOST = 5, NO_CODE = 4, OLDEST = 4, WIDE = 4, NARROW = 2 };

void store_name(const struct store_id *id, char name[STORE_NAME])
{
	enum { BASE = STORE_FOLDER + 2, LIST = BASE + DIGEST_HEX_SIZE };

	/* AB/d-BASE-LIST */
	digest_hex(id->base, name + BASE);
	digest_hex(id->list, name + LIST);
	memcpy(name, name + BASE, 2);
	memcpy(name + 2, "/d-", 3);
	name[LIST - 1] = '-';
}

/* ---- layout ---- */

struct store_layout store_layout_of(const struct mesh_domain *d)
{
	struct store_layout l = {0};

	l.vertex = (size_t)d->nopen * sizeof(struct mesh_link);
	l.open_end = l.vertex + (size_t)d->nopen * sizeof(struct mesh_vertex);
	l.triangle = l.vertex + store_padded((size_t)d->nvertex * sizeof(struct mesh_vertex));
	l.final = l.triangle + store_padded((size_t)d->ntriangle * sizeof(uint32_t[3]));
	l.edges = l.final + store_padded(((size_t)d->nvertex + 7) / 8);
	l.total = l.edges + store_padded(d->nedges);
	return l;
}

struct store_extent store_extent_of(const struct mesh_domain *d, const struct store_code *c, size_t proof_size)
{
	struct store_extent e = {
		.open = (size_t)d->nopen * (sizeof(struct mesh_link) + sizeof(struct mesh_vertex)),
		.closed = (size_t)(d->nvertex - d->nopen) * store_vertex_bytes(c),
		.triangle = (size_t)d->ntriangle * store_triangle_bytes(c),
		.open_at = STORE_HEADER + store_padded(proof_size),
	};

	e.closed_at = e.open_at + e.open;
	e.triangle_at = e.open_at + store_padded(e.open + e.closed);
	e.edges = d->nedges;
	e.end = e.triangle_at + store_padded(e.triangle + e.edges);
	return e;
}

struct store_code store_code_of(const struct mesh_domain *d)
{
	struct store_code c = {.vertex = {WIDE, WIDE, WIDE}, .triangle = d->nvertex <= 1 << 16 ? NARROW : WIDE};
	int32_t low[3] = {INT32_MAX, INT32_MAX, INT32_MAX}, high[3] = {INT32_MIN, INT32_MIN, INT32_MIN};

	for (uint32_t i = d->nopen; i < d->nvertex; i++) {
		const int32_t at[3] = {d->vertex[i].x, d->vertex[i].y, d->vertex[i].z};

		for (unsigned k = 0; k < 3; k++) {
			low[k] = at[k] < low[k] ? at[k] : low[k];
			high[k] = at[k] > high[k] ? at[k] : high[k];
		}
	}
	for (unsigned k = 0; k < 3; k++) {
		if ((int64_t)high[k] - low[k] > UINT16_MAX || d->nopen == d->nvertex)
			continue;
		c.vertex[k] = NARROW;
		c.base[k] = low[k];
	}
	return c;
}

/* ---- the header ---- */

static void domain_pack(struct packer *p, const struct mesh_domain *d)
{
	digest_pack(p, d->digest);
	digest_pack(p, d->closed_digest);
	for (unsigned i = 0; i < 6; i++)
		packer_i32(p, d->box[i]);
	packer_u64(p, d->counts.points);
	packer_u64(p, d->counts.used);
	packer_u64(p, d->counts.halo);
	for (unsigned i = 0; i < RULES_BEFORE; i++)
		packer_u64(p, d->counts.removed[i]);
	packer_u64(p, d->counts.cells_read);
	packer_u64(p, d->counts.points_read);
}

static void domain_unpack(struct cursor *c, struct mesh_domain *d)
{
	d->digest = digest_unpack(c);
	d->closed_digest = digest_unpack(c);
	for (unsigned i = 0; i < 6; i++)
		d->box[i] = cursor_i32(c);
	d->counts.points = cursor_u64(c);
	d->counts.used = cursor_u64(c);
	d->counts.halo = cursor_u64(c);
	for (unsigned i = 0; i < RULES_BEFORE; i++)
		d->counts.removed[i] = cursor_u64(c);
	d->counts.cells_read = cursor_u64(c);
	d->counts.points_read = cursor_u64(c);
}

void store_header_pack(const struct store_front *f, const struct store_id *id, const struct store_header *h,
		       uint8_t bytes[STORE_HEADER])
{
	struct packer p = packer_of(bytes, STORE_HEADER);
	const struct mesh_domain *d = &f->domain;

	packer_u32(&p, MAGIC);
	packer_u32(&p, VERSION);
	digest_pack(&p, id->base);
	digest_pack(&p, id->list);
	digest_pack(&p, f->beside.content);
	packer_u32(&p, d->nvertex);
	packer_u32(&p, d->nopen);
	packer_u32(&p, d->ntriangle);
	packer_u32(&p, (uint32_t)f->beside.proof_size);
	domain_pack(&p, d);
	packer_u64(&p, h->sums.proof);
	packer_u64(&p, h->sums.open);
	packer_u64(&p, h->sums.rest);
	digest_pack(&p, d->own_digest);
	packer_u32(&p, d->nhull);
	for (unsigned i = 0; i < 3; i++)
		packer_u8(&p, h->code.vertex[i]);
	packer_u8(&p, h->code.triangle);
	for (unsigned i = 0; i < 3; i++)
		packer_i32(&p, h->code.base[i]);
	packer_u64(&p, d->counts.most.points);
	packer_i32(&p, d->counts.most.x);
	packer_i32(&p, d->counts.most.y);
	packer_u32(&p, d->nedges);
	for (unsigned i = RULES_BEFORE; i < MESH_RULES; i++)
		packer_u64(&p, d->counts.removed[i]);
	packer_zero(&p, STORE_HEADER - 8 - packer_size(&p));
	packer_u64(&p, XXH3_64bits(bytes, STORE_HEADER - 8));
}

static bool width(uint8_t bytes)
{
	return bytes == NARROW || bytes == WIDE;
}

static bool code_unpack(struct cursor *c, struct store_code *ret)
{
	for (unsigned i = 0; i < 3; i++)
		ret->vertex[i] = cursor_u8(c);
	ret->triangle = cursor_u8(c);
	for (unsigned i = 0; i < 3; i++)
		ret->base[i] = cursor_i32(c);
	return width(ret->vertex[0]) && width(ret->vertex[1]) && width(ret->vertex[2]) && width(ret->triangle);
}

static bool leaves_out(const struct mesh_counts *counts)
{
	uint64_t any = 0;

	for (unsigned i = 0; i < MESH_RULES; i++)
		any |= counts->removed[i];
	return any;
}

void store_sizes(struct store_front *f, const struct store_header *h)
{
	struct store_layout l = store_layout_of(&f->domain);

	f->payload = XXH3_64bits_withSeed(&h->sums.rest, sizeof h->sums.rest, h->sums.open);
	f->bytes = store_extent_of(&f->domain, &h->code, f->beside.proof_size).end;
	f->front = store_padded(f->beside.proof_size) + store_padded(l.open_end);
	f->whole = l.total;
}

enum store_header_is store_header_unpack(const uint8_t bytes[STORE_HEADER], const struct store_id *id, struct store_front *f,
					 struct store_header *h)
{
	struct cursor c = cursor_of(bytes, STORE_HEADER), last = cursor_of(bytes + STORE_HEADER - 8, 8);
	struct mesh_domain *d = &f->domain;
	uint32_t magic = cursor_u32(&c), version = cursor_u32(&c);

	if (magic == MAGIC && version < OLDEST)
		return STORE_HEADER_OLD;
	if (magic != MAGIC || cursor_u64(&last) != XXH3_64bits(bytes, STORE_HEADER - 8))
		return STORE_HEADER_DAMAGED;
	if (version > VERSION)
		return STORE_HEADER_NEWER;
	if (!digest_equal(digest_unpack(&c), id->base) || !digest_equal(digest_unpack(&c), id->list))
		return STORE_HEADER_DAMAGED;
	f->beside.content = digest_unpack(&c);
	d->nvertex = cursor_u32(&c);
	d->nopen = cursor_u32(&c);
	d->ntriangle = cursor_u32(&c);
	f->beside.proof_size = cursor_u32(&c);
	domain_unpack(&c, d);
	h->sums.proof = cursor_u64(&c);
	h->sums.open = cursor_u64(&c);
	h->sums.rest = cursor_u64(&c);
	d->own_digest = digest_unpack(&c);
	d->nhull = cursor_u32(&c);
	/* Users of a domain count with local numbers below 2^31. */
	if (d->nopen > d->nvertex || d->nvertex > INT32_MAX || d->ntriangle > INT32_MAX || (d->ntriangle && d->nvertex < 3) ||
	    f->beside.proof_size > STORE_PROOF_MOST)
		return STORE_HEADER_DAMAGED;
	if (version <= NO_MOST && leaves_out(&d->counts))
		return STORE_HEADER_OLD;
	if (version == NO_CODE)
		h->code = (struct store_code){.vertex = {WIDE, WIDE, WIDE}, .triangle = WIDE};
	else if (!code_unpack(&c, &h->code))
		return STORE_HEADER_DAMAGED;
	if (version > NO_MOST) {
		d->counts.most.points = cursor_u64(&c);
		d->counts.most.x = cursor_i32(&c);
		d->counts.most.y = cursor_i32(&c);
	}
	if (version > NO_EDGES) {
		d->nedges = cursor_u32(&c);
		for (unsigned i = RULES_BEFORE; i < MESH_RULES; i++)
			d->counts.removed[i] = cursor_u64(&c);
		if (d->nedges && d->nedges != d->ntriangle)
			return STORE_HEADER_DAMAGED;
	}
	store_sizes(f, h);
	return STORE_HEADER_GOOD;
}

/* ---- vertices ---- */

enum { GROUP = 8 /* rows of three, so that the compiler makes vectors of them */, CORNERS = 3 * GROUP };

static bool widths(const struct store_code *c, uint8_t x, uint8_t y, uint8_t z)
{
	return c->vertex[0] == x && c->vertex[1] == y && c->vertex[2] == z;
}

/* All three widths are narrow: as one array of numbers above a base. */
static void bases_of(const struct store_code *c, uint32_t base[CORNERS])
{
	for (unsigned i = 0; i < CORNERS; i++)
		base[i] = (uint32_t)c->base[i % 3];
}

static void pack_narrow(const struct store_code *c, const struct mesh_vertex *v, size_t n, uint8_t *out)
{
	uint32_t base[CORNERS], in[CORNERS];
	uint16_t some[CORNERS] = {0};

	bases_of(c, base);
	for (; n >= GROUP; n -= GROUP, v += GROUP, out += sizeof some) {
		memcpy(in, v, sizeof in);
		for (unsigned k = 0; k < CORNERS; k++)
			some[k] = (uint16_t)(in[k] - base[k]);
		memcpy(out, some, sizeof some);
	}
	memcpy(in, v, n * sizeof *v);
	for (unsigned k = 0; k < 3 * n; k++)
		some[k] = (uint16_t)(in[k] - base[k]);
	memcpy(out, some, n * 3 * sizeof *some);
}

static void unpack_narrow(const struct store_code *c, struct mesh_vertex *v, size_t n, const uint8_t *in)
{
	uint32_t base[CORNERS], out[CORNERS];
	uint16_t some[CORNERS];

	bases_of(c, base);
	for (; n >= GROUP; n -= GROUP, v += GROUP, in += sizeof some) {
		memcpy(some, in, sizeof some);
		for (unsigned k = 0; k < CORNERS; k++)
			out[k] = some[k] + base[k];
		memcpy(v, out, sizeof out);
	}
	memcpy(some, in, n * 3 * sizeof *some);
	for (unsigned k = 0; k < 3 * n; k++)
		out[k] = some[k] + base[k];
	memcpy(v, out, n * sizeof *v);
}

/* Unsigned, because numbers above a base are up to 2^32 - 1. */
static inline __attribute__((always_inline)) uint8_t *put(uint8_t *out, int32_t at, int32_t base, uint8_t width)
{
	uint32_t n = (uint32_t)at - (uint32_t)base;

	memcpy(out, &n, width == WIDE ? WIDE : NARROW);
	return out + width;
}

static inline __attribute__((always_inline)) const uint8_t *get(const uint8_t *in, int32_t *at, int32_t base, uint8_t width)
{
	uint32_t n = 0;

	memcpy(&n, in, width == WIDE ? WIDE : NARROW);
	*at = (int32_t)(n + (uint32_t)base);
	return in + width;
}

/* With widths that are constants for the compiler. */
static inline __attribute__((always_inline)) void pack_rows(const int32_t base[3], const struct mesh_vertex *v, size_t n,
							    uint8_t *out, uint8_t x, uint8_t y, uint8_t z)
{
	for (size_t i = 0; i < n; i++)
		out = put(put(put(out, v[i].x, base[0], x), v[i].y, base[1], y), v[i].z, base[2], z);
}

static inline __attribute__((always_inline)) void unpack_rows(const int32_t base[3], struct mesh_vertex *v, size_t n,
							      const uint8_t *in, uint8_t x, uint8_t y, uint8_t z)
{
	for (size_t i = 0; i < n; i++) {
		struct mesh_vertex one;

		in = get(get(get(in, &one.x, base[0], x), &one.y, base[1], y), &one.z, base[2], z);
		v[i] = one;
	}
}

size_t store_pack_vertices(const struct store_code *c, const struct mesh_vertex *v, size_t n, uint8_t *out)
{
	const int32_t base[3] = {c->base[0], c->base[1], c->base[2]};

	if (widths(c, WIDE, WIDE, WIDE))
		memcpy(out, v, n * sizeof *v);
	else if (widths(c, NARROW, NARROW, NARROW))
		pack_narrow(c, v, n, out);
	else if (widths(c, WIDE, WIDE, NARROW))
		pack_rows(base, v, n, out, WIDE, WIDE, NARROW);
	else
		pack_rows(base, v, n, out, c->vertex[0], c->vertex[1], c->vertex[2]);
	return n * store_vertex_bytes(c);
}

/* Writing ends at or before the next byte to be read: each row, or group of rows, is read before it is written. */
void store_unpack_vertices(const struct store_code *c, struct mesh_vertex *v, size_t n)
{
	const uint8_t *in = (const uint8_t *)(v + n) - n * store_vertex_bytes(c);
	const int32_t base[3] = {c->base[0], c->base[1], c->base[2]};

	if (widths(c, NARROW, NARROW, NARROW))
		unpack_narrow(c, v, n, in);
	else if (widths(c, WIDE, WIDE, NARROW))
		unpack_rows(base, v, n, in, WIDE, WIDE, NARROW);
	else if (!widths(c, WIDE, WIDE, WIDE))
		unpack_rows(base, v, n, in, c->vertex[0], c->vertex[1], c->vertex[2]);
}

/* ---- triangles ---- */

size_t store_pack_triangles(const struct store_code *c, const uint32_t (*triangle)[3], size_t n, uint8_t *out)
{
	static const struct store_code corners = {.vertex = {NARROW, NARROW, NARROW}};

	if (c->triangle == WIDE)
		memcpy(out, triangle, n * sizeof *triangle);
	else
		pack_narrow(&corners, (const struct mesh_vertex *)triangle, n, out);
	return n * store_triangle_bytes(c);
}

void store_unpack_triangles(const struct store_code *c, uint32_t (*triangle)[3], size_t n)
{
	static const struct store_code corners = {.vertex = {NARROW, NARROW, NARROW}};

	if (c->triangle == NARROW)
		store_unpack_vertices(&corners, (struct mesh_vertex *)triangle, n);
}

/* A checksum does not protect against a forged file, and later a corner is used as an index without a test. */
bool store_corners_fit(const struct store_code *c, const uint8_t *bytes, size_t n, uint32_t nvertex)
{
	const uint16_t last = nvertex && nvertex <= UINT16_MAX ? (uint16_t)(nvertex - 1) : UINT16_MAX;
	unsigned beyond = n && !nvertex;

	if (c->triangle == NARROW) {
		for (size_t i = 0; i < n; i++) {
			uint16_t corner;

			memcpy(&corner, bytes + i * sizeof corner, sizeof corner);
			beyond |= corner > last;
		}
	} else {
		for (size_t i = 0; i < n; i++) {
			uint32_t corner;

			memcpy(&corner, bytes + i * sizeof corner, sizeof corner);
			beyond |= corner >= nvertex;
		}
	}
	return !beyond;
}
