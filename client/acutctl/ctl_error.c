/*
 * How failures, warnings and notes are told. Read aloud, an error says which file, where in it, what is
 * wrong, and what to do: "acutctl: survey.las: byte 104, header size: ...", then "hint: ...".
 */
#include <errno.h>

#include "ctl.h"
#include "term.h"

int ctl_error(struct program *ctl, const struct err *given)
{
	struct err err = *given;
	int caught = ctl_signal_caught();

	ctl->failure = err;
	if (caught && err.code == ERR_CANCELLED) {
		console_progress_clear(&ctl->console);
		if (!ctl->console.quiet && !ctl->console.json)
			fprintf(stderr, "acutctl: interrupted\n");
		return 128 + caught;
	}
	if (err.code == ERR_CANCELLED && ctl->for_reader && ctl->out_closed)
		return CONSOLE_PIPE;
	if (err.sys == EPIPE && ctl->args.out.n) {
		ctl->out_closed = true;
		return CONSOLE_PIPE;
	}
	if (err.code == ERR_CANCELLED && ctl_signal_late(ctl)) {
		err = ERR_INIT;
		err_set(&err, ERR_TIMEOUT, "not done within %g seconds (--timeout)", ctl->args.timeout);
	}
	return console_error(&ctl->console, &err);
}

enum { REFUSALS_TOLD = 100 };

void ctl_refusal(struct program *ctl, const struct err *err)
{
	ctl->refusals++;
	if (!ctl->console.json && ctl->refusals <= REFUSALS_TOLD)
		ctl_error(ctl, err);
}

void ctl_refusals_end(struct program *ctl, int status)
{
	if (ctl->console.json || ctl->refusals <= REFUSALS_TOLD)
		return;
	console_progress_clear(&ctl->console);
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

int ctl_error_acut(struct program *ctl)
{
	struct err err;

	ctl_error_from_acut(ctl->acut, NULL, &err);
	return ctl_error(ctl, &err);
}
