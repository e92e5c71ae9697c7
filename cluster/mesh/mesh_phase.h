/*
 * The phases plan and mesh: the dataset of a run becomes finished domains, in packs (cluster.md, "Plan and mesh").
 *
 * The plan divides the plane into top leaves, and these into ranges, one for each task of the phase mesh. A task halves its
 * leaves down to the load and makes their domains, in order, in one arena. The domains are those that acutd makes of the same
 * dataset, wherever its memory allows the same load.
 *
 * Each function is one task from beginning to end: it begins an attempt and publishes its record. 0: the task has its record,
 * from this attempt or from another. A failure is recorded (work_fail) before it is returned; -ERR_CANCELLED is not.
 */
#ifndef MESH_PHASE_H
#define MESH_PHASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mesh.h"
#include "work.h"

struct ctl_view_options;
struct err;
struct store_pack_entry;

struct mesh_phase_params {
	const char *view;        /* the request, ctl_view_text; "": all points */
	uint64_t memory;         /* of a task, besides the program itself; the same for both phases of a run */
	uint32_t load, cap, top; /* 0: by the memory and the points; tests set smaller ones for the phase plan */
};

/* When a command is submitted: refuses by name a view that no run of a cluster makes (-ERR_UNSUPPORTED). */
int mesh_phase_check(const struct ctl_view_options *, struct err *err);
/* Memory of the smallest task. */
uint64_t mesh_phase_least_bytes(void);

int mesh_phase_plan(struct work *, const struct mesh_phase_params *, struct err *err);
int mesh_phase_mesh(struct work *, uint32_t task, const struct mesh_phase_params *, struct err *err);

/* ---- for later phases ---- */

/* The plan, as far as it concerns them. */
struct mesh_plan_about {
	char *view;               /* canonical text */
	uint32_t load, cap;       /* as of struct pipe_budget */
	uint32_t tasks;           /* of the phase mesh */
	bool flat;                /* fewer than three positions, or all collinear: domains have no triangles */
	struct mesh_counts empty; /* of a mesh without domains: what the view removed (pipe_emit_empty) */
	struct digest of;         /* packs of this plan have it (struct store_pack) */
};
/* Waits for the record of the plan. *ret is freed with mesh_plan_about_done. */
int mesh_plan_about(const struct work *, struct mesh_plan_about *ret, struct err *err);
void mesh_plan_about_done(struct mesh_plan_about *);

/* What a task of the phase mesh has made, or several: sums over domains. */
struct mesh_sums {
	uint64_t domains, vertices, triangles, hull, bytes; /* vertices: positions of the regions; bytes: of packs */
	struct mesh_counts counts;
	struct digest digest, vertex_digest;
};
void mesh_sums_add(struct mesh_sums *, const struct mesh_sums *);
/* As values of a record. */
int mesh_sums_record(struct work_attempt *, const struct mesh_sums *, struct err *err);
int mesh_sums_read(const struct work_record *, struct mesh_sums *ret, struct err *err);

/* Where the domains of a pack are: groups of `each` domains, in the order of the pack; the last one may have fewer. */
enum { MESH_GROUPS = 64 };
struct mesh_group {
	uint64_t vertices, triangles; /* vertices: positions of the regions */
	uint64_t area;                /* of the parts of regions that have triangles, at most, in squares of the lattice */
	int32_t box[4];               /* x0 y0 x1 y1 of domains with triangles */
	int32_t region[4];            /* of the positions that the regions hold, likewise */
};
struct mesh_extent {
	uint64_t domains, each;
	uint64_t largest; /* store_pack_memory of the largest domain */
	int32_t box[6];   /* of all vertices: mesh_box_begin if there are none */
	uint32_t n;
	struct mesh_group group[MESH_GROUPS];
};
void mesh_extent_begin(struct mesh_extent *);
void mesh_extent_add(struct mesh_extent *, const struct store_pack_entry *); /* in the order of the pack */
/* Adds a group to a sum, which begins as mesh_group_none. */
struct mesh_group mesh_group_none(void);
void mesh_group_add(struct mesh_group *to, const struct mesh_group *);
bool mesh_extent_same(const struct mesh_extent *, const struct mesh_extent *);
/* `largest` and `box` as values of a record. */
int mesh_extent_record(struct work_attempt *, const struct mesh_extent *, struct err *err);
int mesh_extent_read(const struct work_record *, struct mesh_extent *ret, struct err *err);
/* A box of nothing, to which others are added. */
void mesh_box_begin(int32_t box[6]);
void mesh_box_add(int32_t box[6], const int32_t more[6]);

/* The record of a task of the phase mesh, which is waited for, and its pack ("": it has none, because its regions have no domain
 * or no task was left for it). */
struct mesh_task {
	struct mesh_sums sums;
	struct mesh_extent extent;
	char pack[WORK_NAME];
	uint64_t bytes; /* of the pack */
};
int mesh_task_about(const struct work *, uint32_t task, struct mesh_task *ret, struct err *err);

#endif
