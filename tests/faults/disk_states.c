/* disk_states.h. The log is played into bytes and names that are safe and a list of what is not yet. */
#include "disk_states.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { SECTOR = 512 };

struct node {
	bool folder, made;
	uint8_t *data;
	uint64_t size, room;
	size_t synced; /* entries of the log before this one are safe */
};

struct link {
	unsigned dir, node;
	const char *name;
};

struct state {
	struct node *node;
	unsigned nodes;
	struct link *link;
	size_t links;
	uint64_t seed;
};

static uint64_t draw(struct state *s)
{
	s->seed ^= s->seed << 13;
	s->seed ^= s->seed >> 7;
	s->seed ^= s->seed << 17;
	return s->seed;
}

static void resize(struct node *n, uint64_t size)
{
	if (size > n->room) {
		n->room = size * 2;
		n->data = realloc(n->data, n->room);
		if (!n->data)
			abort();
	}
	if (size > n->size)
		memset(n->data + n->size, 0, size - n->size);
	n->size = size;
}

static void write_part(struct node *n, const struct disk_entry *e, uint64_t from, uint64_t to)
{
	if (to > n->size)
		resize(n, to);
	memcpy(n->data + from, e->data + (from - e->at), to - from);
}

static void apply(struct node *n, const struct disk_entry *e)
{
	if (e->op == DISK_SIZE)
		resize(n, e->n);
	else
		write_part(n, e, e->at, e->at + e->n);
}

/* A write that nobody waited for: each sector by itself. */
static void apply_some(struct state *s, struct node *n, const struct disk_entry *e)
{
	if (e->op == DISK_SIZE) {
		if (draw(s) & 1)
			resize(n, e->n);
		return;
	}
	for (uint64_t at = e->at, end = e->at + e->n; at < end;) {
		uint64_t next = (at / SECTOR + 1) * SECTOR;

		if (next > end)
			next = end;
		if (draw(s) & 1)
			write_part(n, e, at, next);
		at = next;
	}
}

static struct link *find(struct state *s, unsigned dir, const char *name)
{
	for (size_t i = 0; i < s->links; i++)
		if (s->link[i].dir == dir && !strcmp(s->link[i].name, name))
			return &s->link[i];
	return NULL;
}

static void put(struct state *s, unsigned dir, const char *name, unsigned node)
{
	struct link *l = find(s, dir, name);

	if (!l)
		l = &s->link[s->links++];
	*l = (struct link){dir, node, name};
}

static void drop(struct state *s, unsigned dir, const char *name)
{
	struct link *l = find(s, dir, name);

	if (l)
		*l = s->link[--s->links];
}

static void apply_names(struct state *s, const struct disk_entry *e)
{
	if (e->op == DISK_CREATE || e->op == DISK_LINK) {
		put(s, e->dir, e->name, e->node);
	} else if (e->op == DISK_UNLINK) {
		drop(s, e->dir, e->name);
	} else {
		drop(s, e->dir, e->name);
		put(s, e->dir2, e->name2, e->node);
	}
}

static bool of_names(const struct disk_entry *e)
{
	return e->op == DISK_CREATE || e->op == DISK_LINK || e->op == DISK_UNLINK || e->op == DISK_RENAME;
}

static void make(const struct state *s, unsigned dir, const char *path, unsigned depth)
{
	for (size_t i = 0; depth < 16 && i < s->links; i++) {
		const struct link *l = &s->link[i];
		const struct node *n = &s->node[l->node];
		char *sub;
		int fd;

		if (l->dir != dir || asprintf(&sub, "%s/%s", path, l->name) < 0)
			continue;
		if (n->folder) {
			if (mkdir(sub, 0700) && errno != EEXIST)
				abort();
			make(s, l->node, sub, depth + 1);
			free(sub);
			continue;
		}
		fd = open(sub, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
		if (fd < 0 || write(fd, n->data, n->size) != (ssize_t)n->size)
			abort();
		close(fd);
		free(sub);
	}
}

/* A folder's changes after its last fsync: a beginning of them. */
static void apply_last_names(struct state *s, const struct disk_cut *c, const struct disk_entry *log)
{
	size_t *stop = calloc(s->nodes, sizeof *stop);

	for (unsigned i = 0; i < s->nodes; i++) {
		size_t from = s->node[i].synced;

		stop[i] = c->seed == 0 ? from : c->seed == 1 ? c->at : from + draw(s) % (c->at - from + 1);
	}
	for (size_t i = 0; i < c->at; i++) {
		const struct disk_entry *e = &log[i];
		unsigned also = e->op == DISK_RENAME ? e->dir2 : e->dir;

		if (of_names(e) && (i < stop[e->dir] || i < stop[also]))
			apply_names(s, e);
	}
	free(stop);
}

void disk_state_make(const struct disk_cut *c, const char *path)
{
	const struct disk_entry *log;
	struct state s = {.seed = c->seed * UINT64_C(0x9e3779b97f4a7c15) + 1};
	size_t n = fault_log(&log);

	for (size_t i = 0; i < n; i++)
		if (log[i].node >= s.nodes)
			s.nodes = log[i].node + 1;
	s.node = calloc(s.nodes, sizeof *s.node);
	s.link = calloc(n + 1, sizeof *s.link);
	for (size_t i = 0; i < c->at; i++) {
		const struct disk_entry *e = &log[i];
		struct node *node = &s.node[e->node];

		if (e->op == DISK_CREATE)
			node->folder = e->folder;
		else if (e->op == DISK_SYNC && !(node->folder || !e->node ? c->no_folder_sync : c->no_file_sync))
			node->synced = i;
	}
	s.node[0].folder = true;
	for (size_t i = 0; i < c->at; i++) {
		const struct disk_entry *e = &log[i];

		if (e->op != DISK_WRITE && e->op != DISK_SIZE)
			continue;
		if (i < s.node[e->node].synced || c->seed == 1)
			apply(&s.node[e->node], e);
		else if (c->seed)
			apply_some(&s, &s.node[e->node], e);
	}
	apply_last_names(&s, c, log);
	make(&s, 0, path, 0);
	for (unsigned i = 0; i < s.nodes; i++)
		free(s.node[i].data);
	free(s.node);
	free(s.link);
}
