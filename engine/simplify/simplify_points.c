/* The positions of a view: its rules, and of several records at one position the one that the view prefers. */
#include "err.h"
#include "simplify_priv.h"

enum { PROGRESS = 1 << 14 };

int simplify_cancelled(const struct simplify *s, struct err *err)
{
	if (!s->p.progress || !s->p.progress(s->p.ctx))
		return 0;
	return err_set(err, ERR_CANCELLED, "the simplification was cancelled");
}

void simplify_sink_init(struct simplify_sink *k, const struct simplify *s, const struct view *view)
{
	*k = (struct simplify_sink){.s = s};
	cut_judge_init(&k->judge, view);
}

static int take(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct simplify_sink *k = ctx;
	int r = 0;

	if (k->records / PROGRESS != (k->records + n) / PROGRESS)
		r = simplify_cancelled(k->s, err);
	k->records += n;
	for (size_t i = 0; !r && i < n; i++) {
		const struct point *p = &pts[i];
		enum view_rule rule = cut_judge(&k->judge, p);

		if (rule != VIEW_KEPT) {
			k->removed[rule]++;
		} else if (k->any && k->last.x == p->x && k->last.y == p->y) {
			k->removed[VIEW_BY_DUPLICATE]++;
			if (view_prefers(k->judge.view, p, &k->last))
				k->last = *p;
		} else {
			if (k->any)
				r = k->point(k->ctx, &k->last, err);
			k->last = *p;
			k->any = true;
		}
	}
	return r;
}

int simplify_scan(struct simplify_sink *k, struct grid_reader *reader, uint64_t lo, uint64_t hi, struct err *err)
{
	int r = grid_scan(reader, lo, hi, take, k, err);

	if (!r && k->any)
		r = k->point(k->ctx, &k->last, err);
	k->any = false;
	return r;
}
