/* FOLDER TASKS: a work folder whose tasks of the phase mesh have not begun. */
#include <stdio.h>
#include <stdlib.h>

#include "err.h"
#include "work.h"

int main(int argc, char **argv)
{
	static const char *const word[] = {"mesh"};
	struct work_about about = {.id = 1, .memory = 64 << 20, .word = word, .nword = 1};
	struct err err = ERR_INIT;
	struct work *work = NULL;
	char text[1024];

	if (argc != 3)
		return 64;
	about.tasks[WORK_MESH] = (uint32_t)atoi(argv[2]);
	if (work_make(argv[1], &about, NULL, 0, &work, &err)) {
		fprintf(stderr, "%s\n", err_format(&err, text, sizeof(text)));
		return 1;
	}
	work_close(work);
	return 0;
}
