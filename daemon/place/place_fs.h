/* Which file systems may hold a store: those of this machine. */
#ifndef PLACE_FS_H
#define PLACE_FS_H

#include <stdint.h>

struct err;

/* The name of a file system that other machines have too, by statfs's f_type; NULL: of this machine, or unknown.
 * `mount_type` is as in mountinfo ("fuse.sshfs"), NULL if not known: only for those of FUSE. */
const char *place_fs_network(uint64_t magic, const char *mount_type);
/* The type of the mount with that device number, of a file as /proc/self/mountinfo; "" if it is not there. */
void place_fs_mount_type(const char *mountinfo, unsigned major, unsigned minor, char *ret, unsigned long size);
/* -ERR_UNSUPPORTED: the folder is on a network file system, by name, and what to do. */
int place_fs_check(int dirfd, struct err *err);

#endif
