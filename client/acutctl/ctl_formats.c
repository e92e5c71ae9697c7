/* formats: what can be read (by the daemon of this version) and written (here, from the table of writers). */
#include "ctl.h"

static const struct { const char *name, *extensions, *help; } input[] = {
	{ "las", ".las", "ASPRS LAS 1.0 to 1.5 and LAZ, point formats 0 to 10" },
	{ "xyz", ".xyz", "text, one point a line: x y z; space, tab, comma or semicolon" },
};

static void line(struct ctl *ctl, const char *direction, const char *name, const char *extensions,
		 const char *help)
{
	struct ctl_json j = { .out = ctl->report };

	if (!ctl->args.json) {
		fprintf(ctl->report, "  %-6s %-6s %s\n", name, extensions, help);
		return;
	}
	ctl_json_open(&j, NULL, '{');
	ctl_json_text(&j, "format", name);
	ctl_json_text(&j, "direction", direction);
	ctl_json_text(&j, "extensions", extensions);
	ctl_json_text(&j, "help", help);
	ctl_json_close(&j, '}');
	ctl_json_line(&j);
}

int ctl_formats_run(struct ctl *ctl)
{
	size_t n;
	const struct format *const *row = format_rows(&n);

	if (!ctl->args.json)
		fputs("read, known by their bytes:\n", ctl->report);
	for (size_t i = 0; i < sizeof(input) / sizeof(*input); i++)
		line(ctl, "in", input[i].name, input[i].extensions, input[i].help);
	if (!ctl->args.json)
		fputs("written:\n", ctl->report);
	for (size_t i = 0; i < n; i++)
		line(ctl, "out", row[i]->name, row[i]->extensions, row[i]->help);
	return CTL_DONE;
}
