/*
 * fake-usb: runs an unchanged program on a USB bus with pretended scanners.
 *
 *   umockdev-wrapper fake-usb [--timeout S] [--report FILE] [--udev] SCRIPT -- PROGRAM [ARGUMENT]...
 *   fake-usb --source SCRIPT FILE    writes the bytes of the first device's source, without faults
 *
 * The exit status is that of the program; 124 if it hung, 125 if the bus could not be made. The report is one JSON object: for
 * each device the delivered, lost and added bytes and the calls to the kernel, and the exit status and resources of the program.
 *
 * The bus is umockdev's: sysfs, nodes and udev events in a folder that only this process and its children see. A thread moves
 * bytes and time; the main thread plugs, unplugs and waits for the program. --udev: the program believes that udev runs, and
 * relies on its events (it gets a /run of its own, if that is permitted).
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/capability.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "fake_usbfs.h"

enum { LEAVING_NS = 30000000, NODES = 512 };

/* Resources of the program at the time when a device is about to be plugged in (again). */
struct sample {
	unsigned descriptors;
	long rss_kb;
};
struct plug {
	struct fake_device *device;
	struct fake_node *node; /* NULL: not plugged in */
	char syspath[96], node_path[64];
	int64_t came_back_ns;
	struct fake_node_counts past;
	unsigned plugs;
};
struct bus {
	UMockdevTestbed *testbed;
	char *root;
	struct fake_device *devices;
	struct plug plugs[FAKE_DEVICES];
	size_t n;
	unsigned address;
	struct fake_node *old[NODES]; /* unplugged; kept while the program may hold them */
	char *old_paths[NODES];
	size_t n_old;
	struct sample samples[NODES];
	size_t n_samples;
	GMutex lock;
	GCond wake;
	bool woken, ending, udev;
	pid_t child;
};
struct outcome {
	bool hung;
	int status;
	double seconds;
	struct rusage used;
};

/* ---- plugging ---- */

static void text_hex(GString *s, const uint8_t *at, size_t n)
{
	for (size_t i = 0; i < n; i++)
		g_string_append_printf(s, "%02X", at[i]);
}

static void bus_add(struct bus *b, const char *text)
{
	GError *error = NULL;

	if (!umockdev_testbed_add_from_string(b->testbed, text, &error))
		g_error("%s", error->message);
}

static void hub_add(struct bus *b)
{
	bus_add(b, "P: /devices/pci0000:00/0000:00:14.0/usb1\nN: bus/usb/001/001\nE: DEVNAME=/dev/bus/usb/001/001\n"
		   "E: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: MAJOR=189\nE: MINOR=0\nE: BUSNUM=001\nE: DEVNUM=001\n"
		   "A: busnum=1\nA: devnum=1\nA: idVendor=1d6b\nA: idProduct=0002\nA: bDeviceClass=09\nA: speed=480\n"
		   "A: bConfigurationValue=1\nA: bNumConfigurations=1\n"
		   "H: descriptors=12010002090000406B1D02000001000000010902190001010000E0000904000001090000000705810304000C\n");
}

static char *device_text(const struct plug *p, unsigned address)
{
	const struct fake_device *d = p->device;
	GString *s = g_string_new(NULL);
	uint8_t descriptors[FAKE_DESCRIPTORS];

	g_string_append_printf(
		s,
		"P: %s\nN: %s\nE: DEVNAME=%s\nE: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: MAJOR=189\n"
		"E: MINOR=%u\nE: BUSNUM=001\nE: DEVNUM=%03u\nE: PRODUCT=%x/%x/100\nE: ID_VENDOR_ID=%04x\nE: ID_MODEL_ID=%04x\n"
		"A: busnum=1\nA: devnum=%u\nA: idVendor=%04x\nA: idProduct=%04x\nA: bDeviceClass=%02x\nA: speed=480\n"
		"A: bConfigurationValue=1\nA: bNumConfigurations=1\nA: bNumInterfaces= 1\nA: version= 2.00\nA: devpath=%s\n",
		p->syspath + 4, p->node_path + 5, p->node_path, address - 1, address, d->vendor, d->product, d->vendor,
		d->product, address, d->vendor, d->product, d->device_class,
		strchr(d->port, '-') ? strchr(d->port, '-') + 1 : "1");
	if (d->serial[0])
		g_string_append_printf(s, "A: serial=%s\nE: ID_SERIAL_SHORT=%s\n", d->serial, d->serial);
	if (d->manufacturer[0])
		g_string_append_printf(s, "A: manufacturer=%s\n", d->manufacturer);
	if (d->model[0])
		g_string_append_printf(s, "A: product=%s\n", d->model);
	g_string_append(s, "H: descriptors=");
	text_hex(s, descriptors, fake_descriptors(d, descriptors));
	g_string_append(s, "\n");
	return g_string_free(s, FALSE);
}

