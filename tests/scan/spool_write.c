/*
 * spool-write OUT PROFILE ID UTC_NS [open]: a spool with times of one's own, for tests. Standard input has its records: kind
 * (u8), time (i64 ns, CLOCK_MONOTONIC), size (u32), bytes; little-endian. The head's clock is UTC_NS at 0; "open": no END.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "spool.h"

static int fail(const struct err *err)
{
	char text[1200];

	fprintf(stderr, "spool-write: %s\n", err_format(err, text, sizeof text));
	return 1;
}

static char *slurp(const char *path, size_t *ret)
{
	FILE *f = fopen(path, "rb");
	char *text = calloc(1, 64 << 10);

	*ret = f && text ? fread(text, 1, (64 << 10) - 1, f) : 0;
	if (f)
		fclose(f);
	return text;
}

static int copy(struct spool_writer *w, struct err *err)
{
	static uint8_t bytes[1 << 20];
	uint8_t head[13];
	int r = 0;

	while (!r && fread(head, 1, sizeof head, stdin) == sizeof head) {
		struct cursor c = cursor_of(head, sizeof head);
		unsigned kind = cursor_u8(&c);
		int64_t time = cursor_i64(&c);
		uint32_t size = cursor_u32(&c);

		if (size > sizeof bytes || fread(bytes, 1, size, stdin) != size)
			return err_set(err, ERR_USAGE, "a record of %u bytes is not there", size);
		r = kind == SPOOL_EVENT ? spool_event(w, time, err, "%.*s", (int)size, (char *)bytes) :
					  spool_append(w, (enum spool_kind)kind, 0, time, bytes, size, err);
	}
	return r;
}

int main(int argc, char **argv)
{
	struct spool_head head = {.utc_ns = 1, .monotonic_ns = 0};
	struct spool_writer *w = NULL;
	struct err err = ERR_INIT;

	if (argc < 5)
		return 2;
	for (int i = 0; i < 16; i++)
		sscanf(argv[3] + 2 * i, "%2hhx", &head.id[i]);
	/* A monotonic time of 0 would be filled in. */
	head.utc_ns = strtoll(argv[4], NULL, 10) + 1;
	head.monotonic_ns = 1;
	strcpy(head.port, "file");
	strcpy(head.profile_name, "test");
	strcpy(head.boot_id, "00000000-0000-4000-8000-000000000000");
	head.profile = slurp(argv[2], &head.profile_size);
	if (spool_create(argv[1], &head, &w, &err) || copy(w, &err) || (argc < 6 && spool_end(w, &err)))
		return fail(&err);
	spool_writer_free(w);
	free(head.profile);
	return 0;
}
