/*
 * One pass over a drop folder: settled files are pushed into a dataset, and moved to done/ or failed/.
 *
 * A file has settled when this pass saw it unchanged (size and both times) for the time of --settle on the monotonic clock:
 * neither the times that copying programs set nor a jump of the wall clock make an incomplete file look complete. So a pass
 * needs no state of an earlier one, and waits at most that long. Files that change meanwhile are left to a later pass.
 *
 * Files are pushed in batches, sorted by name, with --checksum: a file that is in the dataset already, because the pass
 * before was killed between its commit and its moves or because it was delivered twice, is not stored again, and is moved. A
 * refused file does not hold up the others; a push that fails as a whole is halved until the cause is alone. Failures that
 * pass with time (no daemon, busy, no space) leave files where they are. acutd compares a file with the dataset, not with the
 * other files of its push: of files with the same content the first is pushed, and the others go with the next push. If the
 * first was refused for its content the others are refused without a push.
 *
 * An archive is as many inputs as it has survey files (ctl_archive.c). It is moved to failed/ if one of them was refused; the
 * others are in the dataset nevertheless.
 *
 * Only regular files of the folder itself are taken, and no link is followed. A lock on the folder keeps two passes apart.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "ctl_drop.h"
#include "ctl_ingest.h"
#include "digest.h"
#include "parse.h"

enum {
	BATCH_FILES = 1000,
	STUCK_MAX = 16, /* files that alone could not be pushed: the disk is full, or broken */
	LOOKS = 4,      /* in the time of --settle */
};
static const off_t BATCH_BYTES = (off_t)16 << 30;

struct ingest {
	struct session *session;
	const struct ctl_stage_options *opt;
	const struct ctl_input_options *input;
	const char *dataset;
	struct ctl_drop drop;
	struct ctl_drop_list list;
	struct err *bad; /* what contents were refused for, of which there are more files */
	size_t nbad;
	uint64_t settle;
	uint64_t until; /* what settles later is left to another pass */
	unsigned done, refused, left, stuck;
	int status; /* that ends the pass, or that of a file that is stuck */
};

/* ---- pushing ---- */

struct batch {
	struct ctl_drop_file **file;
	size_t n;
};

/* The inputs of a push, and of which file of its batch each is. */
struct sent {
	struct ctl_inputs in;
	size_t *of;
};

