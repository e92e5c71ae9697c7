/* The bytes of LAS 1.4 (ASPRS LAS 1.4 R15): public header block, one variable length record, points of format 6. */
#include "las.h"

#include <math.h>
#include <string.h>
#include <time.h>

#include "cursor.h"
#include "err.h"

enum {
	HEADER = 375,
	VLR = 54,
	FORMAT = 6,
	WKT_RECORD = 2112,
	GPS_STANDARD = 1,
	WKT_SAID = 16,   /* global encoding */
	LEGACY_MOST = 0, /* format 6 has no legacy counts */
};
#define UNITS 1000 /* of the lattice, in one unit of the plane */
#define MILLION 1000000
#define FARTHEST 1e15 /* beyond this a double cannot represent thousandths, while an int64_t still can */

/* ---- coordinates ---- */

struct las_frame las_frame_of(const double first[3])
{
	struct las_frame f = {{0}};

	/* if the first point is not finite: around 0, where it will not fit */
	for (int i = 0; i < 2; i++)
		if (fabs(first[i]) < FARTHEST)
			f.offset[i] = (int64_t)floor(first[i] / MILLION + 0.5) * MILLION;
	return f;
}

int las_place(const struct las_frame *f, const double at[3], int32_t ret[3], struct err *err)
{
	for (int i = 0; i < 3; i++) {
		double v = floor((at[i] - (double)f->offset[i]) * UNITS + 0.5);

		if (!(v >= INT32_MIN && v <= INT32_MAX)) {
			err_set(err, ERR_LIMIT, "a point at %.3f %.3f %.3f lies too far from the first one for one file", at[0],
				at[1], at[2]);
			return err_add_hint(err, "look at the poses: nothing is recorded over 2147 km in one go");
		}
		ret[i] = (int32_t)v;
	}
	return 0;
}

void las_summary_add(struct las_summary *s, const int32_t at[3])
{
	for (int i = 0; i < 3; i++) {
		if (!s->points || at[i] < s->min[i])
			s->min[i] = at[i];
		if (!s->points || at[i] > s->max[i])
			s->max[i] = at[i];
	}
	s->points++;
}

/* The double nearest to the decimal. */
static double coordinate(const struct las_frame *f, int axis, int32_t number)
{
	return (double)(f->offset[axis] * UNITS + number) / UNITS;
}

/* ---- the head ---- */

static void put_text(struct packer *p, const char *s, size_t room)
{
	size_t n = strlen(s) < room ? strlen(s) : room;

	packer_bytes(p, s, n);
	packer_zero(p, room - n);
}

static void put_counts(struct packer *p, const struct las_params *l)
{
	packer_u32(p, LEGACY_MOST);
	packer_zero(p, 5 * 4);
	for (int i = 0; i < 3; i++)
		packer_f64(p, 1.0 / UNITS);
	for (int i = 0; i < 3; i++)
		packer_f64(p, (double)l->frame.offset[i]);
	for (int i = 0; i < 3; i++) {
		packer_f64(p, l->summary.points ? coordinate(&l->frame, i, l->summary.max[i]) : 0);
		packer_f64(p, l->summary.points ? coordinate(&l->frame, i, l->summary.min[i]) : 0);
	}
	packer_u64(p, 0); /* waveforms */
	packer_u64(p, 0); /* no extended records, because a pipe cannot be patched at its end */
	packer_u32(p, 0);
	packer_u64(p, l->summary.points);
	packer_u64(p, l->summary.points); /* by return: all are first returns; the other 14 are zero */
	packer_zero(p, 14 * 8);
}

int las_head(const struct las_params *l, uint8_t ret[LAS_HEAD_MAX], size_t *ret_size, struct err *err)
{
	struct packer p = packer_of(ret, LAS_HEAD_MAX);
	char wkt[LAS_WKT_MAX];
	time_t made = (time_t)l->made_s;
	struct tm day = {0};
	size_t n, head;
	int r = las_wkt(l->system, wkt, &n, err);

	if (r)
		return r;
	gmtime_r(&made, &day);
	head = HEADER + (n ? VLR + n : 0);
	packer_bytes(&p, "LASF", 4);
	packer_u16(&p, 0);
	packer_u16(&p, GPS_STANDARD | WKT_SAID);
	packer_bytes(&p, l->id, 16);
	packer_u8(&p, 1);
	packer_u8(&p, 4);
	put_text(&p, "acut scanner", 32);
	put_text(&p, "acut-scan", 32);
	packer_u16(&p, (uint16_t)(day.tm_yday + 1));
	packer_u16(&p, (uint16_t)(day.tm_year + 1900));
	packer_u16(&p, HEADER);
	packer_u32(&p, (uint32_t)head);
	packer_u32(&p, n ? 1 : 0);
	packer_u8(&p, FORMAT);
	packer_u16(&p, LAS_RECORD);
	put_counts(&p, l);
	if (n) {
		packer_u16(&p, 0);
		put_text(&p, "LASF_Projection", 16);
		packer_u16(&p, WKT_RECORD);
		packer_u16(&p, (uint16_t)n);
		put_text(&p, "OGC WKT", 32);
		packer_bytes(&p, wkt, n);
	}
	if (p.bad || packer_size(&p) != head)
		return err_set(err, ERR_INTERNAL, "a LAS header of %zu bytes came out as %zu", head, packer_size(&p));
	*ret_size = head;
	return 0;
}

void las_record(uint8_t ret[LAS_RECORD], const int32_t at[3], float intensity, double gps_s)
{
	struct packer p = packer_of(ret, LAS_RECORD);
	float part = intensity > 0 ? (intensity < 1 ? intensity : 1) : 0; /* NAN: 0 */

	for (int i = 0; i < 3; i++)
		packer_i32(&p, at[i]);
	packer_u16(&p, (uint16_t)(part * 65535 + 0.5f));
	packer_u8(&p, 1 | 1 << 4); /* the first return of one */
	packer_u8(&p, 0);
	packer_u8(&p, 0); /* never classified */
	packer_u8(&p, 0);
	packer_u16(&p, 0); /* no scan angle: it would have to be relative to the vehicle */
	packer_u16(&p, 0);
	packer_f64(&p, gps_s);
}
