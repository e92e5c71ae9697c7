/* Tables of slots (slots.h). They have one form: ranges are as long as they can be, and slots ascend with the values. */
#include "slots.h"

#include <stdlib.h>

uint8_t slots_of(const struct slots *s, uint32_t source)
{
	size_t lo = 0, hi = s->n;

	while (lo < hi) {
		size_t mid = lo + (hi - lo) / 2;

		if (s->range[mid].last < source)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo < s->n && s->range[lo].first <= source ? s->range[lo].slot : 0;
}

bool slots_list_add(struct slots_list *l, uint32_t first, uint32_t last, int32_t value)
{
	if (l->n == l->room) {
		size_t room = l->room ? 2 * l->room : 16;
		struct slots_list_row *row = realloc(l->row, room * sizeof *row);

		if (!row)
			return false;
		l->row = row;
		l->room = room;
	}
	l->row[l->n++] = (struct slots_list_row){first, last, value};
	return true;
}

void slots_list_free(struct slots_list *l)
{
	free(l->row);
	*l = (struct slots_list){NULL, 0, 0};
}

void slots_free(struct slots *s)
{
	free(s);
}

static int by_source(const void *a, const void *b)
{
	const struct slots_list_row *p = a, *q = b;

	return p->first != q->first ? (p->first > q->first) - (p->first < q->first) : (p->last > q->last) - (p->last < q->last);
}

static bool values_of(const struct slots_list *l, int32_t value[SLOTS_MOST], unsigned *n)
{
	*n = 0;
	for (size_t i = 0; i < l->n; i++) {
		unsigned at = 0;

		while (at < *n && value[at] < l->row[i].value)
			at++;
		if (at < *n && value[at] == l->row[i].value)
			continue;
		if (*n == SLOTS_MOST)
			return false;
		for (unsigned k = (*n)++; k > at; k--)
			value[k] = value[k - 1];
		value[at] = l->row[i].value;
	}
	return true;
}

static uint8_t slot_of(const int32_t value[SLOTS_MOST], int32_t v)
{
	unsigned i = 0;

	while (value[i] != v)
		i++;
	return (uint8_t)(i + 1);
}

int slots_list_slots(struct slots_list *l, struct slots **ret, int32_t ret_value[SLOTS_MOST], unsigned *ret_values,
		     uint32_t *ret_twice)
{
	struct slots_range *range;
	struct slots *s;

	if (!values_of(l, ret_value, ret_values))
		return SLOTS_MANY;
	s = malloc(sizeof *s + l->n * sizeof *range);
	if (!s)
		return SLOTS_NO_MEMORY;
	range = (struct slots_range *)(s + 1);
	*s = (struct slots){range, 0};
	if (l->n)
		qsort(l->row, l->n, sizeof *l->row, by_source);
	for (size_t i = 0; i < l->n; i++) {
		const struct slots_list_row *row = &l->row[i];
		uint8_t slot = slot_of(ret_value, row->value);
		struct slots_range *last = s->n ? &range[s->n - 1] : NULL;

		if (last && row->first <= last->last && slot != last->slot) {
			*ret_twice = row->first;
			free(s);
			return SLOTS_TWICE;
		}
		if (last && slot == last->slot && row->first <= (uint64_t)last->last + 1)
			last->last = row->last > last->last ? row->last : last->last;
		else
			range[s->n++] = (struct slots_range){row->first, row->last, slot};
	}
	*ret = s;
	return SLOTS_OK;
}
