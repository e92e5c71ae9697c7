/*
 * Formulas of the earth that share nothing with GeographicLib, for comparison: Krueger's series of the
 * transverse Mercator to the sixth order (as in Karney, "Transverse Mercator with an accuracy of a few
 * nanometers", 2011, equations 7 to 12 and 35), and the polar stereographic of EPSG's guidance note 7-2.
 */
#ifndef EARTH_H
#define EARTH_H

#include <math.h>

static inline void earth_utm(double inverse_flattening, int zone, int north, double lat, double lon, double ret[2])
{
	const long double rad = 3.14159265358979323846264338327950288L / 180, f = 1 / (long double)inverse_flattening;
	const long double n = f / (2 - f), n2 = n * n, n3 = n2 * n, n4 = n2 * n2, n5 = n4 * n, n6 = n3 * n3;
	const long double alpha[6] = {
		n / 2 - 2 * n2 / 3 + 5 * n3 / 16 + 41 * n4 / 180 - 127 * n5 / 288 + 7891 * n6 / 37800,
		13 * n2 / 48 - 3 * n3 / 5 + 557 * n4 / 1440 + 281 * n5 / 630 - 1983433 * n6 / 1935360,
		61 * n3 / 240 - 103 * n4 / 140 + 15061 * n5 / 26880 + 167603 * n6 / 181440,
		49561 * n4 / 161280 - 179 * n5 / 168 + 6601661 * n6 / 7257600,
		34729 * n5 / 80640 - 3418889 * n6 / 1995840,
		212378941 * n6 / 319334400,
	};
	const long double A = 6378137.0L / (1 + n) * (1 + n2 / 4 + n4 / 64 + n6 / 256), e = sqrtl(f * (2 - f));
	long double d = lon - (6 * zone - 183), phi = lat * rad, xi, eta, x, y;

	d = d > 180 ? d - 360 : d < -180 ? d + 360 : d;
	d *= rad;
	long double tau = sinhl(atanhl(sinl(phi)) - e * atanhl(e * sinl(phi)));

	xi = atan2l(tau, cosl(d));
	eta = asinhl(sinl(d) / hypotl(tau, cosl(d)));
	y = xi;
	x = eta;
	for (int k = 1; k <= 6; k++) {
		y += alpha[k - 1] * sinl(2 * k * xi) * coshl(2 * k * eta);
		x += alpha[k - 1] * cosl(2 * k * xi) * sinhl(2 * k * eta);
	}
	ret[0] = (double)(500000 + 0.9996L * A * x);
	ret[1] = (double)((north ? 0 : 10000000) + 0.9996L * A * y);
}

static inline void earth_ups(double inverse_flattening, int north, double lat, double lon, double ret[2])
{
	const long double rad = 3.14159265358979323846264338327950288L / 180, f = 1 / (long double)inverse_flattening;
	const long double e = sqrtl(f * (2 - f)), phi = (north ? lat : -lat) * rad, s = sinl(phi);
	const long double t = tanl((90 - (north ? lat : -lat)) * rad / 2) * powl((1 + e * s) / (1 - e * s), e / 2);
	const long double rho = 2 * 6378137.0L * 0.994L * t / sqrtl(powl(1 + e, 1 + e) * powl(1 - e, 1 - e));

	ret[0] = (double)(2000000 + rho * sinl(lon * rad));
	ret[1] = (double)(2000000 + (north ? -1 : 1) * rho * cosl(lon * rad));
}

#endif
