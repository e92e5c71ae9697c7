/* cache stat|verify|gc: use of the daemon's disk, verification, and removal of derived data. adopt is ctl_cache_adopt.c. */
#include <string.h>

#include "ctl.h"
#include "term.h"
#include "parse.h"

/* ---- stat ---- */

static void side_print(FILE *out, const char *name, const struct acut_side *s, const char *disk, const char *keep_free)
{
	char a[32], b[32], c[32], d[32], held[96];

	if (s->has_quota)
		snprintf(held, sizeof(held), "%s used of %s (--disk %s)", parse_size_text(s->used, a),
			 parse_size_text(s->quota, b), disk);
	else
		snprintf(held, sizeof(held), "%s used, no quota", parse_size_text(s->used, a));
	term_field(out, name, "%s; %s free of %s, %s stay free (--keep-free %s)", held, parse_size_text(s->free, a),
		   parse_size_text(s->total, c), parse_size_text(s->keep_free, d), keep_free);
}

void ctl_cache_sides(FILE *out, bool one, const struct acut_side *state, const struct acut_side *cache, const char *disk,
		     const char *keep_free)
{
	side_print(out, one ? "disk" : "state disk", state, disk, keep_free);
	if (!one)
		side_print(out, "cache disk", cache, disk, keep_free);
}

void ctl_cache_side_json(struct term_json *j, const char *name, const struct acut_side *s)
{
	if (!s->known) {
		term_json_null(j, name);
		return;
	}
	term_json_open(j, name, '{');
	term_json_u64(j, "used", s->used);
	if (s->has_quota)
		term_json_u64(j, "quota", s->quota);
	else
		term_json_null(j, "quota");
	term_json_u64(j, "total", s->total);
	term_json_u64(j, "free", s->free);
	term_json_u64(j, "keep_free", s->keep_free);
	term_json_close(j, '}');
}

static void stat_json(const struct console *c, const struct acut_cache_stat *s)
{
	struct term_json j = console_json(c);

	term_json_open(&j, "kinds", '{');
	for (size_t i = 0; i < s->nkinds; i++) {
		term_json_open(&j, s->kinds[i].name, '{');
		term_json_u64(&j, "bytes", s->kinds[i].bytes);
		term_json_u64(&j, "entries", s->kinds[i].entries);
		term_json_bool(&j, "state", s->kinds[i].state);
		term_json_close(&j, '}');
	}
	term_json_close(&j, '}');
	term_json_known(&j, "disk", s->disk_limit);
	term_json_known(&j, "keep_free", s->keep_free_limit);
	ctl_cache_side_json(&j, "state_disk", &s->state);
	ctl_cache_side_json(&j, "cache_disk", &s->cache);
	term_json_bool(&j, "one_file_system", s->one_file_system);
	term_json_bool(&j, "measured", s->measured);
	term_json_u64(&j, "evicted_bytes", s->evicted_bytes);
	term_json_u64(&j, "evicted_entries", s->evicted_entries);
	term_json_end(&j);
}

static const struct term_column columns[] = {
	{"KIND"},
	{"SIZE", .right = true},
	{"ENTRIES", .right = true},
	{"DESCRIPTION", .spare = true},
};

static int stat_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	const struct acut_cache_stat *s;
	struct term_table *t;
	FILE *out = session->console.report;
	char size[32];
	int status = session_connect(session);

	if (status)
		return status;
	if (acut_cache_stat(session->acut, &s))
		return session_error_acut(session);
	if (session->console.json) {
		stat_json(&session->console, s);
		return SESSION_DONE;
	}
	t = CONSOLE_TABLE(&session->console, columns);
	for (size_t i = 0; i < s->nkinds; i++) {
		term_table_text(t, "%s", s->kinds[i].name);
		term_table_size(t, s->kinds[i].bytes);
		term_table_count(t, s->kinds[i].entries);
		term_table_text(t, s->kinds[i].state ? "pushed" : "made again");
	}
	term_table_free(t);
	ctl_cache_sides(out, s->one_file_system, &s->state, &s->cache, s->disk_limit, s->keep_free_limit);
	if (!s->measured)
		term_line(out, "the cache from before the start is not counted yet");
	term_field(out, "evicted", "%s in %llu domains and selections since the start", parse_size_text(s->evicted_bytes, size),
		   (unsigned long long)s->evicted_entries);
	return SESSION_DONE;
}

