/*
 * The table of a push: an entry for each file from its probe to the commit.
 *
 * The model: an entry has some hundred bytes and is found by name and by path. Coordinate systems, which most files of a survey
 * share, are stored once each. A small part of the table is free; the rest is charged in steps. A push with more files than the
 * memory can ever hold is refused before it takes memory from others. If there is no memory now, the push waits, as for its
 * stage.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"

enum { TABLE_FREE = 4096, TABLE_STEP = 64 << 10, SOURCE_FILE_BYTES = 80 };

/* No run will release memory. Of the pushes that wait for it, the youngest is refused, which helps the others. */
bool push_must_refuse(const struct push *p)
{
	bool younger = true; /* the list has the youngest first */

	if (admission_tally(p->pushes->admission, 0).runs)
		return false;
	for (const struct push *q = p->pushes->first; q; q = q->next) {
		if (q == p)
			younger = false;
		else if (q->waits_memory ? younger : q->stage_bytes || (q->table_bytes && !push_wants_stage(q)))
			return false;
	}
	return true;
}

static int too_many(const struct push *p, struct err *err)
{
	err_set(err, ERR_LIMIT, "a push of more than %zu files does not fit into this memory", p->nprobes);
	return err_add_hint(err, "push them in several parts, or give acutd --memory %lluM for twice as many",
			    (unsigned long long)(ledger_total(p->pushes->core->p.ledger) >> 19));
}

/* The tables of this user's pushes. None of them waits for another one, so more is refused. */
static int check_share(const struct push *p, uint64_t step, struct err *err)
{
	uint64_t bytes = step;

	for (const struct push *q = p->pushes->first; q; q = q->next)
		bytes += q->peer.uid == p->peer.uid ? q->table_bytes : 0;
	return admission_user_check_size(p->pushes->admission, &p->owner, bytes, "what is kept of so many files", err);
}

int push_table_reserve(struct push *p, uint64_t bytes, struct err *err)
{
	struct pushes *pushes = p->pushes;
	uint64_t used = p->table_used + bytes, left, head, step;

	THREAD_LOOP_ONLY();
	if (used <= p->table_bytes + TABLE_FREE) {
		p->table_used = used;
		return 0;
	}
	step = (used - p->table_bytes + TABLE_STEP - 1) / TABLE_STEP * TABLE_STEP;
	if (check_share(p, step, err))
		return -(int)err->code;
	left = admission_domain_memory(pushes->admission);
	/* A job that runs or comes must be able to finish beside it, one domain at a time, and the push must still get its stage.
	 * So pushes with tables never wait only for each other. */
	head = admission_domain_largest(pushes->admission);
	head = head > admission_plan_min() ? head : admission_plan_min();
	head += p->stage_bytes ? 0 : GRID_STAGE_MIN + push_read_bytes(p);
	if (left >= head + step && ledger_take(pushes->core->p.ledger, LEDGER_FILES, step)) {
		p->table_bytes += step;
		p->table_used = used;
		return 0;
	}
	if (p->table_bytes + step > ledger_total(pushes->core->p.ledger) / 2)
		return too_many(p, err);
	/* A push with a stage does not wait: others may wait for that stage. */
	if (!p->stage_bytes && !push_must_refuse(p))
		return PUSH_WAIT;
	if (!admission_tally(pushes->admission, 0).runs && admission_staged_bytes(pushes->admission) == push_staged_bytes(p))
		return too_many(p, err);
	err_set(err, ERR_BUSY, "there is no memory now to keep track of %zu files", p->nprobes + 1);
	return err_add_hint(err, "push again when other jobs are done, or give acutd more memory");
}

void push_table_release(struct push *p)
{
	if (p->table_bytes)
		sched_give(p->pushes->core->p.sched, LEDGER_FILES, p->table_bytes);
	p->table_bytes = p->table_used = 0;
}

size_t push_read_bytes(const struct push *p)
{
	size_t most = 0;

	for (size_t i = 0; i < p->nprobes; i++)
		if (p->probes[i].read_bytes > most)
			most = p->probes[i].read_bytes;
	/* a part is read by an input of its own, beside the file's */
	return pipe_ingest_bytes() + input_bytes() + most;
}

struct push_probed *push_find_probe(const struct push *p, const char *name)
{
	size_t at = NAMES_START;
	uint32_t i;

	return names_next(&p->probe_names, name, &at, &i) ? &p->probes[i] : NULL;
}

