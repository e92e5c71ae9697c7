/* Lines of a dataset: what became of them, where they cross, and where their heights differ. */
#include "call.h"

void call_line_set(const Acut__V1__LineSet *m, struct acut_line_set *ret)
{
	*ret = (struct acut_line_set){.lines = m->lines,
				      .vertices = m->vertices,
				      .positions = m->positions,
				      .pieces = m->pieces,
				      .crossings = m->crossings,
				      .uneven = m->uneven,
				      .widest = m->widest,
				      .widest_at = {m->widest_x, m->widest_y},
				      .left_out = m->left_out,
				      .doubled = m->doubled,
				      .points = m->points};
	for (size_t i = 0; i < m->n_features && i < 4; i++)
		ret->features[i] = m->features[i];
}

struct places {
	Acut__V1__PlacesRequest req;
	void (*each)(void *ctx, const struct acut_line_place *);
	void *ctx;
};

static bool places_next(void *ctx, const Acut__V1__Message *page)
{
	struct places *l = ctx;

	l->req.after += page->places->n_places;
	return page->places->n_places && l->req.after < page->places->total;
}

static int places_rows(void *ctx, const Acut__V1__Message *page)
{
	const struct places *l = ctx;

	for (size_t i = 0; i < page->places->n_places; i++) {
		const Acut__V1__Place *p = page->places->places[i];
		const struct acut_line_place place = {
			.kind = p->kind, .x = p->x, .y = p->y, .lower = p->lower, .upper = p->upper};

		l->each(l->ctx, &place);
	}
	return 0;
}

int acut_line_places(struct acut *a, const char *dataset, uint64_t generation,
		     void (*each)(void *ctx, const struct acut_line_place *), void *ctx)
{
	struct places l = {.req = ACUT__V1__PLACES_REQUEST__INIT, .each = each, .ctx = ctx};
	int r = call_begin(a);

	if (r < 0)
		return r;
	l.req.dataset = call_text(dataset);
	l.req.generation = generation;
	return call_list(a, &(struct call_list){.req = FRAME_MESSAGE(PLACES_REQUEST, places_request, &l.req),
						.want = ACUT__V1__MESSAGE__BODY_PLACES,
						.ctx = &l,
						.next = places_next,
						.rows = places_rows});
}
