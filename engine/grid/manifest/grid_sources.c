/*
 * Files of sources (grid_manifest.h): what a manifest does not say of its sources itself. A file is believed after its checksum,
 * which the manifest knows, and only if it has sources of the batches that are said to be in files, each once.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "err.h"
#include "grid_block.h"
#include "grid_disk.h"
#include "grid_file.h"
#include "grid_manifest_priv.h"
#include "io.h"
#include "ledger.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

enum { PIECE = 64 << 10 }; /* of a file that is only checked */

static int damaged(const char *name, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "a file of sources is damaged: %s", what);
	err_add_file(err, name);
	return err_add_hint(err, "check the disk, and restore the file: datasets can be meshed without it, but not changed");
}

static int open_file(int dirfd, const struct grid_sources_file *f, int *ret_fd, struct err *err)
{
	struct stat st;
	int fd = -1, rc = grid_file_open(dirfd, f->name, "a file of sources", &fd, err);

	if (rc)
		return rc;
	if (io->fstat(fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		rc = err_add_file(err, f->name);
	} else if (!S_ISREG(st.st_mode) || (uint64_t)st.st_size != f->bytes) {
		rc = damaged(f->name, "it has not the size that the manifest says", err);
	}
	if (rc)
		io_close(fd);
	else
		*ret_fd = fd;
	return rc;
}

/* Checks all but the sources. `said`: the check at the end of the file, `is`: that of its bytes. */
static int check_file(const struct grid_sources_file *f, const uint8_t *head, uint64_t said, uint64_t is, struct err *err)
{
	struct cursor c = cursor_of(head, SOURCES_HEAD);
	const uint8_t *magic = cursor_bytes(&c, 8);
	uint32_t version = cursor_u32(&c), n = cursor_u32(&c);
	uint64_t size = cursor_u64(&c);

	if (memcmp(magic, DISK_SOURCES_MAGIC, 8))
		return damaged(f->name, "it does not begin like one", err);
	if (said != is)
		return damaged(f->name, "its checksum does not agree", err);
	if (!version || version > DISK_SOURCES_VERSION) {
		err_set(err, ERR_VERSION, "a file of sources of version %u; this acut reads versions up to %u", version,
			DISK_SOURCES_VERSION);
		return err_add_file(err, f->name);
	}
	if (said != f->check || n != f->n || size != f->bytes)
		return damaged(f->name, "it is not the one that the manifest names", err);
	return 0;
}

/* Its bytes, checked; to be freed. */
static int read_file(int dirfd, const struct grid_sources_file *f, uint8_t **ret, struct err *err)
{
	const uint64_t end = f->bytes - CHECK_BYTES;
	uint8_t *bytes;
	uint64_t said;
	int fd, rc = open_file(dirfd, f, &fd, err);

	if (rc)
		return rc;
	bytes = malloc(f->bytes);
	rc = bytes ? io_read_at(fd, bytes, f->bytes, 0, f->name, err) :
		     err_set(err, ERR_NOMEM, "no memory for a file of %llu bytes", (unsigned long long)f->bytes);
	io_close(fd);
	if (rc == 0) {
		memcpy(&said, bytes + end, sizeof said);
		rc = check_file(f, bytes, said, grid_check(bytes, end, 0), err);
	}
	if (rc)
		free(bytes);
	else
		*ret = bytes;
	return rc;
}

/* ---- all sources ---- */

/* A batch, and where its sources are among all. */
struct found {
	struct grid_batch *sorted;
	size_t *at;
	struct grid_source *all;
	size_t n;
};

/* Where the source belongs; NULL: it is none of those that are in files. */
static struct grid_source *place_of(const struct found *in, uint32_t id)
{
	const struct grid_batch *b = grid_batches_find(in->sorted, in->n, id);

	return b && b->apart ? &in->all[in->at[b - in->sorted] + (id - b->first)] : NULL;
}

/* Reads the sources of a file into their places. They are ascending. */
static const char *take_file(struct grid_manifest *m, const struct grid_sources_file *f, const uint8_t *bytes,
			     const struct found *to, struct pool *pool)
{
	const struct limits none = {m->nspans, m->nlines};
	struct cursor c = cursor_of(bytes, f->bytes - CHECK_BYTES);
	uint32_t last = 0;

	cursor_skip(&c, SOURCES_HEAD);
	for (uint32_t i = 0; i < f->n; i++) {
		struct grid_source s = {.file = f->check}, *place;

		if (!manifest_unpack_source(&c, m, DISK_SOURCES_LAYOUT, pool, &none, &s))
			return "a source in it is malformed";
		place = place_of(to, s.id);
		if (s.id <= last || !place || place->name)
			return "it has a source that it cannot have";
		last = s.id;
		s.added = place->added;
		s.removed = place->removed;
		s.earlier = place->earlier;
		s.nearlier = place->nearlier;
		*place = s;
	}
	return cursor_left(&c) ? "there are bytes after its end" : NULL;
}

/* The places of all sources, with those that the manifest has itself. */
static int make_places(const struct grid_manifest *m, struct found *ret, struct err *err)
{
	struct found f = {0};
	size_t at = 0, here = 0;

	f.sorted = grid_batches_sorted(m, &f.n);
	f.at = calloc(m->nbatches + 1, sizeof *f.at);
	f.all = calloc(m->nall + 1, sizeof *f.all);
	*ret = f;
	if (!f.sorted || !f.at || !f.all)
		return err_set(err, ERR_NOMEM, "no memory for %llu sources", (unsigned long long)m->nall);
	for (size_t i = 0; i < m->nbatches; i++) {
		const struct grid_batch *b = &m->batches[i];

		f.at[grid_batches_find(f.sorted, f.n, b->first) - f.sorted] = at;
		for (uint32_t k = 0; k < b->n; k++, at++) {
			if (b->apart)
				f.all[at] = (struct grid_source){.id = b->first + k,
								 .added = b->added,
								 .removed = b->removed,
								 .earlier = b->earlier,
								 .nearlier = b->nearlier};
			else
				f.all[at] = m->sources[here++];
		}
	}
	return 0;
}

static void free_places(struct found *f)
{
	free(f->sorted);
	free(f->at);
	free(f->all);
}

/* Bytes of all files, and the largest of them. They must be there before memory is taken. */
static int measure(int dirfd, const struct grid_manifest *m, uint64_t *ret_bytes, uint64_t *ret_largest, struct err *err)
{
	*ret_bytes = *ret_largest = 0;
	for (size_t i = 0; i < m->nfiles; i++) {
		int fd, rc = open_file(dirfd, &m->files[i], &fd, err);

		if (rc)
			return rc;
		io_close(fd);
		*ret_bytes += m->files[i].bytes;
		*ret_largest = m->files[i].bytes > *ret_largest ? m->files[i].bytes : *ret_largest;
	}
	return 0;
}

/* Gives the manifest all sources. If it breaks a rule with them, which is returned, or *ret_nomem, it stays bare. */
static const char *put_sources(struct grid_manifest *m, struct found *to, bool *ret_nomem)
{
	struct grid_source *here = m->sources;
	const size_t nhere = m->nsources;
	const char *fault;

	m->sources = to->all;
	m->nsources = m->nall;
	fault = grid_manifest_check(m, ret_nomem);
	if (fault || *ret_nomem) {
		m->sources = here;
		m->nsources = nhere;
		return fault;
	}
	free(here);
	to->all = NULL;
	m->bare = false;
	return NULL;
}

static int take_files(int dirfd, struct grid_manifest *m, uint64_t bytes, struct found *to, struct err *err)
{
	struct pool pool = {.bytes = malloc(bytes), .room = bytes};
	bool nomem = false;
	int rc = pool.bytes ? 0 : err_set(err, ERR_NOMEM, "no memory for texts of %llu bytes", (unsigned long long)bytes);

	for (size_t i = 0; rc == 0 && i < m->nfiles; i++) {
		uint8_t *of = NULL;
		const char *fault;

		rc = read_file(dirfd, &m->files[i], &of, err);
		fault = rc ? NULL : take_file(m, &m->files[i], of, to, &pool);
		if (fault)
			rc = damaged(m->files[i].name, fault, err);
		free(of);
	}
	if (rc == 0) {
		const char *fault = put_sources(m, to, &nomem);

		if (nomem)
			rc = err_set(err, ERR_NOMEM, "no memory to check a manifest");
		else if (fault)
			rc = damaged(m->files[0].name, fault, err);
	}
	if (rc) {
		free(pool.bytes);
		return rc;
	}
	m->names = pool.bytes;
	m->texts_bytes += pool.used;
	return 0;
}

int grid_manifest_complete(int dirfd, struct grid_manifest *m, struct err *err)
{
	uint64_t bytes, largest, charged, had = m->nsources * sizeof *m->sources;
	struct found places = {0};
	int rc;

	if (!m->bare)
		return 0;
	rc = measure(dirfd, m, &bytes, &largest, err);
	if (rc)
		return rc;
	charged = bytes + largest + m->nall * (sizeof *m->sources + 2 * sizeof(char *)) +
		  m->nbatches * (2 * sizeof *m->batches + sizeof(size_t));
	if (m->ledger && (rc = manifest_charge(m->ledger, charged, m->charged, m->files[0].name, err)))
		return rc;
	rc = make_places(m, &places, err);
	if (rc == 0)
		rc = take_files(dirfd, m, bytes, &places, err);
	free_places(&places);
	if (m->ledger) {
		uint64_t stays = rc ? 0 : bytes + m->nall * sizeof *m->sources - had;

		ledger_give(m->ledger, LEDGER_MANIFEST, charged - stays);
		m->charged += stays;
	}
	return rc;
}

/* The check of the open file's bytes, its head, and the check that it ends with. */
static int check_bytes(int fd, const struct grid_sources_file *f, uint8_t *piece, uint8_t *ret_head, uint64_t *ret_said,
		       uint64_t *ret_is, struct err *err)
{
	const uint64_t end = f->bytes - CHECK_BYTES;
	XXH3_state_t state;
	int rc = 0;

	XXH3_64bits_reset(&state);
	for (uint64_t at = 0; rc == 0 && at < end; at += PIECE) {
		size_t n = end - at < PIECE ? (size_t)(end - at) : PIECE;

		rc = io_read_at(fd, piece, n, at, f->name, err);
		if (rc == 0)
			XXH3_64bits_update(&state, piece, n);
		if (rc == 0 && at == 0)
			memcpy(ret_head, piece, SOURCES_HEAD);
	}
	*ret_is = XXH3_64bits_digest(&state);
	return rc ? rc : io_read_at(fd, ret_said, sizeof *ret_said, end, f->name, err);
}

int grid_sources_verify(int dirfd, const struct grid_manifest *m, size_t file, struct err *err)
{
	const struct grid_sources_file *f = &m->files[file];
	uint8_t head[SOURCES_HEAD] = {0}, *piece;
	uint64_t said = 0, is = 0;
	int fd, rc = open_file(dirfd, f, &fd, err);

	if (rc)
		return rc;
	piece = malloc(PIECE);
	rc = piece ? check_bytes(fd, f, piece, head, &said, &is, err) : err_set(err, ERR_NOMEM, "no memory to check a file");
	free(piece);
	io_close(fd);
	return rc ? rc : check_file(f, head, said, is, err);
}
