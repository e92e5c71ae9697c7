/* The kernel's side of /dev/bus/usb/BBB/DDD for one device, answered by umockdev's worker. */
#ifndef FAKE_USBFS_H
#define FAKE_USBFS_H

#include <umockdev.h>

#include "fake_device.h"

struct fake_node;
struct fake_node_counts {
	uint64_t opens, claims, releases, clears, resets, detaches, attaches, submits, reaps, discards, controls, refused;
	uint64_t unreaped_bytes; /* bytes of transfers that were complete when the program closed the node */
	uint32_t in_flight, in_flight_max;
};

/* `pid` gets the signals of the script. `lock` protects the model and the node. */
struct fake_node *fake_node_new(struct fake_device *, const char *path, GMutex *lock);
struct fake_node *fake_node_free(struct fake_node *);
UMockdevIoctlBase *fake_node_handler(struct fake_node *);
/* Replaces the plain file at `where` by a FIFO, so that poll works. */
bool fake_node_fifo(struct fake_node *, const char *where);
/* Under the lock: moves bytes. Returns when to call it again. */
int64_t fake_node_pump(struct fake_node *, int64_t now_ns);
/* Under the lock: the device is unplugged. */
void fake_node_disconnect(struct fake_node *);
struct fake_device *fake_node_device(const struct fake_node *);
bool fake_node_open(struct fake_node *); /* a program has it open */
void fake_node_counts(const struct fake_node *, struct fake_node_counts *ret);
/* Called under the lock after a request that changed the state of the model. */
void fake_node_notify(struct fake_node *, void (*fn)(void *), void *ctx);
int64_t fake_now(void);

#endif
