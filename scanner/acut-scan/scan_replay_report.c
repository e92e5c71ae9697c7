/* Reports what replay found in a spool, to people and in JSON. */
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "decoder.h"
#include "parse.h"
#include "scan_replay.h"

/* 2026-07-01T10:20:30.123Z */
static const char *utc_text(double utc_s, char buf[48])
{
	int64_t ms = (int64_t)(utc_s * 1000 + 0.5);
	time_t t = (time_t)(ms / 1000);
	struct tm tm;
	size_t n;

	if (ms < 0 || !gmtime_r(&t, &tm) || !(n = strftime(buf, 40, "%Y-%m-%dT%H:%M:%S", &tm)))
		return "unknown";
	snprintf(buf + n, 48 - n, ".%03dZ", (int)(ms % 1000));
	return buf;
}

static double per_second(uint64_t n, double seconds)
{
	return n > 1 && seconds > 0 ? (double)(n - 1) / seconds : 0;
}

/* ---- for people ---- */

static void print_records(FILE *out, const struct scan_found *f)
{
	char size[32], rate[32];
	double seconds = (double)(f->last_ns - f->first_ns) / 1e9;

	term_field(out, "bytes", "%llu (%s) in %llu transfer%s%s%s%s", (unsigned long long)f->bytes,
		   parse_size_text(f->bytes, size), (unsigned long long)f->transfers, f->transfers == 1 ? "" : "s",
		   seconds > 0 ? ", " : "", seconds > 0 ? parse_size_text((uint64_t)((double)f->bytes / seconds), rate) : "",
		   seconds > 0 ? "/s" : "");
	term_field(out, "sha256", "%s%s", f->sha256, f->sha_differs ? " (its end has another)" : "");
	for (size_t i = 0; i < f->n_events; i++)
		term_field(out, i ? "" : "events", "%s: %llu", f->events[i].word, (unsigned long long)f->events[i].n);
	if (f->damaged)
		term_field(out, "damaged", "%llu place%s, %llu bytes of records", (unsigned long long)f->damaged,
			   f->damaged == 1 ? "" : "s", (unsigned long long)f->damaged_bytes);
	if (f->tail.torn)
		term_field(out, "end", "torn: %llu byte%s behind the last whole record", (unsigned long long)f->tail.torn,
			   f->tail.torn == 1 ? "" : "s");
	else
		term_field(out, "end", f->tail.ended ? "as it should be" : "none: the capture was cut off, or runs still");
}

static void print_telegrams(FILE *out, const struct scan_found *f)
{
	const struct framer_counts *c = &f->counts.framer;
	const char *comma = ": ";

	term_field(out, "telegrams", "%llu good, %llu bad; %llu byte%s in none",
		   (unsigned long long)(c->telegrams - f->counts.undecoded), (unsigned long long)(c->bad + f->counts.undecoded),
		   (unsigned long long)c->skipped, c->skipped == 1 ? "" : "s");
	if (f->counts.not_data)
		term_field(out, "", "%llu of the good %s no measurements: answers, names, comments",
			   (unsigned long long)f->counts.not_data, f->counts.not_data == 1 ? "has" : "have");
	if (!c->bad && !c->by[FRAMER_GARBAGE] && !f->counts.undecoded && !f->counts.gaps)
		return;
	fputs("  bad", out);
	for (int i = 0; i < FRAMER_REASON_COUNT; i++) {
		if (!c->by[i])
			continue;
		fprintf(out, "%s%s %llu", comma, framer_reason_name((enum framer_reason)i), (unsigned long long)c->by[i]);
		comma = ", ";
	}
	if (f->counts.undecoded)
		fprintf(out, "%sundecodable %llu", comma, (unsigned long long)f->counts.undecoded);
	fprintf(out, "; gaps in the capture: %llu\n", (unsigned long long)f->counts.gaps);
}

static void print_sweeps(FILE *out, const struct scan_found *f)
{
	const struct replay_counts *c = &f->counts;
	double seconds = c->last_utc_s - c->first_utc_s;
	char from[48], to[48];

	if (decoder_find(f->profile.decoder)->kind == DECODER_POINTS) {
		if (f->profile.framer == PROFILE_FRAMER_LAS)
			term_field(out, "files", "%llu", (unsigned long long)c->framer.files);
		else
			term_field(out, "points", "%llu", (unsigned long long)c->points);
	} else {
		term_field(out, "sweeps", "%llu (%.2f a second); %llu shots, %llu with a range", (unsigned long long)c->sweeps,
			   per_second(c->sweeps, seconds - c->clock_moved_s), (unsigned long long)c->shots,
			   (unsigned long long)c->returns);
		term_field(out, "lost", "%llu by the device's counter; came twice: %llu; device started anew: %llu",
			   (unsigned long long)c->lost, (unsigned long long)c->repeated, (unsigned long long)c->restarts);
		if (c->dirty)
			term_field(out, "dirty", "%llu sweep%s: the device reports a dirty window or a failure",
				   (unsigned long long)c->dirty, c->dirty == 1 ? "" : "s");
	}
	if (c->has_times)
		term_field(out, "time", "%s to %s (%.3f s)", utc_text(c->first_utc_s, from), utc_text(c->last_utc_s, to),
			   seconds);
	if (c->clock_sets)
		term_field(out, "clock",
			   "the computer's was set %llu time%s, by up to %.3f s: what came before has the time of then",
			   (unsigned long long)c->clock_sets, c->clock_sets == 1 ? "" : "s", c->clock_most_s);
	if (c->device_serial[0])
		term_field(out, "serial", "%s, by its telegrams", c->device_serial);
}

