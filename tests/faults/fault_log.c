/*
 * The log of changes to the disk (fault_io.h). All functions run with the lock, except fault_log_start, _stop, _mark and
 * fault_log.
 *
 * The model: files and folders are nodes. A descriptor is recognised by device and inode: its number may be reused by calls that
 * are not logged.
 */
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "fault_priv.h"

struct name {
	unsigned dir, node;
	char *name;
};

struct inode {
	dev_t dev;
	ino_t ino;
	bool lost; /* its fsync failed */
};

static unsigned long distrusted;
static char root[512];
static bool logging;
static struct disk_entry *entry;
static size_t entries, room;
static struct name *names;
static size_t nnames, names_room;
static struct inode *inodes; /* by node */
static unsigned nodes, nodes_room;

static void *grow(void *array, size_t n, size_t *have, size_t size)
{
	if (n < *have)
		return array;
	*have = *have ? 2 * *have : 64;
	array = realloc(array, *have * size);
	if (!array)
		abort();
	return array;
}

static struct disk_entry *add_entry(enum disk_op op, unsigned node)
{
	entry = grow(entry, entries, &room, sizeof *entry);
	entry[entries] = (struct disk_entry){.op = op, .node = node};
	return &entry[entries++];
}

static unsigned node_new(int dirfd, const char *path)
{
	struct stat st = {0};
	size_t have = nodes_room;

	inodes = grow(inodes, nodes, &have, sizeof *inodes);
	nodes_room = (unsigned)have;
	fstatat(dirfd, path, &st, AT_SYMLINK_NOFOLLOW);
	inodes[nodes] = (struct inode){st.st_dev, st.st_ino, false};
	return nodes++;
}

static struct name *find_name(unsigned dir, const char *name)
{
	for (size_t i = 0; i < nnames; i++)
		if (names[i].dir == dir && !strcmp(names[i].name, name))
			return &names[i];
	return NULL;
}

static void put_name(unsigned dir, const char *name, unsigned node)
{
	struct name *old = find_name(dir, name);

	if (old) {
		old->node = node;
		return;
	}
	names = grow(names, nnames, &names_room, sizeof *names);
	names[nnames++] = (struct name){dir, node, strdup(name)};
}

static void drop_name(unsigned dir, const char *name)
{
	struct name *old = find_name(dir, name);

	if (!old)
		return;
	free(old->name);
	*old = names[--nnames];
}

/* The newest first: the number of a removed inode is used again. */
unsigned fault_node_of(int fd)
{
	struct stat st;

	if (!logging || fstat(fd, &st) != 0)
		return FAULT_NO_NODE;
	for (unsigned i = nodes; i-- > 0;)
		if (inodes[i].ino == st.st_ino && inodes[i].dev == st.st_dev)
			return i;
	return FAULT_NO_NODE;
}

/* The node of the folder of `path`, and its last part. FAULT_NO_NODE: it is not below the root. */
static unsigned locate(int dirfd, const char *path, const char **ret_name)
{
	unsigned dir;
	size_t n = strlen(root);
	const char *slash;

	if (!logging)
		return FAULT_NO_NODE;
	if (*path == '/') {
		if (strncmp(path, root, n) || path[n] != '/')
			return FAULT_NO_NODE;
		dir = 0;
		path += n + 1;
	} else {
		dir = fault_node_of(dirfd);
	}
	while (dir != FAULT_NO_NODE && (slash = strchr(path, '/'))) {
		char part[256];
		struct name *hit;

		snprintf(part, sizeof part, "%.*s", (int)(slash - path), path);
		hit = find_name(dir, part);
		dir = hit ? hit->node : FAULT_NO_NODE;
		path = slash + 1;
	}
	*ret_name = path;
	return dir;
}

void fault_did_create(int dirfd, const char *path, bool folder, bool cut)
{
	const char *name;
	unsigned dir = locate(dirfd, path, &name);
	struct name *old;

	if (dir == FAULT_NO_NODE || !strcmp(name, "."))
		return;
	old = find_name(dir, name);
	if (!old) {
		unsigned node = node_new(dirfd, path);
		struct disk_entry *e = add_entry(DISK_CREATE, node);

		e->dir = dir;
		e->name = strdup(name);
		e->folder = folder;
		put_name(dir, name, node);
	} else if (cut) {
		add_entry(DISK_SIZE, old->node);
	}
}

void fault_did_write_node(unsigned node, const void *buf, size_t n, uint64_t at)
{
	struct disk_entry *e;

	if (node == FAULT_NO_NODE)
		return;
	e = add_entry(DISK_WRITE, node);
	e->at = at;
	e->n = n;
	e->data = malloc(n);
	memcpy(e->data, buf, n);
}

void fault_did_size_node(unsigned node, uint64_t size)
{
	if (node != FAULT_NO_NODE)
		add_entry(DISK_SIZE, node)->n = size;
}

