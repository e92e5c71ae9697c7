/*
 * probe: opens a scanner, starts it, listens for a second (--for), stops it, and reports what came and whether it matches the
 * profile: bytes, telegrams, the first sweep. Nothing is kept.
 */
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>

#include "clock.h"
#include "term_text.h"
#include "decoder.h"
#include "err.h"
#include "parse.h"
#include "replay.h"
#include "scan_device.h"

enum { BEGIN = 48 };

struct probe {
	struct program *args;
	struct scan_device d;
	struct replay *replay;
	struct replay_counts counts;
	struct usb_counts usb;
	uint64_t commands, bytes;
	double seconds;
	uint8_t begin[BEGIN]; /* of what came */
	size_t nbegin;
	char fault[512]; /* the first */
	enum usb_end end;
	char end_text[USB_LINE_SIZE];
	/* the first sweep */
	bool swept;
	uint32_t shots, returns;
	double from, to, nearest, farthest;
	char serial[32], point[64];
	bool dirty;
};

static int on_sweep(void *ctx, const struct replay_sweep *s)
{
	struct probe *p = ctx;
	const struct sweep *w = s->sweep;

	p->dirty = p->dirty || w->dirty;
	if (p->swept)
		return 0;
	p->swept = true;
	p->shots = w->shots;
	p->from = w->first * 180 / M_PI;
	p->to = (w->first + w->step * (w->shots ? w->shots - 1 : 0)) * 180 / M_PI;
	p->nearest = p->farthest = NAN;
	for (uint32_t i = 0; i < w->shots; i++) {
		if (isnan(w->range[i]))
			continue;
		p->returns++;
		p->nearest = fmin(p->nearest, (double)w->range[i]);
		p->farthest = fmax(p->farthest, (double)w->range[i]);
	}
	snprintf(p->serial, sizeof(p->serial), "%s", w->device_serial);
	return 0;
}

static int on_points(void *ctx, const struct telegram *t)
{
	struct probe *p = ctx;

	if (!p->point[0] && p->d.profile.profile.framer == PROFILE_FRAMER_LINE)
		snprintf(p->point, sizeof(p->point), "%.*s", (int)(t->size < 60 ? t->size : 60), (const char *)t->at);
	return 0;
}

static void on_fault(void *ctx, const struct replay_fault *f)
{
	struct probe *p = ctx;

	if (p->fault[0])
		return;
	if (f->err)
		snprintf(p->fault, sizeof(p->fault), "%s", f->err->message);
	else
		snprintf(p->fault, sizeof(p->fault), "%llu bytes at byte %llu: %s", (unsigned long long)f->size,
			 (unsigned long long)f->offset, framer_reason_name(f->reason));
}

/* ---- listening ---- */

static void take(struct probe *p, const struct usb_buffer *b)
{
	size_t n = b->size < BEGIN - p->nbegin ? b->size : BEGIN - p->nbegin;

	if (b->kind == USB_SENT)
		p->commands++;
	else if (b->kind == USB_OVERFLOW || b->kind == USB_ERROR)
		replay_gap(p->replay);
	if (b->kind != USB_DATA)
		return;
	memcpy(p->begin + p->nbegin, b->at, n);
	p->nbegin += n;
	p->bytes += b->size;
	replay_feed(p->replay, b->at, b->size, b->time_ns);
}

