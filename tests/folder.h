/* The folder of a test program, and what is in the folders that tests write. Included after the headers of cmocka. */
#ifndef FOLDER_H
#define FOLDER_H

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "repeat.h"

/* While folder_run runs: a folder, and the name "out" in it. */
static char folder_own[64], folder_out[80];

static inline char *folder_path(const char *name, char ret[512])
{
	snprintf(ret, 512, "%s/%s", folder_own, name);
	return ret;
}

static inline int folder_begin(void **state)
{
	repeat_folder(folder_own, sizeof folder_own, "test");
	snprintf(folder_out, sizeof folder_out, "%s/out", folder_own);
	return 0;
}

static inline int folder_end(void **state)
{
	return repeat_remove(folder_own);
}

/* Runs an array of tests, with a folder that is removed then; the status of the program. */
#define folder_run(tests) cmocka_run_group_tests(tests, folder_begin, folder_end)

/* Entries of a folder, hidden ones, too; -1: there is no such folder. */
static inline int folder_count(const char *path)
{
	DIR *d = opendir(path);
	struct dirent *e;
	int n = 0;

	if (!d)
		return -1;
	while ((e = readdir(d)))
		n += strcmp(e->d_name, ".") && strcmp(e->d_name, "..");
	closedir(d);
	return n;
}

/* The bytes of a file and a zero, to be freed. */
static inline char *folder_file(const char *path, size_t *ret_size)
{
	FILE *f = fopen(path, "rb");
	char *text;

	assert_non_null(f);
	fseek(f, 0, SEEK_END);
	*ret_size = (size_t)ftell(f);
	rewind(f);
	text = calloc(1, *ret_size + 1);
	assert_int_equal(fread(text, 1, *ret_size, f), *ret_size);
	fclose(f);
	return text;
}

static inline char *folder_read(const char *folder, const char *name, size_t *ret_size)
{
	char path[1024];

	snprintf(path, sizeof(path), "%s/%s", folder, name);
	return folder_file(path, ret_size);
}

/* The folders have the same files, of the same bytes, and no folders. */
static inline void folder_same(const char *a, const char *b)
{
	DIR *d = opendir(a);
	struct dirent *e;

	assert_non_null(d);
	assert_int_equal(folder_count(a), folder_count(b));
	while ((e = readdir(d))) {
		size_t na, nb;
		char *ta, *tb;

		if (!strcmp(e->d_name, ".") || !strcmp(e->d_name, ".."))
			continue;
		ta = folder_read(a, e->d_name, &na);
		tb = folder_read(b, e->d_name, &nb);
		assert_int_equal(na, nb);
		assert_memory_equal(ta, tb, na);
		free(ta);
		free(tb);
	}
	closedir(d);
}

#endif
