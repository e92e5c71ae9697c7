/*
 * Inputs that are gzip files and zip archives.
 *
 * An archive is like a folder: its survey files are inputs named ARCHIVE/MEMBER, sorted by name; other files in it are left
 * out with a warning, unless it has one file only. An archive is recognised by its first bytes. The daemon needs complete
 * files, so a member is unpacked once, when it is probed, into a file without a name in $TMPDIR (/var/tmp), which exists
 * until the daemon has read it. It gets the archive's time of change: a member is the same, by path, size and time, as long
 * as the archive was not written again. Times in an archive are not used: two versions of a member often have the same.
 *
 * An archive that unpacks to too much data fills the disk up to a margin at most, never the memory.
 */
#include "ctl_input_priv.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "clock.h"
#include "term.h"
#include "io.h"
#include "parse.h"

enum { MEMBERS_MOST = 1 << 20 };
static const uint64_t margin = 64 << 20; /* of the disk, that stays free */
static const uint64_t check_every = 16 << 20;

/* ---- which members ---- */

static bool ends(const char *name, size_t n, const char *end)
{
	size_t m = strlen(end);

	return n > m && !strncasecmp(name + n - m, end, m);
}

bool ctl_archive_named(const char *name)
{
	size_t n = strlen(name);

	if (ends(name, n, ".gz"))
		return ctl_input_is_survey(name, n - 3);
	return ends(name, n, ".zip");
}

/* Some part of its path begins with a point, or it is in the folder that macOS adds. "./a.las" and "../a.las" are not hidden. */
static bool is_hidden(const char *name)
{
	size_t n;

	for (const char *p = name; *p; p += n + (p[n] == '/')) {
		n = strcspn(p, "/");
		if ((*p == '.' && n > (p[1] == '.' ? 2 : 1)) || (n == 8 && !memcmp(p, "__MACOSX", n)))
			return true;
	}
	return false;
}

static int put_member(struct ctl_archive *a, const struct ctl_unpack_member *m, struct err *err)
{
	struct ctl_archive_member *to;
	char *name;

	if (a->n == a->room) {
		size_t room = a->room ? 2 * a->room : 16;
		void *grown = room > MEMBERS_MOST ? NULL : realloc(a->member, room * sizeof(*a->member));

		if (!grown)
			return err_set(err, ERR_NOMEM, "no memory for the list of an archive's files");
		a->member = grown;
		a->room = room;
	}
	to = &a->member[a->n];
	*to = (struct ctl_archive_member){.in = *m};
	if (asprintf(&name, "%s/%s", a->path ? a->path : "", m->name) < 0)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	to->path = name;
	to->name = to->in.name = name + (a->path ? strlen(a->path) : 0) + 1;
	a->n++;
	return 0;
}

static int seen(void *ctx, const struct ctl_unpack_member *m, struct err *err)
{
	struct ctl_archive *a = ctx;

	if (!is_hidden(m->name))
		return put_member(a, m, err);
	a->hidden = true;
	return 0;
}

static int by_name(const void *a, const void *b)
{
	return strcmp(((const struct ctl_archive_member *)a)->name, ((const struct ctl_archive_member *)b)->name);
}

/* Drops members that are not survey files. An archive with one member is used whatever its extension, and named by both. */
static void choose(struct ctl_archive *a, bool from_folder)
{
	size_t kept = 0;

	if (a->n)
		qsort(a->member, a->n, sizeof(*a->member), by_name);
	for (size_t i = 0; i < a->n; i++) {
		struct ctl_archive_member *m = &a->member[i];

		if (ctl_input_is_survey(m->name, strlen(m->name)) || (a->n == 1 && !from_folder)) {
			a->member[kept++] = *m;
			continue;
		}
		if (!a->left_out++)
			snprintf(a->first_left_out, sizeof(a->first_left_out), "%s", m->name);
		free(m->path);
	}
	a->n = kept;
	for (size_t i = 1; i < a->n; i++) {
		if (by_name(&a->member[i - 1], &a->member[i]))
			continue;
		a->member[i].in.why = "its archive has another file of the same name";
		a->member[i].in.todo = "unpack the archive, and name the files";
	}
}

static int list_gzip(struct ctl_archive *a, struct err *err)
{
	const char *base = strrchr(a->file.name, '/');
	size_t n;
	char *name;
	int r;

	base = base ? base + 1 : a->file.name;
	n = strlen(base);
	name = ends(base, n, ".tgz") ? NULL : strndup(base, ends(base, n, ".gz") ? n - 3 : n);
	if (!name && asprintf(&name, "%.*s.tar", (int)(n - 4), base) < 0)
		name = NULL;
	if (!name)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	r = put_member(a, &(struct ctl_unpack_member){.name = name, .size = UINT64_MAX}, err);
	free(name);
	return r;
}

