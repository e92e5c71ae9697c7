/*
 * The part of the kernel's usbfs that libusb uses. Transfers (URBs) wait in order of submission. The model puts bytes into the
 * first one of its IN endpoint. Complete transfers are reaped in order of completion.
 *
 * The node is a FIFO that is full while there is nothing to reap, so it is writable exactly when a descriptor of usbfs would be.
 * POLLERR for an unplugged device cannot be imitated so: libusb learns of the unplug from the transfers that it reaps.
 */
#include "fake_usbfs.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/usbdevice_fs.h>
#include <stddef.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

/* A halted endpoint answers one frame after the submission: an earlier answer would be missed by libusb while it still submits
 * the rest of a transfer that it cut into several. */
enum { DYING_NS = 20000000, FRAME_NS = 1000000 };

struct urb {
	struct urb *next;
	UMockdevIoctlData *data, *buffer;
	UMockdevIoctlClient *client;
	gulong address;
	size_t length, filled;
	unsigned type, endpoint, flags;
	int status;
	int64_t since_ns;
};
struct list {
	struct urb *first, **end;
};
struct fake_node {
	struct fake_device *device;
	UMockdevIoctlBase *handler;
	GMutex *lock;
	struct list waiting, complete;
	struct fake_node_counts counts;
	GSList *clients; /* programs that have it open */
	bool disconnected, disabled_in;
	int64_t dying_ns; /* a real kernel answers NO_DEVICE only after a while */
	int fifo;
	bool fifo_full;
	void (*notify)(void *);
	void *notify_ctx;
	char path[64];
};

int64_t fake_now(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return t.tv_sec * 1000000000ll + t.tv_nsec;
}

static void list_add(struct list *l, struct urb *u)
{
	if (!l->first)
		l->end = &l->first;
	u->next = NULL;
	*l->end = u;
	l->end = &u->next;
}

static void list_take(struct list *l, struct urb *u)
{
	struct urb **p = &l->first;

	while (*p != u)
		p = &(*p)->next;
	*p = u->next;
	for (l->end = &l->first; *l->end;)
		l->end = &(*l->end)->next;
}

static void urb_free(struct urb *u)
{
	g_clear_object(&u->buffer);
	g_clear_object(&u->data);
	g_free(u);
}

/* ---- the answer of poll ---- */

static void fifo_writable(struct fake_node *n, bool writable)
{
	char bytes[4096] = "";

	if (n->fifo < 0 || writable != n->fifo_full)
		return;
	if (writable) {
		if (read(n->fifo, bytes, sizeof bytes) < 0)
			g_error("%s: %s", n->path, strerror(errno));
	} else {
		while (write(n->fifo, bytes, sizeof bytes) > 0)
			;
	}
	n->fifo_full = !writable;
}

bool fake_node_fifo(struct fake_node *n, const char *where)
{
	unlink(where);
	if (mkfifo(where, n->device->locked ? 0 : 0600) != 0)
		return false;
	if (n->device->locked)
		return true;
	n->fifo = open(where, O_RDWR | O_NONBLOCK | O_CLOEXEC);
	fifo_writable(n, false);
	return n->fifo >= 0;
}

/* ---- transfers ---- */

static void urb_complete(struct fake_node *n, struct urb *u, int status)
{
	struct usbdevfs_urb *raw = (struct usbdevfs_urb *)u->data->data;

	list_take(&n->waiting, u);
	if (u->flags & USBDEVFS_URB_SHORT_NOT_OK && status == 0 && u->filled < u->length)
		status = -EREMOTEIO;
	u->status = raw->status = status;
	raw->actual_length = (int)u->filled;
	list_add(&n->complete, u);
	n->counts.in_flight--;
	fifo_writable(n, true);
	if (status < 0 && status != -ENOENT && status != -ECONNRESET && u->endpoint == n->device->endpoint_in &&
	    u->type == USBDEVFS_URB_TYPE_BULK) {
		/* the rest of a transfer that was cut into several is cancelled, as the kernel does */
		n->disabled_in = true;
		for (struct urb *v = n->waiting.first, *next; v; v = next) {
			next = v->next;
			if (v->endpoint != u->endpoint)
				continue;
			if (!(v->flags & USBDEVFS_URB_BULK_CONTINUATION)) {
				n->disabled_in = false;
				break;
			}
			urb_complete(n, v, -ECONNRESET);
		}
	}
}

static struct urb *waiting_on(struct fake_node *n, unsigned endpoint)
{
	for (struct urb *u = n->waiting.first; u; u = u->next)
		if (u->endpoint == endpoint && u->type == USBDEVFS_URB_TYPE_BULK)
			return u;
	return NULL;
}

