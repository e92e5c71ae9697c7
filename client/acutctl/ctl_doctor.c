/*
 * doctor: problems of this side (socket, versions, groups, clock) and of the daemon, and what to do.
 *
 * Checks run in the order in which they depend on each other; each is ok, a warning, wrong, or unknown. The exit status is 0
 * without a wrong one; 1 with one; that of the failure if no daemon can be asked (69: no daemon answers, 77: it refuses this
 * user).
 */
#include <errno.h>
#include <grp.h>
#include <pwd.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/timex.h>
#include <unistd.h>

#include "ctl.h"
#include "term.h"

struct doctor {
	struct session *session;
	struct term_json json;
	unsigned ok, warnings, wrong, unknown;
};

/* ---- results of checks ---- */

static void show_text(struct doctor *d, const struct acut_check *c)
{
	enum term_tint tint = !strcmp(c->state, "ok") ? TERM_GOOD : !strcmp(c->state, "wrong") ? TERM_BAD : TERM_WARN;
	FILE *out = d->session->console.report;
	struct term term = term_of(out);

	if (d->session->console.quiet && tint == TERM_GOOD)
		return;
	fprintf(out, "%s%-8s%s %-10s ", term_tint(&term, tint), c->state, term_tint(&term, TERM_PLAIN), c->name);
	term_wrap(out, 20, c->message);
	if (!c->hint[0])
		return;
	fprintf(out, "%19s -> ", "");
	term_wrap(out, 23, c->hint);
}

static void report(void *ctx, const struct acut_check *c)
{
	struct doctor *d = ctx;

	if (!strcmp(c->state, "ok"))
		d->ok++;
	else if (!strcmp(c->state, "warning"))
		d->warnings++;
	else if (!strcmp(c->state, "wrong"))
		d->wrong++;
	else
		d->unknown++;
	if (!d->session->console.json) {
		show_text(d, c);
		return;
	}
	term_json_open(&d->json, NULL, '{');
	term_json_text(&d->json, "name", c->name);
	term_json_text(&d->json, "state", c->state);
	term_json_text(&d->json, "message", c->message);
	term_json_text(&d->json, "hint", c->hint[0] ? c->hint : NULL);
	term_json_close(&d->json, '}');
}

static void result(struct doctor *d, const char *name, const char *state, const char *hint, const char *fmt, ...)
	__attribute__((format(printf, 5, 6)));
static void result(struct doctor *d, const char *name, const char *state, const char *hint, const char *fmt, ...)
{
	char text[1024];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	report(d, &(const struct acut_check){.name = name, .state = state, .message = text, .hint = hint});
}

/* ---- this side ---- */

/* The user is in the group, but not this session: added after the login. */
static bool joined_since(const char *group)
{
	const struct group *gr = getgrnam(group);
	const struct passwd *pw = getpwuid(geteuid());
	gid_t groups[1024];
	int n = getgroups(1024, groups);
	bool member = false;

	if (!gr || !pw)
		return false;
	for (int i = 0; i < n; i++)
		if (groups[i] == gr->gr_gid)
			return false;
	for (char **name = gr->gr_mem; *name; name++)
		member |= !strcmp(*name, pw->pw_name);
	return member && getegid() != gr->gr_gid;
}

static void report_refused(struct doctor *d, const char *path, const struct err *why)
{
	if (joined_since("acut"))
		result(d, "rights", "wrong", "log out and in again: a group counts from the next login",
		       "%s: this user is in the group acut, but this session is not", why->message);
	else
		result(d, "rights", "wrong",
		       why->hint[0] ? why->hint : "an administrator can add the user to the group: adduser USER acut", "%s%s%s",
		       path ? path : "", path ? ": " : "", why->message);
}

