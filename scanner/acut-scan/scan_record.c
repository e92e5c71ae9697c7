/*
 * record: from a device, a file or a pipe into a spool. Every buffer is appended first; its telegrams are counted after that,
 * and the result changes nothing. fsync has a thread of its own (spool_flush_start). A capture that is ended by a signal,
 * --for, --bytes or the end of a file is complete: END is written and the status is 0. So is, for the spool, one that an
 * unplug ends; its status is 3.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"
#include "scan_record.h"

#define CLOCK_EVERY_NS UINT64_C(10000000000)
enum { FLUSH_BATCH = 16 << 20, NAMES = 100 };

const char *record_why_name(enum record_why why)
{
	static const char *const name[] = {"", "signal", "time", "bytes", "end", "left", "error"};

	return name[why];
}

int record_data(struct record *r, unsigned flags, int64_t time_ns, const void *at, size_t size, struct err *err)
{
	uint64_t now = clock_mono_ns();
	int rc;

	if (now - r->clock_ns >= CLOCK_EVERY_NS) {
		r->clock_ns = now;
		rc = spool_clock(r->spool, err);
		if (rc)
			return rc;
	}
	rc = spool_append(r->spool, SPOOL_DATA, flags, time_ns, at, size, err);
	if (rc)
		return rc;
	r->bytes += size;
	if (flags & SPOOL_AFTER_GAP)
		record_gap(r);
	if (r->framer)
		framer_feed(r->framer, at, size, time_ns);
	return 0;
}

void record_gap(struct record *r)
{
	if (r->framer)
		framer_gap(r->framer);
}

bool record_over(struct record *r)
{
	struct program *a = r->args;

	if (r->why)
		return true;
	if (scan_stopped())
		r->why = RECORD_SIGNAL;
	else if (a->bytes && r->bytes >= a->bytes)
		r->why = RECORD_BYTES;
	else if (a->seconds > 0 && clock_since(r->began_ns) >= a->seconds)
		r->why = RECORD_TIME;
	return r->why != RECORD_GOES_ON;
}

int record_patience(const struct record *r)
{
	double left = r->args->seconds - clock_since(r->began_ns), ms = left * 1000 + 1;
	int wait = r->args->seconds > 0 ? (ms < 1 ? 1 : ms > 1e9 ? 1000000000 : (int)ms) : -1;
	int tick = r->progress ? 200 : r->args->console.json ? 1000 : r->notified && r->reported_bytes != r->bytes ? 1000 : -1;

	return wait < 0 ? tick : tick < 0 || wait < tick ? wait : tick;
}

/* ---- the spool ---- */

/* Letters, digits, dot, dash and underscore, so that a name is one in any shell. */
static void plain(char *text)
{
	for (char *p = text; *p; p++)
		if (!((*p >= '0' && *p <= '9') || (*p >= 'A' && *p <= 'Z') || (*p >= 'a' && *p <= 'z') || *p == '-' ||
		      *p == '_' || (*p == '.' && p != text)))
			*p = '_';
}

/* --folder: PROFILE-SERIAL-TIME.spool, and -2 and so on where one second has several. */
static int create_in_folder(struct record *r, struct err *err)
{
	const struct spool_head *h = &r->head;
	char profile[SPOOL_TEXT_SIZE], serial[SPOOL_TEXT_SIZE], stamp[32];
	time_t now = (time_t)(clock_real_us() / 1000000);
	struct tm tm;
	int rc = 0;

	snprintf(profile, sizeof(profile), "%s", h->profile_name[0] ? h->profile_name : "raw");
	snprintf(serial, sizeof(serial), "%s", h->serial[0] ? h->serial : h->port);
	plain(profile);
	plain(serial);
	if (!gmtime_r(&now, &tm) || !strftime(stamp, sizeof(stamp), "%Y%m%dT%H%M%SZ", &tm))
		return err_set(err, ERR_INTERNAL, "the wall clock has no time");
	for (unsigned i = 1; i <= NAMES; i++) {
		char more[16] = "";

		if (i > 1)
			snprintf(more, sizeof(more), "-%u", i);
		free(r->path);
		if (asprintf(&r->path, "%s/%s-%s-%s%s.spool", r->args->folder, profile, serial, stamp, more) < 0) {
			r->path = NULL;
			return err_set(err, ERR_NOMEM, "no memory for a name");
		}
		*err = ERR_INIT;
		rc = spool_create(r->path, &r->head, &r->spool, err);
		if (rc != -ERR_USAGE)
			break;
	}
	return rc;
}