static void signals_send(struct bus *b, struct fake_device *d);

/* Sends a signal before any more bytes are moved, so that it arrives exactly at its byte. */
static void wake(void *ctx)
{
	struct bus *b = ctx;

	for (size_t i = 0; i < b->n; i++)
		signals_send(b, b->plugs[i].device);
	b->woken = true;
	g_cond_signal(&b->wake);
}

static void node_write(const char *where, const struct fake_device *d)
{
	uint8_t descriptors[FAKE_DESCRIPTORS];
	size_t n = fake_descriptors(d, descriptors);
	FILE *f = fopen(where, "wbe");

	if (!f || fwrite(descriptors, 1, n, f) != n || fclose(f) != 0)
		g_error("%s: %s", where, strerror(errno));
}

static void sample_take(struct bus *b)
{
	struct sample *s = &b->samples[b->n_samples];
	char path[64];
	long pages = 0;
	GDir *dir;
	FILE *f;

	if (b->child <= 0 || b->n_samples == NODES)
		return;
	snprintf(path, sizeof path, "/proc/%d/fd", (int)b->child);
	dir = g_dir_open(path, 0, NULL);
	while (dir && g_dir_read_name(dir))
		s->descriptors++;
	if (dir)
		g_dir_close(dir);
	snprintf(path, sizeof path, "/proc/%d/statm", (int)b->child);
	f = fopen(path, "re");
	if (f && fscanf(f, "%*d %ld", &pages) == 1)
		s->rss_kb = pages * 4;
	if (f)
		fclose(f);
	b->n_samples++;
}

static void plug_in(struct bus *b, struct plug *p)
{
	char *text, *where;
	unsigned address = ++b->address;
	GError *error = NULL;
	struct fake_node *node;

	snprintf(p->syspath, sizeof p->syspath, "/sys/devices/pci0000:00/0000:00:14.0/usb1/%.32s", p->device->port);
	snprintf(p->node_path, sizeof p->node_path, "/dev/bus/usb/001/%03u", address);
	node = fake_node_new(p->device, p->node_path, &b->lock);
	fake_node_notify(node, wake, b);
	if (!umockdev_testbed_attach_ioctl(b->testbed, p->node_path, fake_node_handler(node), &error))
		g_error("%s", error->message);
	text = device_text(p, address);
	bus_add(b, text);
	g_free(text);
	where = g_strconcat(b->root, p->node_path, NULL);
	if (!p->device->no_fifo && !fake_node_fifo(node, where))
		g_error("%s: %s", where, strerror(errno));
	if (p->device->locked && chmod(where, 0) != 0)
		g_error("%s: %s", where, strerror(errno));
	if (p->device->unheard) /* without an event the program must find the node itself */
		node_write(where, p->device);
	g_free(where);
	g_mutex_lock(&b->lock);
	p->node = node;
	p->plugs++;
	p->device->away = false;
	g_mutex_unlock(&b->lock);
	if (!p->device->unheard)
		umockdev_testbed_uevent(b->testbed, p->syspath, "add");
}

static void counts_add(struct fake_node_counts *to, const struct fake_node_counts *c)
{
	to->opens += c->opens;
	to->claims += c->claims;
	to->releases += c->releases;
	to->clears += c->clears;
	to->resets += c->resets;
	to->detaches += c->detaches;
	to->attaches += c->attaches;
	to->submits += c->submits;
	to->reaps += c->reaps;
	to->discards += c->discards;
	to->controls += c->controls;
	to->refused += c->refused;
	to->unreaped_bytes += c->unreaped_bytes;
	if (c->in_flight_max > to->in_flight_max)
		to->in_flight_max = c->in_flight_max;
}

