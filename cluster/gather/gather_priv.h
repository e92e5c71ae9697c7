/* What the files of gather share. Internal. */
#ifndef GATHER_PRIV_H
#define GATHER_PRIV_H

#include "cut.h"
#include "err.h"
#include "gather.h"
#include "grid_manifest.h"
#include "mesh_phase.h"
#include "pipe.h"
#include "store_pack.h"
#include "stream.h"
#include "work.h"

/* Names of parts in the names of files: the run, the task, the attempt. */
enum { GATHER_PART = 64 };

/* In place of a task's number: of the phase finish. */
#define GATHER_FINISH UINT32_MAX

/* ---- gather_input.c: what earlier phases made ---- */

/* What is known of a pack without opening it. */
struct gather_pack {
	uint64_t attempt; /* whose its name is; 0: the task had nothing to do */
	uint64_t size;
	uint64_t domains, each;                       /* domains of all groups; of one, but for the last */
	uint64_t first, first_triangle, first_domain; /* vertices, triangles and domains before it */
	uint64_t at;                                  /* of its groups in the sums */
	uint32_t ngroup;
	struct digest hash;    /* of their bytes */
	struct mesh_group all; /* the sum of its groups */
};
struct gather_input {
	const struct gather_params *p;
	struct grid_manifest *manifest;
	struct mesh_plan_about plan;
	struct mesh_sums sums;    /* of all tasks of the phase mesh */
	int32_t box[6];           /* of the vertices; zeros if there are none */
	uint64_t memory;          /* of the largest domain */
	struct gather_pack *pack; /* of the tasks of the phase mesh, in the order of the plan */
	uint32_t npacks;
	uint64_t border[2];    /* of the task's tiles */
	struct ledger *ledger; /* of the manifest */
	uint64_t held;         /* memory of the manifest and of what is known of packs */
	char sum_name[WORK_NAME];
	int sum_fd;
};
/* Reads nothing: room for what is known of packs. */
int gather_input_packs(struct gather_input *, const struct gather_params *, struct err *err);
/* Memory of a task: of the program, and for its own work at least. */
enum { GATHER_PROCESS = 16 << 20, GATHER_LEAST = 4 << 20 };
/* *ret: what is left of it for other things. -ERR_LIMIT: too little. */
int gather_input_needs(const struct gather_input *, uint64_t *ret, struct err *err);
/* Reads the manifest and the plan alone. -ERR_LIMIT: there is too little memory for the manifest and the packs. */
int gather_input_begin(struct gather_input *, const struct gather_params *, struct err *err);
/* The sums, too, with the border of a task's tiles; opens no pack. */
int gather_input_read(struct gather_input *, const struct gather_params *, uint32_t task, struct err *err);
/* Reads the indexes of all packs: they must have what the sums say. */
int gather_input_check(const struct gather_input *, struct err *err);
void gather_input_done(struct gather_input *);

/* ---- gather_sum.c ---- */

/* Memory for what is known of packs. */
uint64_t gather_sum_bytes(uint32_t npacks, uint32_t tasks);
int gather_sum_read(struct gather_input *, uint32_t task, struct err *err);
void gather_pack_name(const struct gather_input *, uint32_t i, char ret[WORK_NAME]);
/* The sums are of the pack that this record of task i of the phase mesh names. */
bool gather_sum_is_of(const struct gather_input *, uint32_t i, const struct work_record *);
/* The groups of pack i. */
int gather_groups(const struct gather_input *, uint32_t i, struct mesh_group ret[MESH_GROUPS], struct err *err);

/* ---- packs ---- */

/* Which domains. A pack is opened if a group is wanted, and of its index only the entries of such groups are read. `group` is
 * also asked of all groups of a pack together. */
