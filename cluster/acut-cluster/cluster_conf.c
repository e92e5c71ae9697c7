/* cluster.conf: the settings of an installation, which options override. A setting is the text of the option that it stands for.
 */
#include <stdlib.h>
#include <string.h>

#include "cluster.h"
#include "conf.h"
#include "parse.h"

enum { PATH = 512 };
enum kind { TEXT, TIME, SIZE, COUNT, SCHEDULER };

static const struct {
	const char *name;
	enum kind kind;
} settings[] = {
	[CLUSTER_SCHEDULER_NAME] = {"scheduler", SCHEDULER},
	[CLUSTER_PARTITION] = {"partition", TEXT},
	[CLUSTER_ACCOUNT] = {"account", TEXT},
	[CLUSTER_QOS] = {"qos", TEXT},
	[CLUSTER_TIME] = {"time", TIME},
	[CLUSTER_TASK_SECONDS] = {"task-seconds", TIME},
	[CLUSTER_TASK_MEMORY] = {"task-memory", SIZE},
	[CLUSTER_MAX_TASKS] = {"max-tasks", COUNT},
	[CLUSTER_ATTEMPTS] = {"attempts", COUNT},
	[CLUSTER_SCRATCH] = {"scratch", TEXT},
	[CLUSTER_SBATCH] = {"sbatch", TEXT},
};

struct reading {
	struct program *program;
	struct cluster_settings *to;
	struct err first;
};

const char *cluster_setting_name(size_t id)
{
	return settings[id].name;
}

static bool in_file(size_t id)
{
	return true;
}

static const char *wanted(enum kind kind, const char *value)
{
	double seconds;
	uint64_t n;

	switch (kind) {
	case TIME:
		return parse_seconds(value, &seconds) && seconds > 0 ? NULL : "a time above 0, as 90s, 5m or 2h,";
	case SIZE:
		return parse_size(value, &n) && n ? NULL : "a size as 2G";
	case COUNT:
		return parse_u64(value, &n) && n ? NULL : "a number above 0";
	case SCHEDULER:
		return dispatch_is_scheduler(value) ? NULL : "slurm, local or script";
	default:
		return NULL;
	}
}

static int set(void *ctx, size_t id, const char *value, const char *path, unsigned line, struct err *err)
{
	struct cluster_settings *to = ((struct reading *)ctx)->to;
	const char *other = *value ? wanted(settings[id].kind, value) : NULL;
	char *copy = NULL;

	(void)path;
	(void)line;
	if (other)
		return err_set(err, ERR_USAGE, "%s = %.100s: %s is wanted", settings[id].name, value, other);
	if (*value && !(copy = strdup(value)))
		return err_set(err, ERR_NOMEM, "no memory for a setting");
	free(to->text[id]);
	to->text[id] = copy;
	return 0;
}

static void report(void *ctx, bool warning, const struct err *err)
{
	struct reading *r = ctx;
	char text[1600];

	if (warning)
		console_warn(&r->program->session.console, "%s", err_format(err, text, sizeof text));
	else if (!r->first.code)
		r->first = *err;
}

static struct conf conf_of(struct reading *r)
{
	return (struct conf){.n = CLUSTER_SETTINGS,
			     .name = cluster_setting_name,
			     .in_file = in_file,
			     .set = set,
			     .report = report,
			     .ctx = r,
			     .manual = "cluster.conf(5) lists the settings",
			     .reader = "all users of the cluster must be able to read it"};
}

static int end(struct reading *r, struct err *err)
{
	if (!r->first.code)
		return 0;
	*err = r->first;
	cluster_settings_done(r->to);
	return -(int)err->code;
}

int cluster_settings_text(struct program *p, const char *text, size_t n, struct cluster_settings *ret, struct err *err)
{
	struct reading r = {.program = p, .to = ret, .first = ERR_INIT};
	const struct conf c = conf_of(&r);

	*ret = (struct cluster_settings){0};
	conf_text(&c, "cluster.conf", text, n);
	return end(&r, err);
}

int cluster_settings_read(struct program *p, struct cluster_settings *ret, struct err *err)
{
	const char *file = p->opt.config ? p->opt.config : ACUT_CLUSTER_CONFIG;
	struct reading r = {.program = p, .to = ret, .first = ERR_INIT};
	const struct conf c = conf_of(&r);
	char folder[PATH];

	*ret = (struct cluster_settings){0};
	if (p->opt.no_config)
		return p->opt.config ? err_set(err, ERR_USAGE, "--config and --no-config exclude each other") : 0;
	if ((size_t)snprintf(folder, sizeof folder, "%s.d", file) >= sizeof folder)
		return err_set(err, ERR_USAGE, "--config %.100s...: the path is too long", file);
	conf_file(&c, file, p->opt.config != NULL);
	conf_folder(&c, folder);
	return end(&r, err);
}

void cluster_settings_done(struct cluster_settings *s)
{
	for (int i = 0; i < CLUSTER_SETTINGS; i++)
		free(s->text[i]);
	*s = (struct cluster_settings){0};
}
