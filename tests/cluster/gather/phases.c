/*
 * Runs the phases of a cluster's run as functions, for tests of gather and finish:
 *
 *   phases make WORK MEMORY STAGES MESHES GATHERS INPUT...   all up to the phase mesh
 *   phases gather WORK INDEX OPTIONS                         first sum, if it has no record
 *   phases finish|clean WORK OPTIONS
 *   phases recover WORK OPTIONS   prints how many tasks are to be done again
 *   phases mesh WORK INDEX
 *   phases check-sum              of standard input, as texts of a work folder have it
 *   phases check POINTS OPTIONS   whether so many points can be written
 *
 * OPTIONS are those of acutctl mesh that outputs have. PHASES_MEMORY in the environment: bytes, in place of those of the run.
 * PHASES_BLOCK: bytes of a file that one task writes alone. PHASES_REMOVES: how many files are removed before removing fails.
 * SIGTERM interrupts a task.
 */
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <xxhash.h>

#include "err.h"
#include "gather.h"
#include "mesh_phase.h"
#include "no_sync.h"
#include "parse.h"
#include "survey.h"
#include "work.h"

static long left;
static volatile sig_atomic_t told;

static void tell(int signal)
{
	(void)signal;
	told = 1;
}

static int interrupted(void *ctx)
{
	(void)ctx;
	return told;
}

static int remove_some(int fd, const char *name, int flags)
{
	if (left-- > 0)
		return io_system.unlinkat(fd, name, flags);
	errno = EIO;
	return -1;
}

static int failed(const struct err *err)
{
	char text[2048];

	fprintf(stderr, "phases: %s\n", err_format(err, text, sizeof(text)));
	return err_exit_status(err->code);
}

