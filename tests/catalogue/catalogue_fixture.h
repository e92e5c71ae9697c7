/* A folder for the catalogue of a test: setup and teardown of cmocka. */
#ifndef CATALOGUE_FIXTURE_H
#define CATALOGUE_FIXTURE_H

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "repeat.h"

static char folder[64], path[128];

static int setup(void **state)
{
	repeat_folder(folder, sizeof folder, "catalogue");
	snprintf(path, sizeof path, "%s/catalogue.db", folder);
	return 0;
}

static int teardown(void **state)
{
	static const char *const more[] = {"", "-wal", "-shm"};
	char name[160];

	for (int i = 0; i < 3; i++) {
		snprintf(name, sizeof name, "%s%s", path, more[i]);
		unlink(name);
	}
	return rmdir(folder);
}

#endif
