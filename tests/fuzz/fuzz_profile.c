/* Any bytes as a profile: what is taken keeps to the bounds that others rely on; what is not has a sentence. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "decoder.h"
#include "fuzz_input.h"
#include "profile.h"

static const char *const texts[] = {
	"title = A\nnote = \"b \"\n[match]\nvendor = 0x19A2\nproduct = 20481\nserial = SN*?7\ninterface-class = 0xff\n",
	"[usb]\nconfiguration = 2\nendpoint-in = 0x83\nendpoint-out = 0x04\ntransfer-size = 32K\ntransfers = 12\ntimeout = 1.5s\n"
	"[start]\nsend = \\x02on\\x03\nanswer = \\x02ok\nsend = \\r\\n\\t\\0\\\\\n[stop]\nsend = off\n",
	"[framer]\nkind = length\ntelegram-max = 9K\nsync = \\xaa\\x55\nlength = u16be@2\nlength-add = 4\n[decoder]\nname = ranges\nkind = u8@4\n"
	"data-kind = 0x10\ncount = u16le@5\nrange = u32be@7\nrange-scale = 0.004\nangle-step = -0.5\n[time]\nsource = device\n",
	"[framer]\nkind = line\nstarts-torn = yes\n[decoder]\nname = xyz\ncolumns = _xyz\n[geometry]\nmount-roll = 180\nlever-x = 1e-1\nrange-max = 25\n",
	"[framer]\nkind = stx-etx\n[decoder]\nname = cola-a\nahead = 90\nstamp = last\n",
	"[framer]\nkind = fixed\nsize = 24\nsync = RS\n",
	"\xef\xbb\xbf# c\r\n;\n",
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

static bool text_ok(const char *text, size_t room)
{
	return memchr(text, 0, room) != NULL;
}

static void check(const struct profile *p)
{
	if (!text_ok(p->title, sizeof p->title) || !text_ok(p->note, sizeof p->note) || !text_ok(p->serial, sizeof p->serial) ||
	    !text_ok(p->decoder, sizeof p->decoder) || !text_ok(p->columns, sizeof p->columns) ||
	    !text_ok(p->name, sizeof p->name))
		abort();
	if (p->transfer_size < 512 || p->transfer_size % 512 || p->transfer_size > 1 << 20 || !p->transfers ||
	    p->transfers > 256 || !p->timeout_ms)
		abort();
	if (!(p->endpoint_in & 0x80) || (p->endpoint_out & 0x80) || p->starts > PROFILE_COMMANDS || p->stops > PROFILE_COMMANDS)
		abort();
	for (size_t i = 0; i < p->starts; i++)
		if (!p->start[i].size || p->start[i].size > PROFILE_COMMAND_SIZE ||
		    p->start[i].answer_size > PROFILE_COMMAND_SIZE)
			abort();
	if (!p->telegram_max || p->telegram_max > 1 << 20 || p->fixed_size > p->telegram_max || p->sync_size > sizeof p->sync)
		abort();
	if (p->framer == PROFILE_FRAMER_LENGTH && (!p->length_size || p->length_offset + p->length_size > p->telegram_max))
		abort();
	if (!isfinite(p->mount_roll) || !isfinite(p->lever[0]) || !isfinite(p->latency_s) || !(p->ranges.range_scale > 0))
		abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static struct profile p, again; /* with no byte that is not set */
	struct err err = ERR_INIT;
	int rc = profile_parse((const char *)bytes, size, "some", "/some.conf", &p, &err);

	fuzz_input_check(rc, &err);
	if (rc && (rc != -ERR_INPUT || strcmp(err.file, "/some.conf")))
		abort();
	if (rc)
		return 0;
	check(&p);
	if (profile_parse((const char *)bytes, size, "some", "/some.conf", &again, &err) || memcmp(&p, &again, sizeof p))
		abort();
	fuzz_input_check(decoder_check(&p, &err), &err);
	return 0;
}
