/* acut-task WORK PHASE INDEX: one task of a run, here and now. What a node of a cluster executes; also by hand. */
#include <malloc.h>
#include <string.h>

#include "cluster.h"
#include "io.h"
#include "parse.h"

static const char usage[] =
	"usage: acut-task WORK PHASE INDEX\n"
	"\n"
	"Runs one task of the run whose work folder is WORK (acut-cluster), if it has no record yet. Exit status:\n"
	"  0 the task has its record; 1 an input is broken or has changed, or the run was cancelled; 2 usage;\n"
	"  4 there is no such run; 74 reading or writing failed, or no space; 75 no memory; 76 versions;\n"
	"  77 not permitted; 128 and the number of a signal\n";

static int read_words(int argc, char **argv, enum work_phase *ret_phase, uint32_t *ret_index, struct err *err)
{
	uint64_t index = 0;

	if (argc != 4) {
		err_set(err, ERR_USAGE, "three words are wanted, %d given", argc - 1);
		return err_add_hint(err, "acut-task WORK PHASE INDEX");
	}
	if (!work_phase_parse(argv[2], ret_phase)) {
		err_set(err, ERR_USAGE, "there is no phase \"%.40s\"", argv[2]);
		return err_add_hint(err, "head, stage, sort, commit, plan, mesh, sum, gather or finish");
	}
	if (!parse_u64(argv[3], &index) || index > UINT32_MAX)
		return err_set(err, ERR_USAGE, "\"%.40s\" is not the number of a task", argv[3]);
	*ret_index = (uint32_t)index;
	return 0;
}

int main(int argc, char **argv)
{
	struct program p = {.session.console = {.program = "acut-task", .report = stdout, .no_progress = true}};
	enum work_phase phase = WORK_HEAD;
	struct work *w = NULL;
	struct err err = ERR_INIT;
	uint32_t index = 0;
	int r;

	io_reserve_standard();
	/* What a task frees goes back to the node at once: others run there. */
	mallopt(M_TRIM_THRESHOLD, 4 << 20);
	session_begin(&p.session);
	if (argc == 2 && (!strcmp(argv[1], "--help") || !strcmp(argv[1], "-h")))
		return fputs(usage, stdout) < 0 ? 74 : console_end(&p.session.console, 0);
	if (argc == 2 && !strcmp(argv[1], "--version"))
		return puts("acut-task " ACUT_VERSION) < 0 ? 74 : console_end(&p.session.console, 0);
	r = read_words(argc, argv, &phase, &index, &err);
	if (!r)
		r = work_open_task(argv[1], &w, &err);
	if (!r)
		r = task_run(&p, w, phase, index, &err);
	work_close(w);
	return console_end(&p.session.console, r ? session_error(&p.session, &err) : 0);
}
