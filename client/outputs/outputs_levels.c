/*
 * --levels: a folder with the page and tiles of its mesh at several levels of detail.
 *
 * The tiles are the room client/levels; here is what is around them: the folder, which has all of it or what it had before, and
 * index.html, which is made last and takes its place last. It depends on the triangles alone, neither on the order of the stream
 * nor on the domains, which it does not keep.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format_html.h"
#include "levels.h"
#include "outputs_priv.h"
#include "page.h"

struct outputs_levels {
	struct format_options opt;
	struct outfile_folder *place;
	struct outfile *index;
	struct levels *levels;
	char name[300];
	char *facts;
	struct outputs_tail tail;
	uint64_t triangles;
};

static int check(const char *dir, const struct format *format, const struct format_options *opt, struct err *err)
{
	if (!dir || strcmp(format->name, "html"))
		return err_set(err, ERR_USAGE, "--levels has no meaning for %s: it makes a page, html", format->name);
	if (!strcmp(dir, "-")) {
		err_set(err, ERR_USAGE, "levels of detail are files in a folder and cannot go to standard output");
		return err_add_hint(err, "give a folder, as in -o survey/");
	}
	if (format_extension(dir) && format_has_extension(format->extensions, format_extension(dir))) {
		err_set(err, ERR_USAGE, "with --levels the output is a folder, and this is the name of a page");
		return err_add_hint(err, "give a folder, as in -o survey/");
	}
	if (opt->sidecar) {
		err_set(err, ERR_USAGE, "--sidecar has no meaning with --levels");
		return err_add_hint(err, OUTPUTS_LEVELS_INDEX " says what the folder has");
	}
	return 0;
}

/* The name of the folder, as far as the path has one. */
static void name_of(const char *dir, char *name, size_t size)
{
	size_t n = strlen(dir), from;

	while (n && dir[n - 1] == '/')
		n--;
	for (from = n; from && dir[from - 1] != '/'; from--)
		;
	snprintf(name, size, "%.*s", (int)(n - from), dir + from);
	if (!name[0] || !strcmp(name, ".") || !strcmp(name, ".."))
		snprintf(name, size, "mesh");
}

int outputs_levels_new(const char *dir, const struct format *format, const struct format_options *opt,
		       const struct outputs_options *run, struct outputs_levels **ret, struct err *err)
{
	struct levels_options own = {.interrupted = opt->interrupted, .ctx = opt->ctx};
	int r = check(dir, format, opt, err);
	struct outputs_levels *t = r ? NULL : calloc(1, sizeof(*t));

	if (!t)
		return r ? r : err_set(err, ERR_NOMEM, "no memory for tiles");
	t->opt = *opt;
	name_of(dir, t->name, sizeof(t->name));
	r = outfile_folder_hold(dir, OUTPUTS_LEVELS_INDEX, opt->no_clobber, run->part, false, &t->place, err);
	if (!r)
		r = outfile_folder_file(t->place, OUTPUTS_LEVELS_INDEX, &t->index, err);
	own.folder = t->place;
	own.beside = t->index;
	if (!r)
		r = levels_new(&own, &t->levels, err);
	if (r) {
		outputs_levels_free(t);
		return r;
	}
	*ret = t;
	return 0;
}

struct outputs_levels *outputs_levels_free(struct outputs_levels *t)
{
	if (!t)
		return NULL;
	levels_free(t->levels);
	outfile_free(t->index);
	outfile_folder_free(t->place);
	free(t->facts);
	free(t);
	return NULL;
}

const struct outfile *outputs_levels_beside(const struct outputs_levels *t)
{
	return t->index;
}

int outputs_levels_head(struct outputs_levels *t, const struct acut_mesh_head *head, struct err *err)
{
	int r = levels_box(t->levels, head->box, head->box + 3, err);

	return r ? r : format_html_facts(t->name, head, &t->opt, &t->facts, err);
}

int outputs_levels_block(struct outputs_levels *t, const struct format_block *block, struct err *err)
{
	const struct acut_mesh_block *b = block->mesh;
	int r = 0;

	for (uint32_t i = 0; i < b->ntriangle && !r; i++) {
		const int32_t *corner[3];

		for (int j = 0; j < 3; j++)
			corner[j] = block->position[b->triangle[i][j]];
		r = levels_triangle(t->levels, corner, err);
	}
	t->triangles += b->ntriangle;
	return r;
}

void outputs_levels_tail(struct outputs_levels *t, const struct acut_mesh_tail *tail)
{
	outputs_tail_copy(&t->tail, tail);
}

static int put_facts(struct outputs_levels *t, struct err *err)
{
	const uint64_t counts[2] = {t->tail.is.vertices, t->triangles};
	char *text = NULL;
	size_t size = 0;
	FILE *f = open_memstream(&text, &size);
	int r;

	if (f) {
		levels_facts(t->levels, f);
		fputc(',', f);
	}
	r = !f || fclose(f) ? err_set(err, ERR_NOMEM, "no memory for tiles") :
			      format_html_put_facts(t->index, t->facts, text, &t->tail.is, counts, err);
	free(text);
	return r;
}

/* The page, with facts in place of a mesh. It may run scripts that are beside it. */
static int make_index(struct outputs_levels *t, struct err *err)
{
	int r = format_html_title(t->index, "'self' ", t->name, err);

	if (!r)
		r = page_put(t->index, PAGE_UP_TO_FACES, err);
	if (!r)
		r = page_put(t->index, PAGE_UP_TO_FACTS, err);
	if (!r)
		r = put_facts(t, err);
	if (!r)
		r = page_put(t->index, PAGE_UP_TO_END, err);
	return r ? r : outfile_publish(t->index, err);
}

int outputs_levels_publish(struct outputs_levels *t, uint64_t *bytes, struct err *err)
{
	char stamp[17], name[OUTFILE_NAME];
	size_t n;
	int r;

	snprintf(stamp, sizeof(stamp), "%.16s", t->tail.digest);
	r = levels_make(t->levels, stamp, err);
	n = levels_tiles(t->levels);
	if (!r)
		r = make_index(t, err);
	if (!r)
		r = outfile_folder_clear(t->place, n, levels_name, t->levels, err);
	for (size_t i = 0; i < n && !r; i++)
		r = outfile_folder_move(t->place, levels_name(t->levels, i, name), err);
	if (!r)
		r = outfile_folder_sync(t->place, err);
	if (!r)
		r = outfile_folder_move(t->place, OUTPUTS_LEVELS_INDEX, err);
	if (!r)
		r = outfile_folder_sync(t->place, err);
	if (r)
		return r;
	*bytes += levels_bytes(t->levels) + outfile_size(t->index);
	outfile_folder_keep(t->place);
	return 0;
}

uint64_t outputs_levels_count(const struct outputs_levels *t)
{
	return levels_tiles(t->levels);
}

int outputs_levels_moves(struct outputs_levels *t, struct outputs_moves *moves, struct err *err)
{
	return outputs_moves_folder(moves, t->place, levels_tiles(t->levels), levels_name, t->levels, OUTPUTS_LEVELS_INDEX, err);
}