/* Found by its content, because each file may have one of its own. */
static const struct crs_info *find_crs(const struct push *p, const struct crs_info *crs, char ret_key[DIGEST_HEX_SIZE])
{
	size_t at = NAMES_START;
	uint32_t i;

	digest_hex(digest_hash(crs, sizeof *crs), ret_key);
	while (names_next(&p->crs_keys, ret_key, &at, &i))
		if (!memcmp(&p->crs_seen[i]->crs, crs, sizeof *crs))
			return &p->crs_seen[i]->crs;
	return NULL;
}

const struct crs_info *push_keep_crs(struct push *p, const struct crs_info *crs)
{
	char key[DIGEST_HEX_SIZE];
	const struct crs_info *known = find_crs(p, crs, key);
	struct push_crs **more, *c;
	struct err ignored = ERR_INIT;

	if (known)
		return known;
	more = realloc(p->crs_seen, (p->ncrs + 1) * sizeof *more);
	if (!more)
		return NULL;
	p->crs_seen = more;
	c = calloc(1, sizeof *c);
	if (!c)
		return NULL;
	memcpy(&c->crs, crs, sizeof *crs);
	memcpy(c->key, key, sizeof key);
	if (names_put(&p->crs_keys, c->key, (uint32_t)p->ncrs, &ignored)) {
		free(c);
		return NULL;
	}
	more[p->ncrs++] = c;
	return &c->crs;
}

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory to remember a file");
}

/* A new entry; name and path share an allocation. */
static int table_add(struct push *p, const char *name, const char *path, struct push_probed **ret, struct err *err)
{
	size_t n = strlen(name) + 1, m = strlen(path) + 1;
	struct push_probed *at;
	/* The entry, what the commit makes of it (tables, a manifest written and read), and its places in tables of names. */
	uint64_t bytes =
		sizeof *at + 3 * sizeof(struct grid_source) + 3 * (SOURCE_FILE_BYTES + n + m) + 8 * sizeof(struct name_slot);
	int r = push_table_reserve(p, bytes, err);

	if (r)
		return r;
	if ((p->nprobes & (p->nprobes - 1)) == 0) {
		size_t cap = p->nprobes ? p->nprobes * 2 : 1;

		at = realloc(p->probes, cap * sizeof *at);
		if (!at)
			return no_memory(err);
		p->probes = at;
	}
	at = &p->probes[p->nprobes];
	memset(at, 0, sizeof *at);
	at->name = malloc(n + m);
	if (!at->name)
		return no_memory(err);
	memcpy(at->name, name, n);
	at->path = memcpy(at->name + n, path, m);
	r = names_put(&p->probe_names, at->name, (uint32_t)p->nprobes, err);
	if (!r && *path)
		r = names_put(&p->probe_paths, at->path, (uint32_t)p->nprobes, err);
	/* It stays even if it is incomplete, because tables refer to it. */
	p->nprobes++;
	*ret = at;
	return r;
}

/* One of push.texts, which live as long as the push. NULL: no memory. */
static const char *share_text(struct push *p, const char *text)
{
	struct err ignored = ERR_INIT;
	size_t at = NAMES_START;
	char **more, *copy;
	uint32_t i;

	if (names_next(&p->text_keys, text, &at, &i))
		return p->texts[i];
	more = realloc(p->texts, (p->ntexts + 1) * sizeof *more);
	if (!more)
		return NULL;
	p->texts = more;
	copy = strdup(text);
	if (!copy || names_put(&p->text_keys, copy, (uint32_t)p->ntexts, &ignored)) {
		free(copy);
		return NULL;
	}
	return p->texts[p->ntexts++] = copy;
}

/* Keeps a text for the manifest in *at. */
static int keep_text(struct push *p, const char *text, const char **at, struct err *err)
{
	const char *kept;
	int r;

	if (*at && !strcmp(*at, text))
		return 0;
	/* As often as a path: kept here, and in what the commit writes and reads. */
	r = push_table_reserve(p, 4 * (strlen(text) + 1), err);
	if (r)
		return r;
	kept = share_text(p, text);
	if (!kept)
		return no_memory(err);
	*at = kept;
	return 0;
}

/* Many files have the same one: it is charged once, as it is kept. */
static int keep_wkt(struct push *p, const char *wkt, const char **at, struct err *err)
{
	size_t slot = NAMES_START;
	uint32_t i;
	int r = !wkt || names_next(&p->text_keys, wkt, &slot, &i) ? 0 : push_table_reserve(p, 4 * (strlen(wkt) + 1), err);

	if (!r && !(*at = wkt ? share_text(p, wkt) : NULL) && wkt)
		r = no_memory(err);
	return r;
}

