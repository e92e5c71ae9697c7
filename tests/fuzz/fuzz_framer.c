/* Any bytes to each framer: in one piece, byte by byte and in pieces the same telegrams and counts, and all bytes are somewhere.
 * The first byte says which framer, the second how it is cut and whether there are gaps. */
#include <stdlib.h>
#include <string.h>

#include "digest.h"
#include "fuzz_input.h"
#include "framer.h"
#include "profile.h"

#define SEED(text)                     \
	{                              \
		text, sizeof(text) - 1 \
	}
static const struct {
	const char *at;
	size_t size;
} texts[] = {
	SEED("\0\0\2sSN LMDscandata\3\2\2a\3"), SEED("\1\3abc\r\nde\n\n"), SEED("\2\0abcdefg"),
	SEED("\3\1SYabcdSYefghxxSY"),           SEED("\4\0\5abcde\1\3ab"), SEED("\5\2SYS\0\7abSYS\0\5SYS\0\7defg"),
};
enum { TEXTS = sizeof texts / sizeof *texts };

static const char *const profiles[] = {
	"[framer]\nkind = stx-etx\ntelegram-max = 20\n",
	"[framer]\nkind = line\ntelegram-max = 20\n",
	"[framer]\nkind = fixed\nsize = 7\n",
	"[framer]\nkind = fixed\nsize = 6\nsync = SY\n",
	"[framer]\nkind = length\nlength = u8@0\nlength-add = 1\ntelegram-max = 50\n",
	"[framer]\nkind = length\nlength = u16be@3\nsync = SYS\ntelegram-max = 50\n",
	"[framer]\nkind = las\n",
	"[framer]\nkind = line\ntelegram-max = 1\nstarts-torn = yes\n",
};
enum { KINDS = sizeof profiles / sizeof *profiles };

static size_t las(uint8_t *at, size_t room)
{
	memset(at, 0, 512);
	memcpy(at, "\6\1LASF", 6);
	at[2 + 24] = 1;
	at[2 + 25] = 4;
	memcpy(at + 2 + 94, "\167\1\167\1\0\0", 6); /* 375 */
	at[2 + 105] = 20;
	at[2 + 247] = 2;
	at[2 + 235] = (375 + 40) & 255;
	at[2 + 236] = (375 + 40) >> 8;
	at[2 + 243] = 1;
	at[2 + 375 + 40 + 20] = 3;
	return 2 + 375 + 40 + 63;
}

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	if (i < TEXTS && texts[i].size <= room) {
		memcpy(bytes, texts[i].at, texts[i].size);
		return texts[i].size;
	}
	return i == TEXTS && room >= 512 ? las(bytes, room) : 0;
}

struct seen {
	struct digest_stream *digest;
	uint64_t bytes;
};

static int sink(void *ctx, const struct telegram *t)
{
	struct seen *s = ctx;
	uint64_t head[] = {t->size, t->number, t->offset, t->file, t->file_begins, t->file_ends};

	digest_stream_add(s->digest, head, sizeof head);
	digest_stream_add(s->digest, t->at, t->size);
	s->bytes += t->size;
	return 0;
}

static void bad(void *ctx, enum framer_reason reason, uint64_t offset, uint64_t size)
{
	uint64_t head[] = {reason, offset, size};

	digest_stream_add(((struct seen *)ctx)->digest, head, sizeof head);
}

static struct digest run(const struct profile *p, const uint8_t *bytes, size_t size, size_t piece, size_t gap,
			 struct framer_counts *c)
{
	struct seen s = {.digest = digest_stream_new()};
	struct err err = ERR_INIT;
	struct framer *f;
	struct digest d;

	if (!s.digest || framer_new(p, sink, &s, &f, &err))
		abort();
	framer_on_bad(f, bad, &s);
	for (size_t at = 0, n; at < size; at += n) {
		uint8_t *copy;

		n = size - at < piece ? size - at : piece;
		if (gap && at < gap && at + n > gap)
			n = gap - at;
		if (gap && at == gap)
			framer_gap(f);
		copy = malloc(n);
		if (!copy)
			abort();
		memcpy(copy, bytes + at, n);
		if (framer_feed(f, copy, n, (int64_t)at))
			abort();
		free(copy);
		framer_counts(f, c);
		if (c->bytes != at + n || c->bytes != c->framed + c->skipped + c->held || c->held > 20 + (64 << 10) + 8192)
			abort();
	}
	framer_end(f);
	framer_counts(f, c);
	if (c->held || c->bytes != c->framed + c->skipped || s.bytes > c->framed)
		abort();
	framer_free(f);
	d = digest_stream_end(s.digest);
	digest_stream_free(s.digest);
	return d;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct framer_counts a, b;
	struct profile p;
	struct err err = ERR_INIT;
	const char *text;
	struct digest whole;
	size_t gap;

	if (size < 3)
		return 0;
	text = profiles[bytes[0] % KINDS];
	gap = bytes[1] & 1 ? bytes[1] >> 1 : 0;
	if (profile_parse(text, strlen(text), "f", "f", &p, &err))
		abort();
	whole = run(&p, bytes + 2, size - 2, size, gap, &a);
	for (size_t piece = 1; piece < 100; piece = piece * 3 + 1) {
		struct digest cut = run(&p, bytes + 2, size - 2, piece, gap, &b);

		if (!digest_equal(whole, cut) || memcmp(&a, &b, sizeof a))
			abort();
	}
	return 0;
}
