/*
 * Outputs that several processes make, each a part of them: files in part, or the tiles of a part of the plane.
 *
 * A part is published under names that are its own (outfile_hold, outfile_folder_hold). What the process that joins must know of
 * it are bytes: the files with their sizes and inodes, the tiles, the triangles that were left out, the statistics of edges. That
 * process gets the head, these bytes and the tail, but no block; it writes the index of tiles and gives all files their names. If
 * it is interrupted, another one does the same again.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "grow.h"
#include "outputs_priv.h"
#include "outputs_tile.h"

#define MAGIC 0x504f4341u /* "ACOP" */
#define VERSION 1u

/* ---- files ---- */

int outputs_moves_add(struct outputs_moves *m, const char *name, const char *part, const struct outfile_held *held,
		      struct err *err)
{
	if (!grow(&m->move, &m->room, m->n + 1, 64, sizeof(*m->move)))
		return err_set(err, ERR_NOMEM, "no memory for %zu outputs", m->n + 1);
	m->move[m->n] = (struct outputs_move){strdup(name), part, *held};
	if (!m->move[m->n].name)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	m->n++;
	return 0;
}

int outputs_moves_folder(struct outputs_moves *m, const struct outfile_folder *place, size_t n,
			 const char *(*name)(void *ctx, size_t i, char *buf), void *ctx, const char *last, struct err *err)
{
	char buf[OUTFILE_NAME];
	struct outfile_held held;
	int r = 0;

	for (size_t i = 0; i < n + (last != NULL) && !r; i++) {
		const char *file = i < n ? name(ctx, i, buf) : last;

		r = outfile_folder_held(place, file, &held, err);
		r = r ? r : outputs_moves_add(m, file, NULL, &held, err);
	}
	return r;
}

int outputs_moves_settle(const struct outputs_moves *m, struct outfile_folder *place, struct err *err)
{
	int r = 0;

	for (size_t i = 0; i < m->n && !r; i++)
		r = outfile_folder_settle(place, m->move[i].part, m->move[i].name, &m->move[i].held, err);
	return r;
}

