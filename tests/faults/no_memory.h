/* Allocations of the process that are counted, and of which one fails (no_memory.c). */
#ifndef NO_MEMORY_H
#define NO_MEMORY_H

#include <stdatomic.h>
#include <stdint.h>

struct no_memory {
	_Atomic uint64_t at;            /* the allocation that fails; 0: none, and nothing is counted */
	_Atomic uint64_t count, failed; /* since `at` was written; whoever writes it clears these first */
};
extern struct no_memory *no_memory;

#endif