static int create(struct record *r, struct err *err)
{
	if (!r->args->output)
		return create_in_folder(r, err);
	r->path = strdup(r->args->output);
	if (!r->path)
		return err_set(err, ERR_NOMEM, "no memory for a name");
	return spool_create(r->path, &r->head, &r->spool, err);
}

/* The same device, by its numbers and its serial. */
static int same_device(const struct spool_head *there, const struct spool_head *now, struct err *err)
{
	if (there->vendor == now->vendor && there->product == now->product && !strcmp(there->serial, now->serial))
		return 0;
	err_set(err, ERR_USAGE, "this spool is of %04x:%04x serial \"%s\", not of %04x:%04x serial \"%s\"", there->vendor,
		there->product, there->serial, now->vendor, now->product, now->serial);
	return err_add_hint(err, "plug that one in, or record into a new spool");
}

/* --continue. The profile is that of the spool, so that all of it is one stream. */
static int go_on(struct record *r, struct scan_profile *profile, struct err *err)
{
	struct spool_reader *reader = NULL;
	struct spool_totals totals;
	int fd = open(r->args->output, O_RDONLY | O_CLOEXEC), rc;

	if (fd < 0) {
		err_sys(err, errno, "cannot open");
		return err_add_file(err, r->args->output);
	}
	rc = spool_open(fd, r->args->output, &reader, err);
	if (!rc)
		rc = same_device(spool_reader_head(reader), &r->head, err);
	spool_reader_free(reader);
	if (rc)
		return err_add_file(err, r->args->output);
	spool_head_clear(&r->head);
	r->path = strdup(r->args->output);
	rc = r->path ? spool_continue(r->path, &r->head, &r->spool, err) : err_set(err, ERR_NOMEM, "no memory for a name");
	if (rc)
		return rc;
	spool_totals(r->spool, &totals);
	r->first_bytes = totals.bytes;
	return profile_parse(r->head.profile, r->head.profile_size, r->head.profile_name, r->path, &profile->profile, err);
}

static void head_of_profile(struct spool_head *h, const struct scan_profile *p)
{
	snprintf(h->profile_name, sizeof(h->profile_name), "%s", p->profile.name);
	h->profile = malloc(p->size + 1);
	if (!h->profile)
		return;
	memcpy(h->profile, p->text, p->size);
	h->profile[p->size] = 0;
	h->profile_size = p->size;
}

static void head_of_device(struct spool_head *h, const struct usb_device *d)
{
	h->vendor = d->vendor;
	h->product = d->product;
	snprintf(h->manufacturer, sizeof(h->manufacturer), "%s", d->manufacturer);
	snprintf(h->model, sizeof(h->model), "%s", d->model);
	snprintf(h->serial, sizeof(h->serial), "%s", d->serial);
	snprintf(h->port, sizeof(h->port), "%s", d->port);
}

/* ---- the run ---- */

static int check_args(struct program *a, struct err *err)
{
	if (!a->output == !a->folder) {
		err_set(err, ERR_USAGE, a->output ? "-o and --folder are both given" : "record has no output");
		return err_add_hint(err, "give -o FILE, or --folder DIR for a name of its own");
	}
	if (a->output && !strcmp(a->output, "-")) {
		err_set(err, ERR_USAGE, "a spool is a file: standard output cannot be made durable");
		return err_add_hint(err, "acut-scan replay FILE --to raw writes its bytes to a pipe");
	}
	if (a->from && (a->device || a->line.nword))
		return err_set(err, ERR_USAGE, "--from takes the bytes of a file, so no device can be named");
	if (a->from && (a->resume || a->reconnect))
		return err_set(err, ERR_USAGE, "--%s is for devices, not for --from", a->resume ? "continue" : "reconnect");
	if (a->resume && (a->folder || a->profile))
		return err_set(err, ERR_USAGE, "--continue continues -o FILE with the profile in it");
	return 0;
}

static int count_sink(void *ctx, const struct telegram *t)
{
	return 0;
}

/* A count that cannot be had is no reason not to capture. */
static void count_with(struct record *r, const struct profile *p)
{
	struct err err = ERR_INIT;

	if (framer_new(p, count_sink, NULL, &r->framer, &err))
		console_warn(&r->args->console, "telegrams are not counted: %s", err.message);
}

/* How much is safe where the spool could not be written. */
static void hint_safe(struct record *r, struct err *err)
{
	struct spool_totals t;

	spool_totals(r->spool, &t);
	err_add_hint(err, "%s%llu of %llu bytes are safe in the spool%s", err->code == ERR_NOSPACE ? "make room; " : "",
		     (unsigned long long)t.durable, (unsigned long long)t.bytes,
		     r->args->from ? "" : ", and record --continue continues it");
}

