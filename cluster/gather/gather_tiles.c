/*
 * Which tiles are whose: a pure function of the records of the phase mesh, the number of tasks and their memory. The phase sum
 * divides them, and no pack is opened for it.
 *
 * The triangles of a group of domains count for the tile that has the middle of its box. Tiles in the order of their codes are
 * cut into ranges with about as many triangles each. If there are more tiles than fit the memory, those whose codes differ in the
 * lowest bits only count as one.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "gather_priv.h"

struct weight {
	uint64_t code, triangles;
};

struct gather_tiles {
	struct outputs_grid grid;
	struct decimal side;
	struct weight *weight;
	size_t n, room, most;
	unsigned shift;    /* codes are multiples of 2^shift */
	double about;      /* tiles with triangles */
	uint64_t joinable; /* tiles that finish has memory for */
};

/* Memory of a tile: in finish, which holds all of them with their names and sorts them; in a part. */
enum { JOINED = 400, MADE = 192 };

static uint64_t fit(uint64_t memory, uint64_t each)
{
	return memory / each < OUTPUTS_TILES ? OUTPUTS_TILES : memory / each;
}

uint64_t gather_tiles_part(const struct gather_params *p)
{
	return fit(p->memory / 8, MADE);
}

static int lay_out(const struct gather_input *in, struct outputs_grid *ret, struct decimal side, struct err *err)
{
	char scale[DECIMAL_TEXT_SIZE];
	struct acut_mesh_head head = {.scale_xy = decimal_text(in->manifest->lattice.scale_xy, scale)};
	struct stream_head *stream = malloc(sizeof(*stream));
	int r;

	if (!stream)
		return err_set(err, ERR_NOMEM, "no memory for tiles");
	gather_head(in, stream);
	memcpy(head.k, in->manifest->lattice.k, sizeof(head.k));
	memcpy(head.box, stream->box, sizeof(head.box));
	r = outputs_grid_init(ret, side, &head, err);
	free(stream);
	return r;
}

/* Codes have an eighth of what is left of the memory; sorting them takes as much again. */
int gather_tiles_new(const struct gather_input *in, struct gather_tiles **ret, struct err *err)
{
	const struct gather_params *p = in->p;
	const uint64_t used = GATHER_PROCESS + in->held, left = p->memory > used ? p->memory - used : 0;
	struct gather_tiles *t = calloc(1, sizeof(*t));

	if (!t)
		return err_set(err, ERR_NOMEM, "no memory for tiles");
	t->most = left / 8 / sizeof(struct weight) < 1024 ? 1024 : (size_t)(left / 8 / sizeof(struct weight));
	if (!decimal_parse(p->outputs->tile, &t->side) || t->side.mantissa <= 0) {
		free(t);
		return err_set(err, ERR_USAGE, "--tile is not a number above zero: \"%s\"", p->outputs->tile);
	}
	t->joinable = fit(left, JOINED);
	if (lay_out(in, &t->grid, t->side, err)) {
		free(t);
		return -(int)err->code;
	}
	*ret = t;
	return 0;
}

struct gather_tiles *gather_tiles_free(struct gather_tiles *t)
{
	if (t)
		free(t->weight);
	free(t);
	return NULL;
}

static int by_code(const void *a, const void *b)
{
	const struct weight *x = a, *y = b;

	return x->code < y->code ? -1 : x->code > y->code;
}

static void merge(struct gather_tiles *t)
{
	size_t n = 0;

	if (t->n)
		qsort(t->weight, t->n, sizeof(*t->weight), by_code);
	for (size_t i = 0; i < t->n; i++) {
		t->weight[i].code = t->weight[i].code >> t->shift << t->shift;
		if (n && t->weight[n - 1].code == t->weight[i].code)
			t->weight[n - 1].triangles += t->weight[i].triangles;
		else
			t->weight[n++] = t->weight[i];
	}
	t->n = n;
}