void fault_did_sync_node(unsigned node)
{
	if (node != FAULT_NO_NODE)
		add_entry(DISK_SYNC, node);
}

void fault_did_sync_dir_of(const char *path)
{
	const char *name;

	fault_did_sync_node(locate(AT_FDCWD, path, &name));
}

unsigned fault_node_at(const char *path)
{
	const char *name;
	unsigned dir = locate(AT_FDCWD, path, &name);
	struct name *hit = dir == FAULT_NO_NODE ? NULL : find_name(dir, name);

	return hit ? hit->node : FAULT_NO_NODE;
}

void fault_did_unlink(int dirfd, const char *path)
{
	const char *name;
	unsigned dir = locate(dirfd, path, &name);
	struct name *hit = dir == FAULT_NO_NODE ? NULL : find_name(dir, name);
	struct disk_entry *e;

	if (!hit)
		return;
	e = add_entry(DISK_UNLINK, hit->node);
	e->dir = dir;
	e->name = strdup(name);
	drop_name(dir, name);
}

void fault_did_rename(int olddir, const char *old, int newdir, const char *new)
{
	const char *name, *name2;
	unsigned dir = locate(olddir, old, &name), dir2 = locate(newdir, new, &name2), node;
	struct name *hit = dir == FAULT_NO_NODE ? NULL : find_name(dir, name);
	struct disk_entry *e;

	if (!hit || dir2 == FAULT_NO_NODE)
		return;
	node = hit->node;
	fault_use(node);
	e = add_entry(DISK_RENAME, node);
	e->dir = dir;
	e->dir2 = dir2;
	e->name = strdup(name);
	e->name2 = strdup(name2);
	drop_name(dir, name);
	put_name(dir2, name2, node);
}

void fault_did_link(int olddir, const char *old, int newdir, const char *new)
{
	const char *name, *name2;
	unsigned dir = locate(olddir, old, &name), dir2 = locate(newdir, new, &name2);
	struct name *hit = dir == FAULT_NO_NODE ? NULL : find_name(dir, name);
	struct disk_entry *e;

	if (!hit || dir2 == FAULT_NO_NODE)
		return;
	e = add_entry(DISK_LINK, hit->node);
	e->dir = dir2;
	e->name = strdup(name2);
	put_name(dir2, name2, hit->node);
}

/* ---- files that exist at the start ---- */

static void log_file(int fd, unsigned node)
{
	uint8_t *buf = malloc(1 << 20);
	uint64_t at = 0;
	ssize_t n;

	while ((n = pread(fd, buf, 1 << 20, (off_t)at)) > 0) {
		fault_did_write_node(node, buf, (size_t)n, at);
		at += (uint64_t)n;
	}
	free(buf);
	fault_did_sync_node(node);
}

static void log_folder(const char *path, unsigned node)
{
	DIR *dir = opendir(path);
	struct dirent *e;
	char *sub;

	while (dir && (e = readdir(dir))) {
		size_t n = strlen(e->d_name);
		struct stat st;

		if (!strcmp(e->d_name, ".") || !strcmp(e->d_name, "..") || (n > 4 && !strcmp(e->d_name + n - 4, "-shm")))
			continue;
		if (asprintf(&sub, "%s/%s", path, e->d_name) < 0 || lstat(sub, &st))
			abort();
		fault_did_create(AT_FDCWD, sub, S_ISDIR(st.st_mode), false);
		if (S_ISDIR(st.st_mode)) {
			log_folder(sub, fault_node_at(sub));
		} else {
			int fd = open(sub, O_RDONLY | O_CLOEXEC);

			log_file(fd, fault_node_at(sub));
			close(fd);
		}
		free(sub);
	}
	closedir(dir);
	fault_did_sync_node(node);
}

static void clear_log(void)
{
	for (size_t i = 0; i < entries; i++) {
		free(entry[i].name);
		free(entry[i].name2);
		free(entry[i].data);
	}
	for (size_t i = 0; i < nnames; i++)
		free(names[i].name);
	entries = nnames = nodes = 0;
}

void fault_log_start(const char *path)
{
	fault_lock();
	clear_log();
	snprintf(root, sizeof root, "%s", path);
	logging = true;
	node_new(AT_FDCWD, path);
	log_folder(path, 0);
	fault_unlock();
}

void fault_log_stop(void)
{
	fault_lock();
	logging = false;
	fault_unlock();
}

void fault_mark(uint64_t mark)
{
	fault_lock();
	if (logging)
		add_entry(DISK_MARK, 0)->n = mark;
	fault_unlock();
}

size_t fault_log(const struct disk_entry **ret)
{
	*ret = entry;
	return entries;
}

/* ---- failed syncs ---- */

void fault_lose(unsigned node)
{
	inodes[node].lost = true;
}

void fault_use(unsigned node)
{
	distrusted += inodes[node].lost;
}

unsigned long fault_distrusted(void)
{
	return distrusted;
}

void fault_trust_all(void)
{
	distrusted = 0;
}