static void plug_out(struct bus *b, struct plug *p, int64_t now_ns)
{
	struct fake_node *node = p->node;
	char *where = g_strconcat(b->root, p->node_path, NULL);

	g_mutex_lock(&b->lock);
	fake_node_disconnect(node);
	p->node = NULL;
	p->came_back_ns = p->device->gone_for_ns ? now_ns + p->device->gone_for_ns : FAKE_NEVER;
	g_mutex_unlock(&b->lock);
	umockdev_testbed_uevent(b->testbed, p->syspath, "remove");
	umockdev_testbed_remove_device(b->testbed, p->syspath);
	unlink(where);
	g_free(where);
	if (b->n_old == NODES)
		g_error("too many plugs");
	b->old_paths[b->n_old] = g_strdup(p->node_path);
	b->old[b->n_old++] = node;
}

/* Removes nodes of unplugged devices once the program has closed them, as the kernel does. */
static void old_sweep(struct bus *b, bool all)
{
	for (size_t i = 0; i < b->n_old;) {
		struct fake_node_counts counts;
		bool open;

		g_mutex_lock(&b->lock);
		open = fake_node_open(b->old[i]);
		fake_node_counts(b->old[i], &counts);
		g_mutex_unlock(&b->lock);
		if (open && !all) {
			i++;
			continue;
		}
		for (size_t k = 0; k < b->n; k++)
			if (fake_node_device(b->old[i]) == b->plugs[k].device)
				counts_add(&b->plugs[k].past, &counts);
		umockdev_testbed_detach_ioctl(b->testbed, b->old_paths[i], NULL);
		g_free(b->old_paths[i]);
		b->n_old--; /* the handler itself stays: umockdev's worker may still be in it */
		b->old[i] = b->old[b->n_old];
		b->old_paths[i] = b->old_paths[b->n_old];
	}
}

/* Under the lock. True: the program still has an unplugged node of the device open. */
static bool held(const struct bus *b, const struct fake_device *d)
{
	for (size_t i = 0; i < b->n_old; i++)
		if (fake_node_device(b->old[i]) == d && fake_node_open(b->old[i]))
			return true;
	return false;
}

static void bus_tick(struct bus *b, int64_t began_ns)
{
	int64_t now = fake_now();

	for (size_t i = 0; i < b->n; i++) {
		struct plug *p = &b->plugs[i];
		struct fake_device *d = p->device;
		bool leave, come = false;

		g_mutex_lock(&b->lock);
		leave = p->node && d->gone && now - d->gone_ns >= LEAVING_NS;
		if (!p->node && d->away)
			come = d->appear_path[0] ? access(d->appear_path, F_OK) == 0 : now - began_ns >= d->appear_ns;
		else if (!p->node && d->gone && now >= p->came_back_ns)
			come = !d->after_close || !held(b, d);
		if (come && d->gone)
			fake_device_plug(d);
		g_mutex_unlock(&b->lock);
		if (leave)
			plug_out(b, p, now);
		if (come) {
			sample_take(b);
			plug_in(b, p);
		}
	}
	old_sweep(b, false);
}

/* ---- the thread that moves bytes and sends signals ---- */

struct pause {
	pid_t child;
	int64_t span_ns;
};

/* A separate thread, without the lock: a call with the lock may wait for memory of the program, which is stopped. */
static gpointer pause_program(gpointer ctx)
{
	struct pause *p = ctx;

	kill(p->child, SIGSTOP);
	g_usleep((gulong)(p->span_ns / 1000));
	kill(p->child, SIGCONT);
	g_free(p);
	return NULL;
}

static void signals_send(struct bus *b, struct fake_device *d)
{
	if (b->child <= 0)
		return;
	if (d->wants_pause_ns) {
		struct pause *p = g_new(struct pause, 1);

		*p = (struct pause){b->child, d->wants_pause_ns};
		g_thread_unref(g_thread_new("pause", pause_program, p));
		d->wants_pause_ns = 0;
	}
	if (d->wants_stop)
		kill(b->child, SIGINT);
	if (d->wants_kill)
		kill(b->child, SIGKILL);
	d->wants_stop = d->wants_kill = false;
}

static gpointer mover(gpointer ctx)
{
	struct bus *b = ctx;

	g_mutex_lock(&b->lock);
	while (!b->ending) {
		int64_t now = fake_now(), next = now + 1000000000;

		b->woken = false;
		for (size_t i = 0; i < b->n; i++) {
			struct plug *p = &b->plugs[i];

			if (p->node) {
				int64_t when = fake_node_pump(p->node, now);

				if (when < next)
					next = when;
			}
			signals_send(b, p->device);
		}
		b->woken = false; /* by the bytes that were moved here */
		if (next - now < 200000)
			next = now + 200000;
		while (!b->woken && !b->ending && fake_now() < next)
			if (!g_cond_wait_until(&b->wake, &b->lock, g_get_monotonic_time() + (next - fake_now()) / 1000 + 1))
				break;
	}
	g_mutex_unlock(&b->lock);
	return NULL;
}

