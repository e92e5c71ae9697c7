/*
 * fake-gadget: the same pretended scanners as real gadgets of the kernel (FunctionFS), for a machine with dummy_hcd or a
 * USB device port. To the host they are devices like any other: udev, usbfs and all.
 *
 *   modprobe dummy_hcd is_high_speed=1 num=2; modprobe libcomposite; modprobe usb_f_fs
 *   fake-gadget [--udc dummy_udc.0]... [--report FILE] [--on-stop COMMAND] [--end] SCRIPT
 *
 * Device n of the script uses the n-th --udc, or dummy_udc.N. The gadget is made in configfs and removed at the end. To plug in,
 * its UDC is bound; to unplug, unbound. The program ends at SIGTERM or SIGINT, or with --end when all sources have ended. The
 * report is written at the end, and whenever a source ends.
 *
 * Limits of a gadget: babble and errors on the wire lose their bytes and have no other effect; `timeout` stops the reading of
 * commands; the only step is `start`; `stop` runs the COMMAND. The host's controller has taken all earlier bytes before the model
 * is asked for more, so an unplug in the script loses no bytes in the gadget.
 */
#include <endian.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/usb/functionfs.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "fake_device.h"

enum { CHUNK = 65536 };

struct gadget {
	struct fake_device *device;
	pthread_mutex_t lock;
	const char *udc;
	char folder[128], function[256], mount[64];
	int ep0, in, out;
	bool bound, reported;
	int64_t back_ns;
	unsigned plugs;
	uint64_t halts, cut_writes, cut_bytes;
};

static struct gadget gadgets[FAKE_DEVICES];
static size_t n_gadgets;
static volatile sig_atomic_t ending;

static int64_t now_ns(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return t.tv_sec * 1000000000ll + t.tv_nsec;
}

static void sleep_until(int64_t when_ns)
{
	int64_t left = when_ns - now_ns();

	if (left > 20000000)
		left = 20000000;
	if (left > 0)
		nanosleep(&(struct timespec){0, (long)left}, NULL);
}

__attribute__((format(printf, 2, 3))) static bool file_write(const char *path, const char *fmt, ...)
{
	char text[256];
	va_list ap;
	int n, fd = open(path, O_WRONLY | O_CLOEXEC);
	bool good;

	va_start(ap, fmt);
	n = vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	good = fd >= 0 && write(fd, text, (size_t)n) == n;
	if (!good)
		fprintf(stderr, "fake-gadget: %s: %s\n", path, strerror(errno));
	if (fd >= 0)
		close(fd);
	return good;
}

/* ---- configfs ---- */

__attribute__((format(printf, 1, 2))) static bool folder_make(const char *fmt, ...)
{
	char path[512];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(path, sizeof path, fmt, ap);
	va_end(ap);
	if (mkdir(path, 0755) == 0 || errno == EEXIST)
		return true;
	fprintf(stderr, "fake-gadget: %s: %s\n", path, strerror(errno));
	return false;
}

static bool gadget_file(const struct gadget *g, const char *name, const char *text)
{
	char path[256];

	snprintf(path, sizeof path, "%s/%s", g->folder, name);
	return file_write(path, "%s", text);
}

static bool gadget_make(struct gadget *g, size_t i)
{
	const struct fake_device *d = g->device;
	char text[16], link[256];

	mount("none", "/sys/kernel/config", "configfs", 0, NULL); /* often there already */
	snprintf(g->folder, sizeof g->folder, "/sys/kernel/config/usb_gadget/acut%zu", i);
	snprintf(g->function, sizeof g->function, "%s/functions/ffs.acut%zu", g->folder, i);
	snprintf(g->mount, sizeof g->mount, "/run/acut-gadget%zu", i);
	if (!folder_make("%s", g->folder) || !folder_make("%s/strings/0x409", g->folder) ||
	    !folder_make("%s/configs/c.1", g->folder) || !folder_make("%s", g->function) || !folder_make("%s", g->mount))
		return false;
	snprintf(text, sizeof text, "0x%04x", d->vendor);
	if (!gadget_file(g, "idVendor", text))
		return false;
	snprintf(text, sizeof text, "0x%04x", d->product);
	if (!gadget_file(g, "idProduct", text))
		return false;
	snprintf(text, sizeof text, "0x%02x", d->device_class);
	gadget_file(g, "bDeviceClass", text);
	if (d->serial[0])
		gadget_file(g, "strings/0x409/serialnumber", d->serial);
	gadget_file(g, "strings/0x409/manufacturer", d->manufacturer);
	gadget_file(g, "strings/0x409/product", d->model);
	snprintf(link, sizeof link, "%s/configs/c.1/f", g->folder);
	if (symlink(g->function, link) != 0 && errno != EEXIST)
		return false;
	snprintf(text, sizeof text, "acut%zu", i);
	if (mount(text, g->mount, "functionfs", 0, NULL) == 0)
		return true;
	fprintf(stderr, "fake-gadget: %s: %s\n", g->mount, strerror(errno));
	return false;
}

