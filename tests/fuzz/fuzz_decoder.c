/* Any bytes as a telegram of each family. The first byte says of which profile. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cola_make.h"
#include "decoder.h"
#include "fuzz_input.h"
#include "profile.h"

static const char *const profiles[] = {
	"[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\n",
	"[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\nstamp = last\nahead = 0\n",
	("[decoder]\nname = ranges\nkind = u8@0\ndata-kind = 1\ncount = u16be@1\nrange = u32le@3\nrange-stride = 5\nintensity = u8@7\nangle-step = 1\n"
	 "counter = u8@3\ntime = u32be@4\nstamp = last\nperiod = 0.1\nintensity-stride = 5\n"),
	"[decoder]\nname = ranges\nrange = u16be@9\nrange-least = 3\nrange-most = 60000\nangle-step = -0.25\ncount = u32le@0\n",
	"[framer]\nkind = line\n[decoder]\nname = xyz\ncolumns = _xyzc\n",
};
enum { KINDS = sizeof profiles / sizeof *profiles };
static const char *const texts[] = {
	"\4"
	"7 1.5 2 3e2 4",
	"\4"
	"a;1;2;3;4;5",
	"\3\2\0\0\0abcde\1\2\3\4",
	"\2\1\0\2aaaabbbbbccccc",
	"\0sEA LMDscandata 1",
	("\1sSN LMDscandata 1 1 1 0 0 1 1 1 2 0 0 7 0 0 1388 168 1 0 3E8 2 DIST1 3F800000 0 186A0 1388 2 8A1 8A5 RSSI1 3F800000 0 1 1 2 3 4 0 1 0 0 0 0 0 "
	 "0 0 1 4 a  b 0 0 0"),
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static struct cola_scan scan;
	static uint8_t telegram[COLA_TELEGRAM_MAX];
	size_t n;

	if (i < 6) {
		n = i == 2 ? 14 : i == 3 ? 18 : strlen(texts[i] + 1) + 1;
		memcpy(bytes, texts[i], n);
		return n;
	}
	if (i > 14)
		return 0;
	cola_scan_tim551(&scan);
	scan.shots = (uint16_t)(i * 4);
	scan.rssi_bits = i % 3 * 8;
	scan.early = i % 2;
	scan.position = i % 4 == 1;
	scan.encoders = i % 5;
	cola_scan_step(&scan, i);
	n = cola_make(&scan, telegram, sizeof telegram);
	if (n < 3 || n > room)
		return 0;
	bytes[0] = 0;
	memcpy(bytes + 1, telegram + 1, n - 2);
	return n - 1;
}

static void check(const struct sweep *s)
{
	if (!s->shots || s->shots > SWEEP_SHOTS || !isfinite(s->first) || !isfinite(s->step) || !isfinite(s->period_s) ||
	    s->period_s < 0 || !isfinite(s->device_time_s) || (s->has_counter && (!s->counter_bits || s->counter_bits > 32)) ||
	    !memchr(s->device_serial, 0, sizeof s->device_serial))
		abort();
	for (uint32_t i = 0; i < s->shots; i++) {
		if (!isnan(s->range[i]) && !(s->range[i] >= 0 && isfinite(s->range[i])))
			abort();
		if (!isnan(s->intensity[i]) && !(s->intensity[i] >= 0 && s->intensity[i] <= 1))
			abort();
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static struct sweep *s;
	struct profile p;
	struct err err = ERR_INIT;
	const char *text;
	int rc;

	if (!s)
		s = sweep_new();
	if (size < 1 || !s)
		return 0;
	text = profiles[bytes[0] % KINDS];
	if (profile_parse(text, strlen(text), "f", "f", &p, &err) || decoder_check(&p, &err))
		abort();
	rc = decoder_find(p.decoder)->decode(bytes + 1, size - 1, &p, s, &err);
	if (rc < 0 && (rc != -ERR_INPUT || !*err.message || err.offset > size))
		abort();
	if (rc > 0 && rc != DECODER_NOT_DATA)
		abort();
	if (!rc && decoder_find(p.decoder)->kind == DECODER_SWEEP)
		check(s);
	return 0;
}
