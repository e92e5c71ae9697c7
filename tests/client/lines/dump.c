/*
 * acut-lines-dump FILE [--csv] [--layer NAME] [--kind-field NAME]: the features of a file of lines, for tests that compare them
 * with what other programs read. A line for each feature: layer, geometry, kind, state, reason; then one for each of its lines:
 * "open" or "ring" and the coordinates. Tabs separate.
 */
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "lines.h"

static void print(const struct lines_feature *f)
{
	static const char *const states[] = {"usable", "empty", "no-line", "refused"};

	printf("%s\t%s\t%s\t%s\t%s\n", f->layer->name, f->geometry, f->kind ? f->kind : "", states[f->state],
	       f->why ? f->why : "");
	for (size_t p = 0; f->state == LINES_USABLE && p < f->nparts; p++) {
		printf("%s", f->part[p].ring ? "ring" : "open");
		for (size_t i = f->part[p].first; i < f->part[p].first + f->part[p].n; i++)
			printf("\t%.17g %.17g %.17g", lines_coordinate(f, i, 0), lines_coordinate(f, i, 1),
			       lines_coordinate(f, i, 2));
		printf("\n");
	}
}

int main(int argc, char **argv)
{
	struct lines_options opt = {.csv = false};
	const struct lines_feature *f = NULL;
	struct err err = ERR_INIT;
	struct lines *l = NULL;
	char buf[2048];
	int rc;

	for (int i = 2; i < argc; i++) {
		opt.csv |= !strcmp(argv[i], "--csv");
		if (!strcmp(argv[i], "--layer") && i + 1 < argc)
			opt.layer = argv[++i];
		else if (!strcmp(argv[i], "--kind-field") && i + 1 < argc)
			opt.kind_field = argv[++i];
	}
	if (argc < 2)
		return 2;
	rc = lines_open(argv[1], &opt, &l, &err);
	while (!rc && !(rc = lines_next(l, &f, &err)) && f)
		print(f);
	if (rc)
		fprintf(stderr, "%s\n", err_format(&err, buf, sizeof buf));
	lines_close(l);
	return rc ? 1 : 0;
}
