/* What the files of this room share. */
#ifndef CORE_PRIV_H
#define CORE_PRIV_H

struct core;

void limit_init(struct core *);
void limit_done(struct core *);

#endif
