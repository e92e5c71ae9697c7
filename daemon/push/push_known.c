/*
 * Recognises inputs that the dataset already has.
 *
 * The model: a file is known if its path, size and time of change are those of a live source, or (on request) if its content has
 * the hash of a live source, whatever its path. A file with a known path that is not known is another file of that name; it is
 * refused unless the client wants to add it or to replace the old one. A file without a path is always new. So is a pipe,
 * unless the client announces the hash of its content: then it is recognised by the hash, and checked against it.
 *
 * A known file that was read otherwise than this push would read it (push_reading.c) is refused, or treated as another file.
 * Workers call this between requests of one push, so its tables do not change meanwhile.
 */
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"
#include "rights.h"

int push_known_index(const struct grid_manifest *m, struct names *ret, struct err *err)
{
	struct names paths = {0};
	int r = 0;

	for (size_t i = 0; !r && i < m->nsources; i++)
		if (!m->sources[i].removed && *m->sources[i].path)
			r = names_put(&paths, m->sources[i].path, (uint32_t)i, err);
	if (r)
		names_free(&paths);
	else
		*ret = paths;
	return r;
}

static bool same_times(const struct grid_source *s, const struct client_file *id)
{
	return s->size == id->size && s->mtime_ns == id->mtime_ns;
}

/* By content if that was requested and is recorded, otherwise by size and time. */
static bool same_file(const struct push_request *rq, const struct grid_source *s)
{
	if (rq->checksum && !digest_is_zero(s->hash))
		return s->size == rq->id.size && digest_equal(s->hash, rq->hash);
	return same_times(s, &rq->id);
}

/* Live sources that are this file. */
struct found {
	const struct grid_source *same,
		*other; /* the first that was read as this push would read it, and the first that was not */
	bool path;      /* some source has its path */
};

static void note_found(const struct push *p, const struct push_request *rq, const struct grid_source *s, struct found *found)
{
	const struct grid_source **at = push_reading_same(p, rq, s) ? &found->same : &found->other;

	if (!*at)
		*at = s;
}

static struct found find_sources(const struct push *p, const struct grid_manifest *m, const struct names *paths,
				 const struct push_request *rq)
{
	struct found found = {NULL, NULL, false};
	size_t at = NAMES_START;
	uint32_t i;

	while (names_next(paths, rq->path, &at, &i)) {
		found.path = true;
		if (same_file(rq, &m->sources[i]))
			note_found(p, rq, &m->sources[i], &found);
	}
	for (size_t k = 0; rq->checksum && !found.same && k < m->nsources; k++) {
		const struct grid_source *s = &m->sources[k];

		if (!s->removed && !digest_is_zero(s->hash) && s->size == rq->id.size && digest_equal(s->hash, rq->hash))
			note_found(p, rq, s, &found);
	}
	return found;
}

/* The file was named before in this push. */
static bool given_before(const struct push *p, const struct push_request *rq)
{
	size_t at = NAMES_START;
	uint32_t i;

	while (names_next(&p->probe_paths, rq->path, &at, &i)) {
		const struct push_probed *other = &p->probes[i];

		if (!memcmp(&other->id, &rq->id, sizeof rq->id))
			return true;
	}
	return false;
}

static int other_content(const struct push *p, struct push_request *rq)
{
	err_set(&rq->err, ERR_INPUT, "the dataset %s has a file of this name already, %s", p->dataset->name,
		rq->checksum ? "with other content" : "of another size or time of change");
	err_add_place(&rq->err, ERR_NO_OFFSET, "name");
	return err_add_hint(&rq->err, "%s--add takes it as another source beside the old one, --replace in its place",
			    rq->checksum ? "" : "--checksum finds out whether the content is the same; ");
}

/* The file should replace another one, but is already in the dataset as a third one: it would not be added, and the other one
 * would stay. */
static int check_beside(const struct push *p, struct push_request *rq, const struct grid_source *s)
{
	const struct grid_source *target = rq->target ? &p->base->sources[rq->target - 1] : NULL;
	const struct dataset *d = p->dataset;
	/* Only the owner may see the paths of files, as in a list of files. */
	bool owner = rights_allow(&p->peer, RIGHT_OWN, d->uid, d->gid, d->mode);

	if (target ? push_replace_means(target, s) : !strcmp(s->path, rq->path))
		return 0;
	err_set(&rq->err, ERR_INPUT, "the dataset %s has this content already, as %.200s: it takes no other file's place",
		p->dataset->name, owner && *s->path ? s->path : s->name);
	err_add_place(&rq->err, ERR_NO_OFFSET, "name");
	return err_add_hint(&rq->err, "acutctl dataset revert undoes the push that brought %.200s",
			    target && owner && *target->path ? target->path :
			    target                           ? target->name :
							       rq->path);
}