static void print_faults(FILE *out, const struct scan_found *f)
{
	for (uint64_t i = 0; i < f->n_faults && i < SCAN_FAULTS; i++)
		term_line(out, "  at %llu, %llu bytes: %s", (unsigned long long)f->faults[i].offset,
			  (unsigned long long)f->faults[i].size, f->faults[i].text);
	if (f->n_faults > SCAN_FAULTS)
		term_line(out, "  and %llu more", (unsigned long long)(f->n_faults - SCAN_FAULTS));
}

static void print_text(struct program *args, const struct scan_found *f)
{
	FILE *out = args->console.report;
	const struct spool_head *h = &f->head;
	char buf[1200], when[48];

	term_field(out, "spool", "%s", f->file);
	if (h->vendor || h->model[0] || h->serial[0])
		term_field(out, "scanner", "%04x:%04x %s %s%s%s", h->vendor, h->product, h->manufacturer, h->model,
			   h->serial[0] ? " " : "", h->serial);
	if (h->utc_ns)
		term_field(out, "captured", "%s at %s", utc_text((double)h->utc_ns / 1e9, when), h->port);
	print_records(out, f);
	if (!f->decoded) {
		term_field(out, "decoded", "no: %s", err_format(&f->why, buf, sizeof buf));
		return;
	}
	term_field(out, "profile", "%s: %s", f->profile.name, f->profile.title);
	print_telegrams(out, f);
	print_sweeps(out, f);
	print_faults(out, f);
}

/* ---- for programs ---- */

static void json_decoded(struct term_json *j, const struct scan_found *f)
{
	const struct replay_counts *c = &f->counts;
	double seconds = c->last_utc_s - c->first_utc_s;

	term_json_text(j, "profile", f->profile.name);
	term_json_text(j, "decoder", f->profile.decoder);
	term_json_u64(j, "telegrams", c->framer.telegrams);
	term_json_u64(j, "bad_telegrams", c->framer.bad + c->undecoded);
	term_json_open(j, "bad", '{');
	for (int i = 0; i < FRAMER_REASON_COUNT; i++)
		term_json_u64(j, framer_reason_name((enum framer_reason)i), c->framer.by[i]);
	term_json_u64(j, "undecodable", c->undecoded);
	term_json_close(j, '}');
	term_json_u64(j, "skipped_bytes", c->framer.skipped);
	term_json_u64(j, "answers", c->not_data);
	term_json_u64(j, "gaps", c->gaps);
	term_json_u64(j, "sweeps", c->sweeps);
	term_json_u64(j, "shots", c->shots);
	term_json_u64(j, "returns", c->returns);
	term_json_u64(j, "point_telegrams", c->points);
	term_json_u64(j, "files", c->framer.files);
	term_json_u64(j, "lost_sweeps", c->lost);
	term_json_u64(j, "repeated_sweeps", c->repeated);
	term_json_u64(j, "dirty_sweeps", c->dirty);
	term_json_u64(j, "device_restarts", c->restarts);
	term_json_number(j, "sweep_rate_hz", per_second(c->sweeps, seconds - c->clock_moved_s));
	term_json_u64(j, "clock_sets", c->clock_sets);
	term_json_number(j, "clock_moved_s", c->clock_moved_s);
	term_json_known(j, "device_serial", c->device_serial);
	if (c->has_times) {
		term_json_number(j, "first_utc_s", c->first_utc_s);
		term_json_number(j, "last_utc_s", c->last_utc_s);
		term_json_number(j, "device_span_s", c->device_span_s);
	}
}

static void print_json(struct program *args, const struct scan_found *f)
{
	struct term_json j = console_json(&args->console);

	term_json_text(&j, "spool", f->file);
	term_json_known(&j, "serial", f->head.serial);
	term_json_known(&j, "model", f->head.model);
	term_json_known(&j, "port", f->head.port);
	term_json_u64(&j, "records", f->records);
	term_json_u64(&j, "transfers", f->transfers);
	term_json_u64(&j, "bytes", f->bytes);
	term_json_text(&j, "sha256", f->sha256);
	term_json_bool(&j, "sha256_as_said", !f->sha_differs);
	term_json_open(&j, "events", '{');
	for (size_t i = 0; i < f->n_events; i++)
		term_json_u64(&j, f->events[i].word, f->events[i].n);
	term_json_close(&j, '}');
	term_json_u64(&j, "damaged", f->damaged);
	term_json_u64(&j, "damaged_bytes", f->damaged_bytes);
	term_json_bool(&j, "ended", f->tail.ended);
	term_json_u64(&j, "torn_bytes", f->tail.torn);
	term_json_bool(&j, "decoded", f->decoded);
	if (f->decoded)
		json_decoded(&j, f);
	else
		term_error_json(&j, "why", &f->why);
	term_json_open(&j, "faults", '[');
	for (uint64_t i = 0; i < f->n_faults && i < SCAN_FAULTS; i++) {
		term_json_open(&j, NULL, '{');
		term_json_u64(&j, "offset", f->faults[i].offset);
		term_json_u64(&j, "size", f->faults[i].size);
		term_json_text(&j, "reason", f->faults[i].text);
		term_json_close(&j, '}');
	}
	term_json_close(&j, ']');
	term_json_u64(&j, "fault_count", f->n_faults);
	term_json_number(&j, "seconds", f->seconds);
	term_json_end(&j);
}

void scan_replay_report(struct program *args, const struct scan_found *f)
{
	if (args->console.json)
		print_json(args, f);
	else if (!args->console.quiet)
		print_text(args, f);
}
