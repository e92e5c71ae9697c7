/* scanner/usb without a bus: unknown descriptors, sysfs, the memory limit of transfers, messages of refusals. */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "repeat.h"
#include "usb_priv.h"

/* A device of two configurations: the first with a vendor interface of two settings and a mass storage one behind it,
 * the second with an interface of class 3. */
static const uint8_t whole[] = {
	18, 1,   0, 2, 0, 0,   0, 64,   0xa2, 0x19, 0x01, 0x50, 0, 1, 1, 2, 3,    2,  9,    2, 55, 0, 2, 1, 0, 0x80, 50,
	9,  4,   0, 0, 2, 255, 0, 0,    0,    7,    5,    0x81, 2, 0, 2, 0, 7,    5,  0x02, 2, 0,  2, 0, 9, 4, 0,    1,
	1,  255, 0, 0, 0, 7,   5, 0x83, 3,    64,   8,    1, /* packet 64 and a bit that says "one more each microframe" */
	9,  4,   1, 0, 0, 8,   6, 80,   0,    9,    2,    18,   0, 1, 2, 0, 0x80, 50, 9,    4, 0,  0, 0, 3, 0, 0,    0,
};

static void device_of_descriptors(void **state)
{
	struct usb_device d = {0};

	assert_true(usb_descriptor_device(whole, sizeof(whole), 0, &d));
	assert_int_equal(d.vendor, 0x19a2);
	assert_int_equal(d.product, 0x5001);
	assert_int_equal(d.interfaces, 2);
	assert_int_equal(d.interface_classes[0], 255);
	assert_int_equal(d.interface_classes[1], 8);
	assert_true(d.mass_storage);
	assert_true(usb_descriptor_device(whole, sizeof(whole), 2, &d));
	assert_int_equal(d.interfaces, 1);
	assert_int_equal(d.interface_classes[0], 3);
	assert_true(d.mass_storage); /* although in another configuration */
	assert_true(usb_descriptor_device(whole, 43 + 7, 1, &d));
	assert_false(d.mass_storage);
	assert_false(usb_descriptor_device(whole, 17, 0, &d));
}

static void settings_of_descriptors(void **state)
{
	struct usb_setting s;

	assert_true(usb_descriptor_setting(whole, sizeof(whole), 0, 0, 0, &s));
	assert_int_equal(s.configuration, 1);
	assert_int_equal(s.n, 2);
	assert_int_equal(usb_setting_endpoint(&s, 0x81)->type, 2);
	assert_int_equal(usb_setting_endpoint(&s, 0x81)->packet, 512);
	assert_null(usb_setting_endpoint(&s, 0x83));
	assert_true(usb_descriptor_setting(whole, sizeof(whole), 1, 0, 1, &s));
	assert_int_equal(s.n, 1);
	assert_int_equal(s.endpoints[0].type, 3);
	assert_int_equal(s.endpoints[0].packet, 64);
	assert_true(usb_descriptor_setting(whole, sizeof(whole), 2, 0, 0, &s));
	assert_int_equal(s.interface_class, 3);
	assert_int_equal(s.n, 0);
	assert_false(usb_descriptor_setting(whole, sizeof(whole), 0, 5, 0, &s));
	assert_false(usb_descriptor_setting(whole, sizeof(whole), 3, 0, 0, &s));
}

/* Random descriptors: nothing is read beyond their end (under a sanitizer), and the parser ends. */
static void descriptors_of_strangers(void **state)
{
	struct usb_setting s;
	struct usb_device d = {0};
	uint32_t x = 1;

	for (size_t n = 0; n <= sizeof(whole); n++) {
		uint8_t *part = malloc(n ? n : 1);

		memcpy(part, whole, n);
		usb_descriptor_device(part, n, 0, &d);
		usb_descriptor_setting(part, n, 0, 0, 0, &s);
		free(part);
	}
	for (int i = 0; i < 20000; i++) {
		uint8_t *other = malloc(sizeof(whole));

		memcpy(other, whole, sizeof(whole));
		for (int k = 0; k < 4; k++) {
			x = x * 1664525 + 1013904223;
			other[(x >> 8) % sizeof(whole)] = (uint8_t)(x >> 24);
		}
		d.interfaces = 0;
		usb_descriptor_device(other, sizeof(whole), 0, &d);
		assert_true(d.interfaces <= USB_INTERFACES);
		if (usb_descriptor_setting(other, sizeof(whole), 0, 0, 0, &s))
			assert_true(s.n <= USB_ENDPOINTS);
		free(other);
	}
}

/* ---- the kernel's folder ---- */

