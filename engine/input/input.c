/*
 * The door of the room: which format it is, opening, closing, and the watch over files that change.
 *
 * Model: an input is one allocation, its read buffer included; nothing is allocated afterwards, whatever
 * the file says. The descriptor is borrowed and only ever read at explicit offsets. Not here: threads,
 * paths, anything but regular files.
 */
#include "input.h"
#include "input_parts.h"
#include "input_text.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io.h"

size_t input_bytes(void)
{
	return sizeof(struct input);
}

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

static int stat_input(struct input *in, struct stat *st, struct err *err)
{
	if (io->fstat(in->fd, st) < 0) {
		err_sys(err, errno, "cannot ask for the size of the file");
		return err_add_file(err, in->name);
	}
	return 0;
}

int input_check_unchanged(struct input *in, struct err *err)
{
	struct stat st;
	int rc = in->has_pipe ? 0 : stat_input(in, &st, err);

	if (rc || in->has_pipe)
		return rc;
	if ((uint64_t)st.st_size != in->size || st.st_mtim.tv_sec != in->mtime.tv_sec ||
	    st.st_mtim.tv_nsec != in->mtime.tv_nsec) {
		input_fail(in, err, ERR_CHANGED, ERR_NO_OFFSET, NULL, "the file changed while it was read");
		return err_add_hint(err, "wait until whoever writes it is done, then push it again");
	}
	return 0;
}

bool input_has_extension(const char *name, const char *extensions)
{
	const char *dot = strrchr(name, '.');

	if (!dot)
		return false;
	for (const char *e = extensions; *e;) {
		size_t n = strcspn(e, " ");

		if (strlen(dot) == n && !strncasecmp(dot, e, n))
			return true;
		e += n;
		e += strspn(e, " ");
	}
	return false;
}

/* By content; where the content fits no format, by the name, so that the format's own reader says what
 * is wrong with it. */
static const struct input_row *recognise(const struct input *in, size_t n)
{
	for (size_t i = 0; n && i < input_n_rows; i++)
		if (input_rows[i].matches(in->buffer, n) &&
		    !(input_rows[i].open == input_xyz_open && input_has_extension(in->name, ".las .laz .ptx")))
			return &input_rows[i];
	for (size_t i = 0; i < input_n_rows; i++)
		if (input_has_extension(in->name, input_rows[i].text->extensions))
			return &input_rows[i];
	return n ? NULL : &input_rows[input_n_rows - 1]; /* nothing but the mark of an encoding */
}

/* Of no bytes only the name says what they are: a text of no points is one, any other format has at least a head. */
static int choose_empty(struct input *in, struct err *err)
{
	for (size_t i = 0; i < input_n_rows; i++)
		if (input_rows[i].open == input_xyz_open && input_has_extension(in->name, input_rows[i].text->extensions))
			in->row = &input_rows[i];
	if (in->row)
		return 0;
	input_fail(in, err, ERR_TRUNCATED, 0, "header", "the file is empty (0 bytes)");
	return err_add_hint(err, "copy it again; --input-format xyz takes it as a text without points");
}

/* A text of scans that is called a list of points: its heads are no points. */
static int check_forced(struct input *in, size_t n, struct err *err)
{
	if (in->row->open != input_xyz_open || !input_ptx_matches(in->buffer, n))
		return 0;
	input_fail(in, err, ERR_INPUT, 0, NULL, "this is PTX, and --input-format says that it is %s", in->row->text->name);
	return err_add_hint(err, "leave --input-format out, or say ptx");
}

static int choose_row(struct input *in, const char *format, struct err *err)
{
	size_t n;
	int rc;

	for (size_t i = 0; format && !in->row && i < input_n_rows; i++)
		if (!strcmp(format, input_rows[i].text->name))
			in->row = &input_rows[i];
	if (format && !in->row) {
		err_set(err, ERR_USAGE, "there is no input format \"%s\"", format);
		return err_add_hint(err, "\"acutctl formats\" lists them");
	}
	rc = io_read_some(in->fd, in->buffer, INPUT_SNIFF, 0, in->name, &n, err);
	if (rc)
		return rc;
	n = input_encoding_sniff(in->buffer, n);
	if (format)
		return check_forced(in, n, err);
	rc = input_foreign_check(in, n, err);
	if (rc || !in->size)
		return rc ? rc : choose_empty(in, err);
	in->row = recognise(in, n);
	if (!in->row) {
		input_fail(in, err, ERR_INPUT, 0, NULL, "neither LAS nor text: no format that acut knows");
		return err_add_hint(err, "\"acutctl formats\" lists what can be read");
	}
	return 0;
}