static int listen(struct probe *p, struct err *err)
{
	double limit = p->args->seconds > 0 ? p->args->seconds : 1;
	struct usb_capture *capture;
	struct usb_buffer b;
	bool gone = false, stopping = false;
	struct pollfd fds[2];
	uint64_t began;
	int r = usb_capture_start(p->d.usb, &p->d.device, &p->d.profile.profile, &capture, err);

	if (r)
		return r;
	began = clock_mono_ns();
	fds[0] = (struct pollfd){.fd = usb_capture_fd(capture), .events = POLLIN};
	fds[1] = (struct pollfd){.fd = scan_stop_fd(), .events = POLLIN};
	while (!gone) {
		double left = limit - clock_since(began);

		while (!gone && usb_capture_take(capture, &b) == 1) {
			gone = b.kind == USB_GONE;
			if (gone) {
				p->end = b.end;
				snprintf(p->end_text, sizeof(p->end_text), "%s", b.text);
			} else {
				take(p, &b);
				usb_capture_give(capture, &b);
			}
		}
		if (gone)
			break;
		if (!stopping && (left <= 0 || scan_stopped())) {
			p->seconds = clock_since(began);
			usb_capture_stop(capture);
			stopping = true;
			fds[1].fd = -1;
		}
		if (poll(fds, 2, stopping ? -1 : (int)(left > 1e6 ? 1e9 : left * 1000) + 1) < 0 && errno != EINTR) {
			err_sys(err, errno, "cannot wait for the device");
			break;
		}
	}
	if (!stopping)
		p->seconds = clock_since(began);
	usb_capture_counts(capture, &p->usb);
	usb_capture_free(capture);
	replay_end(p->replay);
	replay_counts(p->replay, &p->counts);
	return -(int)err->code;
}

/* ---- what it means ---- */

/* "\x02sRN" as people read bytes. */
static char *escaped(const uint8_t *at, size_t n, char *buf, size_t size)
{
	size_t used = 0;

	buf[0] = 0;
	for (size_t i = 0; i < n && used + 5 < size; i++)
		used += (size_t)(at[i] >= 0x20 && at[i] < 0x7f && at[i] != '\\' ?
					 snprintf(buf + used, size - used, "%c", at[i]) :
					 snprintf(buf + used, size - used, "\\x%02x", at[i]));
	return buf;
}

/* Whether this is a device as the profile has it. */
static int judge(const struct probe *p, struct err *err)
{
	const struct profile *pr = &p->d.profile.profile;
	char words[200], begin[4 * BEGIN + 8];

	scan_device_text(&p->d.device, words, sizeof(words));
	escaped(p->begin, p->nbegin, begin, sizeof(begin));
	if (p->end == USB_END_LEFT)
		return err_set(err, ERR_IO, "%s was unplugged", words);
	if (p->end == USB_END_FAILED)
		return err_set(err, ERR_IO, "%s does not answer any more: %s", words, p->end_text);
	if (!p->bytes) {
		err_set(err, ERR_TIMEOUT, "%s sent nothing within %.1f s", words, p->seconds);
		return err_add_hint(err,
				    pr->starts ? "the start commands of profile %s were taken; is the device busy starting up?" :
						 "profile %s sends no start command: does the device need one?",
				    pr->name);
	}
	if (!p->counts.framer.telegrams) {
		err_set(err, ERR_INPUT, "%s: no telegram in the data, as profile %s frames them; it begins with %s", words,
			pr->name, begin);
		return err_add_hint(err, "the profile is for another device, or its framer is wrong: man acut-scanners.d");
	}
	if (!p->swept && !p->counts.points) {
		err_set(err, ERR_INPUT, "%s: none of the telegrams carries measurements, as profile %s decodes them%s%s", words,
			pr->name, p->fault[0] ? ": " : "", p->fault);
		return err_add_hint(err, "the device's data does not match its profile; the first bytes are %s", begin);
	}
	return 0;
}

