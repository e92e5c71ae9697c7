/* Which file systems may hold a store: local ones. */
#ifndef PLACE_FS_H
#define PLACE_FS_H

#include <stdint.h>

struct err;

/* The name of a network file system, by statfs's f_type; NULL: local or unknown. mount_type: for FUSE, as in mountinfo
 * ("fuse.sshfs"); NULL: unknown. */
const char *place_fs_network(uint64_t magic, const char *mount_type);
/* The type of the mount with that device number, from a file like /proc/self/mountinfo; "": it is not there. */
void place_fs_mount_type(const char *mountinfo, unsigned major, unsigned minor, char *ret, unsigned long size);
/* -ERR_UNSUPPORTED: the folder is on a network file system. */
int place_fs_check(int dirfd, struct err *err);

#endif
