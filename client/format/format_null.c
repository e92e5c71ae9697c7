/*
 * Nothing is written: for runs that want the stream read, checked and counted, and no file. Counts, digests and
 * hull come with the report, edges and what --max-edge leaves out from the run, as with every other row.
 */
#include <stdlib.h>

#include "err.h"
#include "format.h"

struct null {
	uint64_t nvertex, nface;
};

static int null_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct null *n = calloc(1, sizeof(*n));

	if (!n)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	*ret = n;
	return 0;
}

static int null_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	return 0;
}

static int null_block(void *writer, const struct format_block *block, struct err *err)
{
	struct null *n = writer;

	n->nvertex += block->mesh->nnew;
	n->nface += block->mesh->ntriangle;
	return 0;
}

/* Triangles may have been left out on the way, none can have been added. */
static int null_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	const struct null *n = writer;

	if (n->nvertex != tail->vertices || n->nface > tail->triangles)
		return err_set(err, ERR_PROTO, "%llu vertices and %llu triangles came, but the daemon has sent %llu and %llu",
			       (unsigned long long)n->nvertex, (unsigned long long)n->nface, (unsigned long long)tail->vertices,
			       (unsigned long long)tail->triangles);
	return 0;
}

static void *null_free(void *writer)
{
	free(writer);
	return NULL;
}

const struct format format_null = {
	.name = "null",
	.extensions = "",
	.help = "nothing is written: the mesh is checked and counted, without -o",
	.purpose = "checks in scripts",
	.kind = FORMAT_NOTHING,
	.open = null_open,
	.head = null_head,
	.block = null_block,
	.finish = null_finish,
	.free = null_free,
};
