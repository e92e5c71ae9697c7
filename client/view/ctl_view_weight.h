/* The value of --weight. */
#ifndef CTL_VIEW_WEIGHT_H
#define CTL_VIEW_WEIGHT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

struct err;

/* `length`: whether it is a length. NULL: there is no such option. -ERR_USAGE. */
int ctl_view_weight_check(const char *text, bool (*length)(const char *, size_t), struct err *err);
/* The value of the word of a request. */
void ctl_view_weight_put(const char *text, FILE *out);

#endif
