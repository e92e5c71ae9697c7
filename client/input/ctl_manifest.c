/*
 * --manifest: every input is compared with a list of SHA-256 sums, as sha256sum writes and reads it, before anything is sent
 * to the daemon.
 *
 * Names in the list are relative to its folder. A line belongs to an input if both are the same file, however they are
 * spelled. A file in an archive has a line of its own, ARCHIVE/MEMBER, for its unpacked bytes, or the archive's line counts,
 * for the archive's bytes. All inputs are read and all that do not agree are named; one is enough to end the command. A
 * verified file is identified by device, inode, size and time, and an input that is another file when it is opened is
 * refused.
 */
#include <errno.h>
#include <nettle/sha2.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "ctl_input_priv.h"
#include "io.h"

enum { SUM = SHA256_DIGEST_SIZE, PIECE = 1 << 20, NAMED_MOST = 20 };

struct line {
	dev_t dev;
	ino_t ino;
	char *member; /* NULL, or which of the archive */
	unsigned char sum[SUM];
};

struct manifest {
	struct ctl_inputs *in;
	const char *path;
	char *folder; /* with the slash at its end; "" for the current one */
	struct line *line;
	size_t n, room;
};

/* ---- the list ---- */

static int nibble(char c)
{
	return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

static bool read_sum(const char *text, unsigned char sum[SUM])
{
	for (int i = 0; i < SUM; i++) {
		int high = nibble(text[2 * i]), low = high < 0 ? -1 : nibble(text[2 * i + 1]);

		if (low < 0)
			return false;
		sum[i] = (unsigned char)(high << 4 | low);
	}
	return true;
}

/* A line that begins with a backslash has \\, \n and \r in its name for these. */
static bool unescape(char *name)
{
	char *to = name;

	for (; *name; name++) {
		if (*name != '\\') {
			*to++ = *name;
			continue;
		}
		name++;
		if (*name != '\\' && *name != 'n' && *name != 'r')
			return false;
		*to++ = *name == 'n' ? '\n' : *name == 'r' ? '\r' : '\\';
	}
	*to = 0;
	return true;
}

/* "SUM  NAME", "SUM *NAME" (binary), or "SHA256 (NAME) = SUM". */
static bool split(char *text, unsigned char sum[SUM], char **ret_name)
{
	bool escaped = *text == '\\';
	char *end;

	text += escaped;
	if (!strncmp(text, "SHA256 (", 8)) {
		end = strstr(text, ") = ");
		for (char *next = end; next && (next = strstr(next + 1, ") = "));)
			end = next;
		if (!end || strlen(end + 4) != 2 * SUM || !read_sum(end + 4, sum))
			return false;
		*end = 0;
		*ret_name = text + 8;
	} else {
		if (strlen(text) < 2 * SUM + 3 || !read_sum(text, sum) || text[2 * SUM] != ' ' ||
		    (text[2 * SUM + 1] != ' ' && text[2 * SUM + 1] != '*'))
			return false;
		*ret_name = text + 2 * SUM + 2;
	}
	return **ret_name && (!escaped || unescape(*ret_name));
}

/* "ARCHIVE/MEMBER": the longest part in front that is a file. 0, as stat. */
static int find_archive(char *path, struct stat *st, char **ret_member)
{
	int there = -1;

	for (char *end = strrchr(path, '/'); there && end && end > path; end = memrchr(path, '/', (size_t)(end - path))) {
		*end = 0;
		there = stat(path, st);
		*end = '/';
		*ret_member = end + 1;
	}
	return there || !S_ISREG(st->st_mode) ? -1 : 0;
}

static int add(struct manifest *m, char *text, uint64_t number, struct err *err)
{
	struct line line = {0};
	struct stat st;
	char *name, *path, *member = NULL;
	int there;

	if (!split(text, line.sum, &name)) {
		err_set(err, ERR_INPUT,
			"no line of a list of SHA-256 sums: a sum of 64 hexadecimal digits and a name are wanted");
		err_add_place(err, number, "line");
		err_add_hint(err, "sha256sum writes such lists");
		return err_add_file(err, m->path);
	}
	if (asprintf(&path, "%s%s", *name == '/' ? "" : m->folder, name) < 0)
		return err_set(err, ERR_NOMEM, "no memory for a name");
	there = stat(path, &st);
	if (there && errno == ENOTDIR)
		there = find_archive(path, &st, &member);
	line.member = !there && member ? strdup(member) : NULL;
	free(path);
	/* A file that does not exist cannot be an input. */
	if (there)
		return 0;
	if (member && !line.member)
		return err_set(err, ERR_NOMEM, "no memory for a list of sums");
	if (m->n == m->room) {
		size_t room = m->room ? 2 * m->room : 64;
		void *grown = realloc(m->line, room * sizeof(*m->line));

		if (!grown) {
			free(line.member);
			return err_set(err, ERR_NOMEM, "no memory for a list of sums");
		}
		m->line = grown;
		m->room = room;
	}
	line.dev = st.st_dev;
	line.ino = st.st_ino;
	m->line[m->n++] = line;
	return 0;
}

static int by_file(const void *a, const void *b)
{
	const struct line *x = a, *y = b;

	if (x->dev != y->dev)
		return x->dev < y->dev ? -1 : 1;
	if (x->ino != y->ino)
		return x->ino < y->ino ? -1 : 1;
	return strcmp(x->member ? x->member : "", y->member ? y->member : "");
}

static int read_list(struct manifest *m, struct err *err)
{
	FILE *f = fopen(m->path, "re");
	uint64_t number = 0;
	char *text = NULL;
	size_t room = 0;
	ssize_t n;
	int r = 0;

	if (!f) {
		err_set(err, errno == EACCES ? ERR_PERM : ERR_INPUT, "it cannot be opened: %s", strerror(errno));
		return err_add_file(err, m->path);
	}
	while (!r && (n = getline(&text, &room, f)) >= 0) {
		number++;
		while (n && (text[n - 1] == '\n' || text[n - 1] == '\r'))
			text[--n] = 0;
		if (n && text[0] != '#')
			r = add(m, text, number, err);
	}
	if (!r && ferror(f)) {
		err_sys(err, errno, "it cannot be read");
		r = err_add_file(err, m->path);
	}
	free(text);
	fclose(f);
	if (m->n)
		qsort(m->line, m->n, sizeof(*m->line), by_file);
	return r;
}

/* ---- the inputs ---- */

/* The sum of all bytes. */
static int sum_of(struct session *session, int fd, unsigned char sum[SUM], struct err *err)
{
	struct sha256_ctx sha;
	void *piece = malloc(PIECE);
	ssize_t n = 1;

	sha256_init(&sha);
	if (!piece)
		err_set(err, ERR_NOMEM, "no memory to add up a file");
	while (n && !err->code) {
		n = read(fd, piece, PIECE);
		if (n < 0 && errno == EINTR)
			continue;
		if (n < 0)
			err_sys(err, errno, "it cannot be read");
		else if (session_interrupted(session))
			err_set(err, ERR_CANCELLED, "interrupted");
		else
			sha256_update(&sha, (size_t)n, piece);
	}
	sha256_digest(&sha, SUM, sum);
	free(piece);
	return -(int)err->code;
}

static void hex(const unsigned char sum[SUM], char text[2 * SUM + 1])
{
	for (int i = 0; i < SUM; i++)
		snprintf(text + 2 * i, 3, "%02x", sum[i]);
}

static struct line key_of(dev_t dev, ino_t ino, const char *member)
{
	return (struct line){.dev = dev, .ino = ino, .member = (char *)member};
}

/* Every line about this file must agree. */
static int compare(const struct manifest *m, const struct line *key, const unsigned char sum[SUM], struct err *err)
{
	const struct line *at = m->n ? bsearch(key, m->line, m->n, sizeof(*key), by_file) : NULL;
	char is[2 * SUM + 1], want[2 * SUM + 1];

	while (at && at > m->line && !by_file(at - 1, key))
		at--;
	for (; at && at < m->line + m->n && !by_file(at, key); at++) {
		if (!memcmp(at->sum, sum, SUM))
			continue;
		hex(sum, is);
		hex(at->sum, want);
		err_set(err, ERR_INPUT, "its SHA-256 is %s, but %.200s has %s", is, m->path, want);
		return err_add_hint(err, "copy it again from where it comes from");
	}
	return 0;
}

static bool listed(const struct manifest *m, const struct line *key)
{
	return m->n && bsearch(key, m->line, m->n, sizeof(*key), by_file);
}

static int unlisted(const struct manifest *m, struct err *err)
{
	err_set(err, ERR_INPUT, "%.200s does not list it", m->path);
	return err_add_hint(err, "names in it are relative to its folder");
}

/* Its sum, and that it was the same file before and after. */
static int sum_still(struct session *session, int fd, const struct stat *before, unsigned char sum[SUM], struct err *err)
{
	struct stat after;
	int r = sum_of(session, fd, sum, err);

	if (!r && (fstat(fd, &after) || after.st_size != before->st_size || after.st_mtim.tv_sec != before->st_mtim.tv_sec ||
		   after.st_mtim.tv_nsec != before->st_mtim.tv_nsec))
		r = err_set(err, ERR_CHANGED, "the file changed while it was read");
	return r;
}

/* By the archive's own line; its sum is taken once. */
static int check_archive(const struct manifest *m, struct ctl_archive *a, struct err *err)
{
	const struct line key = key_of(a->file.dev, a->file.ino, NULL);
	struct stat st;
	int fd, r = 0;

	if (!listed(m, &key))
		return unlisted(m, err);
	if (!a->summed) {
		r = ctl_input_open(m->in, &a->file, &fd, err);
		if (r)
			return r;
		if (fstat(fd, &st) || !ctl_input_unchanged(&a->file, &st))
			r = err_set(err, ERR_CHANGED, "the archive has changed since it was examined");
		if (!r)
			r = sum_still(m->in->session, fd, &st, a->sum, err);
		io_close(fd);
		a->summed = !r;
	}
	return r ? r : compare(m, &key, a->sum, err);
}

static int check_file(const struct manifest *m, struct ctl_input *in, int fd, const struct line *member, struct err *err)
{
	unsigned char sum[SUM];
	struct stat st;
	struct line key;

	if (fstat(fd, &st))
		return err_sys(err, errno, "it cannot be examined");
	key = member ? *member : key_of(st.st_dev, st.st_ino, NULL);
	if (!listed(m, &key))
		return unlisted(m, err);
	if (sum_still(m->in->session, fd, &st, sum, err) || compare(m, &key, sum, err))
		return -(int)err->code;
	in->verified = true;
	if (!member)
		ctl_input_see(in, &st);
	return 0;
}

static int check_input(const struct manifest *m, struct ctl_input *in, struct err *err)
{
	struct ctl_archive *a = in->archive;
	struct line key = {0};
	int fd, r;

	if (in->fd >= 0) {
		err_set(err, ERR_USAGE, "input from a pipe cannot be compared with a list of sums");
		return err_add_file(err, in->name);
	}
	if (a && !a->why.code)
		key = key_of(a->file.dev, a->file.ino, a->member[in->member].name);
	if (a && (!key.member || !listed(m, &key))) {
		r = check_archive(m, a, err);
		in->verified = !r;
	} else {
		r = ctl_input_open(m->in, in, &fd, err);
		if (!r) {
			r = check_file(m, in, fd, a ? &key : NULL, err);
			io_close(fd);
		}
	}
	return r ? err_add_file(err, in->name) : 0;
}

/* The first one is the error; it names the others. */
static void also(struct err *first, const char *name, size_t n)
{
	char hint[sizeof(first->hint)];

	if (n == 1)
		snprintf(hint, sizeof(hint), "these do not agree either: %s", name);
	else if (n <= NAMED_MOST)
		snprintf(hint, sizeof(hint), "%.*s, %s", (int)sizeof(hint) - 100, first->hint, name);
	else
		return;
	first->hint[0] = 0;
	err_add_hint(first, "%s", hint);
}

int ctl_manifest_check(struct ctl_inputs *in, struct err *err)
{
	struct manifest m = {.in = in, .path = in->opt->manifest};
	const char *slash = strrchr(m.path, '/');
	size_t bad = 0;
	int r;

	m.folder = strndup(m.path, slash ? (size_t)(slash - m.path) + 1 : 0);
	if (!m.folder)
		return err_set(err, ERR_NOMEM, "no memory for a name");
	r = read_list(&m, err);
	for (size_t i = 0; !r && i < in->n; i++) {
		struct err one = ERR_INIT;

		if (!check_input(&m, &in->input[i], &one))
			continue;
		if (!bad++)
			*err = one;
		else
			also(err, in->input[i].name, bad - 1);
		/* Other errors are not about this file. */
		r = one.code == ERR_INPUT || one.code == ERR_CHANGED ? 0 : -(int)one.code;
	}
	for (size_t i = 0; i < m.n; i++)
		free(m.line[i].member);
	free(m.line);
	free(m.folder);
	return bad ? -(int)err->code : r;
}