static int room(struct gather_tiles *t, struct err *err)
{
	if (t->n < t->room)
		return 0;
	if (t->room < t->most) {
		size_t more = t->room ? 2 * t->room : 1024;
		struct weight *w = realloc(t->weight, (more < t->most ? more : t->most) * sizeof(*w));

		if (!w)
			return err_set(err, ERR_NOMEM, "no memory for the tiles of %zu groups", more);
		t->weight = w;
		t->room = more < t->most ? more : t->most;
		return 0;
	}
	merge(t);
	for (; t->n > t->most / 2; merge(t))
		t->shift += 2;
	return 0;
}

/* About how many tiles a group has for itself: its area in tiles, and no more than it has triangles. */
static double tiles_of(const struct gather_tiles *t, const struct mesh_group *g)
{
	const double side = (double)t->grid.p / (double)t->grid.q;

	return fmin((double)g->area / side / side, (double)g->triangles);
}

int gather_tiles_check(const struct gather_tiles *t, struct err *err)
{
	char size[DECIMAL_TEXT_SIZE];

	if (t->about <= (double)t->joinable)
		return 0;
	err_set(err, ERR_USAGE, "the mesh is in about %.0f tiles of %s, and a task has memory to join %llu", t->about,
		decimal_text(t->side, size), (unsigned long long)t->joinable);
	return err_add_hint(err, "give a larger --tile, or tasks more memory (--task-memory)");
}

int gather_tiles_add(struct gather_tiles *t, const struct mesh_group *g, struct err *err)
{
	int32_t middle[2];
	uint32_t at[2];
	int r = g->triangles ? room(t, err) : 0;

	if (r || !g->triangles)
		return r;
	for (int i = 0; i < 2; i++)
		middle[i] = (int32_t)(((int64_t)g->box[i] + g->box[i + 2]) / 2);
	t->about += tiles_of(t, g);
	outputs_grid_at(&t->grid, middle, at);
	t->weight[t->n++] = (struct weight){outputs_tile_code(at[0], at[1]) >> t->shift << t->shift, g->triangles};
	return 0;
}

/* The code from which on tiles are of a task or a later one: a tile goes to the task in whose part of the sum it begins. */
void gather_tiles_divide(struct gather_tiles *t, uint32_t tasks, uint64_t *border)
{
	uint64_t all = 0, sum = 0;
	uint32_t task = 1;

	merge(t);
	for (size_t i = 0; i < t->n; i++)
		all += t->weight[i].triangles;
	border[0] = 0;
	for (size_t i = 0; i < t->n; i++) {
		for (; task < tasks && (unsigned __int128)sum * tasks >= (unsigned __int128)all * task; task++)
			border[task] = t->weight[i].code;
		sum += t->weight[i].triangles;
	}
	for (; task <= tasks; task++)
		border[task] = UINT64_MAX;
}

bool gather_tiles_share(const uint64_t border[2], uint32_t index, bool last, uint64_t triangles, uint64_t ret[2])
{
	ret[0] = border[0];
	ret[1] = last || !border[1] ? border[1] : border[1] - 1;
	if (!triangles)
		return index == 0;
	return last ? ret[0] < UINT64_MAX : ret[0] < border[1];
}

static bool meets(const struct gather_tiles *t, const int32_t first[2], const int32_t last[2], const uint64_t share[2])
{
	uint32_t low[2], high[2];

	outputs_grid_at(&t->grid, first, low);
	outputs_grid_at(&t->grid, last, high);
	return outputs_grid_meets(low, high, share);
}

bool gather_tiles_meets(const struct gather_tiles *t, const struct store_pack_entry *e, const uint64_t share[2])
{
	return e->ntriangle && meets(t, e->box, e->box + 3, share);
}

bool gather_tiles_meets_group(const struct gather_tiles *t, const struct mesh_group *g, const uint64_t share[2])
{
	return g->triangles && meets(t, g->box, g->box + 2, share);
}
