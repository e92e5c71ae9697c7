/*
 * State files of suspended stages (grid_state.h). A state is accepted if its checksum agrees and every run that it names
 * has a valid header. Runs are numbered upwards without gaps, so runs that were written later are found by counting.
 */
#include "grid_state.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "grid_block.h"
#include "grid_run_old.h"
#include "io.h"

enum { HEAD_BYTES = 8 + 4 + 4 + 8 + 4 * 4, CHECK_BYTES = 8 };
#define STATE_MOST ((uint64_t)1 << 30) /* bytes */

void grid_run_name(const char *stem, uint32_t number, char name[GRID_NAME_MAX])
{
	snprintf(name, GRID_NAME_MAX, "%s.%u.run", stem, number);
}

void grid_state_name(const char *stem, char name[GRID_NAME_MAX])
{
	snprintf(name, GRID_NAME_MAX, "%s.stage", stem);
}

int grid_state_write(int dirfd, const char *stem, const struct grid_state *state, bool durable, struct err *err)
{
	size_t bytes = HEAD_BYTES + (state->nruns + state->nsources) * 4 + CHECK_BYTES;
	uint8_t *out = malloc(2 * bytes);
	char name[GRID_NAME_MAX];
	struct grid_file f;
	struct packer p;
	int rc;

	if (!out)
		return err_set(err, ERR_NOMEM, "no memory for the state of a stage");
	p = packer_of(out, bytes);
	packer_bytes(&p, DISK_STATE_MAGIC, 8);
	packer_u32(&p, DISK_VERSION);
	packer_u32(&p, 0);
	packer_u64(&p, bytes);
	packer_u32(&p, state->next_run);
	packer_u32(&p, (uint32_t)state->nruns);
	packer_u32(&p, (uint32_t)state->nsources);
	packer_u32(&p, 0);
	for (size_t i = 0; i < state->nruns; i++)
		packer_u32(&p, state->runs[i]);
	for (size_t i = 0; i < state->nsources; i++)
		packer_u32(&p, state->sources[i]);
	packer_u64(&p, grid_check(out, bytes - CHECK_BYTES, 0));
	grid_state_name(stem, name);
	rc = grid_file_create(&f, dirfd, name, out + bytes, bytes, err);
	if (rc == 0) {
		rc = grid_file_append(&f, out, bytes, err);
		if (rc == 0)
			rc = grid_file_publish(&f, durable ? GRID_DURABLE : GRID_TEMPORARY, err);
		grid_file_abort(&f);
	}
	free(out);
	return rc;
}

static int damaged(const char *name, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the state of an interrupted push is damaged: %s", what);
	return err_add_file(err, name);
}

static int parse(const uint8_t *bytes, size_t n, const char *name, struct grid_state *ret, struct err *err)
{
	struct cursor c = cursor_of(bytes, n - CHECK_BYTES);
	const uint8_t *magic = cursor_bytes(&c, 8);
	uint32_t version = cursor_u32(&c), *to;
	uint64_t size, check;

	cursor_skip(&c, 4);
	size = cursor_u64(&c);
	ret->next_run = cursor_u32(&c);
	ret->nruns = cursor_u32(&c);
	ret->nsources = cursor_u32(&c);
	cursor_skip(&c, 4);
	memcpy(&check, bytes + n - CHECK_BYTES, sizeof check);
	if (memcmp(magic, DISK_STATE_MAGIC, 8) || size != n || check != grid_check(bytes, n - CHECK_BYTES, 0))
		return damaged(name, "its checksum does not agree", err);
	if (version != DISK_VERSION) {
		err_set(err, ERR_VERSION, "the state of an interrupted push has version %u; this acut reads version %d", version,
			DISK_VERSION);
		return err_add_file(err, name);
	}
	if (cursor_left(&c) != 4 * (ret->nruns + ret->nsources))
		return damaged(name, "its counts exceed its size", err);
	ret->memory = to = malloc(cursor_left(&c) + 1);
	if (!to)
		return err_set(err, ERR_NOMEM, "no memory for the state of a stage");
	ret->runs = to;
	ret->sources = to + ret->nruns;
	for (size_t i = 0; i < ret->nruns + ret->nsources; i++)
		to[i] = cursor_u32(&c);
	for (size_t i = 0; i < ret->nruns; i++)
		if (ret->runs[i] >= ret->next_run)
			return damaged(name, "a run has an impossible number", err);
	for (size_t i = 0; i < ret->nsources; i++)
		if (!ret->sources[i] || (i && ret->sources[i] <= ret->sources[i - 1]))
			return damaged(name, "its sources are not in order", err);
	return 0;
}

