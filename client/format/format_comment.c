/*
 * Comments of text headers that describe the numbers, a line each whatever the CRS text contains.
 */
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "format_axis.h"
#include "outfile.h"

/* A line must stay a line: control characters become spaces. */
static void make_line(char *text)
{
	for (; *text; text++)
		if ((unsigned char)*text < ' ' || *text == 0x7f)
			*text = ' ';
}

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

int format_comment_head(const struct acut_mesh_head *head, const struct format_options *opt,
			int (*line)(void *ctx, const char *text, struct err *), void *ctx, struct err *err)
{
	char text[FORMAT_COMMENT];
	int r;

	snprintf(text, sizeof(text), "acut-lattice %s", head->lattice);
	make_line(text);
	r = line(ctx, text, err);
	if (!r) {
		snprintf(text, sizeof(text), "acut-crs %s", head->crs && *head->crs ? head->crs : "unknown");
		make_line(text);
		r = line(ctx, text, err);
	}
	if (!r && head->geoid && *head->geoid) {
		snprintf(text, sizeof(text), "acut-geoid %s", head->geoid);
		make_line(text);
		r = line(ctx, text, err);
	}
	if (!r) {
		snprintf(text, sizeof(text), "acut-units %.64s %.64s",
			 head->unit_xy && *head->unit_xy ? head->unit_xy : "unknown",
			 opt->z_unit                   ? opt->z_unit :
			 head->unit_z && *head->unit_z ? head->unit_z :
							 "unknown");
		make_line(text);
		r = line(ctx, text, err);
	}
	format_unit_comment(head, opt, text, sizeof(text));
	make_line(text);
	if (!r && text[0])
		r = line(ctx, text, err);
	format_axis_origin(head, opt, text, sizeof(text));
	if (!r && text[0])
		r = line(ctx, text, err);
	trimmed_text(head, opt, text, sizeof(text));
	return r || !text[0] ? r : line(ctx, text, err);
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
