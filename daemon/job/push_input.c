/*
 * What a push knows of its inputs: which descriptors it takes, and what their headers say of the lattice.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "io.h"
#include "lattice_set.h"
#include "push_priv.h"

/* A client's descriptor must not be able to make a worker wait, nor to change what it is: regular files only.
 */
int push_fd_check(int fd, const char *name, struct push_input_id *ret, struct err *err)
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
	*ret = (struct push_input_id){
		.dev = st.st_dev,
		.ino = st.st_ino,
		.size = (uint64_t)st.st_size,
		.mtime_ns = (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec,
		.ctime_ns = (int64_t)st.st_ctim.tv_sec * 1000000000 + st.st_ctim.tv_nsec,
	};
	return 0;
}

static int scale_of(const char *text, const char *field, struct decimal *ret, struct err *err)
{
	if (!decimal_parse(text, ret) || ret->mantissa <= 0) {
		err_set(err, ERR_USAGE, "\"%.40s\" is not a scale: a decimal above zero is wanted", text);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	return 0;
}

/* Inputs that do not fit do not go on; the others may. Each is answered with its error when its File comes. The last one's
 * error is the push's. */
static int choose_of_fewer(struct push *p, const struct lattice_input *inputs, struct push_probed **probes, size_t n,
			   const struct decimal *xy, const struct decimal *z, struct err *err)
{
	struct lattice_set *set = lattice_set_new(inputs, n);
	size_t which;
	int r;

	err_clear(err);
	if (!set)
		return err_set(err, ERR_NOMEM, "no memory to choose a lattice");
	while ((r = lattice_set_choose(set, xy, z, &p->lattice, &which, err))) {
		if (which == n || lattice_set_left(set) == 1 || atomic_load(&p->cancel) || push_leave_out(probes[which], err))
			break;
		lattice_set_remove(set, which);
		err_clear(err);
	}
	lattice_set_free(set);
	return r;
}

/* Degrees that are taken as a plane may be rounded less than lengths. */
static void limit_rounding(const struct push_probed *probe, struct lattice_input *c)
{
	static const struct decimal degrees = {1, -9};

	for (int k = 0; k < 2; k++)
		if (probe->crs->plane == CRS_PLANE_GEOGRAPHIC && c->coarsest[k].mantissa &&
		    decimal_compare(c->coarsest[k], degrees) > 0)
			c->coarsest[k] = degrees;
}

static bool rounds(const struct push_probed *probe, unsigned axis, struct decimal scale)
{
	const struct lattice_input *c = &probe->coords;

	return !probe->why && (c->rounds[axis] || (c->coarsest[axis].mantissa && decimal_compare(c->scale[axis], scale) < 0));
}

/* Which scale was chosen, where nobody asked for it and inputs have more digits. */
static void note_rounding(struct push *p)
{
	char more[48] = "", xy[DECIMAL_TEXT_SIZE], z[DECIMAL_TEXT_SIZE];
	const struct push_probed *first = NULL;
	bool any_xy = false, any_z = false;
	size_t n = 0;

	*p->lattice_note = 0;
	for (size_t i = 0; i < p->nprobes; i++) {
		const struct push_probed *probe = &p->probes[i];
		bool of_xy = !*p->scale_xy && (rounds(probe, 0, p->lattice.scale_xy) || rounds(probe, 1, p->lattice.scale_xy));
		bool of_z = !*p->scale_z && rounds(probe, 2, p->lattice.scale_z);

		any_xy |= of_xy;
		any_z |= of_z;
		if ((of_xy || of_z) && !n++)
			first = probe;
	}
	if (!n)
		return;
	if (n > 1)
		snprintf(more, sizeof more, " and %zu more", n - 1);
	snprintf(p->lattice_note, sizeof p->lattice_note,
		 "%.160s%s: more digits than 32 bits hold%s: %s%s%s%s%s, the finest scale that does; --scale XY,Z says another",
		 first->name, more, p->dataset->onestep ? " of all inputs" : " with room for what is pushed later",
		 any_xy ? "x and y are rounded to " : "", any_xy ? decimal_text(p->lattice.scale_xy, xy) : "",
		 any_xy && any_z ? ", " : "", any_z ? any_xy ? "z to " : "z is rounded to " : "",
		 any_z ? decimal_text(p->lattice.scale_z, z) : "");
}

/* From all headers that were probed, so that it does not depend on their order; those that cannot be on one
 * lattice with the others are left out one by one. Worker. */
int push_choose_lattice(struct push *p, struct err *err)
{
	struct decimal xy, z;
	struct lattice_input *inputs;
	struct push_probed **probes;
	size_t i, n = 0;
	int r = 0;

	if (*p->scale_xy)
		r = scale_of(p->scale_xy, "scale_xy", &xy, err);
	if (!r && *p->scale_z)
		r = scale_of(p->scale_z, "scale_z", &z, err);
	if (r)
		return r;
	if (!p->nprobes)
		return err_set(err, ERR_USAGE, "no input was probed: there is nothing to choose a lattice from");
	inputs = calloc(p->nprobes, sizeof *inputs);
	probes = calloc(p->nprobes, sizeof *probes);
	if (!inputs || !probes)
		r = err_set(err, ERR_NOMEM, "no memory to choose a lattice");
	for (i = 0; !r && i < p->nprobes; i++) {
		if (p->probes[i].why)
			continue;
		r = push_plane_coords(p, &p->probes[i], err);
		limit_rounding(&p->probes[i], &p->probes[i].coords);
		probes[n] = &p->probes[i];
		inputs[n] = p->probes[i].coords;
		inputs[n++].grows = !p->dataset->onestep;
	}
	if (!r)
		r = lattice_choose(inputs, n, *p->scale_xy ? &xy : NULL, *p->scale_z ? &z : NULL, &p->lattice, err);
	if (r == -ERR_INPUT && n > 1 && *err->file)
		r = choose_of_fewer(p, inputs, probes, n, *p->scale_xy ? &xy : NULL, *p->scale_z ? &z : NULL, err);
	if (!r)
		note_rounding(p);
	free(inputs);
	free(probes);
	return r;
}

/* ---- a probe of its own ---- */

struct info_ask {
	struct sched_task task;
	struct jobs *jobs;
	int fd, r;
	char *name, *format, *columns;
	bool decimal_comma;
	struct input_info info;
	char info_format[16];
	struct err err;
	void (*probed)(void *token, const struct err *why, const char *name, const struct input_info *);
	void *token;
};

static void info_run(struct sched_task *t)
{
	struct info_ask *a = (struct info_ask *)t;
	/* It is described only, so its plane does not matter, nor that it ends early. */
	struct input_options options = {
		.format = *a->format ? a->format : NULL,
		.columns = *a->columns ? a->columns : NULL,
		.decimal_comma = a->decimal_comma,
		.accept_truncated = true,
		.planar = true,
	};
	struct push_input_id id;
	struct input *in = NULL;

	a->r = push_fd_check(a->fd, a->name, &id, &a->err);
	if (!a->r)
		a->r = input_open(a->fd, a->name, &options, &in, &a->err);
	if (a->r) {
		err_add_file(&a->err, a->name);
		return;
	}
	a->info = *input_info(in);
	snprintf(a->info_format, sizeof a->info_format, "%s", a->info.format);
	a->info.format = a->info_format;
	a->info.coords.name = a->name;
	input_close(in);
}

static void info_done(struct sched_task *t)
{
	struct info_ask *a = (struct info_ask *)t;

	if (t->ran)
		sched_give(a->jobs->p.sched, t->name, t->bytes);
	else
		a->r = err_set(&a->err, ERR_CANCELLED, "the daemon is stopping");
	a->jobs->background--;
	a->probed(a->token, a->r ? &a->err : NULL, a->name, a->r ? NULL : &a->info);
	io_close(a->fd);
	free(a->name);
	free(a->format);
	free(a->columns);
	free(a);
}

void push_info(struct jobs *j, int fd, const char *name, const char *format, const char *columns, bool decimal_comma,
	       const struct job_peer *peer,
	       void (*probed)(void *token, const struct err *why, const char *name, const struct input_info *), void *token)
{
	struct info_ask *a = calloc(1, sizeof *a);
	struct err err = ERR_INIT;

	if (a) {
		a->name = strdup(name);
		a->format = strdup(format);
		a->columns = strdup(columns);
		a->decimal_comma = decimal_comma;
	}
	if (!a || !a->name || !a->format || !a->columns) {
		err_set(&err, ERR_NOMEM, "no memory for a request");
		if (a) {
			free(a->name);
			free(a->format);
			free(a->columns);
			free(a);
		}
		io_close(fd);
		probed(token, &err, name, NULL);
		return;
	}
	a->task = (struct sched_task){
		.run = info_run,
		.done = info_done,
		.owner = {.uid = peer->uid, .flow = ++j->last_flow},
		.reads = true,
		.priority = SCHED_FIRST,
		.name = LEDGER_INPUT,
		.bytes = input_bytes(),
	};
	a->jobs = j;
	a->fd = fd;
	a->err = ERR_INIT;
	a->probed = probed;
	a->token = token;
	j->background++;
	sched_submit(j->p.sched, &a->task);
}
