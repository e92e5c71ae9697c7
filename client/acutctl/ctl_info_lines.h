/* info of files of lines. */
#ifndef CTL_INFO_LINES_H
#define CTL_INFO_LINES_H

#include "ctl.h"

/* A file that is one of lines by its content, or that is to be one: --lines, --layer, --kind-field. */
bool ctl_info_is_lines(const struct program *, const struct ctl_input *);
/* Says of a text that is read as points that it may be lines. */
void ctl_info_may_be_lines(struct program *, const struct ctl_input *);
/* Prints what is in it; exit status. */
int ctl_info_lines(struct program *, const struct ctl_input *);

#endif
