/* Progress of long work: the service manager waits for the start of the daemon as long as there is progress. */
#ifndef PROGRESS_H
#define PROGRESS_H

/* Sets the listener of the calling thread; NULL: none (as initially, and on all other threads). */
void progress_listen(void (*fn)(void *ctx), void *ctx);
/* Another row, file or piece is done. Costs very little. */
void progress_step(void);

#endif
