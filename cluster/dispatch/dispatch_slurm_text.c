/* What the commands of Slurm read and print, as text. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dispatch_priv.h"
#include "err.h"
#include "parse.h"

uint32_t dispatch_ranges(const uint32_t *index, uint32_t n, uint32_t offset, char *buf, size_t size)
{
	size_t used = 0;
	uint32_t k = 0;

	buf[0] = 0;
	while (k < n && size - used > 2 * 11 + 2) {
		uint32_t end = k;

		while (end + 1 < n && index[end + 1] == index[end] + 1)
			end++;
		used += (size_t)snprintf(buf + used, size - used, "%s%u", k ? "," : "", index[k] - offset);
		if (end > k)
			used += (size_t)snprintf(buf + used, size - used, "-%u", index[end] - offset);
		k = end + 1;
	}
	return k;
}

static const struct {
	const char *name;
	enum dispatch_state state;
	enum dispatch_why why;
} states[] = {
	{"PENDING", DISPATCH_WAITING, DISPATCH_WHY_NONE},       {"REQUEUED", DISPATCH_WAITING, DISPATCH_WHY_NONE},
	{"REQUEUE_FED", DISPATCH_WAITING, DISPATCH_WHY_NONE},   {"REQUEUE_HOLD", DISPATCH_WAITING, DISPATCH_WHY_NONE},
	{"RESV_DEL_HOLD", DISPATCH_WAITING, DISPATCH_WHY_NONE}, {"SPECIAL_EXIT", DISPATCH_WAITING, DISPATCH_WHY_NONE},
	{"CONFIGURING", DISPATCH_RUNNING, DISPATCH_WHY_NONE},   {"COMPLETING", DISPATCH_RUNNING, DISPATCH_WHY_NONE},
	{"RUNNING", DISPATCH_RUNNING, DISPATCH_WHY_NONE},       {"RESIZING", DISPATCH_RUNNING, DISPATCH_WHY_NONE},
	{"SIGNALING", DISPATCH_RUNNING, DISPATCH_WHY_NONE},     {"STAGE_OUT", DISPATCH_RUNNING, DISPATCH_WHY_NONE},
	{"STOPPED", DISPATCH_RUNNING, DISPATCH_WHY_NONE},       {"SUSPENDED", DISPATCH_RUNNING, DISPATCH_WHY_NONE},
	{"COMPLETED", DISPATCH_ENDED, DISPATCH_WHY_NONE},       {"FAILED", DISPATCH_ENDED, DISPATCH_WHY_STATUS},
	{"BOOT_FAIL", DISPATCH_ENDED, DISPATCH_WHY_NODE},       {"NODE_FAIL", DISPATCH_ENDED, DISPATCH_WHY_NODE},
	{"OUT_OF_MEMORY", DISPATCH_ENDED, DISPATCH_WHY_MEMORY}, {"TIMEOUT", DISPATCH_ENDED, DISPATCH_WHY_TIME},
	{"DEADLINE", DISPATCH_ENDED, DISPATCH_WHY_TIME},        {"CANCELLED", DISPATCH_ENDED, DISPATCH_WHY_CANCELLED},
	{"REVOKED", DISPATCH_ENDED, DISPATCH_WHY_CANCELLED},    {"PREEMPTED", DISPATCH_ENDED, DISPATCH_WHY_PREEMPTED},
};

/* "acut-ID-PHASE" or "acut-ID-PHASE-OFFSET". */
static bool read_name(const struct dispatch *d, const char *name, unsigned *ret_phase, uint64_t *ret_offset)
{
	const size_t k = strlen(d->o.id);
	size_t n;

	if (strncmp(name, "acut-", 5) || strncmp(name + 5, d->o.id, k) || name[5 + k] != '-')
		return false;
	name += 5 + k + 1;
	n = strcspn(name, "-");
	*ret_offset = 0;
	if (name[n] == '-' && !parse_u64(name + n + 1, ret_offset))
		return false;
	for (unsigned p = 0; p < d->o.nphase; p++)
		if (strlen(d->phase[p].name) == n && !memcmp(d->phase[p].name, name, n)) {
			*ret_phase = p;
			return true;
		}
	return false;
}

/* JOB|INDEX|STATE|REASON|NAME, as dispatch_slurm.c asks for it. A state that is not known is taken for waiting: Slurm has it. */
bool dispatch_row_read(const struct dispatch *d, char *row, struct dispatch_row *ret)
{
	char *field[5], *save = NULL;
	uint64_t job;

	for (int i = 0; i < 5; i++) {
		field[i] = strtok_r(i ? NULL : row, "|", &save);
		if (!field[i])
			return false;
	}
	if (!parse_u64(field[0], &job) || job > UINT32_MAX || !read_name(d, field[4], &ret->phase, &ret->offset))
		return false;
	ret->job = (uint32_t)job;
	ret->list = field[1] + (field[1][0] == '[');
	ret->reason = field[3];
	ret->state = DISPATCH_WAITING;
	ret->why = DISPATCH_WHY_NONE;
	for (size_t i = 0; i < sizeof states / sizeof *states; i++)
		if (!strcmp(states[i].name, field[2])) {
			ret->state = states[i].state;
			ret->why = states[i].why;
		}
	if (ret->why == DISPATCH_WHY_CANCELLED && !strcmp(ret->reason, "DependencyNeverSatisfied"))
		ret->why = DISPATCH_WHY_DEPENDENCY;
	return true;
}

