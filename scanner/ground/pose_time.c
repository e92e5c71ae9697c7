/*
 * Times of poses: POSIX UTC (leap seconds have no number), GPS time, ISO 8601.
 *
 * GPS time began with UTC on 1980-01-06 and has no leap seconds, so it is ahead by those that were inserted since.
 * "Adjusted" GPS time, as in LAS, is 10^9 s less.
 */
#include <ctype.h>
#include <math.h>
#include <string.h>
#include <time.h>

#include "ground.h"
#include "parse.h"

#define GPS_EPOCH 315964800.0 /* 1980-01-06 in POSIX time */
#define GPS_ADJUST 1e9

/* From each of these (POSIX) on, GPS is ahead by one second more. Source: IERS Bulletin C; none was announced since. */
static const double leaps[] = {
	362793600,  /* 1981-07-01 */
	394329600,  /* 1982-07-01 */
	425865600,  /* 1983-07-01 */
	489024000,  /* 1985-07-01 */
	567993600,  /* 1988-01-01 */
	631152000,  /* 1990-01-01 */
	662688000,  /* 1991-01-01 */
	709948800,  /* 1992-07-01 */
	741484800,  /* 1993-07-01 */
	773020800,  /* 1994-07-01 */
	820454400,  /* 1996-01-01 */
	867715200,  /* 1997-07-01 */
	915148800,  /* 1999-01-01 */
	1136073600, /* 2006-01-01 */
	1230768000, /* 2009-01-01 */
	1341100800, /* 2012-07-01 */
	1435708800, /* 2015-07-01 */
	1483228800, /* 2017-01-01 */
};
enum { LEAPS = sizeof leaps / sizeof *leaps };

double pose_gps_of_utc(double utc)
{
	unsigned n = 0;

	while (n < LEAPS && utc >= leaps[n])
		n++;
	return utc - GPS_EPOCH + n - GPS_ADJUST;
}

double pose_utc_of_gps(double gps)
{
	double ahead = gps + GPS_ADJUST + GPS_EPOCH;
	unsigned n = 0;

	/* The leap second itself has no POSIX number; it counts as the second after it. */
	while (n < LEAPS && ahead - (n + 1) >= leaps[n])
		n++;
	return ahead - n;
}

/* ---- ISO 8601 ---- */

static bool parse_digits(const char **at, unsigned n, int *ret)
{
	int v = 0;

	for (unsigned i = 0; i < n; i++, ++*at) {
		if (!isdigit((unsigned char)**at))
			return false;
		v = v * 10 + (**at - '0');
	}
	*ret = v;
	return true;
}

static bool parse_char(const char **at, const char *of)
{
	if (!**at || !strchr(of, **at))
		return false;
	++*at;
	return true;
}

/* The start of a day, in seconds since 1970; false if the calendar does not have that day. */
static bool day_start(int y, int m, int d, time_t *ret)
{
	struct tm tm = {.tm_year = y - 1900, .tm_mon = m - 1, .tm_mday = d};

	*ret = timegm(&tm);
	return tm.tm_year == y - 1900 && tm.tm_mon == m - 1 && tm.tm_mday == d; /* timegm normalizes */
}

/* The fraction of a second, with any number of digits. */
static double parse_fraction(const char **at)
{
	double v = 0, place = 0.1;

	for (; isdigit((unsigned char)**at); ++*at, place /= 10)
		v += (**at - '0') * place;
	return v;
}

/* "", "Z", "+02:00", "+0200", "-05": seconds to subtract. *ret_said: there is a zone. */
static bool parse_zone(const char **at, int *ret, bool *ret_said)
{
	int h, m = 0, sign = **at == '-' ? -1 : 1;

	*ret = 0;
	*ret_said = **at != 0;
	if (!**at || parse_char(at, "Zz"))
		return true;
	if (!parse_char(at, "+-") || !parse_digits(at, 2, &h))
		return false;
	parse_char(at, ":");
	if (**at && !parse_digits(at, 2, &m))
		return false;
	*ret = sign * (h * 3600 + m * 60);
	return h < 24 && m < 60;
}

static bool parse_iso(const char *text, double *ret, bool *ret_zone)
{
	const char *at = text;
	int y, mo, d, h, mi, s = 0, off;
	time_t day;
	double part = 0;

	if (!parse_digits(&at, 4, &y) || !parse_char(&at, "-") || !parse_digits(&at, 2, &mo) || !parse_char(&at, "-") ||
	    !parse_digits(&at, 2, &d) || !parse_char(&at, "Tt ") || !parse_digits(&at, 2, &h) || !parse_char(&at, ":") ||
	    !parse_digits(&at, 2, &mi))
		return false;
	if (parse_char(&at, ":") && !parse_digits(&at, 2, &s))
		return false;
	if (parse_char(&at, ".,")) {
		if (!isdigit((unsigned char)*at))
			return false;
		part = parse_fraction(&at);
	}
	if (!parse_zone(&at, &off, ret_zone) || *at)
		return false;
	if (y < 1970 || !day_start(y, mo, d, &day) || h > 23 || mi > 59 || s > 60)
		return false;
	*ret = (double)(day + h * 3600 + mi * 60 + s - off) + part;
	return true;
}

bool pose_time_parse(const char *text, enum pose_clock clock, double *ret)
{
	double v, utc;
	bool zoned;

	if (parse_double(text, &v)) {
		utc = clock == POSE_GPS ? pose_utc_of_gps(v) : v;
	} else if (parse_iso(text, &v, &zoned) && !(zoned && clock == POSE_GPS)) {
		/* Calendar seconds since 1970; GPS time counts from 1980. */
		utc = clock == POSE_GPS ? pose_utc_of_gps(v - GPS_EPOCH - GPS_ADJUST) : v;
	} else {
		return false;
	}
	if (!(fabs(utc) < 1e11))
		return false;
	*ret = utc;
	return true;
}