static int open_input(struct input *in, const char *format, struct err *err)
{
	struct stat st;
	int rc = stat_input(in, &st, err);

	if (rc)
		return rc;
	if (!S_ISREG(st.st_mode)) {
		input_fail(in, err, ERR_INPUT, ERR_NO_OFFSET, NULL, "not a regular file");
		return err_add_hint(err, "only regular files can be read as input");
	}
	in->size = (uint64_t)st.st_size;
	in->mtime = st.st_mtim;
	if (in->has_pipe) {
		in->head = in->size;
		in->size = UINT64_MAX / 2;
	}
	rc = choose_row(in, format, err);
	if (rc)
		return rc;
	if (!in->size && in->row->open == input_xyz_open)
		input_warn(in, "the file is empty (0 bytes)");
	in->info.format = in->row->text->name;
	in->info.coords.name = in->name;
	in->info.parts = 1;
	in->info.bytes = in->info.bytes_selected = in->has_pipe ? 0 : in->size;
	if (in->has_pipe && (in->row->matches == input_pts_matches || in->row->open == input_ptx_open))
		return input_fail(in, err, ERR_INTERNAL, ERR_NO_OFFSET, NULL, "%s cannot be read from a pipe",
				  in->row->text->name);
	in->info.accounted = in->row->open == input_las_open ? 0 : in->info.bytes;
	rc = in->row->open(in, err);
	in->bytes_read = 0;
	return rc;
}

int input_open(int fd, const char *name, const struct input_options *options, struct input **ret, struct err *err)
{
	struct input *in = malloc(sizeof *in);
	int rc;

	if (!in) {
		err_set(err, ERR_NOMEM, "no memory to read a file");
		return err_add_file(err, name);
	}
	memset(in, 0, offsetof(struct input, buffer));
	in->fd = fd;
	snprintf(in->name, sizeof in->name, "%s", name);
	in->accept_truncated = options->accept_truncated;
	in->planar = options->planar;
	in->any_plane = options->any_plane;
	in->has_crop = options->has_crop;
	memcpy(in->crop, options->crop, sizeof in->crop);
	in->degrees = options->degrees;
	in->has_pipe = options->has_pipe;
	in->pipe = options->has_pipe ? options->pipe : -1;
	in->pipe_seen = options->pipe_seen;
	in->pipe_ctx = options->pipe_ctx;
	in->seen = options->seen;
	in->seen_ctx = options->seen_ctx;
	in->columns = options->columns;
	in->lattice[0] = options->scale_xy;
	in->lattice[1] = options->scale_z;
	in->decimal_comma = options->decimal_comma;
	in->strict = options->strict;
	in->lattice_later = options->lattice_later;
	rc = input_columns_check(in->columns, err);
	if (!rc)
		rc = open_input(in, options->format, err);
	in->columns = NULL;
	if (rc) {
		input_close(in);
		return rc;
	}
	*ret = in;
	return 0;
}

int input_open_part(const struct input *whole, uint64_t first, uint64_t last, struct input **ret, struct err *err)
{
	struct input *in;

	if (first >= last || last > whole->info.parts)
		return err_set(err, ERR_INTERNAL, "parts %llu to %llu of %llu", (unsigned long long)first,
			       (unsigned long long)last, (unsigned long long)whole->info.parts);
	in = malloc(sizeof *in);
	if (!in) {
		err_set(err, ERR_NOMEM, "no memory to read a file");
		return err_add_file(err, whole->name);
	}
	memcpy(in, whole, offsetof(struct input, buffer));
	in->info.coords.name = in->name;
	in->seen = NULL; /* parts are read at once, and not upwards */
	if (in->row->part)
		in->row->part(in, first, last);
	*ret = in;
	return 0;
}

const struct input_info *input_info(const struct input *in)
{
	return &in->info;
}

uint64_t input_bytes_read(const struct input *in)
{
	return in->bytes_read;
}

int input_read(struct input *in, struct input_points *pts, struct err *err)
{
	pts->n = 0;
	return in->row->read(in, pts, err);
}

struct input *input_close(struct input *in)
{
	if (in && in->row && in->row->close)
		in->row->close(in);
	free(in);
	return NULL;
}
