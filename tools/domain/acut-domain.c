/*
 * acut-domain: one region of a dataset, from files alone, without daemon, catalogue or locks. So the scheduler of a
 * cluster can run domains, and a developer can inspect one.
 *
 *   acut-domain --plan MANIFEST VIEW the regions, one on each line
 *   acut-domain --job-plan FILE the regions of a job of the daemon, by the file of its plan
 *   acut-domain --select MANIFEST VIEW FOLDER the points of a view with crop, every or thin, as a grid
 *   acut-domain MANIFEST VIEW REGION OUT triangulate one, publish it in the folder OUT
 *
 * The name of a finished domain is derived from its data, and the file appears only when it is complete; if OUT is the
 * daemon's store, the daemon finds it there. Regions of a view that selects are on the grid of its points. That grid is
 * made in a temporary folder each time, or once with --select, for all runs with its manifest.
 */
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <libgen.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cut.h"
#include "digest.h"
#include "err.h"
#include "grid.h"
#include "io.h"
#include "ledger.h"
#include "parse.h"
#include "pipe.h"
#include "plan_record.h"
#include "selection.h"
#include "store.h"
#include "tool_options.h"

enum { MEGA = 1 << 20, INDEX_MEMORY = 4 * MEGA };

static const struct tool_option OPTIONS[] = {
	{"memory", "SIZE", "bytes for one domain and the index (default 256M)", 'm'},
	{"plan", NULL, "print the regions, a line each: REGION at-most|exact POINTS", 'p'},
	{"load", "N", "points of a region, at most (default 65536, as acutd, or what the memory allows)", 'l'},
	{"job-plan", "FILE", "print the regions of the plan in FILE, likewise", 'j'},
	{"select", NULL, "print FOLDER/manifest, a tab, VIEW", 's'},
};
static const struct tool TOOL = {
	.name = "acut-domain",
	.usage = "usage: acut-domain [--memory SIZE] MANIFEST VIEW REGION OUT\n"
		 "       acut-domain [--memory SIZE] [--load N] --plan MANIFEST VIEW\n"
		 "       acut-domain --job-plan FILE\n"
		 "       acut-domain [--memory SIZE] --select MANIFEST VIEW FOLDER\n",
	.about =
		"Triangulates one region of a dataset from its manifest, and publishes the finished domain in the\n"
		"folder OUT under a name of what it was made of, which it prints. With --plan: prints the regions that make up the mesh, in order: those\n"
		"of acutd's first mesh of the dataset. With --job-plan: those of a job, by STATE/plans/plan-JOB.\n"
		"With --select: makes the grid of the points that a view with crop, every or thin keeps in FOLDER, and\n"
		"prints its manifest and the view to run it with; otherwise each run makes that grid for itself.\n",
	.end = "\n"
	       "VIEW is a view's canonical text ('acutctl show JOB' prints it), '' is the default view.\n"
	       "Exit status: 0 done; 1 it failed; 2 usage; 74 reading or writing failed.\n",
	.option = OPTIONS,
	.n = sizeof OPTIONS / sizeof *OPTIONS,
};

struct options {
	uint64_t memory, load;
	bool plan, select;
	const char *job_plan;
	const char *manifest, *view, *region, *out; /* out: also the folder of --select */
};

struct session {
	struct ledger *ledger;
	struct grid *grid;
	struct view view;
	struct pipe_budget budget;
};

/* -1: continue; otherwise the exit status. */
static int parse_options(int argc, char **argv, struct options *o)
{
	const char *value;
	int c, status;

	while ((c = tool_next(&TOOL, argc, argv, &value, &status)) != TOOL_END) {
		switch (c) {
		case 'm':
			if (!parse_size(value, &o->memory))
				return tool_usage_error(&TOOL, "--memory wants a size such as 256M");
			break;
		case 'l':
			if (!parse_u64(value, &o->load) || !o->load || o->load > UINT32_MAX)
				return tool_usage_error(&TOOL, "--load wants a number of points");
			break;
		case 'j':
			o->job_plan = value;
			break;
		case 'p':
			o->plan = true;
			break;
		case 's':
			o->select = true;
			break;
		default:
			return status;
		}
	}
	if (o->plan + o->select + !!o->job_plan > 1)
		return tool_usage_error(&TOOL, "--plan, --job-plan and --select are three commands");
	if (o->load && !o->plan)
		return tool_usage_error(&TOOL, "--load belongs to --plan");
	if (o->job_plan)
		return optind < argc ? tool_usage_error(&TOOL, "--job-plan wants a file and nothing else") : -1;
	if (argc - optind != (o->plan ? 2 : o->select ? 3 : 4))
		return tool_usage_error(&TOOL, o->plan   ? "--plan wants MANIFEST and VIEW" :
					       o->select ? "--select wants MANIFEST, VIEW and FOLDER" :
							   "it wants MANIFEST, VIEW, REGION and OUT");
	o->manifest = argv[optind];
	o->view = argv[optind + 1];
	o->region = o->plan || o->select ? NULL : argv[optind + 2];
	o->out = o->plan ? NULL : argv[optind + (o->select ? 2 : 3)];
	return -1;
}

