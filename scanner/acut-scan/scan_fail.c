/*
 * How failures, warnings, notes and progress are told, as acutctl tells them. An error says which file, where in it,
 * what is wrong, and what to do.
 */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "scan.h"

static bool progress_shown;

FILE *scan_report(const struct scan_args *args)
{
	return args->output && !strcmp(args->output, "-") ? stderr : stdout;
}

int scan_fail(const struct scan_args *args, const struct err *err)
{
	struct term_json j = {.out = scan_report(args)};

	scan_progress_clear();
	if (err->code == ERR_CANCELLED && scan_stopped()) {
		if (!args->quiet && !args->json)
			fputs("acut-scan: interrupted\n", stderr);
		return 128 + scan_stop_signal();
	}
	if (args->json) {
		term_json_open(&j, NULL, '{');
		term_error_json(&j, "error", err);
		term_json_close(&j, '}');
		term_json_line(&j);
	} else {
		term_error_text("acut-scan", err);
	}
	return err_exit_status(err->code);
}

static void say(const struct scan_args *args, const char *what, const char *fmt, va_list ap)
{
	char *text;

	if (args->quiet || args->json || !(text = term_format(fmt, ap)))
		return;
	scan_progress_clear();
	term_line(stderr, "acut-scan: %s: %s", what, text);
	free(text);
}

void scan_note(const struct scan_args *args, const char *fmt, ...)
{
	va_list ap;

	va_start(ap, fmt);
	say(args, "note", fmt, ap);
	va_end(ap);
}

void scan_warn(const struct scan_args *args, const char *fmt, ...)
{
	va_list ap;

	va_start(ap, fmt);
	say(args, "warning", fmt, ap);
	va_end(ap);
}

bool scan_progress_on(const struct scan_args *args)
{
	const char *term = getenv("TERM");

	return !args->quiet && !args->json && !args->no_progress && isatty(STDERR_FILENO) && !(term && !strcmp(term, "dumb"));
}

void scan_progress(const char *fmt, ...)
{
	unsigned width = term_of(stderr).width;
	char *text, *safe;
	va_list ap;

	va_start(ap, fmt);
	text = term_format(fmt, ap);
	va_end(ap);
	if (!text)
		return;
	safe = term_safe(text);
	free(text);
	if (!safe)
		return;
	safe[term_fit(safe, width > 1 ? width - 1 : 79)] = 0;
	fprintf(stderr, "\r%s\033[K", safe);
	fflush(stderr);
	progress_shown = true;
	free(safe);
}

void scan_progress_clear(void)
{
	if (progress_shown)
		fputs("\r\033[K", stderr);
	progress_shown = false;
}
