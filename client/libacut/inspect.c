/* The content of the records of a file. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "call.h"

static void get_counts(const uint64_t *from, size_t n, uint64_t *to, size_t room)
{
	for (size_t i = 0; i < room; i++)
		to[i] = i < n ? from[i] : 0;
}

static void get_inspected(const Acut__V1__Inspected *m, struct acut_inspected *ret)
{
	*ret = (struct acut_inspected){
		.points = m->points,
		.distinct = m->distinct,
		.hull_corners = m->hull_corners,
		.hull_thinned = m->hull_thinned,
		.hull_area = m->hull_area,
		.lattice = m->lattice,
		.has_place = m->has_place,
		.no_place = m->no_place,
		.area = m->area,
		.perimeter = m->perimeter,
		.south = m->south,
		.west = m->west,
		.north = m->north,
		.east = m->east,
		.mgrs = m->mgrs,
		.difference = m->differences,
		.ndifference = m->n_differences,
		.most_points = m->most_points,
		.most_at = {m->most_x, m->most_y},
	};
	call_probe(m->header, &ret->header);
	for (size_t i = 0; i < 3; i++) {
		ret->min[i] = i < m->n_min ? m->min[i] : NAN;
		ret->max[i] = i < m->n_max ? m->max[i] : NAN;
		ret->inner_min[i] = i < m->n_inner_min ? m->inner_min[i] : NAN;
		ret->inner_max[i] = i < m->n_inner_max ? m->inner_max[i] : NAN;
	}
	get_counts(m->classes, m->n_classes, ret->classes, 256);
	get_counts(m->returns, m->n_returns, ret->returns, 16);
	get_counts(m->return_counts, m->n_return_counts, ret->return_counts, 16);
	get_counts(m->flags, m->n_flags, ret->flags, 4);
}

int acut_inspect(struct acut *a, int fd, const char *name, const char *format, const char *columns,
		 const struct acut_inspected **ret)
{
	Acut__V1__Inspect req = ACUT__V1__INSPECT__INIT;
	char *named, *formed;
	uint32_t id;
	int r = call_begin(a);

	if (r == 0)
		r = call_file(a, fd, name);
	if (r < 0)
		return r;
	named = strdup(name);
	formed = strdup(format ? format : "");
	if (!named || !formed) {
		free(named);
		free(formed);
		return err_set(&a->err, ERR_NOMEM, "there is no memory for a name");
	}
	req.name = frame_text_clean(named);
	req.format = frame_text_clean(formed);
	req.columns = call_text(columns);
	req.decimal_comma = a->decimal_comma;
	r = call_again(a, FRAME_MESSAGE(INSPECT, inspect, &req), fd, ACUT__V1__MESSAGE__BODY_INSPECTED, &id, &a->answer);
	free(named);
	free(formed);
	if (r < 0)
		return r;
	if (!a->answer->inspected->header)
		return err_set(&a->err, ERR_PROTO, "the daemon's answer has no header");
	get_inspected(a->answer->inspected, &a->inspected);
	*ret = &a->inspected;
	return 0;
}