static int check_runs(int dirfd, const char *stem, struct grid_state *state, struct err *err)
{
	char name[GRID_NAME_MAX];
	uint64_t bytes = 0;
	bool older = false;
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < state->nruns; i++) {
		grid_run_name(stem, state->runs[i], name);
		rc = grid_run_check(dirfd, name, &older, &bytes, err);
		state->bytes += bytes;
		state->older |= older;
	}
	return rc;
}

int grid_state_read(int dirfd, const char *stem, struct grid_state *ret, struct err *err)
{
	struct grid_state state = {0};
	char name[GRID_NAME_MAX];
	uint8_t *bytes = NULL;
	struct stat st;
	int fd, rc;

	grid_state_name(stem, name);
	rc = io_open(dirfd, name, O_RDONLY, 0, &fd, err);
	if (rc)
		return rc;
	if (io->fstat(fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		rc = err_add_file(err, name);
	} else if (st.st_size < HEAD_BYTES + CHECK_BYTES || (uint64_t)st.st_size > STATE_MOST) {
		rc = damaged(name, "its size is impossible", err);
	} else if (!(bytes = malloc((size_t)st.st_size))) {
		rc = err_set(err, ERR_NOMEM, "no memory for the state of a stage");
	}
	if (rc == 0)
		rc = io_read_at(fd, bytes, (size_t)st.st_size, 0, name, err);
	io_close(fd);
	if (rc == 0)
		rc = parse(bytes, (size_t)st.st_size, name, &state, err);
	free(bytes);
	if (rc == 0)
		rc = check_runs(dirfd, stem, &state, err);
	if (rc)
		grid_state_free(&state);
	else
		*ret = state;
	return rc;
}

void grid_state_free(struct grid_state *state)
{
	free(state->memory);
	*state = (struct grid_state){0};
}

/* Removes runs below next_run that the state does not name. */
static int trim_old(int dirfd, const char *stem, const struct grid_state *state, struct err *err)
{
	bool *named = calloc((size_t)state->next_run + 1, sizeof *named);
	char name[GRID_NAME_MAX];
	int rc = 0;

	if (!named)
		return err_set(err, ERR_NOMEM, "no memory for the state of a stage");
	for (size_t i = 0; i < state->nruns; i++)
		named[state->runs[i]] = true;
	for (uint32_t i = 0; rc == 0 && i < state->next_run; i++) {
		if (named[i])
			continue;
		grid_run_name(stem, i, name);
		rc = io_remove(dirfd, name, err);
	}
	free(named);
	return rc;
}

int grid_state_trim(int dirfd, const char *stem, const struct grid_state *state, struct err *err)
{
	char name[GRID_NAME_MAX], temp[GRID_NAME_MAX + 8];
	uint32_t number = state->next_run;
	int rc = trim_old(dirfd, stem, state, err);
	bool there = true;

	for (; rc == 0 && there; number++) {
		grid_run_name(stem, number, name);
		snprintf(temp, sizeof temp, "%s.tmp", name);
		there = io->unlinkat(dirfd, name, 0) == 0;
		if (!there && errno != ENOENT) {
			err_sys(err, errno, "cannot remove");
			return err_add_file(err, name);
		}
		rc = io_remove(dirfd, temp, err);
	}
	return rc;
}