static bool gadget_bind(struct gadget *g, bool bind)
{
	if (g->bound == bind)
		return true;
	g->bound = bind;
	g->plugs += bind;
	return gadget_file(g, "UDC", bind ? g->udc : "\n");
}

static void gadget_remove(struct gadget *g)
{
	char path[300];

	gadget_bind(g, false);
	snprintf(path, sizeof path, "%s/configs/c.1/f", g->folder);
	unlink(path);
	umount2(g->mount, MNT_DETACH);
	rmdir(g->mount);
	snprintf(path, sizeof path, "%s/configs/c.1", g->folder);
	rmdir(path);
	rmdir(g->function);
	snprintf(path, sizeof path, "%s/strings/0x409", g->folder);
	rmdir(path);
	rmdir(g->folder);
}

/* ---- FunctionFS ---- */

static struct usb_endpoint_descriptor_no_audio endpoint(uint8_t address, uint16_t packet)
{
	return (struct usb_endpoint_descriptor_no_audio){
		.bLength = USB_DT_ENDPOINT_SIZE,
		.bDescriptorType = USB_DT_ENDPOINT,
		.bEndpointAddress = address,
		.bmAttributes = USB_ENDPOINT_XFER_BULK,
		.wMaxPacketSize = htole16(packet),
	};
}

static bool descriptors_write(struct gadget *g)
{
	struct speed {
		struct usb_interface_descriptor interface;
		struct usb_endpoint_descriptor_no_audio in, out;
	} __attribute__((packed));
	struct {
		struct usb_functionfs_descs_head_v2 head;
		__le32 full_count, high_count;
		struct speed full, high;
	} __attribute__((packed)) all = {
		.head = {.magic = htole32(FUNCTIONFS_DESCRIPTORS_MAGIC_V2),
			 .length = htole32(sizeof all),
			 .flags = htole32(FUNCTIONFS_HAS_FS_DESC | FUNCTIONFS_HAS_HS_DESC)},
		.full_count = htole32(3),
		.high_count = htole32(3),
		.full.interface = {.bLength = USB_DT_INTERFACE_SIZE,
				   .bDescriptorType = USB_DT_INTERFACE,
				   .bNumEndpoints = 2,
				   .bInterfaceClass = g->device->interface_class,
				   .iInterface = 0},
	};
	struct usb_functionfs_strings_head none = {.magic = htole32(FUNCTIONFS_STRINGS_MAGIC), .length = htole32(sizeof none)};

	all.full.in = endpoint(g->device->endpoint_in, 64);
	all.full.out = endpoint(g->device->endpoint_out, 64);
	all.high.interface = all.full.interface;
	all.high.in = endpoint(g->device->endpoint_in, 512);
	all.high.out = endpoint(g->device->endpoint_out, 512);
	return write(g->ep0, &all, sizeof all) == sizeof all && write(g->ep0, &none, sizeof none) == sizeof none;
}

static int endpoint_open(struct gadget *g, unsigned n)
{
	char path[80];

	snprintf(path, sizeof path, "%s/ep%u", g->mount, n);
	return open(path, O_RDWR | O_CLOEXEC);
}

static bool gadget_open(struct gadget *g)
{
	g->ep0 = endpoint_open(g, 0);
	if (g->ep0 < 0 || !descriptors_write(g)) {
		fprintf(stderr, "fake-gadget: %s/ep0: %s\n", g->mount, strerror(errno));
		return false;
	}
	g->in = endpoint_open(g, 1);
	g->out = endpoint_open(g, 2);
	return g->in >= 0 && g->out >= 0;
}

