/* A file without a name, for what has to be a file for a while: in $TMPDIR, else in /var/tmp, which is on a disk. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "ctl_input_priv.h"

int ctl_temp_open(const char **ret_folder, int *ret_fd, struct err *err)
{
	const char *folder = getenv("TMPDIR");
	char path[4096];
	int fd;

	folder = folder && *folder ? folder : "/var/tmp";
	fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
	if (fd < 0 && (errno == EOPNOTSUPP || errno == EISDIR || errno == EINVAL)) {
		/* a file system without such files */
		snprintf(path, sizeof(path), "%s/acut-input-XXXXXX", folder);
		fd = mkostemp(path, O_CLOEXEC);
		if (fd >= 0)
			unlink(path);
	}
	if (fd < 0) {
		err_sys(err, errno, "no file can be made in %.200s", folder);
		return err_add_hint(err, "set TMPDIR to a folder that can be written to");
	}
	*ret_folder = folder;
	*ret_fd = fd;
	return 0;
}
