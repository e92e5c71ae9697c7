/* The formats, one row each, from base/input_format.def. */
#include "input_table.h"

const struct input_row input_rows[] = {
#define INPUT_FORMAT(name, title, extensions, folders, help) {#name, title, extensions, &input_##name##_reader},
#include "input_format.def"
#undef INPUT_FORMAT
};

const size_t input_n_rows = sizeof input_rows / sizeof *input_rows;
