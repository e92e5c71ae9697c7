/*
 * The text of a system, to be kept with a dataset: a WKT that an input carries, and whether it says what the dataset is in.
 *
 * Model: a dataset knows its system as a short text and units. A WKT is kept beside them as it came, but for the blanks between
 * its words. It never decides anything. So what contradicts the short text or the units is not kept: the WKT of degrees that
 * were projected, of a system that was overridden, of heights that a geoid shifted. Texts that differ in spelling alone are not
 * compared with each other.
 */
#include <ctype.h>
#include <string.h>

#include "crs.h"
#include "crs_parts.h"
#include "crs_wkt.h"
#include "utf8.h"

/* One line of UTF-8: what is no character becomes "?", a control character a blank. */
static size_t put_quoted(const char *at, size_t left, char *to)
{
	size_t n = utf8_printable(at, left);

	if (n)
		memmove(to, at, n);
	else
		*to = (unsigned char)*at < 0x80 ? ' ' : '?';
	return n ? n : 1;
}

static bool is_word(char c)
{
	return isalnum((unsigned char)c) || (c && strchr("_+-.", c));
}

size_t crs_wkt_normal(const void *text, size_t size, char ret[CRS_WKT_MAX + 1])
{
	struct crs_span all, plane;
	struct crs_info ignored;
	bool quoted = false, blank = false, apart;
	size_t n = 0, step;

	if (!wkt_read(text, size, &ignored, &all, &plane))
		return 0;
	for (size_t i = 0; i < all.size; i += step) {
		const char *at = all.at + i;

		step = 1;
		quoted ^= *at == '"';
		if (!quoted && strchr(" \t\n\r", *at)) {
			blank = true;
			continue;
		}
		/* two words stay two; there was a blank, so this does not overtake the text */
		apart = !quoted && blank && n && is_word(ret[n - 1]) && is_word(*at);
		step = utf8_printable(at, all.size - i);
		if (n + apart + (step ? step : 1) > CRS_WKT_MAX)
			return 0;
		if (apart)
			ret[n++] = ' ';
		blank = false;
		step = put_quoted(at, all.size - i, ret + n);
		n += step;
	}
	ret[n] = 0;
	return n;
}

static bool contradicts(const char *said, const char *holds)
{
	return !crs_is_unknown(said) && strcmp(said, holds) != 0;
}

static bool same_heights(const struct crs_info *info, const char *holds, const char *unit_z)
{
	const char *said = crs_text_heights(info->text);

	if (contradicts(info->unit_z, unit_z))
		return false;
	if (said)
		return holds && !strcmp(said, holds);
	/* a third axis says of its heights what the text does not */
	return !holds || crs_is_unknown(info->unit_z);
}

struct crs_bytes crs_wkt_holds(const char *wkt, const char *crs, const char *unit_xy, const char *unit_z)
{
	const struct crs_bytes nothing = {wkt, 0};
	char mine[CRS_TEXT_SIZE], its[CRS_TEXT_SIZE];
	struct crs_span all, plane;
	struct crs_info info;

	if (!wkt_read(wkt, strlen(wkt), &info, &all, &plane) || !plane.size)
		return nothing;
	crs_text_plane(info.text, mine);
	crs_text_plane(crs, its);
	if (crs_is_unknown(mine) || strcmp(mine, its) || contradicts(info.unit_xy, unit_xy))
		return nothing;
	if (same_heights(&info, crs_text_heights(crs), unit_z))
		return (struct crs_bytes){all.at, all.size};
	crs_read_wkt(plane.at, plane.size, &info);
	if (!crs_is_unknown(info.unit_z))
		return nothing;
	return (struct crs_bytes){plane.at, plane.size};
}
