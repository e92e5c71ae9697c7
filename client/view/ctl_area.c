/*
 * Areas of --crop and --polygon (ctl_area.h): reading the file, and writing its polygons as a view has them: every corner as
 * whole numbers of one power of ten, as a step from the corner before. Nothing is rounded here: the daemon
 * rounds to the lattice of the dataset.
 */
#include "ctl_area.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "area_code.h"
#include "err.h"
#include "grow.h"
#include "json_reader.h"
#include "utf8.h"

enum { FILE_MOST = 64 << 20, EXPONENT_MOST = 40 };

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for an area");
}

int ctl_area_ring(struct ctl_area *a, bool shell, struct err *err)
{
	if (!grow(&a->ring, &a->rings_room, a->nring + 1, 16, sizeof(*a->ring)))
		return no_memory(err);
	a->ring[a->nring++] = (struct ctl_area_ring){a->ncorner, shell};
	return 0;
}

int ctl_area_feature(struct ctl_area *a, struct err *err)
{
	if (!grow(&a->feature, &a->features_room, a->nfeature + 1, 16, sizeof(*a->feature)))
		return no_memory(err);
	a->feature[a->nfeature++] = (struct ctl_area_feature){.ring = a->nring};
	return 0;
}

int ctl_area_corner(struct ctl_area *a, struct decimal x, struct decimal y, struct err *err)
{
	if (!grow(&a->corner, &a->corners_room, a->ncorner + 1, 256, sizeof(*a->corner)))
		return no_memory(err);
	a->corner[a->ncorner][0] = x;
	a->corner[a->ncorner++][1] = y;
	return 0;
}

const char *ctl_area_name(const struct ctl_area *a, size_t i)
{
	return a->names ? a->names + a->feature[i].name : "";
}

/* To whole characters, with a mark. */
static void cut_name(char *name)
{
	size_t n = 0, length;

	if (strlen(name) <= CTL_AREA_NAME)
		return;
	while (length = utf8_length(name + n, SIZE_MAX), length = length ? length : 1,
	       n + length <= CTL_AREA_NAME - strlen(CTL_AREA_CUT))
		n += length;
	strcpy(name + n, CTL_AREA_CUT);
}

int ctl_area_set_name(struct ctl_area *a, size_t i, char *name, struct err *err)
{
	size_t begin = a->names ? a->names_size : 1, n;

	cut_name(name);
	n = strlen(name) + 1;
	if (!grow(&a->names, &a->names_room, begin + n, 256, 1))
		return no_memory(err);
	a->names[0] = '\0';
	memcpy(a->names + begin, name, n);
	a->names_size = begin + n;
	a->feature[i].name = begin;
	return 0;
}

int ctl_area_field(struct ctl_area *a, const char *name, struct err *err)
{
	for (unsigned i = 0; i < a->nfield; i++)
		if (!strcmp(a->field[i], name))
			return 0;
	a->more_fields = a->nfield == CTL_AREA_FIELDS;
	if (a->more_fields)
		return 0;
	a->field[a->nfield] = strdup(name);
	return a->field[a->nfield] ? (a->nfield++, 0) : no_memory(err);
}

void ctl_area_done(struct ctl_area *a)
{
	for (unsigned i = 0; i < a->nfield; i++)
		free(a->field[i]);
	free(a->names);
	free(a->ring);
	free(a->corner);
	free(a->feature);
	*a = (struct ctl_area){0};
}

/* ---- the file ---- */

static int open_area(const char *file, int *ret, struct err *err)
{
	int fd = open(file, O_RDONLY | O_CLOEXEC);
	struct stat st;

	if (fd < 0 || fstat(fd, &st)) {
		err_sys(err, errno, "the area cannot be read");
		if (fd >= 0)
			close(fd);
		return err_add_hint(err, "an area is a file of GeoJSON or WKT; --crop also takes X1,Y1,X2,Y2");
	}
	if (!S_ISREG(st.st_mode) || st.st_size > FILE_MOST) {
		close(fd);
		return err_set(err, ERR_INPUT, "it is not a file of at most %d MiB, so not an area", FILE_MOST >> 20);
	}
	*ret = fd;
	return 0;
}

static int read_area(struct json_reader *json, struct ctl_area *a, struct err *err)
{
	int r;

	text_source_skip_mark(&json->source);
	if (json_reader_peek(json) == '{')
		r = ctl_area_json(json, a, err);
	else
		r = ctl_area_wkt(&json->source, a, err);
	if (!r && !a->ncorner) {
		r = err_set(err, ERR_INPUT, "there is no polygon in it");
		err_add_hint(err, "an area is made of polygons and multipolygons");
	}
	return r;
}

int ctl_area_read(const char *file, struct ctl_area *ret, struct err *err)
{
	return ctl_area_read_named(file, NULL, ret, err);
}

