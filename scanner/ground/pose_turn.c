/*
 * Attitudes as unit quaternions. Body x ahead, y right, z down; outside north-east-down: Rz(heading) Ry(pitch)
 * Rx(roll). A quaternion and its negative are the same attitude. Interpolation takes the shorter rotation, so 359 and 1
 * degree are two degrees apart, and a pitch of 90 is not singular.
 */
#include <math.h>

#include "pose_parts.h"

#define HALF_RADIAN (3.14159265358979323846 / 360)

void pose_turn_of(const double angle[3], double q[4])
{
	double cr = cos(angle[0] * HALF_RADIAN), sr = sin(angle[0] * HALF_RADIAN);
	double cp = cos(angle[1] * HALF_RADIAN), sp = sin(angle[1] * HALF_RADIAN);
	double ch = cos(angle[2] * HALF_RADIAN), sh = sin(angle[2] * HALF_RADIAN);

	q[0] = ch * cp * cr + sh * sp * sr;
	q[1] = ch * cp * sr - sh * sp * cr;
	q[2] = ch * sp * cr + sh * cp * sr;
	q[3] = sh * cp * cr - ch * sp * sr;
}

void pose_turn_between(const double a[4], const double b[4], double t, double ret[4])
{
	double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3], sign = dot < 0 ? -1 : 1, u = 1 - t, v = t, n = 0;

	dot = fmin(fabs(dot), 1);
	/* Nearly equal: the chord is the arc, with an error below its square. */
	if (dot < 1 - 1e-9) {
		double angle = acos(dot), s = sin(angle);

		u = sin((1 - t) * angle) / s;
		v = sin(t * angle) / s;
	}
	for (int i = 0; i < 4; i++) {
		ret[i] = u * a[i] + v * sign * b[i];
		n += ret[i] * ret[i];
	}
	n = sqrt(n);
	for (int i = 0; i < 4; i++)
		ret[i] /= n;
}

void pose_turn_matrix(const double q[4], double m[3][3])
{
	double w = q[0], x = q[1], y = q[2], z = q[3];

	m[0][0] = 1 - 2 * (y * y + z * z);
	m[0][1] = 2 * (x * y - w * z);
	m[0][2] = 2 * (x * z + w * y);
	m[1][0] = 2 * (x * y + w * z);
	m[1][1] = 1 - 2 * (x * x + z * z);
	m[1][2] = 2 * (y * z - w * x);
	m[2][0] = 2 * (x * z - w * y);
	m[2][1] = 2 * (y * z + w * x);
	m[2][2] = 1 - 2 * (x * x + y * y);
}
