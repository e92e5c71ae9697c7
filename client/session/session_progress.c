/*
 * The progress line, on terminals only: phase, points, domains, rate, time left, written ten times a second.
 */
#include <stdio.h>
#include <string.h>

#include "clock.h"
#include "session.h"
#include "parse.h"

#define EVERY_NS 100000000u

void session_progress_init(struct session_progress *p, struct session *session)
{
	*p = (struct session_progress){.session = session, .on = console_progress_on(&session->console)};
}

/* "12.3 M" */
static const char *short_count(double n, char buf[24])
{
	if (n >= 1e9)
		snprintf(buf, 24, "%.2f G", n / 1e9);
	else if (n >= 1e6)
		snprintf(buf, 24, "%.1f M", n / 1e6);
	else if (n >= 1e4)
		snprintf(buf, 24, "%.0f k", n / 1e3);
	else
		snprintf(buf, 24, "%.0f", n);
	return buf;
}

const char *session_progress_time(double s, char buf[24])
{
	unsigned long n = s < 0 ? 0 : s > 1e7 ? 10000000 : (unsigned long)(s + 0.5);

	if (n >= 3600)
		snprintf(buf, 24, "%lu:%02lu:%02lu", n / 3600, n / 60 % 60, n % 60);
	else
		snprintf(buf, 24, "%lu:%02lu", n / 60, n % 60);
	return buf;
}

/* What the job waits for, in the words of the command jobs. */
static const char *waits_text(const char *waiting, char buf[320])
{
	static const char space[] = "waiting-space: ", file[] = "stalled-file: ", files[] = "stalled-files: ";
	uint64_t bytes;
	char size[32];

	if (!strncmp(waiting, space, sizeof(space) - 1) && parse_u64(waiting + sizeof(space) - 1, &bytes))
		snprintf(buf, 320, "%s of disk space are lacking", parse_size_text(bytes, size));
	else if (!strncmp(waiting, file, sizeof(file) - 1))
		snprintf(buf, 320, "%s gives nothing", waiting + sizeof(file) - 1);
	else if (!strncmp(waiting, files, sizeof(files) - 1))
		snprintf(buf, 320, "waits for %.20s other files of yours that give nothing", waiting + sizeof(files) - 1);
	else
		snprintf(buf, 320, "waits for %.100s", waiting);
	return buf;
}

/* Without a progress line: a lack of disk space is noted once, since it may last until an administrator frees some. */
static void note_space(struct session_progress *p, const struct acut_progress *now)
{
	bool lacks = now->waiting && !strncmp(now->waiting, "waiting-space", 13);
	char text[320];

	if (lacks && !p->printed_space)
		console_note(&p->session->console, "%s", waits_text(now->waiting, text));
	p->printed_space = lacks;
}

/* Each file is noted once: it may last until somebody mends the file system. */
static void note_file(struct session_progress *p, const struct acut_progress *now)
{
	static const char file[] = "stalled-file: ", files[] = "stalled-files: ";
	bool others = now->waiting && !strncmp(now->waiting, files, sizeof(files) - 1);
	bool stalled = now->waiting && !strncmp(now->waiting, file, sizeof(file) - 1);

	if (!stalled && !others) {
		p->stalled[0] = 0;
		return;
	}
	if (!strncmp(p->stalled, now->waiting, sizeof(p->stalled) - 1))
		return;
	snprintf(p->stalled, sizeof(p->stalled), "%s", now->waiting);
	if (stalled)
		console_note(
			&p->session->console,
			"%s gives nothing: does the file system that it is on answer? It is waited for; Ctrl-C ends the push",
			now->waiting + sizeof(file) - 1);
	else
		console_note(
			&p->session->console,
			"this push waits: %.20s other files of yours give nothing; it goes on when one of them does, or its push ends",
			now->waiting + sizeof(files) - 1);
}

static void draw(struct session_progress *p, const struct acut_progress *now)
{
	uint64_t points = p->base + now->points, total = p->total ? p->total : now->points_total;
	double seconds = clock_since(p->start_ns), share = 0;
	char a[24], b[24], c[24], text[320], line[512];
	int n;

	if (now->domains_total)
		share = (double)now->domains / (double)now->domains_total;
	else if (total)
		share = (double)points / (double)total;
	/* 100 % appears only at the end. */
	share = share > 0.99 ? 0.99 : share;
	n = snprintf(line, sizeof(line), "%-6s %3d %%  %s points", p->phase, (int)(100 * share + 1e-9),
		     short_count((double)points, a));
	if (now->domains_total)
		n += snprintf(line + n, sizeof(line) - (size_t)n, "  %llu of %llu domains", (unsigned long long)now->domains,
			      (unsigned long long)now->domains_total);
	if (now->waiting && *now->waiting)
		n += snprintf(line + n, sizeof(line) - (size_t)n, "  %s", waits_text(now->waiting, text));
	else if (seconds > 0.2 && points)
		n += snprintf(line + n, sizeof(line) - (size_t)n, "  %s/s", short_count((double)points / seconds, b));
	/* The daemon knows what was work and what was waiting. */
	if (now->seconds_left > 0)
		snprintf(line + n, sizeof(line) - (size_t)n, "  %s left", session_progress_time(now->seconds_left, c));
	else if (seconds > 1 && share > 0.01 && !now->domains_total)
		snprintf(line + n, sizeof(line) - (size_t)n, "  %s left",
			 session_progress_time(seconds / share * (1 - share), c));
	console_progress(&p->session->console, "%s", line);
}

/* A large file is read once more, in the middle of another phase: for its sum, not for points. */
static void draw_hash(struct session_progress *p, const struct acut_progress *now)
{
	double share = now->points_total ? (double)now->points / (double)now->points_total : 0;
	char done[32], all[32];

	console_progress(&p->session->console, "%-6s %3d %%  %s of %s, for the checksum of the file", "hash",
			 (int)(100 * share + 1e-9), parse_size_text(now->points, done), parse_size_text(now->points_total, all));
}

void session_progress_show(void *ctx, const struct acut_progress *now)
{
	struct session_progress *p = ctx;
	uint64_t t = clock_mono_ns();

	note_file(p, now);
	if (!p->on) {
		note_space(p, now);
		return;
	}
	if (!strcmp(now->phase, "hash")) {
		draw_hash(p, now);
		return;
	}
	if (strncmp(p->phase, now->phase, sizeof(p->phase) - 1)) {
		snprintf(p->phase, sizeof(p->phase), "%s", now->phase);
		p->start_ns = t;
		p->last_ns = 0;
		if (strcmp(p->phase, "stage"))
			p->base = p->total = 0;
	}
	if (p->last_ns && t - p->last_ns < EVERY_NS)
		return;
	p->last_ns = t;
	draw(p, now);
}

void session_progress_job(void *ctx, const struct acut_job *job)
{
	if (!job->final)
		session_progress_show(ctx, &job->progress);
}
