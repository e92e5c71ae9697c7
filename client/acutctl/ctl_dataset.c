/* dataset show NAME: what is in one dataset; and the table of the verbs of dataset. */
#include <math.h>
#include <string.h>

#include "ctl.h"
#include "ctl_dataset.h"
#include "ctl_names.h"
#include "term.h"
#include "mode.h"
#include "parse.h"

void ctl_dataset_json(struct program *ctl, const struct acut_dataset *d)
{
	struct term_json j = {.out = ctl->session.console.report, .list = ctl->session.console.list};
	char mode[8];

	term_json_open(&j, NULL, '{');
	term_json_text(&j, "name", d->name);
	term_json_u64(&j, "generation", d->generation);
	term_json_u64(&j, "points", d->points);
	term_json_u64(&j, "bytes", d->bytes);
	term_json_u64(&j, "files", d->files);
	term_json_u64(&j, "uid", d->uid);
	term_json_text(&j, "owner", ctl_user_name(d->uid));
	if (d->gid == ACUT_NO_GROUP)
		term_json_literal(&j, "gid", "null");
	else
		term_json_u64(&j, "gid", d->gid);
	term_json_text(&j, "group", ctl_group_name(d->gid));
	snprintf(mode, sizeof(mode), "%04o", d->mode);
	term_json_text(&j, "mode", mode);
	term_json_time(&j, "created", d->created_us);
	term_json_time(&j, "pushed", d->pushed_us);
	ctl_job_lattice(&j, d->lattice);
	ctl_job_units(&j, d->crs, d->unit_xy, d->unit_z);
	term_json_open(&j, "min", '[');
	for (int i = 0; i < 3; i++)
		term_json_number(&j, NULL, d->min[i]);
	term_json_close(&j, ']');
	term_json_open(&j, "max", '[');
	for (int i = 0; i < 3; i++)
		term_json_number(&j, NULL, d->max[i]);
	term_json_close(&j, ']');
	term_json_known(&j, "pending", d->pending);
	term_json_u64(&j, "oldest", d->oldest ? d->oldest : d->generation ? 1 : 0);
	term_json_bool(&j, "pinned", d->pinned);
	term_json_u64(&j, "id", d->id);
	if (d->segments)
		term_json_u64(&j, "segments", d->segments);
	else
		term_json_known(&j, "segments", "");
	term_json_bool(&j, "merging", d->merging);
	term_json_time(&j, "removed", d->removed_us);
	term_json_time(&j, "restorable_until", d->until_us);
	term_json_close(&j, '}');
	term_json_line(&j);
}

static void show_text(struct program *ctl, const struct acut_dataset *d)
{
	FILE *out = ctl->session.console.report;
	char a[CTL_NAME_SIZE], b[CTL_NAME_SIZE], mode[MODE_TEXT_SIZE];

	term_field(out, "dataset", "%s", d->name);
	term_field(out, "generation", "%llu, of %u file%s", (unsigned long long)d->generation, d->files,
		   d->files == 1 ? "" : "s");
	term_field(out, "points", "%s, %s", term_count(d->points, a), parse_size_text(d->bytes, b));
	if (d->segments)
		term_field(out, "segments", "%u%s", d->segments, d->merging ? ", some of them become one now" : "");
	if (d->oldest > 1)
		term_field(out, "oldest", "generation %llu", (unsigned long long)d->oldest);
	term_field(out, "owner", "%s, group %s, mode %s (%04o)", ctl_user_text(d->uid, a), ctl_group_text(d->gid, b),
		   mode_text(d->mode, mode), d->mode);
	term_field(out, "created", "%s", term_time(d->created_us, a));
	term_field(out, "pushed", "%s", term_time(d->pushed_us, b));
	term_field(out, "lattice", "%s", d->lattice);
	term_field(out, "crs", "%s", d->crs);
	term_field(out, "units", "%s, heights %s", d->unit_xy, d->unit_z);
	if (isfinite(d->min[0]) && isfinite(d->min[1]))
		term_field(out, "box", "%.15g %.15g to %.15g %.15g", d->min[0], d->min[1], d->max[0], d->max[1]);
	if (d->pinned)
		term_field(out, "pinned", "it is neither removed nor pruned");
	if (d->pending[0])
		term_field(out, "pending", "%s", d->pending);
}

static int show(struct program *ctl)
{
	struct acut_dataset d;
	int status = session_connect(&ctl->session);

	if (status)
		return status;
	if (acut_dataset_at(ctl->session.acut, ctl->line.word[0], ctl->args.generation, &d))
		return session_error_acut(&ctl->session);
	if (ctl->session.console.json)
		ctl_dataset_json(ctl, &d);
	else
		show_text(ctl, &d);
	return SESSION_DONE;
}

static int create(struct program *ctl)
{
	return ctl_dataset_create(ctl, ctl->line.word[0]);
}

static int log_run(struct program *ctl)
{
	return ctl_dataset_log(ctl, ctl->line.word[0]);
}

static int prune(struct program *ctl)
{
	return ctl_dataset_prune(ctl, ctl->line.word[0]);
}

static int revert(struct program *ctl)
{
	return ctl_dataset_revert(ctl, ctl->line.word[0], ctl->line.nword > 1 ? ctl->line.word[1] : NULL);
}

struct named {
	const char *name;
	unsigned n;
};