/* ---- a view that selects ---- */

static int select_into(struct session *s, int dirfd, struct selection_counts *ret, struct err *err)
{
	struct selection_params p = {.grid = s->grid, .view = &s->view, .memory = ledger_left(s->ledger), .dirfd = dirfd};

	return selection_make(&p, ret, err);
}

/* `dataset`: the folder of the manifest. Replaces the dataset's grid by the grid of the selected points, in unlinked files. */
static int select_own(struct session *s, int dataset, struct err *err)
{
	const char *files[4] = {SELECTION_MANIFEST, "counts", "selection.seg"};
	const char *top = getenv("TMPDIR");
	struct err ignored = ERR_INIT;
	char path[4096];
	int dirfd, r;

	snprintf(path, sizeof path, "%s/acut-domain-XXXXXX", top && *top ? top : "/tmp");
	if (!mkdtemp(path)) {
		err_sys(err, errno, "cannot make a folder for the selection");
		return err_add_file(err, path);
	}
	r = io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &dirfd, err);
	if (!r) {
		const struct grid_source *lines = grid_lines_source(s->grid);
		struct view rest = view_rest(&s->view);
		struct grid_named file[GRID_SOURCE_FILES];
		struct grid_use use = {.no_lines = !lines, .slots = s->view.slots ? &selection_slots : NULL};
		struct selection_counts counts = {0};

		r = select_into(s, dirfd, &counts, err);
		if (lines) {
			grid_source_files(lines, file);
			use.lines = counts.mapped ? SELECTION_LINES : file[0].name;
			use.linesfd = counts.mapped ? dirfd : dataset;
			files[3] = counts.mapped ? SELECTION_LINES : NULL;
		}
		if (counts.mapped)
			view_bind_map(&rest, counts.origin);
		s->grid = grid_close(s->grid);
		if (!r)
			r = grid_open_use(dirfd, SELECTION_MANIFEST, GRID_NEWEST, &use, s->ledger, INDEX_MEMORY, &s->grid, err);
		for (size_t i = 0; i < sizeof files / sizeof files[0] && files[i]; i++)
			io_remove(dirfd, files[i], &ignored);
		io_close(dirfd);
		s->view.slots = NULL; /* the rest has it */
		view_done(&s->view);
		s->view = rest;
	}
	rmdir(path);
	return r;
}

static int select_folder(struct session *s, const struct options *o, struct err *err)
{
	struct view rest = view_rest(&s->view);
	struct slots slots = selection_slots;
	struct selection_counts counts;
	char *text;
	int dirfd, r = io_make_dir(AT_FDCWD, o->out, 0777, err);

	if (!r)
		r = io_open(AT_FDCWD, o->out, O_RDONLY | O_DIRECTORY, 0, &dirfd, err);
	if (r)
		return r;
	r = select_into(s, dirfd, &counts, err);
	io_close(dirfd);
	if (r)
		return r;
	if (rest.slots)
		rest.slots = &slots; /* the sources of the selection */
	text = view_text(&rest);
	if (!text)
		return err_set(err, ERR_NOMEM, "no memory for a view");
	printf("%s/%s\t%s\n", o->out, SELECTION_MANIFEST, text);
	free(text);
	return 0;
}

/* ---- a session ---- */

/* The load of the plan; the memory for a domain stays. */
static int set_load(struct session *s, const struct options *o, struct err *err)
{
	if (o->load > s->budget.cap) {
		err_set(err, ERR_LIMIT, "the memory carries %u points at once", s->budget.cap);
		return err_add_hint(err, "give more --memory, or a smaller --load");
	}
	if (o->load)
		s->budget.load = (uint32_t)o->load;
	else if (s->budget.load > PIPE_KEPT_LOAD)
		s->budget.load = PIPE_KEPT_LOAD;
	return 0;
}

/* Room for a region of so many positions, if the memory has it. Else the error says what would. */
static int widen(struct session *s, const struct options *o, uint64_t positions, struct err *err)
{
	const uint64_t left = ledger_left(s->ledger);
	const struct pipe_wide wide = {left, 1, positions, (uint64_t)s->budget.cap + 1};
	uint64_t need;

	err_clear(err);
	if (pipe_budget_wide(&wide, s->grid, &s->budget, &need, err))
		return need == UINT64_MAX ? err_add_hint(err, "leave out points") :
					    err_add_hint(err, "give --memory %lluM or more",
							 (unsigned long long)((need + o->memory - left + MEGA - 1) / MEGA));
	if (o->load)
		s->budget.load = (uint32_t)o->load;
	return 0;
}

