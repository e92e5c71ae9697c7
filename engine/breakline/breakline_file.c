/*
 * Files of lines (breakline.h): the vertices of one source in the order of its input, in pages with checksums. They are what is
 * kept of lines, since rounding the result of snap rounding once more may change it.
 */
#include "breakline_file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "grid_file.h"
#include "io.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are written as they lie in memory");

enum { BUFFER = 16 * BREAKLINE_PAGE };

const char *breakline_kind_text(enum breakline_kind kind)
{
	static const char *const text[BREAKLINE_KINDS] = {"hard", "lake", "boundary", "hole"};

	return (unsigned)kind < BREAKLINE_KINDS ? text[kind] : "unknown";
}

/* Whether the vertex may follow one of that kind; `first`: nothing is before it. */
static bool is_possible(const struct breakline_vertex *v, bool first, uint8_t kind)
{
	bool feature = v->bits & BREAKLINE_FEATURE, line = v->bits & BREAKLINE_LINE, ring = v->bits & BREAKLINE_RING;

	if (v->bits > (BREAKLINE_FEATURE | BREAKLINE_LINE | BREAKLINE_RING) || v->kind >= BREAKLINE_KINDS || v->reserved)
		return false;
	return (feature || (!first && v->kind == kind)) && (line || (!feature && !ring));
}

static void totals_add(struct breakline_totals *t, const struct breakline_vertex *v)
{
	const int32_t box[4] = {v->x, v->y, v->x, v->y};

	if (t->vertices++)
		point_box_join(t->box, box);
	else
		memcpy(t->box, box, sizeof box);
	t->lines += (v->bits & BREAKLINE_LINE) != 0;
	t->features[v->kind] += (v->bits & BREAKLINE_FEATURE) != 0;
}

/* ---- writing ---- */

struct breakline_writer {
	struct grid_file file;
	uint8_t *buffer;
	struct digest_stream *content;
	struct breakline_totals totals;
	struct breakline_vertex page[BREAKLINE_PAGE_VERTICES];
	uint32_t n;
	uint8_t kind; /* of the last vertex */
};

int breakline_writer_new(int dirfd, const char *name, struct breakline_writer **ret, struct err *err)
{
	static const uint8_t none[BREAKLINE_PAGE];
	struct breakline_writer *w = calloc(1, sizeof *w);
	int rc;

	if (!w)
		return err_set(err, ERR_NOMEM, "no memory to write lines");
	w->file = GRID_FILE_INIT;
	w->buffer = malloc(BUFFER);
	w->content = digest_stream_new();
	if (w->buffer && w->content)
		rc = grid_file_create(&w->file, dirfd, name, w->buffer, BUFFER, err);
	else
		rc = err_set(err, ERR_NOMEM, "no memory to write lines");
	if (rc == 0)
		rc = grid_file_append(&w->file, none, sizeof none, err);
	if (rc) {
		breakline_writer_free(w);
		return rc;
	}
	*ret = w;
	return 0;
}

static int flush_page(struct breakline_writer *w, struct err *err)
{
	_Alignas(8) uint8_t page[BREAKLINE_PAGE] = {0};
	struct breakline_page *head = (struct breakline_page *)page;

	if (!w->n)
		return 0;
	head->vertices = w->n;
	memcpy(head + 1, w->page, w->n * sizeof *w->page);
	digest_stream_add(w->content, w->page, w->n * sizeof *w->page);
	head->check = grid_check(page + 8, sizeof page - 8, grid_file_place(&w->file));
	w->n = 0;
	return grid_file_append(&w->file, page, sizeof page, err);
}

int breakline_write(struct breakline_writer *w, const struct breakline_vertex *v, size_t n, struct err *err)
{
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < n; i++) {
		if (!is_possible(&v[i], w->totals.vertices == 0, w->kind))
			return err_set(err, ERR_INTERNAL, "a vertex of a line cannot follow the one before it");
		totals_add(&w->totals, &v[i]);
		w->kind = v[i].kind;
		w->page[w->n++] = v[i];
		if (w->n == BREAKLINE_PAGE_VERTICES)
			rc = flush_page(w, err);
	}
	return rc;
}

int breakline_writer_finish(struct breakline_writer *w, struct breakline_totals *ret, struct err *err)
{
	struct breakline_head h = {.magic = BREAKLINE_MAGIC, .version = BREAKLINE_VERSION, .page_bytes = BREAKLINE_PAGE};
	int rc = flush_page(w, err);

	w->totals.content = digest_stream_end(w->content);
	h.vertices = w->totals.vertices;
	h.lines = w->totals.lines;
	memcpy(h.features, w->totals.features, sizeof h.features);
	memcpy(h.box, w->totals.box, sizeof h.box);
	h.content_hi = w->totals.content.hi;
	h.content_lo = w->totals.content.lo;
	h.check = grid_check((const uint8_t *)&h + 8, sizeof h - 8, 0);
	if (rc == 0)
		rc = grid_file_patch(&w->file, 0, &h, sizeof h, err);
	if (rc == 0)
		rc = grid_file_publish(&w->file, GRID_DURABLE, err);
	if (rc == 0)
		*ret = w->totals;
	return rc;
}

struct breakline_writer *breakline_writer_free(struct breakline_writer *w)
{
	if (!w)
		return NULL;
	grid_file_abort(&w->file);
	digest_stream_free(w->content);
	free(w->buffer);
	free(w);
	return NULL;
}

/* ---- reading ---- */

struct reading {
	int fd;
	const char *name;
	struct breakline_totals totals; /* of the head */
};

