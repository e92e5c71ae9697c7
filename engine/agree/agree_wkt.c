/* The WKT of a set of inputs: that of the first one that carries one which says what the set is in (agree_set.h). One that a
 * person gave counts for inputs without. */
#include "agree_set.h"

#include <string.h>

const char *agree_wkt_of(const struct agree *a, const char *own)
{
	if (a->overrides && agree_known(a->said.text))
		own = "";
	return !*own && a->said_wkt ? a->said_wkt : own;
}

char *agree_wkt_part(const struct agree *a, const char *wkt)
{
	struct crs_bytes part = crs_wkt_holds(wkt, a->crs, a->unit_xy, a->unit_z);

	return part.size ? strndup(part.at, part.size) : NULL;
}
