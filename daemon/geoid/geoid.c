/*
 * The store of geoid grids (geoid.h).
 *
 * The model: a folder in the state folder, with two kinds of files. HASH.pgm is a grid, named by the XXH3-128 of its bytes.
 * NAME.geoid is a short text that names a grid and describes it. Both appear by rename, the grid first: so a name always has its
 * grid, and a grid without a name is a leftover, which the next start removes. The client's file is copied first, and the copy is
 * checked (geoid_ask.c): so nobody can change a grid between check and use.
 */
#include "geoid_priv.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "io.h"

static const char ending[] = ".geoid";

/* ---- names and texts ---- */

void geoids_file(const char *name, char ret[DATASET_NAME_MAX + 8])
{
	snprintf(ret, DATASET_NAME_MAX + 8, "%.*s%s", DATASET_NAME_MAX, name, ending);
}

int geoids_check_name(const char *name, struct err *err)
{
	if (dataset_name_valid(name))
		return 0;
	err_set(err, ERR_USAGE, "\"%.80s\" cannot name a geoid grid", name);
	return err_add_hint(err, "use up to %d letters, digits, '_', '-' and '.', not starting with '.' or '-'",
			    DATASET_NAME_MAX);
}

size_t geoids_write(const struct geoid_info *g, char text[GEOIDS_TEXT_MOST])
{
	const struct crs_geoid_info *i = &g->grid;

	return (size_t)snprintf(text, GEOIDS_TEXT_MOST,
				"acut-geoid 1\nhash %s\nuid %u\nsize %u %u %llu\nheights %.17g %.17g\nerrors %.17g %.17g\n"
				"date %s\ndescription %s\n",
				g->hash, g->uid, i->width, i->height, (unsigned long long)i->bytes, i->min, i->max, i->rms_error,
				i->max_error, i->date, i->description);
}

static bool read_text(const char *text, struct geoid_info *ret)
{
	struct crs_geoid_info *i = &ret->grid;
	unsigned long long bytes;
	int at = 0;

	if (sscanf(text, "acut-geoid 1\nhash %32[0-9a-f]\nuid %u\nsize %u %u %llu\nheights %lg %lg\nerrors %lg %lg\ndate%n",
		   ret->hash, &ret->uid, &i->width, &i->height, &bytes, &i->min, &i->max, &i->rms_error, &i->max_error,
		   &at) != 9 ||
	    !at || !digest_parse(ret->hash, &i->hash))
		return false;
	i->bytes = bytes;
	*i->date = *i->description = 0;
	sscanf(text + at, " %63[^\n]", i->date);
	text = strstr(text + at, "\ndescription ");
	return text && sscanf(text, "\ndescription %127[^\n]", i->description) >= -1;
}

int geoids_read(int dirfd, const char *name, struct geoid_info *ret, struct err *err)
{
	char file[DATASET_NAME_MAX + 8], text[GEOIDS_TEXT_MOST];
	size_t n = 0;
	int fd, r = 0;

	geoids_file(name, file);
	if (io->faccessat(dirfd, file, F_OK, 0) && errno == ENOENT) {
		err_set(err, ERR_NOTFOUND, "there is no geoid grid %s", name);
		return err_add_hint(err, "acutctl geoid add FILE --name %s keeps one; acutctl geoid list shows them", name);
	}
	r = io_open(dirfd, file, O_RDONLY, 0, &fd, err);
	if (r)
		return r;
	r = io_read_some(fd, text, sizeof text - 1, 0, file, &n, err);
	io_close(fd);
	if (r)
		return r;
	text[n] = 0;
	memset(ret, 0, sizeof *ret);
	snprintf(ret->name, sizeof ret->name, "%s", name);
	if (read_text(text, ret))
		return 0;
	err_set(err, ERR_CORRUPT, "the description of the geoid grid %s is damaged", name);
	return err_add_file(err, file);
}

struct name_visitor {
	int (*each)(const char *name, void *ctx, struct err *err);
	void *ctx;
};

static int visit_entry(void *ctx, const struct dirent *e, struct err *err)
{
	const struct name_visitor *visitor = ctx;
	size_t n = strlen(e->d_name), end = sizeof ending - 1;
	char name[DATASET_NAME_MAX + 1];

	if (n <= end || n - end > DATASET_NAME_MAX || strcmp(e->d_name + n - end, ending))
		return 0;
	snprintf(name, sizeof name, "%.*s", (int)(n - end), e->d_name);
	return visitor->each(name, visitor->ctx, err);
}

int geoids_each(int dirfd, int (*each)(const char *name, void *ctx, struct err *err), void *ctx, struct err *err)
{
	struct name_visitor visitor = {each, ctx};

	return io_list(dirfd, ".", visit_entry, &visitor, err);
}

struct health {
	int dirfd;
	unsigned n, bad;
	struct err first;
};

static int check_grid(const char *name, void *ctx, struct err *err)
{
	struct health *h = ctx;
	char grid[DIGEST_HEX_SIZE + 8];
	struct err why = ERR_INIT;
	struct geoid_info g;
	struct stat st;

	h->n++;
	if (!geoids_read(h->dirfd, name, &g, &why)) {
		snprintf(grid, sizeof grid, "%s.pgm", g.hash);
		if (io->fstatat(h->dirfd, grid, &st, AT_SYMLINK_NOFOLLOW) < 0)
			err_sys(&why, errno, "the grid %s cannot be read", name);
		else if ((uint64_t)st.st_size != g.grid.bytes)
			err_set(&why, ERR_CORRUPT, "the grid %s has %llu bytes, not %llu", name, (unsigned long long)st.st_size,
				(unsigned long long)g.grid.bytes);
	}
	if (why.code && !h->bad++)
		h->first = why;
	return 0;
}

