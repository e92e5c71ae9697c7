/* geoid add FILE, geoid list, geoid rm NAME: the geoid grids that the daemon keeps for --geoid. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "ctl.h"
#include "parse.h"

static void geoid_json(struct ctl *ctl, const struct acut_geoid *g)
{
	struct ctl_json j = { .out = ctl->report };

	ctl_json_open(&j, NULL, '{');
	ctl_json_text(&j, "name", g->name);
	ctl_json_text(&j, "hash", g->hash);
	ctl_json_known(&j, "description", g->description);
	ctl_json_known(&j, "date", g->date);
	ctl_json_u64(&j, "width", g->width);
	ctl_json_u64(&j, "height", g->height);
	ctl_json_u64(&j, "bytes", g->bytes);
	ctl_json_number(&j, "min", g->min);
	ctl_json_number(&j, "max", g->max);
	ctl_json_number(&j, "rms_error", g->rms_error);
	ctl_json_number(&j, "max_error", g->max_error);
	ctl_json_u64(&j, "uid", g->uid);
	ctl_json_close(&j, '}');
	ctl_json_line(&j);
}

static void show(void *ctx, const struct acut_geoid *g)
{
	struct ctl *ctl = ctx;
	char size[32];

	if (ctl->args.json) {
		geoid_json(ctl, g);
		return;
	}
	fprintf(ctl->report, "%-16s %u x %u, %s, %.3f to %.3f m", g->name, g->width, g->height,
		parse_size_text(g->bytes, size), g->min, g->max);
	if (isfinite(g->rms_error))
		fprintf(ctl->report, ", rms error %.3g m", g->rms_error);
	fprintf(ctl->report, "\n  %s%s%s, hash %s\n", *g->description ? g->description : "no description",
		*g->date ? ", " : "", g->date, g->hash);
}

/* "folder/egm96-5.pgm": "egm96-5". */
static void name_of(const char *path, char *ret, size_t size)
{
	const char *slash = strrchr(path, '/'), *base = slash ? slash + 1 : path;
	size_t n = strlen(base);

	if (n > 4 && !strcmp(base + n - 4, ".pgm"))
		n -= 4;
	snprintf(ret, size, "%.*s", (int)n, base);
}

int ctl_geoid_file(struct ctl *ctl, const char *path, const char *name, char ret_name[128],
		   const struct acut_geoid **ret)
{
	struct ctl_input in = { .name = (char *)path, .fd = -1 };
	struct err err = ERR_INIT;
	int fd, r;

	if (name)
		snprintf(ret_name, 128, "%s", name);
	else
		name_of(path, ret_name, 128);
	if (ctl_input_open(&in, &fd, &err))
		return ctl_error(ctl, &err);
	r = acut_geoid_add(ctl->acut, fd, ret_name, path, ret);
	close(fd);
	return r ? ctl_error_acut(ctl) : 0;
}

static int usage(struct ctl *ctl, const char *message)
{
	struct err err = ERR_INIT;

	err_set(&err, ERR_USAGE, "%s", message);
	err_add_hint(&err, "acutctl geoid add FILE [--name NAME], geoid list, geoid rm NAME");
	return ctl_error(ctl, &err);
}

static int add(struct ctl *ctl, const char *path)
{
	const struct acut_geoid *g;
	char name[128];
	int status = ctl_geoid_file(ctl, path, ctl->args.name, name, &g);

	if (!status)
		show(ctl, g);
	return status;
}

int ctl_geoid_run(struct ctl *ctl)
{
	char **word = ctl->args.word;
	unsigned n = ctl->args.nword;
	bool adds = !strcmp(word[0], "add"), lists = !strcmp(word[0], "list"), removes = !strcmp(word[0], "rm");
	int status;

	if (!adds && !lists && !removes)
		return usage(ctl, "there is no such command geoid");
	if (n != (lists ? 1u : 2u))
		return usage(ctl, lists ? "geoid list takes nothing" : adds ? "geoid add takes one file" : "geoid rm takes one name");
	if (ctl->args.name && !adds)
		return usage(ctl, "--name belongs to geoid add");
	status = ctl_connect(ctl);
	if (status)
		return status;
	if (adds)
		return add(ctl, word[1]);
	if (lists ? acut_geoids(ctl->acut, show, ctl) : acut_geoid_remove(ctl->acut, word[1]))
		return ctl_error_acut(ctl);
	return CTL_DONE;
}
