/*
 * Views: which points a mesh is made of. They apply when reading, never when storing. Each rule looks
 * at one point, at all points of one position, or at all points of one thin cell; never at order or source.
 *
 * Numbers of the lattice are absolute in a view (X + k): its text does not depend on a dataset's offset. A view
 * is judged only after view_bind has told it the lattice's k; from then on it is read only, and any number
 * of threads may use it.
 */
#ifndef VIEW_H
#define VIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "area_code.h"
#include "digest.h"
#include "point.h"

struct err;
struct lattice;
struct view_area;

enum view_returns { VIEW_RETURNS_ALL, VIEW_RETURNS_FIRST, VIEW_RETURNS_LAST };
enum view_duplicates { VIEW_LOWEST, VIEW_HIGHEST };
enum view_pick { VIEW_PICK_LOWEST, VIEW_PICK_HIGHEST, VIEW_PICK_MEDIAN }; /* median: the lower one */
enum view_crop { VIEW_CROP_NONE, VIEW_CROP_BOX, VIEW_CROP_AREA };

/* Rules in the order in which they apply; the first that removes a point is counted. The crop is first, so that
 * what lies outside need not be read to be counted. */
enum view_rule {
	VIEW_KEPT,
	VIEW_BY_CROP,
	VIEW_BY_CLASS,
	VIEW_BY_NOISE,
	VIEW_BY_RETURNS,
	VIEW_BY_WITHHELD,
	VIEW_BY_OVERLAP,
	VIEW_BY_Z,
	VIEW_BY_EVERY,
	VIEW_BY_THIN,      /* another point of the same thin cell was taken */
	VIEW_BY_DUPLICATE, /* another point of the same position was taken */
	VIEW_RULES
};

struct view_thin {
	int64_t cell; /* side of a cell in lattice numbers; 0: no thinning */
	uint8_t pick; /* enum view_pick */
};

struct view {
	uint64_t classes[4];     /* bit set of the classes asked for; meaningful if has_classes */
	uint64_t not_classes[4]; /* of those left out; 0: none */
	bool has_classes;
	bool ground;  /* classes 2, 8 and key-points of any class; lowest; fails if none */
	bool surface; /* first returns, highest */
	bool keep_withheld, keep_noise;
	bool drop_overlap;  /* POINT_OVERLAP */
	uint8_t returns;    /* enum view_returns */
	uint8_t duplicates; /* enum view_duplicates */
	uint8_t crop;       /* enum view_crop */
	bool has_zmin, has_zmax;
	int64_t zmin, zmax;  /* closed */
	int64_t crop_box[4]; /* x1 y1 x2 y2, closed; of VIEW_CROP_AREA the bounds */
	uint64_t every;      /* keeps positions whose hash is 0 modulo this; 0, 1: all */
	struct view_thin thin;
	struct view_area *area; /* of VIEW_CROP_AREA; owned: view_done */
	/* Not which points, but which triangles of their mesh: those that meet this closed area. Kind, box and area
	 * as of the crop. */
	uint8_t window;
	int64_t window_box[4];
	struct view_area *window_area;
	int64_t k[3]; /* view_bind; no part of the text */
};

#define VIEW_INIT ((struct view){.returns = VIEW_RETURNS_ALL, .duplicates = VIEW_LOWEST})
/* Frees the areas. The view may be filled again. */
void view_done(struct view *);
/* Before a point is judged. */
void view_bind(struct view *, const struct lattice *);

/* The same view with --surface and --ground spelt out (surface: first returns, highest; ground: lowest), left
 * out classes taken out of those asked for, rules that remove nothing reset. Shares the area with the given one:
 * it is not to be done. */
struct view view_normal(const struct view *);
/* -ERR_USAGE if what is asked for contradicts itself (ground and surface, surface of last returns ...). */
int view_check(const struct view *, struct err *err);

/* A view has two texts. The canonical one holds whole numbers of the lattice: the view's identity is its hash.
 * A request holds what was typed, exact decimals and lengths, since who asks does not know the lattice.
 * PROTOCOL.md has the grammar of both. Either is at most VIEW_TEXT_MAX bytes long. */
