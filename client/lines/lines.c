/*
 * Files of lines (lines.h): which reader a file has, its layers, and what is the same for all of them. A reader is asked for a
 * feature and builds it with lines_build.c.
 */
#include "lines_priv.h"

#include <fcntl.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "grow.h"
#include "io.h"

/* CSV is the last one, and only tried if it is asked for: any text may be one. */
static const struct lines_reader *const readers[] = {
	&lines_shape_reader, &lines_geojson_reader, &lines_gpkg_reader,
	&lines_dxf_reader,   &lines_landxml_reader, &lines_csv_reader,
};
#define READERS (sizeof readers / sizeof *readers)

static const struct lines_reader *reader_of(const uint8_t *head, size_t n, bool csv)
{
	for (size_t i = 0; i < READERS - !csv; i++)
		if (readers[i]->matches(head, n))
			return readers[i];
	return NULL;
}

/* Without waiting: a pipe or device is no file of lines. */
static int open_file(const char *path, int *ret_fd, uint64_t *ret_size, struct err *err)
{
	struct stat st;
	int fd = -1, rc = 0;

	/* Who opens and closes a pipe disturbs its writer. */
	if (!io->fstatat(AT_FDCWD, path, &st, 0) && !S_ISREG(st.st_mode))
		rc = -1;
	else if (io_open(AT_FDCWD, path, O_RDONLY | O_NONBLOCK | O_NOCTTY, 0, &fd, err))
		return err_add_file(err, path);
	if (rc || io->fstat(fd, &st) || !S_ISREG(st.st_mode)) {
		io_close(fd);
		err_set(err, ERR_INPUT, "it is not a regular file");
		err_add_hint(err, "lines are read from files only, not from pipes or folders");
		return err_add_file(err, path);
	}
	*ret_fd = fd;
	*ret_size = (uint64_t)st.st_size;
	return 0;
}

const char *lines_recognise(const char *path)
{
	const struct lines_reader *reader = NULL;
	struct err err = ERR_INIT;
	uint8_t head[LINES_HEAD];
	uint64_t size;
	size_t n = 0;
	int fd;

	if (open_file(path, &fd, &size, &err))
		return NULL;
	if (!io_read_some(fd, head, sizeof head, 0, path, &n, &err))
		reader = reader_of(head, n, false);
	io_close(fd);
	return reader ? reader->title : NULL;
}

/* The text that acutd takes, docs/formats/lines.md: it has kinds already, and is an input by itself. */
static bool is_text_of_lines(const uint8_t *head, size_t n)
{
	static const char signature[] = "acut-lines ";

	return n >= sizeof signature - 1 && !memcmp(head, signature, sizeof signature - 1);
}

bool lines_may_be(const char *path)
{
	struct err err = ERR_INIT;
	char *head = malloc(LINES_LOOK);
	uint64_t size;
	size_t n = 0;
	int fd = -1;
	bool may = head && !open_file(path, &fd, &size, &err) && !io_read_some(fd, head, LINES_LOOK, 0, path, &n, &err) &&
		   !memchr(head, 0, n) && !is_text_of_lines((const uint8_t *)head, n) &&
		   !reader_of((const uint8_t *)head, n, false) && lines_csv_may_be(head, n, n == size);

	io_close(fd);
	free(head);
	return may;
}

static int take_option(const char *text, const char *what, char ret[LINES_NAME_SIZE], bool *ret_has, struct err *err)
{
	*ret_has = text;
	if (!text)
		return 0;
	if (!*text || strlen(text) >= LINES_NAME_SIZE)
		return err_set(err, ERR_USAGE, "the name of a %s has 1 to %d bytes", what, LINES_NAME_SIZE - 1);
	strcpy(ret, text);
	return 0;
}

