/* All phases from inputs to a dataset, one after the other, for scripts: survey-run WORK STAGES MEMORY [KEY=VALUE ...], the paths
 * of the inputs on standard input. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "err.h"
#include "io.h"
#include "parse.h"
#include "process.h"
#include "survey.h"

static int failed(const struct err *err)
{
	char text[1600];

	fprintf(stderr, "%s\n", err_format(err, text, sizeof text));
	return err_exit_status(err->code);
}

static void refused(void *ctx, const struct err *why)
{
	char text[1600];

	fprintf(stderr, "refused: %s\n", err_format(why, text, sizeof text));
}

static void warned(void *ctx, const char *path, const char *text)
{
	printf("%s: %s\n", path, text);
}

static size_t read_inputs(struct work_input **ret)
{
	struct work_input *in = NULL;
	size_t n = 0, room = 0, cap = 0;
	char *line = NULL;

	while (getline(&line, &room, stdin) > 0) {
		struct stat st;

		line[strcspn(line, "\n")] = 0;
		if (n == cap)
			in = realloc(in, (cap = cap ? 2 * cap : 64) * sizeof *in);
		if (!in || stat(line, &st))
			abort();
		in[n++] = (struct work_input){.path = strdup(line),
					      .size = (uint64_t)st.st_size,
					      .mtime_ns = (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec};
	}
	free(line);
	*ret = in;
	return n;
}

static void take_option(struct survey_params *p, struct work_about *about, const char *word)
{
	static const char *const keys[] = {"assume", "override", "unit_xy", "unit_z", "utm", "geoid", "scale_xy", "scale_z"};
	const char **const at[] = {&p->says.assume[0], &p->says.override[0], &p->says.assume[1], &p->says.assume[2],
				   &p->says.utm,       &p->says.geoid,       &p->says.scale_xy,  &p->says.scale_z};
	size_t n = strcspn(word, "=");

	if (!strcmp(word, "grows=1"))
		p->grows = true;
	else if (!strncmp(word, "sorts=", 6))
		about->tasks[WORK_SORT] = (uint32_t)strtoul(word + 6, NULL, 10);
	else if (!strncmp(word, "scratch=", 8))
		p->scratch = word + 8;
	for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
		if (strlen(keys[i]) == n && !strncmp(word, keys[i], n))
			*at[i] = word + n + 1;
}

int main(int argc, char **argv)
{
	struct survey_params p = {.refused = refused, .warned = warned};
	struct work_about about = {.id = 1};
	struct work_input *in;
	struct work *w = NULL;
	struct err err = ERR_INIT;
	size_t n;
	int r;

	io_reserve_standard();
	if (argc < 4 || !parse_size(argv[3], &about.memory))
		return 2;
	for (int i = 4; i < argc; i++)
		take_option(&p, &about, argv[i]);
	n = read_inputs(&in);
	about.tasks[WORK_HEAD] = about.tasks[WORK_COMMIT] = 1;
	about.tasks[WORK_STAGE] = (uint32_t)strtoul(argv[2], NULL, 10);
	r = work_make(argv[1], &about, in, n, &w, &err);
	if (!r) {
		work_set_patience(w, 0);
		r = survey_head(w, &p, &err);
		printf("head: peak %llu MiB, computed %llu MiB\n", (unsigned long long)process_peak_rss() >> 20,
		       (unsigned long long)survey_head_bytes(n) >> 20);
	}
	for (uint32_t i = 0; !r && i < about.tasks[WORK_STAGE]; i++)
		r = survey_stage(w, i, &p, &err);
	for (uint32_t i = 0; !r && i < about.tasks[WORK_SORT]; i++)
		r = survey_sort(w, i, &p, &err);
	if (!r)
		r = survey_commit(w, &p, &err);
	work_close(w);
	for (size_t i = 0; i < n; i++)
		free((char *)in[i].path);
	free(in);
	return r ? failed(&err) : 0;
}