/* ---- the program ---- */

static void pretend_udev(void)
{
	int fd;

	if (unshare(CLONE_NEWNS) != 0 || mount("none", "/", NULL, MS_REC | MS_PRIVATE, NULL) != 0 ||
	    mount("none", "/run", "tmpfs", 0, NULL) != 0 || mkdir("/run/udev", 0755) != 0)
		return;
	fd = open("/run/udev/control", O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
	if (fd >= 0)
		close(fd);
}

static pid_t program_start(struct bus *b, char **argv)
{
	bool locked = false;
	pid_t pid;

	for (size_t i = 0; i < b->n; i++)
		locked |= b->devices[i].locked;
	pid = fork();
	if (pid != 0)
		return pid;
	prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (b->udev)
		pretend_udev();
	if (locked) { /* without these capabilities root cannot read everything, either */
		prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE);
		prctl(PR_CAPBSET_DROP, CAP_DAC_READ_SEARCH);
	}
	signal(SIGPIPE, SIG_DFL);
	execvp(argv[0], argv);
	perror(argv[0]);
	_exit(125);
}

static void program_wait(struct bus *b, double timeout_s, int64_t began_ns, struct outcome *ret)
{
	memset(ret, 0, sizeof *ret);
	for (;;) {
		pid_t got = wait4(b->child, &ret->status, WNOHANG, &ret->used);

		if (got == b->child)
			break;
		if (!ret->hung && fake_now() - began_ns > (int64_t)(timeout_s * 1e9)) {
			ret->hung = true;
			kill(b->child, SIGABRT);
			kill(b->child, SIGCONT);
			g_usleep(300000);
			kill(b->child, SIGKILL);
		}
		bus_tick(b, began_ns);
		g_usleep(2000);
	}
	ret->seconds = (double)(fake_now() - began_ns) * 1e-9;
}

static double seconds_of(struct timeval t)
{
	return (double)t.tv_sec + (double)t.tv_usec * 1e-6;
}

static void report_write(struct bus *b, const char *path, const struct outcome *o)
{
	FILE *f = fopen(path, "we");

	if (!f)
		g_error("%s: %s", path, strerror(errno));
	fprintf(f,
		"{\"hung\": %s, \"status\": %d, \"signal\": %d, \"seconds\": %.3f, \"cpu_s\": %.3f, \"rss_kb\": %ld, "
		"\"switches\": %ld, \"devices\": [",
		o->hung ? "true" : "false", WIFEXITED(o->status) ? WEXITSTATUS(o->status) : -1,
		WIFSIGNALED(o->status) ? WTERMSIG(o->status) : 0, o->seconds,
		seconds_of(o->used.ru_utime) + seconds_of(o->used.ru_stime), o->used.ru_maxrss, o->used.ru_nvcsw);
	for (size_t i = 0; i < b->n; i++) {
		struct plug *p = &b->plugs[i];
		const struct fake_node_counts *c = &p->past;

		fprintf(f,
			"%s{\"plugs\": %u, \"opens\": %lu, \"claims\": %lu, \"releases\": %lu, \"clears\": %lu, \"resets\": %lu, "
			"\"detaches\": %lu, \"attaches\": %lu, \"submits\": %lu, \"reaps\": %lu, \"discards\": %lu, \"controls\": %lu, \"refused\": %lu, "
			"\"unreaped\": %lu, \"in_flight_max\": %u, \"model\": ",
			i ? ", " : "", p->plugs, c->opens, c->claims, c->releases, c->clears, c->resets, c->detaches, c->attaches,
			c->submits, c->reaps, c->discards, c->controls, c->refused, c->unreaped_bytes, c->in_flight_max);
		fake_report(f, p->device);
		fputs("}", f);
	}
	fputs("], \"samples\": [", f);
	for (size_t i = 0; i < b->n_samples; i++)
		fprintf(f, "%s[%u, %ld]", i ? ", " : "", b->samples[i].descriptors, b->samples[i].rss_kb);
	fputs("]}\n", f);
	fclose(f);
}

