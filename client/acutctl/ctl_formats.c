/* formats: what can be read (by the daemon of this version) and written (here, from the table of writers). */
#include "ctl.h"

static const struct term_column columns[] = {
	{"FORMAT"}, {"DIRECTION"}, {"EXTENSIONS"}, {"DESCRIPTION", .tail = true}, {"FOR", .tail = true, .spare = true},
};

static void row(const struct console_list *l, const char *direction, const char *name, const char *extensions, const char *help,
		const char *purpose)
{
	struct term_json j;

	if (l->table) {
		term_table_text(l->table, "%s", name);
		term_table_text(l->table, "%s", direction);
		term_table_text(l->table, "%s", extensions);
		term_table_text(l->table, "%s", help);
		term_table_text(l->table, "%s", purpose);
		return;
	}
	j = console_json(l->console);
	term_json_text(&j, "format", name);
	term_json_text(&j, "direction", direction);
	term_json_text(&j, "extensions", extensions);
	term_json_text(&j, "help", help);
	term_json_text(&j, "for", purpose);
	term_json_end(&j);
}

int ctl_formats_run(struct program *ctl)
{
	struct console *c = &ctl->session.console;
	const struct console_list l = {c, CONSOLE_TABLE(c, columns)};
	size_t n;
	const struct format *const *rows = format_rows(&n);

	for (const struct ctl_input_format *f = ctl_input_formats; f->name; f++)
		row(&l, "in", f->name, f->extensions, f->help, "points");
	for (const struct ctl_input_format *f = ctl_input_archives; f->name; f++)
		row(&l, "in", f->name, f->extensions, f->help, "points, packed");
	for (size_t i = 0; i < n; i++)
		row(&l, "out", rows[i]->name, rows[i]->extensions, rows[i]->help, rows[i]->purpose);
	term_table_free(l.table);
	return SESSION_DONE;
}
