/*
 * metrics: numbers of the daemon in the Prometheus text format, on standard output or as a file for the node exporter.
 *
 * Samples come in pages, and the format wants all samples of a name together; so they are collected as text, a buffer for
 * each name, and written after the last page. The file is replaced as a whole: it is written beside its place under a name
 * that the node exporter does not read, and renamed. If no daemon answers the file has acut_up 0.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <pwd.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "ctl.h"
#include "io_place.h"

struct family {
	struct family *next; /* in the order of their first samples */
	char *name, *type, *help, *lines;
	size_t size;
	FILE *out; /* into lines */
};

struct user {
	struct user *next;
	char uid[16], name[64];
};

struct gathering {
	struct family *first, **end;
	struct user *users;
	bool no_memory;
};

/* ---- gathering ---- */

static struct family *family_of(struct gathering *g, const struct acut_metric *m)
{
	struct family *f;

	for (f = g->first; f && strcmp(f->name, m->name); f = f->next)
		;
	if (f)
		return f;
	f = calloc(1, sizeof(*f));
	if (!f)
		return NULL;
	f->name = strdup(m->name);
	f->type = strdup(m->type);
	f->help = strdup(m->help);
	f->out = open_memstream(&f->lines, &f->size);
	*g->end = f;
	g->end = &f->next;
	return f->name && f->type && f->help && f->out ? f : NULL;
}

/* The name of a user, as this machine knows it now; "": it does not. */
static const char *user_name(struct gathering *g, const char *uid)
{
	struct user *u;
	struct passwd *pw;

	for (u = g->users; u && strcmp(u->uid, uid); u = u->next)
		;
	if (u)
		return u->name;
	u = calloc(1, sizeof(*u));
	if (!u)
		return "";
	snprintf(u->uid, sizeof(u->uid), "%s", uid);
	pw = getpwuid((uid_t)strtoul(uid, NULL, 10));
	if (pw)
		snprintf(u->name, sizeof(u->name), "%s", pw->pw_name);
	u->next = g->users;
	g->users = u;
	return u->name;
}

/* As the format has it: backslash, line feed, and in values of labels the quote. */
static void escaped(FILE *out, const char *text, bool quote)
{
	for (; *text; text++) {
		if (*text == '\\' || (quote && *text == '"'))
			fputc('\\', out);
		if (*text == '\n')
			fputs("\\n", out);
		else
			fputc(*text, out);
	}
}

static void number(FILE *out, double v)
{
	if (isnan(v))
		fputs("NaN", out);
	else if (isinf(v))
		fputs(v < 0 ? "-Inf" : "+Inf", out);
	else if (v == floor(v) && fabs(v) < 9007199254740992.0)
		fprintf(out, "%.0f", v);
	else
		fprintf(out, "%.17g", v);
}

static void add_label(FILE *out, bool first, const char *name, const char *value)
{
	fprintf(out, "%s%s=\"", first ? "{" : ",", name);
	escaped(out, value, true);
	fputc('"', out);
}

static void gather(void *ctx, const struct acut_metric *m)
{
	struct gathering *g = ctx;
	struct family *f = family_of(g, m);
	const char *name;

	if (!f) {
		g->no_memory = true;
		return;
	}
	fputs(m->name, f->out);
	for (size_t i = 0; i < m->nlabel; i++) {
		add_label(f->out, !i, m->label[2 * i], m->label[2 * i + 1]);
		name = !strcmp(m->label[2 * i], "uid") ? user_name(g, m->label[2 * i + 1]) : "";
		if (*name)
			add_label(f->out, false, "user", name);
	}
	fputs(m->nlabel ? "} " : " ", f->out);
	number(f->out, m->value);
	fputc('\n', f->out);
}

static void gathering_done(struct gathering *g)
{
	struct family *f;
	struct user *u;

	while ((f = g->first)) {
		g->first = f->next;
		if (f->out)
			fclose(f->out);
		free(f->lines);
		free(f->name);
		free(f->type);
		free(f->help);
		free(f);
	}
	while ((u = g->users)) {
		g->users = u->next;
		free(u);
	}
}

