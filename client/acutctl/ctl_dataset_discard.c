/* dataset discard NAME [--all]: what interrupted pushes left goes. */
#include "ctl.h"
#include "ctl_dataset.h"
#include "parse.h"

static void print_json(const struct console *c, const char *name, const struct acut_discarded *d)
{
	struct term_json j = console_json(c);

	term_json_text(&j, "dataset", name);
	term_json_u64(&j, "pushes", d->pushes);
	term_json_u64(&j, "files", d->files);
	term_json_u64(&j, "bytes", d->bytes);
	term_json_open(&j, "open", '[');
	for (size_t i = 0; i < d->nopen; i++)
		term_json_u64(&j, NULL, d->open[i]);
	term_json_close(&j, ']');
	term_json_end(&j);
}

static void print_text(struct console *c, const char *name, const struct acut_discarded *d)
{
	char bytes[32];

	if (d->pushes)
		console_line(c, "%s: %llu interrupted push%s discarded, %llu file%s, %s", name, (unsigned long long)d->pushes,
			     d->pushes == 1 ? "" : "es", (unsigned long long)d->files, d->files == 1 ? "" : "s",
			     parse_size_text(d->bytes, bytes));
	else
		console_line(c, "%s: no interrupted push is pending", name);
	for (size_t i = 0; i < d->nopen; i++)
		console_line(c, "%s: push %llu is open and keeps what it has", name, (unsigned long long)d->open[i]);
}

int ctl_dataset_discard(struct program *ctl)
{
	struct session *session = &ctl->session;
	const char *name = ctl->line.word[0];
	struct acut_discarded d;
	int status = session_connect(session);

	if (!status && acut_dataset_discard(session->acut, name, ctl->opt.all, &d))
		status = session_error_acut(session);
	if (status)
		return status;
	if (session->console.json)
		print_json(&session->console, name, &d);
	else
		print_text(&session->console, name, &d);
	return SESSION_DONE;
}
