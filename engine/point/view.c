/*
 * Views as predicates (view.h). The model: a view is normalised before it is used or named (--surface is
 * first returns and highest, --ground is lowest), so that two ways to ask for the same are one view.
 */
#include "view.h"

#include <string.h>

#include "err.h"

enum { CLASS_GROUND = 2, CLASS_NOISE_LOW = 7, CLASS_KEY = 8, CLASS_NOISE_HIGH = 18 };

static bool view_names_class(const struct view *v, unsigned cls)
{
	return v->has_classes && (v->classes[cls >> 6] >> (cls & 63) & 1);
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
	if (!w.has_classes)
		memset(w.classes, 0, sizeof w.classes);
	return w;
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
	return 0;
}

static bool has_class(const struct view *v, const struct point *p)
{
	if (v->has_classes && !view_names_class(v, p->cls))
		return false;
	return !v->ground || p->cls == CLASS_GROUND || p->cls == CLASS_KEY || (p->tag & POINT_KEY);
}

/* Number 0 (no returns known) is first, and last where the count is 0 or 1; a number beyond its count is
 * last. */
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

enum view_rule view_judge(const struct view *v, const struct point *p)
{
	if (!has_class(v, p))
		return VIEW_BY_CLASS;
	if ((p->cls == CLASS_NOISE_LOW || p->cls == CLASS_NOISE_HIGH) && !v->keep_noise &&
	    !view_names_class(v, p->cls))
		return VIEW_BY_NOISE;
	if (!has_return(v->surface ? VIEW_RETURNS_FIRST : v->returns, p))
		return VIEW_BY_RETURNS;
	if ((p->tag & POINT_WITHHELD) && !v->keep_withheld)
		return VIEW_BY_WITHHELD;
	return VIEW_KEPT;
}

bool view_prefers(const struct view *v, const struct point *a, const struct point *b)
{
	bool highest = !v->ground && (v->surface || v->duplicates == VIEW_HIGHEST);

	if (a->z != b->z)
		return highest ? a->z > b->z : a->z < b->z;
	if (a->cls != b->cls)
		return a->cls < b->cls;
	if (a->ret != b->ret)
		return a->ret < b->ret;
	return point_flags(a) < point_flags(b);
}

const char *view_rule_text(enum view_rule rule)
{
	static const char *const text[VIEW_RULES] = {
		[VIEW_KEPT] = "kept",
		[VIEW_BY_CLASS] = "class",
		[VIEW_BY_NOISE] = "noise",
		[VIEW_BY_RETURNS] = "returns",
		[VIEW_BY_WITHHELD] = "withheld",
		[VIEW_BY_DUPLICATE] = "duplicate",
	};

	return (unsigned)rule < VIEW_RULES ? text[rule] : "unknown";
}