static int inputs(char **path, size_t n, struct work_input **ret)
{
	struct work_input *in = calloc(n + 1, sizeof(*in));

	for (size_t i = 0; in && i < n; i++) {
		struct stat st;

		if (stat(path[i], &st)) {
			perror(path[i]);
			return -1;
		}
		in[i] = (struct work_input){path[i], (uint64_t)st.st_size,
					    (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec};
	}
	*ret = in;
	return in ? 0 : -1;
}

static int phases_of(struct work *work, uint64_t memory, struct err *err)
{
	const struct work_about *about = work_about(work);
	const struct survey_params survey = {.grows = false};
	const struct mesh_phase_params mesh = {.view = "", .memory = memory};
	int r = survey_head(work, &survey, err);

	for (uint32_t i = 0; i < about->tasks[WORK_STAGE] && !r; i++)
		r = survey_stage(work, i, &survey, err);
	if (!r)
		r = survey_commit(work, &survey, err);
	if (!r)
		r = mesh_phase_plan(work, &mesh, err);
	for (uint32_t i = 0; i < about->tasks[WORK_MESH] && !r; i++)
		r = mesh_phase_mesh(work, i, &mesh, err);
	return r;
}

static int make(int argc, char **argv)
{
	static const char *const word[] = {"mesh"};
	struct work_about about = {.id = 0xabcdef12345678, .word = word, .nword = 1};
	struct work_input *input = NULL;
	struct err err = ERR_INIT;
	struct work *work = NULL;
	int r = argc > 5 && parse_size(argv[1], &about.memory) ? 0 : -1;

	if (r || inputs(argv + 5, (size_t)argc - 5, &input))
		return 64;
	for (enum work_phase p = 0; p < WORK_PHASES; p++)
		about.tasks[p] = p != WORK_SORT;
	about.tasks[WORK_STAGE] = (uint32_t)atoi(argv[2]);
	about.tasks[WORK_MESH] = (uint32_t)atoi(argv[3]);
	about.tasks[WORK_GATHER] = (uint32_t)atoi(argv[4]);
	r = work_make(argv[0], &about, input, (size_t)argc - 5, &work, &err);
	if (!r)
		r = phases_of(work, about.memory, &err);
	work_close(work);
	free(input);
	return r ? failed(&err) : 0;
}

/* One option that has a value; false: there is no such option. */
static bool take(struct ctl_fetch_options *a, struct ctl_fetch_output *o, const char *name, const char *value)
{
	const struct {
		const char *name, **to;
	} row[] = {
		{"--format", &o->format},     {"--origin", &o->origin},     {"--z-unit", &o->z_unit},
		{"--color", &o->color},       {"--cell", &o->cell},         {"--raster", &o->raster},
		{"--interval", &o->interval}, {"--base", &o->base},         {"--simplify", &o->simplify},
		{"--tile", &a->tile},         {"--max-edge", &a->max_edge}, {"--trim-hull", &a->trim_hull},
	};

	for (size_t i = 0; i < sizeof(row) / sizeof(row[0]); i++)
		if (!strcmp(name, row[i].name)) {
			*row[i].to = value;
			return true;
		}
	if (!strcmp(name, "--width"))
		return parse_u64(value, &o->width);
	for (int k = 0; k < OUTPUTS_CUTS; k++)
		if (!strcmp(name, k == OUTPUTS_MASK ? "--mask" : "--erase")) {
			struct cli_texts *t = &a->cut[k];

			t->text[t->n++] = value;
			return true;
		}
	return false;
}

static bool parse(int argc, char **argv, struct ctl_fetch_options *a)
{
	unsigned n = 0;

	for (int i = 0; i < argc; i++) {
		struct ctl_fetch_output *o = &a->output[n];

		if (!strcmp(argv[i], "-o") && i + 1 < argc)
			a->output[++n].path = argv[++i];
		else if (!strcmp(argv[i], "--no-clobber"))
			a->no_clobber = true;
		else if (!strcmp(argv[i], "--levels"))
			a->levels = true;
		else if (!strcmp(argv[i], "--canonical"))
			o->canonical = true;
		else if (!strcmp(argv[i], "--sidecar"))
			o->sidecar = true;
		else if (!strcmp(argv[i], "--polyface"))
			o->polyface = true;
		else if (i + 1 >= argc || !take(a, o, argv[i], argv[i + 1]))
			return false;
		else
			i++;
	}
	return true;
}

static int late(const char *phase, int argc, char **argv)
{
	bool one = !strcmp(phase, "gather");
	struct ctl_fetch_options options = {.tile = NULL};
	struct gather_params p = {.outputs = &options};
	struct err err = ERR_INIT;
	struct work *work = NULL;
	uint32_t again = 0;
	int r;

	if (argc < 1 + one || !parse(argc - 1 - one, argv + 1 + one, &options))
		return 64;
	r = work_open(argv[0], &work, &err);
	if (!r) {
		p.work = work;
		work_set_interrupt(work, interrupted, NULL);
		p.memory = work_about(work)->memory;
		if (getenv("PHASES_MEMORY"))
			p.memory = strtoull(getenv("PHASES_MEMORY"), NULL, 10);
		if (getenv("PHASES_BLOCK"))
			p.block = strtoull(getenv("PHASES_BLOCK"), NULL, 10);
		r = gather_check(&options, 0, &err);
	}
	if (!r && !strcmp(phase, "recover"))
		r = gather_recover(&p, &again, &err);
	else if (!r && strcmp(phase, "clean") != 0)
		r = gather_sum(&p, &err);
	if (!r && one)
		r = gather_task(&p, (uint32_t)atoi(argv[1]), &err);
	else if (!r && !strcmp(phase, "finish"))
		r = gather_finish(&p, &err);
	else if (!r && !strcmp(phase, "clean"))
		r = gather_clean(&p, &err);
	else if (!r)
		printf("%u\n", again);
	work_close(work);
	return r ? failed(&err) : 0;
}

static int check(int argc, char **argv)
{
	struct ctl_fetch_options options = {.tile = NULL};
	struct err err = ERR_INIT;
	uint64_t points;

	if (argc < 1 || !parse_u64(argv[0], &points) || !parse(argc - 1, argv + 1, &options))
		return 64;
	return gather_check(&options, points, &err) ? failed(&err) : 0;
}

static int mesh_again(int argc, char **argv)
{
	struct mesh_phase_params p = {.view = ""};
	struct err err = ERR_INIT;
	struct work *work = NULL;
	int r = argc == 2 ? work_open(argv[0], &work, &err) : -1;

	if (!r) {
		p.memory = work_about(work)->memory;
		r = mesh_phase_mesh(work, (uint32_t)atoi(argv[1]), &p, &err);
	}
	work_close(work);
	return r ? failed(&err) : 0;
}

static int check_sum(void)
{
	static char text[1 << 16];
	size_t n = fread(text, 1, sizeof(text), stdin);

	printf("%016llx", (unsigned long long)XXH3_64bits(text, n));
	return 0;
}

int main(int argc, char **argv)
{
	struct io_table *table = no_sync();

	signal(SIGTERM, tell);
	if (getenv("PHASES_REMOVES")) {
		left = strtol(getenv("PHASES_REMOVES"), NULL, 10);
		table->unlinkat = remove_some;
	}
	if (argc > 2 && !strcmp(argv[1], "make"))
		return make(argc - 2, argv + 2);
	if (argc > 2 && (!strcmp(argv[1], "gather") || !strcmp(argv[1], "finish") || !strcmp(argv[1], "clean") ||
			 !strcmp(argv[1], "recover")))
		return late(argv[1], argc - 2, argv + 2);
	if (argc > 1 && !strcmp(argv[1], "check-sum"))
		return check_sum();
	if (argc > 2 && !strcmp(argv[1], "mesh"))
		return mesh_again(argc - 2, argv + 2);
	if (argc > 2 && !strcmp(argv[1], "check"))
		return check(argc - 2, argv + 2);
	return 64;
}
