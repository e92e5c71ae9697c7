/*
 * The kernel memory for the transfers of all programs together: usbcore's parameter usbfs_memory_mb, 16 MB by default,
 * 0 without a limit. The cost of a transfer is computed as in usbcore: its buffer, its structures, and a list entry for
 * each 16 KiB (drivers/usb/core/devio.c, proc_do_submiturb and usbfs_increase_memory_usage). It is computed before the
 * device is used, so that the error has both numbers.
 */
#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

#include "parse.h"
#include "usb_priv.h"

enum { LIMIT_DEFAULT_MB = 16, URB_BYTES = 512, PIECE = 16384, PIECE_BYTES = 32 };

int usb_limit_read(const char *file, struct usb_limit *ret, struct err *err)
{
	char text[32];
	uint64_t mb;
	ssize_t n;
	int fd = open(file, O_RDONLY | O_CLOEXEC);

	if (fd < 0 && (errno == ENOENT || errno == ENOTDIR || errno == EACCES)) {
		*ret = (struct usb_limit){.bytes = (uint64_t)LIMIT_DEFAULT_MB << 20, .assumed = true};
		return 0;
	}
	if (fd < 0) {
		err_sys(err, errno, "the limit of memory for transfers cannot be read");
		return err_add_file(err, file);
	}
	n = read(fd, text, sizeof(text) - 1);
	close(fd);
	while (n > 0 && (text[n - 1] == '\n' || text[n - 1] == ' '))
		n--;
	text[n > 0 ? n : 0] = 0;
	if (n <= 0 || !parse_u64(text, &mb) || mb > UINT32_MAX) {
		err_set(err, ERR_INPUT, "the limit of memory for transfers is no number of megabytes");
		return err_add_file(err, file);
	}
	*ret = (struct usb_limit){.bytes = mb << 20};
	return 0;
}

/* A controller without scatter-gather takes transfers in pieces of 16 KiB, each with its own structures. */
uint64_t usb_limit_need(uint32_t transfers, uint32_t transfer_size)
{
	uint64_t pieces = ((uint64_t)transfer_size + PIECE - 1) / PIECE;

	return transfers * (transfer_size + (pieces ? pieces : 1) * (URB_BYTES + PIECE_BYTES));
}

int usb_limit_check(const struct usb_limit *limit, const struct profile *profile, uint64_t others, struct err *err)
{
	uint64_t need = usb_limit_need(profile->transfers, profile->transfer_size) +
			(profile->endpoint_out ? usb_limit_need(1, PROFILE_COMMAND_SIZE) : 0);
	uint64_t all = need + others, mb = (all + (1 << 20) - 1) >> 20;

	if (!limit->bytes || all <= limit->bytes)
		return 0;
	err_set(err, ERR_LIMIT,
		"%u transfers of %u bytes need %llu bytes of the kernel's memory for USB%s, and it lends %llu "
		"(usbfs_memory_mb=%llu%s)",
		profile->transfers, profile->transfer_size, (unsigned long long)need,
		others ? ", beside what other captures have" : "", (unsigned long long)limit->bytes,
		(unsigned long long)(limit->bytes >> 20), limit->assumed ? ", assumed: its file is not there" : "");
	err->need = all;
	return err_add_hint(err,
			    "echo %llu > " USB_MEMORY_FILE ", for ever with the kernel's parameter "
			    "usbcore.usbfs_memory_mb=%llu; or fewer or smaller transfers in profile %s",
			    (unsigned long long)mb, (unsigned long long)mb, profile->name);
}
