/*
 * CoLa-A, the protocol of small line scanners: commands between STX and ETX are answered, and `sEN LMDscandata 1` starts one
 * telegram per sweep. The scanner looks straight down from ten metres above hilly ground and moves one metre per sweep. Shots
 * that miss the ground have range 0. Its clock runs at the rate of the script, or at 15 sweeps a second.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fake_device.h"

enum { SHOTS = 271, STX = 2, ETX = 3 };

/* Range of shot i in millimetres. The scan plane is across the direction of travel; 90 degrees is down. */
static unsigned shot_range(uint64_t number, unsigned i, uint64_t seed)
{
	double angle = (-45.0 + i) * M_PI / 180, down = sin(angle), side = cos(angle), height;

	if (down < 0.3)
		return 0;
	height = 10 - 0.8 * sin((double)number * 0.11 + (double)(seed % 7)) - 0.5 * sin(side / down * 4 + (double)number * 0.05);
	return (unsigned)(height / down * 1000 + 0.5);
}

uint8_t *fake_cola_telegram(const struct fake_device *d, uint64_t number, size_t *ret_size)
{
	char *text = NULL;
	size_t size = 0;
	FILE *f = open_memstream(&text, &size);
	double hz = d->hz > 0 ? d->hz : 15;
	uint64_t us = (uint64_t)((double)number * 1e6 / hz);

	if (!f)
		return NULL;
	fputc(STX, f);
	fprintf(f,
		"sSN LMDscandata 1 1 %llX 0 0 %llX %llX %llX %llX 0 0 3F 0 0 %X A2 0 1 DIST1 3F800000 00000000 FFF92230 2710 %X",
		(unsigned long long)(strtoull(d->serial, NULL, 10) & 0xffffffff), (unsigned long long)(number & 0xffff),
		(unsigned long long)(number & 0xffff), (unsigned long long)((us + 1000) & 0xffffffff),
		(unsigned long long)((us + 30000) & 0xffffffff), (unsigned)(hz * 100), SHOTS);
	for (unsigned i = 0; i < SHOTS; i++)
		fprintf(f, " %X", shot_range(number, i, d->seed));
	fprintf(f, " 1 RSSI1 3F800000 00000000 FFF92230 2710 %X", SHOTS);
	for (unsigned i = 0; i < SHOTS; i++)
		fprintf(f, " %X", shot_range(number, i, d->seed) ? 40 + (unsigned)((number * 31 + i * 7) % 200) : 0);
	fputs(" 0 0 0 0 0", f);
	fputc(ETX, f);
	if (fclose(f) != 0)
		return NULL;
	*ret_size = size;
	return (uint8_t *)text;
}

static void answer_add(struct fake_device *d, const char *text, const char *more)
{
	int n;

	if (d->answer_sent == d->answer_size)
		d->answer_size = d->answer_sent = 0;
	n = snprintf((char *)d->answer + d->answer_size, sizeof d->answer - d->answer_size, "%c%s%s%c", STX, text, more, ETX);
	if (n > 0 && d->answer_size + (size_t)n < sizeof d->answer)
		d->answer_size += (size_t)n;
	d->answers++;
}

void fake_cola_command(struct fake_device *d, const uint8_t *at, size_t size)
{
	char text[256];

	if (size && at[0] == STX) {
		at++;
		size--;
	}
	if (size && at[size - 1] == ETX)
		size--;
	if (size >= sizeof text)
		size = sizeof text - 1;
	memcpy(text, at, size);
	text[size] = '\0';
	if (strncmp(text, "sEN LMDscandata ", 16) == 0) {
		d->running = text[16] == '1';
		answer_add(d, "sEA LMDscandata ", d->running ? "1" : "0");
	} else if (strncmp(text, "sRN SerialNumber", 16) == 0) {
		answer_add(d, "sRA SerialNumber 8 ", d->serial);
	} else if (strncmp(text, "sRN ", 4) == 0) {
		strtok(text + 4, " ");
		memcpy(text, "sRA", 3);
		answer_add(d, text, " 1");
	} else if (strncmp(text, "sMN ", 4) == 0) {
		strtok(text + 4, " ");
		memcpy(text, "sAN", 3);
		answer_add(d, text, " 1");
	} else {
		answer_add(d, "sFA 4", "");
	}
}