static void pump_gone(struct fake_node *n)
{
	while (n->waiting.first)
		urb_complete(n, n->waiting.first, n->device->mock || n->disconnected ? -ENODEV : -EPROTO);
}

static void pump_out(struct fake_node *n, int64_t now_ns)
{
	for (struct urb *u; (u = waiting_on(n, n->device->endpoint_out));) {
		enum fake_out out;

		fake_device_step(n->device, FAKE_AT_START, now_ns);
		if (n->device->gone)
			return;
		out = fake_device_out(n->device, now_ns, u->buffer ? u->buffer->data : NULL, u->length);
		if (out == FAKE_OUT_WAIT)
			return;
		if (out == FAKE_TAKEN)
			u->filled = u->length;
		urb_complete(n, u, out == FAKE_OUT_HALT ? -EPIPE : 0);
	}
}

int64_t fake_node_pump(struct fake_node *n, int64_t now_ns)
{
	struct fake_device *d = n->device;
	struct fake_in in = {.when_ns = FAKE_NEVER};

	if (!d->gone)
		pump_out(n, now_ns);
	for (struct urb *u; !d->gone && (u = waiting_on(n, d->endpoint_in));) {
		fake_device_in(d, now_ns, u->buffer->data + u->filled, u->length - u->filled, &in);
		u->filled += in.size;
		if (in.kind == FAKE_HALT && now_ns - u->since_ns < FRAME_NS)
			in = (struct fake_in){.kind = FAKE_WAIT, .when_ns = u->since_ns + FRAME_NS};
		if (in.kind == FAKE_WAIT || in.kind == FAKE_GONE)
			break;
		if (in.kind == FAKE_HALT)
			urb_complete(n, u, -EPIPE);
		else if (in.kind == FAKE_OVERFLOW)
			urb_complete(n, u, -EOVERFLOW);
		else if (in.kind == FAKE_BROKEN)
			urb_complete(n, u, -EPROTO);
		else if (in.ends || u->filled == u->length)
			urb_complete(n, u, 0);
	}
	if (d->gone) {
		if (!n->dying_ns)
			n->dying_ns = now_ns;
		pump_gone(n);
	}
	if (n->notify)
		n->notify(n->notify_ctx);
	return in.kind == FAKE_WAIT && waiting_on(n, d->endpoint_in) ? in.when_ns : FAKE_NEVER;
}

static int submit_control(struct fake_node *n, struct urb *u)
{
	uint8_t *at = u->buffer ? u->buffer->data : NULL;
	int got;

	n->counts.controls++;
	if (u->length < 8)
		return EINVAL;
	fake_device_step(n->device, FAKE_AT_STRING, fake_now());
	if (n->device->gone)
		return 0;
	got = fake_control(n->device, at, at + 8, u->length - 8);
	u->filled = got > 0 ? (size_t)got : 0;
	urb_complete(n, u, got < 0 ? got : 0);
	return 0;
}

/* For a while after an unplug, real kernels accept transfers and fail them. */
static bool is_gone(struct fake_node *n)
{
	if (n->device->gone && !n->dying_ns)
		n->dying_ns = fake_now();
	return n->disconnected || (n->device->gone && (n->device->mock || fake_now() - n->dying_ns > DYING_NS));
}

static int submit(struct fake_node *n, UMockdevIoctlClient *client, UMockdevIoctlData *data)
{
	struct usbdevfs_urb *raw = (struct usbdevfs_urb *)data->data;
	struct urb *u;

	n->counts.submits++;
	if (raw->endpoint == n->device->endpoint_in)
		fake_device_step(n->device, FAKE_AT_SUBMIT, fake_now());
	if (is_gone(n))
		return ENODEV;
	if (n->device->denies && raw->endpoint == n->device->endpoint_in) {
		n->device->denies = false;
		return EINVAL;
	}
	if (raw->type == USBDEVFS_URB_TYPE_BULK && raw->endpoint == n->device->endpoint_in) {
		if (!(raw->flags & USBDEVFS_URB_BULK_CONTINUATION))
			n->disabled_in = false;
		else if (n->disabled_in)
			return EREMOTEIO;
	} else if (raw->type != USBDEVFS_URB_TYPE_CONTROL && raw->endpoint != n->device->endpoint_out) {
		return ENOENT;
	}
	u = g_new0(struct urb, 1);
	u->client = client;
	u->type = raw->type;
	u->endpoint = raw->type == USBDEVFS_URB_TYPE_CONTROL ? 0 : raw->endpoint;
	u->flags = raw->flags;
	u->length = (size_t)raw->buffer_length;
	u->address = data->client_addr;
	u->since_ns = fake_now();
	u->buffer = umockdev_ioctl_data_resolve(data, offsetof(struct usbdevfs_urb, buffer), u->length, NULL);
	if (u->length && !u->buffer) { /* the program is dying */
		g_free(u);
		return EFAULT;
	}
	u->data = g_object_ref(data);
	list_add(&n->waiting, u);
	if (++n->counts.in_flight > n->counts.in_flight_max)
		n->counts.in_flight_max = n->counts.in_flight;
	if (u->type == USBDEVFS_URB_TYPE_CONTROL)
		return submit_control(n, u);
	return 0;
}