static int source_write(const char *script, const char *path)
{
	struct fake_device *devices;
	size_t n;
	static uint8_t bytes[65536];
	struct fake_in in;
	FILE *f = fopen(path, "wbe");

	if (!f || !fake_script_read(script, &devices, &n))
		return 125;
	devices->n_faults = 0;
	devices->rate = 0;
	devices->delivered_path[0] = '\0';
	if (!fake_device_open_source(devices))
		return 125;
	devices->running = true;
	for (;;) {
		fake_device_in(devices, 1, bytes, sizeof bytes, &in);
		if (in.kind != FAKE_BYTES)
			break;
		fwrite(bytes, 1, in.size, f);
	}
	fake_device_clear(devices);
	free(devices);
	return fclose(f) == 0 ? 0 : 125;
}

/* The program has ended: umockdev's worker is about to see its last descriptors close. */
static void await_closed(struct bus *b)
{
	for (int64_t by = fake_now() + 10000000000; fake_now() < by; g_usleep(1000)) {
		bool open = false;

		g_mutex_lock(&b->lock);
		for (size_t i = 0; i < b->n; i++)
			open = open || (b->plugs[i].node && fake_node_open(b->plugs[i].node)) || held(b, b->plugs[i].device);
		g_mutex_unlock(&b->lock);
		if (!open)
			return;
	}
}

static int bus_run(struct bus *b, char **argv, double timeout_s, const char *report)
{
	struct outcome o;
	GThread *thread;
	int64_t began;

	b->testbed = umockdev_testbed_new();
	b->root = umockdev_testbed_get_root_dir(b->testbed);
	b->address = 1;
	hub_add(b);
	for (size_t i = 0; i < b->n; i++) {
		b->plugs[i].device = &b->devices[i];
		if (!fake_device_open_source(&b->devices[i]))
			return 125;
		if (!b->devices[i].away)
			plug_in(b, &b->plugs[i]);
	}
	began = fake_now();
	thread = g_thread_new("mover", mover, b);
	g_mutex_lock(&b->lock);
	b->child = program_start(b, argv);
	g_mutex_unlock(&b->lock);
	program_wait(b, timeout_s, began, &o);
	await_closed(b);
	g_mutex_lock(&b->lock);
	b->ending = true;
	b->child = 0;
	g_cond_signal(&b->wake);
	g_mutex_unlock(&b->lock);
	g_thread_join(thread);
	for (size_t i = 0; i < b->n; i++)
		if (b->plugs[i].node) {
			b->old_paths[b->n_old] = g_strdup(b->plugs[i].node_path);
			b->old[b->n_old++] = b->plugs[i].node;
		}
	old_sweep(b, true);
	if (report)
		report_write(b, report, &o);
	for (size_t i = 0; i < b->n; i++)
		fake_device_clear(&b->devices[i]);
	g_object_unref(b->testbed);
	return o.hung ? 124 : WIFEXITED(o.status) ? WEXITSTATUS(o.status) : 128 + WTERMSIG(o.status);
}

int main(int argc, char **argv)
{
	static struct bus b;
	const char *report = NULL, *script = NULL;
	double timeout_s = 60;
	int i = 1;

	if (argc == 4 && strcmp(argv[1], "--source") == 0)
		return source_write(argv[2], argv[3]);
	for (; i < argc && strcmp(argv[i], "--") != 0; i++) {
		if (strcmp(argv[i], "--timeout") == 0 && i + 1 < argc)
			timeout_s = atof(argv[++i]);
		else if (strcmp(argv[i], "--report") == 0 && i + 1 < argc)
			report = argv[++i];
		else if (strcmp(argv[i], "--udev") == 0)
			b.udev = true;
		else
			script = argv[i];
	}
	if (!script || i + 1 >= argc) {
		fputs("usage: fake-usb [--timeout S] [--report FILE] [--udev] SCRIPT -- PROGRAM [ARGUMENT]...\n", stderr);
		return 125;
	}
	if (!umockdev_in_mock_environment() && !getenv("LD_PRELOAD")) {
		fputs("fake-usb: run me under umockdev-wrapper\n", stderr);
		return 125;
	}
	g_mutex_init(&b.lock);
	g_cond_init(&b.wake);
	if (!fake_script_read(script, &b.devices, &b.n))
		return 125;
	return bus_run(&b, argv + i + 1, timeout_s, report);
}
