/* The daemon's disk: its use, whether it is sound, and removing what can be made again. */
#include <stdlib.h>

#include "call.h"

void call_side(const Acut__V1__CacheSide *s, struct acut_side *ret)
{
	*ret = (struct acut_side){.known = s != NULL};
	if (!s)
		return;
	ret->has_quota = s->has_quota;
	ret->used = s->used;
	ret->quota = s->quota;
	ret->total = s->total;
	ret->free = s->free;
	ret->keep_free = s->keep_free;
}

int acut_cache_stat(struct acut *a, const struct acut_cache_stat **ret)
{
	Acut__V1__CacheStatRequest req = ACUT__V1__CACHE_STAT_REQUEST__INIT;
	const Acut__V1__CacheStat *s;
	struct acut_cache_kind *rows;
	int r = call_ask(a, FRAME_MESSAGE(CACHE_STAT_REQUEST, cache_stat_request, &req), -1, ACUT__V1__MESSAGE__BODY_CACHE_STAT);

	if (r < 0)
		return r;
	s = a->answer->cache_stat;
	a->rows = rows = calloc(s->n_kinds + 1, sizeof *rows);
	if (!rows)
		return err_set(&a->err, ERR_NOMEM, "there is no memory for an answer");
	for (size_t i = 0; i < s->n_kinds; i++)
		rows[i] =
			(struct acut_cache_kind){s->kinds[i]->name, s->kinds[i]->bytes, s->kinds[i]->entries, s->kinds[i]->state};
	a->cache = (struct acut_cache_stat){
		.kinds = rows,
		.nkinds = s->n_kinds,
		.one_file_system = s->one_file_system,
		.measured = s->measured,
		.disk_limit = s->disk_limit,
		.keep_free_limit = s->keep_free_limit,
		.evicted_bytes = s->evicted_bytes,
		.evicted_entries = s->evicted_entries,
	};
	call_side(s->state, &a->cache.state);
	call_side(s->cache, &a->cache.cache);
	*ret = &a->cache;
	return 0;
}

static void tell_damage(const Acut__V1__CacheDamage *d, void (*damage)(void *ctx, const struct acut_cache_damage *), void *ctx)
{
	Acut__V1__Error none = ACUT__V1__ERROR__INIT;
	struct acut_cache_damage out = {.what = d->what, .dataset = d->dataset, .derived = d->derived, .removed = d->removed};

	call_wire_failure(d->error ? d->error : &none, &out.error);
	damage(ctx, &out);
}

int acut_cache_verify(struct acut *a, void (*damage)(void *ctx, const struct acut_cache_damage *), acut_progress_fn progress,
		      void *ctx, struct acut_cache_verified *ret)
{
	Acut__V1__CacheVerify req = ACUT__V1__CACHE_VERIFY__INIT;
	uint32_t id;
	int r = call_begin(a);

	if (r == 0)
		r = call_send(a, FRAME_MESSAGE(CACHE_VERIFY, cache_verify, &req), -1, &id);
	a->progress = progress;
	a->progress_ctx = ctx;
	while (r == 0) {
		a->answer = frame_message_free(a->answer);
		r = call_next(a, id, &a->answer, NULL);
		if (r < 0)
			break;
		if (a->answer->body_case == ACUT__V1__MESSAGE__BODY_CACHE_DAMAGE) {
			tell_damage(a->answer->cache_damage, damage, ctx);
			continue;
		}
		if (a->answer->body_case != ACUT__V1__MESSAGE__BODY_CACHE_VERIFIED) {
			r = call_unexpected(a, a->answer);
			break;
		}
		*ret = (struct acut_cache_verified){
			.files = a->answer->cache_verified->files,
			.bytes = a->answer->cache_verified->bytes,
			.damaged = a->answer->cache_verified->damaged,
			.derived = a->answer->cache_verified->derived,
			.newer = a->answer->cache_verified->newer,
			.derived_newer = a->answer->cache_verified->derived_newer,
		};
		break;
	}
	a->progress = NULL;
	return r;
}

int acut_cache_gc(struct acut *a, bool all, uint64_t *ret_bytes, uint64_t *ret_entries)
{
	Acut__V1__CacheGc req = ACUT__V1__CACHE_GC__INIT;
	int r;

	req.all = all;
	r = call_ask(a, FRAME_MESSAGE(CACHE_GC, cache_gc, &req), -1, ACUT__V1__MESSAGE__BODY_CACHE_FREED);
	if (r < 0)
		return r;
	*ret_bytes = a->answer->cache_freed->bytes;
	*ret_entries = a->answer->cache_freed->entries;
	return 0;
}

int acut_cache_adopt(struct acut *a, int (*next)(void *ctx, const char **ret_name, int *ret_fd), acut_progress_fn progress,
		     void *ctx, struct acut_cache_adopted *ret)
{
	Acut__V1__CacheAdopt req = ACUT__V1__CACHE_ADOPT__INIT;
	const Acut__V1__CacheAdopted *got;
	const char *name = NULL;
	int fd, r = call_begin(a);

	*ret = (struct acut_cache_adopted){.packs = 0};
	a->progress = progress;
	a->progress_ctx = ctx;
	while (r == 0 && (r = next(ctx, &name, &fd)) == 0 && name) {
		Acut__V1__Message *m = NULL;
		uint32_t id;

		r = call_file(a, fd, name);
		req.name = (char *)name;
		if (r == 0)
			r = call_again(a, FRAME_MESSAGE(CACHE_ADOPT, cache_adopt, &req), fd,
				       ACUT__V1__MESSAGE__BODY_CACHE_ADOPTED, &id, &m);
		if (r < 0)
			break;
		got = m->cache_adopted;
		ret->packs++;
		ret->domains += got->domains;
		ret->bytes += got->bytes;
		ret->there += got->there;
		ret->flat += got->flat;
		frame_message_free(m);
		name = NULL;
	}
	a->progress = NULL;
	return r;
}
