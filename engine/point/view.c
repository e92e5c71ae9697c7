/*
 * Views as predicates (view.h). A view is normalized before it is used or named (--surface is first returns and
 * highest, --ground is lowest), so that equivalent requests give the same view. Lattice numbers are absolute, so that a
 * dataset's offset changes neither text nor result.
 */
#include "view.h"

#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "err.h"
#include "lattice.h"
#include "view_area.h"

enum { CLASS_GROUND = 2, CLASS_NOISE_LOW = 7, CLASS_KEY = 8, CLASS_NOISE_HIGH = 18 };

static bool view_names_class(const struct view *v, unsigned cls)
{
	return v->has_classes && (v->classes[cls >> 6] >> (cls & 63) & 1);
}

static bool view_drops_class(const struct view *v, unsigned cls)
{
	return v->not_classes[cls >> 6] >> (cls & 63) & 1;
}

void view_done(struct view *v)
{
	view_area_free(v->area);
	view_area_free(v->window_area);
	slots_free(v->slots);
	*v = VIEW_INIT;
}

void view_bind(struct view *v, const struct lattice *lattice)
{
	memcpy(v->k, lattice->k, sizeof v->k);
}

void view_bind_map(struct view *v, const int64_t from[2])
{
	view_map_init(&v->map, v->metric, from);
}

struct view view_normal(const struct view *v)
{
	struct view w = *v;

