/* Files of lines on command lines: push --lines-as, and mesh --breaklines, --lakes, --boundary, --holes. */
#include "ctl.h"

static int only_with_lines(const struct program *ctl, const char *with, struct err *err)
{
	const struct lines_export_options *o = &ctl->opt.line_options;
	const char *option = ctl->input.layer      ? "--layer" :
			     ctl->input.kind_field ? "--kind-field" :
			     o->densify            ? "--densify" :
			     o->lake_level         ? "--lake-level" :
						     NULL;

	if (!option)
		return 0;
	err_set(err, ERR_USAGE, "%s is about files of lines, and there are none", option);
	return err_add_hint(err, "name them with %s", with);
}

/* A file of lines among survey files is no mistake of the daemon's to explain. A text that has points is not refused, as only
 * its user knows. */
static int refuse_lines(struct program *ctl, unsigned first, const char *how, struct err *err)
{
	const struct ctl_input_options *o = &ctl->input;

	for (unsigned i = first; i < ctl->line.nword && !o->format; i++) {
		const char *name = ctl->line.word[i], *is = lines_recognise(name);

		if (!is && !o->columns && lines_may_be(name))
			console_note(&ctl->session.console, "%s may be lines, as its rows have the names of some: if it is, %s",
				     name, how);
		if (!is)
			continue;
		err_set(err, ERR_USAGE, "it is a file of lines (%s), and nothing says what they are", is);
		err_add_hint(err, "%s", how);
		return err_add_file(err, name);
	}
	return 0;
}

int ctl_lines_as(struct program *ctl, struct ctl_inputs *in, struct err *err)
{
	if (!ctl->opt.line_options.kind && !ctl->input.kind_field) {
		int r = only_with_lines(ctl, "--lines-as", err);

		return r ? r :
			   refuse_lines(ctl, 1,
					"push it with --lines-as hard, lake, boundary or hole, apart from files of points", err);
	}
	in->lines = &ctl->opt.line_options;
	return lines_export_check(in->lines, err);
}

int ctl_lines_beside(struct program *ctl, struct ctl_inputs *in, struct lines_export_options options[LINES_KINDS],
		     struct err *err)
{
	unsigned n = 0;
	int r = 0;

	for (unsigned kind = 0; kind < LINES_KINDS && !r; kind++) {
		const struct cli_texts *file = &ctl->opt.line_files[kind];

		options[kind] = ctl->opt.line_options;
		options[kind].kind = lines_kind_text[kind];
		r = lines_export_check(&options[kind], err);
		for (unsigned i = 0; i < file->n && !r; i++)
			r = ctl_inputs_add_lines(in, file->text[i], &options[kind], err);
		n += file->n;
	}
	if (!r && !n)
		r = only_with_lines(ctl, "--breaklines", err);
	if (!r && n && ctl->view.no_breaklines) {
		err_set(err, ERR_USAGE, "--no-breaklines leaves out all lines that are given");
		return err_add_hint(err, "leave it out, or the files of lines");
	}
	return r ? r : refuse_lines(ctl, 0, "give it with --breaklines, --lakes, --boundary or --holes", err);
}
