/* Requests about the disk: its use, verification, and removal of derived files. */
#include <string.h>

#include "io.h"
#include "server_priv.h"

void message_side(const struct space_side *s, Acut__V1__CacheSide *ret)
{
	acut__v1__cache_side__init(ret);
	ret->used = s->used;
	ret->has_quota = s->quota != UINT64_MAX;
	ret->quota = ret->has_quota ? s->quota : 0;
	ret->total = s->total;
	ret->free = s->free;
	ret->keep_free = s->keep_free;
}

void request_cache_stat(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	Acut__V1__CacheStat out = ACUT__V1__CACHE_STAT__INIT;
	Acut__V1__CacheKind row[SPACE_KINDS], *rows[SPACE_KINDS];
	Acut__V1__CacheSide state, cache;
	struct cache_stat st;

	cache_stat(c->server->service->maintenance, &st);
	for (int k = 0; k < SPACE_KINDS; k++) {
		acut__v1__cache_kind__init(&row[k]);
		row[k].name = (char *)space_kind_text((enum space_kind)k);
		row[k].bytes = st.space.kind[k].bytes;
		row[k].entries = st.space.kind[k].entries;
		row[k].state = space_kind_state((enum space_kind)k);
		rows[k] = &row[k];
	}
	message_side(&st.space.state, &state);
	message_side(&st.space.cache, &cache);
	out.n_kinds = SPACE_KINDS;
	out.kinds = rows;
	out.state = &state;
	out.cache = &cache;
	out.one_file_system = st.space.one_fs;
	out.disk_limit = st.disk;
	out.keep_free_limit = st.keep_free;
	out.measured = st.space.measured;
	out.evicted_bytes = st.space.evicted_bytes;
	out.evicted_entries = st.space.evicted_files;
	request_answer(q, FRAME_MESSAGE(CACHE_STAT, cache_stat, &out));
}

/* ---- verify ---- */

static void on_verify_damage(void *token, const struct cache_damage *d)
{
	struct request *q = token;
	Acut__V1__CacheDamage out = ACUT__V1__CACHE_DAMAGE__INIT;
	struct frame_error error;

	frame_error_from_err(&d->err, &error);
	out.what = (char *)d->what;
	out.dataset = (char *)d->dataset;
	out.error = &error.body;
	out.derived = d->derived;
	out.removed = d->removed;
	conn_send(q->conn, q->id, FRAME_MESSAGE(CACHE_DAMAGE, cache_damage, &out), -1);
}

static void on_verify_progress(void *token, const char *phase, uint64_t bytes, uint64_t total)
{
	request_progress(token, phase, bytes, total, "");
}

static void on_verify_over(void *token, const struct err *why, const struct cache_verified *v)
{
	struct request *q = token;
	Acut__V1__CacheVerified out = ACUT__V1__CACHE_VERIFIED__INIT;

	q->conn->verify = NULL;
	if (why) {
		request_refuse(q, why);
		return;
	}
	out.files = v->files;
	out.bytes = v->bytes;
	out.damaged = v->damaged;
	out.derived = v->derived;
	out.newer = v->newer;
	out.derived_newer = v->derived_newer;
	request_answer(q, FRAME_MESSAGE(CACHE_VERIFIED, cache_verified, &out));
}

void request_cache_verify(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	static const struct cache_verify_calls calls = {on_verify_damage, on_verify_progress, on_verify_over};
	struct err err = ERR_INIT;

	if (cache_verify(c->server->service->maintenance, &c->peer, &calls, q, &c->verify, &err))
		request_refuse(q, &err);
}

/* ---- adopt ---- */

static void on_adopt_progress(void *token, const char *phase, uint64_t bytes, uint64_t total)
{
	request_progress(token, phase, bytes, total, "");
}

static void on_adopted(void *token, const struct err *why, const struct cache_adopted *a)
{
	struct request *q = token;
	Acut__V1__CacheAdopted out = ACUT__V1__CACHE_ADOPTED__INIT;

	q->conn->adopt = NULL;
	if (why) {
		request_refuse(q, why);
		return;
	}
	out.domains = a->domains;
	out.bytes = a->bytes;
	out.there = a->there;
	out.flat = a->flat;
	request_answer(q, FRAME_MESSAGE(CACHE_ADOPTED, cache_adopted, &out));
}

void request_cache_adopt(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	static const struct cache_adopt_calls calls = {on_adopt_progress, on_adopted};
	struct err err = ERR_INIT;

	if (c->adopt)
		err_set(&err, ERR_BUSY, "the last pack of this connection is not taken yet");
	else
		cache_adopt(c->server->service->maintenance, &c->peer, fd, m->cache_adopt->name, &calls, q, &c->adopt, &err);
	if (!err.code)
		return;
	io_close(fd);
	request_refuse(q, &err);
}

/* ---- gc ---- */

static void on_freed(void *token, const struct err *why, uint64_t bytes, uint64_t entries)
{
	Acut__V1__CacheFreed out = ACUT__V1__CACHE_FREED__INIT;

	if (why) {
		request_refuse(token, why);
		return;
	}
	out.bytes = bytes;
	out.entries = entries;
	request_answer(token, FRAME_MESSAGE(CACHE_FREED, cache_freed, &out));
}

void request_cache_gc(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	cache_gc(c->server->service->maintenance, &c->peer, m->cache_gc->all, on_freed, q);
}
