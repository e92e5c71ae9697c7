/* The bytes of a line set file (docs/formats/format.md, "Line sets"), and how its pages are read. Internal. */
#ifndef LINESET_FILE_H
#define LINESET_FILE_H

#include <stddef.h>

#include "lineset.h"
#include "lock.h"

#define LINESET_MAGIC "ACUTLNS1"

enum {
	LINESET_VERSION = 1,
	LINESET_PAGE = 4096,
	LINESET_LEVELS = 6, /* of the tree, at most: 204 * 85^5 pieces */
};

struct lineset_head {
	uint64_t check; /* of the other bytes of the head, which has the size of a page */
	char magic[8];
	uint32_t version, page_bytes;
	uint64_t pieces, pages;    /* pages: without the head */
	uint32_t height;           /* levels of the tree; 0 without pieces */
	uint32_t far, turns, zero; /* turns: of all pieces together */
	int32_t box[4];
	uint64_t sum_hi, sum_lo; /* of all pieces */
	uint64_t root_check;     /* of the last page; 0 without pieces */
	uint8_t rest[LINESET_PAGE - 96];
};
_Static_assert(sizeof(struct lineset_head) == LINESET_PAGE && offsetof(struct lineset_head, pieces) == 24 &&
		       offsetof(struct lineset_head, box) == 56 && offsetof(struct lineset_head, rest) == 96,
	       "format.md");

struct lineset_page {
	uint64_t check; /* of the other bytes of the page; seed: place in the file */
	uint16_t level; /* 0: its entries are pieces */
	uint16_t entries;
	uint32_t zero;
};
_Static_assert(sizeof(struct lineset_page) == 16, "format.md");
_Static_assert(sizeof(struct lineset_piece) == 20, "format.md");

struct lineset_inner { /* a page of the level below */
	int32_t box[4];
	uint64_t check;          /* of that page */
	uint64_t sum_hi, sum_lo; /* of the pieces below it */
	uint32_t turns;          /* of these */
	uint32_t state;          /* of the lower left corner of the box */
};
_Static_assert(sizeof(struct lineset_inner) == 48, "format.md");

enum {
	LINESET_PIECES = (LINESET_PAGE - sizeof(struct lineset_page)) / sizeof(struct lineset_piece),
	LINESET_ENTRIES = (LINESET_PAGE - sizeof(struct lineset_page)) / sizeof(struct lineset_inner),
};
_Static_assert(LINESET_PIECES == 204 && LINESET_ENTRIES == 85, "format.md");

/* The pages of each level: level 0 first, in one piece; all pages are full but the last of each level. */
struct lineset_shape {
	unsigned height;
	uint64_t first[LINESET_LEVELS], pages[LINESET_LEVELS], entries[LINESET_LEVELS];
	uint64_t all;
};
/* False: too many pieces. */
bool lineset_shape(uint64_t pieces, struct lineset_shape *ret);
/* The entries of page `i` of a level. */
unsigned lineset_shape_entries(const struct lineset_shape *, unsigned level, uint64_t i);

static inline uint64_t lineset_place(uint64_t page)
{
	return (page + 1) * LINESET_PAGE;
}

struct digest lineset_piece_sum(const struct lineset_piece *);

/* ---- pages that readers share ---- */

/* Frames come in sets of WAYS. */
enum { LINESET_WAYS = 4, LINESET_FRAME = 16 }; /* bytes of a frame beside its page */

struct lineset_cache;
struct lineset_cache *lineset_cache_new(size_t frames); /* NULL: no memory */
size_t lineset_cache_bytes(size_t frames);
struct lineset_cache *lineset_cache_free(struct lineset_cache *);
/* Copies the page if it is there. Both are thread-safe. */
bool lineset_cache_get(struct lineset_cache *, uint64_t page, void *to);
void lineset_cache_put(struct lineset_cache *, uint64_t page, const void *from);

/* ---- reading ---- */

struct lineset {
	struct lineset_info info;
	struct lineset_shape shape;
	struct digest sum;
	uint64_t root_check;
	uint32_t turns; /* of all pieces */
	int fd;
	char *name;
	struct lineset_cache *cache;
	struct ledger *ledger;
	uint64_t charged;
};

enum { LINESET_LEAVES = 4, LINESET_SLOTS = LINESET_LEVELS - 1 + LINESET_LEAVES };

struct lineset_reader {
	const struct lineset *set;
	uint64_t clock;
	struct {
		uint64_t page, used; /* page: its number plus one; 0: none */
	} slot[LINESET_SLOTS];
	_Alignas(8) uint8_t bytes[LINESET_SLOTS][LINESET_PAGE]; /* one for each inner level, then of level 0 */
};

/* A page, checked, until the next one of that level is read. */
int lineset_page(struct lineset_reader *, unsigned level, uint64_t i, uint64_t check, const struct lineset_page **ret,
		 struct err *);

static inline const struct lineset_piece *lineset_page_pieces(const struct lineset_page *p)
{
	return (const struct lineset_piece *)(p + 1);
}

static inline const struct lineset_inner *lineset_page_inner(const struct lineset_page *p)
{
	return (const struct lineset_inner *)(p + 1);
}

/* Whether the piece has a position in common with the closed box. */
bool lineset_meets(const struct lineset_piece *, const int32_t box[4]);
static inline bool lineset_boxes_meet(const int32_t a[4], const int32_t b[4])
{
	return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

/* A path that begins at a position with a known state: up or down to the height of its end, then to the left or right. */
struct lineset_path {
	int64_t from[2], to[2], den; /* the end times den */
	unsigned state;              /* of the beginning; after all pieces that meet the path's box: of the end */
};
void lineset_path_turn(struct lineset_path *, const struct lineset_piece *);
/* The closed box of the path. False: it is not within the numbers of positions, so no piece is there. */
bool lineset_path_box(const struct lineset_path *, int32_t ret[4]);

/* One descent. Pieces that meet the box are passed to `piece`; an entry that `inner` returns true for is not entered. */
struct lineset_visit {
	int32_t box[4];
	uint32_t turns;                                         /* only pieces that turn one of these; 0: all */
	bool (*inner)(void *ctx, const struct lineset_inner *); /* NULL: none */
	lineset_piece_fn piece;
	void *ctx;
};
int lineset_visit(struct lineset_reader *, const struct lineset_visit *, struct err *);

#endif