/* -code: of the archive itself, or of no memory. */
static int list(struct ctl_archive *a, int fd, bool from_folder, struct err *err)
{
	int r = a->kind == CTL_UNPACK_GZIP ? list_gzip(a, err) : ctl_unpack_list(fd, seen, a, err);
	char endings[64];

	if (r)
		return r;
	choose(a, from_folder && a->kind == CTL_UNPACK_ZIP);
	if (a->n || from_folder)
		return 0;
	err_set(err, ERR_INPUT,
		a->left_out ? "the archive holds no survey files" :
		a->hidden   ? "the archive holds only hidden files" :
			      "the archive holds no files");
	if (a->left_out || a->hidden)
		err_add_hint(err, "files ending in %s are taken from archives; unpack it and name others",
			     ctl_input_endings(endings, sizeof(endings)));
	return -(int)ERR_INPUT;
}

/* ---- archives among inputs ---- */

static struct ctl_archive *free_one(struct ctl_archive *a)
{
	struct ctl_archive *next = a->next;

	for (size_t i = 0; i < a->n; i++)
		free(a->member[i].path);
	free(a->member);
	free(a->file.name);
	free(a->path);
	free(a);
	return next;
}

void ctl_archive_free(struct ctl_inputs *in)
{
	while (in->archives)
		in->archives = free_one(in->archives);
}

static struct ctl_archive *new_archive(const struct ctl_input *file, const struct stat *st, struct err *err)
{
	struct ctl_archive *a = calloc(1, sizeof(*a));
	char path[4096];
	const char *absolute = ctl_input_path(file, path, sizeof(path));

	if (a) {
		a->file = *file;
		a->file.name = strdup(file->name);
		a->path = absolute ? strdup(absolute) : NULL;
		ctl_input_see(&a->file, st);
		a->why = ERR_INIT;
	}
	if (a && a->file.name && (a->path || !absolute))
		return a;
	if (a)
		free_one(a);
	err_set(err, ERR_NOMEM, "no memory for a list of inputs");
	return NULL;
}

/* An input of a member; of an archive that cannot be read, of itself. */
static int add_member(struct ctl_inputs *in, struct ctl_archive *a, size_t i, struct err *err)
{
	char *name = NULL, *safe = NULL;
	int r;

	if (!a->why.code && asprintf(&name, "%s/%s", a->file.name, a->member[i].name) < 0)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	safe = name ? term_safe(name) : NULL;
	r = name && !safe ? err_set(err, ERR_NOMEM, "no memory for a file name") :
			    ctl_input_append(in, &(struct ctl_input){.fd = -1}, safe ? safe : a->file.name, err);
	free(name);
	free(safe);
	if (r)
		return r;
	in->input[in->n - 1].archive = a;
	in->input[in->n - 1].member = i;
	in->input[in->n - 1].path = a->why.code ? a->path : a->path ? a->member[i].path : NULL;
	return 0;
}

static bool is_there(const struct ctl_inputs *in, const struct stat *st)
{
	const struct ctl_archive *a = in->archives;

	while (a && (a->file.dev != st->st_dev || a->file.ino != st->st_ino))
		a = a->next;
	return a;
}

static void warn_left_out(struct console *c, const struct ctl_archive *a)
{
	if (a->left_out == 1)
		console_warn(c, "%s: left out, it is no survey file: %s", a->file.name, a->first_left_out);
	else if (a->left_out)
		console_warn(c, "%s: left out, they are no survey files: %s and %u more", a->file.name, a->first_left_out,
			     a->left_out - 1);
}

static int add_archive(struct ctl_inputs *in, const struct ctl_input *file, int fd, const struct stat *st,
		       enum ctl_unpack_kind kind, bool from_folder, struct err *err)
{
	struct ctl_archive *a = new_archive(file, st, err);
	int r;

	if (!a)
		return -(int)err->code;
	a->next = in->archives;
	in->archives = a;
	a->kind = kind;
	if (list(a, fd, from_folder, &a->why)) {
		err_add_file(&a->why, a->file.name);
		if (a->why.code != ERR_NOMEM)
			return add_member(in, a, 0, err);
		*err = a->why;
		return -(int)ERR_NOMEM;
	}
	warn_left_out(&in->session->console, a);
	r = 0;
	for (size_t i = 0; !r && i < a->n; i++)
		r = add_member(in, a, i, err);
	return r;
}

