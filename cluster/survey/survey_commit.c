/*
 * The commit: the segments of all stages, or what sorting made of them, and the sources of the head with what the stages say of
 * them, become one dataset.
 *
 * The model: the folder of the dataset gets a second name for each segment that a record names, and then the manifest; so it
 * never holds a file of an attempt that lost. Names, times and order all come from records, so two attempts write the same bytes,
 * and the first manifest that has its name stays. A file of sources is named after its content: an attempt that was killed before
 * it had a manifest may have named one of other stages, and no manifest may name a file of other bytes.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "io.h"
#include "survey_priv.h"

struct commit {
	struct survey *s;
	struct grid_segment_info *segment;
	size_t nsegments;
	bool *seen; /* by source of the head */
	uint64_t inputs, points, moved, left_out, warnings;
	int dataset;  /* the folder; -1: not open */
	char **clean; /* texts that took the place of others */
	size_t nclean;
};

/* ---- what the stages say ---- */

static int add(const struct work_record *record, const char *key, uint64_t *sum, struct err *err)
{
	uint64_t n = 0;
	int r = work_record_u64(record, key, &n, err);

	*sum += n;
	return r;
}

static int wrong(const char *name, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "%s", what);
	return err_add_file(err, name);
}

static int take_sources(struct commit *c, const struct grid_manifest *part, const char *name, struct err *err)
{
	struct grid_manifest *head = c->s->head;

	for (size_t i = 0; i < part->nsources; i++) {
		const struct grid_source *from = &part->sources[i];
		struct grid_source *to;

		/* The head numbers them from 1. */
		if (from->id > head->nsources || c->seen[from->id - 1])
			return wrong(name, "it has a source that is of another task, or of none", err);
		to = &head->sources[from->id - 1];
		if (strcmp(to->path, from->path))
			return wrong(name, "it has another source than the head under its number", err);
		c->seen[from->id - 1] = true;
		to->points = from->points;
		to->hash = from->hash;
		to->left_out = from->left_out;
	}
	return 0;
}

int survey_read_part(const struct survey *s, const struct work_record *record, size_t file, struct grid_manifest **ret,
		     struct err *err)
{
	const struct work_file *f;
	int fd, r;

	if (record->nfile <= file)
		return err_set(err, ERR_CORRUPT, "the record of %s %u names no manifest", work_phase_text(record->phase),
			       (unsigned)record->task);
	f = &record->file[file];
	r = work_file_open(s->work, f->name, f->size, &fd, err); /* until it is seen */
	if (r)
		return r;
	io_close(fd);
	return grid_manifest_read(work_fd(s->work), f->name, ret, err);
}

static void take_segment(struct commit *c, const struct grid_manifest *part)
{
	if (part->nsegments == 1 && part->segments[0].points)
		c->segment[c->nsegments++] = part->segments[0];
}

static int take_stage(struct commit *c, uint32_t task, struct err *err)
{
	struct work_record *record = NULL;
	struct grid_manifest *part = NULL;
	int r = work_record_need(c->s->work, WORK_STAGE, task, &record, err);

	if (r)
		return r;
	r = add(record, "inputs", &c->inputs, err);
	if (!r)
		r = add(record, "points", &c->points, err);
	if (!r)
		r = add(record, "moved", &c->moved, err);
	if (!r)
		r = add(record, "left_out", &c->left_out, err);
	if (!r)
		r = add(record, "warnings", &c->warnings, err);
	if (!r && record->nfile)
		r = survey_read_part(c->s, record, 1, &part, err);
	if (!r && part)
		r = take_sources(c, part, record->file[1].name, err);
	if (!r && part && !work_about(c->s->work)->tasks[WORK_SORT])
		take_segment(c, part);
	grid_manifest_free(part);
	work_record_free(record);
	return r;
}

static int take_sorted(struct commit *c, uint32_t task, struct err *err)
{
	struct work_record *record = NULL;
	struct grid_manifest *part = NULL;
	int r = work_record_need(c->s->work, WORK_SORT, task, &record, err);

	if (!r && record->nfile)
		r = survey_read_part(c->s, record, 1, &part, err);
	if (!r && part)
		take_segment(c, part);
	grid_manifest_free(part);
	work_record_free(record);
	return r;
}