/* The data before a failed write is made durable; the error is that of the write. */
static int finish(struct record *r, struct err *err)
{
	struct err ignored = ERR_INIT;
	int rc;

	if (err->code) {
		if (spool_event(r->spool, (int64_t)clock_mono_ns(), &ignored, "stop error %s", err->message) == 0)
			spool_end(r->spool, &ignored);
		rc = ignored.code; /* the spool is what failed */
		ignored = ERR_INIT;
		spool_sync(r->spool, &ignored);
		if (rc && !err->hint[0])
			hint_safe(r, err);
		r->why = RECORD_ERROR;
		return -(int)err->code;
	}
	rc = spool_event(r->spool, (int64_t)clock_mono_ns(), err, "stop %s", record_why_name(r->why));
	if (!rc)
		rc = spool_end(r->spool, err);
	if (rc) {
		hint_safe(r, err);
		r->why = RECORD_ERROR;
	}
	if (r->framer)
		framer_end(r->framer);
	return rc;
}

static int run(struct record *r, struct scan_device *device, int fd, struct err *err)
{
	int rc = spool_flush_start(r->spool, r->args->sync_s, FLUSH_BATCH, err);

	r->began_ns = r->clock_ns = clock_mono_ns();
	r->progress = console_progress_on(&r->args->console);
	if (!rc)
		rc = device ? record_from_usb(r, device, err) : record_from_file(r, fd, err);
	if (rc && (!r->started || !r->bytes) && r->why == RECORD_GOES_ON) {
		if (!r->args->resume) /* it never began: no empty spool stays; one that is gone on with stays as it was */
			unlink(r->path);
		return err->code == ERR_CANCELLED && scan_stopped() ? RECORD_DONE : scan_fail(r->args, err);
	}
	rc = finish(r, err);
	record_report_end(r, err);
	if (rc)
		return scan_fail(r->args, err);
	return r->why == RECORD_UNPLUGGED ? RECORD_LEFT : RECORD_DONE;
}

static void done(struct record *r)
{
	spool_writer_free(r->spool);
	framer_free(r->framer);
	spool_head_clear(&r->head);
	free(r->path);
}

static int record_device(struct program *args)
{
	struct record r = {.args = args};
	struct err err = ERR_INIT;
	struct scan_device d;
	int status;

	if (scan_device_open(args, &d, &err))
		return scan_fail(args, &err);
	head_of_device(&r.head, &d.device);
	if (!args->resume)
		head_of_profile(&r.head, &d.profile);
	if (args->resume ? go_on(&r, &d.profile, &err) : create(&r, &err)) {
		status = scan_fail(args, &err);
	} else {
		count_with(&r, &d.profile.profile);
		status = run(&r, &d, -1, &err);
	}
	done(&r);
	scan_device_done(&d);
	return status;
}

/* The bytes of a file; only the profile defines their meaning. A named pipe is not waited for here, where no signal and no
 * --for would be seen, but when its bytes are read. */
static int record_import(struct program *args)
{
	struct scan_profile profile = {0};
	struct profile_set *set = NULL;
	struct record r = {.args = args};
	struct err err = ERR_INIT;
	int fd = strcmp(args->from, "-") ? open(args->from, O_RDONLY | O_NONBLOCK | O_CLOEXEC) : dup(STDIN_FILENO), status;

	if (fd < 0) {
		err_sys(&err, errno, "cannot open");
		err_add_file(&err, args->from);
		return scan_fail(args, &err);
	}
	if (args->profile && !scan_profile_set(args, &set, &err))
		scan_profile_named(set, args->profile, &profile, &err);
	profile_set_free(set);
	if (!err.code) {
		snprintf(r.head.port, sizeof(r.head.port), "file");
		if (profile.text)
			head_of_profile(&r.head, &profile);
		else
			console_note(&args->console,
				     "without --profile these bytes are kept as they are; replay and push will ask for one");
		create(&r, &err);
	}
	if (err.code) {
		status = scan_fail(args, &err);
	} else {
		if (profile.text)
			count_with(&r, &profile.profile);
		status = run(&r, NULL, fd, &err);
	}
	close(fd);
	done(&r);
	scan_profile_done(&profile);
	return status;
}

int scan_record(struct program *args)
{
	struct err err = ERR_INIT;

	if (check_args(args, &err))
		return scan_fail(args, &err);
	return args->from ? record_import(args) : record_device(args);
}