/* False: it cannot be read to its end; the push will report that. */
static bool hash_file(const struct ingest *g, struct ctl_drop_file *f)
{
	static uint8_t buf[64 << 10];
	int fd = openat(g->drop.fd, f->entry, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
	struct digest_stream *s = fd < 0 ? NULL : digest_stream_new();
	struct stat st;
	ssize_t n = -1;

	/* Another file may have its name by now. */
	if (s && !fstat(fd, &st) && ctl_input_unchanged(&f->in, &st))
		while ((n = read(fd, buf, sizeof(buf))) > 0 && !session_interrupted(g->session))
			digest_stream_add(s, buf, (size_t)n);
	f->hashed = n == 0;
	if (f->hashed)
		f->hash = digest_stream_end(s);
	digest_stream_free(s);
	if (fd >= 0)
		close(fd);
	return f->hashed;
}

/* Whether a file of the batch has the same bytes, and it is not known yet whether the dataset takes them. */
static bool is_twin(const struct ingest *g, const struct batch *b, struct ctl_drop_file *f)
{
	for (size_t i = 0; !f->taken && f->in.size && i < b->n; i++) {
		struct ctl_drop_file *other = b->file[i];

		if (other->in.size == f->in.size && (other->hashed || hash_file(g, other)) && (f->hashed || hash_file(g, f)) &&
		    digest_equal(other->hash, f->hash))
			return true;
	}
	return false;
}

static void note_taken(struct ingest *g, const struct ctl_drop_file *f)
{
	for (size_t i = 0; f->hashed && i < g->list.n; i++)
		if (g->list.file[i].hashed && digest_equal(g->list.file[i].hash, f->hash))
			g->list.file[i].taken = true;
}

/* By what is in it, whatever it is called. */
static bool is_content(const struct err *why)
{
	return (why->code == ERR_INPUT && strcmp(why->field, "name")) || why->code == ERR_TRUNCATED ||
	       why->code == ERR_UNSUPPORTED;
}

static const char *extension(const char *name)
{
	const char *dot = strrchr(name, '.');

	return dot ? dot : "";
}

/* Other files of the same content and extension get the same error. Without memory for it they are pushed. */
static void note_refused(struct ingest *g, const struct ctl_drop_file *f, const struct err *why)
{
	struct err *bad = NULL;

	for (size_t i = 0; f->hashed && is_content(why) && i < g->list.n; i++) {
		struct ctl_drop_file *other = &g->list.file[i];

		if (other->tried || other->taken || other->bad || !other->hashed || other->in.size != f->in.size ||
		    !digest_equal(other->hash, f->hash) || strcmp(extension(other->entry), extension(f->entry)))
			continue;
		if (!bad) {
			bad = realloc(g->bad, (g->nbad + 1) * sizeof *bad);
			if (!bad)
				return;
			g->bad = bad;
			g->bad[g->nbad++] = *why;
		}
		other->bad = g->nbad;
	}
}

/* Where a file of a push belongs. NULL: it stays. */
static const char *put_away(struct ingest *g, struct ctl_drop_file *f, const struct err *why, struct ctl_drop_name *name)
{
	struct err err = ERR_INIT;
	int r;

	if (why && why->code == ERR_CHANGED) {
		g->left++;
		return NULL;
	}
	r = why ? ctl_drop_failed(&g->drop, &f->in, g->dataset, why, name, &err) : ctl_drop_done(&g->drop, &f->in, name, &err);
	if (!r) {
		g->done += !why;
		g->refused += why != NULL;
		if (why)
			note_refused(g, f, why);
		else
			note_taken(g, f);
		return name->text;
	}
	r = session_error(g->session, &err);
	g->left++;
	if (err.code != ERR_CHANGED && !g->status)
		g->status = r;
	return NULL;
}

/* Why a file is refused: as its first input that is. NULL: it is not. `of` NULL: each input is a file. */
static const struct err *why_refused(const struct ctl_staged *s, const size_t *of, size_t file)
{
	for (size_t i = 0; i < s->nfile; i++)
		if ((of ? of[i] : i) == file && s->file[i].refused)
			return &s->file[i].err;
	return NULL;
}

/* Each file of a push that was made, or of which files were refused. */
static int put_away_all(struct ingest *g, const struct batch *b, const struct ctl_staged *s, const size_t *of)
{
	struct ctl_drop_name *names = calloc(b->n, sizeof(*names));
	const char **moved = calloc(b->n, sizeof(*moved)), **names_of = calloc(s->nfile + 1, sizeof(*names_of));
	struct err err = ERR_INIT;
	int status = 0;

	if (!names || !moved || !names_of) {
		err_set(&err, ERR_NOMEM, "no memory for %zu file names", b->n);
		status = session_error(g->session, &err);
	}
	for (size_t i = 0; !status && i < b->n; i++) {
		const struct err *why = why_refused(s, of, i);

		if (s->committed || why)
			moved[i] = put_away(g, b->file[i], why, &names[i]);
	}
	for (size_t i = 0; !status && i < s->nfile; i++)
		names_of[i] = moved[of ? of[i] : i];
	if (!status && (s->committed || s->refused == s->nfile))
		status = ctl_report_push(g->session, s, names_of);
	free(names);
	free(moved);
	free(names_of);
	return status;
}

/* Whether the failure of a whole push may be about one of its files. */
static bool may_be_one(enum err_code code)
{
	return code == ERR_IO || code == ERR_NOSPACE || code == ERR_LIMIT || code == ERR_INPUT || code == ERR_TRUNCATED ||
	       code == ERR_CHANGED || code == ERR_UNSUPPORTED || code == ERR_INTERNAL;
}

static bool is_refused(enum err_code code)
{
	return code == ERR_INPUT || code == ERR_TRUNCATED || code == ERR_UNSUPPORTED || code == ERR_LIMIT;
}

/* It failed alone: it is refused, or it stays and the others go on, for a while. */
static int alone(struct ingest *g, struct ctl_drop_file *f, int status)
{
	struct ctl_drop_name name;
	struct err why = g->session->failure;

	if (is_refused(why.code)) {
		put_away(g, f, &why, &name);
		return 0;
	}
	g->left++;
	if (why.code == ERR_CHANGED)
		return 0;
	g->stuck++;
	if (!g->status)
		g->status = status;
	return g->stuck < STUCK_MAX ? 0 : status;
}

static void sent_done(struct sent *t)
{
	ctl_inputs_done(&t->in);
	free(t->of);
}

/* The batch as inputs. */
static int send(struct ingest *g, const struct batch *b, struct sent *ret, struct err *err)
{
	*ret = (struct sent){.in = ctl_inputs_of(g->session, g->input)};
	ret->in.each = true;
	for (size_t i = 0; i < b->n; i++) {
		size_t before = ret->in.n, *grown;
		int r = ctl_inputs_add(&ret->in, &b->file[i]->in, false, err);

		grown = r ? NULL : realloc(ret->of, (ret->in.n + 1) * sizeof(*ret->of));
		if (!grown) {
			r = r ? r : err_set(err, ERR_NOMEM, "no memory for %zu inputs", ret->in.n);
			sent_done(ret);
			return r;
		}
		ret->of = grown;
		for (size_t k = before; k < ret->in.n; k++)
			ret->of[k] = i;
	}
	return 0;
}

/* 0, or the status that ends the pass. */
static int push(struct ingest *g, struct batch b)
{
	struct session *session = g->session;
	struct ctl_staged staged = {.nfile = 0};
	struct sent sent;
	struct err err = ERR_INIT;
	bool made = false;
	int status;

	if (send(g, &b, &sent, &err))
		return session_error(session, &err);
	status = session->acut ? 0 : session_connect(session);
	if (!status) {
		status = ctl_stage(&sent.in, g->opt, g->dataset, &staged);
		made = staged.committed || staged.refused == sent.in.n || (g->opt->strict && staged.refused);
	}
	if (made) {
		int reported = put_away_all(g, &b, &staged, sent.of);

		status = reported ? reported : staged.committed || staged.refused == sent.in.n ? 0 : status;
	}
	/* A push that was left ends with its connection. */
	if (!staged.committed)
		session_disconnect(session);
	ctl_stage_done(&staged);
	sent_done(&sent);
	if (!status || made || session_interrupted(session) || !may_be_one(session->failure.code))
		return status;
	if (b.n == 1)
		return alone(g, b.file[0], status);
	status = push(g, (struct batch){b.file, b.n / 2});
	return status ? status : push(g, (struct batch){b.file + b.n / 2, b.n - b.n / 2});
}

/* The next batch; returns how many entries of the list it covers. */
static size_t next_batch(const struct ingest *g, struct ctl_drop_file **list, size_t n, struct batch *ret)
{
	struct batch b = {calloc(BATCH_FILES, sizeof(*list)), 0};
	off_t bytes = 0;
	size_t at = 0;

	while (b.file && at < n && b.n < BATCH_FILES && (!b.n || bytes < BATCH_BYTES)) {
		struct ctl_drop_file *f = list[at++];

		if (is_twin(g, &b, f))
			continue;
		bytes += f->in.size;
		f->tried = true;
		b.file[b.n++] = f;
	}
	*ret = b;
	return at;
}

/* Refused without a push, as one of the same content was. `list` keeps the others, *n of them. */
static int refuse_twins(struct ingest *g, struct ctl_drop_file **list, size_t *n)
{
	struct ctl_staged s = {.file = calloc(*n + 1, sizeof(*s.file))};
	struct batch b = {calloc(*n + 1, sizeof(*list)), 0};
	struct err err = ERR_INIT;
	size_t kept = 0;
	int status = 0;

	if (!s.file || !b.file) {
		err_set(&err, ERR_NOMEM, "no memory for %zu files", *n);
		status = session_error(g->session, &err);
	}
	for (size_t i = 0; !status && i < *n; i++) {
		struct ctl_staged_file *to = &s.file[b.n];

		if (!list[i]->bad) {
			list[kept++] = list[i];
			continue;
		}
		*to = (struct ctl_staged_file){.name = list[i]->in.name, .refused = true, .err = g->bad[list[i]->bad - 1]};
		*to->err.file = 0;
		err_add_file(&to->err, list[i]->in.name);
		list[i]->tried = true;
		session_refusal(g->session, &to->err);
		b.file[b.n++] = list[i];
	}
	s.nfile = s.refused = b.n;
	snprintf(s.dataset, sizeof(s.dataset), "%s", g->dataset);
	if (b.n)
		status = put_away_all(g, &b, &s, NULL);
	*n = kept;
	free(s.file);
	free(b.file);
	return status;
}

/* Pushes settled files in batches. *ret_any: there were some. */
static int push_settled(struct ingest *g, bool *ret_any)
{
	/* The time of the scan, not of now: a scan may take long, and the process may have been stopped since. */
	uint64_t now = g->list.scanned_ns;
	struct ctl_drop_file **list = calloc(g->list.n + 1, sizeof(*list));
	struct err err = ERR_INIT;
	size_t n = 0, at = 0;
	int status = 0;

	if (!list) {
		err_set(&err, ERR_NOMEM, "no memory for %zu files", g->list.n);
		return session_error(g->session, &err);
	}
	for (size_t i = 0; i < g->list.n; i++)
		if (!g->list.file[i].tried && now >= g->list.file[i].since + g->settle &&
		    g->list.file[i].since + g->settle <= g->until)
			list[n++] = &g->list.file[i];
	*ret_any = n;
	status = refuse_twins(g, list, &n);
	while (!status && at < n) {
		struct batch b;

		at += next_batch(g, list + at, n - at, &b);
		if (b.file) {
			status = push(g, b);
		} else {
			err_set(&err, ERR_NOMEM, "no memory for a list of files");
			status = session_error(g->session, &err);
		}
		free(b.file);
	}
	free(list);
	return status;
}

/* ---- the pass ---- */

/* Until the next of them may have settled; false: there is none that will in this pass. */
static bool wait_for_some(struct ingest *g)
{
	uint64_t next = UINT64_MAX, now = clock_mono_ns(), most = now + g->settle / LOOKS;
	size_t waiting = 0;

	for (size_t i = 0; i < g->list.n; i++) {
		if (g->list.file[i].tried)
			continue;
		waiting++;
		if (g->list.file[i].since + g->settle < next)
			next = g->list.file[i].since + g->settle;
	}
	if (!waiting || next > g->until)
		return false;
	/* Not in one go: a file that changes meanwhile is noticed soon. */
	next = next < most ? next : most;
	while (!session_interrupted(g->session) && (now = clock_mono_ns()) < next) {
		uint64_t ms = (next - now) / 1000000 + 1;

		poll(NULL, 0, ms < 500 ? (int)ms : 500);
	}
	return true;
}

static int interrupted(struct ingest *g)
{
	struct err err = ERR_INIT;

	err_set(&err, ERR_CANCELLED, "interrupted");
	return session_error(g->session, &err);
}

static int pass(struct ingest *g)
{
	struct err err = ERR_INIT;
	bool any = true, printed = false;
	int status = 0;

	for (;;) {
		if (session_interrupted(g->session))
			return interrupted(g);
		if (ctl_drop_scan(&g->drop, &g->list, &err))
			return session_error(g->session, &err);
		if (!g->until)
			g->until = clock_mono_ns() + 2 * g->settle;
		status = push_settled(g, &any);
		if (status)
			return status;
		if (any)
			continue;
		if (!printed && g->list.n && g->settle)
			console_line(&g->session->console, "%s: waiting until files have not changed for %g s", g->drop.name,
				     (double)g->settle * 1e-9);
		printed = true;
		if (!wait_for_some(g))
			return 0;
	}
}

static int finish(struct ingest *g, int status)
{
	size_t settling = 0;
	char more[96] = "";

	for (size_t i = 0; i < g->list.n; i++)
		settling += g->list.file[i].there && !g->list.file[i].tried;
	if (g->list.passed_by)
		snprintf(more, sizeof(more), "; %u left that are no regular files", g->list.passed_by);
	if (g->done || g->refused || g->left || settling || g->list.passed_by)
		console_line(&g->session->console, "%s: %u done, %u refused, %zu stay for another pass%s", g->drop.name, g->done,
			     g->refused, settling + g->left, more);
	if (!status)
		status = g->status;
	if (!status && g->refused)
		status = g->done ? SESSION_SOME_REFUSED : 1;
	return status;
}

static int check(const struct ingest *g, const char *settle, uint64_t *ret_settle, struct err *err)
{
	double seconds = 30;

	if (ctl_stage_check(g->opt, g->input, err))
		return -(int)err->code;
	if (settle && (!parse_seconds(settle, &seconds) || seconds < 0 || seconds > 86400))
		return err_set(err, ERR_USAGE, "--settle is not a time of at most a day: \"%s\" (30, 30s, 5m)", settle);
	*ret_settle = (uint64_t)(seconds * 1e9);
	return 0;
}

static int lock(struct ingest *g, struct err *err)
{
	if (!flock(g->drop.fd, LOCK_EX | LOCK_NB))
		return 0;
	if (errno != EWOULDBLOCK)
		err_sys(err, errno, "the folder cannot be locked");
	else
		err_set(err, ERR_BUSY, "another ingest is at work on the folder");
	return err_add_file(err, g->drop.name);
}

int ctl_ingest(struct session *session, const struct ctl_stage_options *opt, const struct ctl_input_options *input,
	       const char *dataset, const char *folder, const char *settle)
{
	struct ctl_stage_options by_content = *opt;
	struct ingest g = {.session = session, .opt = &by_content, .input = input, .dataset = dataset};
	struct err err = ERR_INIT;
	int status;

	/* Names and times depend on the sender: a file that comes twice is recognised by its content. */
	by_content.checksum = true;
	if (check(&g, settle, &g.settle, &err))
		return session_error(session, &err);
	/* Lines reach a journal at once, in order with those of standard error. */
	setvbuf(stdout, NULL, _IOLBF, BUFSIZ);
	if (ctl_drop_open(&g.drop, folder, &err) || lock(&g, &err)) {
		ctl_drop_close(&g.drop);
		return session_error(session, &err);
	}
	status = finish(&g, pass(&g));
	ctl_drop_list_done(&g.list);
	free(g.bad);
	ctl_drop_close(&g.drop);
	return status;
}
