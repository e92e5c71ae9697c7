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

void scan_error_json(struct ctl_json *j, const char *key, const struct err *err)
{
	ctl_json_open(j, key, '{');
	ctl_json_text(j, "code", err_wire_name(err->code));
	ctl_json_text(j, "file", err->file[0] ? err->file : NULL);
	if (err->offset == ERR_NO_OFFSET)
		ctl_json_text(j, "offset", NULL);
	else
		ctl_json_u64(j, "offset", err->offset);
	ctl_json_text(j, "field", err->field[0] ? err->field : NULL);
	ctl_json_text(j, "message", err->message);
	ctl_json_text(j, "hint", err->hint[0] ? err->hint : NULL);
	ctl_json_close(j, '}');
}

/* The place is left out where the message names the line itself. */
static void print_text(const struct err *err)
{
	bool line = !strcmp(err->field, "line"), place = err->offset != ERR_NO_OFFSET && !line;
	char at[64] = "";

	if (place)
		snprintf(at, sizeof(at), "byte %llu%s", (unsigned long long)err->offset, err->field[0] ? ", " : ": ");
	ctl_term_line(stderr, "acut-scan: %s%s%s%s%s%s", err->file, err->file[0] ? ": " : "", at, line ? "" : err->field,
		      err->field[0] && !line ? ": " : "", err->message[0] ? err->message : err_wire_name(err->code));
	if (err->hint[0])
		ctl_term_line(stderr, "hint: %s", err->hint);
}

int scan_fail(const struct scan_args *args, const struct err *err)
{
	struct ctl_json j = {.out = scan_report(args)};

	scan_progress_clear();
	if (err->code == ERR_CANCELLED && scan_stopped()) {
		if (!args->quiet && !args->json)
			fputs("acut-scan: interrupted\n", stderr);
		return 128 + scan_stop_signal();
	}
	if (args->json) {
		ctl_json_open(&j, NULL, '{');
		scan_error_json(&j, "error", err);
		ctl_json_close(&j, '}');
		ctl_json_line(&j);
	} else {
		print_text(err);
	}
	return err_exit_status(err->code);
}

static void say(const struct scan_args *args, const char *what, const char *fmt, va_list ap)
{
	char *text;

	if (args->quiet || args->json || vasprintf(&text, fmt, ap) < 0)
		return;
	scan_progress_clear();
	ctl_term_line(stderr, "acut-scan: %s: %s", what, text);
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
	unsigned width = ctl_term_of(stderr).width;
	char *text, *safe;
	va_list ap;
	int n;

	va_start(ap, fmt);
	n = vasprintf(&text, fmt, ap);
	va_end(ap);
	if (n < 0)
		return;
	safe = ctl_term_safe(text);
	free(text);
	if (!safe)
		return;
	safe[ctl_term_fit(safe, width > 1 ? width - 1 : 79)] = 0;
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
