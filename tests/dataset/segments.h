/* For tests of merge and prune: the folder of a dataset, its meshes, and requests. */
#ifndef SEGMENTS_H
#define SEGMENTS_H

#include "gate.h"
#include "dataset_priv.h"

#include "clock.h"
#include "job_priv.h"

/* ---- the folder ---- */

static struct dataset *named(const char *name)
{
	return dataset_find(h.service->datasets, name, &me);
}

static struct dataset_info dataset_of(const char *name)
{
	struct dataset_info info;

	dataset_info(named(name), &info);
	return info;
}

static int folder_of(const char *name)
{
	char path[128];
	int fd;

	snprintf(path, sizeof path, "%s/datasets/%llu", h.folder, (unsigned long long)dataset_of(name).id);
	fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	assert_true(fd >= 0);
	return fd;
}

/* Number of files whose names begin with `prefix`; *ret_bytes: their sizes. */
static unsigned files_of(const char *name, const char *prefix, uint64_t *ret_bytes)
{
	int fd = folder_of(name);
	DIR *dir = fdopendir(fd);
	struct dirent *e;
	struct stat st;
	unsigned n = 0;

	*ret_bytes = 0;
	while ((e = readdir(dir))) {
		if (*e->d_name == '.' || strncmp(e->d_name, prefix, strlen(prefix)))
			continue;
		assert_int_equal(fstatat(fd, e->d_name, &st, 0), 0);
		*ret_bytes += (uint64_t)st.st_size;
		n++;
	}
	closedir(dir);
	return n;
}

/* A merge that was given up starts again after a second. */
static bool merge_awaited(void)
{
	for (const struct dataset *d = datasets_first(h.service->datasets); d; d = d->next)
		if (d->merge_due && h.service->datasets->merge_after_ns != UINT64_MAX)
			return true;
	return h.service->datasets->merge;
}

static void idle(void)
{
	turn_until(!service_active(h.service) && !merge_awaited());
	turn(0); /* starts what may start now */
	turn_until(!service_active(h.service) && !merge_awaited());
}

/* The folder has one manifest and its segments, and nothing else. */
static void folder_is_tidy(const char *name)
{
	struct dataset_info info = dataset_of(name);
	uint64_t bytes, ignored;

	assert_int_equal(files_of(name, "manifest-", &ignored), 1);
	assert_int_equal(files_of(name, "", &bytes), 1 + info.segments);
	assert_int_equal(bytes - ignored, info.bytes);
}

/* ---- meshes ---- */

struct mesh {
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	uint64_t points;
};

static struct job *mesh_job(const char *name, uint64_t generation)
{
	struct job_params p = {.dataset = named(name), .view = VIEW, .generation = generation, .fresh = true, .peer = me};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	return accepted_job;
}

static struct mesh mesh_of(const char *name, uint64_t generation)
{
	struct job *job = mesh_job(name, generation);
	struct mesh m = {0};

	if (!job)
		fail_msg("%s", accepted_err.message);
	turn_until_final(job);
	if (info_of(job).state != JOB_done)
		fail_msg("generation %llu: %s", (unsigned long long)generation, job->err.message);
	snprintf(m.digest, sizeof m.digest, "%s", info_of(job).report->digest);
	snprintf(m.vertex_digest, sizeof m.vertex_digest, "%s", info_of(job).report->vertex_digest);
	m.points = info_of(job).report->points;
	return m;
}

static void same_mesh(const char *name, uint64_t generation, const struct mesh *want)
{
	struct mesh m = mesh_of(name, generation);

	assert_string_equal(m.digest, want->digest);
	assert_string_equal(m.vertex_digest, want->vertex_digest);
	assert_int_equal(m.points, want->points);
}

/* ---- requests ---- */

static void reverted(void *token, const struct err *why, const struct reverted *r)
{
	answer(why);
}

static void revert(const char *name, uint64_t generation)
{
	ask(dataset_revert(named(name), generation, &me, reverted, NULL));
	assert_int_equal(got.why.code, 0);
}

#endif
