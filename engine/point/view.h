/*
 * Views: which points a mesh is made of. They apply when points are read, never when they are stored. Each rule depends
 * on one point, on all points of one position, or on all points of one thin cell; never on the order of points, and on their
 * sources only by the slots of weights (slots.h).
 *
 * Lattice numbers in a view are absolute (X + k), so its text does not depend on a dataset's offset. Points are judged
 * only after view_bind, which sets the lattice's k; from then on the view is read-only, and any number of threads may
 * use it.
 */
#ifndef VIEW_H
#define VIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "area_code.h"
#include "digest.h"
#include "point.h"
#include "slots.h"
#include "view_metric.h"

struct err;
struct lattice;
struct view_area;

/* Classes with a weight, classes and slots with one together, and the greatest radius. */
enum { VIEW_CLASS_WEIGHTS = 32, VIEW_WEIGHTS = VIEW_CLASS_WEIGHTS + SLOTS_MOST, VIEW_RADIUS_MOST = 1 << 30 };

enum view_returns { VIEW_RETURNS_ALL, VIEW_RETURNS_FIRST, VIEW_RETURNS_LAST };
enum view_duplicates { VIEW_LOWEST, VIEW_HIGHEST };
enum view_pick { VIEW_PICK_LOWEST, VIEW_PICK_HIGHEST, VIEW_PICK_MEDIAN }; /* median: the lower one */
enum view_crop { VIEW_CROP_NONE, VIEW_CROP_BOX, VIEW_CROP_AREA };

/* The first rule that removes a point counts it; view_judge has their order. The crop is first, so that points outside need not
 * be read to be counted. Stored domains have counts by these numbers (docs/formats/format.md), so they stay: a new rule comes
 * last. */
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
	VIEW_BY_LINE,      /* on a line, or too near to it (POINT_NEAR_LINE) */
	VIEW_BY_AREA,      /* in a lake, in a hole, or outside of the boundary (POINT_IN_AREA) */
	VIEW_BY_ERROR,     /* near enough to the mesh of the points that were kept (max_error, max_points) */
	VIEW_BY_WEIGHT,    /* hidden by points of more weight; a rule of the mesh, not of a point */
	VIEW_RULES
};

/* The widest that lines can be kept clear: all differences of lattice numbers are below it. */
#define VIEW_CLEAR_MOST (INT64_C(1) << 33)
/* Likewise the greatest bound of errors. */
#define VIEW_ERROR_MOST (INT64_C(1) << 33)

struct view_thin {
	int64_t cell; /* side of a cell in lattice numbers; 0: no thinning */
	uint8_t pick; /* enum view_pick */
};

struct view {
	uint64_t classes[4];     /* bit set of the requested classes; meaningful if has_classes */
	uint64_t not_classes[4]; /* bit set of the excluded classes; 0: none */
	bool has_classes;
	bool ground;  /* classes 2, 8 and key-points of any class; lowest; fails if there are none */
	bool surface; /* first returns, highest */
	bool keep_withheld, keep_noise;
	bool drop_overlap;  /* POINT_OVERLAP */
	uint8_t returns;    /* enum view_returns */
	uint8_t duplicates; /* enum view_duplicates */
	uint8_t crop;       /* enum view_crop */
	bool has_zmin, has_zmax;
	int64_t zmin, zmax;  /* closed */
	int64_t crop_box[4]; /* x1 y1 x2 y2, closed; the bounds for VIEW_CROP_AREA */
	uint64_t every;      /* keeps positions whose hash is 0 modulo this; 0, 1: all */
	struct view_thin thin;
	bool no_breaklines;      /* lines of the dataset do not count */
	int64_t breakline_clear; /* lattice numbers within which of a line points are removed; 0: only those on it */
	struct view_area *area;  /* for VIEW_CROP_AREA; owned: view_done */
	/* The window does not choose points: it chooses the triangles of the mesh that meet this closed area. Kind, box
	 * and area as for the crop. */
	uint8_t window;
	int64_t window_box[4];
	struct view_area *window_area;
	bool has_max_error;
	int64_t max_error;   /* no point is further above or below the mesh: lattice numbers of z */
	uint64_t max_points; /* the mesh has at most so many vertices, with a bound near the least that allows it; 0: no such
				limit */
	struct view_metric metric;
	/* Points of a class, or of some sources, hide others of less weight within their radius (docs/design/weights.md). By
	 * class, ascending, then by slot. The radius of its source is that of a point, also if its class has one. */
	struct view_weight {
		uint8_t cls, slot; /* slot 0: of the class */
		int32_t radius; /* lattice numbers, at least 1, at most VIEW_RADIUS_MOST; 0 of slot 1: its sources have no weight
				 */
	} weight[VIEW_WEIGHTS];
	uint8_t nweight;
	/* NULL: no source has a radius of its own. Owned: view_done. Grids are opened with it (struct grid_use). */
	struct slots *slots;
	bool selected;       /* by view_rest: the sources of the grid are not those of the dataset */
	bool hidden;         /* the mesh is the positions that weights hide, as vertices without triangles */
	int64_t k[3];        /* set by view_bind; not part of the text */
	struct view_map map; /* set by view_bind_map; likewise */
};