struct gather_choice {
	bool (*group)(void *ctx, const struct mesh_group *);
	bool (*domain)(void *ctx, const struct store_pack_entry *);
	void *ctx;
};
/* Calls `each` for the domains of the choice (NULL: all), in the order of the plan, with their packs open. */
typedef int (*gather_domain_fn)(void *ctx, const struct store_pack *, const struct store_pack_entry *, struct err *err);
int gather_walk(const struct gather_input *, const struct gather_choice *, gather_domain_fn each, void *ctx, struct err *err);
struct gather_opened {
	int fd; /* -1: none */
	char name[WORK_NAME];
	struct store_pack of; /* borrows both */
};
/* Opens pack i; ret->fd is the caller's. */
int gather_pack_open(const struct gather_input *, uint32_t i, struct gather_opened *ret, struct err *err);
/* What a stream of acutd says first of the same mesh. `wkt` and `view` are borrowed. */
void gather_head(const struct gather_input *, struct stream_head *ret);
/* What it says last. */
struct stream_tail gather_tail(const struct gather_input *);

/* ---- gather.c ---- */

bool gather_divides_tiles(const struct ctl_fetch_options *);
/* -ERR_LIMIT: an output is one PLY, which cannot have so many vertices. */
int gather_check_ply(const struct ctl_fetch_options *, uint64_t vertices, const char *what, struct err *err);
/* gather_clean.c: gather_clean, but, with `finishing`, not of other attempts at finish: these do once more what was done, and
 * need what they have. */
int gather_sweep(const struct gather_params *, bool finishing, struct err *err);
void gather_part_name(const struct gather_params *, uint32_t index, uint64_t attempt, char buf[GATHER_PART]);

/* gather_finish.c: the list of what a task of gather has made, for outputs_join, to be freed. -ERR_CORRUPT. */
int gather_list_read(const struct gather_params *, const struct work_file *, uint8_t **ret, size_t *ret_size, struct err *err);

/* ---- gather_emit.c ---- */

/* Emits the domains of the choice to the sink, checked. NULL: all; then the mesh must be whole. */
int gather_emit(const struct gather_input *, const struct gather_choice *, const struct acut_mesh_sink *, size_t memory,
		struct pipe_totals *ret, struct err *err);

/* ---- gather_place.c: the number of each vertex in a file that all tasks write ---- */

/* A domain, in the order of the plan. */
struct gather_place {
	struct cut_region region;
	uint32_t pack, entry; /* of the index of that pack */
	uint32_t nvertex, nopen, ntriangle;
	uint64_t own, first, first_triangle; /* positions of the region; how many positions and triangles are before */
	int32_t box[6];
};
struct gather_place_counts {
	uint64_t looked_up; /* corners in regions of other domains */
	uint64_t tables;    /* domains whose open vertices were read for that, again if they were forgotten */
	uint64_t fronts;    /* how often open vertices were read */
	uint64_t found;     /* positions that no triangle of their own domain uses, again likewise */
};
struct gather_places;
/* `memory`: for all that is kept of domains; -ERR_LIMIT later if it does not suffice. The input is borrowed. */
int gather_places_new(const struct gather_input *, uint64_t memory, struct gather_places **ret, struct err *err);
uint64_t gather_places_held(const struct gather_places *); /* of that memory */
struct gather_places *gather_places_free(struct gather_places *);
/* Where the part of a task begins, by the records of vertices and triangles. */
struct gather_border {
	uint64_t domain, first, first_triangle;
};
int gather_places_border(struct gather_places *, uint32_t index, uint32_t tasks, struct gather_border *ret, struct err *err);
/* Calls `each` for the domains that are wanted, in order. `wants` is asked of packs, of groups, and of domains: of `n` from
 * number `domain` on, which have so many vertices and triangles from these numbers on. Places stay valid. */