static bool same_content(const struct push *p, const struct push_request *rq, const struct grid_source *s)
{
	return s->size == rq->id.size && digest_equal(s->hash, rq->hash) && push_reading_same(p, rq, s);
}

/* The file that it would replace has the same content. Then nothing changes, also if the times differ. */
static int find_unchanged(struct push *p, struct push_request *rq, const struct grid_source **ret)
{
	const struct file_hash_watch watch = push_hash_watch(p);
	const struct grid_source *all = p->base->sources;
	size_t at = NAMES_START;
	uint32_t i;
	int r = 0;

	if (!rq->checksum)
		r = file_hash(&watch, rq->fd, rq->id.size, rq->name, &rq->hash, &rq->err);
	while (!r && names_next(&p->base_paths, rq->path, &at, &i))
		if (same_content(p, rq, &all[i]))
			*ret = &all[i];
	for (size_t k = 0; !r && rq->target && k < p->base->nsources; k++)
		if (!all[k].removed && push_replace_means(&all[rq->target - 1], &all[k]) && same_content(p, rq, &all[k]))
			*ret = &all[k];
	return r;
}

/*
 * The file that rq->replaces names is absent because a file with this very content replaced it: the answer to that commit was
 * lost, and the client tries again.
 */
static int find_successor(struct push *p, struct push_request *rq, const struct grid_source **ret)
{
	const struct file_hash_watch watch = push_hash_watch(p);
	const struct grid_manifest *m = p->base;
	uint64_t removed = 0;
	int r = 0;

	*ret = NULL;
	if (!m || p->dataset->onestep || !*rq->path)
		return 0;
	for (size_t i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		if (strcmp(s->path, rq->replaces) && strcmp(s->name, rq->replaces))
			continue;
		if (!s->removed)
			return 0; /* it is still there */
		removed = s->removed > removed ? s->removed : removed;
	}
	for (size_t i = 0; removed && !r && i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		if (s->removed || s->added != removed || s->size != rq->id.size)
			continue;
		if (!rq->hash.hi && !rq->hash.lo)
			r = file_hash(&watch, rq->fd, rq->id.size, rq->name, &rq->hash, &rq->err);
		if (!r && digest_equal(s->hash, rq->hash))
			*ret = s;
	}
	return r;
}

const struct grid_source *push_known_find(const struct push *p, const struct grid_manifest *m, const struct names *paths,
					  const struct push_request *rq)
{
	const struct found found = find_sources(p, m, paths, rq);

	return found.same ? found.same : found.other;
}

int push_known(struct push *p, struct push_request *rq)
{
	const struct file_hash_watch watch = push_hash_watch(p);
	struct found found = {NULL, NULL, false};
	const struct grid_source *s = NULL;
	bool replaces = *rq->replaces;
	int r = 0;

	rq->known = PUSH_NEW;
	if (replaces)
		r = find_successor(p, rq, &s);
	if (r)
		return r;
	if (s && !push_reading_same(p, rq, s))
		return push_reading_refuse(p, rq, s);
	if (s) {
		rq->target = 0;
		rq->known = PUSH_KNOWN;
		rq->in_base = true;
		rq->in.points = s->points;
		return 0;
	}
	r = push_replace_target(p, rq);
	if (r || p->dataset->onestep || !*rq->path)
		return r;
	if (rq->checksum && !rq->announced)
		r = file_hash(&watch, rq->fd, rq->id.size, rq->name, &rq->hash, &rq->err);
	if (!r && p->base)
		found = find_sources(p, p->base, &p->base_paths, rq);
	replaces |= found.path && rq->replace;
	s = found.same;
	if (!r && replaces && (s || found.other))
		r = check_beside(p, rq, s ? s : found.other);
	if (!r && replaces && !s)
		r = find_unchanged(p, rq, &s);
	if (r)
		return r;
	if (s || given_before(p, rq)) {
		rq->known = PUSH_KNOWN;
		rq->in_base = s;
		rq->in.points = s ? s->points : 0;
		return 0;
	}
	if (found.other && !rq->add && !replaces)
		return push_reading_refuse(p, rq, found.other);
	if (found.path && !rq->add && !replaces)
		return other_content(p, rq);
	push_offers_find(p, rq);
	return 0;
}