static void as_json(const struct probe *p, const struct err *err)
{
	const struct replay_counts *c = &p->counts;
	struct term_json j = {.out = stdout};
	char begin[4 * BEGIN + 8];

	term_json_open(&j, NULL, '{');
	scan_device_json(&j, &p->d.device, p->d.set);
	term_json_text(&j, "used_profile", p->d.profile.profile.name);
	term_json_number(&j, "seconds", p->seconds);
	term_json_u64(&j, "commands", p->commands);
	term_json_u64(&j, "bytes", p->bytes);
	term_json_u64(&j, "transfers", p->usb.transfers);
	term_json_text(&j, "begins", escaped(p->begin, p->nbegin, begin, sizeof(begin)));
	term_json_u64(&j, "telegrams", c->framer.telegrams);
	term_json_u64(&j, "bad_telegrams", c->framer.bad);
	term_json_u64(&j, "answers", c->not_data);
	term_json_u64(&j, "undecoded", c->undecoded);
	term_json_u64(&j, "sweeps", c->sweeps);
	term_json_u64(&j, "points", c->points);
	term_json_u64(&j, "stalls", p->usb.stalls);
	term_json_u64(&j, "overflows", p->usb.overflows);
	term_json_u64(&j, "errors", p->usb.errors);
	term_json_bool(&j, "dirty", p->dirty);
	if (p->swept) {
		term_json_open(&j, "first_sweep", '{');
		term_json_u64(&j, "shots", p->shots);
		term_json_u64(&j, "returns", p->returns);
		term_json_number(&j, "from_degrees", p->from);
		term_json_number(&j, "to_degrees", p->to);
		term_json_number(&j, "nearest", p->nearest);
		term_json_number(&j, "farthest", p->farthest);
		term_json_known(&j, "device_serial", p->serial);
		term_json_close(&j, '}');
	} else {
		term_json_null(&j, "first_sweep");
	}
	term_json_bool(&j, "fits", !err->code);
	term_error_json(&j, "error", err);
	term_json_end(&j);
}

static void as_text(const struct probe *p)
{
	const struct replay_counts *c = &p->counts;
	char words[200], size[32], count[32], range[64] = "";

	term_line(stdout, "%s, profile %s", scan_device_text(&p->d.device, words, sizeof(words)), p->d.profile.profile.name);
	term_field(stdout, "received", "%s in %llu transfers, in %.1f s", parse_size_text(p->bytes, size),
		   (unsigned long long)p->usb.transfers, p->seconds);
	term_field(stdout, "telegrams", "%s, %llu bad, %llu answers, %llu that cannot be decoded",
		   term_count(c->framer.telegrams, count), (unsigned long long)c->framer.bad, (unsigned long long)c->not_data,
		   (unsigned long long)c->undecoded);
	if (p->swept) {
		if (p->returns)
			snprintf(range, sizeof(range), ", %.3f to %.3f m", p->nearest, p->farthest);
		term_field(stdout, "sweeps", "%llu%s", (unsigned long long)c->sweeps,
			   p->dirty ? "; the device reports a dirty window" : "");
		term_field(stdout, "the first", "%u shots from %.1f to %.1f degrees, %u with a range%s", p->shots, p->from, p->to,
			   p->returns, range);
	}
	if (p->serial[0])
		term_field(stdout, "says it is", "%s", p->serial);
	if (p->point[0])
		term_field(stdout, "first line", "%s", p->point);
	if (p->usb.stalls || p->usb.overflows || p->usb.errors)
		term_field(stdout, "bus", "%llu stalls, %llu overflows, %llu errors", (unsigned long long)p->usb.stalls,
			   (unsigned long long)p->usb.overflows, (unsigned long long)p->usb.errors);
}

int scan_probe(struct program *args)
{
	struct probe p = {.args = args};
	const struct replay_sinks sinks = {.ctx = &p, .sweep = on_sweep, .points = on_points, .fault = on_fault};
	const struct replay_clock clock = {.utc_ns = clock_real_us() * 1000, .monotonic_ns = (int64_t)clock_mono_ns()};
	struct err err = ERR_INIT;
	bool printed = false;
	int r = scan_device_open(args, &p.d, &err);

	if (r)
		return scan_fail(args, &err);
	if (p.d.profile.profile.note[0])
		console_note(&args->console, "%s", p.d.profile.profile.note);
	r = replay_new(&p.d.profile.profile, &clock, &sinks, &p.replay, &err);
	if (!r)
		r = listen(&p, &err);
	if (!r) {
		r = judge(&p, &err);
		printed = true;
		if (args->console.json)
			as_json(&p, &err);
		else
			as_text(&p);
	}
	replay_free(p.replay);
	scan_device_done(&p.d);
	if (!r)
		return 0;
	/* In JSON it is in the object already. */
	return printed && args->console.json ? err_exit_status(err.code) : scan_fail(args, &err);
}
