/*
 * Messages of all readers: warnings, coordinates that are not in a plane, and files that change while they are read.
 */
#include "input_reader.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "io.h"

void input_warn(struct input *in, const char *fmt, ...)
{
	char *text = in->info.warning;
	size_t n = strlen(text), size = sizeof in->info.warning;
	va_list args;

	if (n && n + 3 < size)
		n += (size_t)snprintf(text + n, size - n, "; ");
	va_start(args, fmt);
	vsnprintf(text + n, size - n, fmt, args);
	va_end(args);
}

static int ask(struct input *in, struct stat *st, struct err *err)
{
	if (io->fstat(in->fd, st) < 0) {
		err_sys(err, errno, "cannot ask for the size of the file");
		return err_add_file(err, in->name);
	}
	return 0;
}

int input_take_stat(struct input *in, struct err *err)
{
	struct stat st;
	int rc = ask(in, &st, err);

	if (rc)
		return rc;
	if (!S_ISREG(st.st_mode)) {
		input_fail(in, err, ERR_INPUT, ERR_NO_OFFSET, NULL, "not a regular file");
		return err_add_hint(err, "only regular files can be read as input");
	}
	in->size = (uint64_t)st.st_size;
	in->mtime = st.st_mtim;
	return 0;
}

int input_check_unchanged(struct input *in, struct err *err)
{
	struct stat st;
	int rc = in->has_pipe ? 0 : ask(in, &st, err);

	if (rc || in->has_pipe)
		return rc;
	if ((uint64_t)st.st_size != in->size || st.st_mtim.tv_sec != in->mtime.tv_sec ||
	    st.st_mtim.tv_nsec != in->mtime.tv_nsec) {
		input_fail(in, err, ERR_CHANGED, ERR_NO_OFFSET, NULL, "the file changed while it was read");
		return err_add_hint(err, "wait until it is completely written, then push it again");
	}
	return 0;
}

int input_check_plane(struct input *in, struct err *err)
{
	if (in->planar || in->any_plane)
		return 0;
	if (in->info.crs.plane == CRS_PLANE_GEOGRAPHIC && !in->degrees) {
		input_fail(in, err, ERR_UNSUPPORTED, ERR_NO_OFFSET, "coordinate system",
			   "its coordinates are degrees (%.200s), which are no plane", in->info.crs.text);
		return err_add_hint(err, "--planar triangulates the file's own plane, degrees as they are");
	}
	if (in->info.crs.plane == CRS_PLANE_GEOCENTRIC) {
		input_fail(in, err, ERR_UNSUPPORTED, ERR_NO_OFFSET, "coordinate system",
			   "its coordinates are geocentric (%.200s): no terrain stands on the plane of x and y",
			   in->info.crs.text);
		return err_add_hint(err,
				    "project it to a plane first; --planar takes x and y as they are; if that is not what they "
				    "are, name their system with --override-crs");
	}
	return 0;
}
