/* record --from: the bytes of a file or a pipe, in the pieces in which they come, so that the times of a pipe are kept. */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clock.h"
#include "scan_record.h"

enum { PIECE = 256 << 10 };

/* A spool is not imported as raw bytes by mistake. */
static int is_spool(const uint8_t *at, size_t size, const char *name, struct err *err)
{
	static const uint8_t magic[8] = {0x89, 'A', 'C', 'U', 'T', 'S', 'P', '\n'};

	if (size < sizeof(magic) || memcmp(at, magic, sizeof(magic)))
		return 0;
	err_set(err, ERR_USAGE, "this is a spool already");
	err_add_hint(err, "acut-scan replay and push read it as it is");
	return err_add_file(err, name);
}

/* 1: something; 0: the end of the file or of the capture. */
static int some(struct record *r, int fd, uint8_t *at, size_t room, size_t *ret_n, const char *name, struct err *err)
{
	struct pollfd p[2] = {{.fd = fd, .events = POLLIN}, {.fd = scan_stop_fd(), .events = POLLIN}};
	ssize_t n;

	while (!record_over(r)) {
		record_report_progress(r);
		if (poll(p, 2, record_patience(r)) < 0 && errno != EINTR)
			return err_sys(err, errno, "cannot wait for bytes");
		if (!p[0].revents)
			continue;
		n = read(fd, at, room);
		if (n < 0 && (errno == EINTR || errno == EAGAIN))
			continue;
		if (n < 0) {
			err_sys(err, errno, "cannot read");
			return err_add_file(err, name);
		}
		*ret_n = (size_t)n;
		if (!n)
			r->why = RECORD_EOF;
		return n > 0;
	}
	return 0;
}

int record_from_file(struct record *r, int fd, struct err *err)
{
	const char *name = strcmp(r->args->from, "-") ? r->args->from : "standard input";
	uint8_t *at = malloc(PIECE);
	size_t n = 0;
	int rc;

	if (!at)
		return err_set(err, ERR_NOMEM, "no memory to read %s", name);
	record_report_start(r, name);
	for (;;) {
		uint64_t limit = r->args->bytes ? r->args->bytes - r->bytes : PIECE;

		rc = some(r, fd, at, limit < PIECE ? (size_t)limit : PIECE, &n, name, err);
		if (rc > 0 && !r->bytes)
			rc = is_spool(at, n, name, err) ? -(int)err->code : 1;
		if (rc <= 0)
			break;
		rc = record_data(r, 0, (int64_t)clock_mono_ns(), at, n, err);
		if (rc)
			break;
	}
	free(at);
	return rc;
}
