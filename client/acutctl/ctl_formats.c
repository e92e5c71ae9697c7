/* formats: what can be read (by the daemon of this version) and written (here, from the table of writers). */
#include <string.h>

#include "ctl.h"
#include "term_table.h"

const struct ctl_input_format ctl_formats_input[] = {
	{"las", ".las .laz", "ASPRS LAS 1.0 to 1.5 and LAZ, point formats 0 to 10"},
	{"ptx", ".ptx", "scans of a scanner that stands (Leica, FARO): cells by column and row, each scan with its matrix"},
	{"pts", ".pts", "text with the number of points in its first line, then as xyz"},
	{"xyz", ".xyz .txt .csv .asc", "text, one point a line: x y z or --columns; space, tab, comma or semicolon"},
	{0},
};

const struct ctl_input_format ctl_formats_archive[] = {
	{"gz", ".gz", "a file packed by gzip: unpacked, then as what is in it"},
	{"zip", ".zip", "an archive: the survey files in it, each unpacked, then as what it is"},
	{0},
};

bool ctl_formats_extension(const struct ctl_input_format *f, const char *word)
{
	size_t n = strlen(word);

	for (const char *at = f->extensions; n && (at = strstr(at, word)); at += n)
		if (at > f->extensions && at[-1] == '.' && (!at[n] || at[n] == ' '))
			return true;
	return false;
}

static const struct term_column columns[] = {
	{"FORMAT"},
	{"DIRECTION"},
	{"EXTENSIONS"},
	{"WHAT IT IS", .tail = true},
};

static void row(struct program *ctl, struct term_table *t, const char *direction, const char *name, const char *extensions,
		const char *help)
{
	struct term_json j = {.out = ctl->session.console.report};

	if (!ctl->session.console.json) {
		term_table_text(t, "%s", name);
		term_table_text(t, "%s", direction);
		term_table_text(t, "%s", extensions);
		term_table_text(t, "%s", help);
		return;
	}
	term_json_open(&j, NULL, '{');
	term_json_text(&j, "format", name);
	term_json_text(&j, "direction", direction);
	term_json_text(&j, "extensions", extensions);
	term_json_text(&j, "help", help);
	term_json_close(&j, '}');
	term_json_line(&j);
}

int ctl_formats_run(struct program *ctl)
{
	size_t n;
	const struct format *const *rows = format_rows(&n);
	struct term_table *t = ctl->session.console.json ?
				       NULL :
				       term_table_new(ctl->session.console.report, columns, sizeof(columns) / sizeof(*columns));

	for (size_t i = 0; ctl_formats_input[i].name; i++)
		row(ctl, t, "in", ctl_formats_input[i].name, ctl_formats_input[i].extensions, ctl_formats_input[i].help);
	for (size_t i = 0; ctl_formats_archive[i].name; i++)
		row(ctl, t, "in", ctl_formats_archive[i].name, ctl_formats_archive[i].extensions, ctl_formats_archive[i].help);
	for (size_t i = 0; i < n; i++)
		row(ctl, t, "out", rows[i]->name, rows[i]->extensions, rows[i]->help);
	term_table_free(t);
	return SESSION_DONE;
}