int ctl_area_read_named(const char *file, const char *name_field, struct ctl_area *ret, struct err *err)
{
	struct json_reader *json = malloc(sizeof(*json));
	struct ctl_area a = {.name_field = name_field};
	int fd = -1, r = json ? open_area(file, &fd, err) : no_memory(err);

	if (!r) {
		text_source_file(&json->source, fd, file, err);
		r = read_area(json, &a, err);
		close(fd);
	}
	free(json);
	if (r) {
		ctl_area_done(&a);
		return err_add_file(err, file);
	}
	*ret = a;
	return 0;
}

/* The EPSG number at the end of "urn:ogc:def:crs:EPSG::2154", "EPSG:2154" or ".../EPSG/0/2154"; longitude and latitude of WGS 84
 * are 4326; 0: it is none of these. */
unsigned long ctl_area_epsg(const struct ctl_area *a)
{
	const char *name = a->crs, *end = name + strlen(name), *at = end;

	if (strstr(name, "CRS84"))
		return 4326;
	while (at > name && at[-1] >= '0' && at[-1] <= '9')
		at--;
	return strstr(name, "EPSG") && !strchr(name, ',') ? strtoul(at, NULL, 10) : 0;
}

/* ---- the text ---- */

/* The largest power of ten that all corners are whole numbers of; 0 is one of any. */
static int32_t common_exponent(const struct ctl_area *a)
{
	int32_t e = EXPONENT_MOST;

	for (size_t i = 0; i < a->ncorner; i++)
		for (int k = 0; k < 2; k++)
			if (a->corner[i][k].mantissa && a->corner[i][k].exponent < e)
				e = a->corner[i][k].exponent;
	return e;
}

static bool whole(struct decimal d, int32_t exponent, __int128 *ret)
{
	__int128 v = d.mantissa;

	for (int32_t e = d.exponent; v && e > exponent; e--)
		if (__builtin_mul_overflow(v, (__int128)10, &v))
			return false;
	*ret = v;
	return v <= AREA_CODE_MOST / 4 && v >= -(AREA_CODE_MOST / 4);
}

static int corner_is_wild(const struct ctl_area *a, size_t i, struct err *err)
{
	char x[DECIMAL_TEXT_SIZE], y[DECIMAL_TEXT_SIZE];

	err_set(err, ERR_INPUT, "the corner %s %s and the others have no common unit to be kept exactly in",
		decimal_text(a->corner[i][0], x), decimal_text(a->corner[i][1], y));
	return err_add_hint(err, "give all corners with about the same digits after the point");
}

/* The last corner of a ring usually repeats the first one, and is left out then. */
static size_t ring_end(const struct ctl_area *a, size_t r)
{
	size_t first = a->ring[r].first, end = r + 1 < a->nring ? a->ring[r + 1].first : a->ncorner;
	const struct decimal *from, *to;

	if (end - first < 2) /* GeoJSON can have a ring without corners, and an area of such rings only has none to point at */
		return end;
	from = a->corner[first];
	to = a->corner[end - 1];
	return !decimal_compare(from[0], to[0]) && !decimal_compare(from[1], to[1]) ? end - 1 : end;
}

size_t ctl_area_corners(const struct ctl_area *a, size_t i)
{
	return ring_end(a, i) - a->ring[i].first;
}

int ctl_area_print(const struct ctl_area *a, FILE *out, struct err *err)
{
	int32_t exponent = common_exponent(a);
	__int128 at[2] = {0, 0}, to[2];
	char code[2 * AREA_CODE_SIZE];
	size_t bytes = 0;

	fprintf(out, "area@%d:", (int)exponent);
	for (size_t r = 0; r < a->nring; r++) {
		fputc(a->ring[r].shell ? '+' : '-', out);
		for (size_t i = a->ring[r].first; i < ring_end(a, r); i++) {
			size_t n;

			if (exponent < -EXPONENT_MOST || !whole(a->corner[i][0], exponent, &to[0]) ||
			    !whole(a->corner[i][1], exponent, &to[1]))
				return corner_is_wild(a, i, err);
			n = area_code_put(to[0] - at[0], code);
			n += area_code_put(to[1] - at[1], code + n);
			bytes += fwrite(code, 1, n, out);
			memcpy(at, to, sizeof(at));
		}
	}
	if (bytes + a->nring <= AREA_TEXT_MAX - 512)
		return 0;
	err_set(err, ERR_LIMIT, "the area has %zu corners, too many for one view (%zu bytes of %d)", a->ncorner, bytes + a->nring,
		AREA_TEXT_MAX - 512);
	return err_add_hint(err, "simplify it (ogr2ogr -simplify), or give fewer digits after the point");
}