int geoids_check(const struct geoids *g, unsigned *ret_n, unsigned *ret_bad, struct err *err)
{
	struct health h = {.dirfd = g->fd};
	int r = geoids_each(g->fd, check_grid, &h, err);

	if (r)
		return r;
	*ret_n = h.n;
	*ret_bad = h.bad;
	if (h.bad)
		*err = h.first;
	return 0;
}

/* ---- charges to users ---- */

struct charges {
	int dirfd;
	struct charged_grid {
		uint32_t uid;
		char hash[DIGEST_HEX_SIZE];
		uint64_t bytes;
	} grid[GEOIDS_MAX];
	size_t n;
};

/* A user who gave one grid two names is charged once: there is one file. */
static int add_charge(const char *name, void *ctx, struct err *err)
{
	struct charges *s = ctx;
	struct err ignored = ERR_INIT;
	struct geoid_info g;
	size_t i;

	if (s->n == GEOIDS_MAX || geoids_read(s->dirfd, name, &g, &ignored))
		return 0;
	for (i = 0; i < s->n && (s->grid[i].uid != g.uid || strcmp(s->grid[i].hash, g.hash)); i++)
		;
	if (i < s->n)
		return 0;
	s->grid[i] = (struct charged_grid){.uid = g.uid, .bytes = g.grid.bytes};
	memcpy(s->grid[i].hash, g.hash, sizeof g.hash);
	s->n++;
	return 0;
}

int geoids_charge(struct geoids *g, struct err *err)
{
	struct limit_geoid all[GEOIDS_MAX];
	struct charges s = {.dirfd = g->fd};
	int r = geoids_each(g->fd, add_charge, &s, err);

	for (size_t i = 0; i < s.n; i++)
		all[i] = (struct limit_geoid){.uid = s.grid[i].uid, .bytes = s.grid[i].bytes};
	if (!r)
		limit_geoids(g->core, all, s.n);
	return r;
}

/* ---- names of a grid ---- */

static int count_name(const char *name, void *ctx, struct err *err)
{
	struct geoids_names *u = ctx;
	struct geoid_info g;
	struct err ignored = ERR_INIT;

	u->all++;
	if (!geoids_read(u->dirfd, name, &g, &ignored)) {
		u->n += !strcmp(g.hash, u->hash);
		u->own += g.uid == u->uid;
	}
	return 0;
}

int geoids_count_names(int dirfd, const char *hash, uint32_t uid, struct geoids_names *ret, struct err *err)
{
	*ret = (struct geoids_names){.dirfd = dirfd, .hash = hash, .uid = uid};
	return geoids_each(dirfd, count_name, ret, err);
}

int geoids_find(const struct geoids *g, const char *name, struct geoids_found *ret, struct err *err)
{
	struct geoid_info info;
	int r = geoids_check_name(name, err);

	if (!r)
		r = geoids_read(g->fd, name, &info, err);
	if (r)
		return r;
	snprintf(ret->path, sizeof ret->path, "/proc/self/fd/%d/%s.pgm", g->fd, info.hash);
	memcpy(ret->hash, info.hash, sizeof ret->hash);
	return 0;
}

/* ---- start ---- */

static bool is_grid(const char *name, char hash[DIGEST_HEX_SIZE])
{
	struct digest d;

	if (strlen(name) != DIGEST_HEX_SIZE - 1 + 4 || strcmp(name + DIGEST_HEX_SIZE - 1, ".pgm"))
		return false;
	memcpy(hash, name, DIGEST_HEX_SIZE - 1);
	hash[DIGEST_HEX_SIZE - 1] = 0;
	return digest_parse(hash, &d);
}

static int remove_leftover(void *ctx, const struct dirent *e, struct err *err)
{
	int dirfd = *(int *)ctx;
	size_t n = strlen(e->d_name);
	char hash[DIGEST_HEX_SIZE];
	struct geoids_names names;
	struct err ignored = ERR_INIT; /* the file stays until the next start */
	bool leftover = n > 4 && !strcmp(e->d_name + n - 4, ".tmp");

	if (!leftover && is_grid(e->d_name, hash))
		leftover = !geoids_count_names(dirfd, hash, 0, &names, &ignored) && !names.n;
	if (leftover)
		io->unlinkat(dirfd, e->d_name, 0);
	return 0;
}

int geoids_new(struct core *core, struct geoids **ret, struct err *err)
{
	struct geoids *g = calloc(1, sizeof *g);
	int r;

	if (!g)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	g->core = core;
	g->fd = -1;
	r = core_folder(core->p.statefd, "geoids", &g->fd, err);
	if (!r)
		r = io_list(g->fd, ".", remove_leftover, &g->fd, err);
	if (!r)
		r = geoids_charge(g, err);
	if (r)
		geoids_free(g);
	else
		*ret = g;
	return r;
}

struct geoids *geoids_free(struct geoids *g)
{
	if (g)
		io_close(g->fd);
	free(g);
	return NULL;
}

uint64_t geoids_changes(const struct geoids *g)
{
	return g->changes;
}