static int session_open(struct session *s, const struct options *o, struct err *err)
{
	char folder[4096], file[4096];
	struct selection_counts counts;
	struct err ignored = ERR_INIT;
	struct grid_use use;
	int dirfd = -1, r;

	if (strlen(o->manifest) >= sizeof folder)
		return err_set(err, ERR_USAGE, "the manifest's path is too long");
	strcpy(folder, o->manifest);
	strcpy(file, o->manifest);
	s->view = VIEW_INIT;
	r = *o->view ? view_parse(o->view, &s->view, err) : 0;
	if (!r && view_simplifies(&s->view)) {
		err_set(err, ERR_UNSUPPORTED, "acut-domain chooses no points for max-error and max-points");
		r = err_add_hint(err, "let acutd make the mesh, or leave them out of the view");
	}
	if (!r)
		r = io_open(AT_FDCWD, dirname(folder), O_RDONLY | O_DIRECTORY, 0, &dirfd, err);
	if (r)
		return r;
	use = (struct grid_use){.no_lines = s->view.no_breaklines, .clear = s->view.breakline_clear, .slots = s->view.slots};
	s->ledger = ledger_new(o->memory);
	if (!s->ledger)
		r = err_set(err, ERR_NOMEM, "no memory");
	else
		r = grid_open_use(dirfd, basename(file), GRID_NEWEST, &use, s->ledger, INDEX_MEMORY, &s->grid, err);
	if (r == GRID_E_NO_LINE_SET) {
		r = err_set(err, ERR_NOTFOUND, "its lines have no line set yet");
		err_add_hint(err, "acutd makes it with the first mesh of that generation");
	}
	if (!r)
		view_bind(&s->view, &grid_manifest(s->grid)->lattice);
	if (!r && s->view.metric.k && !selection_counts_read(dirfd, &counts, &ignored) && counts.mapped)
		view_bind_map(&s->view, counts.origin); /* the grid of --select */
	else if (!r && view_selects(&s->view) && !o->select)
		r = select_own(s, dirfd, err);
	io_close(dirfd);
	if (!r)
		r = pipe_budget(ledger_left(s->ledger), 1, s->grid, &s->budget, err);
	return r ? r : set_load(s, o, err);
}

static void session_close(struct session *s)
{
	view_done(&s->view);
	grid_close(s->grid);
	ledger_free(s->ledger);
}

static void *domain_memory(const struct session *s)
{
	return aligned_alloc(64, (s->budget.domain_bytes + 63) & ~(size_t)63);
}

static void print_leaves(const struct cut_plan *plan)
{
	char text[CUT_REGION_TEXT_SIZE];

	for (size_t i = 0; i < plan->n; i++)
		printf("%s %s %llu\n", cut_region_text(&plan->leaf[i].region, text), plan->leaf[i].exact ? "exact" : "at-most",
		       (unsigned long long)plan->leaf[i].count);
}

static int make_plan(struct session *s, struct cut_plan *ret, struct err *err)
{
	struct mesh_counts empty;
	void *memory = domain_memory(s);
	int r;

	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory for planning (%zu bytes)", s->budget.domain_bytes);
	r = pipe_plan(s->grid, &s->view, &s->budget, memory, ret, &empty, err);
	free(memory);
	return r;
}

static int print_plan(struct session *s, const struct options *o, struct err *err)
{
	struct cut_plan plan = {0};
	int r = make_plan(s, &plan, err);

	while (pipe_budget_narrow(&s->budget, s->grid, r, err)) {
		r = widen(s, o, err->need, err);
		if (r)
			return r;
		r = make_plan(s, &plan, err);
	}
	if (r == PIPE_E_EMPTY) {
		fputs("acut-domain: the view takes no point: there is nothing to triangulate\n", stderr);
		return 0;
	}
	if (r)
		return r;
	print_leaves(&plan);
	cut_plan_done(&plan);
	return 0;
}

