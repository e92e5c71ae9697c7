/* How fast framers and decoders are: MB/s over made bytes in transfers of 16 KiB. replay-speed [MB] */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cola_make.h"
#include "err.h"
#include "profile.h"
#include "replay.h"

enum { TRANSFER = 16384 };

static uint64_t given;

static int count(void *ctx, const struct telegram *t)
{
	given += t->size;
	return 0;
}

static double now(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return (double)t.tv_sec + (double)t.tv_nsec / 1e9;
}

static void run(const char *name, const char *text, const uint8_t *bytes, size_t size, size_t piece)
{
	struct replay_sinks sinks = {0};
	struct replay_clock clock = {0};
	struct replay_counts c;
	struct replay *r;
	struct profile p;
	struct framer *f;
	struct err err = ERR_INIT;
	double start, framed, decoded;

	if (profile_parse(text, strlen(text), "speed", "speed", &p, &err) || framer_new(&p, count, NULL, &f, &err) ||
	    replay_new(&p, &clock, &sinks, &r, &err))
		exit(1);
	start = now();
	for (size_t at = 0; at < size; at += piece)
		framer_feed(f, bytes + at, size - at < piece ? size - at : piece, 0);
	framer_end(f);
	framed = now() - start;
	start = now();
	for (size_t at = 0; at < size; at += piece)
		replay_feed(r, bytes + at, size - at < piece ? size - at : piece, (int64_t)at);
	replay_end(r);
	decoded = now() - start;
	replay_counts(r, &c);
	printf("%-10s pieces of %-6zu framer %7.0f MB/s; framer and decoder %6.0f MB/s (%llu sweeps, %llu points, %llu bad)\n",
	       name, piece, (double)size / 1e6 / framed, (double)size / 1e6 / decoded, (unsigned long long)c.sweeps,
	       (unsigned long long)c.points, (unsigned long long)(c.framer.bad + c.undecoded));
	framer_free(f);
	replay_free(r);
}

int main(int argc, char **argv)
{
	size_t room = (argc > 1 ? strtoul(argv[1], NULL, 10) : 50) * 1000000, n = 0;
	uint8_t *bytes = malloc(room + COLA_TELEGRAM_MAX);
	static struct cola_scan scan;

	if (!bytes)
		return 1;
	cola_scan_tim551(&scan);
	scan.shots = 811;
	scan.step = 3333;
	scan.rssi_bits = 8;
	for (uint32_t i = 0; n < room; i++) {
		cola_scan_step(&scan, i);
		n += cola_make(&scan, bytes + n, COLA_TELEGRAM_MAX);
	}
	run("cola-a", "[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\n[time]\nsource = device\n", bytes, n, TRANSFER);
	run("cola-a", "[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\n[time]\nsource = device\n", bytes, n, 512);
	for (size_t i = 0; i + 1500 <= n; i += 1500)
		memcpy(bytes + i, "\xaa\x55\xd8\5", 4); /* 1500 - 4 */
	n -= n % 1500;
	run("ranges",
	    "[framer]\nkind = length\nsync = \\xaa\\x55\nlength = u16le@2\nlength-add = 4\n[decoder]\nname = ranges\nrange = u16le@4\n"
	    "angle-step = 0.5\nperiod = 0.1\n",
	    bytes, n, TRANSFER);
	for (size_t i = 0; i + 32 <= n; i += 32)
		memcpy(bytes + i, "412345.678 5412345.678 123.4567\n", 32);
	n -= n % 32;
	run("xyz", "[framer]\nkind = line\n[decoder]\nname = xyz\n", bytes, n, TRANSFER);
	free(bytes);
	return 0;
}
