/*
 * Ellipsoids and datums by number and by name (EPSG Geodetic Parameter Dataset; the names are EPSG's, OGC's and
 * ESRI's). Only datums that survey files really name; any other keeps the name that its record gives, and the
 * ellipsoid that the record gives.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "crs_parts.h"

static const struct {
	unsigned epsg;
	struct crs_ellipsoid e;
} ellipsoids[] = {
	{7001, {6377563.396, 299.3249646}},    /* Airy 1830 */
	{7002, {6377340.189, 299.3249646}},    /* Airy Modified 1849 */
	{7003, {6378160, 298.25}},             /* Australian National Spheroid */
	{7004, {6377397.155, 299.1528128}},    /* Bessel 1841 */
	{7008, {6378206.4, 294.978698213898}}, /* Clarke 1866: b is 6356583.8 */
	{7019, {6378137, 298.257222101}},      /* GRS 1980 */
	{7022, {6378388, 297}},                /* International 1924 */
	{7024, {6378245, 298.3}},              /* Krassowsky 1940 */
	{7030, {6378137, 298.257223563}},      /* WGS 84 */
	{7036, {6378160, 298.247167427}},      /* GRS 1967 */
	{7043, {6378135, 298.26}},             /* WGS 72 */
};

/* `names`: plain, separated by spaces, of datum and geographic system; the number is the datum's. */
static const struct {
	const char *datum;
	unsigned epsg, ellipsoid;
	const char *names;
} datums[] = {
	{"WGS 84", 6326, 7030, "wgs84 wgs1984 gcswgs1984 worldgeodeticsystem1984 worldgeodeticsystem1984ensemble"},
	{"WGS 72", 6322, 7043, "wgs72 wgs1972 gcswgs1972 worldgeodeticsystem1972"},
	{"NAD83", 6269, 7019, "nad83 nad1983 northamericandatum1983 northamerican1983 gcsnorthamerican1983"},
	{"NAD83(HARN)", 6152, 7019,
	 "nad83harn nad1983harn northamerican1983harn gcsnorthamerican1983harn nad83highaccuracyreferencenetwork "
	 "nad83highaccuracyregionalnetwork"},
	{"NAD83(NSRS2007)", 6759, 7019,
	 "nad83nsrs2007 nad1983nsrs2007 gcsnad1983nsrs2007 nad83nationalspatialreferencesystem2007"},
	{"NAD83(2011)", 1116, 7019, "nad832011 nad19832011 gcsnad19832011 nad83nationalspatialreferencesystem2011"},
	{"NAD83(CSRS)", 6140, 7019,
	 "nad83csrs nad1983csrs northamerican1983csrs gcsnorthamerican1983csrs "
	 "nad83canadianspatialreferencesystem"},
	{"NAD27", 6267, 7008, "nad27 nad1927 northamericandatum1927 northamerican1927 gcsnorthamerican1927"},
	{"ETRS89", 6258, 7019,
	 "etrs89 etrs1989 gcsetrs1989 europeanterrestrialreferencesystem1989 "
	 "europeanterrestrialreferencesystem1989ensemble"},
	{"RGF93", 6171, 7019, "rgf93 rgf93v1 rgf1993 gcsrgf1993 reseaugeodesiquefrancais1993 reseaugeodesiquefrancais1993v1"},
	{"OSGB36", 6277, 7001, "osgb36 osgb1936 gcsosgb1936 ordnancesurveyofgreatbritain1936"},
	{"Amersfoort", 6289, 7004, "amersfoort gcsamersfoort"},
	{"DHDN", 6314, 7004, "dhdn deutscheshauptdreiecksnetz gcsdeutscheshauptdreiecksnetz"},
	{"ED50", 6230, 7022, "ed50 european1950 gcseuropean1950 europeandatum1950"},
	{"GDA94", 6283, 7019, "gda94 gda1994 gcsgda1994 geocentricdatumofaustralia1994"},
	{"GDA2020", 1168, 7019, "gda2020 gcsgda2020 geocentricdatumofaustralia2020"},
	{"NZGD2000", 6167, 7019, "nzgd2000 gcsnzgd2000 newzealandgeodeticdatum2000"},
};

bool crs_ellipsoid_of_epsg(unsigned code, struct crs_ellipsoid *ret)
{
	for (size_t i = 0; i < sizeof ellipsoids / sizeof *ellipsoids; i++) {
		if (ellipsoids[i].epsg == code) {
			*ret = ellipsoids[i].e;
			return true;
		}
	}
	return false;
}

/* GRS 1980 and WGS 84 differ by 1.5e-6 in 298.2572; writers print eight decimals or more. */
static bool same_ellipsoid(double a, double f, struct crs_ellipsoid e)
{
	return fabs(a - e.a) < 1e-3 && fabs(f - e.inverse_flattening) < 1e-7;
}

static void take(struct crs_system *s, size_t row)
{
	struct crs_ellipsoid e;

	snprintf(s->datum, sizeof s->datum, "%s", datums[row].datum);
	if (!crs_ellipsoid_of_epsg(datums[row].ellipsoid, &e))
		return;
	if (s->a == 0 || same_ellipsoid(s->a, s->inverse_flattening, e)) {
		s->a = e.a;
		s->inverse_flattening = e.inverse_flattening;
	} else {
		s->a = s->inverse_flattening = 0;
	}
}

static bool listed(const char *names, const char *name)
{
	size_t n = strlen(name);

	for (const char *at = names; (at = strstr(at, name)); at += n)
		if ((at == names || at[-1] == ' ') && (!at[n] || at[n] == ' '))
			return true;
	return false;
}

void crs_datum_of_name(struct crs_system *s, struct crs_span name)
{
	char plain[96];
	size_t n = 0;

	/* ESRI writes D_ before the name */
	if (name.size > 2 && (name.at[0] == 'D' || name.at[0] == 'd') && name.at[1] == '_') {
		name.at += 2;
		name.size -= 2;
	}
	crs_text_plain(name, plain, sizeof plain);
	if (!plain[0] || !strcmp(plain, "unknown"))
		return;
	for (size_t i = 0; i < sizeof datums / sizeof *datums; i++) {
		if (listed(datums[i].names, plain)) {
			take(s, i);
			return;
		}
	}
	for (size_t i = 0; i < name.size && n + 1 < sizeof s->datum; i++) {
		char c = name.at[i];

		s->datum[n++] = c == '_' ? ' ' : c >= 0x20 && c < 0x7f ? c : '?';
	}
	s->datum[n] = 0;
}

void crs_datum_of_epsg(struct crs_system *s, unsigned code)
{
	for (size_t i = 0; i < sizeof datums / sizeof *datums; i++) {
		if (code && datums[i].epsg == code) {
			take(s, i);
			return;
		}
	}
}

char *crs_ellipsoid_text(const struct crs_system *s, char buf[CRS_ELLIPSOID_TEXT])
{
	if (s->inverse_flattening == 0)
		snprintf(buf, CRS_ELLIPSOID_TEXT, "a sphere of %.10g m", s->a);
	else
		snprintf(buf, CRS_ELLIPSOID_TEXT, "the ellipsoid %.10g m, 1/%.12g", s->a, s->inverse_flattening);
	return buf;
}
