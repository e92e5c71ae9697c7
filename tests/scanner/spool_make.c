/*
 * spool-make OUT PROFILE [sweeps N | bytes FILE] [cut N] [lose I] [bad I] [twice I] [unended]: a spool as a capture of a TiM, or
 * of the bytes of a file, writes it, in transfers of N bytes (16384), one sweep each 66.7 ms from 2026-07-01 10:00 UTC on. Of the
 * sweeps with these numbers one is left out, has a byte changed, comes twice. For tests of what reads spools.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cola_make.h"
#include "err.h"
#include "profile.h"
#include "spool.h"

static const int64_t UTC = 1782900000000000000, MONOTONIC = 1000000000000;

struct options {
	long sweeps, cut, lose, bad, twice;
	const char *bytes;
	bool unended;
};

static void die(const struct err *err)
{
	char text[1500];

	fprintf(stderr, "spool-make: %s\n", err_format(err, text, sizeof text));
	exit(1);
}

static void put(struct spool_writer *w, long cut, int64_t time_ns, const uint8_t *at, size_t size)
{
	struct err err = ERR_INIT;

	for (size_t done = 0, n; done < size; done += n) {
		n = size - done < (size_t)cut ? size - done : (size_t)cut;
		if (spool_append(w, SPOOL_DATA, n < (size_t)cut ? SPOOL_SHORT : 0, time_ns, at + done, n, &err))
			die(&err);
	}
}

static void put_sweeps(struct spool_writer *w, const struct options *o)
{
	static struct cola_scan scan;
	static uint8_t telegram[COLA_TELEGRAM_MAX];

	cola_scan_tim551(&scan);
	scan.rssi_bits = 8;
	for (long i = 0; i < o->sweeps; i++) {
		size_t n;

		cola_scan_step(&scan, (uint32_t)i);
		n = cola_make(&scan, telegram, sizeof telegram);
		if (i == o->bad)
			telegram[n / 2] = 'Q';
		for (int twice = i == o->lose ? 2 : i == o->twice ? 0 : 1; twice < 2; twice++)
			put(w, o->cut, MONOTONIC + (int64_t)((double)i / 15 * 1e9), telegram, n);
	}
}

static void put_file(struct spool_writer *w, const struct options *o)
{
	FILE *f = fopen(o->bytes, "rb");
	uint8_t *at = malloc((size_t)o->cut);
	size_t n;
	int64_t time_ns = MONOTONIC;

	if (!f || !at) {
		perror(o->bytes);
		exit(1);
	}
	while ((n = fread(at, 1, (size_t)o->cut, f)) > 0)
		put(w, o->cut, time_ns += 1000000, at, n);
	fclose(f);
	free(at);
}

static struct options options_of(int argc, char **argv)
{
	struct options o = {.sweeps = 0, .cut = 16384, .lose = -1, .bad = -1, .twice = -1};

	for (int i = 3; i < argc; i++) {
		const char *word = argv[i];
		long *to = !strcmp(word, "sweeps") ? &o.sweeps :
			   !strcmp(word, "cut")    ? &o.cut :
			   !strcmp(word, "lose")   ? &o.lose :
			   !strcmp(word, "bad")    ? &o.bad :
			   !strcmp(word, "twice")  ? &o.twice :
						     NULL;

		if (!strcmp(word, "unended"))
			o.unended = true;
		else if (!strcmp(word, "bytes") && i + 1 < argc)
			o.bytes = argv[++i];
		else if (to && i + 1 < argc)
			*to = atol(argv[++i]);
		else
			exit(2);
	}
	return o;
}

int main(int argc, char **argv)
{
	struct options o = options_of(argc, argv);
	struct spool_head head = {.vendor = 0x19a2,
				  .product = 0x5001,
				  .manufacturer = "SICK AG",
				  .model = "TiM551",
				  .serial = "17271466",
				  .port = "1-2"};
	struct profile_entry *profile;
	struct spool_writer *w;
	struct err err = ERR_INIT;

	if (argc < 3)
		return 2;
	if (profile_entry_read(argv[2], &profile, &err))
		die(&err);
	snprintf(head.profile_name, sizeof head.profile_name, "%s", profile->profile.name);
	head.profile = strdup(profile->text);
	head.profile_size = profile->size;
	head.utc_ns = UTC;
	head.monotonic_ns = MONOTONIC;
	if (spool_create(argv[1], &head, &w, &err))
		die(&err);
	if (o.bytes)
		put_file(w, &o);
	else
		put_sweeps(w, &o);
	if (spool_event(w, MONOTONIC, &err, "stop asked") || (!o.unended && spool_end(w, &err)))
		die(&err);
	spool_writer_free(w);
	spool_head_clear(&head);
	profile_entry_free(profile);
	return 0;
}
