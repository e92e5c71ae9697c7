/*
 * A minimal capture program over scanner/usb, for its tests: writes what came to a file, prints a line for each event and one
 * with the counts.
 *
 *   usb-capture [--list] [--watch SECONDS] [--changes N] [--device WHICH] [--profile FILE] [--out FILE] [--bytes N] [--slow MS]
 *               [--hold N] [--until-parked] [--again] [--wait] [--waits FILE] [--debug] [--memory MB] [--drop]
 *
 * --changes: watch until there were N changes
 * --slow:    keep each buffer until no transfer is in flight because buffers are lacking (or until a stop), and MS longer
 * --hold:    never give back N buffers
 * --until-parked: stop once no transfer is in flight because buffers are lacking
 * --again:   capture again when the device comes back
 * --drop:    free the capture after --bytes, without a stop
 * --wait:    wait for a device if there is none
 * --waits:   a file that is created when the wait begins
 * --memory:  the kernel's limit (usbfs_memory_mb) in umockdev's folder
 *
 * SIGINT stops it. The exit status is that of the error.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "log.h"
#include "profile.h"
#include "usb.h"

static const char *const kinds[] = {"DATA", "SENT", "STALL", "CLEARED", "OVERFLOW", "TIMEOUT", "ERROR", "PARKED", "GONE"};
static const char *const ends[] = {"stopped", "left", "failed"};

struct tool {
	const char *device, *profile, *out;
	double watch;
	uint64_t bytes, got, parks;
	unsigned slow_ms, hold, changes;
	const char *memory, *waits;
	const char *second, *second_out; /* another device, captured at the same time */
	bool until_parked, list, again, wait, debug, drop, stopped, stop_sent;
	int out_fd, stop_fd;
	struct usb *usb;
	struct usb_counts counts;
	uint64_t with_error, after_gap, bad_order;
	int64_t last_ns;
};

static int fail(const struct err *err)
{
	char text[1600];

	fprintf(stderr, "usb-capture: %s\n", err_format(err, text, sizeof(text)));
	return err_exit_status(err->code);
}

static bool arguments(struct tool *t, int argc, char **argv)
{
	for (int i = 1; i < argc; i++) {
		const char *a = argv[i], *next = i + 1 < argc ? argv[i + 1] : "";

		if (!strcmp(a, "--list"))
			t->list = true;
		else if (!strcmp(a, "--again"))
			t->again = true;
		else if (!strcmp(a, "--wait"))
			t->wait = true;
		else if (!strcmp(a, "--drop"))
			t->drop = true;
		else if (!strcmp(a, "--debug"))
			t->debug = true;
		else if (!strcmp(a, "--device") && ++i)
			t->device = next;
		else if (!strcmp(a, "--profile") && ++i)
			t->profile = next;
		else if (!strcmp(a, "--memory") && ++i)
			t->memory = next;
		else if (!strcmp(a, "--out") && ++i)
			t->out = next;
		else if (!strcmp(a, "--second") && ++i)
			t->second = next;
		else if (!strcmp(a, "--second-out") && ++i)
			t->second_out = next;
		else if (!strcmp(a, "--until-parked"))
			t->until_parked = true;
		else if (!strcmp(a, "--waits") && ++i)
			t->waits = next;
		else if (!strcmp(a, "--changes") && ++i)
			t->changes = (unsigned)atoi(next);
		else if (!strcmp(a, "--watch") && ++i)
			t->watch = atof(next);
		else if (!strcmp(a, "--bytes") && ++i)
			t->bytes = strtoull(next, NULL, 10);
		else if (!strcmp(a, "--slow") && ++i)
			t->slow_ms = (unsigned)atoi(next);
		else if (!strcmp(a, "--hold") && ++i)
			t->hold = (unsigned)atoi(next);
		else
			return false;
	}
	return true;
}

static void print_device(const struct usb_device *d)
{
	printf("%s %04x:%04x serial=%s model=%s speed=%s class=%u/%u open=%d refused=%d storage=%d profile=%d\n", d->port,
	       d->vendor, d->product, d->serial, d->model, d->speed, d->device_class, d->interfaces ? d->interface_classes[0] : 0,
	       d->openable, d->refused, d->mass_storage, d->profile);
}

static void note_waits(const struct tool *t)
{
	int fd = t->waits ? open(t->waits, O_WRONLY | O_CREAT | O_CLOEXEC, 0600) : -1;

	if (fd >= 0)
		close(fd);
}

static unsigned print_changes(struct tool *t)
{
	struct usb_device device;
	enum usb_change change;
	unsigned n = 0;

	for (; usb_change(t->usb, &change, &device); n++) {
		printf("%s ", change == USB_CAME ? "CAME" : "LEFT");
		print_device(&device);
	}
	return n;
}

