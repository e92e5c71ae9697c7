/*
 * The interface of the room: recognising formats, opening, closing, and checking whether files change while they are read.
 *
 * Model: an input is one allocation, with its read buffer and the state of its reader; beside it only a WKT is allocated. The
 * descriptor is borrowed and only read at explicit offsets. Not here: threads, paths, anything but regular files.
 */
#include "input.h"
#include "input_las.h"
#include "input_table.h"
#include "input_text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io.h"

/* The largest state of any reader. */
static size_t state_bytes(void)
{
	size_t most = 0;

	for (size_t i = 0; i < input_n_rows; i++)
		most = input_rows[i].reader->state_bytes > most ? input_rows[i].reader->state_bytes : most;
	return most;
}

size_t input_bytes(void)
{
	return sizeof(struct input) + state_bytes() + CRS_WKT_MAX + 1;
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

/* Recognises formats other than plain text. */
static bool is_named_otherwise(const struct input *in)
{
	for (size_t i = 0; i < input_n_rows; i++)
		if (!input_rows[i].reader->plain_text && input_has_extension(in->name, input_rows[i].extensions))
			return true;
	return false;
}

/* Recognises a format by content. If no format fits, by the name, so that the reader of that format reports the error. */
static const struct input_row *recognise(const struct input *in, size_t n)
{
	for (size_t i = 0; n && i < input_n_rows; i++)
		if (input_rows[i].reader->matches(in->buffer, n) && !(input_rows[i].reader->plain_text && is_named_otherwise(in)))
			return &input_rows[i];
	for (size_t i = 0; i < input_n_rows; i++)
		if (input_has_extension(in->name, input_rows[i].extensions))
			return &input_rows[i];
	return n ? NULL : &input_rows[input_n_rows - 1]; /* nothing but the mark of an encoding */
}

/* The format of an empty file is known only by its name: a text may have no points, other formats have at least a head. */
static int choose_empty(struct input *in, const struct input_row **ret, struct err *err)
{
	for (size_t i = 0; i < input_n_rows; i++)
		if (input_rows[i].reader->plain_text && input_has_extension(in->name, input_rows[i].extensions))
			*ret = &input_rows[i];
	if (*ret)
		return 0;
	input_fail(in, err, ERR_TRUNCATED, 0, "header", "the file is empty (0 bytes)");
	return err_add_hint(err, "copy it again; --input-format xyz takes it as a text without points");
}

/* Refuses PTX that --input-format calls a list of points: the heads of its scans are not points. */
static int check_forced(struct input *in, const struct input_row *row, size_t n, struct err *err)
{
	if (!row->reader->plain_text || !input_ptx_reader.matches(in->buffer, n))
		return 0;
	input_fail(in, err, ERR_INPUT, 0, NULL, "this is PTX, and --input-format says that it is %s", row->name);
	return err_add_hint(err, "leave --input-format out, or say ptx");
}

static int choose_row(struct input *in, const char *format, const struct input_row **ret, struct err *err)
{
	size_t n;
	int rc;

	for (size_t i = 0; format && !*ret && i < input_n_rows; i++)
		if (!strcmp(format, input_rows[i].name))
			*ret = &input_rows[i];
	if (format && !*ret) {
		err_set(err, ERR_USAGE, "there is no input format \"%s\"", format);
		return err_add_hint(err, "\"acutctl formats\" lists them");
	}
	rc = io_read_some(in->fd, in->buffer, INPUT_SNIFF, 0, in->name, &n, err);
	if (rc)
		return rc;
	n = input_encoding_sniff(in->buffer, n);
	if (format)
		return check_forced(in, *ret, n, err);
	rc = input_foreign_check(in, n, err);
	if (rc || !in->size)
		return rc ? rc : choose_empty(in, ret, err);
	*ret = recognise(in, n);
	if (!*ret) {
		input_fail(in, err, ERR_INPUT, 0, NULL, "neither LAS nor text: no format that acut knows");
		return err_add_hint(err, "\"acutctl formats\" lists what can be read");
	}
	return 0;
}

static int open_input(struct input *in, const char *format, struct err *err)
{
	const struct input_row *row = NULL;
	int rc = input_take_stat(in, err);

	if (rc)
		return rc;
	if (in->has_pipe) {
		in->head = in->size;
		in->size = UINT64_MAX / 2;
	}
	rc = choose_row(in, format, &row, err);
	if (rc)
		return rc;
	in->reader = row->reader;
	if (!in->size && in->reader->plain_text)
		input_warn(in, "the file is empty (0 bytes)");
	in->info.format = row->name;
	in->info.coords.name = in->name;
	in->info.parts = 1;
	in->info.bytes = in->info.bytes_selected = in->info.accounted = in->has_pipe ? 0 : in->size;
	if (in->has_pipe && !in->reader->forwards)
		return input_fail(in, err, ERR_INTERNAL, ERR_NO_OFFSET, NULL, "%s cannot be read from a pipe", row->name);
	rc = in->reader->open(in, err);
	in->bytes_read = 0;
	return rc;
}

/* All zeros, or like `whole`, but for the buffer. */
static struct input *allocate(const struct input *whole)
{
	size_t state = state_bytes();
	struct input *in = malloc(sizeof *in + state);

	if (!in)
		return NULL;
	if (whole)
		memcpy(in, whole, offsetof(struct input, buffer));
	else
		memset(in, 0, offsetof(struct input, buffer));
	if (whole)
		memcpy(input_state(in), input_state(whole), state);
	else
		memset(input_state(in), 0, state);
	return in;
}

int input_open(int fd, const char *name, const struct input_options *options, struct input **ret, struct err *err)
{
	struct input *in = allocate(NULL);
	int rc;

	if (!in) {
		err_set(err, ERR_NOMEM, "no memory to read a file");
		return err_add_file(err, name);
	}
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
	in = allocate(whole);
	if (!in) {
		err_set(err, ERR_NOMEM, "no memory to read a file");
		return err_add_file(err, whole->name);
	}
	in->info.coords.name = in->name;
	in->seen = NULL; /* parts are read at once, and not upwards */
	in->wkt = NULL;
	if (in->reader->part)
		in->reader->part(in, first, last);
	*ret = in;
	return 0;
}

const struct input_info *input_info(const struct input *in)
{
	return &in->info;
}

const char *input_wkt(const struct input *in)
{
	return in->wkt ? in->wkt : "";
}

uint64_t input_bytes_read(const struct input *in)
{
	return in->bytes_read;
}

int input_read(struct input *in, struct input_points *pts, struct err *err)
{
	pts->n = 0;
	return in->reader->read(in, pts, err);
}

uint64_t input_forward_head(const uint8_t *bytes, size_t n)
{
	return input_las_forward_head(bytes, n);
}

struct input *input_close(struct input *in)
{
	if (in && in->reader && in->reader->close)
		in->reader->close(in);
	if (in)
		free(in->wkt);
	free(in);
	return NULL;
}
