/*
 * Manifests (grid.h): one checksummed file that alone describes a dataset. Written whole, read whole,
 * believed only after the checksum and then every rule (grid_manifest_check.c) hold; the same rules hold for
 * what is written.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "grid_block.h"
#include "grid_disk.h"
#include "grid_file.h"
#include "grid_manifest_priv.h"
#include "io.h"
#include "ledger.h"
#include "point.h"

bool manifest_unpack_text(struct cursor *c, char *ret, size_t size)
{
	size_t n = cursor_u16(c);
	const uint8_t *bytes = n < size ? cursor_bytes(c, n) : NULL;

	if (n && (!bytes || memchr(bytes, 0, n)))
		return false;
	if (n)
		memcpy(ret, bytes, n);
	ret[n] = 0;
	return !c->bad;
}

/* Before version 8: the keys of the corners of the box are all that is known. */
static void unpack_range(struct cursor *c, uint32_t version, struct grid_segment_info *ret)
{
	if (version >= 8) {
		ret->lo = cursor_u64(c);
		ret->hi = cursor_u64(c);
	} else if (ret->points) {
		ret->lo = point_morton(ret->box[0], ret->box[1]);
		ret->hi = point_morton(ret->box[2], ret->box[3]);
	}
}

static bool unpack_segment(struct cursor *c, uint32_t version, struct grid_segment_info *ret)
{
	int last = -1;

	if (!manifest_unpack_text(c, ret->file, sizeof ret->file))
		return false;
	ret->points = cursor_u64(c);
	ret->cells = cursor_u64(c);
	ret->bytes = cursor_u64(c);
	for (unsigned i = 0; i < 4; i++)
		ret->box[i] = cursor_i32(c);
	ret->sum.hi = cursor_u64(c);
	ret->sum.lo = cursor_u64(c);
	for (unsigned n = cursor_u16(c); n && !c->bad; n--) {
		int cls = cursor_u8(c);
		uint64_t count = cursor_u64(c);

		if (cls <= last || !count)
			return false;
		ret->classes[cls] = count;
		last = cls;
	}
	unpack_range(c, version, ret);
	return !c->bad;
}

/* Unpacks a text of less than `size` bytes and appends it to the pool. */
static bool unpack_long_text(struct cursor *c, struct pool *pool, size_t size, const char **ret)
{
	char *to = pool->bytes + pool->used;
	size_t room = pool->room - pool->used;

	if (!room || !manifest_unpack_text(c, to, size < room ? size : room))
		return false;
	*ret = to;
	pool->used += strlen(to) + 1;
	return true;
}

bool manifest_unpack_spans(struct cursor *c, struct grid_manifest *m, size_t most, const struct grid_span **ret, size_t *ret_n)
{
	*ret_n = cursor_u16(c);
	if (*ret_n > most - m->nspans)
		return false;
	*ret = m->spans + m->nspans;
	for (size_t i = 0; i < *ret_n; i++) {
		struct grid_span *span = &m->spans[m->nspans++];

		span->added = cursor_u64(c);
		span->removed = cursor_u64(c);
	}
	return !c->bad;
}

static bool unpack_lines(struct cursor *c, struct grid_manifest *m, const struct limits *limits, struct grid_source *ret)
{
	struct grid_lines *lines = &m->lines[m->nlines];

	ret->kind = cursor_u8(c);
	if (ret->kind == GRID_POINTS)
		return !c->bad;
	if (m->nlines == limits->lines)
		return false;
	m->nlines++;
	for (unsigned i = 0; i < GRID_LINE_KINDS; i++)
		lines->features[i] = cursor_u64(c);
	lines->lines = cursor_u64(c);
	lines->vertices = cursor_u64(c);
	lines->bytes = cursor_u64(c);
	lines->places = cursor_u64(c);
	lines->content.hi = cursor_u64(c);
	lines->content.lo = cursor_u64(c);
	ret->lines = lines;
	return !c->bad;
}