/* --wait: once a device has come; the events from then on. */
static int list(struct tool *t)
{
	struct pollfd p = {usb_watch_fd(t->usb), POLLIN, 0};
	struct err err = ERR_INIT;
	struct usb_device *devices;
	size_t n;

	note_waits(t);
	if (t->wait)
		poll(&p, 1, -1);
	if ((t->wait ? usb_list_begin : usb_list)(t->usb, true, &devices, &n, &err))
		return fail(&err);
	for (size_t i = 0; i < n; i++)
		print_device(&devices[i]);
	free(devices);
	print_changes(t);
	return 0;
}

static uint64_t parks(struct usb_capture *c)
{
	struct usb_counts counts;

	usb_capture_counts(c, &counts);
	return counts.parked;
}

/* Slower than any device: all other transfers are full before this buffer is given back. */
static void dawdle(struct tool *t, struct usb_capture *c)
{
	struct pollfd p = {t->stop_fd, POLLIN, 0};

	while (!t->stopped && parks(c) == t->parks && !poll(&p, 1, 1))
		;
	t->parks = parks(c);
	usleep(t->slow_ms * 1000);
}

static void keep(struct tool *t, struct usb_capture *c, struct usb_buffer *b)
{
	t->got += b->size;
	t->with_error += b->with_error;
	t->after_gap += b->after_gap;
	t->bad_order += b->time_ns < t->last_ns;
	t->last_ns = b->time_ns;
	if (t->out_fd >= 0 && write(t->out_fd, b->at, b->size) != (ssize_t)b->size)
		perror("write");
	if (t->slow_ms)
		dawdle(t, c);
}

/* Takes all events; true once the device has gone. */
static bool take_all(struct tool *t, struct usb_capture *c, enum usb_end *ret)
{
	struct usb_buffer b;

	while (usb_capture_take(c, &b)) {
		if (b.kind == USB_DATA)
			keep(t, c, &b);
		else
			printf("%s %s%s%.*s\n", kinds[b.kind], b.kind == USB_GONE ? ends[b.end] : "", b.text,
			       b.kind == USB_SENT ? (int)b.size : 0, b.kind == USB_SENT ? (const char *)b.at : "");
		if (b.kind == USB_DATA && t->hold) {
			t->hold--;
			continue;
		}
		usb_capture_give(c, &b);
		if (b.kind == USB_GONE) {
			*ret = b.end;
			return true;
		}
	}
	return false;
}

static void end_capture(const struct tool *t, struct usb_capture *c)
{
	struct usb_counts counts;

	usb_capture_counts(c, &counts);
	printf("counts transfers=%llu bytes=%llu shorts=%llu stalls=%llu overflows=%llu timeouts=%llu errors=%llu parked=%llu "
	       "parked_ns=%llu in_flight=%u with_error=%llu after_gap=%llu bad_order=%llu\n",
	       (unsigned long long)counts.transfers, (unsigned long long)counts.bytes, (unsigned long long)counts.shorts,
	       (unsigned long long)counts.stalls, (unsigned long long)counts.overflows, (unsigned long long)counts.timeouts,
	       (unsigned long long)counts.errors, (unsigned long long)counts.parked, (unsigned long long)counts.parked_ns,
	       counts.in_flight, (unsigned long long)t->with_error, (unsigned long long)t->after_gap,
	       (unsigned long long)t->bad_order);
	usb_capture_free(c);
}

static enum usb_end capture(struct tool *t, struct usb_capture *c)
{
	enum usb_end end = USB_END_STOPPED;

	for (;;) {
		struct pollfd p[2] = {{usb_capture_fd(c), POLLIN, 0}, {t->stop_fd, POLLIN, 0}};

		if (t->stopped)
			p[1].fd = -1;
		poll(p, 2, t->until_parked && !t->stopped ? 10 : -1);
		t->stopped = t->stopped || p[1].revents || (t->until_parked && parks(c)) || (t->bytes && t->got >= t->bytes);
		if (t->stopped && t->drop)
			break;
		if (t->stopped && !t->stop_sent) {
			t->stop_sent = true;
			usb_capture_stop(c);
		}
		if (p[0].revents && take_all(t, c, &end))
			break;
	}
	end_capture(t, c);
	return end;
}

/* Waits for an event or a stop. */
static bool wait_for_one(struct tool *t)
{
	struct pollfd p[2] = {{usb_watch_fd(t->usb), POLLIN, 0}, {t->stop_fd, POLLIN, 0}};
	struct usb_device device;
	enum usb_change change;
	bool came = false;

	note_waits(t);
	while (!came) {
		poll(p, 2, -1);
		if (p[1].revents)
			return false;
		while (usb_change(t->usb, &change, &device)) {
			printf("%s ", change == USB_CAME ? "CAME" : "LEFT");
			print_device(&device);
			came = came || change == USB_CAME;
		}
	}
	return true;
}

