/* Any bytes as a log of a task, and as rows that squeue prints: texts have an end, and tasks are of the run. */
#include <stdlib.h>
#include <string.h>

#include "dispatch_priv.h"
#include "err.h"
#include "fuzz_input.h"

static const char *const texts[] = {
	"",
	"acut-cluster: mesh 17 begins on n4, job 4711, start 0\nhello\nacut-cluster: mesh 17 ends with status 0\n",
	"acut-cluster: mesh 1 begins on vm, process of 77\nacut-cluster: mesh 1 begins on b\nslurmstepd: error: *** JOB 5 ON b CANCELLED AT 1 DUE TO TIME LIMIT ***\n",
	"12|3|RUNNING|None|acut-ff-stage\n12|4|PENDING|Resources|acut-ff-stage\n",
	"13|[0-4,7,9-12%3]|CANCELLED|DependencyNeverSatisfied|acut-ff-mesh-1000\n",
	"MaxArraySize            = 1001\nSLURM_VERSION = 22.05\n",
	"4711;cluster\n",
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

static bool never(void *ctx, unsigned phase, uint32_t index)
{
	return false;
}

static void read_row(const struct dispatch *d, const struct dispatch_phase *phase, char *line)
{
	struct dispatch_row row;
	uint32_t from, to;

	if (!dispatch_row_read(d, line, &row))
		return;
	if (row.phase > 1 || !row.reason)
		abort();
	while (dispatch_row_next(d, &row, &from, &to))
		if (from > to || to >= phase[row.phase].tasks)
			abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static const struct dispatch_phase phase[] = {{"stage", 5, 0, 0}, {"mesh", 3000, 0, 0}};
	const struct dispatch_options o = {.id = "ff", .work = "/w", .task = "/t", .phase = phase, .nphase = 2, .done = never};
	char *text = malloc(size + 1), *save = NULL;
	struct dispatch *d = NULL;
	struct dispatch_log log;
	struct err err = ERR_INIT;
	uint64_t number;
	uint32_t job;

	if (!text || dispatch_new("slurm", &o, &d, &err))
		abort();
	memcpy(text, bytes, size);
	text[size] = 0;
	dispatch_log_parse(text, size, &log);
	if (strlen(log.tail) >= sizeof log.tail || strlen(log.host) >= sizeof log.host || (log.ended && !log.begun && log.why))
		abort();
	dispatch_config_number(text, "MaxArraySize", &number);
	if (dispatch_job_read(text, &job) && !job)
		abort();
	for (char *line = strtok_r(text, "\n", &save); line; line = strtok_r(NULL, "\n", &save))
		read_row(d, phase, line);
	dispatch_free(d);
	free(text);
	return 0;
}
