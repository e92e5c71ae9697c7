/*
 * Which inputs the dataset has already.
 *
 * The model: a file is the same if its path, size and time of change are those of a live source, or, where the
 * client asks for it, if its bytes have that source's hash, whatever its name. The same path with anything else
 * is another file of that name, and taken only if the client says so: beside the old one, or in its place. What has no path is
 * always new, and so is a pipe, unless the client says beforehand what its bytes will be: then it is judged by that, and held to
 * it. What was read otherwise than this push would (push_reading.c) is not what is asked for: it is refused, or taken as another
 * file is. Workers call this between the asks of one push, so its tables stand still meanwhile.
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

/* By content where that was asked for and is known, else by size and time. */
static bool same_file(const struct push_ask *a, const struct grid_source *s)
{
	if (a->checksum && !digest_is_zero(s->hash))
		return s->size == a->id.size && digest_equal(s->hash, a->hash);
	return same_times(s, &a->id);
}

/* Live sources that are this file, the first of each. */
struct found {
	const struct grid_source *same, *other; /* read as this push would, and otherwise */
	bool path;                              /* there is one of its path at least */
};

static void note(const struct push *p, const struct push_ask *a, const struct grid_source *s, struct found *found)
{
	const struct grid_source **at = push_reading_same(p, a, s) ? &found->same : &found->other;

	if (!*at)
		*at = s;
}

static struct found find(const struct push *p, const struct grid_manifest *m, const struct names *paths, const struct push_ask *a)
{
	struct found found = {NULL, NULL, false};
	size_t at = NAMES_START;
	uint32_t i;

	while (names_next(paths, a->path, &at, &i)) {
		found.path = true;
		if (same_file(a, &m->sources[i]))
			note(p, a, &m->sources[i], &found);
	}
	for (size_t k = 0; a->checksum && !found.same && k < m->nsources; k++) {
		const struct grid_source *s = &m->sources[k];

		if (!s->removed && !digest_is_zero(s->hash) && s->size == a->id.size && digest_equal(s->hash, a->hash))
			note(p, a, s, &found);
	}
	return found;
}

/* The same file twice in one push. */
static bool given_before(const struct push *p, const struct push_ask *a)
{
	size_t at = NAMES_START;
	uint32_t i;

	while (names_next(&p->probe_paths, a->path, &at, &i)) {
		const struct push_probed *other = &p->probes[i];

		if (!memcmp(&other->id, &a->id, sizeof a->id))
			return true;
	}
	return false;
}

static int other_content(const struct push *p, struct push_ask *a)
{
	err_set(&a->err, ERR_INPUT, "the dataset %s has a file of this name already, %s", p->dataset->name,
		a->checksum ? "with other content" : "of another size or time of change");
	err_add_place(&a->err, ERR_NO_OFFSET, "name");
	return err_add_hint(&a->err, "%s--add takes it as another source beside the old one, --replace in its place",
			    a->checksum ? "" : "--checksum finds out whether the content is the same; ");
}

/* What is asked for in place of a file, and is in the dataset already as another one: nothing would come, and that file
 * would stay. */
static int check_beside(const struct push *p, struct push_ask *a, const struct grid_source *s)
{
	const struct grid_source *target = a->target ? &p->base->sources[a->target - 1] : NULL;
	const struct dataset *d = p->dataset;
	/* Where others have their files is for the owner alone, as in a list of files. */
	bool owner = rights_allow(&p->peer, RIGHT_OWN, d->uid, d->gid, d->mode);

	if (target ? push_replace_means(target, s) : !strcmp(s->path, a->path))
		return 0;
	err_set(&a->err, ERR_INPUT, "the dataset %s has this content already, as %.200s: it takes no other file's place",
		p->dataset->name, owner && *s->path ? s->path : s->name);
	err_add_place(&a->err, ERR_NO_OFFSET, "name");
	return err_add_hint(&a->err, "acutctl dataset revert undoes the push that brought %.200s",
			    target && owner && *target->path ? target->path :
			    target                           ? target->name :
							       a->path);
}

