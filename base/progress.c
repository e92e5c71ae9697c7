/* One listener for each thread. It is called when something was done, never by a clock: a thread that hangs makes no
 * progress. */
#include "progress.h"

#include <stddef.h>

static _Thread_local void (*listener)(void *ctx);
static _Thread_local void *listener_ctx;

void progress_listen(void (*fn)(void *ctx), void *ctx)
{
	listener = fn;
	listener_ctx = ctx;
}

void progress_step(void)
{
	if (listener)
		listener(listener_ctx);
}
