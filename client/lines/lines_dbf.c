/*
 * dBASE tables as Shapefiles have them (level 3 to 7 agree in what is read here): a head of 32 bytes, 32 for each field, then
 * rows of one size, each with a flag for deletion before its fields.
 */
#include "lines_dbf.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "io.h"

enum { HEAD = 32, FIELD = 32, NAME = 11, FIELDS_MOST = 2046, NAME_MOST = 10 };

static uint32_t u16(const uint8_t *p)
{
	return p[0] | (uint32_t)p[1] << 8;
}

static uint32_t u32(const uint8_t *p)
{
	return u16(p) | u16(p + 2) << 16;
}

static int damaged(struct err *err, const char *what)
{
	err_set(err, ERR_INPUT, "its table (.dbf) %s", what);
	return err_add_hint(err, "write the Shapefile again, or leave out --kind-field and move the table away");
}

/* Names have ten bytes, so longer ones are cut there, as the writers of Shapefiles do. */
static bool is_field(const char *wanted, const char name[NAME + 1])
{
	size_t n = strlen(wanted) > NAME_MOST ? NAME_MOST : strlen(wanted);

	return strnlen(name, NAME) == n && !strncasecmp(wanted, name, n);
}

static int no_field(struct lines *l, const char *names, struct err *err)
{
	err_set(err, ERR_INPUT, "it has no field \"%s\"", l->kind_field);
	return err_add_hint(err, "its fields: %s", *names ? names : "none");
}

static int find_field(struct lines *l, struct lines_dbf *d, struct err *err)
{
	char names[sizeof err->hint - 32] = "";
	uint8_t f[FIELD];
	uint32_t at = 1;
	size_t n = 0;

	for (uint32_t i = 0; i < FIELDS_MOST && HEAD + (i + 1) * FIELD <= d->head; i++) {
		char name[NAME + 1] = "";
		int rc = io_read_at(d->fd, f, sizeof f, HEAD + i * FIELD, l->path, err);

		if (rc)
			return rc;
		if (f[0] == 0x0d)
			break;
		memcpy(name, f, NAME);
		if (is_field(l->kind_field, name)) {
			d->field_at = at;
			d->field_size = f[16];
			return at + d->field_size > d->row_size ? damaged(err, "has a field beyond its rows") : 0;
		}
		if (n < sizeof names)
			n += (size_t)snprintf(names + n, sizeof names - n, "%s%s", n ? ", " : "", name);
		at += f[16];
	}
	return no_field(l, names, err);
}

int lines_dbf_open(struct lines *l, int fd, struct lines_dbf *ret, struct err *err)
{
	struct lines_dbf d = {.fd = fd};
	uint8_t head[HEAD];
	int rc;

	*ret = d;
	if (fd < 0 && l->has_kind_field) {
		err_set(err, ERR_INPUT, "it has no table (.dbf), so no field \"%s\"", l->kind_field);
		return err_add_hint(err, "put the .dbf beside it, or leave out --kind-field");
	}
	if (fd < 0)
		return 0;
	rc = io_read_at(fd, head, sizeof head, 0, l->path, err);
	if (rc == -ERR_TRUNCATED) {
		err_clear(err);
		return damaged(err, "is cut");
	}
	if (rc)
		return rc;
	d.rows = u32(head + 4);
	d.head = u16(head + 8);
	d.row_size = u16(head + 10);
	if (d.head <= HEAD || !d.row_size)
		return damaged(err, "has no fields");
	rc = l->has_kind_field ? find_field(l, &d, err) : 0;
	if (!rc)
		*ret = d;
	return rc;
}

int lines_dbf_row(struct lines *l, struct lines_dbf *d, uint64_t i, bool *ret_deleted, struct err *err)
{
	uint8_t flag, text[256];
	uint64_t at = d->head + i * d->row_size;
	int rc;

	*ret_deleted = false;
	if (d->fd < 0)
		return 0;
	if (i >= d->rows)
		return damaged(err, "has fewer rows than there are shapes");
	rc = io_read_at(d->fd, &flag, 1, at, l->path, err);
	if (!rc && d->field_size)
		rc = io_read_at(d->fd, text, d->field_size, at + d->field_at, l->path, err);
	if (rc == -ERR_TRUNCATED) {
		err_clear(err);
		return damaged(err, "is cut");
	}
	if (rc)
		return rc;
	*ret_deleted = flag == '*';
	if (d->field_size)
		lines_kind(l, (const char *)text, d->field_size);
	return 0;
}