static void write_all(struct gathering *g, FILE *out)
{
	for (struct family *f = g->first; f; f = f->next) {
		if (fflush(f->out))
			g->no_memory = true;
		fprintf(out, "# HELP %s ", f->name);
		escaped(out, f->help, false);
		fprintf(out, "\n# TYPE %s %s\n", f->name, f->type);
		fwrite(f->lines, 1, f->size, out);
	}
}

/* ---- JSON ---- */

static void sample_json(void *ctx, const struct acut_metric *m)
{
	struct term_json *j = ctx;

	term_json_open(j, NULL, '{');
	term_json_text(j, "name", m->name);
	term_json_text(j, "type", m->type);
	term_json_open(j, "labels", '{');
	for (size_t i = 0; i < m->nlabel; i++)
		term_json_text(j, m->label[2 * i], m->label[2 * i + 1]);
	term_json_close(j, '}');
	term_json_number(j, "value", m->value);
	term_json_end(j);
}

/* ---- the file ---- */

static int publish_at(struct gathering *g, const struct io_place *at, const char *path, struct err *err)
{
	char temp[NAME_MAX + 1];
	FILE *out;
	int fd, r = 0, saved;

	if ((size_t)snprintf(temp, sizeof(temp), "%s.%ld.tmp", at->name, (long)getpid()) >= sizeof(temp))
		return err_set(err, ERR_USAGE, "the name of the file is too long: %.100s", path);
	unlinkat(at->dirfd, temp, 0);
	fd = openat(at->dirfd, temp, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0644);
	if (fd < 0) {
		err_sys(err, errno, "cannot make the file %s", temp);
		return err_add_file(err, path);
	}
	out = fdopen(fd, "w");
	if (!out) {
		close(fd);
		unlinkat(at->dirfd, temp, 0);
		return err_set(err, ERR_NOMEM, "no memory for a file");
	}
	write_all(g, out);
	/* The collector is another user, whatever the umask is. */
	errno = 0;
	if (fflush(out) || ferror(out) || fchmod(fd, 0644) < 0)
		r = err_sys(err, errno ? errno : EIO, "cannot write the file");
	saved = fclose(out) ? errno : 0;
	if (!r && saved)
		r = err_sys(err, saved, "cannot write the file");
	if (!r && renameat(at->dirfd, temp, at->dirfd, at->name) < 0)
		r = err_sys(err, errno, "cannot rename the file to its name");
	if (!r)
		return 0;
	unlinkat(at->dirfd, temp, 0);
	return err_add_file(err, path);
}

/* A link of that name is replaced. */
static int publish(struct gathering *g, const char *path, struct err *err)
{
	struct io_place at;
	int r = io_place_find(path, false, &at, err);

	if (r)
		return r;
	r = publish_at(g, &at, path, err);
	io_place_done(&at);
	return r;
}

static int finish(struct session *session, const char *file, struct gathering *g)
{
	struct err err = ERR_INIT;

	if (g->no_memory)
		err_set(&err, ERR_NOMEM, "no memory for all metrics");
	else if (file)
		publish(g, file, &err);
	else
		write_all(g, session->console.report);
	return err.code ? session_error(session, &err) : SESSION_DONE;
}

int ctl_metrics_run(struct program *ctl)
{
	static const struct acut_metric down = {.name = "acut_up", .type = "gauge", .help = "1: acutd answers."};
	struct session *session = &ctl->session;
	const char *file = ctl->opt.textfile;
	struct gathering g = {.end = &g.first};
	struct term_json j = {.out = session->console.report, .list = true};
	struct err err = ERR_INIT;
	int status, written;

	if (session->console.json && file) {
		err_set(&err, ERR_USAGE, "--textfile writes the format of Prometheus, not JSON");
		return session_error(session, &err);
	}
	status = session_connect(session);
	if (!status &&
	    acut_metrics(session->acut, session->console.json ? sample_json : gather, session->console.json ? (void *)&j : &g))
		status = session_error_acut(session);
	if (!status && !session->console.json)
		status = finish(session, file, &g);
	else if (status && file && !session_caught()) {
		gathering_done(&g);
		g = (struct gathering){.end = &g.first};
		gather(&g, &down);
		written = finish(session, file, &g);
		status = written ? written : status;
	}
	gathering_done(&g);
	return status;
}