static bool read_number(const char **at, uint64_t *ret)
{
	if (!isdigit((unsigned char)**at))
		return false;
	for (*ret = 0; isdigit((unsigned char)**at) && *ret < UINT32_MAX; (*at)++)
		*ret = *ret * 10 + (uint64_t)(**at - '0');
	return true;
}

/* "0-4,7,9-12%3": behind the % is how many may run at once. */
bool dispatch_row_next(const struct dispatch *d, struct dispatch_row *row, uint32_t *ret_from, uint32_t *ret_to)
{
	const uint32_t tasks = d->phase[row->phase].tasks;
	uint64_t from, to;

	row->list += *row->list == ',';
	if (!read_number(&row->list, &from))
		return false;
	to = from;
	if (*row->list == '-') {
		row->list++;
		if (!read_number(&row->list, &to))
			return false;
	}
	if (row->offset >= tasks || from > to || to + row->offset >= tasks)
		return false;
	*ret_from = (uint32_t)(from + row->offset);
	*ret_to = (uint32_t)(to + row->offset);
	return true;
}

bool dispatch_config_number(const char *text, const char *name, uint64_t *ret)
{
	const size_t k = strlen(name);

	for (const char *line = text; line && *line; line = strchr(line, '\n'), line = line ? line + 1 : NULL) {
		char word[24];
		size_t n = 0;

		if (strncmp(line, name, k) || (line[k] != ' ' && line[k] != '='))
			continue;
		line += k + strspn(line + k, " =");
		while (isdigit((unsigned char)line[n]) && n < sizeof word - 1) {
			word[n] = line[n];
			n++;
		}
		word[n] = 0;
		return parse_u64(word, ret);
	}
	return false;
}

bool dispatch_job_read(const char *text, uint32_t *ret)
{
	char word[16];
	uint64_t n;
	size_t k = strspn(text, "0123456789");

	if (!k || k >= sizeof word || (text[k] && text[k] != ';' && text[k] != '\n'))
		return false;
	memcpy(word, text, k);
	word[k] = 0;
	if (!parse_u64(word, &n) || !n || n > UINT32_MAX)
		return false;
	*ret = (uint32_t)n;
	return true;
}

void dispatch_pattern(const char *path, char *buf, size_t size)
{
	size_t n = 0;

	for (; *path && n + 2 < size; path++) {
		if (*path == '%')
			buf[n++] = '%';
		buf[n++] = *path;
	}
	buf[n] = 0;
}

void dispatch_quote(FILE *to, const char *text)
{
	fputc('\'', to);
	for (; *text; text++)
		if (*text == '\'')
			fputs("'\\''", to);
		else
			fputc(*text, to);
	fputc('\'', to);
}

/* Words of sbatch that mean that its controller did not answer: then the job may be there or not. */
bool dispatch_is_no_answer(const struct err *err)
{
	static const char *const signs[] = {"timed out",     "Unable to contact", "Connection refused",
					    "Temporarily",   "temporarily",       "Zero Bytes",
					    "was killed by", "try again",         "Transport endpoint"};

	if (err->code == ERR_BUSY)
		return true;
	for (size_t i = 0; i < sizeof signs / sizeof *signs; i++)
		if (strstr(err->message, signs[i]))
			return true;
	return false;
}

/* The user may not have more tasks in the queue. */
bool dispatch_is_full(const struct err *err)
{
	static const char *const signs[] = {"MaxSubmit", "MaxJobsPer", "job submit limit", "MaxTRESPer"};

	for (size_t i = 0; i < sizeof signs / sizeof *signs; i++)
		if (strstr(err->message, signs[i]))
			return true;
	return false;
}

/* What the shell of a user may have for work by hand, and would hide jobs from us, or change what a submission is. Presets as
 * SBATCH_ACCOUNT hold. */
static bool is_unwanted(const char *variable)
{
	static const char *const heads[] = {"SQUEUE_",      "SCANCEL_",          "SINFO_",           "SLURM_CLUSTERS=",
					    "SBATCH_WAIT=", "SBATCH_ARRAY_INX=", "SBATCH_CLUSTERS=", "SBATCH_MEM_PER_"};

	for (size_t i = 0; i < sizeof heads / sizeof *heads; i++)
		if (!strncmp(variable, heads[i], strlen(heads[i])))
			return true;
	return false;
}

void dispatch_clear_environment(void)
{
	char name[200];

	for (char **v = environ; v && *v;) {
		const size_t n = strcspn(*v, "=");

		if (!is_unwanted(*v) || n >= sizeof name) {
			v++;
			continue;
		}
		memcpy(name, *v, n);
		name[n] = 0;
		unsetenv(name); /* moves the later ones up */
	}
}
