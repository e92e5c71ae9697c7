/*
 * How failures, warnings and notes are told. Read aloud, an error says which file, where in it, what is
 * wrong, and what to do: "acutctl: survey.las: byte 104, header size: ...", then "hint: ...".
 */
#include <errno.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "ctl.h"
#include "term.h"

static void print_json(struct ctl *ctl, const struct err *err)
{
	struct term_json j = {.out = ctl->report};

	term_json_open(&j, NULL, '{');
	term_error_json(&j, "error", err);
	term_json_close(&j, '}');
	term_json_line(&j);
}

int ctl_error(struct ctl *ctl, const struct err *given)
{
	struct err err = *given;
	int caught = ctl_signal_caught();

	ctl->failure = err;
	if (caught && err.code == ERR_CANCELLED) {
		ctl_progress_clear(ctl);
		if (!ctl->args.quiet && !ctl->args.json)
			fprintf(stderr, "acutctl: interrupted\n");
		return 128 + caught;
	}
	if (err.code == ERR_CANCELLED && ctl->for_reader && ctl->out_closed)
		return CTL_PIPE;
	if (err.sys == EPIPE && ctl->args.nout) {
		ctl->out_closed = true;
		return CTL_PIPE;
	}
	if (err.code == ERR_CANCELLED && ctl_signal_late(ctl)) {
		err = ERR_INIT;
		err_set(&err, ERR_TIMEOUT, "not done within --timeout %s", ctl->args.timeout);
	}
	ctl_progress_clear(ctl);
	if (ctl->args.json)
		print_json(ctl, &err);
	else
		term_error_text("acutctl", &err);
	return err_exit_status(err.code);
}

enum { REFUSALS_TOLD = 100 };

void ctl_refusal(struct ctl *ctl, const struct err *err)
{
	ctl->refusals++;
	if (!ctl->args.json && ctl->refusals <= REFUSALS_TOLD)
		ctl_error(ctl, err);
}

void ctl_refusals_end(struct ctl *ctl, int status)
{
	if (ctl->args.json || ctl->refusals <= REFUSALS_TOLD)
		return;
	ctl_progress_clear(ctl);
	/* Where none was good JSON has the failure alone. */
	term_line(stderr, "acutctl: %llu more inputs were refused, %llu in all%s", ctl->refusals - REFUSALS_TOLD, ctl->refusals,
		  status == CTL_SOME_REFUSED ? ": --json tells each" : "");
}

void ctl_error_from_failure(const struct acut_failure *f, struct err *ret)
{
	*ret = ERR_INIT;
	err_set(ret, f->code > 0 && f->code < ERR_COUNT ? (enum err_code)f->code : ERR_INTERNAL, "%s", f->message);
	if (f->file[0])
		err_add_file(ret, f->file);
	err_add_place(ret, f->offset, f->field);
	if (f->hint[0])
		err_add_hint(ret, "%s", f->hint);
}

int ctl_error_from_acut(const struct acut *acut, const char *file, struct err *ret)
{
	ctl_error_from_failure(acut_error(acut), ret);
	return file ? err_add_file(ret, file) : -(int)ret->code;
}

int ctl_error_acut(struct ctl *ctl)
{
	struct err err;

	ctl_error_from_acut(ctl->acut, NULL, &err);
	return ctl_error(ctl, &err);
}

void ctl_warn(struct ctl *ctl, const char *fmt, ...)
{
	va_list ap;
	char *text, **grown;

	va_start(ap, fmt);
	text = term_format(fmt, ap);
	va_end(ap);
	if (!text)
		return;
	for (size_t i = 0; i < ctl->nwarning; i++) {
		if (!strcmp(ctl->warning[i], text)) { /* of a file: said with its header and with its points */
			free(text);
			return;
		}
	}
	if (!ctl->args.quiet && !ctl->args.json) {
		ctl_progress_clear(ctl);
		term_line(stderr, "acutctl: warning: %s", text);
	}
	grown = realloc(ctl->warning, (ctl->nwarning + 1) * sizeof(*grown));
	if (!grown) {
		free(text);
		return;
	}
	ctl->warning = grown;
	ctl->warning[ctl->nwarning++] = text;
}

void ctl_remark(struct ctl *ctl, const char *text)
{
	if (!*text || ctl->args.quiet || ctl->args.json)
		return;
	ctl_progress_clear(ctl);
	term_line(stderr, "acutctl: note: %s", text);
}

void ctl_note(struct ctl *ctl, const char *fmt, ...)
{
	va_list ap;
	char *text;

	if (ctl->args.quiet || ctl->args.json)
		return;
	va_start(ap, fmt);
	text = term_format(fmt, ap);
	va_end(ap);
	if (!text)
		return;
	ctl_progress_clear(ctl);
	term_line(ctl->report, "%s", text);
	free(text);
}
