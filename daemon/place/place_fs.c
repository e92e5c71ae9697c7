/*
 * Network file systems hold no store: locks, the order of writes, and the visibility of renames differ there, and SQLite's WAL
 * does not work at all. They are recognised by the number that statfs reports (linux/magic.h and the sources of the systems),
 * FUSE file systems by the type of their mount. Unknown file systems count as local.
 */
#include "place_fs.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/vfs.h>

#include "err.h"
#include "io.h"

#define MAGIC_FUSE UINT32_C(0x65735546)

static const struct {
	uint32_t magic;
	const char *name;
} network[] = {
	{0x00006969, "nfs"},      {0x0000517B, "smb"},    {0xFF534D42, "cifs"}, {0xFE534D42, "smb2"},   {0x5346414F, "afs"},
	{0x6B414653, "kafs"},     {0x01021997, "9p"},     {0x00C36400, "ceph"}, {0x0BD00BD0, "lustre"}, {0x47504653, "gpfs"},
	{0x7461636F, "ocfs2"},    {0x01161970, "gfs2"},   {0x73757245, "coda"}, {0x0000564C, "ncp"},    {0xAAD7AAEA, "panfs"},
	{0x20030528, "orangefs"}, {0x19830326, "beegfs"}, {0xBEEFDEAD, "snfs"}, {0xBACBACBC, "vmhgfs"}, {0x786F4256, "vboxsf"},
	{0x7C7C6673, "prl_fs"},   {0x61636673, "acfs"},
};

static const char *const network_fuse[] = {
	"sshfs",      "glusterfs", "ceph-fuse", "ceph",     "s3fs",     "s3fs-fuse",   "rclone",  "davfs",     "davfs2",
	"curlftpfs",  "gcsfuse",   "goofys",    "juicefs",  "JuiceFS",  "mfs",         "moosefs", "seaweedfs", "lizardfs",
	"blobfuse",   "blobfuse2", "smbnetfs",  "nfs",      "fuse-nfs", "beegfs",      "cvmfs2",  "afp",       "afpfs",
	"gvfsd-fuse", "wdfs",      "hdfs",      "fuse_dfs", "quobyte",  "vmhgfs-fuse",
};

const char *place_fs_network(uint64_t magic, const char *mount_type)
{
	/* f_type is signed on some machines. */
	uint32_t m = (uint32_t)magic;

	for (size_t i = 0; i < sizeof network / sizeof network[0]; i++)
		if (network[i].magic == m)
			return network[i].name;
	if (m != MAGIC_FUSE || !mount_type || strncmp(mount_type, "fuse.", 5) != 0)
		return NULL;
	for (size_t i = 0; i < sizeof network_fuse / sizeof network_fuse[0]; i++)
		if (!strcmp(network_fuse[i], mount_type + 5))
			return network_fuse[i];
	return NULL;
}

/* "id parent major:minor root point options [optional...] - type source options" */
static bool line_type(char *line, unsigned major, unsigned minor, char *ret, unsigned long size)
{
	unsigned a, b;
	char *type;

	if (sscanf(line, "%*u %*u %u:%u", &a, &b) != 2 || a != major || b != minor)
		return false;
	type = strstr(line, " - ");
	if (!type)
		return false;
	type += 3;
	type[strcspn(type, " \n")] = 0;
	snprintf(ret, size, "%s", type);
	return true;
}

void place_fs_mount_type(const char *mountinfo, unsigned major, unsigned minor, char *ret, unsigned long size)
{
	FILE *f = fopen(mountinfo, "re");
	char *line = NULL;
	size_t n = 0;

	*ret = 0;
	while (f && getline(&line, &n, f) > 0 && !line_type(line, major, minor, ret, size))
		;
	free(line);
	if (f)
		fclose(f);
}

int place_fs_check(int dirfd, struct err *err)
{
	struct statfs fs;
	struct stat st;
	const char *name;
	char type[64] = "";

	if (io->fstatfs(dirfd, &fs) != 0 || io->fstat(dirfd, &st) != 0)
		return err_sys(err, errno, "cannot tell the file system");
	if ((uint32_t)fs.f_type == MAGIC_FUSE)
		place_fs_mount_type("/proc/self/mountinfo", major(st.st_dev), minor(st.st_dev), type, sizeof type);
	name = place_fs_network((uint32_t)fs.f_type, type);
	if (!name)
		return 0;
	err_set(err, ERR_UNSUPPORTED, "the state folder is on a network file system (%s), where what was pushed is not safe",
		name);
	return err_add_hint(err, "give --state a folder on a disk of this machine (ext4, xfs, btrfs, zfs)");
}