static int discard(struct fake_node *n, gulong address)
{
	n->counts.discards++;
	fake_device_step(n->device, FAKE_AT_DISCARD, fake_now());
	for (struct urb *u = n->waiting.first; u; u = u->next) {
		if (u->address != address)
			continue;
		urb_complete(n, u, -ENOENT);
		return 0;
	}
	return is_gone(n) ? ENODEV : EINVAL;
}

static int reap(struct fake_node *n, UMockdevIoctlClient *client, UMockdevIoctlData *data)
{
	struct urb *u = n->complete.first;

	if (!u) {
		fifo_writable(n, is_gone(n));
		return is_gone(n) ? ENODEV : EAGAIN;
	}
	n->counts.reaps++;
	fake_device_step(n->device, FAKE_AT_REAP, fake_now());
	list_take(&n->complete, u);
	if (!umockdev_ioctl_data_set_ptr(data, 0, u->data))
		g_error("cannot hand back a transfer");
	urb_free(u);
	if (!n->complete.first)
		fifo_writable(n, false);
	return 0;
}

/* ---- requests to a node ---- */

static int claim(struct fake_node *n)
{
	n->counts.claims++;
	fake_device_step(n->device, FAKE_AT_CLAIM, fake_now());
	if (is_gone(n) || n->device->gone)
		return ENODEV;
	return n->device->interface_class == 8 || n->device->busy || (n->device->driver[0] && !n->device->detached) ? EBUSY : 0;
}

/* The driver of an interface is detached when libusb claims it, and attached again at its release. */
static int driver_move(struct fake_node *n, gulong request, UMockdevIoctlData *data)
{
	if (request == USBDEVFS_DISCONNECT_CLAIM) {
		n->counts.detaches++;
		n->device->detached = true;
		return claim(n);
	}
	if (((struct usbdevfs_ioctl *)data->data)->ioctl_code == (int)USBDEVFS_CONNECT) {
		n->counts.attaches++;
		n->device->detached = false;
	} else {
		n->counts.detaches++;
		n->device->detached = true;
	}
	return 0;
}

static int driver(struct fake_node *n, UMockdevIoctlData *data)
{
	struct usbdevfs_getdriver *get = (struct usbdevfs_getdriver *)data->data;

	if (n->device->interface_class != 8 && (!n->device->driver[0] || n->device->detached))
		return ENODATA;
	snprintf(get->driver, sizeof get->driver, "%s", n->device->driver[0] ? n->device->driver : "usb-storage");
	return 0;
}

static int answer(struct fake_node *n, UMockdevIoctlClient *client, gulong request, UMockdevIoctlData *arg,
		  UMockdevIoctlData *data)
{
	if (request == USBDEVFS_REAPURBNDELAY || request == USBDEVFS_REAPURB)
		return reap(n, client, data);
	if (request == USBDEVFS_DISCARDURB)
		return discard(n, *(gulong *)arg->data);
	if (request == USBDEVFS_RELEASEINTERFACE) {
		n->counts.releases++;
		fake_device_step(n->device, FAKE_AT_RELEASE, fake_now());
	}
	if (is_gone(n))
		return ENODEV;
	switch (request) {
	case USBDEVFS_GET_CAPABILITIES:
		*(uint32_t *)data->data =
			(USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_BULK_CONTINUATION | USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
			 USBDEVFS_CAP_BULK_SCATTER_GATHER | USBDEVFS_CAP_REAP_AFTER_DISCONNECT) &
			~n->device->caps_off;
		return 0;
	case USBDEVFS_SUBMITURB:
		return submit(n, client, data);
	case USBDEVFS_CLAIMINTERFACE:
		return claim(n);
	case USBDEVFS_CLEAR_HALT:
		n->counts.clears++;
		fake_device_step(n->device, FAKE_AT_CLEAR, fake_now());
		fake_device_clear_halt(n->device, (uint8_t) * (unsigned *)data->data);
		return n->device->gone ? ENODEV : 0;
	case USBDEVFS_RESET:
		n->counts.resets++;
		return 0;
	case USBDEVFS_CONNECTINFO:
		((struct usbdevfs_connectinfo *)data->data)->devnum = (unsigned)atoi(strrchr(n->path, '/') + 1);
		return 0;
	case USBDEVFS_GETDRIVER:
		return driver(n, data);
	case USBDEVFS_IOCTL:
	case USBDEVFS_DISCONNECT_CLAIM:
		return driver_move(n, request, data);
	case USBDEVFS_GET_SPEED:
	case USBDEVFS_RELEASEINTERFACE:
	case USBDEVFS_SETCONFIGURATION:
	case USBDEVFS_SETINTERFACE:
	case USBDEVFS_RESETEP:
		return 0;
	default:
		n->counts.refused++;
		return ENOTTY;
	}
}

