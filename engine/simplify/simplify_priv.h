/* What the files of this room share. Internal. */
#ifndef SIMPLIFY_PRIV_H
#define SIMPLIFY_PRIV_H

#include "simplify.h"

int simplify_report_write(int dirfd, const struct simplify_report *, struct err *err);

#endif
