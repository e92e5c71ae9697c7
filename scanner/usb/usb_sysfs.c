/*
 * Information of the kernel about the devices on its buses, read from /sys/bus/usb/devices without opening or waking
 * them: their descriptors and texts. An entry that disappears while it is read is skipped.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "parse.h"
#include "usb_priv.h"
#include "utf8.h"

static int read_file(const char *folder, const char *port, const char *name, void *ret, size_t room, size_t *ret_size)
{
	char path[512];
	size_t n = 0;
	ssize_t got = 0;
	int fd, sys;

	if (snprintf(path, sizeof(path), "%s/%s/%s", folder, port, name) >= (int)sizeof(path))
		return -ENAMETOOLONG;
	fd = open(path, O_RDONLY | O_CLOEXEC);
	if (fd < 0)
		return -errno;
	while (n < room && ((got = read(fd, (char *)ret + n, room - n)) > 0 || (got < 0 && errno == EINTR)))
		n += got > 0 ? (size_t)got : 0;
	sys = errno;
	close(fd);
	if (got < 0)
		return -sys;
	*ret_size = n;
	return 0;
}

/* A text of the device: truncated at whole characters, '?' for invalid bytes, without blanks at its ends. */
static void read_text(const char *folder, const char *port, const char *name, char *ret, size_t room)
{
	uint8_t raw[512];
	size_t n, at = 0, used = 0;

	ret[0] = 0;
	if (read_file(folder, port, name, raw, sizeof(raw), &n))
		return;
	while (n && (raw[n - 1] == '\n' || raw[n - 1] == ' ' || !raw[n - 1]))
		n--;
	while (at < n && raw[at] == ' ')
		at++;
	while (at < n) {
		size_t length = utf8_printable(raw + at, n - at);

		if (used + (length ? length : 1) >= room)
			break;
		if (length)
			memcpy(ret + used, raw + at, length);
		else
			ret[used] = '?';
		used += length ? length : 1;
		at += length ? length : 1;
	}
	ret[used] = 0;
}

static bool read_number(const char *folder, const char *port, const char *name, uint64_t most, uint64_t *ret)
{
	char text[32];

	read_text(folder, port, name, text, sizeof(text));
	return parse_u64(text, ret) && *ret <= most;
}

int usb_sysfs_descriptors(const char *folder, const char *port, uint8_t *ret, size_t room, size_t *ret_size)
{
	return read_file(folder, port, "descriptors", ret, room, ret_size);
}

unsigned usb_sysfs_configuration(const char *folder, const char *port)
{
	uint64_t value;

	return read_number(folder, port, "bConfigurationValue", UINT8_MAX, &value) ? (unsigned)value : 0;
}

void usb_sysfs_driver(const char *folder, const char *port, unsigned configuration, unsigned interface, char *ret, size_t room)
{
	char path[512], link[512];
	const char *name;
	ssize_t n;

	ret[0] = 0;
	snprintf(path, sizeof(path), "%s/%s:%u.%u/driver", folder, port, configuration ? configuration : 1, interface);
	n = readlink(path, link, sizeof(link) - 1);
	if (n <= 0)
		return;
	link[n] = 0;
	name = strrchr(link, '/');
	snprintf(ret, room, "%s", name ? name + 1 : link);
}

static const char *speed_words(const char *mbit)
{
	static const struct {
		const char *mbit, *words;
	} speeds[] = {
		{"1.5", "low"}, {"12", "full"}, {"480", "high"}, {"5000", "super"}, {"10000", "super+"}, {"20000", "super+ x2"},
	};

	for (size_t i = 0; i < sizeof(speeds) / sizeof(speeds[0]); i++) {
		if (!strcmp(mbit, speeds[i].mbit))
			return speeds[i].words;
	}
	return "unknown";
}

void usb_access(struct usb_device *device)
{
	device->refused = access(device->node, R_OK | W_OK) == 0 ? 0 : errno;
	device->openable = !device->refused;
}

/* "1-2", "3-1.4" are devices; "usb1" is the bus itself, "1-2:1.0" an interface. */
static bool is_port(const char *name)
{
	return name[0] >= '0' && name[0] <= '9' && strchr(name, '-') && !strchr(name, ':') &&
	       strlen(name) < sizeof(((struct usb_device *)0)->port);
}

static bool read_device(const char *folder, const char *port, struct usb_device *ret)
{
	uint8_t descriptors[USB_DESCRIPTORS_MAX];
	uint64_t bus, address;
	char speed[16];
	size_t size;

	*ret = (struct usb_device){.profile = -1};
	if (usb_sysfs_descriptors(folder, port, descriptors, sizeof(descriptors), &size) ||
	    !usb_descriptor_device(descriptors, size, usb_sysfs_configuration(folder, port), ret) ||
	    !read_number(folder, port, "busnum", UINT8_MAX, &bus) || !read_number(folder, port, "devnum", UINT8_MAX, &address) ||
	    ret->device_class == USB_CLASS_HUB)
		return false;
	ret->bus = (uint8_t)bus;
	ret->address = (uint8_t)address;
	snprintf(ret->port, sizeof(ret->port), "%.*s", (int)sizeof(ret->port) - 1, port);
	snprintf(ret->node, sizeof(ret->node), USB_NODES "/%03u/%03u", ret->bus, ret->address);
	read_text(folder, port, "manufacturer", ret->manufacturer, sizeof(ret->manufacturer));
	read_text(folder, port, "product", ret->model, sizeof(ret->model));
	read_text(folder, port, "serial", ret->serial, sizeof(ret->serial));
	read_text(folder, port, "speed", speed, sizeof(speed));
	ret->speed = speed_words(speed);
	usb_access(ret);
	return true;
}

/* Not opendir: closedir in one thread and close in another are no race, but checkers that see only one of them report it. */
int usb_folder_names(const char *folder, struct dirent ***ret)
{
	int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC), n, sys;

	if (fd < 0)
		return -errno;
	n = scandirat(fd, ".", ret, NULL, versionsort);
	sys = errno;
	close(fd);
	return n < 0 ? -sys : n;
}

int usb_sysfs_list(const char *folder, struct usb_device **ret, size_t *ret_n, struct err *err)
{
	struct usb_device *list;
	struct dirent **names = NULL;
	size_t n = 0;
	int found = usb_folder_names(folder, &names);

	if (found == -ENOENT || found == -ENOTDIR)
		found = 0; /* no USB */
	if (found < 0) {
		err_sys(err, -found, "the devices on the bus cannot be listed");
		return err_add_file(err, folder);
	}
	list = calloc(found ? (size_t)found : 1, sizeof(*list));
	for (int i = 0; i < found; i++) {
		if (list && is_port(names[i]->d_name))
			n += read_device(folder, names[i]->d_name, &list[n]);
		free(names[i]);
	}
	free(names);
	if (!list)
		return err_set(err, ERR_NOMEM, "no memory for a list of %d devices", found);
	*ret = list;
	*ret_n = n;
	return 0;
}
