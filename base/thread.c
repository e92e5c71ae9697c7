/* A mark for each thread. */
#include "thread.h"

static _Thread_local bool helper;

void thread_mark_helper(void)
{
	helper = true;
}

bool thread_is_helper(void)
{
	return helper;
}