/* With all its splits. The file is read while a daemon may append to it. */
static int print_job_plan(const char *path, struct err *err)
{
	char folder[4096], file[4096];
	const char *name;
	struct plan_file *f;
	struct plan_kept kept;
	struct plan_head head;
	struct cut_plan plan = {0};
	uint8_t record[PLAN_RECORD];
	size_t seen, got = 0;
	int dirfd, fd, r;

	if (strlen(path) >= sizeof folder)
		return err_set(err, ERR_USAGE, "the path of the plan is too long");
	strcpy(folder, path);
	strcpy(file, path);
	name = basename(file);
	r = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);
	if (r)
		return r;
	r = io_read_some(fd, record, sizeof record, 0, path, &got, err);
	io_close(fd);
	if (!r && (got < sizeof record || !plan_head_unpack(record, &head) || plan_file_job(name) != head.job)) {
		err_set(err, ERR_INPUT, "it is no plan of a job");
		r = err_add_file(err, path);
	}
	if (!r)
		r = io_open(AT_FDCWD, dirname(folder), O_RDONLY | O_DIRECTORY, 0, &dirfd, err);
	if (r)
		return r;
	f = plan_file_new(dirfd, head.job, head.generation, false, NULL);
	r = f ? plan_file_read(f, &plan, &kept, &seen, err) : err_set(err, ERR_NOMEM, "no memory for a plan");
	if (r == PLAN_FILE_ABSENT) {
		err_set(err, ERR_CORRUPT, "the plan is damaged");
		r = err_add_file(err, path);
	}
	if (!r)
		print_leaves(&plan);
	cut_plan_done(&plan);
	plan_file_free(f);
	io_close(dirfd);
	return r;
}

/* Raises *need to the positions that the region has itself: what did not fit may have been counted only so far. */
static int raise_need(const struct session *s, const struct cut_region *region, void *memory, uint64_t *need, struct err *err)
{
	struct grid_reader *reader = NULL;
	struct cut_plan plan = {0};
	int r = grid_reader_new(s->grid, memory, grid_reader_bytes(s->grid), &reader, err);

	if (!r)
		r = cut_plan_below(reader, region, true, UINT32_MAX, &plan, err);
	for (size_t i = 0; i < plan.n; i++)
		*need = plan.leaf[i].count > *need ? plan.leaf[i].count : *need;
	cut_plan_done(&plan);
	grid_reader_free(reader);
	return r;
}

/* *ret is in *ret_memory, to be freed. */
static int fit_domain(struct session *s, const struct options *o, const struct cut_region *region, void **ret_memory,
		      struct mesh_domain *ret, struct err *err)
{
	uint64_t need = 0;
	int r, failed;

	do {
		r = need ? widen(s, o, need, err) : 0;
		if (r)
			return r;
		*ret_memory = domain_memory(s);
		if (!*ret_memory)
			return err_set(err, ERR_NOMEM, "no memory for a domain (%zu bytes)", s->budget.domain_bytes);
		r = pipe_domain(s->grid, &s->view, region, NULL, &s->budget, *ret_memory, ret, &need, err);
		failed = r == PIPE_E_SPLIT ? raise_need(s, region, *ret_memory, &need, err) : 0;
		if (r)
			free(*ret_memory);
		if (failed)
			return failed;
	} while (r == PIPE_E_SPLIT);
	return r;
}

static int make_domain(struct session *s, const struct options *o, struct err *err)
{
	char digest[DIGEST_HEX_SIZE], base[DIGEST_HEX_SIZE], list[DIGEST_HEX_SIZE];
	struct mesh_domain domain = {0};
	struct pipe_stored stored;
	struct cut_region region;
	struct pipe_key key;
	void *memory;
	int dirfd = -1, r;

	if (!cut_region_parse(o->region, &region))
		return err_set(err, ERR_USAGE, "'%s' is not a region", o->region);
	r = fit_domain(s, o, &region, &memory, &domain, err);
	if (r)
		return r;
	r = io_open(AT_FDCWD, o->out, O_RDONLY | O_DIRECTORY, 0, &dirfd, err);
	if (!r) {
		pipe_key_init(&key, s->grid, &s->view);
		r = pipe_store(dirfd, &key, &region, &domain, memory, &stored, NULL, err);
	}
	if (!r)
		printf("%.2s/d-%s-%s points %llu halo %llu triangles %u digest %s\n", digest_hex(stored.id.base, base), base,
		       digest_hex(stored.id.list, list), (unsigned long long)domain.counts.used,
		       (unsigned long long)domain.counts.halo, domain.ntriangle, digest_hex(domain.digest, digest));
	io_close(dirfd);
	free(memory);
	return r;
}

int main(int argc, char **argv)
{
	struct options o = {.memory = 256 << 20};
	struct err err = ERR_INIT;
	struct session s = {0};
	char text[1600];
	int status, r;

	io_reserve_standard();
	status = parse_options(argc, argv, &o);
	if (status >= 0)
		return status;
	r = o.job_plan ? print_job_plan(o.job_plan, &err) : session_open(&s, &o, &err);
	if (!r && !o.job_plan)
		r = o.plan ? print_plan(&s, &o, &err) : o.select ? select_folder(&s, &o, &err) : make_domain(&s, &o, &err);
	session_close(&s);
	if (!r && fflush(stdout) != 0)
		r = err_sys(&err, errno, "cannot write to standard output");
	if (r) {
		fprintf(stderr, "acut-domain: %s\n", err_format(&err, text, sizeof text));
		return err_exit_status(err.code);
	}
	return 0;
}