/* ---- threads ---- */

static void *events_thread(void *ctx)
{
	struct gadget *g = ctx;
	struct usb_functionfs_event event;

	while (read(g->ep0, &event, sizeof event) == sizeof event) {
		if (event.type != FUNCTIONFS_SETUP)
			continue;
		/* not known: an answer in the wrong direction makes the endpoint halt */
		if (event.u.setup.bRequestType & USB_DIR_IN) {
			if (read(g->ep0, &event, 0) < 0)
				continue;
		} else if (write(g->ep0, &event, 0) < 0) {
			continue;
		}
	}
	return NULL;
}

static void *out_thread(void *ctx)
{
	struct gadget *g = ctx;
	uint8_t command[512];

	for (;;) {
		ssize_t n;
		bool deaf;

		pthread_mutex_lock(&g->lock);
		deaf = g->device->deaf || g->device->gone || !g->bound;
		pthread_mutex_unlock(&g->lock);
		n = deaf ? -1 : read(g->out, command, sizeof command);
		if (n < 0) {
			sleep_until(now_ns() + 5000000);
			continue;
		}
		pthread_mutex_lock(&g->lock);
		fake_device_step(g->device, FAKE_AT_START, now_ns());
		if (!g->device->gone)
			fake_device_out(g->device, now_ns(), command, (size_t)n);
		pthread_mutex_unlock(&g->lock);
	}
	return NULL;
}

/* Fills `at` with whole packets, or up to a short one. */
static size_t chunk_fill(struct gadget *g, uint8_t *at, struct fake_in *in)
{
	size_t filled = 0;

	pthread_mutex_lock(&g->lock);
	do {
		fake_device_in(g->device, now_ns(), at + filled, CHUNK - filled, in);
		filled += in->size;
	} while (in->kind == FAKE_BYTES && !in->ends && filled < CHUNK);
	if (in->kind == FAKE_HALT)
		g->device->halted = false; /* the endpoint is, from now on; the host clears it */
	pthread_mutex_unlock(&g->lock);
	return filled;
}

static void *in_thread(void *ctx)
{
	struct gadget *g = ctx;
	static __thread uint8_t bytes[CHUNK];

	for (;;) {
		struct fake_in in;
		size_t n;
		ssize_t written = 0;

		pthread_mutex_lock(&g->lock);
		n = g->bound;
		pthread_mutex_unlock(&g->lock);
		if (!n) {
			sleep_until(now_ns() + 2000000);
			continue;
		}
		n = chunk_fill(g, bytes, &in);
		if (n || in.ends)
			written = write(g->in, bytes, n);
		if (written >= 0 && in.ends && n && n % g->device->packet == 0)
			written = write(g->in, bytes, 0);
		if (written < 0) {
			g->cut_writes++;
			g->cut_bytes += n;
			sleep_until(now_ns() + 5000000);
		}
		if (in.kind == FAKE_HALT && read(g->in, bytes, 1) < 0)
			g->halts++;
		else if (in.kind == FAKE_WAIT || in.kind == FAKE_GONE)
			sleep_until(in.kind == FAKE_GONE ? now_ns() + 5000000 : in.when_ns);
	}
	return NULL;
}

/* ---- main ---- */

static void on_signal(int n)
{
	(void)n;
	ending = 1;
}

static void report_write(const char *path)
{
	FILE *f = path ? fopen(path, "we") : NULL;

	if (!f)
		return;
	fputs("{\"devices\": [", f);
	for (size_t i = 0; i < n_gadgets; i++) {
		struct gadget *g = &gadgets[i];

		pthread_mutex_lock(&g->lock);
		fprintf(f, "%s{\"plugs\": %u, \"halts\": %llu, \"cut_writes\": %llu, \"cut_bytes\": %llu, \"model\": ",
			i ? ", " : "", g->plugs, (unsigned long long)g->halts, (unsigned long long)g->cut_writes,
			(unsigned long long)g->cut_bytes);
		if (g->device->delivered_file)
			fflush(g->device->delivered_file);
		fake_report(f, g->device);
		fputs("}", f);
		pthread_mutex_unlock(&g->lock);
	}
	fputs("]}\n", f);
	fclose(f);
}

