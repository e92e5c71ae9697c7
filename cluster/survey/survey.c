/*
 * What all phases of this room share: an attempt from its beginning to its record, what was agreed of the inputs, and how an
 * input is opened.
 *
 * The model: a task believes nothing but the list of inputs and the records of earlier phases. An input is opened again by each
 * task that reads it, and must have the size and the time of change that it had when the run began.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "err.h"
#include "io.h"
#include "parse.h"
#include "survey_priv.h"

/* ---- attempts ---- */

static int make(void *ctx, struct work_attempt *a, uint32_t task, struct err *err)
{
	struct survey *s = ctx;
	int r;

	s->attempt = a;
	r = s->run(s, task, err);
	agree_done(&s->agree);
	grid_manifest_free(s->head);
	return r;
}

int survey_run(struct work *w, enum work_phase phase, uint32_t task, const struct survey_params *p, survey_fn run,
	       struct err *err)
{
	struct survey s = {.work = w, .p = p, .run = run};
	int r = work_run(w, phase, task, make, &s, err);

	return r > 0 ? 0 : r;
}

int survey_check_memory(const struct survey *s, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t has = work_about(s->work)->memory;
	char need[32], is[32];

	if (bytes <= has)
		return 0;
	err_set(err, ERR_LIMIT, "%s takes %s of memory, and a task has %s", what, parse_size_text(bytes, need),
		parse_size_text(has, is));
	err->need = bytes;
	return err_add_hint(err, "give tasks more with --task-memory");
}

/* ---- what was agreed ---- */

static void name_of_geoid(const char *path, char *ret, size_t size)
{
	const char *slash = strrchr(path, '/'), *base = slash ? slash + 1 : path;
	size_t n = strlen(base);

	if (n > 4 && !strcmp(base + n - 4, ".pgm"))
		n -= 4;
	snprintf(ret, size, "%.*s", (int)(n < 64 ? n : 64), base);
}

/* The grid's hash; the head makes it from the whole file, and notes its size and time, by which others know it again. */
static int hash_geoid(struct survey *s, const struct work_record *head, const char *path, char ret[DIGEST_HEX_SIZE],
		      struct err *err)
{
	const char *known = head ? work_record_text(head, "geoid_hash") : NULL;
	char seen[64];
	struct crs_geoid_info info;
	struct stat st;
	int fd, r = work_file_open(s->work, path, UINT64_MAX, &fd, err);

	if (r)
		return err_add_file(err, path);
	if (io->fstat(fd, &st))
		r = err_sys(err, errno, "cannot ask for its size");
	snprintf(seen, sizeof seen, "%lld %lld.%09ld", (long long)st.st_size, (long long)st.st_mtim.tv_sec, st.st_mtim.tv_nsec);
	if (!r && !head)
		r = crs_geoid_check(fd, path, &info, err);
	if (!r && head && (!known || strcmp(seen, work_record_text(head, "geoid_file"))))
		r = err_set(err, ERR_CHANGED, "the geoid grid changed since the run began");
	io_close(fd);
	if (r)
		return err_add_file(err, path);
	if (head) {
		snprintf(ret, DIGEST_HEX_SIZE, "%s", known);
		return 0;
	}
	r = work_result(s->attempt, "geoid_hash", digest_hex(info.hash, ret), err);
	return r ? r : work_result(s->attempt, "geoid_file", seen, err);
}

int survey_agree(struct survey *s, const struct work_record *head, struct err *err)
{
	struct agree_words says = s->p->says;
	char geoid[72] = "", hash[DIGEST_HEX_SIZE], *path = NULL;
	bool shifts = says.geoid && *says.geoid;
	int r;

	if (shifts)
		name_of_geoid(says.geoid, geoid, sizeof geoid);
	says.geoid = geoid;
	r = agree_init(&s->agree, &says, err);
	s->agree.dataset = "of the run";
	s->agree.grows = s->p->grows;
	if (!r)
		r = agree_said(&s->agree, &says, err);
	if (!r)
		r = agree_plane_words(&s->agree, err);
	if (!r && shifts && !(path = realpath(s->p->says.geoid, NULL))) {
		err_sys(err, errno, "cannot find the geoid grid");
		r = err_add_file(err, s->p->says.geoid);
	}
	if (!r && shifts)
		r = hash_geoid(s, head, path, hash, err);
	if (!r && shifts)
		r = agree_geoid_found(&s->agree, path, hash, err);
	free(path);
	return r;
}

int survey_take_head(struct survey *s, struct err *err)
{
	struct work_record *record = NULL;
	const char *zone;
	uint64_t read_bytes = 0;
	int r = work_record_need(s->work, WORK_HEAD, 0, &record, err);

	if (r)
		return r;
	r = survey_read_part(s, record, 0, &s->head, err);
	if (!r)
		r = survey_agree(s, record, err);
	zone = work_record_text(record, "zone");
	if (!r && (!zone || !agree_take_up(&s->agree, s->head->crs, s->head->unit_xy, s->head->unit_z, zone, &s->head->lattice)))
		r = err_set(err, ERR_CORRUPT, "the record of the head has no zone");
	if (!r)
		r = work_record_u64(record, "read_bytes", &read_bytes, err);
	s->read_bytes = (size_t)read_bytes;
	work_record_free(record);
	return r;
}

/* ---- inputs ---- */

int survey_unchanged(int fd, const char *path, uint64_t size, int64_t mtime_ns, const char *since, struct err *err)
{
	struct stat st;

	if (io->fstat(fd, &st)) {
		err_sys(err, errno, "cannot ask for its size");
	} else if (!S_ISREG(st.st_mode)) {
		err_set(err, ERR_INPUT, "it is no regular file");
	} else if ((uint64_t)st.st_size != size || (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec != mtime_ns) {
		err_set(err, ERR_CHANGED, "the file changed %s", since);
		err_add_hint(err, "begin another run when nobody writes to it");
	} else {
		return 0;
	}
	return err_add_file(err, path);
}

/* Where a node does not see the inputs, they are not waited for one by one. */
int survey_open(struct survey *s, const char *path, uint64_t size, int64_t mtime_ns, int *ret_fd, struct err *err)
{
	int fd, r;

	if (atomic_load(&s->impatient))
		r = io_open(work_fd(s->work), path, O_RDONLY | O_NONBLOCK | O_NOCTTY, 0, &fd, err);
	else
		r = work_file_open(s->work, path, UINT64_MAX, &fd, err);
	if (r) {
		atomic_store(&s->impatient, true);
		return err_add_file(err, path);
	}
	r = survey_unchanged(fd, path, size, mtime_ns, "since the run began", err);
	if (r)
		io_close(fd);
	else
		*ret_fd = fd;
	return r;
}

struct input_options survey_input_options(const struct survey *s, bool projects)
{
	const struct survey_params *p = s->p;
	struct input_options options = {
		.format = p->format && *p->format ? p->format : NULL,
		.columns = p->columns && *p->columns ? p->columns : NULL,
		.decimal_comma = p->decimal_comma,
		.strict = p->strict,
		.accept_truncated = p->accept_truncated,
		.pipe = -1,
	};

	agree_input_options(&s->agree, projects, &options);
	return options;
}
