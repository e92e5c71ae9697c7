/* Positions of the vertices that later blocks may still use (outputs_front.c). A zeroed one is empty. */
#ifndef OUTPUTS_FRONT_H
#define OUTPUTS_FRONT_H

#include <stddef.h>
#include <stdint.h>

struct acut_mesh_block;
struct cursor;
struct err;
struct packer;

struct outputs_front {
	struct outputs_front_slot {
		uint64_t number;
		int32_t at[3];
		uint32_t used;
	} * slot;
	size_t size, used;      /* size a power of two */
	int32_t (*position)[3]; /* of the current block, unless it has room for them */
	size_t room;
};
/* Positions of all local vertices of the block; afterwards the table holds what later blocks may use. */
int outputs_front_block(struct outputs_front *, const struct acut_mesh_block *, const int32_t (**ret)[3], struct err *err);
void outputs_front_done(struct outputs_front *);
enum { OUTPUTS_FRONT_SAVED = 20 }; /* bytes a vertex, and 8 */
void outputs_front_save(const struct outputs_front *, struct packer *);
/* Into an empty one. -ERR_NOMEM; the cursor is bad where it is damaged. */
int outputs_front_load(struct outputs_front *, struct cursor *, struct err *err);

#endif