/* The number of the weight of a point: 0, none, or 1 + its place in `weight`. */
static inline uint8_t view_weight_of(const struct view *v, const struct point *p)
{
	unsigned slot = v->slots ? point_slot(p) : 0;

	for (uint8_t i = 0; i < v->nweight; i++)
		if (v->weight[i].slot == slot && (slot || v->weight[i].cls == p->cls))
			return (uint8_t)(i + 1);
	return 0;
}
/* The weights, by number: squares. Returns the greatest. */
int64_t view_weights(const struct view *, int64_t ret[VIEW_WEIGHTS + 1]);
/* Adds the radius of a class; one of zero is none. False: the class has one, or there are too many. */
bool view_weight_set(struct view *, uint8_t cls, int32_t radius);
/* The radii of sources, once, after those of classes. If no class has one, sources with zero are left out. -ERR_USAGE: a source
 * has two radii, or there are too many; -ERR_NOMEM. */
int view_weight_sources(struct view *, struct slots_list *, struct err *err);

#define VIEW_INIT ((struct view){.returns = VIEW_RETURNS_ALL, .duplicates = VIEW_LOWEST})
/* Frees the areas. The view may be filled again. */
void view_done(struct view *);
/* Call it before a point is judged. */
void view_bind(struct view *, const struct lattice *);
/* For a view with a metric, before it is used with its selection: positions are mapped, with this origin. Window and crop stay
 * those of the lattice. */
void view_bind_map(struct view *, const int64_t from[2]);

/* The normal form of the view: --surface and --ground expanded (surface: first returns, highest; ground: lowest),
 * excluded classes removed from the requested ones, rules that remove nothing reset. Shares the area with `view`, so
 * only `view` is passed to view_done. */
struct view view_normal(const struct view *);
/* -ERR_USAGE if the options contradict each other (ground and surface, surface of last returns ...). */
int view_check(const struct view *, struct err *err);

/* A view has two texts. The canonical text has whole lattice numbers; its hash identifies the view. A request has the
 * decimals and lengths that a user typed, because a user does not know the lattice. protocol.md has both grammars. Both
 * are at most VIEW_TEXT_MAX bytes long. */
#define VIEW_TEXT_MAX AREA_TEXT_MAX

/* The canonical text of the normal view, to be freed; NULL: no memory. */
char *view_text(const struct view *);
/* Parses exactly what view_text writes. -ERR_PROTO, -ERR_NOMEM. */
int view_parse(const char *text, struct view *ret, struct err *err);
struct digest view_hash(const struct view *);
/* The same for views that differ only in which sources have which slot. */
struct digest view_hash_slots(const struct view *);
/* Converts a request to a view of a dataset with this lattice and these units (crs.h) of x and y, and of z: corners and heights
 * are rounded once, as points are; lengths are converted exactly, the bound of errors is rounded down. A canonical text is
 * accepted, too; "" is the default view. The view is checked. -ERR_PROTO: not a request; -ERR_USAGE: a contradiction; -ERR_INPUT:
 * impossible for this dataset (its unit is unknown); -ERR_LIMIT: the canonical text would be too long. */
int view_resolve(const char *text, const struct lattice *, const char *unit_xy, const char *unit_z, struct view *ret,
		 struct err *err);
