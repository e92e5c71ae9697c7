/* The triangles of a block that stay: their corners and flags, in the order of the block. */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outputs_priv.h"

int outputs_passed_begin(struct outputs_passed *k, const struct acut_mesh_block *b, struct err *err)
{
	k->n = 0;
	if (b->ntriangle > k->room) {
		void *triangle = realloc(k->triangle, b->ntriangle * sizeof(*k->triangle)), *flags = NULL;

		if (triangle) {
			k->triangle = triangle;
			flags = realloc(k->flags, b->ntriangle);
		}
		if (!flags)
			return err_set(err, ERR_NOMEM, "no memory for a block of %u triangles", b->ntriangle);
		k->flags = flags;
		k->room = b->ntriangle;
	}
	return 0;
}

void outputs_passed_end(const struct outputs_passed *k, const struct acut_mesh_block *b, struct acut_mesh_block *ret)
{
	*ret = *b;
	ret->triangle = (const uint32_t(*)[3])k->triangle;
	ret->flags = b->flags ? k->flags : NULL;
	ret->ntriangle = k->n;
}

void outputs_passed_free(struct outputs_passed *k)
{
	free(k->triangle);
	free(k->flags);
}