bool manifest_unpack_source(struct cursor *c, struct grid_manifest *m, uint32_t version, struct pool *pool,
			    const struct limits *limits, struct grid_source *ret)
{
	ret->id = cursor_u32(c);
	if (version < 9) {
		ret->added = cursor_u64(c);
		ret->removed = cursor_u64(c);
	}
	ret->points = cursor_u64(c);
	ret->hash.hi = cursor_u64(c);
	ret->hash.lo = cursor_u64(c);
	if (!unpack_long_text(c, pool, GRID_SOURCE_NAME, &ret->name))
		return false;
	ret->path = ret->overridden = ret->reading = "";
	if (version < 2)
		return !c->bad;
	ret->size = cursor_u64(c);
	ret->mtime_ns = (int64_t)cursor_u64(c);
	if (!unpack_long_text(c, pool, GRID_SOURCE_PATH, &ret->path))
		return false;
	if (version >= 4 && version < 9 && !manifest_unpack_spans(c, m, limits->spans, &ret->earlier, &ret->nearlier))
		return false;
	if (version < 5)
		return !c->bad;
	if (!unpack_long_text(c, pool, GRID_SOURCE_OVERRIDDEN, &ret->overridden))
		return false;
	ret->left_out = cursor_u64(c);
	if (!unpack_long_text(c, pool, GRID_SOURCE_READING, &ret->reading))
		return false;
	return version < 7 || unpack_lines(c, m, limits, ret);
}

static bool unpack_generation(struct cursor *c, struct pool *pool, uint32_t version, struct grid_generation *ret)
{
	ret->number = cursor_u64(c);
	ret->time_us = (int64_t)cursor_u64(c);
	ret->uid = cursor_u32(c);
	ret->kind = cursor_u8(c);
	ret->undoes = cursor_u64(c);
	ret->files = cursor_u32(c);
	ret->files_removed = cursor_u32(c);
	ret->points_added = cursor_u64(c);
	ret->points_removed = cursor_u64(c);
	if (version >= 7) {
		ret->lines_added = cursor_u64(c);
		ret->lines_removed = cursor_u64(c);
	}
	ret->content.hi = cursor_u64(c);
	ret->content.lo = cursor_u64(c);
	return unpack_long_text(c, pool, GRID_USER, &ret->user) && !c->bad;
}

static bool unpack_wkt(struct cursor *c, struct grid_manifest *m, uint32_t version, struct pool *pool)
{
	m->wkt = "";
	if (version < 6)
		return true;
	if (!unpack_long_text(c, pool, GRID_WKT, &m->wkt))
		return false;
	m->wkt_since = cursor_u64(c);
	return !c->bad;
}

/* Allocates m->texts for the rest of the file: each text takes a zero instead of two bytes of length. */
static const char *alloc_texts(const struct cursor *c, uint32_t version, struct grid_manifest *m, struct pool *ret)
{
	size_t each = version < 2 ? SOURCE_LEAST - 1 :
				    SOURCE_LEAST + SOURCE_MORE - 2 + (version < 4 ? 0 : SOURCE_SPANS) +
					    (version < 5 ? 0 : SOURCE_READ - 2) + (version < 7 ? 0 : SOURCE_KIND);

	if (version >= 9)
		each = SOURCE_LAST - 4;

	if (m->nsources > cursor_left(c) / each)
		return "its counts exceed its size";
	*ret = (struct pool){.room = cursor_left(c) - m->nsources * each};
	m->texts = ret->bytes = malloc(ret->room + 1);
	return NULL;
}

/* Counts come from the file, so they are bounded by its size before they are used. */
static bool unpack_counts(struct cursor *c, uint32_t version, struct grid_manifest *m, struct limits *ret)
{
	size_t nsegments, nsources, ngenerations = 0, nfiles = 0, nbatches = 0;

	*ret = (struct limits){0};
	m->generation = cursor_u64(c);
	nsegments = cursor_u32(c);
	nsources = cursor_u32(c);
	if (version >= 4) {
		m->oldest = cursor_u64(c);
		ngenerations = cursor_u32(c);
		ret->spans = cursor_u32(c);
	}
	if (version >= 7)
		ret->lines = cursor_u32(c);
	if (version >= 9) {
		nfiles = cursor_u32(c);
		nbatches = cursor_u32(c);
	}
	if (c->bad || nsegments > cursor_left(c) / SEGMENT_LEAST || nsources > cursor_left(c) / SOURCE_LEAST ||
	    ngenerations > cursor_left(c) / GENERATION_LEAST || ret->spans > cursor_left(c) / SPAN_BYTES ||
	    ret->lines > cursor_left(c) / LINES_BYTES || nfiles > GRID_SOURCES_FILES || nfiles > cursor_left(c) / FILE_LEAST ||
	    nbatches > cursor_left(c) / BATCH_LEAST)
		return false;
	m->nfiles = nfiles;
	m->nbatches = nbatches;
	m->nsegments = nsegments;
	m->nsources = nsources;
	m->ngenerations = ngenerations;
	return true;
}

