/* status: the daemon, its memory by name and by holder, its jobs. */
#include <string.h>

#include "ctl.h"
#include "parse.h"

/* What is held of a name by nobody of the list. */
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

static void print_entry(FILE *out, bool *first, const char *name, uint64_t bytes)
{
	char text[32];

	fprintf(out, "%s%s %s", *first ? "" : ", ", name, parse_size_text(bytes, text));
	*first = false;
}

static void print_holder(FILE *out, const struct acut_holder *h)
{
	char who[48] = "", text[32];
	bool first = true;

	if (h->id)
		snprintf(who, sizeof who, " %llu", (unsigned long long)h->id);
	fprintf(out, "  %-10s %s%s of user %u", parse_size_text(sum_of(h), text), h->kind, who, h->uid);
	if (h->pid)
		fprintf(out, ", process %u", h->pid);
	if (*h->what)
		fprintf(out, ", %s", h->what);
	fprintf(out, ": ");
	for (size_t k = 0; k < h->nheld; k++)
		print_entry(out, &first, h->held[k].name, h->held[k].bytes);
	fprintf(out, "\n");
}

static void print_ledger(FILE *out, const struct acut_status *s)
{
	char a[32], b[32];
	uint64_t sum = 0;
	bool first = true;

	for (size_t i = 0; i < s->nledger; i++)
		sum += s->ledger[i].bytes;
	fprintf(out, "memory      %s, held %s, at most %s since the start\n", parse_size_text(s->memory, a),
		parse_size_text(sum, b), parse_size_text(s->ledger_peak, (char[32]){0}));
	for (size_t i = 0; i < s->nledger; i++)
		if (s->ledger[i].peak || s->ledger[i].bytes)
			fprintf(out, "  %-10s %-10s at most %s\n", s->ledger[i].name,
				parse_size_text(s->ledger[i].bytes, a), parse_size_text(s->ledger[i].peak, b));
	fprintf(out, "held by\n");
	for (size_t i = 0; i < s->nholders; i++)
		print_holder(out, &s->holders[i]);
	if (s->holders_more)
		fprintf(out, "  and %zu more, with less each\n", s->holders_more);
	sum = 0;
	for (size_t i = 0; i < s->nledger; i++)
		sum += rest_of(s, i);
	fprintf(out, "  %-10s the daemon itself%s: ", parse_size_text(sum, a), s->holders_more ? " and those" : "");
	for (size_t i = 0; i < s->nledger; i++)
		if (rest_of(s, i))
			print_entry(out, &first, s->ledger[i].name, rest_of(s, i));
	fprintf(out, "%s\n", first ? "nothing" : "");
	fprintf(out, "resident    %s, at most %s\npipes       %s (of the kernel, beside the memory)\n",
		parse_size_text(s->rss_bytes, a), parse_size_text(s->peak_rss_bytes, b),
		parse_size_text(s->pipe_capacity, (char[32]){0}));
}

static void print(struct ctl *ctl, const struct acut_status *s)
{
	FILE *out = ctl->report;

	fprintf(out, "acutd %s, process %llu, up %.0f s\n", s->version, (unsigned long long)s->pid,
		s->uptime_seconds);
	print_ledger(out, s);
	fprintf(out, "threads     %u\njobs        %u running, %u waiting\nconnections %u\n", s->threads,
		s->jobs_running, s->jobs_waiting, s->connections);
	fprintf(out, "state       %s\ncache       %s\n", s->state_dir, s->cache_dir);
	if (s->state_side.known && s->cache_side.known)
		ctl_cache_sides(out, s->one_file_system, &s->state_side, &s->cache_side, s->disk_limit, s->keep_free_limit);
}

static void print_json_holders(struct ctl_json *j, const struct acut_status *s)
{
	ctl_json_open(j, "holders", '[');
	for (size_t i = 0; i < s->nholders; i++) {
		const struct acut_holder *h = &s->holders[i];

		ctl_json_open(j, NULL, '{');
		ctl_json_text(j, "kind", h->kind);
		if (h->id)
			ctl_json_u64(j, "id", h->id);
		else
			ctl_json_literal(j, "id", "null");
		ctl_json_u64(j, "uid", h->uid);
		if (h->pid)
			ctl_json_u64(j, "pid", h->pid);
		else
			ctl_json_literal(j, "pid", "null");
		ctl_json_known(j, "dataset", h->what);
		ctl_json_open(j, "held", '{');
		for (size_t k = 0; k < h->nheld; k++)
			ctl_json_u64(j, h->held[k].name, h->held[k].bytes);
		ctl_json_close(j, '}');
		ctl_json_close(j, '}');
	}
	ctl_json_close(j, ']');
	ctl_json_u64(j, "holders_more", s->holders_more);
}

static void print_json(struct ctl *ctl, const struct acut_status *s)
{
	struct ctl_json j = { .out = ctl->report };

	ctl_json_open(&j, NULL, '{');
	ctl_json_text(&j, "version", s->version);
	ctl_json_u64(&j, "pid", s->pid);
	ctl_json_u64(&j, "memory", s->memory);
	ctl_json_u64(&j, "rss_bytes", s->rss_bytes);
	ctl_json_u64(&j, "peak_rss_bytes", s->peak_rss_bytes);
	ctl_json_u64(&j, "pipe_capacity_bytes", s->pipe_capacity);
	ctl_json_u64(&j, "threads", s->threads);
	ctl_json_number(&j, "uptime_seconds", s->uptime_seconds);
	ctl_json_open(&j, "ledger", '{');
	for (size_t i = 0; i < s->nledger; i++)
		ctl_json_u64(&j, s->ledger[i].name, s->ledger[i].bytes);
	ctl_json_close(&j, '}');
	ctl_json_open(&j, "ledger_peak", '{');
	for (size_t i = 0; i < s->nledger; i++)
		ctl_json_u64(&j, s->ledger[i].name, s->ledger[i].peak);
	ctl_json_close(&j, '}');
	ctl_json_u64(&j, "ledger_peak_bytes", s->ledger_peak);
	print_json_holders(&j, s);
	ctl_json_u64(&j, "jobs_running", s->jobs_running);
	ctl_json_u64(&j, "jobs_waiting", s->jobs_waiting);
	ctl_json_u64(&j, "connections", s->connections);
	ctl_json_known(&j, "state", s->state_dir);
	ctl_json_known(&j, "cache", s->cache_dir);
	ctl_json_known(&j, "disk", s->disk_limit);
	ctl_json_known(&j, "keep_free", s->keep_free_limit);
	ctl_cache_side_json(&j, "state_disk", &s->state_side);
	ctl_cache_side_json(&j, "cache_disk", &s->cache_side);
	ctl_json_literal(&j, "one_file_system", s->one_file_system ? "true" : "false");
	ctl_json_close(&j, '}');
	ctl_json_line(&j);
}

int ctl_status_run(struct ctl *ctl)
{
	const struct acut_status *s;
	int status = ctl_connect(ctl);

	if (status)
		return status;
	if (acut_status(ctl->acut, &s))
		return ctl_error_acut(ctl);
	if (ctl->args.json)
		print_json(ctl, s);
	else
		print(ctl, s);
	return CTL_DONE;
}
