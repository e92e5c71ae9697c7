/*
 * Reports of record: to people one line that is overwritten, and a summary; with --json a line a second, one for each event,
 * and one at the end; to systemd readiness and status.
 */
#include <stdio.h>
#include <string.h>

#include <systemd/sd-daemon.h>

#include "clock.h"
#include "term_text.h"
#include "parse.h"
#include "scan_record.h"

static double seconds(uint64_t ns)
{
	return (double)ns / 1e9;
}

static void counts_now(const struct record *r, struct usb_counts *ret)
{
	struct usb_counts now = {0};

	*ret = r->before;
	if (!r->capture)
		return;
	usb_capture_counts(r->capture, &now);
	ret->transfers += now.transfers;
	ret->stalls += now.stalls;
	ret->overflows += now.overflows;
	ret->timeouts += now.timeouts;
	ret->errors += now.errors;
	ret->shorts += now.shorts;
	ret->parked += now.parked;
	ret->parked_ns += now.parked_ns;
}

static void framed(const struct record *r, struct framer_counts *ret)
{
	*ret = (struct framer_counts){0};
	if (r->framer)
		framer_counts(r->framer, ret);
}

static void counts_json(struct term_json *j, const struct record *r)
{
	struct spool_totals t;
	struct framer_counts f;
	struct usb_counts u;

	spool_totals(r->spool, &t);
	framed(r, &f);
	counts_now(r, &u);
	term_json_u64(j, "bytes", t.bytes);
	term_json_u64(j, "durable", t.durable);
	term_json_u64(j, "transfers", t.transfers);
	if (r->framer) {
		term_json_u64(j, "telegrams", f.telegrams);
		term_json_u64(j, "bad_telegrams", f.bad);
	} else {
		term_json_null(j, "telegrams");
		term_json_null(j, "bad_telegrams");
	}
	term_json_number(j, "seconds", clock_since(r->began_ns));
	term_json_u64(j, "short_transfers", u.shorts);
	term_json_u64(j, "stalls", u.stalls);
	term_json_u64(j, "overflows", u.overflows);
	term_json_u64(j, "timeouts", u.timeouts);
	term_json_u64(j, "errors", u.errors);
	term_json_u64(j, "parked", u.parked);
	term_json_number(j, "parked_seconds", seconds(u.parked_ns));
	term_json_u64(j, "disk_waits", t.waits);
	term_json_number(j, "disk_wait_seconds", seconds(t.wait_ns));
	term_json_u64(j, "unplugged", r->left);
}

static void open_line(struct term_json *j, const struct record *r, const char *event)
{
	term_json_open(j, NULL, '{');
	term_json_text(j, "event", event);
	term_json_text(j, "file", r->path);
}

void record_report_start(struct record *r, const char *what)
{
	const struct spool_head *h = &r->head;
	struct term_json j = {.out = stdout};
	char id[16];

	r->started = true;
	r->notified = sd_notifyf(0, "READY=1\nSTATUS=%s: capturing into %s", what, r->path) > 0;
	r->reported_ns = clock_mono_ns();
	if (!r->args->console.json) {
		if (!r->args->console.quiet) {
			console_progress_clear(&r->args->console);
			term_line(stderr, "acut-scan: %s: capturing into %s", what, r->path);
		}
		return;
	}
	open_line(&j, r, "begin");
	snprintf(id, sizeof(id), "%04x", h->vendor);
	term_json_text(&j, "vendor", h->vendor || h->product ? id : NULL);
	snprintf(id, sizeof(id), "%04x", h->product);
	term_json_text(&j, "product", h->vendor || h->product ? id : NULL);
	term_json_known(&j, "model", h->model);
	term_json_known(&j, "serial", h->serial);
	term_json_text(&j, "port", h->port);
	term_json_known(&j, "profile", h->profile_name);
	term_json_end(&j);
}

static void line(struct record *r)
{
	char size[32], rate[32], telegrams[64] = "", bad[32] = "", parked[64] = "", count[32];
	struct framer_counts f;
	struct usb_counts u;

	framed(r, &f);
	counts_now(r, &u);
	if (f.bad)
		snprintf(bad, sizeof(bad), " (%llu bad)", (unsigned long long)f.bad);
	if (r->framer)
		snprintf(telegrams, sizeof(telegrams), "  %s telegrams%s", term_count(f.telegrams, count), bad);
	if (u.parked || u.overflows || u.errors)
		snprintf(parked, sizeof(parked), "  parked %.1f s, %llu dropped", seconds(u.parked_ns),
			 (unsigned long long)(u.overflows + u.errors));
	console_progress(&r->args->console, "%s %s%s  %s/s%s%s", r->args->from ? "import" : "capture",
			 parse_size_text(r->bytes, size), telegrams, parse_size_text((uint64_t)r->rate, rate), parked,
			 r->args->from || r->capture ? "" : "  unplugged, waiting");
}

