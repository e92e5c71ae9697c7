/* Requests about geoid grids. The `struct request` is the token of the call, whose answer comes once. */
#include "io.h"
#include "server_priv.h"

enum { LIST_MAX = 64 };

static void on_list(void *token, const struct err *why, const struct geoid_info *list, size_t n)
{
	Acut__V1__Geoids m = ACUT__V1__GEOIDS__INIT;
	Acut__V1__Geoid row[LIST_MAX], *rows[LIST_MAX];

	if (why) {
		request_refuse(token, why);
		return;
	}
	for (size_t i = 0; i < n && i < LIST_MAX; i++) {
		const struct geoid_info *g = &list[i];

		acut__v1__geoid__init(&row[i]);
		row[i].name = (char *)g->name;
		row[i].hash = (char *)g->hash;
		row[i].description = (char *)g->grid.description;
		row[i].date = (char *)g->grid.date;
		row[i].width = g->grid.width;
		row[i].height = g->grid.height;
		row[i].bytes = g->grid.bytes;
		row[i].min = g->grid.min;
		row[i].max = g->grid.max;
		row[i].rms_error = g->grid.rms_error;
		row[i].max_error = g->grid.max_error;
		row[i].uid = g->uid;
		rows[i] = &row[i];
		m.n_geoids = i + 1;
	}
	m.geoids = rows;
	request_answer(token, FRAME_MESSAGE(GEOIDS, geoids, &m));
}

static void on_removed(void *token, const struct err *why, const struct geoid_info *list, size_t n)
{
	request_finish(token, why);
}

void request_geoid_add(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	geoid_add(c->server->service->geoids, fd, m->geoid_add->name, m->geoid_add->file, &c->peer, on_list, q);
}

void request_geoids(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	geoid_list(c->server->service->geoids, &c->peer, on_list, q);
}

void request_geoid_remove(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	geoid_remove(c->server->service->geoids, m->geoid_remove->name, &c->peer, on_removed, q);
}
