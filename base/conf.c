/*
 * Files of settings: FILE, then FILE.d/NAME.conf in the order of their names. Lines are `key = value`. Every error is reported
 * with file and line, and nothing is guessed. If a key is set more than once, the last value holds.
 *
 * Files are small and read as a whole. The reader of the text does not know of files, so tests can pass any bytes. What a key
 * means, and whether a value is good, only the program knows (struct conf).
 */
#include "conf.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"

enum { FILE_MOST = 64 << 10, FILES_MOST = 256, LINE_MOST = 2048, PATH_SIZE = 512 };

struct file_reader {
	const struct conf *conf;
	const char *path;
	unsigned line;
	unsigned *set; /* for each setting, the line of this file that set it */
};

/* "FILE:LINE", with the end of a long path. */
static void location_text(const struct file_reader *r, char *buf, size_t size)
{
	size_t n = strlen(r->path), room = size - 16;

	if (r->line)
		snprintf(buf, size, "%s%s:%u", n > room ? "..." : "", r->path + (n > room ? n - room + 3 : 0), r->line);
	else
		snprintf(buf, size, "%s%s", n > room ? "..." : "", r->path + (n > room ? n - room + 3 : 0));
}

/* `hint` may be NULL. */
__attribute__((format(printf, 3, 4))) static void report_error(struct file_reader *r, const char *hint, const char *fmt, ...)
{
	struct err err = ERR_INIT;
	char place[sizeof err.file], text[sizeof err.message];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	location_text(r, place, sizeof place);
	err_set(&err, ERR_USAGE, "%s", text);
	err_add_file(&err, place);
	if (hint)
		err_add_hint(&err, "%s", hint);
	r->conf->report(r->conf->ctx, false, &err);
}

/* ---- names ---- */

static char plain(char c)
{
	return c == '_' ? '-' : c >= 'A' && c <= 'Z' ? (char)(c - 'A' + 'a') : c;
}

/* Levenshtein distance. UINT32_MAX: b is longer than 31 letters. */
static unsigned distance(const char *a, const char *b)
{
	unsigned row[32], n = (unsigned)strlen(b);

	if (n > 31)
		return UINT32_MAX;
	for (unsigned j = 0; j <= n; j++)
		row[j] = j;
	for (unsigned i = 1; *a; a++, i++) {
		unsigned above = row[0]; /* to the left, too */

		row[0] = i;
		for (unsigned j = 1; j <= n; j++) {
			unsigned change = above + (plain(*a) != b[j - 1]);

			above = row[j];
			row[j] = row[j] + 1 < change ? row[j] + 1 : change;
			if (row[j - 1] + 1 < row[j])
				row[j] = row[j - 1] + 1;
		}
	}
	return row[n];
}

/* The setting with the most similar name; NULL: none is similar. */
static const char *nearest(const struct conf *c, const char *name)
{
	unsigned best = UINT32_MAX, d;
	const char *found = NULL;

	if (strlen(name) > 64)
		return NULL;
	name += strspn(name, "-");
	for (size_t i = 0; i < c->n; i++) {
		d = distance(name, c->name(i));
		if (d < best && c->in_file(i)) {
			best = d;
			found = c->name(i);
		}
	}
	return best <= 1 + strlen(name) / 3 ? found : NULL;
}

/* c->n: there is none. */
static size_t find_setting(const struct conf *c, const char *name)
{
	size_t i = 0;

	while (i < c->n && strcmp(name, c->name(i)))
		i++;
	return i;
}

static void report_unknown(struct file_reader *r, const char *name)
{
	const char *near = nearest(r->conf, name);
	char hint[96];

	if (near)
		snprintf(hint, sizeof hint, "is %s meant?", near);
	else
		snprintf(hint, sizeof hint, "%s", r->conf->manual);
	report_error(r, hint, "there is no setting \"%.60s\"", name);
}

/* ---- lines ---- */

static bool is_blank(char c)
{
	return c == ' ' || c == '\t' || c == '\r' || c == '\f' || c == '\v';
}