static const char *unpack_generations(struct cursor *c, uint32_t version, struct grid_manifest *m, struct pool *pool,
				      bool *ret_nomem)
{
	if (version < 4) {
		*ret_nomem = !grid_manifest_derive(m);
		return NULL;
	}
	m->generations = calloc(m->ngenerations + 1, sizeof *m->generations);
	*ret_nomem = !m->generations;
	for (size_t i = 0; m->generations && i < m->ngenerations; i++)
		if (!unpack_generation(c, pool, version, &m->generations[i]))
			return "a generation in it is malformed";
	return NULL;
}

static const char *unpack_head(struct cursor *c, uint32_t version, struct grid_manifest *m, struct limits *ret)
{
	char lattice[LATTICE_TEXT_SIZE], again[LATTICE_TEXT_SIZE];

	if (!unpack_counts(c, version, m, ret))
		return "its counts exceed its size";
	if (!manifest_unpack_text(c, lattice, sizeof lattice) || !manifest_unpack_text(c, m->crs, sizeof m->crs) ||
	    !manifest_unpack_text(c, m->unit_xy, sizeof m->unit_xy) || !manifest_unpack_text(c, m->unit_z, sizeof m->unit_z))
		return "a text in it is malformed";
	return !lattice_parse(lattice, &m->lattice) || strcmp(lattice_text(&m->lattice, again), lattice) ?
		       "its lattice is malformed" :
		       NULL;
}

static bool alloc_tables(struct grid_manifest *m, const struct limits *limits)
{
	m->segments = calloc(m->nsegments + 1, sizeof *m->segments);
	m->sources = calloc(m->nsources + 1, sizeof *m->sources);
	m->spans = calloc(limits->spans + 1, sizeof *m->spans);
	m->lines = calloc(limits->lines + 1, sizeof *m->lines);
	m->files = calloc(m->nfiles + 1, sizeof *m->files);
	m->batches = calloc(m->nbatches + 1, sizeof *m->batches);
	return m->segments && m->sources && m->spans && m->lines && m->files && m->batches;
}

static const char *unpack_sources(struct cursor *c, uint32_t version, struct grid_manifest *m, const struct limits *limits,
				  struct pool *pool)
{
	for (size_t i = 0; i < m->nsources; i++)
		if (!manifest_unpack_source(c, m, version, pool, limits, &m->sources[i]))
			return "a source in it is malformed";
	if (m->nspans != limits->spans || m->nlines != limits->lines)
		return "its sources have fewer spans or lines than it says";
	return version >= 9 ? manifest_take_lives(m) : NULL;
}

/* NULL, or what is wrong with the file; *ret_nomem: there was no memory. */
static const char *unpack(struct cursor *c, uint32_t version, struct grid_manifest *m, bool *ret_nomem)
{
	struct limits limits;
	struct pool pool = {0};
	const char *fault = unpack_head(c, version, m, &limits);

	*ret_nomem = !fault && !alloc_tables(m, &limits);
	for (size_t i = 0; !fault && !*ret_nomem && i < m->nsegments; i++)
		if (!unpack_segment(c, version, &m->segments[i]))
			fault = "a segment in it is malformed";
	if (!fault && !*ret_nomem && version >= 9)
		fault = manifest_unpack_batches(c, m, &limits);
	if (!fault && !*ret_nomem) {
		fault = alloc_texts(c, version, m, &pool);
		*ret_nomem = !fault && !m->texts;
	}
	if (!fault && !*ret_nomem)
		fault = unpack_sources(c, version, m, &limits, &pool);
	if (fault || *ret_nomem)
		return fault ? fault : "no memory";
	if (version < 9) {
		free(m->batches);
		m->batches = manifest_batches_of(m->sources, m->nsources, NULL, &m->nbatches);
		m->nall = m->nsources;
		if ((*ret_nomem = !m->batches))
			return "no memory";
	}
	if (version >= 3 &&
	    (!manifest_unpack_text(c, m->geoid, sizeof m->geoid) || !manifest_unpack_text(c, m->choices, sizeof m->choices)))
		return "a text in it is malformed";
	if (!unpack_wkt(c, m, version, &pool))
		return "its coordinate system is malformed";
	fault = unpack_generations(c, version, m, &pool, ret_nomem);
	if (fault || *ret_nomem)
		return fault ? fault : "no memory";
	if (cursor_left(c))
		return "there are bytes after its end";
	m->texts_bytes = pool.used;
	m->bare = m->nfiles > 0;
	fault = manifest_batches_fault(m, ret_nomem);
	return fault || *ret_nomem ? fault : grid_manifest_check(m, ret_nomem);
}