static int unknown(const struct lines *l, struct err *err)
{
	err_set(err, ERR_INPUT, "it is no file of lines that acut reads");
	err_add_hint(
		err,
		"these are Shapefile, GeoJSON, GeoPackage, DXF, LandXML, and CSV where it is asked for; ogr2ogr converts others");
	return err_add_file(err, l->path);
}

static int text_of_lines(const struct lines *l, struct err *err)
{
	err_set(err, ERR_INPUT, "it is a text of lines (acut-lines), which says itself what its lines are");
	err_add_hint(err, "give it as an input beside the points, or to push, without an option of lines");
	return err_add_file(err, l->path);
}

static int open_it(struct lines *l, const char *path, const struct lines_options *opt, struct err *err)
{
	uint8_t head[LINES_HEAD];
	size_t n = 0;
	int rc;

	if (strlen(path) >= sizeof l->path)
		return err_set(err, ERR_USAGE, "the name of a file has more than %zu bytes", sizeof l->path - 1);
	strcpy(l->path, path);
	l->interrupted = opt->interrupted;
	l->ctx = opt->ctx;
	rc = take_option(opt->layer, "layer", l->layer_name, &l->has_layer, err);
	if (!rc)
		rc = take_option(opt->kind_field, "field", l->kind_field, &l->has_kind_field, err);
	if (!rc)
		rc = open_file(path, &l->fd, &l->size, err);
	if (!rc)
		rc = io_read_some(l->fd, head, sizeof head, 0, path, &n, err);
	if (rc)
		return rc;
	if (is_text_of_lines(head, n))
		return text_of_lines(l, err);
	l->reader = reader_of(head, n, opt->csv);
	if (!l->reader)
		return unknown(l, err);
	l->info.format = l->reader->name;
	l->info.title = l->reader->title;
	l->info.place = l->reader->place;
	rc = l->reader->open(l, err);
	return rc ? err_add_file(err, l->path) : 0;
}

int lines_open(const char *path, const struct lines_options *opt, struct lines **ret, struct err *err)
{
	struct lines *l = calloc(1, sizeof *l);
	int rc;

	if (!l)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	l->fd = -1;
	rc = open_it(l, path, opt, err);
	if (rc) {
		lines_close(l);
		return rc;
	}
	*ret = l;
	return 0;
}

const struct lines_info *lines_info(const struct lines *l)
{
	return &l->info;
}

struct lines *lines_close(struct lines *l)
{
	if (!l)
		return NULL;
	if (l->reader)
		l->reader->close(l);
	for (size_t i = 0; i < l->nlayers; i++)
		free(l->layer[i]);
	free(l->layer);
	free(l->part);
	free(l->vertex);
	io_close(l->fd);
	free(l);
	return NULL;
}

void lines_free_state(struct lines *l)
{
	free(l->state);
}

/* ---- layers ---- */

uint32_t lines_hash(const char *name)
{
	uint32_t h = 2166136261u; /* FNV-1a */

	for (size_t i = 0; name[i] && i < LINES_NAME_SIZE - 1; i++)
		h = (h ^ (uint8_t)name[i]) * 16777619u;
	return h;
}

int lines_too_many_layers(struct err *err)
{
	err_set(err, ERR_LIMIT, "it has more than %d layers", LINES_LAYERS_MOST);
	return err_add_hint(err, "copy those that are wanted into a file of their own (ogr2ogr)");
}

int lines_layer(struct lines *l, const char *name, struct lines_layer **ret, struct err *err)
{
	uint32_t hash = lines_hash(name);
	struct lines_layer *new;

	for (size_t i = l->nlayers; i > 0; i--)
		if (l->layer_hash[i - 1] == hash && !strncmp(l->layer[i - 1]->name, name, LINES_NAME_SIZE - 1)) {
			*ret = l->layer[i - 1];
			return 0;
		}
	if (l->nlayers == LINES_LAYERS_MOST)
		return lines_too_many_layers(err);
	if (!grow(&l->layer, &l->layers_room, l->nlayers + 1, 16, sizeof(*l->layer)))
		return err_set(err, ERR_NOMEM, "no memory for layers");
	new = calloc(1, sizeof *new);
	if (!new)
		return err_set(err, ERR_NOMEM, "no memory for layers");
	snprintf(new->name, sizeof new->name, "%s", name);
	new->index = (unsigned)l->nlayers;
	new->selected = !l->has_layer || !strcasecmp(l->layer_name, new->name);
	new->crs.wkt = new->crs.from = "";
	l->layer_hash[l->nlayers] = hash;
	l->layer[l->nlayers++] = *ret = new;
	return 0;
}

