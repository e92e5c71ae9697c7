/*
 * For io.c: descriptors that background threads close (io_close_background in io.h). Internal.
 */
#ifndef IO_CLOSER_H
#define IO_CLOSER_H

#include <stdbool.h>

bool io_closer(int fd); /* true: it will be closed soon; false: close it now */

#endif