/* The same, with a window, "box:..." or "area@E:..." as in a request, instead of the view's own; "": without a window. */
int view_resolve_window(const char *text, const char *window, const struct lattice *, const char *unit_xy, const char *unit_z,
			struct view *ret, struct err *err);
/* Whether two lengths of a request are the same in every dataset: "1ft" and "0.3048m", but not "1m" and "1". */
bool view_same_length(const char *a, size_t a_size, const char *b, size_t b_size);
/* "2,8" or "2-5,9": sets the requested or the excluded classes; -ERR_USAGE for anything else. */
int view_set_classes(struct view *, const char *list, struct err *err);
int view_set_not_classes(struct view *, const char *list, struct err *err);

/* The rule that removes this point, or VIEW_KEPT. Never VIEW_BY_THIN or VIEW_BY_DUPLICATE, which depend on other
 * points. A vertex of a line (POINT_LINE) is removed by the crop alone, and what lines remove is marked (grid.h). Return number 0
 * (unknown) counts as a first return, and as a last one if the count is 0 or 1. The view is bound. */
enum view_rule view_judge(const struct view *, const struct point *);
/* Whether view_judge uses only class, returns, flags and marks of a point. */
bool view_by_kind(const struct view *);
/* True: of two kept points at one position, a is preferred to b: by weight, by height, then the rest of the record. False if they
 * are equal (the source never decides, but by its weight). */
bool view_prefers(const struct view *, const struct point *a, const struct point *b);
const char *view_rule_text(enum view_rule);
/* Whether the points that it removes are left out by the selection (view_selects), so that they are never meshed. */
bool view_rule_selects(enum view_rule);

/* Whether crop, every, thin, a metric or a bound of errors is set. The mesh of such a view is made from a grid of its selected
 * points, with view_rest. */
bool view_selects(const struct view *);
/* Whether points are left out because the mesh of the others is near enough: max_error or max_points. */
bool view_simplifies(const struct view *);
/* The same without max_error and max_points, and without the window; the area is shared. */
struct view view_whole(const struct view *);
/* The view to apply to points that view_judge and the thin rule have kept: the rule for duplicates, the metric, and the window,
 * whose area is shared, and the weights, whose slots are. */
struct view view_rest(const struct view *);
/* False only if no point of this box (lattice numbers, x1 y1 x2 y2, closed) can be kept. The view is bound. */
bool view_may_hold(const struct view *, const int32_t box[4]);

/*
 * Of a view with a map, the numbers of these functions are mapped ones, and the corners of a triangle are mapped positions.
 * Whether the closed triangle a, b, c (lattice numbers, not collinear) meets the window's closed area, exactly. True
 * without a window. The view is bound.
 */
bool view_window_meets(const struct view *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
/* False only if no point of the plane in this box (lattice numbers, closed) is in the window. The view is bound. */
bool view_window_near(const struct view *, const int64_t box[4]);
/* The window's bounds in lattice numbers, clamped to +-2^40. The view is bound and has a window. */
void view_window_bounds(const struct view *, int64_t ret[4]);
/* Whether these bounds are the whole window. */
bool view_window_is_box(const struct view *);

/* Whether a closed triangle, not collinear, meets a closed box; numbers within 2^61. */
bool view_box_meets(const int64_t box[4], const int64_t corner[3][2]);

/* The thin cell of a point: floor(x / cell), floor(y / cell) of absolute numbers. The view is bound, thin.cell > 0. Of
 * the points of one cell that view_judge keeps, one is taken: in the order of view_thin_compare the first, or for the
 * median number (n - 1) / 2. */
void view_thin_cell(const struct view *, const struct point *, int64_t ret[2]);
/* The order of the points of a cell: z, ascending unless the highest is taken; then class, returns, flags; x, y; the slot, the
 * greatest first. 0 for equal points: nothing else of the source decides. */
int view_thin_compare(const struct view_thin *, const struct point *a, const struct point *b);
/* For lowest and highest, on a stream of points: whether a is preferred to b. */
static inline bool view_thin_prefers(const struct view_thin *t, const struct point *a, const struct point *b)
{
	return view_thin_compare(t, a, b) < 0;
}

#endif
