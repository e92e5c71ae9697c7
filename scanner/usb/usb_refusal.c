/*
 * Why a device cannot be used, with a hint: permissions and the udev rule that gives them, another program and which
 * one, mass storage, unplugged.
 */
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "usb_priv.h"

char *usb_device_words(const struct usb_device *device, char *buf, size_t size)
{
	snprintf(buf, size, "%.40s%s%04x:%04x%s%s%.40s at %s", device->model, device->model[0] ? " " : "", device->vendor,
		 device->product, device->model[0] ? "" : "", device->serial[0] ? " serial " : "", device->serial, device->port);
	return buf;
}

static bool is_plain(uint8_t byte)
{
	return byte >= 0x20 && byte < 0x7f && byte != '\\';
}

char *usb_bytes_words(const uint8_t *at, size_t n, char *buf, size_t size)
{
	size_t all = 0, used = 0, most;

	for (size_t i = 0; i < n; i++)
		all += is_plain(at[i]) ? 1 : 4;
	most = all < size ? all : size - 4;
	buf[0] = 0;
	for (size_t i = 0; i < n && used + (is_plain(at[i]) ? 1 : 4) <= most; i++)
		used += (size_t)snprintf(buf + used, size - used, is_plain(at[i]) ? "%c" : "\\x%02x", at[i]);
	if (all >= size)
		snprintf(buf + used, size - used, "...");
	return buf;
}

int usb_refusal_mode(const struct usb_device *device, int sys, struct err *err)
{
	char words[160];

	err_raise(err, ERR_PERM, sys, __FILE__, __LINE__, "%s: %s may not be opened for writing (%s)",
		  usb_device_words(device, words, sizeof(words)), device->node, strerror(sys));
	if (sys == EPERM)
		return err_add_hint(err, "the service's DeviceAllow= keeps it away: it takes \"char-usb_device rw\"");
	return err_add_hint(err,
			    "put SUBSYSTEM==\"usb\", ATTRS{idVendor}==\"%04x\", ATTRS{idProduct}==\"%04x\", "
			    "MODE=\"0660\", GROUP=\"" USB_RULE_GROUP "\" into " USB_RULE_FILE ", be in that group, "
			    "then udevadm control --reload, and plug it in again",
			    device->vendor, device->product);
}

/* Whether a process has the node open; only root can see into the processes of others. */
static bool process_holds(const char *pid, const char *node)
{
	char path[300], link[256];
	struct dirent **names = NULL;
	bool found = false;
	int n;

	snprintf(path, sizeof(path), "/proc/%.32s/fd", pid);
	n = usb_folder_names(path, &names);
	for (int i = 0; i < n; i++) {
		ssize_t length;

		snprintf(path, sizeof(path), "/proc/%.32s/fd/%.32s", pid, names[i]->d_name);
		length = found ? 0 : readlink(path, link, sizeof(link) - 1);
		link[length > 0 ? length : 0] = 0;
		found = found || !strcmp(link, node);
		free(names[i]);
	}
	free(names);
	return found;
}

static bool find_holder(const char *node, char *ret, size_t room)
{
	char path[64], name[64] = "", own[32];
	struct dirent **names = NULL;
	bool found = false;
	FILE *file;
	int n = usb_folder_names("/proc", &names);

	snprintf(own, sizeof(own), "%ld", (long)getpid());
	for (int i = 0; i < n; i++) {
		const char *pid = names[i]->d_name;

		if (!found && pid[0] >= '1' && pid[0] <= '9' && strcmp(pid, own) != 0 && process_holds(pid, node)) {
			found = true;
			snprintf(path, sizeof(path), "/proc/%.32s/comm", pid);
			file = fopen(path, "re");
			if (file && fgets(name, sizeof(name), file))
				name[strcspn(name, "\n")] = 0;
			if (file)
				fclose(file);
			snprintf(ret, room, "%s (process %.32s)", name[0] ? name : "a program", pid);
		}
		free(names[i]);
	}
	free(names);
	return found;
}

int usb_refusal_busy(const struct usb_device *device, unsigned configuration, unsigned interface, struct err *err)
{
	char words[160], driver[64], holder[128];

	usb_device_words(device, words, sizeof(words));
	usb_sysfs_driver(USB_SYSFS, device->port, configuration, interface, driver, sizeof(driver));
	if (find_holder(device->node, holder, sizeof(holder)))
		err_set(err, ERR_BUSY, "%s: interface %u is in use by %s", words, interface, holder);
	else if (driver[0] && strcmp(driver, "usbfs"))
		err_set(err, ERR_BUSY, "%s: interface %u is in use by the kernel's driver %s, which does not let go of it", words,
			interface, driver);
	else
		err_set(err, ERR_BUSY, "%s: interface %u is in use by another program", words, interface);
	return err_add_hint(err, "end that program; as root \"fuser -v %s\" names it", device->node);
}

int usb_refusal_storage(const struct usb_device *device, struct err *err)
{
	char words[160];

	err_set(err, ERR_UNSUPPORTED, "%s is mass storage, which is left alone", usb_device_words(device, words, sizeof(words)));
	return err_add_hint(err, "mount it and push its files with acutctl");
}

int usb_refusal_left(const struct usb_device *device, const char *when, struct err *err)
{
	char words[160];

	err_set(err, ERR_NOTFOUND, "%s was unplugged %s", usb_device_words(device, words, sizeof(words)), when);
	return err_add_hint(err, "plug it in again");
}
