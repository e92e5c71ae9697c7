/*
 * A minimal capture program, which tests the model: opens VENDOR:PRODUCT, claims it, sends a command if one is given, keeps
 * transfers in flight and writes what comes to a file, until SIGINT, BYTES, or an unplug. What it wrote must have the hash of the
 * model.
 */
#include <libusb.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TRANSFERS = 8, SIZE = 65536 };

static volatile sig_atomic_t stopping;
static FILE *out;
static unsigned in_flight;
static unsigned long long bytes, wanted;
static int halted, gone;
static unsigned endpoint_in;

static void on_signal(int n)
{
	(void)n;
	stopping = 1;
}

static void done(struct libusb_transfer *t)
{
	fwrite(t->buffer, 1, (size_t)t->actual_length, out);
	bytes += (unsigned)t->actual_length;
	in_flight--;
	if (t->status == LIBUSB_TRANSFER_NO_DEVICE)
		gone = 1;
	if (t->status == LIBUSB_TRANSFER_STALL)
		halted = 1;
	if (t->status == LIBUSB_TRANSFER_CANCELLED || gone || stopping || halted)
		return;
	if (libusb_submit_transfer(t) == 0)
		in_flight++;
	else
		gone = 1;
}

int main(int argc, char **argv)
{
	unsigned vendor, product;
	struct libusb_transfer *transfers[TRANSFERS];
	libusb_context *ctx;
	libusb_device_handle *handle;
	struct timeval soon = {0, 50000};

	if (argc < 3 || sscanf(argv[1], "%x:%x", &vendor, &product) != 2 || !(out = fopen(argv[2], "wbe")))
		return 2;
	wanted = argc > 3 ? strtoull(argv[3], NULL, 10) : 0;
	endpoint_in = 0x81;
	signal(SIGINT, on_signal);
	if (libusb_init(&ctx) != 0)
		return 3;
	handle = libusb_open_device_with_vid_pid(ctx, (uint16_t)vendor, (uint16_t)product);
	if (!handle || libusb_claim_interface(handle, 0) != 0) {
		fprintf(stderr, "no device\n");
		return 4;
	}
	if (argc > 4) {
		int sent, n = (int)strlen(argv[4]);

		if (libusb_bulk_transfer(handle, 0x02, (unsigned char *)argv[4], n, &sent, 1000) != 0)
			fprintf(stderr, "command not taken\n");
	}
	for (int i = 0; i < TRANSFERS; i++) {
		transfers[i] = libusb_alloc_transfer(0);
		libusb_fill_bulk_transfer(transfers[i], handle, (unsigned char)endpoint_in, malloc(SIZE), SIZE, done, NULL, 0);
		if (!gone && libusb_submit_transfer(transfers[i]) == 0)
			in_flight++;
		else
			gone = 1;
	}
	while (!gone && !stopping) {
		libusb_handle_events_timeout(ctx, &soon);
		if (wanted && bytes >= wanted)
			stopping = 1;
		if (!halted || in_flight)
			continue;
		halted = 0;
		if (libusb_clear_halt(handle, (unsigned char)endpoint_in) != 0)
			break;
		for (int i = 0; i < TRANSFERS; i++)
			if (libusb_submit_transfer(transfers[i]) == 0)
				in_flight++;
	}
	for (int i = 0; i < TRANSFERS; i++)
		libusb_cancel_transfer(transfers[i]);
	while (in_flight)
		libusb_handle_events_timeout(ctx, &soon);
	for (int i = 0; i < TRANSFERS; i++) {
		free(transfers[i]->buffer);
		libusb_free_transfer(transfers[i]);
	}
	libusb_release_interface(handle, 0);
	libusb_close(handle);
	libusb_exit(ctx);
	fprintf(stderr, "%llu bytes%s\n", bytes, gone ? ", gone" : "");
	return fclose(out) == 0 ? 0 : 5;
}
