/*
 * The text of a coordinate system, "EPSG:2154 + EPSG:5720", "NAME", "NAME + NAME": numbers, and the half of the heights.
 */
#include "call.h"

#include <string.h>

/* "EPSG:n" of n bytes; 0: it is none. */
static uint32_t number_of(const char *text, size_t n)
{
	uint32_t v = 0;

	if (n < 6 || n > 11 || strncmp(text, "EPSG:", 5))
		return 0;
	for (size_t i = 5; i < n; i++) {
		if (text[i] < '0' || text[i] > '9')
			return 0;
		v = v * 10 + (uint32_t)(text[i] - '0');
	}
	return v;
}

void call_system(const char *crs, uint32_t *ret_epsg, uint32_t *ret_epsg_z, const char **ret_vertical)
{
	const char *plus = strstr(crs, " + ");

	*ret_vertical = plus ? plus + 3 : "";
	*ret_epsg = number_of(crs, plus ? (size_t)(plus - crs) : strlen(crs));
	*ret_epsg_z = number_of(*ret_vertical, strlen(*ret_vertical));
}
