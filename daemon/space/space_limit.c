/* Limits of the disk as texts: a size, or a percentage of the file system. */
#include <stdio.h>
#include <string.h>

#include "parse.h"
#include "space.h"

bool space_limit_parse(const char *text, unsigned most, struct space_limit *ret)
{
	size_t n = strlen(text);
	char digits[8];
	uint64_t v;

	if (!n || text[n - 1] != '%') {
		if (!parse_size(text, &v))
			return false;
		*ret = (struct space_limit){SPACE_BYTES, v};
		return true;
	}
	if (n > sizeof digits)
		return false;
	memcpy(digits, text, n - 1);
	digits[n - 1] = 0;
	if (!parse_u64(digits, &v) || v > most)
		return false;
	*ret = (struct space_limit){SPACE_PERCENT, v};
	return true;
}

char *space_limit_text(const struct space_limit *limit, char *buf)
{
	if (limit->unit == SPACE_PERCENT)
		snprintf(buf, 32, "%llu%%", (unsigned long long)limit->n);
	else if (limit->unit == SPACE_BYTES)
		parse_size_text(limit->n, buf);
	else
		snprintf(buf, 32, "none");
	return buf;
}
