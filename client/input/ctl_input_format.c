/* Formats of inputs: the table that the daemon's readers have, for help, completion and the search of folders. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "ctl_input_priv.h"

const struct ctl_input_format ctl_input_formats[] = {
#define INPUT_FORMAT(name, title, extensions, folders, help) {#name, extensions, help, folders},
#include "input_format.def"
#undef INPUT_FORMAT
	{0},
};

const struct ctl_input_format ctl_input_archives[] = {
	{"gz", ".gz", "a file packed by gzip: unpacked, then read by its own format"},
	{"zip", ".zip", "an archive: each survey file in it is unpacked and read by its own format"},
	{0},
};

/* Whether `is` accepts one of the words of ".las .laz". */
static bool any_extension(const char *list, bool (*is)(const char *extension, size_t n, const char *text, size_t size),
			  const char *text, size_t size)
{
	for (const char *at = list; *at; at += strspn(at, " ")) {
		size_t n = strcspn(at, " ");

		if (is(at, n, text, size))
			return true;
		at += n;
	}
	return false;
}

static bool ends_name(const char *extension, size_t n, const char *name, size_t size)
{
	return size > n && name[size - n - 1] != '/' && !strncasecmp(name + size - n, extension, n);
}

static bool is_word(const char *extension, size_t n, const char *word, size_t size)
{
	return size == n - 1 && !memcmp(extension + 1, word, size);
}

bool ctl_input_is_survey(const char *name, size_t n)
{
	for (const struct ctl_input_format *f = ctl_input_formats; f->name; f++)
		if (any_extension(f->folders, ends_name, name, n))
			return true;
	return false;
}

const struct ctl_input_format *ctl_input_format_of(const char *word)
{
	for (const struct ctl_input_format *f = ctl_input_formats; f->name; f++)
		if (!strcmp(f->name, word) || any_extension(f->extensions, is_word, word, strlen(word)))
			return f;
	return NULL;
}

char *ctl_input_endings(char *buf, size_t size)
{
	size_t n = 0;

	for (const struct ctl_input_format *f = ctl_input_formats; f->name && n < size; f++)
		n += (size_t)snprintf(buf + n, size - n, "%s%s", n ? " " : "", f->folders);
	return buf;
}
