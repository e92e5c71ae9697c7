/*
 * Imports: a dataset that was exported, here or elsewhere, becomes a dataset of this daemon.
 *
 * The model: an import is a push whose segments and line sets are finished already. It has a row among the catalogue's pushes, so
 * that a crash leaves nothing behind. Its dataset has no generation until the commit. The manifest comes first. It is trusted
 * only after all segments that it names have come, agree with it, and have been checked block by block. The files get new names,
 * which no push of this daemon ever has, so a new manifest with these names is written. Files of lines have theirs by the numbers
 * of their sources, which stay. Generations and their times are those of the export. Line sets, with the segments of their
 * vertices, are not taken: they follow from the files of lines, and nothing else proves what they say. The first mesh makes them
 * (dataset_asked.c).
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "breaklines.h"
#include "clock.h"
#include "grid_verify.h"
#include "io.h"
#include "log.h"
#include "copy_priv.h"
#include "space.h"

enum { COPY = 256 << 10, NAME = 64 };

struct import {
	struct sched_task task;
	struct copies *copies;
	uint64_t id, push;
	struct dataset *dataset;
	struct peer peer;
	struct sched_owner owner;
	bool opened, busy, ended, committed;
	bool row;                       /* the catalogue has a row of it */
	bool telling;                   /* a callback is being called, which may end the import */
	struct grid_manifest *m, *made; /* as it came; as it is written here */
	struct dataset_next becomes;
	size_t nfiles;
	bool *have; /* for each file that the manifest names */
	char name[NAME], made_name[NAME], sources_name[NAME];
	int fd;
	uint64_t taken; /* space on the disk */
	int r;
	struct err err;
	void (*begun)(void *token, const struct err *why, struct import *);
	void (*filed)(void *token, const struct err *why);
	void (*done)(void *token, const struct err *why, const struct imported *);
	void *token;
};

uint64_t import_id(const struct import *i)
{
	return i->id;
}

static void submit(struct import *i, void (*run)(struct sched_task *), void (*done)(struct sched_task *), uint64_t bytes)
{
	i->task = (struct sched_task){.run = run,
				      .done = done,
				      .owner = i->owner,
				      .priority = SCHED_NORMAL,
				      .lengthy = true,
				      .reads = bytes > 0,
				      .name = LEDGER_INPUT,
				      .bytes = bytes};
	i->busy = true;
	i->r = 0;
	i->err = ERR_INIT;
	sched_submit(i->copies->core->p.sched, &i->task);
}

/* Frees the import. Without a commit, its files are removed with the dataset, which has no generation. If a push keeps the
 * dataset, the row stays: the next start then removes the files. */