int ctl_archive_add(struct ctl_inputs *in, const struct ctl_input *file, bool from_folder, bool *ret_is, struct err *err)
{
	struct ctl_input plain = *file;
	struct err quiet = ERR_INIT;
	enum ctl_unpack_kind kind;
	struct stat st;
	int fd, r = 0;

	*ret_is = false;
	if (!file->entry && (stat(file->name, &st) || !S_ISREG(st.st_mode)))
		return 0;
	if (ctl_input_open(in, &plain, &fd, &quiet))
		return 0;
	kind = ctl_unpack_kind_of(fd);
	*ret_is = kind != CTL_UNPACK_NONE && !fstat(fd, &st);
	if (*ret_is && is_there(in, &st))
		console_line(&in->session->console, "%s: it is named twice, and taken once", file->name);
	else if (*ret_is)
		r = add_archive(in, file, fd, &st, kind, from_folder, err);
	close(fd);
	return r;
}

/* ---- unpacking ---- */

struct unpacking {
	struct ctl_inputs *inputs;
	const struct ctl_input *in;
	const char *folder;
	int to;
	uint64_t done, size, checked;
	struct session_progress progress;
};

static int no_room(const struct unpacking *u, struct err *err)
{
	char size[32];

	err_set(err, ERR_NOSPACE, "there is no room in %s to unpack it, after %s", u->folder, parse_size_text(u->done, size));
	return err_add_hint(err, "set TMPDIR to a folder with more room, or name fewer archives at once");
}

static uint64_t room_left(const struct unpacking *u)
{
	struct statvfs v;

	return fstatvfs(u->to, &v) ? UINT64_MAX : (uint64_t)v.f_bavail * v.f_frsize;
}

static void show(struct unpacking *u)
{
	uint64_t now = clock_mono_ns();
	char line[256], done[32], size[32];

	if (!u->progress.on || now - u->progress.last_ns < 100000000)
		return;
	u->progress.last_ns = now;
	if (u->size == UINT64_MAX)
		snprintf(line, sizeof(line), "unpack %s  %.180s", parse_size_text(u->done, done), u->in->name);
	else
		snprintf(line, sizeof(line), "unpack %s of %s  %.180s", parse_size_text(u->done, done),
			 parse_size_text(u->size, size), u->in->name);
	console_progress(&u->inputs->session->console, "%s", line);
}

static int sink(void *ctx, const void *bytes, size_t n, struct err *err)
{
	struct unpacking *u = ctx;

	if (session_interrupted(u->inputs->session))
		return err_set(err, ERR_CANCELLED, "interrupted");
	if (u->done - u->checked >= check_every) {
		u->checked = u->done;
		if (room_left(u) < margin)
			return no_room(u, err);
	}
	for (size_t at = 0; at < n;) {
		ssize_t k = pwrite(u->to, (const char *)bytes + at, n - at, (off_t)u->done);

		if (k < 0 && errno == EINTR)
			continue;
		if (k <= 0 && (errno == ENOSPC || errno == EDQUOT || errno == EFBIG))
			return no_room(u, err);
		if (k <= 0)
			return err_sys(err, errno, "cannot write in %s", u->folder);
		at += (size_t)k;
		u->done += (uint64_t)k;
	}
	show(u);
	return 0;
}

/* A text that is cut ends with a part of a line, which may look complete; it is removed. LAS has records of a fixed length. */
static int drop_cut_line(struct unpacking *u, struct err *err)
{
	char tail[4096];
	uint64_t from = u->done > sizeof(tail) ? u->done - sizeof(tail) : 0;
	ssize_t n = pread(u->to, tail, 4, 0);
	const char *end;

	if (n == 4 && !memcmp(tail, "LASF", 4))
		return 0;
	n = pread(u->to, tail, sizeof(tail), (off_t)from);
	end = n > 0 ? memrchr(tail, '\n', (size_t)n) : NULL;
	if (end && ftruncate(u->to, (off_t)(from + (uint64_t)(end + 1 - tail))))
		return err_sys(err, errno, "cannot write in %s", u->folder);
	return 0;
}

static int unpack_gzip(struct unpacking *u, int from, struct err *err)
{
	bool cut;
	uint64_t trailing;
	int r = ctl_unpack_gzip(from, sink, u, &cut, &trailing, err);

	if (r && cut && u->inputs->opt->accept_truncated) {
		err_clear(err);
		console_warn(&u->inputs->session->console, "%s: its gzip file ends before its last byte", u->in->name);
		return drop_cut_line(u, err);
	}
	if (!r && trailing)
		console_warn(&u->inputs->session->console, "%s: %llu bytes after its end in the gzip file are ignored",
			     u->in->name, (unsigned long long)trailing);
	return r;
}

