/* dataset prune NAME --keep N | --before GENERATION: old generations go, and what only they have. */
#include "ctl.h"
#include "ctl_dataset.h"
#include "parse.h"

static void print_json(const struct console *c, const char *name, const struct acut_pruned *p)
{
	struct term_json j = console_json(c);

	term_json_text(&j, "dataset", name);
	term_json_u64(&j, "oldest", p->oldest);
	term_json_u64(&j, "generations", p->generations);
	term_json_u64(&j, "files", p->files);
	term_json_u64(&j, "points", p->points);
	term_json_u64(&j, "bytes", p->bytes);
	term_json_u64(&j, "segments", p->segments);
	term_json_end(&j);
}

int ctl_dataset_prune(struct program *ctl)
{
	struct session *session = &ctl->session;
	const struct ctl_options *a = &ctl->opt;
	const char *name = ctl->line.word[0];
	struct err err = ERR_INIT;
	struct acut_pruned p;
	char points[32], bytes[32];
	int status;

	if (!a->keep == !a->before) {
		err_set(&err, ERR_USAGE, "dataset prune takes one of --keep and --before");
		err_add_hint(&err, "--keep 10: the newest ten generations stay; --before 20: all before generation 20 go");
		return session_error(session, &err);
	}
	status = session_connect(session);
	if (!status && acut_dataset_prune(session->acut, name, a->keep, a->before, &p))
		status = session_error_acut(session);
	if (status)
		return status;
	if (session->console.json)
		print_json(&session->console, name, &p);
	else if (!p.generations)
		console_line(&session->console, "%s: nothing is older than generation %llu", name, (unsigned long long)p.oldest);
	else
		console_line(&session->console, "%s: %llu generations gone, the oldest is %llu; %s points of %llu files gone, %s",
			     name, (unsigned long long)p.generations, (unsigned long long)p.oldest, term_count(p.points, points),
			     (unsigned long long)p.files, parse_size_text(p.bytes, bytes));
	return SESSION_DONE;
}
