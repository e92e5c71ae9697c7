/*
 * The kind of the current thread. Data of the event loop have no lock: its functions assert that no helper thread calls
 * them. Workers, the catalogue's thread and closers of files mark themselves; any other thread counts as the loop.
 */
#ifndef THREAD_H
#define THREAD_H

#include <assert.h>
#include <stdbool.h>

void thread_mark_helper(void); /* the calling thread, for its lifetime */
bool thread_is_helper(void);

#define THREAD_LOOP_ONLY() assert(!thread_is_helper())

#endif