static bool same_content(const struct push *p, const struct push_ask *a, const struct grid_source *s)
{
	return s->size == a->id.size && digest_equal(s->hash, a->hash) && push_reading_same(p, a, s);
}

/* What a file would replace, if it is that file already, whatever its times say: then nothing changes. */
static int find_unchanged(struct push *p, struct push_ask *a, const struct grid_source **ret)
{
	const struct grid_source *all = p->base->sources;
	size_t at = NAMES_START;
	uint32_t i;
	int r = 0;

	if (!a->checksum)
		r = push_hash(p, a->fd, a->id.size, a->name, &a->hash, &a->err);
	while (!r && names_next(&p->base_paths, a->path, &at, &i))
		if (same_content(p, a, &all[i]))
			*ret = &all[i];
	for (size_t k = 0; !r && a->target && k < p->base->nsources; k++)
		if (!all[k].removed && push_replace_means(&all[a->target - 1], &all[k]) && same_content(p, a, &all[k]))
			*ret = &all[k];
	return r;
}

/*
 * The file that a->replaces names is gone, because one of this very content took its place: the answer to that commit was lost,
 * and the client says it once more.
 */
static int find_successor(struct push *p, struct push_ask *a, const struct grid_source **ret)
{
	const struct grid_manifest *m = p->base;
	uint64_t gone = 0;
	int r = 0;

	*ret = NULL;
	if (!m || p->dataset->onestep || !*a->path)
		return 0;
	for (size_t i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		if (strcmp(s->path, a->replaces) && strcmp(s->name, a->replaces))
			continue;
		if (!s->removed)
			return 0; /* it is there: no question */
		gone = s->removed > gone ? s->removed : gone;
	}
	for (size_t i = 0; gone && !r && i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		if (s->removed || s->added != gone || s->size != a->id.size)
			continue;
		if (!a->hash.hi && !a->hash.lo)
			r = push_hash(p, a->fd, a->id.size, a->name, &a->hash, &a->err);
		if (!r && digest_equal(s->hash, a->hash))
			*ret = s;
	}
	return r;
}

/* It lies there from the interrupted push. */
static void adopt(struct push *p, struct push_ask *a)
{
	const struct found found = find(p, p->adopt, &p->adopt_paths, a);
	const struct grid_source *s = found.same ? found.same : found.other;

	if (!s)
		return;
	a->adopted = (size_t)(s - p->adopt->sources);
	a->known = p->adopt_taken[a->adopted] ? PUSH_KNOWN : PUSH_ADOPTED;
	a->in.points = s->points;
}

int push_known(struct push *p, struct push_ask *a)
{
	struct found found = {NULL, NULL, false};
	const struct grid_source *s = NULL;
	bool replaces = *a->replaces;
	int r = 0;

	a->known = PUSH_NEW;
	if (replaces)
		r = find_successor(p, a, &s);
	if (r)
		return r;
	if (s && !push_reading_same(p, a, s))
		return push_reading_refuse(p, a, s);
	if (s) {
		a->target = 0;
		a->known = PUSH_KNOWN;
		a->in.points = s->points;
		return 0;
	}
	r = push_replace_target(p, a);
	if (r || p->dataset->onestep || !*a->path)
		return r;
	if (a->checksum && !a->told)
		r = push_hash(p, a->fd, a->id.size, a->name, &a->hash, &a->err);
	if (!r && p->base)
		found = find(p, p->base, &p->base_paths, a);
	replaces |= found.path && a->replace;
	s = found.same;
	if (!r && replaces && (s || found.other))
		r = check_beside(p, a, s ? s : found.other);
	if (!r && replaces && !s)
		r = find_unchanged(p, a, &s);
	if (r)
		return r;
	if (s || given_before(p, a)) {
		a->known = PUSH_KNOWN;
		a->in.points = s ? s->points : 0;
		return 0;
	}
	if (found.other && !a->add && !replaces)
		return push_reading_refuse(p, a, found.other);
	if (found.path && !a->add && !replaces)
		return other_content(p, a);
	if (p->adopt && push_same_reading(p, a))
		adopt(p, a);
	return 0;
}
