/* Any bytes as a spool: its records have numbers and places that rise, its end is found, and replay takes all of it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cola_make.h"
#include "fuzz_input.h"
#include "profile.h"
#include "replay.h"
#include "spool.h"

static const char *const profiles[] = {"[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\n",
				       "[framer]\nkind = line\n[decoder]\nname = xyz\n",
				       "[framer]\nkind = las\n[decoder]\nname = las\n"};

/* Written by the writer, so that checksums are right. */
size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static struct cola_scan scan;
	static uint8_t telegram[COLA_TELEGRAM_MAX];
	struct spool_head head = {.vendor = 0x19a2, .model = "TiM", .utc_ns = 1, .monotonic_ns = 1};
	char path[] = "/tmp/acut-fuzz-spool-XXXXXX";
	struct spool_writer *w;
	struct err err = ERR_INIT;
	FILE *f;
	size_t n = 0;

	if (i > 5 || !mkdtemp(path))
		return 0;
	if (chdir(path))
		abort();
	head.profile = strdup(profiles[i % 3]);
	head.profile_size = strlen(profiles[i % 3]);
	memset(head.id, 7, sizeof head.id);
	if (spool_create("s", &head, &w, &err))
		abort();
	cola_scan_tim551(&scan);
	scan.shots = 5;
	for (unsigned k = 0; k < i * 2; k++) {
		size_t size;

		cola_scan_step(&scan, k);
		size = cola_make(&scan, telegram, sizeof telegram);
		spool_append(w, SPOOL_DATA, k == 3 ? SPOOL_AFTER_GAP : 0, k, i % 3 == 1 ? (const uint8_t *)"1 2 3\n" : telegram,
			     i % 3 == 1 ? 6 : size, &err);
		spool_event(w, k, &err, k % 2 ? "overflow 3" : "parked 5");
		spool_append(w, SPOOL_SENT, 0, k, "\2sEN\3", 5, &err);
	}
	spool_clock(w, &err);
	if (i % 2)
		spool_end(w, &err);
	spool_writer_free(w);
	spool_head_clear(&head);
	f = fopen("s", "rb");
	if (f) {
		n = fread(bytes, 1, room, f);
		fclose(f);
	}
	unlink("s");
	if (chdir("/") || rmdir(path))
		abort();
	return n;
}

/* Whether it is decoded as its own profile says. */
static struct replay *replay_of(const struct spool_head *h)
{
	struct replay_clock clock = replay_clock_of(h);
	struct replay_sinks sinks = {0};
	struct replay *r = NULL;
	struct profile p;
	struct err err = ERR_INIT;

	if (!h->profile || profile_parse(h->profile, h->profile_size, "own", "own", &p, &err))
		return NULL;
	replay_new(&p, &clock, &sinks, &r, &err);
	return r;
}

static void read_all(struct spool_reader *reader, size_t size)
{
	struct replay *replay = replay_of(spool_reader_head(reader));
	struct spool_record rec;
	struct spool_tail tail;
	struct err err = ERR_INIT;
	uint64_t offset = 0, skipped, bytes = 0, turns = 0;
	int rc;

	while ((rc = spool_next(reader, &rec, &err)) != 0) {
		if (++turns > size)
			abort();
		if (rc < 0) {
			fuzz_input_check(rc, &err);
			err = ERR_INIT;
			if (rc != -ERR_INPUT || spool_skip(reader, &skipped, &err))
				break;
			continue;
		}
		if (rec.offset < offset || rec.offset + rec.size > size || rec.size > SPOOL_PAYLOAD_MAX)
			abort();
		offset = rec.offset + rec.size;
		bytes += rec.kind == SPOOL_DATA ? rec.size : 0;
		if (replay)
			replay_record(replay, &rec);
	}
	if (!rc) {
		spool_tail(reader, &tail);
		if (tail.torn > size || tail.whole > size)
			abort();
	}
	if (replay) {
		struct replay_counts c;

		replay_end(replay);
		replay_counts(replay, &c);
		if (c.bytes != bytes || c.framer.bytes > bytes || c.framer.held)
			abort();
	}
	replay_free(replay);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct spool_reader *reader = NULL;
	struct err err = ERR_INIT;
	int fd = dup(fuzz_input_fd(bytes, size)), rc;

	if (fd < 0 || lseek(fd, 0, SEEK_SET))
		abort();
	rc = spool_open(fd, "fuzz.spool", &reader, &err);
	fuzz_input_check(rc, &err);
	if (!rc)
		read_all(reader, size);
	spool_reader_free(reader);
	return 0;
}
