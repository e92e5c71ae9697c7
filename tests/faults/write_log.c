/*
 * An nbdkit plugin: a disk in a file, and beside it a log of every write, flush and write-through, from which power.py makes
 * what the disk may hold after a power cut. A record: u32 kind (1 write, 2 flush, 3 write that is safe itself), u32 bytes,
 * u64 offset, the bytes.
 *
 *   nbdkit write_log.so file=DISK log=LOG
 */
#define NBDKIT_API_VERSION 2
#include <nbdkit-plugin.h>

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

/* One request at a time: the log has the order of the answers. */
#define THREAD_MODEL NBDKIT_THREAD_MODEL_SERIALIZE_ALL_REQUESTS

static char *file, *log_file;
static int disk = -1, out = -1;

struct record {
	uint32_t kind, n;
	uint64_t at;
};

static int wl_config(const char *key, const char *value)
{
	char **to = !strcmp(key, "file") ? &file : !strcmp(key, "log") ? &log_file : NULL;

	if (!to) {
		nbdkit_error("unknown parameter %s", key);
		return -1;
	}
	*to = nbdkit_absolute_path(value);
	return *to ? 0 : -1;
}

static int wl_ready(void)
{
	disk = file ? open(file, O_RDWR | O_CLOEXEC) : -1;
	out = log_file ? open(log_file, O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0600) : -1;
	if (disk < 0 || out < 0) {
		nbdkit_error("file= and log=: %m");
		return -1;
	}
	return 0;
}

static void *wl_open(int readonly)
{
	return NBDKIT_HANDLE_NOT_NEEDED;
}

static int64_t wl_size(void *handle)
{
	struct stat st;

	return fstat(disk, &st) ? -1 : st.st_size;
}

static int note(uint32_t kind, const void *buf, uint32_t n, uint64_t at)
{
	struct record r = {kind, n, at};
	struct iovec v[2] = {{&r, sizeof r}, {(void *)buf, n}};

	return writev(out, v, n ? 2 : 1) == (ssize_t)(sizeof r + n) ? 0 : -1;
}

static int wl_pread(void *handle, void *buf, uint32_t n, uint64_t at, uint32_t flags)
{
	return pread(disk, buf, n, (off_t)at) == (ssize_t)n ? 0 : -1;
}

static int wl_pwrite(void *handle, const void *buf, uint32_t n, uint64_t at, uint32_t flags)
{
	if (pwrite(disk, buf, n, (off_t)at) != (ssize_t)n)
		return -1;
	return note(flags & NBDKIT_FLAG_FUA ? 3 : 1, buf, n, at);
}

static int wl_flush(void *handle, uint32_t flags)
{
	return note(2, NULL, 0, 0);
}

static int wl_can_fua(void *handle)
{
	return NBDKIT_FUA_NATIVE;
}

static struct nbdkit_plugin plugin = {
	.name = "write-log",
	.config = wl_config,
	.get_ready = wl_ready,
	.open = wl_open,
	.get_size = wl_size,
	.pread = wl_pread,
	.pwrite = wl_pwrite,
	.flush = wl_flush,
	.can_fua = wl_can_fua,
	.errno_is_preserved = 1,
};

NBDKIT_REGISTER_PLUGIN(plugin)