void lines_stem(const struct lines *l, char ret[LINES_NAME_SIZE])
{
	const char *slash = strrchr(l->path, '/'), *name = slash ? slash + 1 : l->path, *dot = strrchr(name, '.');
	size_t n = dot && dot > name ? (size_t)(dot - name) : strlen(name);

	lines_utf8(name, n, ret, LINES_NAME_SIZE);
}

/* There was no feature of the layer that is asked for: its names are in the hint, as many as fit. */
static int no_such_layer(const struct lines *l, struct err *err)
{
	char names[sizeof err->hint - 64];
	size_t n = 0;

	for (size_t i = 0; i < l->nlayers; i++)
		if (l->layer[i]->selected)
			return 0;
	for (size_t i = 0; i < l->nlayers && n < sizeof names; i++)
		n += (size_t)snprintf(names + n, sizeof names - n, "%s%s", n ? ", " : "", l->layer[i]->name);
	err_set(err, ERR_INPUT, "it has no layer \"%s\"", l->layer_name);
	err_add_hint(err, n ? "its layers: %s" : "it has no layers at all%s", n ? names : "");
	return err_add_file(err, l->path);
}

/* ---- features ---- */

int lines_next(struct lines *l, const struct lines_feature **ret, struct err *err)
{
	bool more = false;
	int rc;

	if (l->failed)
		return err_set(err, ERR_INPUT, "its reading has failed before");
	do
		if (!(rc = lines_interrupted(l, err)) && !l->ended)
			rc = l->reader->next(l, &more, err);
	while (!rc && more && !l->f.layer->selected);
	if (!rc && !more && !l->ended) {
		l->ended = true;
		rc = l->has_layer ? no_such_layer(l, err) : 0;
	}
	if (rc) {
		l->failed = true;
		return err_add_file(err, l->path);
	}
	*ret = more ? &l->f : NULL;
	return 0;
}

int lines_interrupted(const struct lines *l, struct err *err)
{
	return l->interrupted && l->interrupted(l->ctx) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

int lines_bad(const struct lines *l, struct err *err, uint64_t place, const char *fmt, ...)
{
	char text[sizeof err->message], where[48];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	snprintf(where, sizeof where, "%s %" PRIu64, l->reader->place, place);
	err_set(err, ERR_INPUT, "%s", text);
	err_add_hint(err, "the file is damaged, or no %s; write it again", l->reader->title);
	return err_add_place(err, ERR_NO_OFFSET, where);
}

int lines_refusal(const struct lines *l, const struct lines_feature *f, struct err *err)
{
	char where[sizeof err->field];

	snprintf(where, sizeof where, "%s %" PRIu64 ", feature %" PRIu64, l->info.place, f->place, f->number);
	err_set(err, ERR_INPUT, "%s%s%s cannot be used: %s", f->geometry, *f->layer->name ? " of layer " : "", f->layer->name,
		f->why);
	if (f->why == lines_no_z)
		err_add_hint(err, "give its vertices heights before: nothing is draped onto the points");
	else if (f->why == lines_no_name)
		err_add_hint(err, "give each row the name of its line: rows of one name, one after the other, are a line");
	else
		err_add_hint(err,
			     "mend it in the program that wrote it (curves become lines there), or choose layers by --layer");
	err_add_place(err, ERR_NO_OFFSET, where);
	return err_add_file(err, l->path);
}
