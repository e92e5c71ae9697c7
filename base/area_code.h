/*
 * Whole numbers as they stand in the corners of an area in the text of a view (PROTOCOL.md, "Views"): few
 * characters for small ones, since corners are given as steps from the one before.
 *
 * v >= 0 is taken as 2v, v < 0 as -2v - 1, and written in groups of five bits, the lowest first; a group that
 * is not the last has 32 added. Groups are the characters A-Z a-z 0-9 _ . in this order.
 */
#ifndef AREA_CODE_H
#define AREA_CODE_H

#include <stdbool.h>
#include <stddef.h>

/* Longest text of a view, its end not counted: with all else it fits a frame of the protocol. */
#define AREA_TEXT_MAX 49152

enum { AREA_CODE_SIZE = 26 }; /* characters of the longest number */

/* Numbers within this of zero have a code. */
#define AREA_CODE_MOST ((__int128)1000000000000000000 * 1000000000000000000)

/* Writes the code, without an end; returns its length. */
size_t area_code_put(__int128 v, char buf[AREA_CODE_SIZE]);
/* Takes the number at *text, which moves behind it. False: none stands before `end`, or not as area_code_put
 * writes it. */
bool area_code_take(const char **text, const char *end, __int128 *ret);

#endif
