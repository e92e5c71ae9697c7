/*
 * Comments of text headers that describe the numbers, a line each whatever the CRS text contains.
 */
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "format_axis.h"
#include "outfile.h"

static bool has_window(const struct acut_mesh_head *head)
{
	return head->view && strstr(head->view, " window=");
}

bool format_is_part(const struct acut_mesh_head *head, const struct format_options *opt)
{
	return opt->trimmed || has_window(head) || head->bounded;
}

/* "acut-trimmed ..." of a file that has a part of the mesh, else "". */
static void trimmed_text(const struct acut_mesh_head *head, const struct format_options *opt, char *buf, size_t size)
{
	const char *window = has_window(head) ? " window" : "";

	buf[0] = 0;
	if (format_is_part(head, opt))
		snprintf(buf, size, "acut-trimmed%s%s%s%s", opt->trimmed ? " " : "", opt->trimmed ? opt->trimmed : "", window,
			 head->bounded ? " bounded" : "");
}

/* Hands a text to `line`, unless it is empty. It must stay a line: control characters become spaces. */
static int say(int (*line)(void *ctx, const char *text, struct err *), void *ctx, char *text, struct err *err)
{
	for (char *at = text; *at; at++)
		if ((unsigned char)*at < ' ' || *at == 0x7f)
			*at = ' ';
	return *text ? line(ctx, text, err) : 0;
}

int format_comment_head(const struct acut_mesh_head *head, const struct format_options *opt,
			int (*line)(void *ctx, const char *text, struct err *), void *ctx, struct err *err)
{
	char text[FORMAT_COMMENT];
	int r;

	snprintf(text, sizeof(text), "acut-lattice %s", head->lattice);
	r = say(line, ctx, text, err);
	snprintf(text, sizeof(text), "acut-crs %s", format_unit_known(head->crs));
	if (!r)
		r = say(line, ctx, text, err);
	snprintf(text, sizeof(text), "acut-geoid %s", head->geoid ? head->geoid : "");
	if (!r && head->geoid && *head->geoid)
		r = say(line, ctx, text, err);
	snprintf(text, sizeof(text), "acut-units %.64s %.64s", format_unit_known(head->unit_xy),
		 format_unit_known(opt->z_unit ? opt->z_unit : head->unit_z));
	if (!r)
		r = say(line, ctx, text, err);
	format_unit_comment(head, opt, text, sizeof(text));
	if (!r)
		r = say(line, ctx, text, err);
	format_axis_origin(head, opt, text, sizeof(text));
	if (!r)
		r = say(line, ctx, text, err);
	trimmed_text(head, opt, text, sizeof(text));
	return r ? r : say(line, ctx, text, err);
}

char *format_file_name(const struct outfile *out, const char *without, char *buf, size_t size)
{
	const char *base = outfile_base(out);
	char *dot;

	snprintf(buf, size, "%s", base ? base : without);
	dot = strrchr(buf, '.');
	if (dot && dot != buf)
		*dot = 0;
	return buf;
}
