/* LAS, LAZ and COPC. */
#ifndef INPUT_LAS_H
#define INPUT_LAS_H

#include "input_reader.h"

/* From its first bytes: how many bytes must be there before a LAS file can be read forwards; see input_forward_head. */
enum { INPUT_LAS_LOOK = 227 };
uint64_t input_las_forward_head(const uint8_t *bytes, size_t n);

#endif
