/*
 * Logs of tasks: one file a task, to which all its attempts append. A line of ours marks where an attempt begins, with its host,
 *and where it ends, with its status; between them is what the task says, and what the scheduler adds ("... DUE TO TIME LIMIT").
 *
 *	acut-cluster: mesh 17 begins on n4, job 4711
 *	acut-cluster: mesh 17 ends with status 0
 *
 * An attempt without an end, and that does not run, was on a node that is lost.
 */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "dispatch_priv.h"

enum { READ_MOST = 64 << 10 };

static const struct {
	const char *text;
	enum dispatch_why why;
} signs[] = {
	{"DUE TO TIME LIMIT", DISPATCH_WHY_TIME},       {"DUE TO NODE FAILURE", DISPATCH_WHY_NODE},
	{"DUE TO PREEMPTION", DISPATCH_WHY_PREEMPTED},  {"oom-kill event", DISPATCH_WHY_MEMORY},
	{"oom_kill event", DISPATCH_WHY_MEMORY},        {"Exceeded job memory limit", DISPATCH_WHY_MEMORY},
	{"exceeded memory limit", DISPATCH_WHY_MEMORY}, {"CANCELLED AT", DISPATCH_WHY_CANCELLED},
};

/* "acut-cluster: PHASE INDEX VERB ", where `verb` is; NULL: it is no such line. */
static const char *own_line(const char *line, size_t n, const char *verb)
{
	static const char head[] = "acut-cluster: ";
	const size_t most = sizeof head - 1 + 60, k = strlen(verb);
	const char *at;

	if (n < sizeof head - 1 || memcmp(line, head, sizeof head - 1))
		return NULL;
	at = memmem(line, n < most ? n : most, verb, k);
	return at ? at + k : NULL;
}

static void host_of(const char *at, const char *end, char buf[64])
{
	size_t n = 0;

	while (at + n < end && at[n] != ',' && at[n] != ' ' && n < 63)
		n++;
	memcpy(buf, at, n);
	buf[n] = 0;
}

/* The last lines of an attempt, as one line. */
static void keep_tail(const char *from, const char *to, char buf[400])
{
	const char *at = to;
	unsigned lines = 0;
	size_t n = 0;

	while (at > from && to - at < 360 && (at[-1] != '\n' || at == to || ++lines < 3))
		at--;
	for (; at < to && n < 398; at++) {
		const bool end = *at == '\n';

		if (end && (!n || at + 1 == to || (n > 1 && buf[n - 1] == ' ' && buf[n - 2] == ';')))
			continue;
		if (end)
			buf[n++] = ';';
		buf[n++] = end || (unsigned char)*at < ' ' ? ' ' : *at;
	}
	buf[n] = 0;
}

/* Of an attempt of which no more lines come. */
static enum dispatch_why why_of(const struct dispatch_log *l)
{
	if (l->ended && !l->status)
		return DISPATCH_WHY_NONE;
	if (l->why)
		return l->why;
	return !l->ended ? DISPATCH_WHY_NODE : l->status > 128 ? DISPATCH_WHY_SIGNAL : DISPATCH_WHY_STATUS;
}

void dispatch_log_parse(const char *text, size_t n, struct dispatch_log *ret)
{
	const char *end = text + n, *from = text, *stop = end;

	*ret = (struct dispatch_log){0};
	for (const char *line = text; line < end;) {
		const char *next = memchr(line, '\n', (size_t)(end - line)), *at;
		const size_t size = (size_t)((next ? next : end) - line);

		if ((at = own_line(line, size, " begins on "))) {
			if (ret->begun++) {
				ret->before = why_of(ret);
				memcpy(ret->host_before, ret->host, sizeof ret->host);
			}
			ret->ended = false;
			ret->status = 0;
			ret->why = DISPATCH_WHY_NONE;
			host_of(at, line + size, ret->host);
			at = memmem(at, (size_t)(line + size - at), ", process of ", 13);
			ret->driver = at ? atoi(at + 13) : 0;
			from = next ? next + 1 : end;
			stop = end;
		} else if ((at = own_line(line, size, " ends with status "))) {
			ret->ended = true;
			ret->status = atoi(at);
			stop = line;
		} else {
			for (size_t i = 0; i < sizeof signs / sizeof *signs && !ret->why; i++)
				if (memmem(line, size, signs[i].text, strlen(signs[i].text)))
					ret->why = signs[i].why;
		}
		line = next ? next + 1 : end;
	}
	ret->why = ret->begun ? why_of(ret) : DISPATCH_WHY_NONE;
	keep_tail(from, stop, ret->tail);
}

bool dispatch_log_read(const struct dispatch *d, unsigned phase, uint32_t index, struct dispatch_log *ret)
{
	char name[96], path[4096], *text;
	struct stat st;
	ssize_t n = -1;
	int fd;

	*ret = (struct dispatch_log){0};
	d->on->log_name(d, phase, index, name);
	if ((size_t)snprintf(path, sizeof path, "%s/log/%s", d->o.work, name) >= sizeof path)
		return false;
	fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	if (fd < 0)
		return false;
	text = malloc(READ_MOST + 1);
	if (text && !fstat(fd, &st))
		n = pread(fd, text, READ_MOST, st.st_size > READ_MOST ? st.st_size - READ_MOST : 0);
	close(fd);
	if (n >= 0) {
		text[n] = 0;
		dispatch_log_parse(text, (size_t)n, ret);
	}
	free(text);
	return n >= 0;
}
