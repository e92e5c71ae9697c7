/* Descriptors that clients pass. */
#include <errno.h>
#include <fcntl.h>
#include <sys/stat.h>

#include "core.h"
#include "io.h"

/* Only regular files: a descriptor of a client must not be able to block a worker, nor to become something else later. */
int client_file_check(int fd, const char *name, struct client_file *ret, struct err *err)
{
	struct stat st;
	int flags;

	if (fd < 0) {
		err_set(err, ERR_INPUT, "no descriptor came with the file");
		return err_add_file(err, name);
	}
	flags = fcntl(fd, F_GETFL);
	if (flags < 0 || io->fstat(fd, &st) != 0) {
		err_sys(err, errno, "the descriptor cannot be used");
		return err_add_file(err, name);
	}
	if (!S_ISREG(st.st_mode)) {
		err_set(err, ERR_INPUT, "it is a %s, not a regular file",
			S_ISDIR(st.st_mode)  ? "folder" :
			S_ISFIFO(st.st_mode) ? "pipe" :
			S_ISSOCK(st.st_mode) ? "socket" :
					       "device");
		err_add_hint(err, "pass a file; what comes from a pipe must be written to a file first");
		return err_add_file(err, name);
	}
	if ((flags & O_PATH) || (flags & O_ACCMODE) == O_WRONLY) {
		err_set(err, ERR_PERM, "the descriptor was not opened for reading");
		return err_add_file(err, name);
	}
	*ret = (struct client_file){
		.dev = st.st_dev,
		.ino = st.st_ino,
		.size = (uint64_t)st.st_size,
		.mtime_ns = (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec,
		.ctime_ns = (int64_t)st.st_ctim.tv_sec * 1000000000 + st.st_ctim.tv_nsec,
	};
	return 0;
}