	if (w.surface) {
		w.returns = VIEW_RETURNS_FIRST;
		w.duplicates = VIEW_HIGHEST;
		w.surface = false;
	}
	if (w.ground)
		w.duplicates = VIEW_LOWEST;
	for (unsigned i = 0; i < 4; i++)
		w.classes[i] = w.has_classes ? w.classes[i] & ~w.not_classes[i] : 0;
	if (w.has_classes)
		memset(w.not_classes, 0, sizeof w.not_classes);
#define VIEW_HEIGHT(field, ...) \
	if (!w.has_##field)     \
		w.field = 0;
#include "view_option.def"
	if (!w.has_max_error)
		w.max_error = 0;
	if (w.every <= 1)
		w.every = 0;
	if (!w.thin.cell)
		w.thin.pick = VIEW_PICK_LOWEST;
	w.metric = view_metric_normal(w.metric);
	return w;
}

/* True if no class is left. */
static bool no_class(const struct view *v)
{
	for (unsigned i = 0; i < 4; i++)
		if ((v->has_classes ? v->classes[i] : UINT64_MAX) & ~v->not_classes[i])
			return false;
	return true;
}

int view_check(const struct view *v, struct err *err)
{
	if (v->ground && v->surface) {
		err_set(err, ERR_USAGE, "a mesh cannot be of the ground and of the surface at once");
		return err_add_hint(err, "submit two jobs on one dataset: they share its points");
	}
	if (v->surface && v->returns == VIEW_RETURNS_LAST) {
		err_set(err, ERR_USAGE, "the surface is made of first returns, not of last ones");
		return err_add_hint(err, "leave out one of --surface and --returns last");
	}
	if (v->ground && v->duplicates == VIEW_HIGHEST) {
		err_set(err, ERR_USAGE, "the ground is the lowest of several points of one position");
		return err_add_hint(err, "use --class 2,8 --duplicates highest");
	}
	if (no_class(v)) {
		err_set(err, ERR_USAGE, "no class is left: all that --class names are left out by --not-class");
		return err_add_hint(err, "leave out one of them");
	}
	if (v->no_breaklines && v->breakline_clear) {
		err_set(err, ERR_USAGE, "without lines no point is near one");
		return err_add_hint(err, "leave out one of --no-breaklines and --breakline-clear");
	}
	if (v->has_max_error && v->max_points) {
		err_set(err, ERR_USAGE, "--max-points looks for the bound that --max-error gives");
		return err_add_hint(err, "leave out one of them");
	}
	if (view_simplifies(v) && v->metric.k > 1) {
		err_set(err, ERR_USAGE, "a metric has no bound of errors");
		return err_add_hint(err, "leave out --metric, or --max-error and --max-points");
	}
	if (v->has_zmin && v->has_zmax && v->zmin > v->zmax) {
		err_set(err, ERR_USAGE, "--zmin is above --zmax: no height is left");
		return err_add_hint(err, "swap them");
	}
	if (v->crop != VIEW_CROP_NONE && (v->crop_box[0] > v->crop_box[2] || v->crop_box[1] > v->crop_box[3])) {
		err_set(err, ERR_USAGE, "the box of --crop is empty");
		return err_add_hint(err, "give X1,Y1,X2,Y2: the smallest x and y, then the largest");
	}
	if (v->window && (v->window_box[0] > v->window_box[2] || v->window_box[1] > v->window_box[3])) {
		err_set(err, ERR_USAGE, "the box of --bbox is empty");
		return err_add_hint(err, "give X1,Y1,X2,Y2: the smallest x and y, then the largest");
	}
	if (v->nweight && view_simplifies(v)) {
		err_set(err, ERR_USAGE, "weights have no bound of errors");
		return err_add_hint(err, "leave out --weight, or --max-error and --max-points");
	}
	if (v->nweight && v->metric.k > 1) {
		err_set(err, ERR_USAGE, "radii of weights are circles, and with a metric distances are ellipses");
		return err_add_hint(err, "leave out one of --weight and --metric");
	}
	if (v->hidden && (!v->nweight || v->window)) {
		err_set(err, ERR_USAGE,
			v->window ? "the positions that are hidden are those of the whole mesh" :
				    "without weights nothing is hidden");
		return err_add_hint(err, v->window ? "leave out --bbox and --polygon" : "give --weight, too");
	}
	return view_metric_check(v->metric, err);
}

static bool has_class(const struct view *v, const struct point *p)
{
	if (view_drops_class(v, p->cls) || (v->has_classes && !view_names_class(v, p->cls)))
		return false;
	return !v->ground || p->cls == CLASS_GROUND || p->cls == CLASS_KEY || (p->tag & POINT_KEY);
}

/* Number 0 (unknown) is a first return, and a last one if the count is 0 or 1. A number beyond its count is a last return. */
static bool has_return(unsigned returns, const struct point *p)
{
	switch (returns) {
	case VIEW_RETURNS_FIRST:
		return point_return(p) <= 1;
	case VIEW_RETURNS_LAST:
		return point_return(p) >= point_returns(p) || (!point_return(p) && point_returns(p) == 1);
	default:
		return true;
	}
}

static bool in_crop(const struct view *v, int64_t x, int64_t y)
{
	const int64_t *b = v->crop_box;

	if (v->crop == VIEW_CROP_AREA)
		return view_area_has(v->area, x, y);
	return x >= b[0] && y >= b[1] && x <= b[2] && y <= b[3];
}

/* This is part of the meaning of a view, so it never changes: XXH3-64, seed 0, over the 16 bytes of the absolute
 * position, little-endian. */
static bool in_every(const struct view *v, int64_t x, int64_t y)
{
	const int64_t at[2] = {x, y};

	_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "positions are hashed as they lie in memory");
	return XXH3_64bits(at, sizeof at) % v->every == 0;
}

enum view_rule view_judge(const struct view *v, const struct point *p)
{
	int64_t x = p->x + v->k[0], y = p->y + v->k[1], z = p->z + v->k[2];

	if (v->crop && !in_crop(v, x, y))
		return VIEW_BY_CROP;
	if (p->tag & POINT_LINE)
		return VIEW_KEPT;
	if (!has_class(v, p))
		return VIEW_BY_CLASS;
	if ((p->cls == CLASS_NOISE_LOW || p->cls == CLASS_NOISE_HIGH) && !v->keep_noise && !view_names_class(v, p->cls))
		return VIEW_BY_NOISE;
	if (!has_return(v->surface ? VIEW_RETURNS_FIRST : v->returns, p))
		return VIEW_BY_RETURNS;
	if ((p->tag & POINT_WITHHELD) && !v->keep_withheld)
		return VIEW_BY_WITHHELD;
	if ((p->tag & POINT_OVERLAP) && v->drop_overlap)
		return VIEW_BY_OVERLAP;
	if ((v->has_zmin && z < v->zmin) || (v->has_zmax && z > v->zmax))
		return VIEW_BY_Z;
	if (p->tag & (POINT_NEAR_LINE | POINT_IN_AREA))
		return p->tag & POINT_NEAR_LINE ? VIEW_BY_LINE : VIEW_BY_AREA;
	if (v->every > 1 && !in_every(v, x, y))
		return VIEW_BY_EVERY;
	return VIEW_KEPT;
}

