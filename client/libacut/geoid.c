/* The geoid grids that the daemon keeps: add, list, remove. */
#include <stdlib.h>
#include <string.h>

#include "call.h"

static void get_geoid(const Acut__V1__Geoid *g, struct acut_geoid *ret)
{
	*ret = (struct acut_geoid){
		.name = g->name,
		.hash = g->hash,
		.description = g->description,
		.date = g->date,
		.width = g->width,
		.height = g->height,
		.uid = g->uid,
		.bytes = g->bytes,
		.min = g->min,
		.max = g->max,
		.rms_error = g->rms_error,
		.max_error = g->max_error,
	};
}

int acut_geoid_add(struct acut *a, int fd, const char *name, const char *file, const struct acut_geoid **ret)
{
	Acut__V1__GeoidAdd req = ACUT__V1__GEOID_ADD__INIT;
	char *named, *called;
	uint32_t id;
	int r = call_begin(a);

	if (r == 0)
		r = call_file(a, fd, file);
	if (r < 0)
		return r;
	named = strdup(name);
	called = strdup(file);
	if (!named || !called) {
		free(named);
		free(called);
		return err_set(&a->err, ERR_NOMEM, "there is no memory for a name");
	}
	req.name = frame_text_clean(named);
	req.file = frame_text_clean(called);
	r = call_again(a, FRAME_MESSAGE(GEOID_ADD, geoid_add, &req), fd, ACUT__V1__MESSAGE__BODY_GEOIDS, &id, &a->answer);
	free(named);
	free(called);
	if (r < 0)
		return r;
	if (a->answer->geoids->n_geoids != 1)
		return err_set(&a->err, ERR_PROTO, "the daemon's answer has no geoid grid");
	get_geoid(a->answer->geoids->geoids[0], &a->geoid);
	*ret = &a->geoid;
	return 0;
}

int acut_geoids(struct acut *a, void (*each)(void *ctx, const struct acut_geoid *), void *ctx)
{
	Acut__V1__GeoidsRequest req = ACUT__V1__GEOIDS_REQUEST__INIT;
	struct acut_geoid g;
	int r = call_ask(a, FRAME_MESSAGE(GEOIDS_REQUEST, geoids_request, &req), -1, ACUT__V1__MESSAGE__BODY_GEOIDS);

	for (size_t i = 0; r == 0 && i < a->answer->geoids->n_geoids; i++) {
		get_geoid(a->answer->geoids->geoids[i], &g);
		each(ctx, &g);
	}
	return r;
}

int acut_geoid_remove(struct acut *a, const char *name)
{
	Acut__V1__GeoidRemove req = ACUT__V1__GEOID_REMOVE__INIT;

	req.name = call_text(name);
	return call_ask(a, FRAME_MESSAGE(GEOID_REMOVE, geoid_remove, &req), -1, ACUT__V1__MESSAGE__BODY_DONE);
}
