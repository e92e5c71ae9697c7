/* Users and groups by name. */
#ifndef CTL_NAMES_H
#define CTL_NAMES_H

#include <stdint.h>

struct err;

enum { CTL_NAME_SIZE = 64 };

/* NULL: that number has no name here. Until the next call. */
const char *ctl_user_name(uint32_t uid);
const char *ctl_group_name(uint32_t gid);
/* The name, or the number, or "-" for no group. Return buf, of CTL_NAME_SIZE bytes. */
char *ctl_user_text(uint32_t uid, char *buf);
char *ctl_group_text(uint32_t gid, char *buf);
/* By name or number. -ERR_USAGE. */
int ctl_user_find(const char *text, uint32_t *ret, struct err *err);
int ctl_group_find(const char *text, uint32_t *ret, struct err *err);

#endif