bool view_by_kind(const struct view *v)
{
	return v->crop == VIEW_CROP_NONE && !v->has_zmin && !v->has_zmax && v->every <= 1;
}

bool view_selects(const struct view *v)
{
	return v->crop != VIEW_CROP_NONE || v->every > 1 || v->thin.cell || v->metric.k > 1 || view_simplifies(v);
}

bool view_simplifies(const struct view *v)
{
	return v->has_max_error || v->max_points;
}

struct view view_whole(const struct view *v)
{
	struct view whole = *v;

	whole.has_max_error = false;
	whole.max_error = 0;
	whole.max_points = 0;
	whole.window = VIEW_CROP_NONE;
	whole.window_area = NULL;
	return whole;
}

bool view_rule_selects(enum view_rule rule)
{
	return rule == VIEW_BY_CROP || rule == VIEW_BY_EVERY || rule == VIEW_BY_THIN || rule == VIEW_BY_ERROR;
}

struct view view_rest(const struct view *v)
{
	struct view rest = VIEW_INIT, normal = view_normal(v);

	rest.keep_withheld = rest.keep_noise = true;
	rest.duplicates = normal.duplicates;
	rest.metric = normal.metric;
	rest.nweight = v->nweight;
	memcpy(rest.weight, v->weight, sizeof rest.weight);
	rest.slots = v->slots;
	rest.hidden = v->hidden;
	rest.selected = true;
	memcpy(rest.k, v->k, sizeof rest.k);
	rest.window = v->window;
	memcpy(rest.window_box, v->window_box, sizeof rest.window_box);
	rest.window_area = v->window_area;
	return rest;
}

bool view_may_hold(const struct view *v, const int32_t box[4])
{
	const int64_t at[4] = {box[0] + v->k[0], box[1] + v->k[1], box[2] + v->k[0], box[3] + v->k[1]};
	const int64_t *b = v->crop_box;

	switch (v->crop) {
	case VIEW_CROP_AREA:
		return view_area_meets(v->area, at);
	case VIEW_CROP_BOX:
		return at[0] <= b[2] && at[1] <= b[3] && at[2] >= b[0] && at[3] >= b[1];
	default:
		return true;
	}
}

static int64_t cell_number(int64_t v, int64_t cell)
{
	return v / cell - (v % cell < 0);
}

void view_thin_cell(const struct view *v, const struct point *p, int64_t ret[2])
{
	ret[0] = cell_number(p->x + v->k[0], v->thin.cell);
	ret[1] = cell_number(p->y + v->k[1], v->thin.cell);
}

/* Compares all of the record except height, position and source. */
static int compare_kind(const struct point *a, const struct point *b)
{
	if (a->cls != b->cls)
		return a->cls < b->cls ? -1 : 1;
	if (a->ret != b->ret)
		return a->ret < b->ret ? -1 : 1;
	return (int)point_flags(a) - (int)point_flags(b);
}

int view_thin_compare(const struct view_thin *t, const struct point *a, const struct point *b)
{
	int r;

	if (a->z != b->z)
		return (a->z < b->z) == (t->pick != VIEW_PICK_HIGHEST) ? -1 : 1;
	if ((r = compare_kind(a, b)))
		return r;
	if (a->x != b->x)
		return a->x < b->x ? -1 : 1;
	if (a->y != b->y)
		return a->y < b->y ? -1 : 1;
	return (int)point_slot(b) - (int)point_slot(a);
}

