/* Text files of a work folder: lines, and a check at the end. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "err.h"
#include "io.h"
#include "work_priv.h"

#define VERSION "2"                   /* of version 1 the kernel is not compared */
enum { CHECK = 6 + 16 + 1 };          /* "check ", 16 digits, a line feed */
#define TEXT_MOST ((uint64_t)1 << 31) /* bytes */

/* ---- writing ---- */

int work_out_begin(struct work_out *o, const char *kind, struct err *err)
{
	*o = (struct work_out){NULL};
	o->to = open_memstream(&o->bytes, &o->size);
	if (!o->to)
		return err_set(err, ERR_NOMEM, "no memory for a text");
	fprintf(o->to, "%s %s\n", kind, VERSION);
	return 0;
}

void work_out_line(struct work_out *o, const char *key, const char *rest)
{
	fputs(key, o->to);
	fputc(' ', o->to);
	for (; *rest; rest++) {
		const char *code = *rest == '\\' ? "\\\\" : *rest == '\n' ? "\\n" : *rest == '\r' ? "\\r" : NULL;

		if (code)
			fputs(code, o->to);
		else
			fputc(*rest, o->to);
	}
	fputc('\n', o->to);
}

int work_out_end(struct work_out *o, struct err *err)
{
	bool bad = fflush(o->to) != 0;

	if (!bad)
		fprintf(o->to, "check %016llx\n", (unsigned long long)XXH3_64bits(o->bytes, o->size));
	bad |= fclose(o->to) != 0;
	o->to = NULL;
	return bad ? err_set(err, ERR_NOMEM, "no memory for a text") : 0;
}

void work_out_done(struct work_out *o)
{
	if (o->to)
		fclose(o->to);
	free(o->bytes);
	*o = (struct work_out){NULL};
}

int work_write_new(const struct work *w, const char *temp, const void *bytes, size_t n, struct err *err)
{
	int fd, r = io_open(w->fd, temp, O_WRONLY | O_CREAT | O_EXCL, 0640, &fd, err);

	if (r)
		return r;
	r = io_write_at(fd, bytes, n, 0, temp, err);
	if (!r)
		r = io_sync(fd, temp, err);
	/* A shared file system may report a failed write only here. */
	if (io->close(fd) < 0 && !r)
		r = err_sys(err, errno, "cannot write %s", temp);
	if (r)
		io->unlinkat(w->fd, temp, 0);
	return r;
}

/* ---- reading ---- */

int work_corrupt(const char *name, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "%s", what);
	return err_add_file(err, name);
}

/* The text of an open file, with a zero behind it. `again`: the file may not be complete yet. */
static int read_text(int fd, const char *name, struct work_in *in, bool *again, struct err *err)
{
	char *check, sum[32];
	struct stat st;
	int r;

	*again = false;
	if (io->fstat(fd, &st) < 0) {
		*again = work_passing(errno);
		return err_sys(err, errno, "cannot read %s", name);
	}
	if ((uint64_t)st.st_size > TEXT_MOST)
		return work_corrupt(name, "it is too large for a file of a work folder", err);
	in->size = (size_t)st.st_size;
	in->text = malloc(in->size + 1);
	if (!in->text)
		return err_set(err, ERR_NOMEM, "no memory to read %s", name);
	r = io_read_at(fd, in->text, in->size, 0, name, err);
	if (r) {
		*again = err->code == ERR_TRUNCATED || work_passing(err->sys);
		return r;
	}
	in->text[in->size] = 0;
	*again = true;
	if (in->size < CHECK || memchr(in->text, 0, in->size))
		return work_corrupt(name, "it is damaged", err);
	check = in->text + in->size - CHECK;
	snprintf(sum, sizeof sum, "check %016llx\n", (unsigned long long)XXH3_64bits(in->text, in->size - CHECK));
	if (memcmp(check, sum, CHECK) != 0)
		return work_corrupt(name, "it is damaged", err);
	*again = false;
	*check = 0;
	in->at = in->text;
	return 0;
}

static int check_kind(struct work_in *in, const char *name, const char *kind, struct err *err)
{
	char *key, *rest;

	if (!work_in_line(in, &key, &rest) || strcmp(key, kind) != 0)
		return work_corrupt(name, "it is of another kind", err);
	if (strcmp(rest, VERSION) == 0 || strcmp(rest, "1") == 0)
		return 0;
	err_set(err, ERR_VERSION, "it has version %.20s, this version of acut reads up to " VERSION, rest);
	return err_add_file(err, name);
}

int work_in_read(const struct work *w, const char *name, const char *kind, bool wait, struct work_in *ret, struct err *err)
{
	double waited = 0;
	bool again;
	int fd, r;

	for (;;) {
		*ret = (struct work_in){NULL};
		fd = io->openat(w->fd, name, O_RDONLY | O_CLOEXEC, 0);
		if (fd < 0) {
			again = work_passing(errno);
			r = again ? WORK_E_ABSENT : err_sys(err, errno, "cannot open %s", name);
		} else {
			r = read_text(fd, name, ret, &again, err);
			io_close(fd);
		}
		if (!r)
			break;
		free(ret->text);
		ret->text = NULL;
		if (!again || !wait || !work_wait(w, &waited))
			return r;
		err_clear(err);
	}
	r = check_kind(ret, name, kind, err);
	if (r) {
		free(ret->text);
		ret->text = NULL;
	}
	return r;
}

size_t work_in_lines(const struct work_in *in)
{
	size_t n = 0;

	for (const char *at = in->at; (at = strchr(at, '\n')); at++)
		n++;
	return n;
}

static void unescape(char *s)
{
	char *to = s;

	for (; *s; s++) {
		if (*s == '\\' && s[1])
			*to++ = *++s == 'n' ? '\n' : *s == 'r' ? '\r' : *s;
		else
			*to++ = *s;
	}
	*to = 0;
}

bool work_in_line(struct work_in *in, char **ret_key, char **ret_rest)
{
	char *key = in->at, *end = strchr(key, '\n'), *space;

	if (!*key || !end)
		return false;
	*end = 0;
	in->at = end + 1;
	space = strchr(key, ' ');
	*ret_key = key;
	*ret_rest = space ? space + 1 : end;
	if (space)
		*space = 0;
	unescape(*ret_rest);
	return true;
}

bool work_in_u64(char **rest, uint64_t *ret)
{
	char *end;

	if (**rest < '0' || **rest > '9')
		return false;
	errno = 0;
	*ret = strtoull(*rest, &end, 10);
	if (errno || (*end && *end != ' '))
		return false;
	*rest = *end ? end + 1 : end;
	return true;
}