/* ---- verify ---- */

static void damage(void *ctx, const struct acut_cache_damage *d)
{
	struct session_progress *progress = ctx;
	struct console *c = &progress->session->console;
	struct err err;
	char text[1400];

	console_progress_clear(c);
	session_failure_of(&d->error, &err);
	if (c->json) {
		struct term_json j = console_json(c);

		term_json_text(&j, "damaged", d->what);
		term_json_known(&j, "dataset", d->dataset);
		term_json_bool(&j, "derived", d->derived);
		term_json_bool(&j, "removed", d->removed);
		term_json_bool(&j, "newer", err.code == ERR_VERSION);
		term_error_json(&j, "error", &err);
		term_json_end(&j);
		return;
	}
	if (err.code == ERR_VERSION) {
		term_line(c->report, "of a newer version: %s%s%s: %s", d->what, *d->dataset ? " of " : "", d->dataset,
			  err_format(&err, text, sizeof(text)));
		fflush(c->report);
		return;
	}
	term_line(c->report, "damaged %s%s%s: %s%s", d->what, *d->dataset ? " of " : "", d->dataset,
		  err_format(&err, text, sizeof(text)),
		  !d->derived ? "" :
		  d->removed  ? "; removed, it is made again" :
				"; it could not be removed");
	fflush(c->report);
}

static void verify_progress(void *ctx, const struct acut_progress *now)
{
	struct session_progress *progress = ctx;
	char a[32], b[32];

	if (progress->on)
		console_progress(&progress->session->console, "%.40s: %s of about %s", now->phase,
				 parse_size_text(now->points, a), parse_size_text(now->points_total, b));
}

static int verify_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct session_progress progress;
	struct acut_cache_verified out;
	char size[32];
	int status = session_connect(session);

	if (status)
		return status;
	session_progress_init(&progress, session);
	status = acut_cache_verify(session->acut, damage, verify_progress, &progress, &out);
	console_progress_clear(&session->console);
	if (status)
		return session_error_acut(session);
	if (session->console.json) {
		struct term_json j = console_json(&session->console);

		term_json_u64(&j, "files", out.files);
		term_json_u64(&j, "bytes", out.bytes);
		term_json_u64(&j, "damaged", out.damaged);
		term_json_u64(&j, "derived_damaged", out.derived);
		term_json_u64(&j, "newer", out.newer);
		term_json_u64(&j, "derived_newer", out.derived_newer);
		term_json_end(&j);
	} else {
		fprintf(session->console.report,
			"%llu files of %s read: %llu damaged of what was pushed, %llu of what is made again\n",
			(unsigned long long)out.files, parse_size_text(out.bytes, size), (unsigned long long)out.damaged,
			(unsigned long long)out.derived);
		if (out.newer || out.derived_newer)
			fprintf(session->console.report,
				"%llu of what was pushed, %llu of what is made again are of a newer version of acut and were not "
				"read%s\n",
				(unsigned long long)out.newer, (unsigned long long)out.derived_newer,
				out.newer ? ": install the acut that wrote them again, or a later one" : "");
	}
	return out.damaged ? 1 : out.newer ? err_exit_status(ERR_VERSION) : SESSION_DONE;
}

/* ---- gc ---- */

static int gc_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	uint64_t bytes, entries;
	char size[32];
	int status = session_connect(session);

	if (status)
		return status;
	if (acut_cache_gc(session->acut, ctl->opt.all, &bytes, &entries))
		return session_error_acut(session);
	if (session->console.json) {
		struct term_json j = console_json(&session->console);

		term_json_u64(&j, "freed_bytes", bytes);
		term_json_u64(&j, "freed_entries", entries);
		term_json_end(&j);
	} else {
		fprintf(session->console.report, "%s in %llu domains and selections are free\n", parse_size_text(bytes, size),
			(unsigned long long)entries);
	}
	return SESSION_DONE;
}

const struct cli_verb ctl_cache_verbs[] = {
	{"stat", "stat", "use of the daemon's disk, by kind", 0, 0, NULL, stat_run},
	{"verify", "verify", "read all of it and report damage", 0, 0, NULL, verify_run},
	{"adopt", "adopt WORK", "take the finished domains of a run of acut-cluster", 1, 1, NULL, ctl_cache_adopt},
	{"gc", "gc", "remove what exceeds the quota, or all that can be made again", 0, 0, "all", gc_run},
	{0},
};