static int take_all(struct commit *c, struct err *err)
{
	const uint32_t *tasks = work_about(c->s->work)->tasks;
	uint64_t points = 0;
	int r = 0;

	c->segment = calloc((size_t)tasks[WORK_STAGE] + tasks[WORK_SORT] + 1, sizeof *c->segment);
	c->seen = calloc(c->s->head->nsources + 1, sizeof *c->seen);
	if (!c->segment || !c->seen)
		return err_set(err, ERR_NOMEM, "no memory for a manifest");
	for (uint32_t i = 0; !r && i < tasks[WORK_STAGE]; i++) {
		r = take_stage(c, i, err);
		if (!r)
			r = work_check_interrupt(c->s->work, err);
	}
	for (uint32_t i = 0; !r && i < tasks[WORK_SORT]; i++)
		r = take_sorted(c, i, err);
	for (size_t i = 0; !r && i < c->s->head->nsources; i++)
		if (!c->seen[i])
			r = wrong(c->s->head->sources[i].path, "no stage has read it", err);
	for (size_t i = 0; i < c->nsegments; i++)
		points += c->segment[i].points;
	if (!r && points != c->points)
		r = err_set(err, ERR_CORRUPT, "the segments have %llu points, the stages have read %llu",
			    (unsigned long long)points, (unsigned long long)c->points);
	return r;
}

/* ---- the dataset ---- */

/* Whatever link returned: its answer may be lost, and another attempt may have been first. */
static int link_segment(struct commit *c, const struct grid_segment_info *s, struct err *err)
{
	struct stat of[2];
	int sys, fd, r = work_file_open(c->s->work, s->file, s->bytes, &fd, err);

	if (r)
		return r;
	sys = io->linkat(work_fd(c->s->work), s->file, c->dataset, s->file, 0) ? errno : 0;
	if (!sys || (io->fstat(fd, &of[0]) == 0 && io->fstatat(c->dataset, s->file, &of[1], AT_SYMLINK_NOFOLLOW) == 0 &&
		     of[0].st_ino == of[1].st_ino))
		sys = 0;
	io_close(fd);
	return sys ? err_sys(err, sys, "cannot give %s to the dataset", s->file) : 0;
}

/* Bytes of a path need not be text, but what is told of a dataset is. */
static int clean(struct commit *c, const char **text, size_t most, struct err *err)
{
	char **more, *copy = malloc(most);

	if (copy)
		survey_clean_text(*text, copy, most);
	if (copy && !strcmp(copy, *text)) {
		free(copy);
		return 0;
	}
	more = copy ? realloc(c->clean, (c->nclean + 1) * sizeof *more) : NULL;
	if (!more) {
		free(copy);
		return err_set(err, ERR_NOMEM, "no memory for a manifest");
	}
	c->clean = more;
	c->clean[c->nclean++] = copy;
	*text = copy;
	return 0;
}

static int same_files(int a, int b, const char *name, bool *ret, struct err *err)
{
	enum { PIECE = 64 << 10 };
	uint8_t *of[2] = {malloc(PIECE), malloc(PIECE)};
	size_t n[2] = {1, 1};
	uint64_t at = 0;
	int r = of[0] && of[1] ? 0 : err_set(err, ERR_NOMEM, "no memory to compare manifests");

	for (*ret = true; !r && *ret && n[0]; at += n[0]) {
		r = io_read_some(a, of[0], PIECE, at, name, &n[0], err);
		if (!r)
			r = io_read_some(b, of[1], PIECE, at, name, &n[1], err);
		*ret = n[0] == n[1] && !memcmp(of[0], of[1], n[0]);
	}
	free(of[0]);
	free(of[1]);
	return r;
}

/* Another attempt was first, or the answer of a link was lost. */
static int check_same(struct commit *c, const char *temp, const char *file, struct err *err)
{
	char path[WORK_NAME];
	int fd[2] = {-1, -1}, r;
	bool same = false;

	snprintf(path, sizeof path, WORK_IN_DATASET "/%s", file);

	r = work_file_open(c->s->work, temp, UINT64_MAX, &fd[0], err);
	if (!r)
		r = work_file_open(c->s->work, path, UINT64_MAX, &fd[1], err);
	if (!r)
		r = same_files(fd[0], fd[1], file, &same, err);
	io_close(fd[0]);
	io_close(fd[1]);
	if (r || same)
		return r;
	err_set(err, ERR_CONFLICT, "the dataset has a file %s of other stages", file);
	err_add_hint(err, "remove it, and run the task again");
	return err_add_file(err, path);
}

/* Gives a file of this attempt its name in the dataset. */
static int name_file(struct commit *c, const char *temp, const char *file, struct err *err)
{
	int r = 0;

	if (io->linkat(work_fd(c->s->work), temp, c->dataset, file, 0)) {
		int sys = errno;

		r = sys == EEXIST ? check_same(c, temp, file, err) : err_sys(err, sys, "cannot name the file %s", file);
	}
	if (!r && io->unlinkat(work_fd(c->s->work), temp, 0))
		r = err_sys(err, errno, "cannot remove %s", temp);
	return r;
}

struct tidying {
	struct commit *c;
	const struct grid_manifest *m;
};