static char *trim(char *text)
{
	size_t n;

	while (is_blank(*text))
		text++;
	for (n = strlen(text); n && is_blank(text[n - 1]); n--)
		;
	text[n] = 0;
	return text;
}

/* Removes the quotes of a value. False: they are wrong, which was reported. */
static bool unquote(struct file_reader *r, char **value)
{
	char *v = *value, quote = *v;
	size_t n = strlen(v);

	if (quote == '"' || quote == '\'') {
		if (n < 2 || v[n - 1] != quote || memchr(v + 1, quote, n - 2)) {
			report_error(r, "a value in quotes ends with the quote that it began with",
				     "the quotes of %.100s do not pair", v);
			return false;
		}
		v[n - 1] = 0;
		*value = v + 1;
		return true;
	}
	for (size_t i = 1; i < n; i++)
		if ((v[i] == '#' || v[i] == ';') && is_blank(v[i - 1])) {
			report_error(r, "a comment stands on a line of its own; a value with such a character stands in quotes",
				     "there is a comment behind the value: %.100s", v);
			return false;
		}
	if (n && v[n - 1] == '\\') {
		report_error(r, "write it on one line", "a value does not go on in the next line");
		return false;
	}
	return true;
}

static void set_value(struct file_reader *r, size_t id, const char *value)
{
	char place[sizeof((struct err *)0)->file];
	struct err err = ERR_INIT;

	location_text(r, place, sizeof place);
	if (r->set[id]) {
		err_set(&err, ERR_USAGE, "%s was set in line %u already; this line holds", r->conf->name(id), r->set[id]);
		err_add_file(&err, place);
		r->conf->report(r->conf->ctx, true, &err);
		err_clear(&err);
	}
	r->set[id] = r->line;
	if (!r->conf->set(r->conf->ctx, id, value, r->path, r->line, &err))
		return;
	err_add_file(&err, place);
	r->conf->report(r->conf->ctx, false, &err);
}

static void report_no_value(struct file_reader *r, const char *line)
{
	char first[32], hint[96];
	size_t n = strcspn(line, " \t:");

	if (*line == '[') {
		report_error(r, "leave this line out", "there are no sections here: %.60s", line);
		return;
	}
	snprintf(first, sizeof first, "%.*s", (int)n, line);
	if (find_setting(r->conf, first) < r->conf->n)
		snprintf(hint, sizeof hint, "write %s = VALUE", first);
	else
		snprintf(hint, sizeof hint, "a line is \"key = value\", or a comment that begins with #");
	report_error(r, hint, "there is no \"=\" in \"%.60s\"", line);
}

static void read_line(struct file_reader *r, char *line)
{
	char *key = trim(line), *value;
	size_t id;

	if (!*key || *key == '#' || *key == ';')
		return;
	value = strchr(key, '=');
	if (!value) {
		report_no_value(r, key);
		return;
	}
	*value++ = 0;
	key = trim(key);
	value = trim(value);
	if (!unquote(r, &value))
		return;
	id = find_setting(r->conf, key);
	if (id == r->conf->n)
		report_unknown(r, key);
	else if (!r->conf->in_file(id))
		report_error(r, "leave it out", "%s is an option of the command line, not of a file", key);
	else
		set_value(r, id, value);
}

static void read_text(struct file_reader *r, const char *text, size_t n)
{
	char line[LINE_MOST];
	const char *at = text, *end = text + n;

	if (n >= 3 && !memcmp(at, "\xef\xbb\xbf", 3)) /* a byte order mark, which some editors write */
		at += 3;
	while (at < end) {
		const char *stop = memchr(at, '\n', (size_t)(end - at));
		size_t length = (size_t)((stop ? stop : end) - at);

		r->line++;
		if (memchr(at, 0, length)) {
			report_error(r, "write it again as plain text", "there is a zero byte in it");
			return;
		}
		if (length >= sizeof line) {
			report_error(r, NULL, "a line of %zu bytes is too long, %d are the most", length, LINE_MOST - 1);
		} else {
			memcpy(line, at, length);
			line[length] = 0;
			read_line(r, line);
		}
		at = stop ? stop + 1 : end;
	}
}

