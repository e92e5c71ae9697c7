/* One listener a thread. It is called where something was done, never by a clock: what hangs makes no step. */
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
