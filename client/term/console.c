/* Everything that a program prints goes through here, so that options and the progress line are heeded in one place. */
#include "console.h"

#include <errno.h>
#include <poll.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "term.h"
#include "term_error.h"

int console_error(struct console *c, const struct err *err)
{
	struct term_json j;

	console_progress_clear(c);
	if (c->json) {
		j = console_json(c);
		term_error_json(&j, "error", err);
		term_json_end(&j);
	} else {
		term_error_text(c->program, err);
	}
	return err_exit_status(err->code);
}

/* Takes over the text. */
static void print(struct console *c, FILE *out, const char *kind, char *text)
{
	bool wanted = !c->quiet && !c->json;

	if (wanted && !text)
		term_lose();
	if (wanted && text && *text) {
		console_progress_clear(c);
		if (kind)
			term_line(out, "%s: %s: %s", c->program, kind, text);
		else
			term_line(out, "%s", text);
	}
	free(text);
}

/* False: it is there already, as of a file that is warned of for its header and again for its points. */
static bool keep_warning(struct console *c, const char *text)
{
	char **grown, *copy;

	for (size_t i = 0; i < c->nwarning; i++)
		if (!strcmp(c->warning[i], text))
			return false;
	copy = strdup(text);
	grown = copy ? realloc(c->warning, (c->nwarning + 1) * sizeof(*grown)) : NULL;
	if (!grown) {
		free(copy);
		if (c->json)
			term_lose();
		return true;
	}
	c->warning = grown;
	c->warning[c->nwarning++] = copy;
	return true;
}

void console_warn(struct console *c, const char *fmt, ...)
{
	va_list ap;
	char *text;

	va_start(ap, fmt);
	text = term_format(fmt, ap);
	va_end(ap);
	if (text && c->keeps_warnings && !keep_warning(c, text))
		free(text);
	else
		print(c, stderr, "warning", text);
}

void console_note(struct console *c, const char *fmt, ...)
{
	va_list ap;

	va_start(ap, fmt);
	print(c, stderr, "note", term_format(fmt, ap));
	va_end(ap);
}

void console_line(struct console *c, const char *fmt, ...)
{
	va_list ap;

	if (c->quiet || c->json)
		return;
	va_start(ap, fmt);
	print(c, c->report, NULL, term_format(fmt, ap));
	va_end(ap);
}

struct term_json console_json(const struct console *c)
{
	return term_json_begin(c->report, c->list);
}

struct term_table *console_table(const struct console *c, const struct term_column *columns, unsigned n)
{
	return c->json ? NULL : term_table_new(c->report, columns, n);
}

void console_begin_list(struct console *c)
{
	static char together[128 << 10];

	setvbuf(c->report, together, _IOFBF, sizeof together);
	c->list = true;
}

bool console_progress_on(const struct console *c)
{
	const char *term = getenv("TERM");

	return !c->quiet && !c->no_progress && !c->json && isatty(STDERR_FILENO) && !(term && !strcmp(term, "dumb"));
}

/* One write, over the old line, then what is left of that is cleared: nothing flickers. The last column stays free, since some
 * terminals go on to the next line there. */
void console_progress(struct console *c, const char *fmt, ...)
{
	unsigned width = term_of(stderr).width;
	char *text, *safe;
	va_list ap;

	va_start(ap, fmt);
	text = term_format(fmt, ap);
	va_end(ap);
	safe = text ? term_safe(text) : NULL;
	free(text);
	if (!safe)
		return;
	safe[term_fit(safe, width > 1 ? width - 1 : 79)] = 0;
	if (!c->progress_shown || strcmp(c->line, safe)) {
		snprintf(c->line, sizeof(c->line), "%s", safe);
		fprintf(stderr, "\r%s\033[K", safe);
		fflush(stderr);
		c->progress_shown = true;
	}
	free(safe);
}

void console_progress_clear(struct console *c)
{
	if (c->progress_shown)
		fputs("\r\033[K", stderr);
	c->progress_shown = false;
}

bool console_is_gone(int fd, int ms, bool *ret_other)
{
	struct pollfd p = {.fd = fd};
	struct stat st;

	*ret_other = fstat(fd, &st) || !(S_ISFIFO(st.st_mode) || S_ISSOCK(st.st_mode));
	return !*ret_other && poll(&p, 1, ms) == 1 && (p.revents & (POLLERR | POLLHUP));
}

bool console_reader_gone(void)
{
	bool other;

	return console_is_gone(STDOUT_FILENO, 0, &other);
}

int console_end(struct console *c, int status)
{
	struct err err = ERR_INIT;
	int error;

	console_progress_clear(c);
	for (size_t i = 0; i < c->nwarning; i++)
		free(c->warning[i]);
	free(c->warning);
	c->warning = NULL;
	c->nwarning = 0;
	errno = 0;
	if (!fflush(stdout) && !ferror(stdout)) {
		if (!term_lost())
			return status;
		err_set(&err, ERR_NOMEM, "there is no memory for all that was to be printed");
	} else if (errno == EPIPE || (!errno && console_reader_gone())) { /* the error of an earlier write is forgotten by now */
		return CONSOLE_PIPE;
	} else {
		err_sys(&err, errno ? errno : EIO, "standard output cannot be written");
	}
	c->report = stderr;
	if (status && !term_lost())
		return status;
	error = console_error(c, &err);
	return status ? status : error;
}
