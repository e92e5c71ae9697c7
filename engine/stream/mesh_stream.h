/* A block of a mesh as one of the stream (stream.md). Whoever writes streams, or feeds what reads them, has it from here. */
#ifndef MESH_STREAM_H
#define MESH_STREAM_H

#include "mesh.h"
#include "stream.h"

/* Arrays are borrowed: nothing is copied. */
struct stream_block mesh_stream_block(const struct mesh_block *);

#endif
