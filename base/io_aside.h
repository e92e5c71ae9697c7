/*
 * For io.c: descriptors that another thread closes (io_close_aside in io.h).
 */
#ifndef IO_ASIDE_H
#define IO_ASIDE_H

#include <stdbool.h>

bool io_aside(int fd); /* it is closed soon; false: close it now */

#endif