static int watch(struct tool *t)
{
	struct pollfd p = {usb_watch_fd(t->usb), POLLIN, 0};
	uint64_t began = clock_mono_ns();
	unsigned told = 0;

	note_waits(t);
	while (clock_since(began) < t->watch && (!t->changes || told < t->changes)) {
		poll(&p, 1, 10);
		told += print_changes(t);
	}
	return 0;
}

static int open_out(const char *path)
{
	return path ? open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600) : -1;
}

static int run(struct tool *t, const struct profile *profile)
{
	struct usb_capture *c;
	struct usb_device device;
	int r;

	for (;;) {
		struct err err = ERR_INIT;

		r = usb_find(t->usb, t->device, &device, &err);
		if (r == 0)
			r = usb_capture_start(t->usb, &device, profile, &c, &err);
		if (r && !(t->again && r == -ERR_NOTFOUND) && !t->wait)
			return fail(&err);
		if (r == 0) {
			printf("started %s\n", device.port);
			fflush(stdout);
			if (capture(t, c) == USB_END_STOPPED || !t->again)
				return 0;
		}
		t->wait = false;
		fflush(stdout);
		if (!wait_for_one(t))
			return 0;
	}
}

/* Two captures of one process, side by side, until both have given what was wanted. */
static int run_two(struct tool *first, const struct profile *profile)
{
	struct tool other = *first, *t[2] = {first, &other};
	struct usb_capture *c[2] = {NULL, NULL};
	struct usb_device device;
	struct err err = ERR_INIT;
	unsigned open = 0;

	other.device = first->second;
	other.out_fd = open_out(first->second_out);
	for (; open < 2; open++)
		if (usb_find(first->usb, t[open]->device, &device, &err) ||
		    usb_capture_start(first->usb, &device, profile, &c[open], &err))
			return fail(&err);
	while (open) {
		struct pollfd p[2] = {{c[0] ? usb_capture_fd(c[0]) : -1, POLLIN, 0},
				      {c[1] ? usb_capture_fd(c[1]) : -1, POLLIN, 0}};

		poll(p, 2, -1);
		for (int i = 0; i < 2; i++) {
			enum usb_end end;

			if (!c[i] || !p[i].revents)
				continue;
			if (take_all(t[i], c[i], &end)) {
				end_capture(t[i], c[i]);
				c[i] = NULL;
				open--;
			} else if (t[i]->got >= t[i]->bytes && !t[i]->stop_sent) {
				t[i]->stop_sent = true;
				usb_capture_stop(c[i]);
			}
		}
	}
	return 0;
}

/* The file of the kernel's parameter, in umockdev's folder for /sys. */
static void set_memory(const char *mb)
{
	static const char *const folders[] = {"sys/module", "sys/module/usbcore", "sys/module/usbcore/parameters"};
	const char *root = getenv("UMOCKDEV_DIR");
	char path[512];
	FILE *file;

	for (size_t i = 0; i < 3; i++) {
		snprintf(path, sizeof(path), "%s/%s", root, folders[i]);
		mkdir(path, 0755);
	}
	snprintf(path, sizeof(path), "%s/sys/module/usbcore/parameters/usbfs_memory_mb", root);
	file = fopen(path, "we");
	if (!root || !file || fprintf(file, "%s\n", mb) < 0 || fclose(file))
		perror(path);
}

int main(int argc, char **argv)
{
	struct tool t = {.device = "", .out_fd = -1};
	struct profile_entry *profile = NULL;
	struct profile_set *set = NULL;
	struct err err = ERR_INIT;
	const char *folders[2] = {getenv("ACUT_PROFILES"), NULL};
	sigset_t stop;
	int r;

	if (!arguments(&t, argc, argv))
		return 2;
	log_init("usb-capture", t.debug ? LOG_LEVEL_DEBUG : LOG_LEVEL_INFO);
	sigemptyset(&stop);
	sigaddset(&stop, SIGINT);
	sigaddset(&stop, SIGTERM);
	sigprocmask(SIG_BLOCK, &stop, NULL);
	t.stop_fd = signalfd(-1, &stop, SFD_CLOEXEC);
	if (profile_set_read(folders, &set, &err) || (t.profile && profile_entry_read(t.profile, &profile, &err)))
		return fail(&err);
	t.out_fd = open_out(t.out);
	if (usb_new(set, &t.usb, &err))
		return fail(&err);
	usb_set_stop_fd(t.usb, t.stop_fd);
	if (t.memory)
		set_memory(t.memory);
	printf("polls %s\n", usb_polls(t.usb) ? usb_polls(t.usb) : "no");
	if (t.list)
		r = list(&t);
	else if (t.watch)
		r = watch(&t);
	else if (t.second)
		r = run_two(&t, &profile->profile);
	else
		r = run(&t, &profile->profile);
	usb_free(t.usb);
	profile_entry_free(profile);
	profile_set_free(set);
	return r;
}
