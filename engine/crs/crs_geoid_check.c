/*
 * Is a file a geoid grid that can be relied on (crs_geo.h)? The whole of it is read once, in pieces.
 *
 * Model: GeographicLib's PGM: "P5", comments of which "# Offset" and "# Scale" must be there, width (even) and
 * height (odd), 65535, one white space, then big-endian pixels, row by row, and nothing behind them. Not here:
 * heights at places.
 */
#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <xxhash.h>

#include "crs_geo.h"
#include "crs_geo_parts.h"
#include "err.h"
#include "io.h"
#include "parse.h"

enum { PIECE = 64 * 1024, HEADER_MOST = 8192, SIDE_MOST = 100000 };
#define HEIGHT_MOST 250.0 /* metres: the true ones lie within 110 */

struct header {
	double offset, scale;
	bool has_offset, has_scale;
	uint64_t start; /* of the pixels */
};

static int bad(struct err *err, const char *name, uint64_t offset, const char *field, const char *what)
{
	err_set(err, ERR_INPUT, "not a geoid grid of GeographicLib: %s", what);
	err_add_place(err, offset, field);
	err_add_hint(err, "give a .pgm file as GeographicLib publishes them, such as egm96-5.pgm");
	return err_add_file(err, name);
}

/* The value behind a key of a comment line, or NULL. */
static const char *value_of(const char *line, const char *key)
{
	size_t n = strlen(key);

	while (*line == '#' || *line == ' ')
		line++;
	if (strncmp(line, key, n) || !isspace((unsigned char)line[n]))
		return NULL;
	line += n;
	while (isspace((unsigned char)*line))
		line++;
	return line;
}

static void take_text(const char *value, char *ret, size_t size)
{
	size_t n = 0;

	for (; value[n] && n + 1 < size; n++)
		ret[n] = value[n] >= 0x20 && value[n] < 0x7f ? value[n] : '?';
	ret[n] = 0;
}

/* False: a number that is none. */
static bool take_comment(const char *line, struct header *h, struct crs_geoid_info *info)
{
	const char *v;

	if ((v = value_of(line, "Offset")))
		return h->has_offset = parse_double(v, &h->offset);
	if ((v = value_of(line, "Scale")))
		return h->has_scale = parse_double(v, &h->scale) && h->scale > 0;
	if ((v = value_of(line, "Description")))
		take_text(v, info->description, sizeof info->description);
	else if ((v = value_of(line, "DateTime")))
		take_text(v, info->date, sizeof info->date);
	else if ((v = value_of(line, "RMSCubicError")))
		return parse_double(v, &info->rms_error) && info->rms_error >= 0;
	else if ((v = value_of(line, "MaxCubicError")))
		return parse_double(v, &info->max_error) && info->max_error >= 0;
	return true;
}

/* Lines of the header, without their ends. False at the end of `text`. */
static bool next_line(const char *text, size_t n, size_t *at, char line[256])
{
	const char *start = text + *at, *end = memchr(start, '\n', n - *at);
	size_t length;

	if (!end)
		return false;
	length = (size_t)(end - start);
	*at += length + 1;
	if (length && start[length - 1] == '\r')
		length--;
	snprintf(line, 256, "%.*s", (int)(length < 255 ? length : 255), start);
	return true;
}

static int read_header(const char *text, size_t n, const char *name, struct header *h, struct crs_geoid_info *info,
		       struct err *err)
{
	char line[256], more;
	size_t at = 0, was = 0;
	unsigned long most;

	if (!next_line(text, n, &at, line) || strcmp(line, "P5"))
		return bad(err, name, 0, "magic", "it does not begin with a line P5");
	for (;;) {
		was = at;
		if (!next_line(text, n, &at, line))
			return bad(err, name, was, "header", "its header does not end");
		if (line[0] != '#')
			break;
		if (!take_comment(line, h, info))
			return bad(err, name, was, "header", "a number of its header is none");
	}
	if (sscanf(line, "%u %u %c", &info->width, &info->height, &more) != 2)
		return bad(err, name, was, "size", "width and height are not there");
	was = at;
	if (!next_line(text, n, &at, line) || sscanf(line, "%lu %c", &most, &more) != 1 || most != 65535)
		return bad(err, name, was, "maximum", "the greatest pixel is not 65535");
	if (!h->has_offset || !h->has_scale)
		return bad(err, name, ERR_NO_OFFSET, "header", "it does not say Offset and Scale");
	if (info->width < 2 || info->height < 3 || info->width % 2 || info->height % 2 == 0 || info->width > SIDE_MOST ||
	    info->height > SIDE_MOST)
		return bad(err, name, ERR_NO_OFFSET, "size", "its width must be even and its height odd");
	h->start = at;
	return 0;
}