static int tidy_entry(void *ctx, const struct dirent *e, struct err *err)
{
	struct tidying *t = ctx;

	/* One with a dot is an attempt's. */
	if (strncmp(e->d_name, "sources-", 8) || strchr(e->d_name, '.') || grid_manifest_has_file(t->m, e->d_name))
		return 0;
	return io_remove(t->c->dataset, e->d_name, err);
}

/* Removes files of sources that the manifest, which is there to stay, does not name: who imports the dataset would send them. */
static int tidy(struct commit *c, struct err *err)
{
	struct grid_manifest *m = NULL;
	struct tidying t = {.c = c};
	int r = grid_manifest_load_bare(c->dataset, "manifest", NULL, &m, err);

	t.m = m;
	if (!r)
		r = io_list(c->dataset, ".", tidy_entry, &t, err);
	grid_manifest_free(m);
	return r;
}

/* The manifest, then the file of sources, if there is one. */
static int note_files(struct commit *c, const struct grid_manifest *m, const struct grid_apart *apart, struct err *err)
{
	uint64_t bytes = grid_manifest_bytes(m);
	char path[WORK_NAME];
	int r = work_result_file(c->s->attempt, WORK_IN_DATASET "/manifest", err);

	if (!r && apart->made) {
		snprintf(path, sizeof path, WORK_IN_DATASET "/%s", apart->file.name);
		r = work_result_file(c->s->attempt, path, err);
		bytes += apart->file.bytes;
	}
	return r ? r : work_result_u64(c->s->attempt, "bytes", bytes, err);
}

static int publish(struct commit *c, const struct grid_manifest *m, struct err *err)
{
	char temp[WORK_NAME], sources[WORK_NAME];
	struct grid_apart apart = {.as = sources + strlen(WORK_IN_DATASET "/")};
	struct err ignored = ERR_INIT;
	int r = work_attempt_file(c->s->attempt, WORK_IN_DATASET, "manifest", "", temp, err);

	/* An attempt that is killed leaves it. Without a dot it would be taken for a file of the dataset (acutctl dataset
	 * import). */
	if (!r)
		r = work_attempt_file(c->s->attempt, WORK_IN_DATASET, "sources", ".new", sources, err);
	if (!r)
		r = grid_manifest_write_apart(c->dataset, temp + strlen(WORK_IN_DATASET "/"), &apart, m, err);
	/* First what the manifest names. */
	if (!r && apart.made)
		r = name_file(c, sources, apart.file.name, err);
	if (!r)
		r = name_file(c, temp, "manifest", err);
	if (r == -ERR_CONFLICT)
		tidy(c, &ignored);
	if (!r)
		r = tidy(c, err);
	return r ? r : note_files(c, m, &apart, err);
}

static int make_dataset(struct commit *c, struct err *err)
{
	struct grid_manifest m = *c->s->head;
	int r = io_open(work_fd(c->s->work), WORK_IN_DATASET, O_RDONLY | O_DIRECTORY, 0, &c->dataset, err);

	m.segments = c->segment;
	m.nsegments = c->nsegments;
	for (size_t i = 0; !r && i < m.nsources; i++) {
		r = clean(c, &m.sources[i].path, GRID_SOURCE_PATH, err);
		if (!r)
			r = clean(c, &m.sources[i].name, GRID_SOURCE_NAME, err);
	}
	for (size_t i = 0; !r && i < c->nsegments; i++)
		r = link_segment(c, &c->segment[i], err);
	grid_generations_tally(&m, m.generations, m.ngenerations);
	return r ? r : publish(c, &m, err);
}

static int write_results(struct commit *c, struct err *err)
{
	const struct {
		const char *key;
		uint64_t value;
	} of[] = {{"inputs", c->inputs},     {"points", c->points},     {"moved", c->moved},
		  {"left_out", c->left_out}, {"warnings", c->warnings}, {"segments", c->nsegments}};
	int r = 0;

	for (size_t i = 0; !r && i < sizeof of / sizeof *of; i++)
		r = work_result_u64(c->s->attempt, of[i].key, of[i].value, err);
	return r;
}

static int run(struct survey *s, uint32_t task, struct err *err)
{
	struct commit c = {.s = s, .dataset = -1};
	int r = survey_take_head(s, err);

	if (!r)
		r = take_all(&c, err);
	if (!r)
		r = make_dataset(&c, err);
	if (!r)
		r = write_results(&c, err);
	io_close(c.dataset);
	for (size_t i = 0; i < c.nclean; i++)
		free(c.clean[i]);
	free(c.clean);
	free(c.segment);
	free(c.seen);
	return r;
}

int survey_commit(struct work *w, const struct survey_params *p, struct err *err)
{
	return survey_run(w, WORK_COMMIT, 0, p, run, err);
}