int push_remember_probe(struct push *p, const struct push_request *rq, struct err *err)
{
	struct push_probed *at = push_find_probe(p, rq->name);
	char key[DIGEST_HEX_SIZE], reading[GRID_SOURCE_READING];
	const struct crs_info *crs = find_crs(p, &rq->info.crs, key);
	int r = 0;

	/* Each system but the first, and what it becomes in the dataset. */
	if (!crs && p->ncrs)
		r = push_table_reserve(p, 2 * (sizeof(struct push_crs) + sizeof crs + 4 * sizeof(struct name_slot)), err);
	if (!r && !crs)
		crs = push_keep_crs(p, &rq->info.crs);
	if (!r && !at)
		r = table_add(p, rq->name, rq->path, &at, err);
	if (!r)
		r = keep_wkt(p, rq->wkt, &at->wkt, err);
	if (r)
		return r;
	if (!crs)
		return no_memory(err);
	if (strcmp(at->path, rq->path)) {
		err_set(err, ERR_INPUT, "another file of this push has the same name in UTF-8");
		err_add_place(err, ERR_NO_OFFSET, "name");
		err_add_hint(err, "bytes that are not UTF-8 count as '?' in names: rename one of them, or push it alone");
		return err_add_file(err, at->name);
	}
	agree_how_read(&p->agree, rq->info.format, rq->columns, rq->decimal_comma, &rq->info.crs, reading, sizeof reading);
	r = keep_text(p, rq->overridden, &at->overridden, err);
	if (!r)
		r = keep_text(p, reading, &at->reading, err);
	if (r)
		return r;
	at->id = rq->id;
	at->in.coords = rq->info.coords;
	at->in.coords.name = at->in.name = at->name;
	at->in.lines = rq->info.lines.are;
	at->in.crs = crs;
	at->in.plane = NULL;
	at->in.on_plane = false;
	at->read_bytes = rq->info.read_bytes;
	at->replace = rq->replace;
	at->target = rq->target;
	at->claimed = rq->info.claimed;
	if (rq->info.most && at->claimed > rq->info.most)
		at->claimed = rq->info.most;
	return 0;
}

/* An error about the file, with its texts one after the other. */
struct push_excluded {
	enum err_code code;
	int sys, src_line;
	uint64_t need, offset;
	const char *src_file;
	char text[]; /* message, field, hint */
};

static char *put_text(char *at, const char *text)
{
	return stpcpy(at, text) + 1;
}

int push_exclude(struct push_probed *probe, const struct err *why)
{
	/* The file becomes no source, so there is room for its error. */
	const size_t room = 3 * (sizeof(struct grid_source) + SOURCE_FILE_BYTES);
	size_t bytes = sizeof *probe->excluded + strlen(why->message) + strlen(why->field) + 3;
	const char *hint = bytes + strlen(why->hint) <= room ? why->hint : "";
	struct push_excluded *w = malloc(bytes + strlen(hint));

	if (!w)
		return -ERR_NOMEM;
	*w = (struct push_excluded){.code = why->code,
				    .sys = why->sys,
				    .src_line = why->src_line,
				    .need = why->need,
				    .offset = why->offset,
				    .src_file = why->src_file};
	put_text(put_text(put_text(w->text, why->message), why->field), hint);
	probe->excluded = w;
	return 0;
}

void push_exclusion(const struct push_probed *probe, struct err *ret)
{
	const struct push_excluded *w = probe->excluded;
	const char *field = w->text + strlen(w->text) + 1, *hint = field + strlen(field) + 1;

	*ret = (struct err){.code = w->code,
			    .sys = w->sys,
			    .src_line = w->src_line,
			    .need = w->need,
			    .offset = w->offset,
			    .src_file = w->src_file};
	snprintf(ret->message, sizeof ret->message, "%s", w->text);
	snprintf(ret->field, sizeof ret->field, "%s", field);
	snprintf(ret->hint, sizeof ret->hint, "%s", hint);
	err_add_file(ret, probe->name);
}

void push_forget_probes(struct push *p)
{
	for (size_t i = 0; i < p->nprobes; i++) {
		free(p->probes[i].name);
		free(p->probes[i].excluded);
	}
	free(p->probes);
	for (size_t i = 0; i < p->ntexts; i++)
		free(p->texts[i]);
	free(p->texts);
	for (size_t i = 0; i < p->ncrs; i++)
		free(p->crs_seen[i]);
	free(p->crs_seen);
	names_free(&p->probe_names);
	names_free(&p->probe_paths);
	p->probes = NULL;
	names_free(&p->text_keys);
	p->texts = NULL;
	p->ntexts = 0;
	names_free(&p->crs_keys);
	p->crs_seen = NULL;
	p->nprobes = p->ncrs = 0;
}