static void count_name(void *ctx, const struct acut_dataset *d)
{
	struct named *named = ctx;

	named->n += !strcmp(d->name, named->name);
}

/* How to get it back: where several of its name were removed, that does not say which. */
static void say_removed(struct program *ctl, const char *name, uint64_t id, int64_t until_us)
{
	struct named named = {.name = name};
	char until[32], number[32];

	snprintf(number, sizeof(number), "%llu", (unsigned long long)id);
	if (acut_datasets_removed(ctl->session.acut, count_name, &named))
		named.n = 0;
	console_line(&ctl->session.console, "%s is removed; acutctl dataset restore %s brings it back until %s", name,
		     named.n > 1 ? number : name, term_time(until_us, until));
}

/* rm, restore, pin, unpin: the daemon's word for it, and what came of it. */
static int change(struct program *ctl, const char *verb)
{
	const char *name = ctl->line.word[0];
	struct acut_dataset d;
	uint64_t id = 0;
	int status = session_connect(&ctl->session);

	if (!parse_u64(name, &id))
		id = 0;
	if (!status && acut_dataset_change(ctl->session.acut, verb, name, id, ctl->args.as, &d))
		status = session_error_acut(&ctl->session);
	if (status)
		return status;
	if (ctl->session.console.json)
		ctl_dataset_json(ctl, &d);
	else if (d.removed_us)
		say_removed(ctl, name, d.id, d.until_us);
	else if (!strcmp(verb, "restore"))
		console_line(&ctl->session.console, "%s is there again", d.name);
	return SESSION_DONE;
}

static int rm(struct program *ctl)
{
	return change(ctl, "remove");
}

static int restore(struct program *ctl)
{
	return change(ctl, "restore");
}

static int pin(struct program *ctl)
{
	return change(ctl, "pin");
}

static int unpin(struct program *ctl)
{
	return change(ctl, "unpin");
}

static int changed(struct program *ctl, int r, const struct acut_dataset *d)
{
	if (r)
		return session_error_acut(&ctl->session);
	if (ctl->session.console.json)
		ctl_dataset_json(ctl, d);
	return SESSION_DONE;
}

static int chmod_run(struct program *ctl)
{
	struct acut_dataset d;
	struct err err = ERR_INIT;
	uint32_t mode;
	int status;

	if (mode_parse(ctl->line.word[0], 0, 0, &mode, &err))
		return session_error(&ctl->session, &err);
	status = session_connect(&ctl->session);
	return status ? status :
			changed(ctl, acut_dataset_chmod(ctl->session.acut, ctl->line.word[1], ctl->line.word[0], &d), &d);
}

static int chgrp_run(struct program *ctl)
{
	struct acut_dataset d;
	struct err err = ERR_INIT;
	uint32_t gid;
	int status;

	if (ctl_group_find(ctl->line.word[0], &gid, &err))
		return session_error(&ctl->session, &err);
	status = session_connect(&ctl->session);
	return status ? status : changed(ctl, acut_dataset_chgrp(ctl->session.acut, ctl->line.word[1], gid, &d), &d);
}

static int chown_run(struct program *ctl)
{
	struct acut_dataset d;
	struct err err = ERR_INIT;
	uint32_t uid;
	int status;

	if (ctl_user_find(ctl->line.word[0], &uid, &err))
		return session_error(&ctl->session, &err);
	status = session_connect(&ctl->session);
	return status ? status : changed(ctl, acut_dataset_chown(ctl->session.acut, ctl->line.word[1], uid, &d), &d);
}

static int export(struct program *ctl)
{
	return ctl_dataset_export(ctl, ctl->line.word[0], ctl->line.word[1]);
}

static int import(struct program *ctl)
{
	return ctl_dataset_import(ctl, ctl->line.word[0], ctl->line.nword > 1 ? ctl->line.word[1] : NULL);
}

const struct cli_verb ctl_dataset_verbs[] = {
	{"chgrp", "chgrp GROUP DATASET", "give it to another group that you are in", 2, 2, NULL, chgrp_run},
	{"chmod", "chmod MODE DATASET", "who may read it and push into it: 640, u=rw,g=r,o=, g+w", 2, 2, NULL, chmod_run},
	{"chown", "chown USER DATASET", "give it to another owner, as an administrator", 2, 2, NULL, chown_run},
	{"create", "create NAME", "a dataset before its first push", 1, 1, "scale crs mode", create},
	{"export", "export DATASET DIR", "one dataset with all its generations into a folder", 2, 2, "copy", export},
	{"import", "import DIR [NAME]", "a new dataset of an exported one", 1, 2, NULL, import},
	{"log", "log DATASET", "what each generation did", 1, 1, "files", log_run},
	{"pin", "pin DATASET", "it is neither removed nor pruned from now on", 1, 1, NULL, pin},
	{"prune", "prune DATASET", "old generations go, and the points that only they have", 1, 1, "keep before", prune},
	{"restore", "restore REMOVED", "bring a removed dataset back, by name or number", 1, 1, "as", restore},
	{"revert", "revert DATASET [GENERATION]", "undo what a generation did, unless told another one the newest", 1, 2, NULL,
	 revert},
	{"rm", "rm DATASET", "remove it; it can be restored for seven days", 1, 1, NULL, rm},
	{"show", "show DATASET", "what is in it", 1, 1, "at generation", show},
	{"unpin", "unpin DATASET", "it can be removed and pruned again", 1, 1, NULL, unpin},
	{0},
};