static void put(const char *folder, const char *port, const char *name, const void *at, size_t size)
{
	char path[600];
	FILE *file;

	snprintf(path, sizeof(path), "%s/%s", folder, port);
	mkdir(path, 0755);
	snprintf(path, sizeof(path), "%s/%s/%s", folder, port, name);
	file = fopen(path, "wbe");
	assert_non_null(file);
	assert_int_equal(fwrite(at, 1, size, file), size);
	fclose(file);
}

static void put_text(const char *folder, const char *port, const char *name, const char *text)
{
	put(folder, port, name, text, strlen(text));
}

static void put_device(const char *folder, const char *port, const char *address)
{
	put(folder, port, "descriptors", whole, sizeof(whole));
	put_text(folder, port, "busnum", "3\n");
	put_text(folder, port, "devnum", address);
	put_text(folder, port, "speed", "480\n");
	put_text(folder, port, "bConfigurationValue", "2\n");
}

static void folder_of_the_kernel(void **state)
{
	char folder[] = "/tmp/acut-usb-XXXXXX", driver[32], path[400];
	struct usb_device *list;
	struct err err = ERR_INIT;
	size_t n;

	assert_non_null(mkdtemp(folder));
	put_device(folder, "3-10", "17\n");
	put_device(folder, "3-2.4", "4\n");
	put_device(folder, "usb3", "1\n");      /* the bus */
	put_device(folder, "3-2.4:1.0", "4\n"); /* an interface */
	put_device(folder, "3-3", "999\n");     /* no such number */
	put(folder, "3-4", "descriptors", whole, 10);
	put_text(folder, "3-2.4", "serial", "A\xc3\xa4\x1b[0m\xff 7 \n");
	put_text(folder, "3-2.4", "product", "  Scanner\n");
	put(folder, "3-10", "descriptors", "\x12\x01\x00\x02\x09\x00\x00\x40\x6b\x1d\x02\x00\x00\x01\x01\x02\x03\x01", 18);
	assert_int_equal(usb_sysfs_list(folder, &list, &n, &err), 0);
	assert_int_equal(n, 1); /* without the hub at 3-10 */
	assert_string_equal(list[0].port, "3-2.4");
	assert_string_equal(list[0].node, "/dev/bus/usb/003/004");
	assert_string_equal(list[0].serial, "A\xc3\xa4?[0m? 7");
	assert_string_equal(list[0].model, "Scanner");
	assert_string_equal(list[0].manufacturer, "");
	assert_string_equal(list[0].speed, "high");
	assert_int_equal(list[0].interface_classes[0], 3);
	assert_false(list[0].openable);
	assert_int_equal(list[0].refused, ENOENT);
	free(list);
	snprintf(path, sizeof(path), "%s/3-2.4:2.1", folder);
	mkdir(path, 0755);
	snprintf(path, sizeof(path), "%s/3-2.4:2.1/driver", folder);
	assert_int_equal(symlink("../../../bus/usb/drivers/usb-storage", path), 0);
	usb_sysfs_driver(folder, "3-2.4", 2, 1, driver, sizeof(driver));
	assert_string_equal(driver, "usb-storage");
	usb_sysfs_driver(folder, "3-2.4", 2, 0, driver, sizeof(driver));
	assert_string_equal(driver, "");
	assert_int_equal(repeat_remove(folder), 0);
	assert_int_equal(usb_sysfs_list(folder, &list, &n, &err), 0); /* no USB at all */
	assert_int_equal(n, 0);
	free(list);
}

static void texts_are_cut_at_characters(void **state)
{
	char folder[] = "/tmp/acut-usb-XXXXXX", text[400];
	struct usb_device *list;
	struct err err = ERR_INIT;
	size_t n;

	assert_non_null(mkdtemp(folder));
	put_device(folder, "3-1", "4\n");
	for (size_t i = 0; i < 100; i++)
		memcpy(text + 2 * i, "\xc3\xa4", 3);
	put_text(folder, "3-1", "serial", text);
	put_text(folder, "3-1", "product", "\xe2\x82\xac\xed\xa0\x80\xc0\x80\xf4\x90\x80\x80\xe2\x82");
	assert_int_equal(usb_sysfs_list(folder, &list, &n, &err), 0);
	assert_int_equal(n, 1);
	assert_int_equal(strlen(list[0].serial), 126); /* of 127: half a character is cut off */
	assert_string_equal(list[0].model, "\xe2\x82\xac???????????");
	free(list);
	assert_int_equal(repeat_remove(folder), 0);
}

/* ---- memory ---- */