static int32_t radius_of(const struct view *v, const struct point *p)
{
	uint8_t weight = view_weight_of(v, p);

	return weight ? v->weight[weight - 1].radius : 0;
}

bool view_prefers(const struct view *v, const struct point *a, const struct point *b)
{
	int32_t ra = radius_of(v, a), rb = radius_of(v, b);
	bool highest = !v->ground && (v->surface || v->duplicates == VIEW_HIGHEST);

	if (ra != rb)
		return ra > rb;
	if (a->z != b->z)
		return highest ? a->z > b->z : a->z < b->z;
	return compare_kind(a, b) < 0;
}

int64_t view_weights(const struct view *v, int64_t ret[VIEW_WEIGHTS + 1])
{
	int64_t most = 0;

	memset(ret, 0, (VIEW_WEIGHTS + 1) * sizeof *ret);
	for (unsigned i = 0; i < v->nweight; i++) {
		int64_t radius = v->weight[i].radius;

		ret[i + 1] = radius * radius;
		most = ret[i + 1] > most ? ret[i + 1] : most;
	}
	return most;
}

bool view_weight_set(struct view *v, uint8_t cls, int32_t radius)
{
	unsigned at = v->nweight;

	for (unsigned i = 0; i < v->nweight; i++)
		if (v->weight[i].cls == cls)
			return false;
	if (!radius)
		return true;
	if (v->nweight == VIEW_CLASS_WEIGHTS)
		return false;
	for (; at > 0 && v->weight[at - 1].cls > cls; at--)
		v->weight[at] = v->weight[at - 1];
	v->weight[at] = (struct view_weight){.cls = cls, .radius = radius};
	v->nweight++;
	return true;
}

/* Radius 0 changes nothing if there is none to take away. */
static void drop_zero(struct slots_list *l)
{
	size_t n = 0;

	for (size_t i = 0; i < l->n; i++)
		if (l->row[i].value)
			l->row[n++] = l->row[i];
	l->n = n;
}

int view_weight_sources(struct view *v, struct slots_list *l, struct err *err)
{
	int32_t radius[SLOTS_MOST];
	uint32_t twice = 0;
	unsigned n = 0;
	int r;

	if (!v->nweight)
		drop_zero(l);
	if (!l->n)
		return 0;
	r = slots_list_slots(l, &v->slots, radius, &n, &twice);
	if (r == SLOTS_NO_MEMORY)
		return err_set(err, ERR_NOMEM, "no memory for the weights of sources");
	if (r == SLOTS_TWICE)
		err_set(err, ERR_USAGE, "--weight: source %u has two radii", twice);
	if (r == SLOTS_MANY)
		err_set(err, ERR_USAGE, "--weight: sources have more than %d different radii", SLOTS_MOST);
	if (r)
		return err_add_hint(err, "give each file one radius");
	for (unsigned i = 0; i < n; i++)
		v->weight[v->nweight++] = (struct view_weight){.slot = (uint8_t)(i + 1), .radius = radius[i]};
	return 0;
}

const char *view_rule_text(enum view_rule rule)
{
	static const char *const text[VIEW_RULES] = {
		[VIEW_KEPT] = "kept",
		[VIEW_BY_CLASS] = "class",
		[VIEW_BY_NOISE] = "noise",
		[VIEW_BY_RETURNS] = "returns",
		[VIEW_BY_WITHHELD] = "withheld",
		[VIEW_BY_OVERLAP] = "overlap",
		[VIEW_BY_Z] = "z",
		[VIEW_BY_CROP] = "crop",
		[VIEW_BY_EVERY] = "every",
		[VIEW_BY_THIN] = "thin",
		[VIEW_BY_DUPLICATE] = "duplicate",
		[VIEW_BY_LINE] = "line",
		[VIEW_BY_AREA] = "area",
		[VIEW_BY_WEIGHT] = "weight",
		[VIEW_BY_ERROR] = "error",
	};

	return (unsigned)rule < VIEW_RULES ? text[rule] : "unknown";
}