/* Its name in a command; "FILE" where a shell would want more than the bare name. */
static const char *in_command(const char *name)
{
	const char *base = strrchr(name, '/');

	base = base ? base + 1 : name;
	return *base != '-' && strlen(base) < 100 &&
			       !base[strspn(base, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-+")] ?
		       base :
		       "FILE";
}

/* The daemon's hint for what is packed would name a file that is not there. */
static int check_not_packed(const struct unpacking *u, const struct ctl_archive *a, struct err *err)
{
	enum ctl_unpack_kind kind = ctl_unpack_kind_of(u->to);
	char magic[5];

	if (kind != CTL_UNPACK_NONE) {
		err_set(err, ERR_INPUT, "this is %s within %s, and only the outer one is unpacked",
			kind == CTL_UNPACK_GZIP ? "a gzip file" : "a zip archive",
			a->kind == CTL_UNPACK_GZIP ? "a gzip file" : "a zip archive");
		return err_add_hint(err, "unpack it: %s %s, and name the result",
				    a->kind == CTL_UNPACK_GZIP ? "gunzip -k" : "unzip", in_command(a->file.name));
	}
	if (a->kind != CTL_UNPACK_GZIP || pread(u->to, magic, sizeof(magic), 257) != sizeof(magic) ||
	    memcmp(magic, "ustar", sizeof(magic)))
		return 0;
	err_set(err, ERR_INPUT, "this is a tar archive, packed by gzip");
	return err_add_hint(err, "unpack it: tar -xzf %s, and name the files", in_command(a->file.name));
}

static int unpack(struct unpacking *u, const struct ctl_archive *a, const struct ctl_archive_member *m, int from, struct err *err)
{
	const struct timespec times[2] = {a->file.mtime, a->file.mtime};
	struct stat st;
	int r;

	u->size = m->in.size;
	if (u->size != UINT64_MAX && u->size > check_every && room_left(u) < u->size + margin)
		return no_room(u, err);
	r = a->kind == CTL_UNPACK_GZIP ? unpack_gzip(u, from, err) : ctl_unpack_zip(from, &m->in, sink, u, err);
	if (!r && (fstat(from, &st) || !ctl_input_unchanged(&a->file, &st)))
		r = err_set(err, ERR_CHANGED, "the archive changed while it was read");
	if (!r)
		r = check_not_packed(u, a, err);
	if (!r && futimens(u->to, times))
		r = err_sys(err, errno, "cannot set the time of a file in %s", u->folder);
	return r;
}

/* A file each, until the daemon is done with it: as many as this process may have. One that grows too large is a failed write. */
static void set_limits(void)
{
	struct rlimit l;

	signal(SIGXFSZ, SIG_IGN);
	if (!getrlimit(RLIMIT_NOFILE, &l) && l.rlim_cur < l.rlim_max) {
		l.rlim_cur = l.rlim_max;
		setrlimit(RLIMIT_NOFILE, &l);
	}
}

/* The archive, if it is still as it was. */
static int open_archive(struct ctl_inputs *in, struct ctl_archive *a, int *ret_fd, struct err *err)
{
	struct stat st;
	int r = ctl_input_open(in, &a->file, ret_fd, err);

	if (r || (!fstat(*ret_fd, &st) && ctl_input_unchanged(&a->file, &st)))
		return r;
	close(*ret_fd);
	err_set(err, ERR_CHANGED, "the archive has changed since it was examined");
	return err_add_hint(err, "name it again when no program writes to it");
}

int ctl_archive_keep(struct ctl_inputs *inputs, struct ctl_input *in, struct err *err)
{
	struct ctl_archive *a = in->archive;
	const struct ctl_archive_member *m = a->why.code ? NULL : &a->member[in->member];
	struct unpacking u = {.inputs = inputs, .in = in};
	int from, r;

	if (in->kept)
		return 0;
	if (!m) {
		*err = a->why;
		return -(int)err->code;
	}
	if (m->in.why) {
		err_set(err, ERR_INPUT, "%s", m->in.why);
		if (m->in.todo)
			err_add_hint(err, "%s", m->in.todo);
		return err_add_file(err, in->name);
	}
	set_limits();
	session_progress_init(&u.progress, inputs->session);
	r = ctl_temp_open(&u.folder, &u.to, err);
	if (r)
		return err_add_file(err, in->name);
	r = open_archive(inputs, a, &from, err);
	if (!r) {
		r = unpack(&u, a, m, from, err);
		close(from);
	}
	if (u.progress.on)
		console_progress_clear(&inputs->session->console);
	if (!r) {
		in->kept = u.to;
		return 0;
	}
	close(u.to);
	return err_add_file(err, in->name);
}

void ctl_input_drop(struct ctl_input *in)
{
	if ((in->archive || in->lines) && in->kept) {
		close(in->kept);
		in->kept = 0;
	}
}
