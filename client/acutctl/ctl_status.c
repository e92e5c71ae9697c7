/* status: the daemon, its memory by name and by holder, its jobs. */
#include <string.h>

#include "ctl.h"
#include "term.h"
#include "parse.h"

/* Bytes under a name that no listed holder has. */
static uint64_t rest_of(const struct acut_status *s, size_t name)
{
	uint64_t left = s->ledger[name].bytes;

	for (size_t i = 0; i < s->nholders; i++)
		for (size_t k = 0; k < s->holders[i].nheld; k++) {
			const struct acut_ledger_entry *e = &s->holders[i].held[k];

			if (!strcmp(e->name, s->ledger[name].name))
				left -= e->bytes < left ? e->bytes : left;
		}
	return left;
}

static uint64_t sum_of(const struct acut_holder *h)
{
	uint64_t sum = 0;

	for (size_t k = 0; k < h->nheld; k++)
		sum += h->held[k].bytes;
	return sum;
}

static void add_entry(char *text, size_t size, const char *name, uint64_t bytes)
{
	size_t n = strlen(text);
	char held[32];

	if (n < size)
		snprintf(text + n, size - n, "%s%s %s", n ? ", " : "", name, parse_size_text(bytes, held));
}

static void print_holder(struct term_table *t, const struct acut_holder *h)
{
	char text[512] = "";

	for (size_t k = 0; k < h->nheld; k++)
		add_entry(text, sizeof(text), h->held[k].name, h->held[k].bytes);
	term_table_size(t, sum_of(h));
	term_table_text(t, "%s", h->kind);
	term_table_id(t, h->id);
	term_table_text(t, "%u", h->uid);
	term_table_id(t, h->pid);
	term_table_text(t, "%s", h->what);
	term_table_text(t, "%s", text);
}

/* The rest, without a listed holder. */
static void print_rest(struct term_table *t, const struct acut_status *s)
{
	char text[512] = "";
	uint64_t sum = 0;

	for (size_t i = 0; i < s->nledger; i++) {
		if (!rest_of(s, i))
			continue;
		sum += rest_of(s, i);
		add_entry(text, sizeof(text), s->ledger[i].name, rest_of(s, i));
	}
	term_table_size(t, sum);
	term_table_text(t, "daemon");
	for (int i = 0; i < 3; i++)
		term_table_none(t);
	if (s->holders_more)
		term_table_text(t, "and %zu more", s->holders_more);
	else
		term_table_none(t);
	term_table_text(t, "%s", text);
}

static void print_tables(FILE *out, const struct acut_status *s)
{
	static const struct term_column names[] = {{"MEMORY FOR"}, {"HELD", .right = true}, {"AT MOST", .right = true}};
	static const struct term_column holders[] = {
		{"HELD", .right = true},
		{"BY"},
		{"NUMBER", .right = true, .spare = true},
		{"USER", .right = true},
		{"PROCESS", .right = true, .spare = true},
		{"DATASET", .shrink = true, .spare = true},
		{"FOR", .tail = true},
	};
	struct term_table *t = term_table_new(out, names, 3);

	fputc('\n', out);
	for (size_t i = 0; i < s->nledger; i++) {
		if (!s->ledger[i].peak && !s->ledger[i].bytes)
			continue;
		term_table_text(t, "%s", s->ledger[i].name);
		term_table_size(t, s->ledger[i].bytes);
		term_table_size(t, s->ledger[i].peak);
	}
	term_table_free(t);
	fputc('\n', out);
	t = term_table_new(out, holders, 7);
	for (size_t i = 0; i < s->nholders; i++)
		print_holder(t, &s->holders[i]);
	print_rest(t, s);
	term_table_free(t);
}

