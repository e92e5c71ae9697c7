/* Counts the features of a file of lines (lines_survey.h). Its memory grows with the number of layers only. */
#include "lines_survey.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grow.h"

static void note(struct lines_survey_list *list, const char *name, const struct lines_feature *f)
{
	char shown[LINES_SURVEY_NAME];

	snprintf(shown, sizeof shown, "%s", name);
	for (size_t i = 0; i < list->n; i++)
		if (!strcmp(list->row[i].name, shown)) {
			list->row[i].features++;
			return;
		}
	if (list->n == LINES_SURVEY_ROWS) {
		list->others++;
		return;
	}
	list->row[list->n] = (struct lines_survey_row){.features = 1, .first = f->number, .place = f->place};
	strcpy(list->row[list->n++].name, shown);
}

/* The counts of the feature's layer, after those of all layers before it. */
static int counts_of(struct lines_survey *s, const struct lines_layer *layer, struct lines_counts **ret, struct err *err)
{
	if (!grow(&s->layer, &s->room, (size_t)layer->index + 1, 16, sizeof(*s->layer)))
		return err_set(err, ERR_NOMEM, "no memory for layers");
	while (s->nlayers <= layer->index)
		memset(&s->layer[s->nlayers++], 0, sizeof(*s->layer));
	s->layer[layer->index].layer = layer;
	*ret = &s->layer[layer->index].counts;
	return 0;
}

static bool is_closed(const struct lines_feature *f, const struct lines_part *p)
{
	for (unsigned k = 0; k < 3; k++)
		if (lines_coordinate(f, p->first, k) != lines_coordinate(f, p->first + p->n - 1, k))
			return false;
	return p->n > 2;
}

static void count_parts(struct lines_counts *c, const struct lines_feature *f)
{
	c->usable++;
	for (size_t i = 0; i < f->nparts; i++) {
		c->rings += f->part[i].ring;
		c->lines += !f->part[i].ring;
		c->closed += !f->part[i].ring && is_closed(f, &f->part[i]);
		c->vertices += f->part[i].n;
	}
}

static void grow_box(struct lines_survey *s, const struct lines_feature *f)
{
	for (size_t i = 0; i < f->nvertices; i++)
		for (unsigned k = 0; k < 3; k++) {
			double v = lines_coordinate(f, i, k);

			s->min[k] = fmin(s->min[k], v);
			s->max[k] = fmax(s->max[k], v);
		}
}

static int take(struct lines_survey *s, const struct lines_feature *f, struct err *err)
{
	struct lines_counts *of_layer = NULL;
	int rc = counts_of(s, f->layer, &of_layer, err);

	if (rc)
		return rc;
	s->all.features++;
	of_layer->features++;
	if (f->state == LINES_EMPTY) {
		s->empty++;
		return 0;
	}
	if (f->state == LINES_NO_LINE) {
		note(&s->left_out, f->why, f);
		return 0;
	}
	note(&s->geometry, f->geometry, f);
	if (f->kind)
		note(&s->kinds, f->kind, f);
	else
		s->without_kind++;
	if (f->state == LINES_REFUSED) {
		s->all.refused++;
		of_layer->refused++;
		note(&s->refused, f->why, f);
		return 0;
	}
	count_parts(&s->all, f);
	count_parts(of_layer, f);
	grow_box(s, f);
	return 0;
}

int lines_survey(struct lines *l, struct lines_survey *ret, struct err *err)
{
	const struct lines_feature *f = NULL;
	int rc;

	*ret = (struct lines_survey){.min = {INFINITY, INFINITY, INFINITY}, .max = {-INFINITY, -INFINITY, -INFINITY}};
	do {
		rc = lines_next(l, &f, err);
		if (!rc && f)
			rc = take(ret, f, err);
	} while (!rc && f);
	return rc;
}

void lines_survey_done(struct lines_survey *s)
{
	free(s->layer);
	*s = (struct lines_survey){0};
}
