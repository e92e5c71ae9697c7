/* Numbers by index, in pages of which some are in memory; the others are in a nameless file. Pages are small, since they are
 * reached in no order. */
#include <stdlib.h>
#include <string.h>

#include "contour_priv.h"
#include "err.h"
#include "grow.h"
#include "outfile.h"

enum { PAGE = 512 }; /* numbers */

struct page {
	uint64_t number;
	bool changed, used; /* used: since `hand` was here */
	uint64_t *at;
};

struct contour_array {
	const struct outfile *beside;
	struct outfile *spool;
	struct page *page;
	unsigned most, pages, hand;
	uint32_t *where; /* by page number: from 1 the page in memory; 0: none; IN_FILE: only there */
	size_t room;
};
#define IN_FILE UINT32_MAX

int contour_array_new(const struct outfile *beside, unsigned pages, struct contour_array **ret, struct err *err)
{
	struct contour_array *a = calloc(1, sizeof(*a));

	if (a) {
		a->beside = beside;
		a->most = pages;
		a->page = calloc(pages, sizeof(*a->page));
	}
	if (!a || !a->page) {
		contour_array_free(a);
		return err_set(err, ERR_NOMEM, "no memory for contours");
	}
	*ret = a;
	return 0;
}

struct contour_array *contour_array_free(struct contour_array *a)
{
	for (unsigned i = 0; a && i < a->pages; i++)
		free(a->page[i].at);
	if (a) {
		outfile_free(a->spool);
		free(a->page);
		free(a->where);
	}
	free(a);
	return NULL;
}

static int make_room(struct contour_array *a, uint64_t number, struct err *err)
{
	size_t had = a->room;

	if (!grow(&a->where, &a->room, number + 1, 256, sizeof(*a->where)))
		return err_set(err, ERR_NOMEM, "no memory for contours");
	memset(a->where + had, 0, (a->room - had) * sizeof(*a->where));
	return 0;
}

/* A page that was not used for a round of the hand leaves the memory. */
static int evict(struct contour_array *a, unsigned *ret, struct err *err)
{
	struct page *p;
	int r = a->spool ? 0 : outfile_spool(a->beside, &a->spool, err);

	for (; a->page[a->hand].used; a->hand = (a->hand + 1) % a->pages)
		a->page[a->hand].used = false;
	p = &a->page[a->hand];
	if (!r && p->changed)
		r = outfile_patch(a->spool, p->number * PAGE * sizeof(uint64_t), p->at, PAGE * sizeof(uint64_t), err);
	if (!r)
		a->where[p->number] = IN_FILE;
	*ret = a->hand;
	a->hand = (a->hand + 1) % a->pages;
	return r;
}

static int load(struct contour_array *a, uint64_t number, struct err *err)
{
	unsigned i = a->pages;
	struct page *p;
	int r = 0;

	if (i < a->most) {
		a->page[i].at = malloc(PAGE * sizeof(uint64_t));
		if (!a->page[i].at)
			return err_set(err, ERR_NOMEM, "no memory for contours");
		a->pages++;
	} else {
		r = evict(a, &i, err);
	}
	if (r)
		return r;
	p = &a->page[i];
	p->number = number;
	p->changed = a->where[number] == 0; /* what is not in the file must come there */
	if (a->where[number] == IN_FILE)
		r = outfile_read(a->spool, number * PAGE * sizeof(uint64_t), p->at, PAGE * sizeof(uint64_t), err);
	else
		memset(p->at, 0, PAGE * sizeof(uint64_t));
	a->where[number] = i + 1;
	return r;
}

int contour_array_at(struct contour_array *a, uint64_t index, bool change, uint64_t **ret, struct err *err)
{
	uint64_t number = index / PAGE;
	struct page *p;
	int r = number >= a->room ? make_room(a, number, err) : 0;

	if (!r && (!a->where[number] || a->where[number] == IN_FILE))
		r = load(a, number, err);
	if (r)
		return r;
	p = &a->page[a->where[number] - 1];
	p->used = true;
	p->changed |= change;
	*ret = p->at + index % PAGE;
	return 0;
}