void record_report_progress(struct record *r)
{
	uint64_t now = clock_mono_ns(), every = r->progress ? 200000000 : 1000000000;
	struct term_json j = {.out = stdout};
	char size[32], rate[32];
	double passed;

	if ((!r->progress && !r->args->console.json && !r->notified) || now - r->reported_ns < every)
		return;
	passed = seconds(now - r->reported_ns);
	r->rate += ((double)(r->bytes - r->reported_bytes) / passed - r->rate) * (passed >= 1 ? 1 : passed);
	if (r->notified && (r->reported_bytes != r->bytes || r->rate >= 1))
		sd_notifyf(0, "STATUS=%s in %s, %s/s%s", parse_size_text(r->bytes, size), r->path,
			   parse_size_text((uint64_t)r->rate, rate), r->args->from || r->capture ? "" : "; unplugged");
	r->reported_ns = now;
	r->reported_bytes = r->bytes;
	if (r->progress)
		line(r);
	if (!r->args->console.json)
		return;
	open_line(&j, r, "progress");
	counts_json(&j, r);
	term_json_number(&j, "rate", r->rate);
	term_json_end(&j);
}

void record_report_event(struct record *r, const char *event, const char *text)
{
	struct term_json j = {.out = stdout};

	if (!r->args->console.json) {
		if (!strcmp(event, "left") || !strcmp(event, "back") || !strcmp(event, "error"))
			console_warn(&r->args->console, "%s %s", event, text);
		return;
	}
	open_line(&j, r, event);
	term_json_text(&j, "text", text);
	term_json_end(&j);
}

static void end_json(struct record *r, const char *sum, const struct err *err)
{
	struct term_json j = {.out = stdout};
	struct spool_totals t;

	spool_totals(r->spool, &t);
	open_line(&j, r, "end");
	term_json_text(&j, "ended", record_why_name(r->why));
	counts_json(&j, r);
	term_json_u64(&j, "records", t.records);
	term_json_u64(&j, "events", t.events);
	term_json_text(&j, "sha256", sum);
	term_error_json(&j, "error", err);
	term_json_end(&j);
}

static void end_text(const struct record *r, const struct spool_totals *t, const char *sum)
{
	char size[32], count[32], telegrams[96] = "", rate[32];
	double passed = clock_since(r->began_ns);
	struct framer_counts f;
	struct usb_counts u;

	framed(r, &f);
	counts_now(r, &u);
	if (r->framer)
		snprintf(telegrams, sizeof(telegrams), ", %s telegrams, %llu bad", term_count(f.telegrams, count),
			 (unsigned long long)f.bad);
	term_line(stdout, "%s", r->path);
	term_field(stdout, "captured", "%s in %llu transfers%s", parse_size_text(t->bytes, size),
		   (unsigned long long)t->transfers, telegrams);
	term_field(stdout, "took", "%.1f s, %s/s", passed,
		   parse_size_text((uint64_t)((double)r->bytes / (passed > 0.001 ? passed : 0.001)), rate));
	term_field(stdout, "ended by", "%s", r->why == RECORD_UNPLUGGED ? "unplugging" : record_why_name(r->why));
	if (u.stalls || u.overflows || u.errors || u.timeouts || u.parked)
		term_field(stdout, "bus", "%llu stalls, %llu overflows, %llu errors, %llu timeouts; parked %llu times, %.3f s",
			   (unsigned long long)u.stalls, (unsigned long long)u.overflows, (unsigned long long)u.errors,
			   (unsigned long long)u.timeouts, (unsigned long long)u.parked, seconds(u.parked_ns));
	if (t->waits)
		term_field(stdout, "disk", "waited for %llu times, %.3f s", (unsigned long long)t->waits, seconds(t->wait_ns));
	if (t->durable < t->bytes)
		term_field(stdout, "durable", "%llu of %llu bytes", (unsigned long long)t->durable, (unsigned long long)t->bytes);
	term_field(stdout, "sha256", "%s", sum);
}

void record_report_end(struct record *r, const struct err *err)
{
	struct spool_totals t;
	char sum[65], size[32];

	spool_totals(r->spool, &t);
	for (int i = 0; i < 32; i++)
		snprintf(sum + 2 * i, 3, "%02x", t.sha256[i]);
	if (r->notified)
		sd_notifyf(0, "STOPPING=1\nSTATUS=%s in %s", parse_size_text(t.bytes, size), r->path);
	console_progress_clear(&r->args->console);
	if (r->args->console.json)
		end_json(r, sum, err);
	else if (!r->args->console.quiet)
		end_text(r, &t, sum);
}