static void limits(void **state)
{
	char path[] = "/tmp/acut-usb-XXXXXX";
	struct profile p = {.name = "tim", .transfers = 16, .transfer_size = 1 << 20};
	struct usb_limit limit;
	struct err err = ERR_INIT;
	int fd = mkstemp(path);

	assert_true(fd >= 0);
	assert_int_equal(usb_limit_read(path, &limit, &err), -ERR_INPUT);
	assert_string_equal(err.file, path);
	err = ERR_INIT;
	assert_int_equal(write(fd, "16\n", 3), 3);
	assert_int_equal(usb_limit_read(path, &limit, &err), 0);
	assert_int_equal(limit.bytes, 16 << 20);
	assert_false(limit.assumed);
	/* 16 transfers of 1 MiB do not fit into 16 MiB: the kernel adds its own overhead. */
	assert_true(usb_limit_need(p.transfers, p.transfer_size) > 16 << 20);
	assert_int_equal(usb_limit_check(&limit, &p, 0, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.message, "16777216"));
	assert_non_null(strstr(err.message, "usbfs_memory_mb=16"));
	assert_non_null(strstr(err.hint, "echo 17 > /sys/module/usbcore/parameters/usbfs_memory_mb"));
	assert_non_null(strstr(err.hint, "profile tim"));
	assert_true(err.need > 16 << 20);
	err = ERR_INIT;
	p.transfers = 15;
	assert_int_equal(usb_limit_check(&limit, &p, 0, &err), 0);
	assert_int_equal(usb_limit_check(&limit, &p, 1 << 20, &err), -ERR_LIMIT); /* another capture has that */
	err = ERR_INIT;
	limit.bytes = 0;
	p.transfers = 4096;
	assert_int_equal(usb_limit_check(&limit, &p, 0, &err), 0);
	close(fd);
	unlink(path);
	assert_int_equal(usb_limit_read(path, &limit, &err), 0);
	assert_true(limit.assumed);
	assert_int_equal(limit.bytes, 16 << 20);
}

/* ---- messages ---- */

static const struct usb_device tim = {
	.vendor = 0x19a2, .product = 0x5001, .port = "1-2", .node = "/dev/bus/usb/001/004", .model = "TiM561", .serial = "1234"};

static void refusals(void **state)
{
	struct err err = ERR_INIT;
	char words[200];

	assert_string_equal(usb_device_words(&tim, words, sizeof(words)), "TiM561 19a2:5001 serial 1234 at 1-2");
	assert_int_equal(usb_refusal_mode(&tim, EACCES, &err), -ERR_PERM);
	assert_non_null(strstr(err.hint,
			       "SUBSYSTEM==\"usb\", ATTRS{idVendor}==\"19a2\", ATTRS{idProduct}==\"5001\", MODE=\"0660\", "
			       "GROUP=\"acut-scan\""));
	assert_non_null(strstr(err.hint, "/etc/udev/rules.d/"));
	assert_non_null(strstr(err.message, tim.node));
	assert_true(strlen(err.hint) < sizeof(err.hint) - 1); /* whole */
	err = ERR_INIT;
	assert_int_equal(usb_refusal_mode(&tim, EPERM, &err), -ERR_PERM);
	assert_non_null(strstr(err.hint, "DeviceAllow="));
	err = ERR_INIT;
	assert_int_equal(usb_refusal_busy(&tim, 1, 0, &err), -ERR_BUSY);
	assert_non_null(strstr(err.message, "interface 0 is in use by another program"));
	err = ERR_INIT;
	assert_int_equal(usb_refusal_storage(&tim, &err), -ERR_UNSUPPORTED);
}

static void bytes_in_words(void **state)
{
	char words[40];

	assert_string_equal(usb_bytes_words((const uint8_t *)"\x02sRN a\\\x03", 8, words, sizeof(words)), "\\x02sRN a\\x5c\\x03");
	assert_string_equal(usb_bytes_words(NULL, 0, words, sizeof(words)), "");
	assert_string_equal(usb_bytes_words((const uint8_t *)"0123456789", 10, words, 9), "01234...");
	assert_string_equal(usb_bytes_words((const uint8_t *)"0123456789", 10, words, 11), "0123456789");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(device_of_descriptors),
		cmocka_unit_test(settings_of_descriptors),
		cmocka_unit_test(descriptors_of_strangers),
		cmocka_unit_test(folder_of_the_kernel),
		cmocka_unit_test(texts_are_cut_at_characters),
		cmocka_unit_test(limits),
		cmocka_unit_test(refusals),
		cmocka_unit_test(bytes_in_words),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
