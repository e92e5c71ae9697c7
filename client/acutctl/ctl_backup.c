/*
 * backup DIR: the state of the daemon, as of one moment, while it works. dataset export NAME DIR: one dataset.
 * dataset import DIR [NAME]: an exported one becomes a dataset of this daemon.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "ctl.h"
#include "ctl_copy.h"
#include "ctl_dataset.h"
#include "io.h"
#include "parse.h"

struct showing {
	struct ctl_copy copy;
	struct session_progress progress;
	uint64_t bytes, damaged;
	struct err damage; /* of the first of these, printed when all is there */
};

static int ready(void *ctx, const struct acut_backup_ready *r)
{
	struct showing *s = ctx;

	s->bytes = r->bytes;
	snprintf(s->copy.identity, sizeof s->copy.identity, "%s", r->identity);
	s->copy.place[0] = (struct ctl_copy_place){r->state_device, r->state_inode, "state"};
	s->copy.place[1] = (struct ctl_copy_place){r->cache_device, r->cache_inode, "cache"};
	if (ctl_copy_begin(&s->copy, &s->copy.err))
		return -1;
	s->damaged = r->damaged;
	if (r->damaged)
		session_failure_of(&r->damage, &s->damage);
	return 0;
}

static int file(void *ctx, const struct acut_backup_file *f)
{
	struct showing *s = ctx;

	return ctl_copy_file(&s->copy, f);
}

static void report(struct console *console, const struct ctl_copy *c, const char *dataset, double seconds)
{
	char all[32], more[32];

	if (console->json) {
		struct term_json j = console_json(console);

		term_json_text(&j, "folder", c->dir);
		term_json_text(&j, "dataset", dataset);
		term_json_u64(&j, "files", c->files);
		term_json_u64(&j, "bytes", c->bytes);
		term_json_u64(&j, "new_files", c->new_files);
		term_json_u64(&j, "new_bytes", c->new_bytes);
		term_json_u64(&j, "linked_files", c->linked);
		term_json_u64(&j, "removed_files", c->removed);
		term_json_number(&j, "seconds", seconds);
		term_json_end(&j);
		return;
	}
	console_line(console, "%llu files, %s, are in %s; %llu of them are new (%s, %llu by hard links), %llu old ones went",
		     (unsigned long long)c->files, parse_size_text(c->bytes, all), c->dir, (unsigned long long)c->new_files,
		     parse_size_text(c->new_bytes, more), (unsigned long long)c->linked, (unsigned long long)c->removed);
}

static int take(struct program *ctl, const char *dataset, const char *dir)
{
	struct session *session = &ctl->session;
	struct showing s = {
		.copy = {.session = session, .dir = dir, .flat = dataset != NULL, .no_links = ctl->opt.copy, .err = ERR_INIT}};
	const struct acut_backup_sink sink = {.ready = ready, .file = file, .ctx = &s};
	uint64_t begun = clock_mono_ns();
	struct err err = ERR_INIT;
	int status, r;

	snprintf(s.copy.what, sizeof s.copy.what, dataset ? "dataset %s" : "state of acutd", dataset);
	s.copy.dirfd = s.copy.storefd = -1;
	status = session_connect(session);
	if (!status) {
		r = acut_backup(session->acut, dataset, &sink);
		if (r && s.copy.err.code)
			status = session_error(session, &s.copy.err);
		else if (r)
			status = session_error_acut(session);
	}
	if (!status && ctl_copy_end(&s.copy, &err))
		status = session_error(session, &err);
	if (!status)
		report(&session->console, &s.copy, dataset, clock_since(begun));
	if (!status && s.damaged > 1)
		console_warn(&session->console, "%llu datasets are damaged; this is the first", (unsigned long long)s.damaged);
	if (!status && s.damaged)
		status = session_error(session, &s.damage);
	ctl_copy_done(&s.copy);
	return status;
}

int ctl_backup_run(struct program *ctl)
{
	return take(ctl, NULL, ctl->line.word[0]);
}

int ctl_dataset_export(struct program *ctl)
{
	return take(ctl, ctl->line.word[0], ctl->line.word[1]);
}

/* ---- import ---- */

struct bringing {
	const char *dir;
	int dirfd, fd;
	char **name; /* "manifest", then the others */
	size_t n, at;
	char path[512];
	struct err err;
};

