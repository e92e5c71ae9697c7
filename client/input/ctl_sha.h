/* SHA-256 by libcrypto, which is opened when a sum is wanted: it is larger than all of acutctl, and loading it took a third of
 * the time of every command. */
#ifndef CTL_SHA_H
#define CTL_SHA_H

#include <stddef.h>

enum { CTL_SHA_SIZE = 32 };

struct err;
struct ctl_sha;

/* -ERR_UNSUPPORTED: there is no libcrypto. NULL after an error. */
struct ctl_sha *ctl_sha_new(struct err *err);
/* Not 0: it failed. */
int ctl_sha_add(struct ctl_sha *, const void *data, size_t n);
int ctl_sha_sum(struct ctl_sha *, unsigned char ret[CTL_SHA_SIZE]);
struct ctl_sha *ctl_sha_free(struct ctl_sha *);

#endif