static void import_free(struct import *i)
{
	struct err err = ERR_INIT;

	if (i->opened)
		dataset_close(i->dataset);
	space_give(i->copies->core->space, SPACE_PENDING, i->taken);
	limit_disk_give(i->copies->core, i->peer.uid, i->taken);
	if (i->row && !i->committed && i->dataset->users == 1 &&
	    catalogue_drop_push(i->copies->core->p.catalogue, i->push, NULL, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
	dataset_push_end(i->dataset);
	core_background_done(i->copies->core);
	dataset_release(i->dataset);
	grid_manifest_free(i->m);
	grid_manifest_free(i->made);
	dataset_next_clear(&i->becomes);
	uncharge(i->copies->core, sizeof *i);
	io_close(i->fd);
	free(i->have);
	free(i);
}

void import_end(struct import *i)
{
	i->ended = true;
	if (i->telling)
		return;
	if (i->busy)
		sched_cancel(i->copies->core->p.sched, &i->task);
	else
		import_free(i);
}

/* True, with the error: a request that comes too early or too late. */
static bool refuse(const struct import *i, struct err *err)
{
	if (i->busy || i->ended)
		err_set(err, ERR_USAGE, "the last request for this import is not answered yet");
	else if (i->committed)
		err_set(err, ERR_USAGE, "this import is committed already");
	return err->code != 0;
}

static void give(struct import *i, struct sched_task *t)
{
	i->busy = false;
	if (t->ran && t->bytes)
		sched_give(i->copies->core->p.sched, t->name, t->bytes);
	if (!t->ran)
		i->r = err_set(&i->err, ERR_CANCELLED, "the import was ended");
}

/* ---- begin ---- */

static void begin_done(void *ctx, int r, const struct err *why)
{
	struct import *i = ctx;
	bool failed = r != 0;

	i->busy = false;
	i->row = !r;
	i->telling = true;
	i->begun(i->token, r ? why : NULL, i);
	i->telling = false;
	if (failed || i->ended)
		import_free(i);
}

static int make(struct copies *c, const char *name, const struct peer *peer, struct import **ret, struct err *err)
{
	struct import *i;

	if (c->core->stopping)
		return err_set(err, ERR_BUSY, "the daemon is stopping");
	if (dataset_name_check(name, err))
		return -(int)err->code;
	if (dataset_find(c->datasets, name, peer)) {
		err_set(err, ERR_CONFLICT, "there is a dataset %s already", name);
		return err_add_hint(err, "import under another name");
	}
	if (dataset_limit(c->datasets, peer, err) || charge(c->core, sizeof *i, "an import", err))
		return -(int)err->code;
	i = calloc(1, sizeof *i);
	if (i)
		i->dataset = dataset_new(c->datasets, name, peer, false, err);
	else
		err_set(err, ERR_NOMEM, "no memory for an import");
	if (!i || !i->dataset) {
		uncharge(c->core, sizeof *i);
		free(i);
		return -(int)err->code;
	}
	*ret = i;
	return 0;
}

void import_begin(struct copies *c, const char *name, uint32_t mode, const struct peer *peer,
		  void (*begun)(void *token, const struct err *why, struct import *), void *token)
{
	struct catalogue_push row = {.uid = peer->uid, .begun_us = clock_real_us()};
	struct err err = ERR_INIT;
	struct import *i = NULL;

	if (make(c, name, peer, &i, &err)) {
		begun(token, &err, NULL);
		return;
	}
	i->copies = c;
	i->id = ++c->last_import;
	i->push = row.id = ++c->core->last_push;
	i->peer = rights_without_groups(peer);
	i->owner = (struct sched_owner){.uid = peer->uid, .flow = ++c->core->last_flow};
	i->begun = begun;
	i->token = token;
	i->fd = -1;
	dataset_set_mode(i->dataset, mode);
	dataset_hold(i->dataset);
	dataset_push_begin(i->dataset);
	c->core->background++;
	row.dataset = i->dataset->id;
	i->busy = true;
	if (dataset_put_row(i->dataset, &err) || catalogue_put_push(c->core->p.catalogue, &row, begin_done, i, &err))
		begin_done(i, -(int)err.code, &err);
}

/* ---- files ---- */

/* Copies the file, which must still have `bytes`: its owner may write to it meanwhile. */
static int copy_file(struct import *i, const char *as, uint64_t bytes, struct err *err)
{
	uint8_t *buf = malloc(COPY);
	char temp[NAME + 8];
	int fd = -1, r = buf ? 0 : err_set(err, ERR_NOMEM, "no memory to copy a file");
	uint64_t at = 0;
	size_t n = COPY;

	snprintf(temp, sizeof temp, "%s.tmp", as);
	if (!r)
		r = io_open(i->dataset->dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC, 0600, &fd, err);
	while (!r && n == COPY) {
		if (atomic_load(&i->task.cancel))
			r = err_set(err, ERR_CANCELLED, "the import was ended");
		if (!r)
			r = io_read_some(i->fd, buf, COPY, at, i->name, &n, err);
		at += n;
		if (!r && (at > bytes || (n < COPY && at < bytes))) {
			err_set(err, ERR_INPUT, "the file was written to while it was read");
			r = err_add_file(err, i->name);
		}
		if (!r && n)
			r = io_write_at(fd, buf, n, at - n, as, err);
	}
	if (!r)
		r = io_publish(i->dataset->dirfd, fd, temp, as, err);
	else if (fd >= 0)
		io->unlinkat(i->dataset->dirfd, temp, 0);
	io_close(fd);
	free(buf);
	return r;
}

static void segment_name(const struct import *i, size_t k, char buf[NAME])
{
	snprintf(buf, NAME, "import-%llu-%zu.seg", (unsigned long long)i->push, k);
}

/* It belongs to a line set. */
static bool is_derived(const struct import *i, const char *file)
{
	struct grid_named of[GRID_SOURCE_FILES];

	for (size_t s = 0; s < i->m->nsources; s++) {
		const struct grid_source *source = &i->m->sources[s];
		size_t n = source->kind == GRID_LINE_VERTICES ? grid_source_files(source, of) : 0;
		char segment[40] = "";

		for (size_t k = 0; k < n; k++)
			if (!strcmp(of[k].name, file))
				return true;
		if (n)
			grid_line_segment(source->id, segment);
		if (n && !strcmp(strcat(segment, ".seg"), file))
			return true;
	}
	return false;
}

/* Reserves space on the disk, before the file is written. */
static int take_space(struct import *i, uint64_t bytes)
{
	int r = limit_disk_take(i->copies->core, i->peer.uid, i->peer.admin, bytes, "the import", &i->err);

	if (r)
		return r;
	r = space_take(i->copies->core->space, SPACE_PENDING, bytes, SPACE_MUST, "the import", &i->err);
	if (r)
		limit_disk_give(i->copies->core, i->peer.uid, bytes);
	i->taken += r ? 0 : bytes;
	return r;
}

static int take_manifest(struct import *i, uint64_t bytes)
{
	char as[NAME];
	int r;

	if (i->m)
		return err_set(&i->err, ERR_USAGE, "this import has a manifest already");
	snprintf(as, sizeof as, "import-%llu", (unsigned long long)i->push);
	r = take_space(i, bytes);
	if (!r)
		r = copy_file(i, as, bytes, &i->err);
	if (!r)
		r = grid_manifest_load_bare(i->dataset->dirfd, as, i->copies->core->p.ledger, &i->m, &i->err);
	if (!r && !i->m->generation)
		r = err_set(&i->err, ERR_INPUT, "this is not the manifest of a dataset");
	if (!r) {
		i->nfiles = grid_manifest_files(i->m);
		i->have = calloc(i->nfiles + 1, sizeof *i->have);
		r = i->have ? 0 : err_set(&i->err, ERR_NOMEM, "no memory for an import");
	}
	if (!r)
		r = io_remove(i->dataset->dirfd, as, &i->err);
	return r;
}

/* The name of a file of sources until the commit. */
static void sources_name(const struct import *i, size_t k, char buf[NAME])
{
	snprintf(buf, NAME, "import-%llu.sources-%zu", (unsigned long long)i->push, k);
}

/* A file that the manifest names: k is its number. */
static void take_named(struct import *i, const struct client_file *id)
{
	struct grid_named_at at = {0};
	struct grid_named file;
	char as[NAME];
	size_t k = 0;
	bool found;

	while ((found = grid_manifest_next_file(i->m, &at, &file)) && strcmp(file.name, i->name))
		k++;
	if (!found) {
		err_set(&i->err, ERR_INPUT, "the manifest does not name this file");
		i->r = err_add_file(&i->err, i->name);
	} else if (id->size != file.bytes) {
		err_set(&i->err, ERR_INPUT, "the file has %llu bytes, the manifest says %llu", (unsigned long long)id->size,
			(unsigned long long)file.bytes);
		i->r = err_add_file(&i->err, i->name);
	} else if (!i->have[k] && !is_derived(i, file.name)) {
		if (file.source)
			memcpy(as, file.name, sizeof as);
		else if (file.of_sources)
			sources_name(i, k - i->m->nsegments, as);
		else
			segment_name(i, k, as);
		i->r = take_space(i, id->size);
		if (!i->r)
			i->r = copy_file(i, as, id->size, &i->err);
		i->have[k] = !i->r;
	}
}

static void file_run(struct sched_task *t)
{
	struct import *i = (struct import *)t;
	struct client_file id;

	i->r = client_file_check(i->fd, i->name, &id, &i->err);
	if (!i->r && !i->opened) {
		i->r = dataset_open(i->dataset, &i->err);
		i->opened = !i->r;
	}
	if (i->r)
		return;
	if (!strcmp(i->name, "manifest")) {
		i->r = take_manifest(i, id.size);
		err_add_file(&i->err, i->name);
		return;
	}
	if (!i->m) {
		i->r = err_set(&i->err, ERR_USAGE, "the manifest must come first");
		return;
	}
	take_named(i, &id);
}

static void file_done(struct sched_task *t)
{
	struct import *i = (struct import *)t;

	give(i, t);
	i->fd = io_close(i->fd);
	i->telling = true;
	i->filed(i->token, i->r ? &i->err : NULL);
	i->telling = false;
	if (i->ended)
		import_free(i);
}

void import_file(struct import *i, const char *name, int fd, void (*done)(void *token, const struct err *why), void *token)
{
	struct err err = ERR_INIT;

	if (!refuse(i, &err) && strlen(name) >= sizeof i->name)
		err_set(&err, ERR_INPUT, "\"%.60s\" is not a file of a dataset", name);
	if (err.code) {
		io_close(fd);
		done(token, &err);
		return;
	}
	snprintf(i->name, sizeof i->name, "%s", name);
	i->fd = fd;
	i->filed = done;
	i->token = token;
	submit(i, file_run, file_done, COPY);
}

/* ---- commit ---- */

struct check_ctx {
	struct import *i;
	struct err *first; /* damage */
};

static int check_cancelled(void *ctx, uint64_t bytes)
{
	return atomic_load(&((struct check_ctx *)ctx)->i->task.cancel);
}

static void note_damage(void *ctx, const struct err *why)
{
	struct check_ctx *c = ctx;

	if (!c->first->code)
		*c->first = *why;
}

/* Names the file in the error as the client knows it: segment k of the new manifest. */
static void use_sent_name(const struct import *i, size_t k, struct err *err)
{
	size_t sent = 0;

	for (; sent < i->m->nsegments; sent++)
		if (!is_derived(i, i->m->segments[sent].file) && !k--)
			break;
	if (sent < i->m->nsegments)
		snprintf(err->file, sizeof err->file, "%s", i->m->segments[sent].file);
	*err->hint = 0;
	err_add_hint(err, "copy the folder here again, or export the dataset again");
}

/* Checks every page and block against its checksum, and the records against index, header and manifest. */
static int check_segments(struct import *i, struct err *err)
{
	struct err first = ERR_INIT;
	struct check_ctx c = {i, &first};
	struct grid_verify_params p = {
		.dirfd = i->dataset->dirfd, .damaged = note_damage, .progress = check_cancelled, .ctx = &c};
	struct ledger *ledger = i->copies->core->p.ledger;
	int r = 0;

	if (!ledger_take(ledger, LEDGER_INPUT, GRID_VERIFY_BYTES))
		return err_set(err, ERR_BUSY, "there is no memory now to check the import");
	p.memory = aligned_alloc(64, GRID_VERIFY_BYTES);
	if (!p.memory)
		r = err_set(err, ERR_NOMEM, "no memory to check a segment");
	for (size_t k = 0; !r && !first.code && k < i->made->nsegments; k++) {
		r = grid_verify_segment(&p, i->made, k, err);
		if (first.code)
			use_sent_name(i, k, &first);
	}
	free(p.memory);
	sched_give(i->copies->core->p.sched, LEDGER_INPUT, GRID_VERIFY_BYTES);
	if (!r && first.code) {
		*err = first;
		r = -(int)first.code;
	}
	return r;
}

/* Reads the files of sources, which have other names here. */
static int read_sources(struct import *i, struct err *err)
{
	char sent[GRID_SOURCES_FILES][NAME];
	int r;

	if (!i->m->bare)
		return 0; /* by a commit that failed */
	for (size_t k = 0; k < i->m->nfiles; k++) {
		memcpy(sent[k], i->m->files[k].name, NAME);
		sources_name(i, k, i->m->files[k].name);
	}
	r = grid_manifest_complete(i->dataset->dirfd, i->m, err);
	for (size_t k = 0; k < i->m->nfiles; k++) {
		if (r && !strcmp(err->file, i->m->files[k].name))
			snprintf(err->file, sizeof err->file, "%.*s", NAME - 1, sent[k]);
		memcpy(i->m->files[k].name, sent[k], NAME);
	}
	return r;
}

static int remove_sources(struct import *i, struct err *err)
{
	char name[NAME];
	int r = 0;

	for (size_t k = 0; !r && k < i->m->nfiles; k++) {
		sources_name(i, k, name);
		r = io_remove(i->dataset->dirfd, name, err);
	}
	return r;
}

/* Writes the manifest with the names that the segments have here, with a file of sources of its own, and without line sets. */
static int write_manifest(struct import *i, struct err *err)
{
	struct grid_apart apart = {.name = i->sources_name};
	struct grid_manifest m = *i->m;
	int r;

	m.files = NULL;
	m.nfiles = 0;
	m.segments = calloc(m.nsegments + 1, sizeof *m.segments);
	m.sources = calloc(m.nsources + 1, sizeof *m.sources);
	m.nsegments = m.nsources = 0;
	for (size_t k = 0; m.segments && k < i->m->nsegments; k++) {
		if (is_derived(i, i->m->segments[k].file))
			continue;
		m.segments[m.nsegments] = i->m->segments[k];
		segment_name(i, k, m.segments[m.nsegments++].file);
	}
	for (size_t k = 0; m.sources && k < i->m->nsources; k++)
		if (i->m->sources[k].kind != GRID_LINE_VERTICES)
			m.sources[m.nsources++] = i->m->sources[k];
	if (m.segments && m.sources)
		r = grid_manifest_write_apart(i->dataset->dirfd, i->made_name, &apart, &m, err);
	else
		r = err_set(err, ERR_NOMEM, "no memory for an import");
	free(m.segments);
	free(m.sources);
	return r;
}

static void commit_run(struct sched_task *t)
{
	struct import *i = (struct import *)t;
	struct grid_named_at at = {0};
	struct grid_named file;

	if (!i->m) {
		i->r = err_set(&i->err, ERR_INPUT, "this import has no manifest yet");
		return;
	}
	for (size_t k = 0; grid_manifest_next_file(i->m, &at, &file); k++) {
		if (!i->have[k] && !is_derived(i, file.name)) {
			err_set(&i->err, ERR_INPUT, "the file is missing");
			i->r = err_add_file(&i->err, file.name);
			return;
		}
	}
	i->r = read_sources(i, &i->err);
	if (!i->r)
		i->r = write_manifest(i, &i->err);
	if (!i->r)
		i->r = remove_sources(i, &i->err);
	i->made = grid_manifest_free(i->made); /* left by a commit that failed */
	if (!i->r)
		i->r = grid_manifest_load(i->dataset->dirfd, i->made_name, i->copies->core->p.ledger, &i->made, &i->err);
	if (!i->r)
		i->r = check_segments(i, &i->err);
	for (size_t k = 0; !i->r && k < i->made->nsources; k++)
		i->r = breaklines_verify(i->dataset->dirfd, &i->made->sources[k], NULL, &i->err);
}

static void answer(struct import *i, const struct err *why)
{
	struct imported done = {.dataset = i->dataset->name, .generation = i->dataset->generation, .points = i->dataset->points};

	i->busy = false;
	dataset_commit_end(i->dataset, i);
	if (!why)
		log_event(LOG_EVENT_DATASET_IMPORTED,
			  &(struct log_about){.dataset = done.dataset,
					      .generation = done.generation,
					      ABOUT_USER(i->peer.uid),
					      .pid = i->peer.pid},
			  "the dataset %s was imported: %llu points", done.dataset, (unsigned long long)done.points);
	i->telling = true;
	i->done(i->token, why, why ? NULL : &done);
	i->telling = false;
	if (i->ended)
		import_free(i);
}

static void row_done(void *ctx, int r, const struct err *why)
{
	struct import *i = ctx;

	dataset_row_written(i->dataset);
	i->committed = !r;
	if (!r)
		dataset_next_install(i->dataset, &i->becomes, false);
	answer(i, r ? why : NULL);
}

/* Writes the row of the new generation. row_done then changes the dataset. */
static int put_row(struct import *i, struct err *err)
{
	int r;

	dataset_next_clear(&i->becomes); /* left by a commit that failed */
	r = dataset_next_make(i->dataset, i->made, NULL, i->made_name, clock_real_us(), &i->becomes, err);
	return r ? r : dataset_next_put(i->dataset, &i->becomes, i->push, row_done, i, err);
}

static void commit_done(struct sched_task *t)
{
	struct import *i = (struct import *)t;

	give(i, t);
	i->busy = true;
	if (i->r || put_row(i, &i->err))
		answer(i, &i->err);
}

void import_commit(struct import *i, void (*done)(void *token, const struct err *why, const struct imported *), void *token)
{
	struct err err = ERR_INIT;

	struct dataset *d = i->dataset;

	if (!refuse(i, &err) && (d->generation || d->committer || d->pushes > 1)) {
		err_set(&err, ERR_BUSY, "files are being pushed into the dataset %s", d->name);
		err_add_hint(&err, "import under another name");
	}
	if (err.code) {
		done(token, &err, NULL);
		return;
	}
	dataset_commit_begin(d, i);
	i->done = done;
	i->token = token;
	snprintf(i->made_name, sizeof i->made_name, "manifest-import-%llu", (unsigned long long)i->push);
	dataset_sources_name(i->made_name, i->sources_name);
	submit(i, commit_run, commit_done, 0);
}
