/*
 * What the machine itself carries: the floor that a time of acut stands on. Memory: bytes a second of reading, and of
 * copying (read and written bytes both counted), by one thread and by all. Disk: bytes a second of writing a file
 * in one piece after the other, into the page cache and to the disk (fsync counted), and of reading it back after the
 * cache has let go of it. Memory and its own file are all that it touches; the file is gone at the end.
 *
 * usage: bench-floor FOLDER [MIB [REPEATS]]     one line each: NAME VALUE UNIT N MIN MAX (the value is the median)
 */
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { PIECE = 1 << 20, THREADS_MAX = 64, REPEATS_MAX = 99 };

static double now(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void die(const char *what)
{
	fprintf(stderr, "bench-floor: cannot %s: %s\n", what, strerror(errno));
	exit(1);
}

static int by_value(const void *a, const void *b)
{
	double x = *(const double *)a, y = *(const double *)b;

	return x < y ? -1 : x > y;
}

static void tell(const char *name, double bytes, double *seconds, int n)
{
	qsort(seconds, (size_t)n, sizeof *seconds, by_value);
	printf("%s %.3f GB/s %d %.3f %.3f\n", name, bytes / seconds[n / 2] * 1e-9, n, bytes / seconds[n - 1] * 1e-9,
	       bytes / seconds[0] * 1e-9);
	fflush(stdout);
}

/* ---- memory ---- */

struct part {
	pthread_t thread;
	uint64_t *from, *to; /* to: NULL if it is only read */
	size_t bytes;
	uint64_t sum;
};

static void *work(void *p)
{
	struct part *part = p;
	uint64_t sum[4] = {0};

	if (part->to) {
		memcpy(part->to, part->from, part->bytes);
		return NULL;
	}
	for (size_t i = 0; i + 4 <= part->bytes / 8; i += 4)
		for (size_t k = 0; k < 4; k++)
			sum[k] += part->from[i + k];
	part->sum = sum[0] + sum[1] + sum[2] + sum[3];
	return NULL;
}

static double pass(uint64_t *from, uint64_t *to, size_t bytes, unsigned threads)
{
	struct part part[THREADS_MAX];
	size_t each = bytes / threads / 64 * 64;
	double start = now();

	for (unsigned i = 0; i < threads; i++) {
		part[i] = (struct part){.from = from + i * each / 8, .to = to ? to + i * each / 8 : NULL, .bytes = each};
		if ((errno = pthread_create(&part[i].thread, NULL, work, &part[i])))
			die("start a thread");
	}
	for (unsigned i = 0; i < threads; i++)
		pthread_join(part[i].thread, NULL);
	return now() - start;
}

static void memory(size_t bytes, int repeats)
{
	long online = sysconf(_SC_NPROCESSORS_ONLN);
	unsigned most = online < 1 ? 1 : online > THREADS_MAX ? THREADS_MAX : (unsigned)online;
	uint64_t *from = aligned_alloc(64, bytes), *to = aligned_alloc(64, bytes);
	double seconds[REPEATS_MAX];

	if (!from || !to)
		die("get memory");
	memset(from, 1, bytes);
	memset(to, 2, bytes);
	for (int all = 0; all < 2; all++) {
		for (int i = 0; i < repeats; i++)
			seconds[i] = pass(from, NULL, bytes, all ? most : 1);
		tell(all ? "memory/read/all" : "memory/read/one", (double)bytes, seconds, repeats);
		for (int i = 0; i < repeats; i++)
			seconds[i] = pass(from, to, bytes, all ? most : 1);
		tell(all ? "memory/copy/all" : "memory/copy/one", 2 * (double)bytes, seconds, repeats);
	}
	free(from);
	free(to);
}

/* ---- disk ---- */

static void write_all(int fd, const void *piece, size_t bytes)
{
	for (size_t at = 0; at < bytes; at += PIECE)
		if (pwrite(fd, piece, PIECE, (off_t)at) != PIECE)
			die("write");
}

static void disk(const char *folder, size_t bytes, int repeats)
{
	double cached[REPEATS_MAX], synced[REPEATS_MAX], read_back[REPEATS_MAX];
	char path[4096];
	void *piece = aligned_alloc(4096, PIECE);
	int fd;

	if (!piece || snprintf(path, sizeof path, "%s/bench-floor-XXXXXX", folder) >= (int)sizeof path)
		die("get memory");
	fd = mkstemp(path);
	if (fd < 0)
		die("make a file");
	unlink(path);
	memset(piece, 7, PIECE);
	for (int i = 0; i < repeats; i++) {
		double start = now();

		write_all(fd, piece, bytes);
		cached[i] = now() - start;
		if (fsync(fd))
			die("sync");
		synced[i] = now() - start;
		posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
		start = now();
		for (size_t at = 0; at < bytes; at += PIECE)
			if (pread(fd, piece, PIECE, (off_t)at) != PIECE)
				die("read");
		read_back[i] = now() - start;
	}
	tell("disk/write", (double)bytes, cached, repeats);
	tell("disk/write-fsync", (double)bytes, synced, repeats);
	tell("disk/read", (double)bytes, read_back, repeats);
	close(fd);
	free(piece);
}

int main(int argc, char **argv)
{
	long mib = argc > 2 ? strtol(argv[2], NULL, 10) : 256, repeats = argc > 3 ? strtol(argv[3], NULL, 10) : 5;

	if (argc < 2 || argc > 4 || mib < 1 || mib > 1 << 20 || repeats < 1 || repeats > REPEATS_MAX) {
		fputs("usage: bench-floor FOLDER [MIB [REPEATS]]\n", stderr);
		return 2;
	}
	memory((size_t)mib << 20, (int)repeats);
	disk(argv[1], (size_t)mib << 20, (int)repeats);
	return 0;
}
