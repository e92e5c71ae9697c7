/*
 * What parts leave beside the outputs: folders whose files were moved, and files of attempts that were killed. Their names have
 * the number of the run. Folders are listed only here.
 */
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gather_priv.h"
#include "io.h"
#include "io_place.h"

struct sweep {
	int fd;
	char mark[32], but[48]; /* ".ID-", ".ID-FINISH-" */
};

static int sweep_entry(void *ctx, const struct dirent *e, struct err *err)
{
	const struct sweep *s = ctx;
	size_t n = strlen(e->d_name);

	if (e->d_name[0] != '.' || n < 5 || strcmp(e->d_name + n - 5, ".part") || !strstr(e->d_name, s->mark))
		return 0;
	if (s->but[0] && strstr(e->d_name, s->but))
		return 0;
	return io_folder_remove(s->fd, e->d_name, err);
}

static int sweep_folder(const struct gather_params *p, bool finishing, int fd, struct err *err)
{
	const unsigned long long id = work_about(p->work)->id;
	struct sweep s = {.fd = fd};

	snprintf(s.mark, sizeof(s.mark), ".%016llx-", id);
	if (finishing)
		snprintf(s.but, sizeof(s.but), ".%016llx-%u-", id, GATHER_FINISH);
	return io_list(fd, ".", sweep_entry, &s, err);
}

int gather_sweep(const struct gather_params *p, bool finishing, struct err *err)
{
	const struct ctl_fetch_options *a = p->outputs;
	int r = 0;

	for (unsigned i = 1; i <= ctl_fetch_count(a) && !r; i++) {
		const char *path = ctl_fetch_output(a, i).path;
		struct err absent = ERR_INIT;
		struct io_place place = {.dirfd = -1};
		int fd = -1;

		if (a->tile || a->levels) {
			if (io_place_folder(path, 0, &fd, NULL, &absent))
				continue; /* it was never made */
		} else {
			if (io_place_find(path, true, &place, &absent))
				continue;
			r = io_open(place.dirfd, ".", O_RDONLY | O_DIRECTORY, 0, &fd, err);
			io_place_done(&place);
		}
		if (!r)
			r = sweep_folder(p, finishing, fd, err);
		io_close(fd);
	}
	return r;
}

int gather_clean(const struct gather_params *p, struct err *err)
{
	return gather_sweep(p, false, err);
}
