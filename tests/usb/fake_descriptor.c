/* Descriptors of the device in the format of the wire, and the control requests that read them. */
#include <errno.h>
#include <string.h>

#include "fake_device.h"

static void put16(uint8_t *at, unsigned v)
{
	at[0] = (uint8_t)v;
	at[1] = (uint8_t)(v >> 8);
}

static size_t endpoint_put(uint8_t *at, uint8_t address, unsigned packet)
{
	at[0] = 7;
	at[1] = 5;
	at[2] = address;
	at[3] = 2; /* bulk */
	put16(at + 4, packet);
	at[6] = 0;
	return 7;
}

size_t fake_descriptors(const struct fake_device *d, uint8_t at[FAKE_DESCRIPTORS])
{
	uint8_t *conf = at + 18, *p;

	memset(at, 0, FAKE_DESCRIPTORS);
	at[0] = 18;
	at[1] = 1;
	put16(at + 2, 0x0200);
	at[4] = d->device_class;
	at[7] = 64;
	put16(at + 8, d->vendor);
	put16(at + 10, d->product);
	put16(at + 12, 0x0100);
	at[14] = d->manufacturer[0] ? 1 : 0;
	at[15] = d->model[0] ? 2 : 0;
	at[16] = d->serial[0] ? 3 : 0;
	at[17] = 1;
	conf[0] = 9;
	conf[1] = 2;
	conf[4] = 1; /* interfaces */
	conf[5] = 1; /* its value */
	conf[7] = 0x80;
	conf[8] = 50;
	p = conf + 9;
	p[0] = 9;
	p[1] = 4;
	p[4] = (uint8_t)((d->endpoint_in != 0) + (d->endpoint_out != 0));
	p[5] = d->interface_class;
	p[6] = d->interface_class == 8 ? 6 : 0;
	p[7] = d->interface_class == 8 ? 0x50 : 0;
	p += 9;
	if (d->endpoint_in)
		p += endpoint_put(p, d->endpoint_in, d->packet);
	if (d->endpoint_out)
		p += endpoint_put(p, d->endpoint_out, d->packet);
	put16(conf + 2, (unsigned)(p - conf));
	return (size_t)(p - at);
}

size_t fake_string(const struct fake_device *d, unsigned i, uint8_t at[FAKE_DESCRIPTORS])
{
	const char *texts[] = {NULL, d->manufacturer, d->model, d->serial};
	size_t n;

	at[1] = 3;
	if (i == 0) {
		at[0] = 4;
		put16(at + 2, 0x0409);
		return 4;
	}
	if (i > 3 || !texts[i][0])
		return 0;
	n = strlen(texts[i]);
	if (n > (FAKE_DESCRIPTORS - 4) / 2)
		n = (FAKE_DESCRIPTORS - 4) / 2;
	at[0] = (uint8_t)(2 + 2 * n);
	for (size_t k = 0; k < n; k++)
		put16(at + 2 + 2 * k, (uint8_t)texts[i][k]);
	return 2 + 2 * n;
}

int fake_control(struct fake_device *d, const uint8_t setup[8], uint8_t *at, size_t room)
{
	uint8_t whole[FAKE_DESCRIPTORS], *from = whole;
	unsigned value = setup[2] | (unsigned)setup[3] << 8, index = setup[4] | (unsigned)setup[5] << 8;
	size_t n = 0;

	if (setup[0] == 0x80 && setup[1] == 6) {
		n = fake_descriptors(d, whole);
		if (value >> 8 == 1)
			n = 18;
		else if (value >> 8 == 2)
			from += 18, n -= 18;
		else if (value >> 8 == 3)
			n = fake_string(d, value & 0xff, whole);
		else
			n = 0;
	} else if ((setup[0] & 0x7f) <= 2 && setup[0] & 0x80 && setup[1] == 0) {
		whole[0] = setup[0] == 0x82 && (index & 0xff) == d->endpoint_in && d->halted;
		whole[1] = 0;
		n = 2;
	} else if (setup[0] == 2 && setup[1] == 1) { /* CLEAR_FEATURE of an endpoint */
		fake_device_clear_halt(d, (uint8_t)index);
		return 0;
	} else if (setup[0] == 0 && setup[1] == 9) {
		return 0;
	}
	if (n == 0)
		return -EPIPE;
	if (n > room)
		n = room;
	memcpy(at, from, n);
	return (int)n;
}
