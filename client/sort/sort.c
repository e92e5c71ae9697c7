/*
 * External sort: records of a few 64-bit words, ordered by the first `keys` of them.
 *
 * Records gather in one buffer; full, it is sorted in place (by bytes from the top, small pieces by
 * insertion) and written to a nameless file as a run. Reading merges the runs with a heap; their buffers
 * share the same memory. Runs that are too many for that are merged to fewer, longer ones in a second file, which takes the
 * place of the first, as often as needed. What fits the buffer never touches the disk. Equal keys come out in any order.
 *
 * An interruption is looked at before a run is written and before a part of a run is read, so never later than one buffer takes.
 * The files have no names: what was sorted is gone when the sort is freed.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outfile.h"
#include "sort.h"

#define SORT_WORDS 6
#define SORT_RUN_LEAST 4096 /* bytes a run's buffer has at least */
#define SORT_FIRST 1024     /* records that there is memory for at first */

struct run {
	uint64_t at, end; /* what is still in the file, bytes */
	uint64_t *buf;
	size_t next, have; /* records in buf */
};

struct sort {
	unsigned words, keys;
	const struct outfile *beside;
	struct outfile *spool;
	uint64_t *buf;
	size_t room, used; /* records */
	size_t have;       /* that buf has memory for; it grows up to room before the first run */
	struct run *run;
	size_t nrun, run_room;
	uint32_t *heap;
	size_t nheap;
	size_t share; /* records of the buffer that each run has while it is merged */
	size_t next;  /* without runs: the next record of buf */
	int (*interrupted)(void *ctx);
	void *ctx;
};

static int compare(const struct sort *s, const uint64_t *a, const uint64_t *b)
{
	for (unsigned i = 0; i < s->keys; i++)
		if (a[i] != b[i])
			return a[i] < b[i] ? -1 : 1;
	return 0;
}

static void insertion(const struct sort *s, uint64_t *rec, size_t n)
{
	size_t size = s->words * sizeof(uint64_t);
	uint64_t hold[SORT_WORDS];

	for (size_t i = 1; i < n; i++) {
		size_t j = i;

		memcpy(hold, rec + i * s->words, size);
		for (; j && compare(s, hold, rec + (j - 1) * s->words) < 0; j--)
			memcpy(rec + j * s->words, rec + (j - 1) * s->words, size);
		memcpy(rec + j * s->words, hold, size);
	}
}

static unsigned byte_of(const uint64_t *rec, unsigned byte)
{
	return rec[byte >> 3] >> (56 - 8 * (byte & 7)) & 255;
}

/* Records that agree in all bytes before `byte`: put into 256 places by that byte, each sorted further. */
static void sort_bytes(const struct sort *s, uint64_t *rec, size_t n, unsigned byte)
{
	size_t at[256] = {0}, end[256], sum = 0, size = s->words * sizeof(uint64_t);
	uint64_t hold[SORT_WORDS];

	if (n < 48 || byte == 8 * s->keys) {
		if (byte < 8 * s->keys)
			insertion(s, rec, n);
		return;
	}
	for (size_t i = 0; i < n; i++)
		at[byte_of(rec + i * s->words, byte)]++;
	for (unsigned b = 0; b < 256; b++) {
		sum += at[b];
		end[b] = sum;
		at[b] = sum - at[b];
	}
	for (unsigned b = 0; b < 256; b++) {
		while (at[b] < end[b]) {
			uint64_t *here = rec + at[b] * s->words, *there;
			unsigned to = byte_of(here, byte);
			if (to == b) {
				at[b]++;
				continue;
			}
			there = rec + at[to]++ * s->words;
			memcpy(hold, there, size);
			memcpy(there, here, size);
			memcpy(here, hold, size);
		}
	}
	for (unsigned b = 0; b < 256; b++) {
		size_t start = b ? end[b - 1] : 0;
		if (end[b] - start > 1)
			sort_bytes(s, rec + start * s->words, end[b] - start, byte + 1);
	}
}

int sort_new(unsigned words, unsigned keys, uint64_t memory, const struct outfile *beside, struct sort **ret, struct err *err)
{
	struct sort *s = calloc(1, sizeof(*s));

	if (s) {
		s->words = words;
		s->keys = keys;
		s->beside = beside;
		s->room = (size_t)(memory / (words * sizeof(uint64_t)));
		if (s->room < 2 * SORT_RUN_LEAST / sizeof(uint64_t))
			s->room = 2 * SORT_RUN_LEAST / sizeof(uint64_t);
	}
	if (!s)
		return err_set(err, ERR_NOMEM, "no memory to sort with");
	*ret = s;
	return 0;
}

void sort_interrupt(struct sort *s, int (*interrupted)(void *ctx), void *ctx)
{
	s->interrupted = interrupted;
	s->ctx = ctx;
}