int manifest_damaged(const char *name, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the manifest is damaged: %s", what);
	err_add_file(err, name);
	return err_add_hint(err, "check the disk, and restore the file or push the data again");
}

static int parse(const uint8_t *bytes, size_t n, const char *name, struct grid_manifest **ret, struct err *err)
{
	struct cursor c = cursor_of(bytes, n);
	const uint8_t *magic = cursor_bytes(&c, 8);
	uint32_t version = cursor_u32(&c), zero = cursor_u32(&c);
	uint64_t size = cursor_u64(&c), check;
	bool nomem = false;

	if (c.bad || n < HEAD_BYTES + CHECK_BYTES || memcmp(magic, DISK_MANIFEST_MAGIC, 8) || zero)
		return manifest_damaged(name, "it does not begin like a manifest", err);
	memcpy(&check, bytes + n - CHECK_BYTES, sizeof check);
	if (size != n || check != grid_check(bytes, n - CHECK_BYTES, 0))
		return manifest_damaged(name, "its checksum does not agree", err);
	if (!version || version > DISK_MANIFEST_VERSION) {
		err_set(err, ERR_VERSION, "a manifest of version %u; this acut reads versions up to %u", version,
			DISK_MANIFEST_VERSION);
		return err_add_file(err, name);
	}
	c.end -= CHECK_BYTES;
	struct grid_manifest *m = calloc(1, sizeof *m);
	const char *fault = m ? unpack(&c, version, m, &nomem) : "no memory";

	if (!fault && !nomem) {
		*ret = m;
		return 0;
	}
	if (!m || nomem)
		err_set(err, ERR_NOMEM, "no memory for a manifest of %zu bytes", n);
	else
		manifest_damaged(name, fault, err);
	grid_manifest_free(m);
	return -(int)err->code;
}

/* An upper bound of the memory for reading it: the file, its texts, a table of names to search for repeats (twice, for
 * sorting), and the tables. Counts come from the file, so they are bounded by its size before they are used. */
static int bytes_to_read(int fd, const char *name, uint64_t size, uint64_t *ret, struct err *err)
{
	uint8_t head[HEAD_BYTES + HEAD_MORE + HEAD_LINES + HEAD_APART] = {0};
	size_t n = size < sizeof head ? (size_t)size : sizeof head; /* one of an older version may be smaller */
	int rc = io_read_at(fd, head, n, 0, name, err);
	struct cursor c = cursor_of(head, sizeof head);
	uint64_t nsegments, nsources, generation, ngenerations, nspans = 0, nlines = 0, nfiles = 0, nbatches;
	uint32_t version;

	if (rc)
		return rc;
	cursor_bytes(&c, 8);
	version = cursor_u32(&c);
	/* The layout of a newer version is unknown; it is rejected later, after its checksum was checked. */
	if (version > DISK_MANIFEST_VERSION) {
		*ret = 2 * size;
		return 0;
	}
	cursor_bytes(&c, 4 + 8);
	generation = cursor_u64(&c);
	nsegments = cursor_u32(&c);
	nsources = cursor_u32(&c);
	/* Derived generations are those that added or removed a source. */
	ngenerations = generation < 2 * nsources ? generation : 2 * nsources;
	if (version >= 4) {
		cursor_u64(&c);
		ngenerations = cursor_u32(&c);
		nspans = cursor_u32(&c);
	}
	if (version >= 7)
		nlines = cursor_u32(&c);
	nbatches = nsources;
	if (version >= 9) {
		nfiles = cursor_u32(&c);
		nbatches = cursor_u32(&c);
	}
	if (nsegments > size / SEGMENT_LEAST || nsources > size / SOURCE_LEAST || nspans > size / SPAN_BYTES ||
	    nlines > size / LINES_BYTES || nfiles > GRID_SOURCES_FILES || nbatches > size / BATCH_LEAST ||
	    (version >= 4 && ngenerations > size / GENERATION_LEAST))
		return manifest_damaged(name, "its counts exceed its size", err);
	*ret = sizeof(struct grid_manifest) + 2 * size + nsegments * sizeof(struct grid_segment_info) +
	       nsources * sizeof(struct grid_source) + 2 * (nsegments + nsources + 1) * sizeof(char *) +
	       ngenerations * sizeof(struct grid_generation) + nspans * sizeof(struct grid_span) +
	       nlines * sizeof(struct grid_lines) + nfiles * sizeof(struct grid_sources_file) +
	       nbatches * 3 * sizeof(struct grid_batch);
	return 0;
}