#define VIEW_TEXT_MAX AREA_TEXT_MAX

/* The canonical text of the normal view, to be freed; NULL: no memory. */
char *view_text(const struct view *);
/* Takes exactly what view_text writes. -ERR_PROTO, -ERR_NOMEM. */
int view_parse(const char *text, struct view *ret, struct err *err);
struct digest view_hash(const struct view *);
/* A request as the view of a dataset with this lattice and this unit of x and y (crs.h): corners and heights
 * rounded once as points are, lengths converted exactly. A canonical text is taken too, "" is the default view.
 * The view is checked. -ERR_PROTO: not a request; -ERR_USAGE: what it asks for cannot be; -ERR_INPUT: it cannot
 * of this dataset (its unit is unknown); -ERR_LIMIT: the canonical text would be too long. */
int view_resolve(const char *text, const struct lattice *, const char *unit_xy, struct view *ret, struct err *err);
/* The same with a window, "box:..." or "area@E:..." as a request has it, in place of the view's own; "": without one. */
int view_resolve_window(const char *text, const char *window, const struct lattice *, const char *unit_xy, struct view *ret,
			struct err *err);
/* "2,8" or "2-5,9": sets classes, or those left out; -ERR_USAGE for rubbish. */
int view_set_classes(struct view *, const char *list, struct err *err);
int view_set_not_classes(struct view *, const char *list, struct err *err);

/* The rule that removes this point, or VIEW_KEPT. Never VIEW_BY_THIN nor VIEW_BY_DUPLICATE, which need other
 * points. Return number 0 (none known) counts as a first return, and as a last one where the count is 0 or 1.
 * View bound. */
enum view_rule view_judge(const struct view *, const struct point *);
/* Whether class, returns and flags of a point are all that view_judge looks at. */
bool view_by_kind(const struct view *);
/* Of two kept points of one position: true if a is the one to take rather than b. False for equals (the
 * source never decides). */
bool view_prefers(const struct view *, const struct point *a, const struct point *b);
const char *view_rule_text(enum view_rule);

/* True where crop, every or thin is set: such a view is meshed from a grid of its selected points, under what
 * view_rest gives. */
bool view_selects(const struct view *);
/* What is left to apply to points that view_judge and the thin rule have kept: the rule of duplicates. And the
 * window, whose area is shared. */
struct view view_rest(const struct view *);
/* False only if no point of this box (lattice numbers, x1 y1 x2 y2, closed) can be kept. View bound. */
bool view_may_hold(const struct view *, const int32_t box[4]);

/*
 * Windows, exact: whether the closed triangle a, b, c (lattice numbers, not all on one line) meets the closed
 * area. True without a window. View bound.
 */
bool view_window_meets(const struct view *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
/* False only if no point of the plane in this box (lattice numbers, closed) lies in the window. View bound. */
bool view_window_near(const struct view *, const int64_t box[4]);
/* The window's bounds in lattice numbers, cut back to +-2^40. View bound, with a window. */
void view_window_bounds(const struct view *, int64_t ret[4]);

/* Whether a closed triangle, not all on one line, meets a closed box; numbers within 2^61. */
bool view_box_meets(const int64_t box[4], const int64_t corner[3][2]);

/* The thin cell of a point: floor(x / cell), floor(y / cell) of absolute numbers. View bound, thin.cell > 0.
 * All points of one cell that view_judge keeps are one set, of which one is taken: the first, or for the median
 * number (n - 1) / 2, in the order of view_thin_compare. */
void view_thin_cell(const struct view *, const struct point *, int64_t ret[2]);
/* The order of the points of a cell: z, upwards unless the highest is picked; then class, returns, flags; x, y.
 * 0 for equals: the source never decides. */
int view_thin_compare(const struct view_thin *, const struct point *a, const struct point *b);
/* For lowest and highest, as points come by: a is to be taken rather than b. */
static inline bool view_thin_prefers(const struct view_thin *t, const struct point *a, const struct point *b)
{
	return view_thin_compare(t, a, b) < 0;
}

#endif
