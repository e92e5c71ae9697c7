/* What a task of the phase mesh reports: sums over its domains, as values of its record. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "mesh_priv.h"

static void counts_add(struct mesh_counts *sum, const struct mesh_counts *c)
{
	sum->points += c->points;
	for (unsigned i = 0; i < MESH_RULES; i++)
		sum->removed[i] += c->removed[i];
	sum->used += c->used;
	mesh_most_add(&sum->most, c->most.points, c->most.x, c->most.y);
	sum->halo += c->halo;
	sum->cells_read += c->cells_read;
	sum->points_read += c->points_read;
}

void sums_add_domain(struct mesh_sums *s, const struct mesh_domain *d)
{
	s->domains++;
	s->vertices += d->counts.used;
	s->triangles += d->ntriangle;
	s->hull += d->nhull;
	counts_add(&s->counts, &d->counts);
	digest_add(&s->digest, d->digest);
	digest_add(&s->vertex_digest, d->own_digest);
}

void mesh_sums_add(struct mesh_sums *s, const struct mesh_sums *of)
{
	s->domains += of->domains;
	s->vertices += of->vertices;
	s->triangles += of->triangles;
	s->hull += of->hull;
	s->bytes += of->bytes;
	counts_add(&s->counts, &of->counts);
	digest_add(&s->digest, of->digest);
	digest_add(&s->vertex_digest, of->vertex_digest);
}

/* ---- records ---- */

/* The numbers of a record, with their keys; `removed-N` and the texts are apart. */
struct number {
	const char *key;
	uint64_t *value;
};
enum { NUMBERS = 11 };

static void numbers_of(struct mesh_sums *s, struct number ret[NUMBERS])
{
	const struct number of[NUMBERS] = {{"domains", &s->domains},
					   {"vertices", &s->vertices},
					   {"triangles", &s->triangles},
					   {"hull", &s->hull},
					   {"bytes", &s->bytes},
					   {"points", &s->counts.points},
					   {"used", &s->counts.used},
					   {"halo", &s->counts.halo},
					   {"cells_read", &s->counts.cells_read},
					   {"points_read", &s->counts.points_read},
					   {"most", &s->counts.most.points}};

	memcpy(ret, of, sizeof of);
}

int mesh_sums_record(struct work_attempt *a, const struct mesh_sums *sums, struct err *err)
{
	struct mesh_sums s = *sums;
	struct number number[NUMBERS];
	char text[DIGEST_HEX_SIZE];
	int r = 0;

	numbers_of(&s, number);
	for (unsigned i = 0; !r && i < NUMBERS; i++)
		r = work_result_u64(a, number[i].key, *number[i].value, err);
	for (unsigned i = 0; !r && i < MESH_RULES; i++) {
		char key[24];

		snprintf(key, sizeof key, "removed-%u", i);
		if (s.counts.removed[i])
			r = work_result_u64(a, key, s.counts.removed[i], err);
	}
	snprintf(text, sizeof text, "%" PRId32 " %" PRId32, s.counts.most.x, s.counts.most.y);
	if (!r && s.counts.most.points)
		r = work_result(a, "most_at", text, err);
	if (!r)
		r = work_result(a, "digest", digest_hex(s.digest, text), err);
	return r ? r : work_result(a, "vertex_digest", digest_hex(s.vertex_digest, text), err);
}

static bool texts_read(const struct work_record *record, struct mesh_sums *s)
{
	const char *digest = work_record_text(record, "digest"), *vertex = work_record_text(record, "vertex_digest"),
		   *at = work_record_text(record, "most_at");

	return digest && digest_parse(digest, &s->digest) && vertex && digest_parse(vertex, &s->vertex_digest) &&
	       (!s->counts.most.points || (at && sscanf(at, "%" SCNd32 " %" SCNd32, &s->counts.most.x, &s->counts.most.y) == 2));
}

int mesh_sums_read(const struct work_record *record, struct mesh_sums *ret, struct err *err)
{
	struct mesh_sums s = {0};
	struct number number[NUMBERS];
	int r = 0;

	numbers_of(&s, number);
	for (unsigned i = 0; !r && i < NUMBERS; i++)
		r = work_record_u64(record, number[i].key, number[i].value, err);
	for (unsigned i = 0; !r && i < MESH_RULES; i++) {
		char key[24];

		snprintf(key, sizeof key, "removed-%u", i);
		if (work_record_text(record, key))
			r = work_record_u64(record, key, &s.counts.removed[i], err);
	}
	if (!r && !texts_read(record, &s))
		r = err_set(err, ERR_CORRUPT, "the record of %s %" PRIu32 " has no digests", work_phase_text(record->phase),
			    record->task);
	if (!r)
		*ret = s;
	return r;
}

int mesh_task_about(const struct work *w, uint32_t task, struct mesh_task *ret, struct err *err)
{
	struct work_record *record = NULL;
	int r = work_record_need(w, WORK_MESH, task, &record, err);

	if (r)
		return r;
	mesh_extent_begin(&ret->extent);
	ret->pack[0] = 0;
	ret->bytes = 0;
	r = mesh_sums_read(record, &ret->sums, err);
	if (!r && record->nfile) {
		snprintf(ret->pack, WORK_NAME, "%s", record->file[0].name);
		ret->bytes = record->file[0].size;
		r = extent_read(record, &ret->sums, &ret->extent, err);
	}
	work_record_free(record);
	return r;
}