int manifest_charge(struct ledger *ledger, uint64_t bytes, uint64_t had, const char *name, struct err *err)
{
	const uint64_t all = had + bytes;

	if (ledger_take(ledger, LEDGER_MANIFEST, bytes))
		return 0;
	if (all > ledger_total(ledger) / 2) {
		err_set(err, ERR_LIMIT, "the manifest takes %llu MiB to read, of a memory of %llu MiB",
			(unsigned long long)(all >> 20), (unsigned long long)(ledger_total(ledger) >> 20));
		err_add_hint(err, "give acutd --memory %lluM or more", (unsigned long long)(all >> 18));
	} else {
		err_set(err, ERR_BUSY, "no %llu KiB are free for the manifest of the dataset", (unsigned long long)(bytes >> 10));
		err_add_hint(err, "try again when other jobs are done, or give acutd more memory");
	}
	return err_add_file(err, name);
}

/* Uncharges what was needed only while reading. */
static void settle_charge(struct grid_manifest *m, struct ledger *ledger, uint64_t bytes, uint64_t size)
{
	m->ledger = ledger;
	m->charged = sizeof *m + size + m->nsegments * sizeof *m->segments + m->nsources * sizeof *m->sources +
		     m->ngenerations * sizeof *m->generations + m->nspans * sizeof *m->spans + m->nlines * sizeof *m->lines +
		     m->nfiles * sizeof *m->files + m->nbatches * sizeof *m->batches;
	ledger_give(ledger, LEDGER_MANIFEST, bytes - m->charged);
}

int grid_manifest_load_bare(int dirfd, const char *name, struct ledger *ledger, struct grid_manifest **ret, struct err *err)
{
	struct grid_manifest *m = NULL;
	uint64_t charged = 0;
	uint8_t *bytes = NULL;
	struct stat st;
	int fd = -1, rc = grid_file_open(dirfd, name, "the manifest", &fd, err);

	if (rc)
		return rc;
	if (io->fstat(fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		rc = err_add_file(err, name);
	} else if (!S_ISREG(st.st_mode) || st.st_size < HEAD_BYTES + HEAD_MORE + HEAD_LINES ||
		   (uint64_t)st.st_size > MANIFEST_MOST) {
		rc = manifest_damaged(name, "its size is impossible", err);
	} else if (ledger && ((rc = bytes_to_read(fd, name, (uint64_t)st.st_size, &charged, err)) ||
			      (rc = manifest_charge(ledger, charged, 0, name, err)))) {
		charged = 0;
	} else if (!(bytes = malloc((size_t)st.st_size))) {
		rc = err_set(err, ERR_NOMEM, "no memory for a manifest of %lld bytes", (long long)st.st_size);
	}
	if (rc == 0)
		rc = io_read_at(fd, bytes, (size_t)st.st_size, 0, name, err);
	if (rc == 0)
		rc = parse(bytes, (size_t)st.st_size, name, &m, err);
	free(bytes);
	io_close(fd);
	if (charged && rc)
		ledger_give(ledger, LEDGER_MANIFEST, charged);
	else if (charged)
		settle_charge(m, ledger, charged, (uint64_t)st.st_size);
	if (rc == 0)
		*ret = m;
	return rc;
}

int grid_manifest_load(int dirfd, const char *name, struct ledger *ledger, struct grid_manifest **ret, struct err *err)
{
	struct grid_manifest *m = NULL;
	int rc = grid_manifest_load_bare(dirfd, name, ledger, &m, err);

	if (rc == 0)
		rc = grid_manifest_complete(dirfd, m, err);
	if (rc)
		grid_manifest_free(m);
	else
		*ret = m;
	return rc;
}

int grid_manifest_read(int dirfd, const char *name, struct grid_manifest **ret, struct err *err)
{
	return grid_manifest_load(dirfd, name, NULL, ret, err);
}

const char *grid_manifest_wkt(const struct grid_manifest *m, uint64_t generation)
{
	return m->wkt && m->wkt_since <= generation ? m->wkt : "";
}

struct grid_manifest *grid_manifest_free(struct grid_manifest *m)
{
	if (!m)
		return NULL;
	free(m->segments);
	free(m->sources);
	free(m->generations);
	free(m->spans);
	free(m->lines);
	free(m->files);
	free(m->batches);
	free(m->texts);
	free(m->names);
	if (m->charged)
		ledger_give(m->ledger, LEDGER_MANIFEST, m->charged);
	free(m);
	return NULL;
}
