/*
 * Broken, degenerate and odd files, one by one: what the reader does with each is written down in
 * malformed.tbl, and a file without a row is a failure. Memory and time are bounded for each.
 */
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "account.h"
#include "clock.h"
#include "fixture.h"

enum { ROWS = 400, NAME = 80, BATCH = 500, BATCH_BYTES = BATCH * (24 + 3) };

struct row {
	char file[NAME], options[16], outcome[32], offset[32], field[NAME];
	unsigned long long points;
};

static struct row rows[ROWS];
static size_t n_rows;
static int failures;

static void read_table(const char *path)
{
	char line[512];
	FILE *f = fopen(path, "r");

	if (!f) {
		printf("cannot open %s\n", path);
		exit(1);
	}
	while (fgets(line, sizeof line, f)) {
		struct row *r = &rows[n_rows];

		if (line[0] == '#' || line[0] == '\n')
			continue;
		if (n_rows == ROWS || sscanf(line, "%79s %15s %31s %31s %79s %llu", r->file, r->options, r->outcome, r->offset,
					     r->field, &r->points) != 6) {
			printf("%s: cannot read the row: %s", path, line);
			exit(1);
		}
		for (char *p = r->field; *p; p++)
			*p = *p == '_' ? ' ' : *p;
		n_rows++;
	}
	fclose(f);
}

static void compare(const struct row *row, const struct outcome *out)
{
	const char *outcome = out->code ? err_wire_name(out->code) : "ok";
	char offset[32] = "-";

	if (out->code && out->err.offset != ERR_NO_OFFSET)
		snprintf(offset, sizeof offset, "%llu", (unsigned long long)out->err.offset);
	if (!strcmp(row->outcome, outcome) && !strcmp(row->offset, offset) && row->points == out->points &&
	    !strcmp(row->field, out->code ? out->err.field : "-") && (!out->code || out->err.message[0]))
		return;
	failures++;
	printf("%s (%s): %s %s %s %llu; expected %s %s %s %llu; %s\n", row->file, row->options, outcome, offset, out->err.field,
	       (unsigned long long)out->points, row->outcome, row->offset, row->field, row->points,
	       out->code ? out->err.message : out->info.warning);
}

static void check_row(const char *folder, const struct row *row)
{
	struct input_options options = {
		.accept_truncated = strchr(row->options, 't'), /* --accept-truncated */
		.planar = strchr(row->options, 'p'),           /* --planar */
	};
	char path[4400];
	struct outcome out;
	struct stat st;
	int fd;

	snprintf(path, sizeof path, "%s/malformed/%s", folder, row->file);
	fd = open(path, O_RDONLY | O_CLOEXEC);
	if (fd < 0) {
		printf("cannot open %s\n", path);
		failures++;
		return;
	}
	account_begin();
	out = fixture_read_fd(fd, path, &options, BATCH);
	/* Work and memory follow from the file's size, not from what it claims: read it twice at most, in the
	 * memory that the input says. */
	if (fstat(fd, &st) || account_read() > 3 * (uint64_t)st.st_size + (1 << 20) ||
	    account_taken() > input_bytes() + out.info.read_bytes + BATCH_BYTES) {
		printf("%s: %llu bytes read, %zu bytes of memory\n", row->file, (unsigned long long)account_read(),
		       account_taken());
		failures++;
	}
	compare(row, &out);
	close(fd);
}

/* Every file of the folder has a row. */
static void check_folder(const char *folder, const char *prefix)
{
	char path[4400];
	struct dirent *e;
	DIR *dir;

	snprintf(path, sizeof path, "%s/malformed/%s", folder, prefix);
	dir = opendir(path);
	while (dir && (e = readdir(dir))) {
		char name[512];
		size_t i = 0;

		if (e->d_name[0] == '.' || e->d_type == DT_DIR)
			continue;
		snprintf(name, sizeof name, "%s%s", prefix, e->d_name);
		while (i < n_rows && strcmp(rows[i].file, name))
			i++;
		if (i == n_rows) {
			printf("%s has no row in malformed.tbl\n", name);
			failures++;
		}
	}
	if (dir)
		closedir(dir);
	else
		failures++;
}

int main(int argc, char **argv)
{
	const char *folder = fixture_data();

	if (argc < 2)
		return 1;
	read_table(argv[1]);
	if (!*folder)
		return 77;
	for (size_t i = 0; i < n_rows; i++)
		check_row(folder, &rows[i]);
	check_folder(folder, "");
	check_folder(folder, "derived/");
	printf("%zu rows, %d failures\n", n_rows, failures);
	return failures != 0;
}
