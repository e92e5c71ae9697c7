/* status: the daemon, its memory by name, its jobs. */
#include "ctl.h"
#include "parse.h"

static void print(struct ctl *ctl, const struct acut_status *s)
{
	FILE *out = ctl->report;
	char a[32], b[32];

	fprintf(out, "acutd %s, process %llu, up %.0f s\n", s->version, (unsigned long long)s->pid,
		s->uptime_seconds);
	fprintf(out, "memory      %s, most ever used %s\n", parse_size_text(s->memory, a),
		parse_size_text(s->peak_rss_bytes, b));
	for (size_t i = 0; i < s->nledger; i++)
		if (s->ledger[i].bytes)
			fprintf(out, "  %-10s %s\n", s->ledger[i].name,
				parse_size_text(s->ledger[i].bytes, a));
	fprintf(out, "threads     %u\njobs        %u running, %u waiting\nconnections %u\n", s->threads,
		s->jobs_running, s->jobs_waiting, s->connections);
	fprintf(out, "state       %s\ncache       %s\n", s->state_dir, s->cache_dir);
}

static void print_json(struct ctl *ctl, const struct acut_status *s)
{
	struct ctl_json j = { .out = ctl->report };

	ctl_json_open(&j, NULL, '{');
	ctl_json_text(&j, "version", s->version);
	ctl_json_u64(&j, "pid", s->pid);
	ctl_json_u64(&j, "memory", s->memory);
	ctl_json_u64(&j, "peak_rss_bytes", s->peak_rss_bytes);
	ctl_json_u64(&j, "threads", s->threads);
	ctl_json_number(&j, "uptime_seconds", s->uptime_seconds);
	ctl_json_open(&j, "ledger", '{');
	for (size_t i = 0; i < s->nledger; i++)
		ctl_json_u64(&j, s->ledger[i].name, s->ledger[i].bytes);
	ctl_json_close(&j, '}');
	ctl_json_u64(&j, "jobs_running", s->jobs_running);
	ctl_json_u64(&j, "jobs_waiting", s->jobs_waiting);
	ctl_json_u64(&j, "connections", s->connections);
	ctl_json_known(&j, "state", s->state_dir);
	ctl_json_known(&j, "cache", s->cache_dir);
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