void conf_text(const struct conf *c, const char *path, const char *text, size_t n)
{
	struct file_reader r = {.conf = c, .path = path, .set = calloc(c->n + 1, sizeof *r.set)};

	if (r.set)
		read_text(&r, text, n);
	else
		report_error(&r, NULL, "there is no memory to read it");
	free(r.set);
}

/* ---- files ---- */

static void report_unreadable(const struct conf *c, const char *path, int sys, const char *hint)
{
	struct err err = ERR_INIT;

	err_set(&err, ERR_USAGE, "it cannot be read: %s", strerror(sys));
	err_add_file(&err, path);
	if (hint)
		err_add_hint(&err, "%s", hint);
	c->report(c->ctx, false, &err);
}

/* Reads until the end of the file, or `size` bytes. */
static ssize_t read_whole(int fd, char *buf, size_t size)
{
	size_t have = 0;

	while (have < size) {
		ssize_t n = read(fd, buf + have, size - have);

		if (n < 0 && errno == EINTR)
			continue;
		if (n < 0)
			return -1;
		if (n == 0)
			break;
		have += (size_t)n;
	}
	return (ssize_t)have;
}

static void read_fd(const struct conf *c, const char *path, int fd)
{
	struct file_reader r = {.conf = c, .path = path};
	struct stat st;
	char *text;
	ssize_t n;

	if (fstat(fd, &st) != 0) {
		report_unreadable(c, path, errno, NULL);
		return;
	}
	if (!S_ISREG(st.st_mode)) {
		report_error(&r, "put a plain text file there, or remove it", "this is not a regular file");
		return;
	}
	text = malloc(FILE_MOST + 1);
	n = text ? read_whole(fd, text, FILE_MOST + 1) : -1;
	if (!text || n < 0)
		report_unreadable(c, path, text ? errno : ENOMEM, NULL);
	else if (n > FILE_MOST)
		report_error(&r, "is it a configuration at all?", "it is larger than %d KiB", FILE_MOST >> 10);
	else
		conf_text(c, path, text, (size_t)n);
	free(text);
}

bool conf_file(const struct conf *c, const char *path, bool must)
{
	/* O_NONBLOCK: a pipe or device must not block. */
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);

	if (fd < 0) {
		if (errno == ENOENT && !must)
			return false;
		report_unreadable(c, path, errno, errno == ENOENT ? "make it, or leave --config out" : c->reader);
		return true;
	}
	read_fd(c, path, fd);
	close(fd);
	return true;
}

static int is_drop_in(const struct dirent *e)
{
	size_t n = strlen(e->d_name);

	return n > 5 && e->d_name[0] != '.' && !strcmp(e->d_name + n - 5, ".conf");
}

static int compare_names(const struct dirent **a, const struct dirent **b)
{
	return strcmp((*a)->d_name, (*b)->d_name);
}

void conf_folder(const struct conf *c, const char *path)
{
	struct file_reader r = {.conf = c, .path = path};
	struct dirent **list = NULL;
	char file[PATH_SIZE];
	int n = scandir(path, &list, is_drop_in, compare_names);

	if (n < 0) {
		if (errno != ENOENT)
			report_unreadable(c, path, errno, c->reader);
		return;
	}
	if (n > FILES_MOST)
		report_error(&r, NULL, "there are %d files in it, %d are the most", n, FILES_MOST);
	for (int i = 0; i < n; i++) {
		if (n <= FILES_MOST && (size_t)snprintf(file, sizeof file, "%s/%s", path, list[i]->d_name) < sizeof file)
			conf_file(c, file, true);
		else if (n <= FILES_MOST)
			report_error(&r, "use shorter names", "the path of %.100s is too long", list[i]->d_name);
		free(list[i]);
	}
	free(list);
}
