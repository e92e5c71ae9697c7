/*
 * Converts the numbers of a block: lattice numbers to coordinates, local numbers of vertices to those of the mesh. Nothing here
 * talks to a daemon.
 */
#include "acut.h"
#include "decimal.h"

double acut_coordinate(const struct acut_mesh_head *head, int axis, int32_t number)
{
	struct decimal scale = {head->scale_mantissa[axis == 2], head->scale_exponent[axis == 2]};

	return decimal_scaled_double(scale, head->k[axis] + number);
}

char *acut_coordinate_text(const struct acut_mesh_head *head, int axis, int32_t number, char *buf)
{
	struct decimal scale = {head->scale_mantissa[axis == 2], head->scale_exponent[axis == 2]};

	return decimal_scaled_text(scale, head->k[axis] + number, buf);
}

void acut_block_coordinates(const struct acut_mesh_head *head, const struct acut_mesh_block *block, double (*ret)[3])
{
	for (uint32_t i = 0; i < block->nnew; i++)
		for (int axis = 0; axis < 3; axis++)
			ret[i][axis] = acut_coordinate(head, axis, block->vertex[i][axis]);
}

void acut_block_triangles(const struct acut_mesh_block *block, uint64_t (*ret)[3])
{
	for (uint32_t t = 0; t < block->ntriangle; t++)
		for (int k = 0; k < 3; k++) {
			uint32_t n = block->triangle[t][k];

			ret[t][k] = n < block->nforeign ? block->foreign[n] : block->first + (n - block->nforeign);
		}
}
