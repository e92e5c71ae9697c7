/* What gather_place.c and gather_corner.c share. Internal to them. */
#ifndef GATHER_PLACE_H
#define GATHER_PLACE_H

#include "cut.h"
#include "gather_priv.h"

enum { PLACE_TABLES = 256, PLACE_PACKS = 32 };

struct place_seat {
	uint64_t place, number;
};
/* What others need of a domain. */
struct place_table {
	const struct gather_place *of;
	size_t n, nextra;
	struct place_seat *seat;   /* by place */
	struct mesh_vertex *extra; /* by place: positions without a triangle of the domain's own */
	uint64_t used;             /* when; 0: the table is free */
};
struct place_opened {
	uint32_t pack;
	struct gather_opened file;
};
/* The groups of a pack, and the domains of those that were needed. */
struct place_groups {
	struct mesh_group group[MESH_GROUPS];
	uint64_t first[MESH_GROUPS], first_triangle[MESH_GROUPS];
	struct gather_place *place[MESH_GROUPS]; /* NULL: not read */
};
struct gather_places {
	const struct gather_input *in;
	struct place_groups **pack; /* by pack; NULL: not read */
	struct place_table table[PLACE_TABLES];
	const struct gather_place *last; /* which held the last corner */
	uint64_t clock, held, most;      /* held: bytes of groups, domains and tables */
	struct place_opened opened[PLACE_PACKS];
	unsigned next;
	void *front;
	size_t front_bytes;
	struct gather_place_counts counts;
};

/* The groups of a pack; the domains of group k of a pack, and how many these are. All stay in memory. */
int place_groups(struct gather_places *, uint32_t pack, struct place_groups **ret, struct err *err);
int place_group(struct gather_places *, uint32_t pack, uint32_t k, const struct gather_place **ret, struct err *err);
uint32_t place_group_size(const struct gather_pack *, uint32_t k);
/* Links and open vertices of a domain; valid until the next one. */
int place_front(struct gather_places *, const struct gather_place *, struct mesh_domain *ret, struct err *err);
void place_table_drop(struct gather_places *, struct place_table *);
struct place_table *place_table_oldest(struct gather_places *); /* NULL: there is none */

#endif
