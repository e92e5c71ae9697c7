/*
 * How fast points come out of the page cache, one thread: million points a second of CPU time, best of
 * several passes, for a few point formats and for text. Usage: input_speed [FILE...]
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "fixture.h"

enum { BATCH = 8192, PASSES = 7, POINTS = 3000000 };

static double cpu_seconds(void)
{
	struct timespec t;

	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static void measure(int fd, const char *name)
{
	const struct input_options options = {.planar = true};
	struct input_points pts;
	double best = 1e9, best_open = 1e9;
	uint64_t n = 0;

	fixture_points_new(&pts, BATCH);
	for (int pass = 0; pass < PASSES; pass++) {
		struct err err = ERR_INIT;
		struct input *in;
		double start = cpu_seconds(), opened;

		if (input_open(fd, name, &options, &in, &err)) {
			printf("%s: %s\n", name, err.message);
			break;
		}
		opened = cpu_seconds();
		n = 0;
		while (!input_read(in, &pts, &err) && pts.n)
			n += pts.n;
		if (cpu_seconds() - opened < best)
			best = cpu_seconds() - opened;
		if (opened - start < best_open)
			best_open = opened - start;
		input_close(in);
	}
	fixture_points_free(&pts);
	printf("%-28s %9llu points, open %7.4f s, read %7.4f s, %6.1f M points/s\n", name, (unsigned long long)n, best_open, best,
	       (double)n / best * 1e-6);
}

static void measure_text(void)
{
	char *text = malloc((size_t)POINTS * 40);
	size_t size = 0;
	int fd;

	for (int i = 0; i < POINTS; i++)
		size += (size_t)sprintf(text + size, "%d.%02d %d.%02d %d.%02d\n", 435000 + i % 1000, i % 100, 5400000 + i % 777,
					i % 97, i % 300, i % 89);
	fd = fixture_fd(text, size);
	measure(fd, "text, 28 bytes a line");
	close(fd);
	free(text);
}

int main(int argc, char **argv)
{
	static const unsigned formats[] = {0, 1, 3, 6, 7};

	for (int i = 1; i < argc; i++) {
		int fd = open(argv[i], O_RDONLY | O_CLOEXEC);

		if (fd < 0) {
			perror(argv[i]);
			return 1;
		}
		measure(fd, argv[i]);
		close(fd);
	}
	for (size_t i = 0; argc < 2 && i < sizeof formats / sizeof *formats; i++) {
		struct las_spec s = {.minor = 4, .format = formats[i], .n = POINTS};
		struct bytes b = fixture_las(&s);
		int fd = fixture_fd(b.at, b.size);
		char name[40];

		free(b.at);
		snprintf(name, sizeof name, "format %u, %u bytes", formats[i], fixture_length(formats[i]));
		measure(fd, name);
		close(fd);
	}
	if (argc < 2)
		measure_text();
	return 0;
}