/* Why no daemon answers, as far as the path shows it. */
static void report_unreachable(struct doctor *d, const char *path, const struct err *why)
{
	static const char start[] = "systemctl start acutd.socket; systemctl status acutd shows why it does not run";
	struct stat st;

	if (!path)
		result(d, "socket", "wrong", "start acutd (systemctl start acutd.socket), or give its socket with --socket", "%s",
		       why->message);
	else if (stat(path, &st) < 0 && errno == ENOENT)
		result(d, "socket", "wrong", start, "there is no socket %s: acutd does not run, or listens elsewhere", path);
	else if (stat(path, &st) < 0)
		result(d, "socket", "wrong", "check the rights of its folder", "cannot examine the socket %s: %s", path,
		       strerror(errno));
	else if (!S_ISSOCK(st.st_mode))
		result(d, "socket", "wrong", "give the path of acutd's socket with --socket or ACUT_SOCKET", "%s is no socket",
		       path);
	else if (why->code == ERR_NODAEMON)
		result(d, "socket", "wrong", start, "no process listens at %s: acutd has ended and left its socket", path);
	else
		result(d, "socket", "wrong", why->hint, "%s", why->message);
}

static void check_build(struct doctor *d)
{
	const char *build = acut_daemon_build(d->session->acut);
	double seconds;

	if (strcmp(build, ACUT_VERSION))
		result(d, "version", "warning", "install acutctl and acutd of one release, then: systemctl restart acutd",
		       "acutctl is %s, acutd is %s", ACUT_VERSION, build);
	else
		result(d, "version", "ok", "", "acutctl and acutd are %s", build);
	if (acut_ping(d->session->acut, &seconds))
		result(d, "answer", "wrong", "journalctl -t acutd", "acutd does not answer: %s",
		       acut_error(d->session->acut)->message);
	else if (seconds > 1)
		result(d, "answer", "warning", "check the load of the machine and the health of its disk",
		       "acutd took %.1f seconds to answer", seconds);
	else
		result(d, "answer", "ok", "", "acutd answered in %.1f ms", 1e3 * seconds);
}

static void check_sync(struct doctor *d)
{
	struct timex t = {0};
	int r = adjtimex(&t);

	if (r < 0)
		result(d, "time", "unknown", "", "whether the clock is synchronised cannot be asked: %s", strerror(errno));
	else if (t.status & STA_UNSYNC)
		result(d, "time", "warning", "have it set by NTP: timedatectl set-ntp true",
		       "the clock of this machine is not synchronised");
	else
		result(d, "time", "ok", "", "the clock of this machine is synchronised");
}

/* ---- all ---- */

static int ask(struct doctor *d)
{
	const char *path = session_path(d->session);
	struct err err = ERR_INIT;

	if (session_connect_try(d->session, &err)) {
		if (session_caught() || session_late(d->session))
			return -1;
		if (err.code == ERR_PERM)
			report_refused(d, path, &err);
		else
			report_unreachable(d, path, &err);
		return err_exit_status(err.code);
	}
	result(d, "socket", "ok", "", "%s answers", path ? path : "the private daemon");
	check_build(d);
	check_sync(d);
	if (!acut_doctor(d->session->acut, report, d))
		return d->wrong ? 1 : SESSION_DONE;
	session_failure(d->session, NULL, &err);
	if (err.code == ERR_UNSUPPORTED) {
		result(d, "daemon", "unknown", "install acutctl and acutd of one release", "this acutd cannot be asked: %s",
		       err.message);
		return d->wrong ? 1 : SESSION_DONE;
	}
	result(d, "daemon", "wrong", err.hint, "acutd cannot be asked: %s", err.message);
	return err_exit_status(err.code);
}

int ctl_doctor_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct doctor d = {.session = session};
	struct err err = ERR_INIT;
	int status;

	if (session->console.json) {
		d.json = console_json(&session->console);
		term_json_open(&d.json, "checks", '[');
	}
	status = ask(&d);
	if (status < 0) {
		err_set(&err, ERR_CANCELLED, "interrupted");
		return session_error(session, &err);
	}
	if (session->console.json) {
		term_json_close(&d.json, ']');
		term_json_u64(&d.json, "ok", d.ok);
		term_json_u64(&d.json, "warnings", d.warnings);
		term_json_u64(&d.json, "wrong", d.wrong);
		term_json_u64(&d.json, "unknown", d.unknown);
		term_json_end(&d.json);
	} else if (!session->console.quiet) {
		fprintf(session->console.report, "%s: %u ok, %u warning%s, %u wrong%s\n",
			d.wrong    ? "something is wrong" :
			d.warnings ? "it works" :
				     "all is well",
			d.ok, d.warnings, d.warnings == 1 ? "" : "s", d.wrong, d.unknown ? ", some is not known" : "");
	}
	return status;
}
