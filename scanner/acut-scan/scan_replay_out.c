/*
 * The output of replay: the captured bytes; telegrams and sweeps as JSON, one line each; shots as CSV; points unchanged, as lines
 * of a text or as LAS files, each in a separate file (NAME.las, NAME-2.las, ...).
 *
 * Existing files are never overwritten, and incomplete ones are removed.
 */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "decoder.h"
#include "io_place.h"
#include "scan_replay.h"

enum { PATH = 4096 };

struct scan_out {
	struct program *args;
	enum scan_to to;
	FILE *file;      /* NULL: none is open */
	char path[PATH]; /* of it; "": standard output */
	unsigned files;  /* LAS: that were begun */
	bool begun;      /* CSV: the names of the columns are written */
	struct err err;
};

static int fail(struct scan_out *o)
{
	err_sys(&o->err, errno ? errno : EIO, "cannot be written");
	err_add_file(&o->err, o->path[0] ? o->path : "standard output");
	return -1;
}

static int open_file(struct scan_out *o, const char *path)
{
	struct io_place at;
	int fd, sys;

	if (strlen(path) >= sizeof o->path)
		return err_set(&o->err, ERR_USAGE, "the path of the output is too long");
	strcpy(o->path, path);
	if (io_place_find(path, false, &at, &o->err))
		return -1;
	fd = openat(at.dirfd, at.name, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
	sys = errno;
	io_place_done(&at);
	errno = sys;
	if (fd < 0 && errno == EEXIST) {
		err_set(&o->err, ERR_USAGE, "it is there already");
		err_add_hint(&o->err, "nothing is written over: take another name, or remove it");
		return err_add_file(&o->err, path);
	}
	o->file = fd < 0 ? NULL : fdopen(fd, "w");
	if (!o->file)
		return fail(o);
	setvbuf(o->file, NULL, _IOFBF, 1 << 18);
	return 0;
}

/* Standard output is flushed by main. */
static void close_file(struct scan_out *o, bool good)
{
	if (!o->file)
		return;
	if (!o->path[0]) {
		o->file = NULL;
		return;
	}
	errno = 0;
	if (fclose(o->file) && good) {
		fail(o);
		good = false;
	}
	o->file = NULL;
	if (!good)
		unlink(o->path);
}

int scan_out_new(struct program *args, struct scan_out **ret, struct err *err)
{
	static const char *const words[] = {"", "raw", "telegrams", "sweeps", "csv", "points"};
	struct scan_out *o = calloc(1, sizeof *o);
	bool standard = !args->output || !strcmp(args->output, "-");

	if (!o)
		return err_set(err, ERR_NOMEM, "no memory to write out");
	o->args = args;
	o->err = ERR_INIT;
	for (size_t i = 1; args->to && i < sizeof words / sizeof *words; i++)
		if (!strcmp(args->to, words[i]))
			o->to = (enum scan_to)i;
	if (args->output && !o->to)
		err_set(&o->err, ERR_USAGE, "-o %.100s needs --to", args->output);
	else if (o->to == SCAN_TO_RAW && standard && isatty(STDOUT_FILENO))
		err_set(&o->err, ERR_USAGE, "raw bytes are not for a terminal; -o names a file");
	else if (o->to && standard)
		o->file = stdout;
	else if (o->to && o->to != SCAN_TO_POINTS)
		open_file(o, args->output);
	if (o->err.code) {
		*err = o->err;
		free(o);
		return -(int)err->code;
	}
	*ret = o;
	return 0;
}

enum scan_to scan_out_to(const struct scan_out *o)
{
	return o->to;
}

int scan_out_free(struct scan_out *o, bool good, struct err *err)
{
	int rc;

	if (!o)
		return 0;
	close_file(o, good && !o->err.code);
	if (o->err.code && !err->code)
		*err = o->err;
	rc = -(int)o->err.code;
	free(o);
	return rc;
}

/* ---- bytes, telegrams, sweeps ---- */

int scan_out_raw(struct scan_out *o, const void *at, size_t size)
{
	return fwrite(at, 1, size, o->file) == size ? 0 : fail(o);
}

static bool is_ascii(const struct telegram *t)
{
	for (size_t i = 0; i < t->size; i++)
		if (t->at[i] < ' ' || t->at[i] > '~')
			return false;
	return true;
}

int scan_out_telegram(struct scan_out *o, const struct telegram *t, double utc_s)
{
	struct term_json j = {.out = o->file, .list = true};
	bool ascii = is_ascii(t);
	char *text = malloc(2 * t->size + 1);

	if (!text)
		return err_set(&o->err, ERR_NOMEM, "no memory for a telegram");
	for (size_t i = 0; !ascii && i < t->size; i++)
		sprintf(text + 2 * i, "%02x", t->at[i]);
	if (ascii)
		memcpy(text, t->at, t->size);
	text[(ascii ? 1 : 2) * t->size] = '\0';
	term_json_open(&j, NULL, '{');
	term_json_u64(&j, "telegram", t->number);
	term_json_u64(&j, "offset", t->offset);
	term_json_u64(&j, "size", t->size);
	term_json_number(&j, "utc_s", utc_s);
	term_json_text(&j, ascii ? "text" : "hex", text);
	term_json_end(&j);
	free(text);
	return ferror(o->file) ? fail(o) : 0;
}

/* Six decimals: a micrometre, and finer than any scanner's intensity. */
static void put_value(FILE *f, float v, const char *none)
{
	if (isnan(v))
		fputs(none, f);
	else
		fprintf(f, "%.6g", (double)v);
}

static void put_array(FILE *f, const char *key, const float *v, uint32_t n)
{
	fprintf(f, ",\"%s\":[", key);
	for (uint32_t i = 0; i < n; i++) {
		if (i)
			putc(',', f);
		put_value(f, v[i], "null");
	}
	putc(']', f);
}

static bool has_intensity(const struct sweep *s)
{
	for (uint32_t i = 0; i < s->shots; i++)
		if (!isnan(s->intensity[i]))
			return true;
	return false;
}

static void sweep_json(FILE *f, const struct replay_sweep *r)
{
	const struct sweep *s = r->sweep;
	double degree = 180 / M_PI;

	fprintf(f, "{\"telegram\":%llu,\"offset\":%llu,\"utc_s\":%.6f", (unsigned long long)r->telegram->number,
		(unsigned long long)r->telegram->offset, r->utc_s);
	if (s->has_device_time)
		fprintf(f, ",\"device_time_s\":%.6f", r->device_time_s);
	if (s->has_counter)
		fprintf(f, ",\"counter\":%u", s->counter);
	fprintf(f, ",\"lost\":%llu,\"repeated\":%s,\"after_gap\":%s,\"dirty\":%s", (unsigned long long)r->lost,
		r->repeated ? "true" : "false", r->after_gap ? "true" : "false", s->dirty ? "true" : "false");
	fprintf(f, ",\"period_s\":%.9g,\"first_deg\":%.9g,\"step_deg\":%.9g", s->period_s, s->first * degree, s->step * degree);
	put_array(f, "range_m", s->range, s->shots);
	if (has_intensity(s))
		put_array(f, "intensity", s->intensity, s->shots);
	fputs("}\n", f);
}

static void sweep_csv(struct scan_out *o, const struct replay_sweep *r)
{
	const struct sweep *s = r->sweep;

	if (!o->begun)
		fputs("utc_s,telegram,shot,angle_deg,range_m,intensity\n", o->file);
	o->begun = true;
	for (uint32_t i = 0; i < s->shots; i++) {
		double at = s->shots > 1 ? sweep_duration(s) * i / (s->shots - 1) : 0;

		fprintf(o->file, "%.6f,%llu,%u,%.9g,", r->utc_s + at, (unsigned long long)r->telegram->number, i,
			(s->first + i * s->step) * 180 / M_PI);
		put_value(o->file, s->range[i], "");
		putc(',', o->file);
		put_value(o->file, s->intensity[i], "");
		putc('\n', o->file);
	}
}

int scan_out_sweep(struct scan_out *o, const struct replay_sweep *r)
{
	if (o->to == SCAN_TO_CSV)
		sweep_csv(o, r);
	else
		sweep_json(o->file, r);
	return ferror(o->file) ? fail(o) : 0;
}

/* ---- points ---- */

/* NAME.las, NAME-2.las, ... */
static int next_file(struct scan_out *o)
{
	const char *name = o->args->output, *slash = strrchr(name, '/'), *dot = strrchr(name, '.');
	size_t n = dot && (!slash || dot > slash + 1) && dot != name ? (size_t)(dot - name) : strlen(name);
	char path[PATH];
	int size;

	o->files++;
	size = o->files == 1 ? snprintf(path, sizeof path, "%s", name) :
			       snprintf(path, sizeof path, "%.*s-%u%s", (int)n, name, o->files, name + n);
	if (size < 0 || (size_t)size >= sizeof path)
		return err_set(&o->err, ERR_USAGE, "the path of the output is too long");
	return open_file(o, path);
}

int scan_out_points(struct scan_out *o, const struct profile *p, const struct telegram *t)
{
	bool lines = p->framer == PROFILE_FRAMER_LINE, standard = !o->args->output || !strcmp(o->args->output, "-");

	if (!standard && (lines ? !o->file : t->file_begins) && next_file(o))
		return -1;
	if (!o->file)
		return 0; /* of a file that is broken */
	if (fwrite(t->at, 1, t->size, o->file) != t->size || (lines && putc('\n', o->file) == EOF))
		return fail(o);
	if (!standard && t->file_ends)
		close_file(o, true);
	return o->err.code ? -1 : 0;
}

void scan_out_broken(struct scan_out *o)
{
	if (o->to == SCAN_TO_POINTS && o->path[0] && o->file)
		close_file(o, false);
}