int outputs_interrupted(const struct outputs_options *run, struct err *err)
{
	return run->interrupted && run->interrupted(run->ctx) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

int outputs_moves_look(const struct outputs_moves *m, const struct outputs_options *run, const struct outfile_folder *place,
		       bool *ret_all, struct err *err)
{
	*ret_all = true;
	for (size_t i = 0; i < m->n; i++) {
		const struct outputs_move *file = &m->move[i];

		if (outfile_folder_has(place, file->name, &file->held))
			continue;
		*ret_all = false;
		/* another attempt may move it between the two looks */
		if (outfile_folder_waits(place, file->part, file->name) || outfile_folder_has(place, file->name, &file->held))
			continue;
		err_set(err, ERR_GONE, "the complete output %s is not there any more", file->name);
		return err_add_file(err, file->name);
	}
	return outputs_interrupted(run, err);
}

int outputs_part_file(struct outputs *run, const struct outfile *out, struct err *err)
{
	struct outfile_held held;
	int r = run->opt.part ? outfile_held(out, &held, err) : 0;

	return r || !run->opt.part ? r : outputs_moves_add(&run->joined.moves, outfile_name(out), run->opt.part, &held, err);
}

void outputs_joined_done(struct outputs_joined *j)
{
	for (size_t i = 0; i < j->moves.n; i++)
		free(j->moves.move[i].name);
	for (size_t i = 0; i < j->nparts; i++)
		free(j->part[i]);
	free(j->moves.move);
	free(j->part);
	free(j->folder);
	memset(j, 0, sizeof(*j));
}

/* ---- a part, as bytes ---- */

/* The lefts that are not of the statistics of edges. */
static const struct outputs_left *left_of(const struct outputs *run, enum outputs_reason reason)
{
	static const struct outputs_left none;
	const struct outputs_left *left = outputs_left_by((struct outputs *)run, reason);

	return left ? left : &none;
}

static void pack(const struct outputs *run, struct packer *p)
{
	const struct outputs_moves *m = &run->joined.moves;
	const struct format_simplified s = outputs_simplified(run);

	packer_u32(p, MAGIC);
	packer_u32(p, VERSION);
	packer_u64(p, run->bytes);
	packer_u64(p, run->levels ? outputs_levels_count(run->levels) : 0);
	packer_u64(p, s.vertices);
	packer_u64(p, s.left_out);
	packer_u32(p, outputs_no_lines(run));
	outputs_edge_save(&run->edge, p);
	for (enum outputs_reason i = 0; i < OUTPUTS_BY_EDGE; i++)
		outputs_left_save(left_of(run, i), p);
	packer_u64(p, m->n);
	for (size_t i = 0; i < m->n; i++) {
		size_t n = strlen(m->move[i].name);

		packer_u64(p, m->move[i].held.size);
		packer_u64(p, m->move[i].held.inode);
		packer_u32(p, (uint32_t)n);
		packer_bytes(p, m->move[i].name, n);
	}
	packer_u8(p, run->tiles != NULL);
	if (run->tiles)
		outputs_tiles_save(run->tiles, p);
}

int outputs_part(const struct outputs *run, uint8_t **ret, size_t *ret_size, struct err *err)
{
	const struct outputs_moves *m = &run->joined.moves;
	size_t room = 1024 + sizeof(run->edge) + (run->tiles ? outputs_tiles_saved(run->tiles) : 0);
	struct packer p;
	uint8_t *bytes;

	for (size_t i = 0; i < m->n; i++)
		room += 20 + strlen(m->move[i].name);
	bytes = malloc(room);
	if (!bytes)
		return err_set(err, ERR_NOMEM, "no memory for the list of outputs");
	p = packer_of(bytes, room);
	pack(run, &p);
	if (p.bad) {
		free(bytes);
		return err_set(err, ERR_INTERNAL, "the list of outputs is longer than its bound");
	}
	*ret = bytes;
	*ret_size = packer_size(&p);
	return 0;
}

/* ---- joining ---- */

static int damaged(struct err *err)
{
	return err_set(err, ERR_CORRUPT, "the list of outputs is damaged");
}

static int load_moves(struct outputs *run, const char *part, struct cursor *c, struct err *err)
{
	uint64_t n = cursor_u64(c);
	char name[4096 + 256];
	int r = 0;

	for (; n && !r; n--) {
		struct outfile_held held = {.size = cursor_u64(c)};
		uint32_t length;
		const uint8_t *text;

		held.inode = cursor_u64(c);
		length = cursor_u32(c);
		text = length < sizeof(name) ? cursor_bytes(c, length) : NULL;
		if (c->bad || !text)
			return damaged(err);
		memcpy(name, text, length);
		name[length] = 0;
		/* a name in a folder stays there */
		if (strlen(name) != length || ((run->opt.tiled || run->opt.levels) && strchr(name, '/')))
			return damaged(err);
		r = outputs_moves_add(&run->joined.moves, name, part, &held, err);
	}
	return r;
}

static char *add_part(struct outputs_joined *j, const char *part, struct err *err)
{
	char **more = realloc(j->part, (j->nparts + 1) * sizeof(*more));

	if (more)
		j->part = more;
	if (!more || !(more[j->nparts] = strdup(part))) {
		err_set(err, ERR_NOMEM, "no memory for a part of the outputs");
		return NULL;
	}
	return more[j->nparts++];
}

/* What comes before the tiles. */
static int load(struct outputs *run, const char *name, struct cursor *c, struct err *err)
{
	struct outputs_joined *j = &run->joined;
	char *part = add_part(j, name, err);
	struct outputs_left left;

	if (!part)
		return -(int)err->code;
	if (cursor_u32(c) != MAGIC)
		return damaged(err);
	if (cursor_u32(c) != VERSION)
		return err_set(err, ERR_VERSION, "the list of outputs was written by another version of acut");
	j->bytes += cursor_u64(c);
	j->tiles += cursor_u64(c);
	j->simplified.vertices += cursor_u64(c);
	j->simplified.left_out += cursor_u64(c);
	j->no_lines |= cursor_u32(c);
	outputs_edge_add(&run->edge, c);
	for (enum outputs_reason i = 0; i < OUTPUTS_BY_EDGE; i++) {
		outputs_left_load(&left, c);
		outputs_left_sum(&j->left[i], &left);
	}
	return load_moves(run, part, c, err);
}

int outputs_join(struct outputs *run, const char *name, const void *bytes, size_t size, struct err *err)
{
	struct cursor c = cursor_of(bytes, size);
	int r = load(run, name, &c, err);

	if (!r && cursor_u8(&c) != (run->tiles != NULL))
		r = damaged(err);
	if (!r && run->tiles)
		r = outputs_tiles_load(run->tiles, &c, err);
	if (!r && (c.bad || cursor_left(&c)))
		r = damaged(err);
	return r;
}

static int take_back(const char *folder, const struct outputs_move *move, struct err *err)
{
	char *path;
	int r;

	if (!folder)
		return outfile_unsettle(move->name, move->part, &move->held, err);
	if (asprintf(&path, "%s/%s", folder, move->name) < 0)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	r = outfile_unsettle(path, move->part, &move->held, err);
	free(path);
	return r;
}

int outputs_part_take_back(const char *folder, const char *part, const void *bytes, size_t size, struct err *err)
{
	struct cursor c = cursor_of(bytes, size);
	struct outputs *run = calloc(1, sizeof(*run));
	int r;

	if (!run)
		return err_set(err, ERR_NOMEM, "no memory for the list of outputs");
	run->opt.tiled = folder != NULL;
	r = load(run, part, &c, err);
	for (size_t i = 0; i < run->joined.moves.n && !r; i++)
		r = take_back(folder, &run->joined.moves.move[i], err);
	outputs_joined_done(&run->joined);
	free(run);
	return r;
}

/* All files, and the index after them. */
static int settle_folder(const struct outputs *run, struct outfile_folder *place, struct err *err)
{
	const struct outputs_moves *m = &run->joined.moves, tiles = {m->move, m->n - 1, m->room};
	const struct outputs_move *index = &m->move[m->n - 1];
	bool all;
	int r = outputs_moves_look(m, &run->opt, place, &all, err);

	if (r || all)
		return r;
	r = outfile_folder_clear(place, 0, NULL, NULL, err);
	if (!r)
		r = outputs_moves_settle(&tiles, place, err);
	if (!r)
		r = outfile_folder_sync(place, err);
	if (!r)
		r = outfile_folder_settle(place, index->part, index->name, &index->held, err);
	return r ? r : outfile_folder_sync(place, err);
}

/* Levels have their index already. */
static int settle_levels(struct outputs *run, struct err *err)
{
	struct outputs_joined *j = &run->joined;
	struct outfile_folder *place;
	int r;

	if (!j->moves.n)
		return 0;
	r = outfile_folder_hold(j->folder, OUTPUTS_LEVELS_INDEX, j->no_clobber, run->opt.part, true, &place, err);
	if (r)
		return r;
	r = settle_folder(run, place, err);
	if (!r)
		outfile_folder_keep(place);
	outfile_folder_free(place);
	return r;
}

/* No triangle may be in no part, or in two. */
static int check_tiles(const struct outputs *run, struct err *err)
{
	const struct outputs_tiles *t = run->tiles;
	char have[DIGEST_HEX_SIZE];
	struct digest sum = {0, 0};

	for (size_t i = 0; i < t->ntile; i++)
		digest_add(&sum, t->tile[i].digest);
	if (t->divides || !strcmp(digest_hex(sum, have), run->written))
		return 0;
	return err_set(err, ERR_DIGEST, "the tiles have the digest %s, but the mesh has %s", have, run->written);
}

int outputs_part_publish(struct outputs *run, struct err *err)
{
	struct outputs_joined *j = &run->joined;
	struct outputs_report report;
	int r = 0;

	run->bytes = run->tiles ? 0 : j->bytes;
	if (run->tiles) {
		r = check_tiles(run, err);
		if (r)
			return r;
		outputs_report(run, &report);
		return outputs_tiles_publish(run->tiles, &run->origin, &report, &run->bytes, err);
	}
	if (run->opt.levels)
		return settle_levels(run, err);
	for (size_t i = 0; i < j->moves.n && !r; i++)
		r = outfile_settle(j->moves.move[i].name, j->moves.move[i].part, &j->moves.move[i].held, j->no_clobber, err);
	return r;
}

void outputs_part_drop(const struct outputs *run)
{
	const struct outputs_joined *j = &run->joined;

	if (run->opt.share_of)
		return; /* others write them, too */
	if (j->folder)
		outfile_folder_drop(j->folder, run->opt.part);
	for (size_t i = 0; i < j->moves.n && !j->folder; i++)
		outfile_held_drop(j->moves.move[i].name, run->opt.part);
}