static int next(void *ctx, const char **ret_name, int *ret_fd)
{
	struct bringing *b = ctx;

	b->fd = io_close(b->fd);
	if (b->at == b->n)
		return 0;
	snprintf(b->path, sizeof b->path, "%s/%s", b->dir, b->name[b->at]);
	b->fd = openat(b->dirfd, b->name[b->at], O_RDONLY | O_CLOEXEC);
	if (b->fd < 0) {
		err_sys(&b->err, errno, "cannot open");
		err_add_file(&b->err, b->path);
		return -1;
	}
	*ret_name = b->name[b->at++];
	*ret_fd = b->fd;
	return 0;
}

static int manifest_first(const void *a, const void *b)
{
	const char *x = *(char *const *)a, *y = *(char *const *)b;
	bool mx = !strcmp(x, "manifest"), my = !strcmp(y, "manifest");

	return mx || my ? my - mx : strcmp(x, y);
}

/* A file of a dataset: its manifest, a segment, a file of sources, or a file of lines, which is named by the number of its
 * source. */
static bool is_of_dataset(const char *name)
{
	static const char *const lines[] = {"lines-", "lineset-", "places-"};
	size_t k = strlen(name);

	for (unsigned i = 0; i < sizeof lines / sizeof *lines; i++) {
		const char *number = name + strlen(lines[i]);

		if (!strncmp(name, lines[i], strlen(lines[i])) && *number && strspn(number, "0123456789") == strlen(number))
			return true;
	}
	if (!strcmp(name, "sources") || (!strncmp(name, "sources-", 8) && !strchr(name, '.')))
		return true;
	return !strcmp(name, "manifest") || (k >= 5 && *name != '.' && !strcmp(name + k - 4, ".seg"));
}

static int gather(struct bringing *b, struct err *err)
{
	size_t room = 0;
	struct dirent *e;
	DIR *dir = opendir(b->dir);
	bool whole = false;

	if (!dir) {
		err_sys(err, errno, "cannot open the folder");
		return err_add_file(err, b->dir);
	}
	b->dirfd = fcntl(dirfd(dir), F_DUPFD_CLOEXEC, 3);
	while ((e = readdir(dir))) {
		whole |= !strcmp(e->d_name, "manifest");
		if (!is_of_dataset(e->d_name))
			continue;
		if (b->n == room) {
			char **more = realloc(b->name, (room = room ? 2 * room : 64) * sizeof *more);

			if (!more)
				break;
			b->name = more;
		}
		b->name[b->n] = strdup(e->d_name);
		if (!b->name[b->n])
			break;
		b->n++;
	}
	closedir(dir);
	if (e)
		return err_set(err, ERR_NOMEM, "no memory for the names of files");
	if (!whole) {
		err_set(err, ERR_INPUT, "there is no file manifest in this folder");
		err_add_hint(err, "give a folder that acutctl dataset export has written to its end");
		return err_add_file(err, b->dir);
	}
	qsort(b->name, b->n, sizeof *b->name, manifest_first);
	return 0;
}

/* "/box/valley/": "valley". */
static void last_part(const char *dir, char *ret, size_t size)
{
	size_t n = strlen(dir), from;

	while (n > 1 && dir[n - 1] == '/')
		n--;
	for (from = n; from && dir[from - 1] != '/'; from--)
		;
	snprintf(ret, size, "%.*s", (int)(n - from), dir + from);
}

static void imported(struct console *c, const struct acut_imported *i)
{
	char n[32];

	if (c->json) {
		struct term_json j = console_json(c);

		term_json_text(&j, "dataset", i->dataset);
		term_json_u64(&j, "generation", i->generation);
		term_json_u64(&j, "points", i->points);
		term_json_end(&j);
		return;
	}
	console_line(c, "dataset %s: generation %llu, %s points", i->dataset, (unsigned long long)i->generation,
		     term_count(i->points, n));
}

/* Unless a name is given, that of the folder. */
int ctl_dataset_import(struct program *ctl)
{
	struct session *session = &ctl->session;
	const char *dir = ctl->line.word[0], *name = ctl->line.word[1];
	struct bringing b = {.dir = dir, .dirfd = -1, .fd = -1, .err = ERR_INIT};
	const struct acut_imported *got;
	struct err err = ERR_INIT;
	char part[128];
	int status = 0;

	last_part(dir, part, sizeof part);
	if (gather(&b, &err))
		status = session_error(session, &err);
	if (!status)
		status = session_connect(session);
	if (!status) {
		if (acut_import(session->acut, name ? name : part, next, &b, &got))
			status = b.err.code ? session_error(session, &b.err) : session_error_acut(session);
		else
			imported(&session->console, got);
	}
	io_close(b.fd);
	io_close(b.dirfd);
	for (size_t i = 0; i < b.n; i++)
		free(b.name[i]);
	free(b.name);
	return status;
}
