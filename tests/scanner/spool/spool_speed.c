/* Speed of writing and reading spools: MB/s of payloads for some sizes of transfers. spool-speed [FOLDER] */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "spool.h"

static double cpu(void)
{
	struct timespec t;

	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec / 1e9;
}

int main(int argc, char **argv)
{
	static const size_t sizes[] = {512, 4096, 16384, 65536, 1 << 20};
	const size_t total = 512u << 20;
	char path[512];
	uint8_t *at = malloc(1 << 20);

	memset(at, 'x', 1 << 20);
	snprintf(path, sizeof(path), "%s/speed.spool", argc > 1 ? argv[1] : "/tmp");
	for (size_t i = 0; i < sizeof(sizes) / sizeof(*sizes); i++) {
		struct spool_head head = {0};
		struct spool_writer *w;
		struct spool_reader *r;
		struct spool_record record;
		struct err err = ERR_INIT;
		uint64_t began;
		double wrote, busy;

		if (spool_create(path, &head, &w, &err) || spool_flush_start(w, 1, 16 << 20, &err))
			return fprintf(stderr, "%s\n", err.message), 1;
		began = clock_mono_ns();
		busy = cpu();
		for (size_t n = 0; n < total; n += sizes[i])
			if (spool_append(w, SPOOL_DATA, 0, 0, at, sizes[i], &err))
				return fprintf(stderr, "%s\n", err.message), 1;
		wrote = clock_since(began);
		busy = cpu() - busy;
		if (spool_end(w, &err))
			return fprintf(stderr, "%s\n", err.message), 1;
		printf("%8zu bytes a transfer: %6.0f MB/s written (%.0f by CPU time), %6.0f with fsync", sizes[i],
		       (double)total / 1e6 / wrote, (double)total / 1e6 / busy, (double)total / 1e6 / clock_since(began));
		spool_writer_free(w);
		if (spool_open(open(path, O_RDONLY | O_CLOEXEC), path, &r, &err))
			return 1;
		began = clock_mono_ns();
		while (spool_next(r, &record, &err) > 0)
			;
		printf(", %6.0f MB/s read\n", (double)total / 1e6 / clock_since(began));
		spool_reader_free(r);
		unlink(path);
	}
	free(at);
	return 0;
}
