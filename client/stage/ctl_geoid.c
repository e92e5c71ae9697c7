/* Files that become geoid grids of the daemon. */
#include <string.h>

#include "ctl_stage.h"
#include "io.h"

/* "folder/egm96-5.pgm": "egm96-5". */
static void name_of(const char *path, char *ret, size_t size)
{
	const char *slash = strrchr(path, '/'), *base = slash ? slash + 1 : path;
	size_t n = strlen(base);

	if (n > 4 && !strcmp(base + n - 4, ".pgm"))
		n -= 4;
	snprintf(ret, size, "%.*s", (int)n, base);
}

int ctl_stage_geoid(struct session *session, const char *path, const char *name, char ret_name[128],
		    const struct acut_geoid **ret)
{
	struct err err = ERR_INIT;
	int fd, r;

	if (name)
		snprintf(ret_name, 128, "%s", name);
	else
		name_of(path, ret_name, 128);
	if (ctl_input_open_file(path, &fd, &err))
		return session_error(session, &err);
	r = acut_geoid_add(session->acut, fd, ret_name, path, ret);
	io_close(fd);
	return r ? session_error_acut(session) : 0;
}
