/* What an area consists of (area.c). */
#ifndef AREA_PRIV_H
#define AREA_PRIV_H

#include "area.h"

/* Rings, by their first item; the nodes of their tree by the first box. */
struct area_set {
	size_t item, n, box;
};

struct area_ring {
	size_t first, n; /* corners */
	size_t box;      /* nodes of its chain */
	struct area_set holes;
	bool shell;
};

struct area_item {
	uint64_t key;
	size_t ring;
};

struct area {
	enum area_border border;
	struct area_ring *ring;
	int64_t (*corner)[2];
	size_t nring, rings_room, ncorner, corners_room;
	int64_t (*box)[4];
	size_t nbox, boxes_room;
	struct area_item *item;
	struct area_set polygons;
	int64_t bounds[4];
};

#endif
