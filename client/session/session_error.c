/*
 * How a failure is printed. A caught signal, a passed deadline or a reader that is gone is the cause, whatever error the
 * interrupted call has.
 */
#include <errno.h>

#include "session.h"
#include "term.h"

int session_error(struct session *session, const struct err *given)
{
	struct err err = *given;
	int caught = session_caught();

	session->failure = err;
	if (caught && err.code == ERR_CANCELLED) {
		console_progress_clear(&session->console);
		if (!session->console.quiet && !session->console.json)
			fprintf(stderr, "%s: interrupted\n", session->console.program);
		return 128 + caught;
	}
	if (err.code == ERR_CANCELLED && session->for_reader && session->out_closed)
		return CONSOLE_PIPE;
	if (err.sys == EPIPE && session->writes) {
		session->out_closed = true;
		return CONSOLE_PIPE;
	}
	if (err.code == ERR_CANCELLED && session_late(session)) {
		err = ERR_INIT;
		err_set(&err, ERR_TIMEOUT, "not done within %g seconds (--timeout)", session->opt.timeout);
	}
	return console_error(&session->console, &err);
}

enum { REFUSALS_MOST = 100 };

void session_refusal(struct session *session, const struct err *err)
{
	session->refusals++;
	if (!session->console.json && session->refusals <= REFUSALS_MOST)
		session_error(session, err);
}

void session_refusals_end(struct session *session, int status)
{
	if (session->console.json || session->refusals <= REFUSALS_MOST)
		return;
	console_progress_clear(&session->console);
	/* Where none was good JSON has the failure alone. */
	term_line(stderr, "%s: %llu more inputs were refused, %llu in all%s", session->console.program,
		  session->refusals - REFUSALS_MOST, session->refusals,
		  status == SESSION_SOME_REFUSED ? ": --json lists each" : "");
}

void session_failure_of(const struct acut_failure *f, struct err *ret)
{
	*ret = ERR_INIT;
	err_set(ret, f->code > 0 && f->code < ERR_COUNT ? (enum err_code)f->code : ERR_INTERNAL, "%s", f->message);
	if (f->file[0])
		err_add_file(ret, f->file);
	err_add_place(ret, f->offset, f->field);
	if (f->hint[0])
		err_add_hint(ret, "%s", f->hint);
}

int session_failure(const struct session *session, const char *file, struct err *ret)
{
	session_failure_of(acut_error(session->acut), ret);
	return file ? err_add_file(ret, file) : -(int)ret->code;
}

int session_error_acut(struct session *session)
{
	struct err err;

	session_failure(session, NULL, &err);
	return session_error(session, &err);
}