static gboolean on_ioctl(UMockdevIoctlBase *handler, UMockdevIoctlClient *client, struct fake_node *n)
{
	gulong request = umockdev_ioctl_client_get_request(client), size = _IOC_SIZE(request);
	UMockdevIoctlData *arg = umockdev_ioctl_client_get_arg(client), *data = NULL;
	int error;

	if (size)
		data = umockdev_ioctl_data_resolve(arg, 0, size, NULL);
	g_mutex_lock(n->lock);
	error = size && !data ? EFAULT : answer(n, client, request, arg, data);
	if (error == 0 && request == USBDEVFS_GET_SPEED) {
		umockdev_ioctl_client_complete(client, 3, 0);
	} else {
		umockdev_ioctl_client_complete(client, error ? -1 : 0, error);
	}
	fake_node_pump(n, fake_now());
	g_mutex_unlock(n->lock);
	g_clear_object(&data);
	return TRUE;
}

/* Under the lock: cleans up after a program that has closed the node or ended. */
static void list_forget(struct fake_node *n, struct list *l, const UMockdevIoctlClient *client)
{
	for (struct urb *u = l->first, *next; u; u = next) {
		next = u->next;
		if (u->client != client)
			continue;
		if (u->type == USBDEVFS_URB_TYPE_BULK && u->endpoint == n->device->endpoint_in)
			n->counts.unreaped_bytes += u->filled;
		if (l == &n->waiting)
			n->counts.in_flight--;
		list_take(l, u);
		urb_free(u);
	}
}

static void on_connected(UMockdevIoctlBase *handler, UMockdevIoctlClient *client, struct fake_node *n)
{
	g_mutex_lock(n->lock);
	n->clients = g_slist_prepend(n->clients, g_object_ref(client));
	n->counts.opens++;
	fake_device_step(n->device, FAKE_AT_OPEN, fake_now());
	fake_node_pump(n, fake_now());
	g_mutex_unlock(n->lock);
}

struct fake_node *fake_node_new(struct fake_device *d, const char *path, GMutex *lock)
{
	struct fake_node *n = g_new0(struct fake_node, 1);

	n->device = d;
	n->lock = lock;
	n->fifo = -1;
	g_strlcpy(n->path, path, sizeof n->path);
	n->handler = umockdev_ioctl_base_new();
	g_signal_connect(n->handler, "handle-ioctl", G_CALLBACK(on_ioctl), n);
	g_signal_connect(n->handler, "client-connected", G_CALLBACK(on_connected), n);
	return n;
}

struct fake_node *fake_node_free(struct fake_node *n)
{
	if (!n)
		return NULL;
	if (n->fifo >= 0)
		close(n->fifo);
	g_slist_free_full(n->clients, g_object_unref);
	g_object_unref(n->handler);
	g_free(n);
	return NULL;
}

UMockdevIoctlBase *fake_node_handler(struct fake_node *n)
{
	return n->handler;
}

void fake_node_disconnect(struct fake_node *n)
{
	n->disconnected = true;
	pump_gone(n);
	fifo_writable(n, true);
}

/* umockdev does not report when a client has left. */
bool fake_node_open(struct fake_node *n)
{
	for (GSList *at = n->clients, *next; at; at = next) {
		UMockdevIoctlClient *client = at->data;

		next = at->next;
		if (umockdev_ioctl_client_get_connected(client))
			continue;
		list_forget(n, &n->complete, client);
		list_forget(n, &n->waiting, client);
		n->clients = g_slist_delete_link(n->clients, at); /* not freed: umockdev's worker may still be in it */
	}
	return n->clients != NULL;
}

void fake_node_counts(const struct fake_node *n, struct fake_node_counts *ret)
{
	*ret = n->counts;
}

void fake_node_notify(struct fake_node *n, void (*fn)(void *), void *ctx)
{
	n->notify = fn;
	n->notify_ctx = ctx;
}

struct fake_device *fake_node_device(const struct fake_node *n)
{
	return n->device;
}