struct gather_places_choice {
	bool (*wants)(void *ctx, uint64_t domain, uint64_t n, uint64_t first, uint64_t vertices, uint64_t first_triangle,
		      uint64_t triangles);
	void *ctx;
};
typedef int (*gather_place_fn)(void *ctx, uint64_t domain, const struct gather_place *, struct err *err);
int gather_places_walk(struct gather_places *, const struct gather_places_choice *, gather_place_fn each, void *ctx,
		       struct err *err);
/* The pack stays open until others were. */
int gather_place_entry(struct gather_places *, const struct gather_place *, const struct store_pack **ret_pack,
		       struct store_pack_entry *ret, struct err *err);
/* The last positions of the domain's region: those that are not among its vertices. Valid until the next number is asked for. */
int gather_place_extras(struct gather_places *, const struct gather_place *, const struct mesh_vertex **ret, size_t *ret_n,
			struct err *err);
/* Of a corner that its domain's region does not hold. */
int gather_place_number(struct gather_places *, const struct mesh_vertex *, uint64_t *ret, struct err *err);
struct gather_place_counts gather_place_counts(const struct gather_places *);

/* ---- gather_share.c: files that all tasks write ---- */

bool gather_shares(const struct ctl_fetch_options *);
/* The name of the parts; makes the files, with the name `own`, if no attempt has. */
int gather_share_agree(const struct gather_params *, struct work_attempt *, const char *own, char part[GATHER_PART],
		       struct err *err);
/* The same, if it was agreed before; WORK_E_ABSENT. */
int gather_share_agreed(const struct gather_params *, char part[GATHER_PART], struct err *err);
/* Nobody will open the files any more; removes what is left of them. */
int gather_share_forget(const struct gather_params *, const char *part, struct err *err);
/* After -ERR_GONE: what to do if the files were deleted, which no attempt may make again by itself. */
void gather_share_gone(const struct gather_params *, struct err *err);
/* The domains of a task, and its share but for the tail. */
int gather_share_of(struct gather_places *, uint32_t index, uint32_t tasks, uint64_t range[2], struct outputs_share *ret,
		    struct err *err);
uint64_t gather_share_block(const struct gather_params *);
/* Of the domains of a task: what it has written. */
struct gather_share_sums {
	uint64_t domains, vertices, triangles; /* domains: that were read, with those of others */
	uint64_t extra;                        /* positions that no triangle of their own domain uses */
	struct digest digest, vertex_digest;
	struct gather_place_counts place;
};
/* `given_up`: another attempt has done the task. */
int gather_share_write(const struct gather_input *, struct gather_places *, const uint64_t range[2], struct outputs *,
		       int (*given_up)(void *ctx), void *ctx, struct gather_share_sums *ret, struct err *err);

/* ---- gather_tiles.c: which tiles are whose ---- */

struct gather_tiles;
int gather_tiles_new(const struct gather_input *, struct gather_tiles **ret, struct err *err);
int gather_tiles_add(struct gather_tiles *, const struct mesh_group *, struct err *err);
/* After all groups: refuses more tiles, about, than finish has memory for. */
int gather_tiles_check(const struct gather_tiles *, struct err *err);
/* Likewise: the borders of the shares of all tasks, one more than these. */
void gather_tiles_divide(struct gather_tiles *, uint32_t tasks, uint64_t *border);
/* The codes of the tiles of a task, both ends included, by its borders and the triangles of the mesh; false: it has none. */
bool gather_tiles_share(const uint64_t border[2], uint32_t index, bool last, uint64_t triangles, uint64_t ret[2]);
/* The tiles that a part can have, by the memory of a task. */
uint64_t gather_tiles_part(const struct gather_params *);
/* Whether a triangle of the domain, or of one of the group, can be in such a tile. */
bool gather_tiles_meets(const struct gather_tiles *, const struct store_pack_entry *, const uint64_t share[2]);
bool gather_tiles_meets_group(const struct gather_tiles *, const struct mesh_group *, const uint64_t share[2]);
struct gather_tiles *gather_tiles_free(struct gather_tiles *);

#endif
