/*
 * Applying a view to many points. Most views depend only on a point's kind (class, returns, flags, marks of lines), and there are
 * few kinds, so results are cached by kind.
 */
#ifndef CUT_JUDGE_H
#define CUT_JUDGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "view.h"

enum { CUT_JUDGE_KINDS = 64 };

struct cut_judge {
	const struct view *view;
	bool by_kind;
	uint32_t kind[CUT_JUDGE_KINDS]; /* by hash; `rule` is the result for this kind */
	uint8_t rule[CUT_JUDGE_KINDS];
};

static inline void cut_judge_init(struct cut_judge *j, const struct view *view)
{
	const struct point zero = {.x = 0};

	*j = (struct cut_judge){.view = view, .by_kind = view_by_kind(view)};
	if (j->by_kind)
		memset(j->rule, (int)view_judge(view, &zero), sizeof j->rule);
}

/* view_judge. */
static inline enum view_rule cut_judge(struct cut_judge *j, const struct point *p)
{
	uint32_t kind, slot;

	if (!j->by_kind)
		return view_judge(j->view, p);
	memcpy(&kind, (const char *)p + offsetof(struct point, cls), sizeof kind);
	slot = kind * UINT32_C(0x9e3779b1) >> 26;
	if (j->kind[slot] != kind) {
		j->kind[slot] = kind;
		j->rule[slot] = (uint8_t)view_judge(j->view, p);
	}
	return (enum view_rule)j->rule[slot];
}
_Static_assert(CUT_JUDGE_KINDS == 1 << (32 - 26) && sizeof(struct point) == offsetof(struct point, cls) + sizeof(uint32_t),
	       "a kind is the end of a record");

#endif