/* True: its source ended. */
static bool gadget_tick(struct gadget *g, int64_t began_ns, const char *on_stop)
{
	struct fake_device *d = g->device;
	bool leave = false, come = false, stop, ended;

	pthread_mutex_lock(&g->lock);
	if (d->away && now_ns() - began_ns >= d->appear_ns) {
		d->away = false;
		come = true;
	} else if (!d->gone && !g->bound && !d->away) {
		come = true;
	} else if (d->gone && g->bound) {
		leave = true;
		g->back_ns = d->gone_for_ns ? now_ns() + d->gone_for_ns : FAKE_NEVER;
	} else if (d->gone && now_ns() >= g->back_ns) {
		fake_device_plug(d);
		come = true;
	}
	stop = d->wants_stop;
	d->wants_stop = false;
	ended = d->ended || (d->gone && !d->gone_for_ns);
	pthread_mutex_unlock(&g->lock);
	if (leave)
		gadget_bind(g, false);
	if (come)
		gadget_bind(g, true);
	if (stop && on_stop && system(on_stop) != 0)
		fprintf(stderr, "fake-gadget: %s failed\n", on_stop);
	return ended;
}

static int gadgets_run(const char *report, const char *on_stop, bool until_end)
{
	int64_t began = now_ns();
	pthread_t thread;
	size_t ended = 0, before = 0;

	for (size_t i = 0; i < n_gadgets; i++) {
		struct gadget *g = &gadgets[i];

		if (!gadget_make(g, i) || !gadget_open(g))
			return 1;
		if (pthread_create(&thread, NULL, events_thread, g) != 0 || pthread_create(&thread, NULL, in_thread, g) != 0 ||
		    pthread_create(&thread, NULL, out_thread, g) != 0)
			return 1;
	}
	while (!ending && !(until_end && ended == n_gadgets)) {
		ended = 0;
		for (size_t i = 0; i < n_gadgets; i++)
			ended += gadget_tick(&gadgets[i], began, on_stop);
		if (ended != before)
			report_write(report);
		before = ended;
		nanosleep(&(struct timespec){0, 3000000}, NULL);
	}
	if (until_end)
		nanosleep(&(struct timespec){1, 0}, NULL); /* the host reads the last bytes */
	report_write(report);
	for (size_t i = 0; i < n_gadgets; i++)
		gadget_remove(&gadgets[i]);
	return 0;
}

int main(int argc, char **argv)
{
	static char names[FAKE_DEVICES][32];
	const char *udcs[FAKE_DEVICES], *report = NULL, *script = NULL, *on_stop = NULL;
	struct fake_device *devices;
	bool until_end = false;
	size_t n_udcs = 0;

	for (int i = 1; i < argc; i++) {
		if (strcmp(argv[i], "--udc") == 0 && i + 1 < argc && n_udcs < FAKE_DEVICES)
			udcs[n_udcs++] = argv[++i];
		else if (strcmp(argv[i], "--report") == 0 && i + 1 < argc)
			report = argv[++i];
		else if (strcmp(argv[i], "--on-stop") == 0 && i + 1 < argc)
			on_stop = argv[++i];
		else if (strcmp(argv[i], "--end") == 0)
			until_end = true;
		else
			script = argv[i];
	}
	if (!script || !fake_script_read(script, &devices, &n_gadgets)) {
		fputs("usage: fake-gadget [--udc NAME]... [--report FILE] [--on-stop COMMAND] [--end] SCRIPT\n", stderr);
		return 2;
	}
	for (size_t i = 0; i < n_gadgets; i++) {
		snprintf(names[i], sizeof names[i], "dummy_udc.%zu", i);
		gadgets[i].device = &devices[i];
		gadgets[i].udc = i < n_udcs ? udcs[i] : names[i];
		pthread_mutex_init(&gadgets[i].lock, NULL);
		if (!fake_device_open_source(&devices[i]))
			return 2;
	}
	signal(SIGTERM, on_signal);
	signal(SIGINT, on_signal);
	signal(SIGPIPE, SIG_IGN);
	return gadgets_run(report, on_stop, until_end);
}
