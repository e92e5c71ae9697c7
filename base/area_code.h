/*
 * The code of whole numbers in areas, in the text of a view (protocol.md, "Views"). Small numbers take few characters,
 * because corners are given as differences.
 *
 * v >= 0 is coded as 2v, v < 0 as -2v - 1, in groups of five bits, the lowest first. A group that is not the last has
 * 32 added. Groups are the characters A-Z a-z 0-9 _ . in this order.
 */
#ifndef AREA_CODE_H
#define AREA_CODE_H

#include <stdbool.h>
#include <stddef.h>

/* Longest text of a view, without the terminating zero: with everything else it fits a frame of the protocol. */
#define AREA_TEXT_MAX 49152

enum { AREA_CODE_SIZE = 26 }; /* characters of the longest number */

/* Numbers within this of zero can be coded. */
#define AREA_CODE_MOST ((__int128)1000000000000000000 * 1000000000000000000)

/* Writes the code, without a terminating zero; returns its length. */
size_t area_code_put(__int128 v, char buf[AREA_CODE_SIZE]);
/* Reads the number at *text and advances it. False: no number before `end`, or not as area_code_put writes it. */
bool area_code_get(const char **text, const char *end, __int128 *ret);

#endif