/* Hash of all bytes, least and greatest pixel. The header is one piece, so that pixels never lie across two. */
static int read_pieces(int fd, const char *name, const struct header *h, uint8_t *piece, XXH3_state_t *state,
		       struct crs_geoid_info *info, struct err *err)
{
	unsigned least = 65535, most = 0;
	uint64_t at = 0;

	while (at < info->bytes) {
		uint64_t left = (at ? info->bytes : h->start) - at;
		size_t n = left < PIECE ? (size_t)left : PIECE;
		int r = io_read_at(fd, piece, n, at, name, err);

		if (r)
			return r;
		XXH3_128bits_update(state, piece, n);
		for (size_t i = 0; at && i + 1 < n; i += 2) {
			unsigned v = (unsigned)piece[i] << 8 | piece[i + 1];

			least = v < least ? v : least;
			most = v > most ? v : most;
		}
		at += n;
	}
	info->min = h->offset + h->scale * least;
	info->max = h->offset + h->scale * most;
	return 0;
}

static int read_all(int fd, const char *name, const struct header *h, struct crs_geoid_info *info, struct err *err)
{
	uint8_t *piece = malloc(PIECE);
	XXH3_state_t *state = XXH3_createState();
	int r;

	if (!piece || !state || XXH3_128bits_reset(state) == XXH_ERROR)
		r = err_set(err, ERR_NOMEM, "no memory to check a geoid grid");
	else
		r = read_pieces(fd, name, h, piece, state, info, err);
	if (!r) {
		XXH128_hash_t hash = XXH3_128bits_digest(state);

		info->hash = (struct digest){hash.high64, hash.low64};
	}
	XXH3_freeState(state);
	free(piece);
	return r;
}

int crs_geoid_size(const char *path, unsigned *ret_width, unsigned *ret_height, struct err *err)
{
	struct crs_geoid_info info = {0};
	struct header h = {0};
	char text[HEADER_MOST];
	size_t n;
	int fd, r = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);

	if (r)
		return r;
	r = io_read_some(fd, text, sizeof text, 0, path, &n, err);
	if (!r)
		r = read_header(text, n, path, &h, &info, err);
	io_close(fd);
	if (r)
		return r;
	*ret_width = info.width;
	*ret_height = info.height;
	return 0;
}

int crs_geoid_check(int fd, const char *name, struct crs_geoid_info *ret, struct err *err)
{
	struct crs_geoid_info info = {.rms_error = NAN, .max_error = NAN};
	struct header h = {0};
	char text[HEADER_MOST];
	struct stat st;
	size_t n;
	int r;

	if (io->fstat(fd, &st)) {
		err_sys(err, errno, "cannot look at the file");
		return err_add_file(err, name);
	}
	r = io_read_some(fd, text, sizeof text, 0, name, &n, err);
	if (!r)
		r = read_header(text, n, name, &h, &info, err);
	if (r)
		return r;
	info.bytes = h.start + 2 * (uint64_t)info.width * info.height;
	if ((uint64_t)st.st_size != info.bytes) {
		err_set(err, (uint64_t)st.st_size < info.bytes ? ERR_TRUNCATED : ERR_INPUT,
			"a geoid grid of %u by %u has %llu bytes, but the file has %llu", info.width, info.height,
			(unsigned long long)info.bytes, (unsigned long long)st.st_size);
		return err_add_file(err, name);
	}
	r = read_all(fd, name, &h, &info, err);
	if (r)
		return r;
	if (!(info.min >= -HEIGHT_MOST && info.max <= HEIGHT_MOST)) {
		err_set(err, ERR_INPUT, "its heights run from %.10g to %.10g m: no geoid does", info.min, info.max);
		return err_add_file(err, name);
	}
	*ret = info;
	return 0;
}
