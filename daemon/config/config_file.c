/*
 * The files of the configuration: FILE, then FILE.d/NAME.conf in the order of their names. Lines are `key = value`. Every error
 * is reported with file and line, and nothing is guessed. If a key is set more than once, the last value holds.
 *
 * Files are small and read as a whole. The reader of the text does not know of files, so tests can pass any bytes.
 */
#include "config_file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "config.h"
#include "config_report.h"
#include "err.h"

enum { FILE_MOST = 64 << 10, FILES_MOST = 256, LINE_MOST = 2048 };

struct file_reader {
	const char *path;
	unsigned line;
	struct config *to;
	struct config_report *report;
	unsigned set[CONFIG_SETTINGS]; /* line of this file that set it */
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
	config_report_error(r->report, &err);
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
static const char *nearest(const char *name)
{
	unsigned best = UINT32_MAX, d;
	const char *found = NULL;

	if (strlen(name) > 64)
		return NULL;
	name += strspn(name, "-");
	for (int i = 0; i < CONFIG_SETTINGS; i++) {
		d = distance(name, config_settings[i].name);
		if (d < best && config_settings[i].scope != CONFIG_LINE) {
			best = d;
			found = config_settings[i].name;
		}
	}
	return best <= 1 + strlen(name) / 3 ? found : NULL;
}

static int find_setting(const char *name)
{
	for (int i = 0; i < CONFIG_SETTINGS; i++)
		if (!strcmp(name, config_settings[i].name))
			return i;
	return -1;
}

static void report_unknown(struct file_reader *r, const char *name)
{
	const char *near = nearest(name);
	char hint[96];

	if (near)
		snprintf(hint, sizeof hint, "is %s meant?", near);
	else
		snprintf(hint, sizeof hint, "acutd --help and acutd.conf(5) list the settings");
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

static void reset_setting(struct file_reader *r, int id)
{
	const struct config_setting *s = &config_settings[id];
	struct config presets;

	config_presets(&presets);
	config_value_copy(s, &presets, r->to);
	r->to->origin[id] = (struct config_origin){.by = CONFIG_BY_DEFAULT};
}

static void set_value(struct file_reader *r, int id, const char *value)
{
	const struct config_setting *s = &config_settings[id];
	const char *wanted;

	if (r->set[id]) {
		struct err err = ERR_INIT;
		char place[sizeof err.file];

		location_text(r, place, sizeof place);
		err_set(&err, ERR_USAGE, "%s was set in line %u already; this line holds", s->name, r->set[id]);
		err_add_file(&err, place);
		config_report_warning(r->report, &err);
	}
	r->set[id] = r->line;
	if (!*value) {
		reset_setting(r, id);
		return;
	}
	if (s->type == CONFIG_TYPE_PATH && *value != '/') {
		report_error(r, "begin it with /: a service has no folder of its own to start from",
			     "%s = %.100s is not an absolute path", s->name, value);
		return;
	}
	if (!config_value_parse(s, value, r->to, &wanted)) {
		report_error(r, NULL, "%s = %.100s: %s is wanted", s->name, value, wanted);
		return;
	}
	r->to->origin[id] = (struct config_origin){.by = CONFIG_BY_FILE, .line = r->line};
	snprintf(r->to->origin[id].file, sizeof r->to->origin[id].file, "%s", r->path);
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
	if (find_setting(first) >= 0)
		snprintf(hint, sizeof hint, "write %s = VALUE", first);
	else
		snprintf(hint, sizeof hint, "a line is \"key = value\", or a comment that begins with #");
	report_error(r, hint, "there is no \"=\" in \"%.60s\"", line);
}

static void read_line(struct file_reader *r, char *line)
{
	char *key = trim(line), *value;
	int id;

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
	id = find_setting(key);
	if (id < 0)
		report_unknown(r, key);
	else if (config_settings[id].scope == CONFIG_LINE)
		report_error(r, "leave it out", "%s is an option of the command line, not of a file", key);
	else
		set_value(r, id, value);
}

void config_text(const char *path, const char *text, size_t n, struct config *to, struct config_report *report)
{
	struct file_reader r = {.path = path, .to = to, .report = report};
	char line[LINE_MOST];
	const char *at = text, *end = text + n;

	if (n >= 3 && !memcmp(at, "\xef\xbb\xbf", 3)) /* a byte order mark, which some editors write */
		at += 3;
	while (at < end) {
		const char *stop = memchr(at, '\n', (size_t)(end - at));
		size_t length = (size_t)((stop ? stop : end) - at);

		r.line++;
		if (memchr(at, 0, length)) {
			report_error(&r, "write it again as plain text", "there is a zero byte in it");
			return;
		}
		if (length >= sizeof line) {
			report_error(&r, NULL, "a line of %zu bytes is too long, %d are the most", length, LINE_MOST - 1);
		} else {
			memcpy(line, at, length);
			line[length] = 0;
			read_line(&r, line);
		}
		at = stop ? stop + 1 : end;
	}
}

/* ---- files ---- */

static void report_unreadable(const char *path, struct config_report *report, int sys, const char *hint)
{
	struct err err = ERR_INIT;

	err_set(&err, ERR_USAGE, "it cannot be read: %s", strerror(sys));
	err_add_file(&err, path);
	if (hint)
		err_add_hint(&err, "%s", hint);
	config_report_error(report, &err);
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

static void read_fd(const char *path, int fd, struct config *to, struct config_report *report)
{
	struct file_reader r = {.path = path, .to = to, .report = report};
	struct stat st;
	char *text;
	ssize_t n;

	if (fstat(fd, &st) != 0) {
		report_unreadable(path, report, errno, NULL);
		return;
	}
	if (!S_ISREG(st.st_mode)) {
		report_error(&r, "put a plain text file there, or remove it", "this is not a regular file");
		return;
	}
	text = malloc(FILE_MOST + 1);
	n = text ? read_whole(fd, text, FILE_MOST + 1) : -1;
	if (!text || n < 0)
		report_unreadable(path, report, text ? errno : ENOMEM, NULL);
	else if (n > FILE_MOST)
		report_error(&r, "is it a configuration at all?", "it is larger than %d KiB", FILE_MOST >> 10);
	else
		config_text(path, text, (size_t)n, to, report);
	free(text);
}

bool config_file(const char *path, bool must, struct config *to, struct config_report *report)
{
	/* O_NONBLOCK: a pipe or device must not block. */
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);

	if (fd < 0) {
		if (errno == ENOENT && !must)
			return false;
		report_unreadable(path, report, errno,
				  errno == ENOENT ? "make it, or leave --config out" :
						    "the user that acutd runs as must be able to read it");
		return true;
	}
	read_fd(path, fd, to, report);
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

void config_folder(const char *path, struct config *to, struct config_report *report)
{
	struct file_reader r = {.path = path, .to = to, .report = report};
	struct dirent **list = NULL;
	char file[CONFIG_PATH_SIZE];
	int n = scandir(path, &list, is_drop_in, compare_names);

	if (n < 0) {
		if (errno != ENOENT)
			report_unreadable(path, report, errno, "the user that acutd runs as must be able to read the folder");
		return;
	}
	if (n > FILES_MOST)
		report_error(&r, NULL, "there are %d files in it, %d are the most", n, FILES_MOST);
	for (int i = 0; i < n; i++) {
		if (n <= FILES_MOST && (size_t)snprintf(file, sizeof file, "%s/%s", path, list[i]->d_name) < sizeof file)
			config_file(file, true, to, report);
		else if (n <= FILES_MOST)
			report_error(&r, "use shorter names", "the path of %.100s is too long", list[i]->d_name);
		free(list[i]);
	}
	free(list);
}
