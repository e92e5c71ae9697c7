/* Geoid grids that a test makes: GeographicLib's PGM, of a smooth made-up field. */
#ifndef TEST_GEOID_H
#define TEST_GEOID_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#define GEOID_OFFSET -108.0
#define GEOID_SCALE 0.003

/* Metres. */
static inline double geoid_field(double lat, double lon)
{
	const double rad = M_PI / 180;

	return 30 * sin(lat * rad) + 20 * cos(lat * rad) * cos(2 * lon * rad) + 5;
}

/* A new file in a temporary place, ending in .pgm; the caller unlinks and frees. Width even, height odd. */
static inline char *geoid_synthetic(unsigned width, unsigned height)
{
	const char *folder = getenv("TMPDIR");
	char *path = malloc(4096);
	FILE *f;
	int fd;

	snprintf(path, 4096, "%s/acut-geoid-XXXXXX.pgm", folder ? folder : "/tmp");
	fd = mkstemps(path, 4);
	f = fd < 0 ? NULL : fdopen(fd, "wb");
	if (!f)
		abort();
	fprintf(f,
		"P5\n# Geoid file in PGM format for the GeographicLib::Geoid class\n# Description made up\n"
		"# DateTime 2020-01-01 00:00:00\n# MaxCubicError 0.5\n# RMSCubicError 0.1\n# Offset %g\n# Scale %g\n"
		"%u %u\n65535\n",
		GEOID_OFFSET, GEOID_SCALE, width, height);
	for (unsigned r = 0; r < height; r++)
		for (unsigned c = 0; c < width; c++) {
			long v = lround((geoid_field(90 - r * 180.0 / (height - 1), c * 360.0 / width) - GEOID_OFFSET) /
					GEOID_SCALE);

			fputc((int)(v >> 8), f);
			fputc((int)(v & 255), f);
		}
	fclose(f);
	return path;
}

#endif
