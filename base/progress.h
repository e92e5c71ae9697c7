/* What takes long says that it gets on: who waits for a start learns from it that the start is no hung one. */
#ifndef PROGRESS_H
#define PROGRESS_H

/* For the calling thread; NULL: nobody listens (as at first, and on all other threads). */
void progress_listen(void (*fn)(void *ctx), void *ctx);
/* Another row, file or piece is done. Costs next to nothing. */
void progress_step(void);

#endif