static int look(const struct sort *s, struct err *err)
{
	return s->interrupted && s->interrupted(s->ctx) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

/* Sorts the buffer and writes it out as one run. */
static int spill(struct sort *s, struct err *err)
{
	struct run *r;
	int rc = look(s, err);

	if (rc)
		return rc;
	if (s->nrun == s->run_room) {
		size_t room = s->run_room ? 2 * s->run_room : 64;
		void *grown = realloc(s->run, room * sizeof(*s->run));
		if (!grown)
			return err_set(err, ERR_NOMEM, "no memory to sort with");
		s->run = grown;
		s->run_room = room;
	}
	if (!s->spool)
		rc = outfile_spool(s->beside, &s->spool, err);
	if (rc)
		return rc;
	sort_bytes(s, s->buf, s->used, 0);
	r = &s->run[s->nrun++];
	*r = (struct run){.at = outfile_size(s->spool)};
	rc = outfile_write(s->spool, s->buf, s->used * s->words * sizeof(uint64_t), err);
	r->end = outfile_size(s->spool);
	s->used = 0;
	return rc;
}

static int grow(struct sort *s, struct err *err)
{
	size_t have = s->have ? 2 * s->have : SORT_FIRST;
	void *grown;

	have = have < s->room ? have : s->room;
	grown = realloc(s->buf, have * s->words * sizeof(uint64_t));
	if (!grown)
		return err_set(err, ERR_NOMEM, "no memory to sort with");
	s->buf = grown;
	s->have = have;
	return 0;
}

int sort_add(struct sort *s, const uint64_t *record, struct err *err)
{
	int r = s->used < s->have ? 0 : s->have < s->room ? grow(s, err) : spill(s, err);

	if (r)
		return r;
	memcpy(s->buf + s->used++ * s->words, record, s->words * sizeof(uint64_t));
	return 0;
}

/* Fills a run's buffer from the file; have == 0 afterwards: the run has ended. */
static int refill(struct sort *s, struct run *r, struct err *err)
{
	size_t size = s->words * sizeof(uint64_t);
	uint64_t left = (r->end - r->at) / size;
	size_t n = left < s->share ? (size_t)left : s->share;
	int rc = n ? look(s, err) : 0;

	if (n && !rc)
		rc = outfile_read(s->spool, r->at, r->buf, n * size, err);
	if (rc)
		return rc;
	r->at += n * size;
	r->next = 0;
	r->have = n;
	return 0;
}

static const uint64_t *top_of(const struct sort *s, size_t heap)
{
	const struct run *r = &s->run[s->heap[heap]];

	return r->buf + r->next * s->words;
}

static void sift(struct sort *s, size_t i)
{
	for (;;) {
		size_t c = 2 * i + 1;
		uint32_t t;

		if (c >= s->nheap)
			return;
		if (c + 1 < s->nheap && compare(s, top_of(s, c + 1), top_of(s, c)) < 0)
			c++;
		if (compare(s, top_of(s, i), top_of(s, c)) <= 0)
			return;
		t = s->heap[i];
		s->heap[i] = s->heap[c];
		s->heap[c] = t;
		i = c;
	}
}

/* Begins to merge n runs from `first` on. */
static int merge(struct sort *s, size_t first, size_t n, struct err *err)
{
	int r = 0;

	s->share = s->room / n;
	s->nheap = 0;
	for (size_t i = 0; i < n && !r; i++) {
		struct run *run = &s->run[first + i];

		run->buf = s->buf + i * s->share * s->words;
		r = refill(s, run, err);
		s->heap[s->nheap++] = (uint32_t)(first + i);
	}
	for (size_t i = s->nheap / 2; i-- && !r;)
		sift(s, i);
	return r;
}

/* Past the top of the heap. */
static int step(struct sort *s, struct err *err)
{
	struct run *r = &s->run[s->heap[0]];

	if (++r->next == r->have) {
		int rc = refill(s, r, err);
		if (rc)
			return rc;
		if (!r->have)
			s->heap[0] = s->heap[--s->nheap];
	}
	sift(s, 0);
	return 0;
}

/* Merges runs, `most` to one, into a new file. */
static int pass(struct sort *s, size_t most, struct err *err)
{
	struct outfile *to = NULL;
	size_t runs = 0;
	int r = outfile_spool(s->beside, &to, err);

	for (size_t first = 0, n; first < s->nrun && !r; first += n) {
		struct run merged = {.at = outfile_size(to)};

		n = s->nrun - first < most ? s->nrun - first : most;
		r = merge(s, first, n, err);
		while (!r && s->nheap) {
			r = outfile_write(to, top_of(s, 0), s->words * sizeof(uint64_t), err);
			if (!r)
				r = step(s, err);
		}
		merged.end = outfile_size(to);
		s->run[runs++] = merged; /* of runs that have been read */
	}
	if (r) {
		outfile_free(to);
		return r;
	}
	outfile_free(s->spool);
	s->spool = to;
	s->nrun = runs;
	return 0;
}

int sort_start(struct sort *s, struct err *err)
{
	size_t most = s->room * s->words * sizeof(uint64_t) / SORT_RUN_LEAST;
	int r;

	if (!s->nrun) {
		sort_bytes(s, s->buf, s->used, 0);
		return 0;
	}
	r = s->used ? spill(s, err) : 0;
	if (r)
		return r;
	s->heap = malloc((s->nrun < most ? s->nrun : most) * sizeof(*s->heap));
	if (!s->heap)
		return err_set(err, ERR_NOMEM, "no memory to sort with");
	while (s->nrun > most && !r)
		r = pass(s, most, err);
	if (!r)
		r = merge(s, 0, s->nrun, err);
	s->next = SIZE_MAX; /* nothing handed out yet */
	return r;
}

int sort_next(struct sort *s, const uint64_t **ret, struct err *err)
{
	if (!s->nrun) {
		*ret = s->next < s->used ? s->buf + s->next++ * s->words : NULL;
		return 0;
	}
	if (s->next == SIZE_MAX) {
		s->next = 0;
	} else if (s->nheap) {
		int r = step(s, err);
		if (r)
			return r;
	}
	*ret = s->nheap ? top_of(s, 0) : NULL;
	return 0;
}

struct sort *sort_free(struct sort *s)
{
	if (!s)
		return NULL;
	outfile_free(s->spool);
	free(s->buf);
	free(s->run);
	free(s->heap);
	free(s);
	return NULL;
}
