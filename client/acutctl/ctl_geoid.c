/* geoid add FILE, geoid list, geoid rm NAME: the geoid grids that the daemon keeps for --geoid. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "ctl.h"
#include "term_table.h"
#include "parse.h"

static void geoid_json(struct program *ctl, const struct acut_geoid *g)
{
	struct term_json j = {.out = ctl->session.console.report};

	term_json_open(&j, NULL, '{');
	term_json_text(&j, "name", g->name);
	term_json_text(&j, "hash", g->hash);
	term_json_known(&j, "description", g->description);
	term_json_known(&j, "date", g->date);
	term_json_u64(&j, "width", g->width);
	term_json_u64(&j, "height", g->height);
	term_json_u64(&j, "bytes", g->bytes);
	term_json_number(&j, "min", g->min);
	term_json_number(&j, "max", g->max);
	term_json_number(&j, "rms_error", g->rms_error);
	term_json_number(&j, "max_error", g->max_error);
	term_json_u64(&j, "uid", g->uid);
	term_json_close(&j, '}');
	term_json_line(&j);
}

static const struct term_column columns[] = {
	{"NAME", .shrink = true}, {"POSTS", .right = true, .spare = true},
	{"SIZE", .right = true},  {"LEAST", .right = true},
	{"MOST", .right = true},  {"RMS ERROR", .right = true, .spare = true},
	{"HASH", .spare = true},  {"DESCRIPTION", .tail = true, .spare = true},
};

struct listing {
	struct program *ctl;
	struct term_table *table;
};

static void show(void *ctx, const struct acut_geoid *g)
{
	struct listing *l = ctx;
	struct term_table *t = l->table;

	if (l->ctl->session.console.json) {
		geoid_json(l->ctl, g);
		return;
	}
	term_table_text(t, "%s", g->name);
	term_table_text(t, "%ux%u", g->width, g->height);
	term_table_size(t, g->bytes);
	term_table_text(t, "%.3f", g->min);
	term_table_text(t, "%.3f", g->max);
	if (isfinite(g->rms_error))
		term_table_text(t, "%.3g", g->rms_error);
	else
		term_table_none(t);
	term_table_text(t, "%s", g->hash);
	term_table_text(t, "%s%s%s", g->description, *g->description && *g->date ? ", " : "", g->date);
}

static struct term_table *table(struct program *ctl)
{
	return ctl->session.console.json ?
		       NULL :
		       term_table_new(ctl->session.console.report, columns, sizeof(columns) / sizeof(*columns));
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

int ctl_geoid_file(struct program *ctl, const char *path, const char *name, char ret_name[128], const struct acut_geoid **ret)
{
	struct ctl_input in = {.name = (char *)path, .fd = -1};
	struct err err = ERR_INIT;
	int fd, r;

	if (name)
		snprintf(ret_name, 128, "%s", name);
	else
		name_of(path, ret_name, 128);
	if (ctl_input_open(ctl, &in, &fd, &err))
		return session_error(&ctl->session, &err);
	r = acut_geoid_add(ctl->session.acut, fd, ret_name, path, ret);
	close(fd);
	return r ? session_error_acut(&ctl->session) : 0;
}

static int add_run(struct program *ctl)
{
	const struct acut_geoid *g;
	char name[128];
	int status = session_connect(&ctl->session);

	if (!status)
		status = ctl_geoid_file(ctl, ctl->line.word[0], ctl->args.name, name, &g);
	if (!status) {
		struct listing l = {ctl, table(ctl)};

		show(&l, g);
		term_table_free(l.table);
	}
	return status;
}

static int list_run(struct program *ctl)
{
	struct listing l = {.ctl = ctl};
	int status = session_connect(&ctl->session);

	if (status)
		return status;
	l.table = table(ctl);
	status = acut_geoids(ctl->session.acut, show, &l);
	term_table_free(l.table);
	return status ? session_error_acut(&ctl->session) : SESSION_DONE;
}

static int rm_run(struct program *ctl)
{
	int status = session_connect(&ctl->session);

	return status                                                  ? status :
	       acut_geoid_remove(ctl->session.acut, ctl->line.word[0]) ? session_error_acut(&ctl->session) :
									 SESSION_DONE;
}

const struct cli_verb ctl_geoid_verbs[] = {
	{"add", "add FILE.pgm", "keep a geoid grid with the daemon", 1, 1, "name", add_run},
	{"list", "list", "the grids that are kept", 0, 0, NULL, list_run},
	{"rm", "rm GEOID", "remove one", 1, 1, NULL, rm_run},
	{0},
};
