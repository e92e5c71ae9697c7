/* One domain step by step, with the CPU time of each. */
#ifndef ENGINE_DOMAIN_H
#define ENGINE_DOMAIN_H

#include "pipe.h"

enum phase {
	PHASE_READ,  /* blocks of the region's own points: pread, checksums, decoding */
	PHASE_VIEW,  /* judging them, reducing duplicates, into the kernel's input */
	PHASE_HALO,  /* chains of the borders, reading beyond them, merging */
	PHASE_ORDER, /* of insertion */
	PHASE_TRIANGULATE,
	PHASE_OWNED,    /* owner test, digest, packing */
	PHASE_VERTICES, /* marks to local numbers, box, digest of vertices */
	PHASE_NUMBERS,  /* local numbers into triangles, links of open vertices */
	PHASE_EMIT,     /* numbering, table of open vertices, final bits */
	PHASE_ENCODE,   /* frame of the stream and its checksum */
	PHASE_STORE,    /* writing a finished domain */
	PHASE_LOAD,     /* reading it back */
	PHASES
};

struct phases {
	double seconds[PHASES];
	uint64_t bytes_read, records_read; /* from segments, halos included */
	uint64_t cells_read;               /* for halos */
	uint64_t open, vertices;
};

extern const char *const phase_text[PHASES];

double phase_cpu(void);
/* As pipe_domain. `twice`: room to read the region once more, of grid_reader_bytes. */
int phase_domain(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct cut_sites *sites,
		 const struct pipe_budget *budget, void *memory, void *twice, struct phases *sum, struct mesh_domain *ret,
		 uint64_t *ret_need, struct err *err);
/* Into the store and back, before it is emitted; `memory` has room for what is read. */
int phase_store(int dirfd, const struct mesh_domain *d, void *memory, size_t size, struct phases *sum, struct err *err);
int phase_emit(struct pipe_emitter *, struct mesh_domain *, const struct cut_region *, struct phases *sum, struct err *err);

#endif