static void print(FILE *out, const struct acut_status *s)
{
	char a[32], b[32], c[32];
	uint64_t sum = 0;

	for (size_t i = 0; i < s->nledger; i++)
		sum += s->ledger[i].bytes;
	term_field(out, "acutd", "%s, process %llu, up %.0f s", s->version, (unsigned long long)s->pid, s->uptime_seconds);
	term_field(out, "memory", "%s, held %s, at most %s since the start", parse_size_text(s->memory, a),
		   parse_size_text(sum, b), parse_size_text(s->ledger_peak, c));
	term_field(out, "resident", "%s, at most %s", parse_size_text(s->rss_bytes, a), parse_size_text(s->peak_rss_bytes, b));
	term_field(out, "pipes", "%s (of the kernel, beside the memory)", parse_size_text(s->pipe_capacity, a));
	term_field(out, "threads", "%u", s->threads);
	term_field(out, "jobs", "%u running, %u waiting", s->jobs_running, s->jobs_waiting);
	term_field(out, "connections", "%u", s->connections);
	term_field(out, "state", "%s", s->state_dir);
	term_field(out, "cache", "%s", s->cache_dir);
	if (s->state_side.known && s->cache_side.known)
		ctl_cache_sides(out, s->one_file_system, &s->state_side, &s->cache_side, s->disk_limit, s->keep_free_limit);
	print_tables(out, s);
}

static void print_json_holders(struct term_json *j, const struct acut_status *s)
{
	term_json_open(j, "holders", '[');
	for (size_t i = 0; i < s->nholders; i++) {
		const struct acut_holder *h = &s->holders[i];

		term_json_open(j, NULL, '{');
		term_json_text(j, "kind", h->kind);
		term_json_known_u64(j, "id", h->id);
		term_json_u64(j, "uid", h->uid);
		term_json_known_u64(j, "pid", h->pid);
		term_json_known(j, "dataset", h->what);
		term_json_open(j, "held", '{');
		for (size_t k = 0; k < h->nheld; k++)
			term_json_u64(j, h->held[k].name, h->held[k].bytes);
		term_json_close(j, '}');
		term_json_close(j, '}');
	}
	term_json_close(j, ']');
	term_json_u64(j, "holders_more", s->holders_more);
}

static void print_json(const struct console *c, const struct acut_status *s)
{
	struct term_json j = console_json(c);

	term_json_text(&j, "version", s->version);
	term_json_u64(&j, "pid", s->pid);
	term_json_u64(&j, "memory", s->memory);
	term_json_u64(&j, "rss_bytes", s->rss_bytes);
	term_json_u64(&j, "peak_rss_bytes", s->peak_rss_bytes);
	term_json_u64(&j, "pipe_capacity_bytes", s->pipe_capacity);
	term_json_u64(&j, "threads", s->threads);
	term_json_number(&j, "uptime_seconds", s->uptime_seconds);
	term_json_open(&j, "ledger", '{');
	for (size_t i = 0; i < s->nledger; i++)
		term_json_u64(&j, s->ledger[i].name, s->ledger[i].bytes);
	term_json_close(&j, '}');
	term_json_open(&j, "ledger_peak", '{');
	for (size_t i = 0; i < s->nledger; i++)
		term_json_u64(&j, s->ledger[i].name, s->ledger[i].peak);
	term_json_close(&j, '}');
	term_json_u64(&j, "ledger_peak_bytes", s->ledger_peak);
	print_json_holders(&j, s);
	term_json_u64(&j, "jobs_running", s->jobs_running);
	term_json_u64(&j, "jobs_waiting", s->jobs_waiting);
	term_json_u64(&j, "connections", s->connections);
	term_json_known(&j, "state", s->state_dir);
	term_json_known(&j, "cache", s->cache_dir);
	term_json_known(&j, "disk", s->disk_limit);
	term_json_known(&j, "keep_free", s->keep_free_limit);
	ctl_cache_side_json(&j, "state_disk", &s->state_side);
	ctl_cache_side_json(&j, "cache_disk", &s->cache_side);
	term_json_bool(&j, "one_file_system", s->one_file_system);
	term_json_end(&j);
}

int ctl_status_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	const struct acut_status *s;
	int status = session_connect(session);

	if (status)
		return status;
	if (acut_status(session->acut, &s))
		return session_error_acut(session);
	if (session->console.json)
		print_json(&session->console, s);
	else
		print(session->console.report, s);
	return SESSION_DONE;
}