static int damaged(const struct reading *r, uint64_t place, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the file of lines is damaged: %s", what);
	err_add_place(err, place, NULL);
	err_add_file(err, r->name);
	return err_add_hint(err, "check the disk, and restore the file or push the lines again");
}

static int read_page(const struct reading *r, void *page, uint64_t place, struct err *err)
{
	int rc = io_read_at(r->fd, page, BREAKLINE_PAGE, place, r->name, err);

	if (rc != -ERR_TRUNCATED)
		return rc;
	err_clear(err);
	return damaged(r, place, "it ends too early", err);
}

static int check_head(struct reading *r, const struct breakline_head *h, struct err *err)
{
	uint64_t pages = h->vertices / BREAKLINE_PAGE_VERTICES + (h->vertices % BREAKLINE_PAGE_VERTICES != 0);
	struct stat st;

	if (h->check != grid_check((const uint8_t *)h + 8, BREAKLINE_PAGE - 8, 0) ||
	    memcmp(h->magic, BREAKLINE_MAGIC, sizeof h->magic))
		return damaged(r, 0, "its head is invalid", err);
	if (h->version != BREAKLINE_VERSION || h->page_bytes != BREAKLINE_PAGE) {
		err_set(err, ERR_VERSION, "a file of lines of version %u; this acut reads version %u", h->version,
			BREAKLINE_VERSION);
		return err_add_file(err, r->name);
	}
	if (io->fstat(r->fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		return err_add_file(err, r->name);
	}
	if ((uint64_t)st.st_size / BREAKLINE_PAGE != pages + 1 || st.st_size % BREAKLINE_PAGE)
		return damaged(r, 0, "its size differs from its head", err);
	r->totals =
		(struct breakline_totals){.lines = h->lines, .vertices = h->vertices, .content = {h->content_hi, h->content_lo}};
	memcpy(r->totals.features, h->features, sizeof h->features);
	memcpy(r->totals.box, h->box, sizeof h->box);
	return 0;
}

static int open_file(int dirfd, const char *name, struct reading *r, struct err *err)
{
	struct breakline_head h;
	int rc;

	*r = (struct reading){.fd = -1, .name = name};
	rc = grid_file_open(dirfd, name, "the file of lines", &r->fd, err);
	if (rc == 0)
		rc = read_page(r, &h, 0, err);
	if (rc == 0)
		rc = check_head(r, &h, err);
	if (rc)
		r->fd = io_close(r->fd);
	return rc;
}

int breakline_totals(int dirfd, const char *name, struct breakline_totals *ret, struct err *err)
{
	struct reading r;
	int rc = open_file(dirfd, name, &r, err);

	if (rc)
		return rc;
	io_close(r.fd);
	*ret = r.totals;
	return 0;
}

struct walk {
	struct digest_stream *content;
	struct breakline_totals totals;
	uint8_t kind;
};

/* Checks a page and counts its vertices; n: how many it should have. */
static int take_page(const struct reading *r, struct walk *w, const uint8_t *page, uint64_t place, size_t n, struct err *err)
{
	const struct breakline_page *head = (const struct breakline_page *)page;
	const struct breakline_vertex *v = (const struct breakline_vertex *)(head + 1);

	if (head->check != grid_check(page + 8, BREAKLINE_PAGE - 8, place))
		return damaged(r, place, "the checksum of a page does not agree", err);
	if (head->vertices != n)
		return damaged(r, place, "a page is not the one that its place requires", err);
	for (size_t i = 0; i < n; i++) {
		if (!is_possible(&v[i], w->totals.vertices == 0, w->kind))
			return damaged(r, place, "a vertex is impossible", err);
		totals_add(&w->totals, &v[i]);
		w->kind = v[i].kind;
	}
	digest_stream_add(w->content, v, n * sizeof *v);
	return 0;
}

static int read_all(const struct reading *r, struct walk *w,
		    int (*each)(void *ctx, const struct breakline_vertex *, size_t n, struct err *err), void *ctx,
		    struct err *err)
{
	_Alignas(8) uint8_t page[BREAKLINE_PAGE];
	uint64_t place = BREAKLINE_PAGE;
	int rc = 0;

	for (uint64_t left = r->totals.vertices; rc == 0 && left; place += BREAKLINE_PAGE) {
		size_t n = left < BREAKLINE_PAGE_VERTICES ? left : BREAKLINE_PAGE_VERTICES;

		rc = read_page(r, page, place, err);
		if (rc == 0)
			rc = take_page(r, w, page, place, n, err);
		if (rc == 0)
			rc = each(ctx, (const struct breakline_vertex *)(page + sizeof(struct breakline_page)), n, err);
		left -= n;
	}
	w->totals.content = digest_stream_end(w->content);
	if (rc == 0 &&
	    (memcmp(w->totals.features, r->totals.features, sizeof w->totals.features) || w->totals.lines != r->totals.lines ||
	     memcmp(w->totals.box, r->totals.box, sizeof w->totals.box) || !digest_equal(w->totals.content, r->totals.content)))
		rc = damaged(r, 0, "its lines differ from its head", err);
	return rc;
}

int breakline_read(int dirfd, const char *name,
		   int (*each)(void *ctx, const struct breakline_vertex *, size_t n, struct err *err), void *ctx, struct err *err)
{
	struct reading r;
	struct walk w = {.content = NULL};
	int rc = open_file(dirfd, name, &r, err);

	if (rc)
		return rc;
	w.content = digest_stream_new();
	rc = w.content ? read_all(&r, &w, each, ctx, err) : err_set(err, ERR_NOMEM, "no memory to read lines");
	digest_stream_free(w.content);
	io_close(r.fd);
	return rc;
}
