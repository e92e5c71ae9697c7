/* dataset show NAME: what is in one dataset; and the table of the verbs of dataset. */
#include <math.h>
#include <string.h>

#include "ctl.h"
#include "ctl_dataset.h"
#include "ctl_names.h"
#include "term.h"
#include "mode.h"
#include "parse.h"

void ctl_dataset_json(const struct console *c, const struct acut_dataset *d)
{
	struct term_json j = console_json(c);
	char mode[8];

	term_json_text(&j, "name", d->name);
	term_json_u64(&j, "generation", d->generation);
	term_json_u64(&j, "points", d->points);
	term_json_u64(&j, "bytes", d->bytes);
	term_json_u64(&j, "files", d->files);
	term_json_u64(&j, "uid", d->uid);
	term_json_text(&j, "owner", ctl_user_name(d->uid));
	if (d->gid == ACUT_NO_GROUP)
		term_json_null(&j, "gid");
	else
		term_json_u64(&j, "gid", d->gid);
	term_json_text(&j, "group", ctl_group_name(d->gid));
	snprintf(mode, sizeof(mode), "%04o", d->mode);
	term_json_text(&j, "mode", mode);
	term_json_time(&j, "created", d->created_us);
	term_json_time(&j, "pushed", d->pushed_us);
	ctl_report_lattice(&j, d->lattice);
	ctl_report_units(&j, d->crs, d->unit_xy, d->unit_z);
	ctl_report_system(&j, d);
	term_json_numbers(&j, "min", d->min, 3);
	term_json_numbers(&j, "max", d->max, 3);
	term_json_known(&j, "pending", d->pending);
	term_json_u64(&j, "oldest", d->oldest ? d->oldest : d->generation ? 1 : 0);
	term_json_bool(&j, "pinned", d->pinned);
	term_json_u64(&j, "id", d->id);
	term_json_known_u64(&j, "segments", d->segments);
	term_json_bool(&j, "merging", d->merging);
	term_json_time(&j, "removed", d->removed_us);
	term_json_time(&j, "restorable_until", d->until_us);
	if (d->line_files) {
		term_json_open(&j, "lines", '{');
		term_json_u64(&j, "files", d->line_files);
		ctl_report_lines_keys(&j, d->features, d->lines, d->vertices);
		term_json_close(&j, '}');
	} else {
		term_json_null(&j, "lines");
	}
	term_json_end(&j);
}

static void show_text(FILE *out, const struct acut_dataset *d)
{
	char a[CTL_NAME_SIZE], b[CTL_NAME_SIZE], mode[MODE_TEXT_SIZE], lines[160];

	term_field(out, "dataset", "%s", d->name);
	term_field(out, "generation", "%llu, of %u file%s", (unsigned long long)d->generation, d->files,
		   d->files == 1 ? "" : "s");
	term_field(out, "points", "%s, %s", term_count(d->points, a), parse_size_text(d->bytes, b));
	if (d->line_files)
		term_field(out, "lines", "%u file%s of lines, %s", d->line_files, d->line_files == 1 ? "" : "s",
			   ctl_report_lines_text(d->features, d->lines, d->vertices, lines, sizeof lines));
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
	if (*d->geoid)
		term_field(out, "geoid", "%s", d->geoid);
	if (*d->wkt)
		term_field(out, "wkt", "%s", d->wkt);
	if (isfinite(d->min[0]) && isfinite(d->min[1]))
		term_field(out, "box", "%.15g %.15g to %.15g %.15g", d->min[0], d->min[1], d->max[0], d->max[1]);
	if (d->pinned)
		term_field(out, "pinned", "it is neither removed nor pruned");
	if (d->pending[0])
		term_field(out, "pending", "%s", d->pending);
}

static int show(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct acut_dataset d;
	int status = session_connect(session);

	if (status)
		return status;
	if (acut_dataset_at(session->acut, ctl->line.word[0], ctl->opt.generation, &d))
		return session_error_acut(session);
	if (session->console.json)
		ctl_dataset_json(&session->console, &d);
	else
		show_text(session->console.report, &d);
	return SESSION_DONE;
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

/* How to restore it: by its number if several datasets of its name were removed. */
static void print_removed(struct session *session, const char *name, uint64_t id, int64_t until_us)
{
	struct named named = {.name = name};
	char until[32], number[32];

	snprintf(number, sizeof(number), "%llu", (unsigned long long)id);
	if (acut_datasets_removed(session->acut, count_name, &named))
		named.n = 0;
	console_line(&session->console, "%s is removed; acutctl dataset restore %s brings it back until %s", name,
		     named.n > 1 ? number : name, term_time(until_us, until));
}

/* rm, restore, pin, unpin: by the daemon's name of it. */
static int change(struct program *ctl, const char *verb)
{
	struct session *session = &ctl->session;
	const char *name = ctl->line.word[0];
	struct acut_dataset d;
	uint64_t id = 0;
	int status = session_connect(session);

	if (!parse_u64(name, &id))
		id = 0;
	if (!status && acut_dataset_change(session->acut, verb, name, id, ctl->opt.as, &d))
		status = session_error_acut(session);
	if (status)
		return status;
	if (session->console.json)
		ctl_dataset_json(&session->console, &d);
	else if (d.removed_us)
		print_removed(session, name, d.id, d.until_us);
	else if (!strcmp(verb, "restore"))
		console_line(&session->console, "%s is there again", d.name);
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

static int changed(struct session *session, int r, const struct acut_dataset *d)
{
	if (r)
		return session_error_acut(session);
	if (session->console.json)
		ctl_dataset_json(&session->console, d);
	return SESSION_DONE;
}

static int chmod_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct acut_dataset d;
	struct err err = ERR_INIT;
	uint32_t mode;
	int status;

	if (mode_parse(ctl->line.word[0], 0, 0, &mode, &err))
		return session_error(session, &err);
	status = session_connect(session);
	return status ? status :
			changed(session, acut_dataset_chmod(session->acut, ctl->line.word[1], ctl->line.word[0], &d), &d);
}

static int chgrp_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct acut_dataset d;
	struct err err = ERR_INIT;
	uint32_t gid;
	int status;

	if (ctl_group_find(ctl->line.word[0], &gid, &err))
		return session_error(session, &err);
	status = session_connect(session);
	return status ? status : changed(session, acut_dataset_chgrp(session->acut, ctl->line.word[1], gid, &d), &d);
}

static int chown_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct acut_dataset d;
	struct err err = ERR_INIT;
	uint32_t uid;
	int status;

	if (ctl_user_find(ctl->line.word[0], &uid, &err))
		return session_error(session, &err);
	status = session_connect(session);
	return status ? status : changed(session, acut_dataset_chown(session->acut, ctl->line.word[1], uid, &d), &d);
}

const struct cli_verb ctl_dataset_verbs[] = {
	{"chgrp", "chgrp GROUP DATASET", "give it to another group that you are in", 2, 2, NULL, chgrp_run},
	{"chmod", "chmod MODE DATASET", "rights to read it and to push into it: 640, u=rw,g=r,o=, g+w", 2, 2, NULL, chmod_run},
	{"chown", "chown USER DATASET", "give it to another owner, as an administrator", 2, 2, NULL, chown_run},
	{"create", "create NAME", "make a dataset before its first push", 1, 1, "scale crs mode", ctl_dataset_create},
	{"discard", "discard DATASET", "remove what your interrupted pushes into it left", 1, 1, "all", ctl_dataset_discard},
	{"export", "export DATASET DIR", "copy one dataset with all its generations into a folder", 2, 2, "copy",
	 ctl_dataset_export},
	{"import", "import DIR [NAME]", "make a new dataset from an exported one", 1, 2, NULL, ctl_dataset_import},
	{"log", "log DATASET", "changes of each generation", 1, 1, "files", ctl_dataset_log},
	{"pin", "pin DATASET", "protect it from removal and pruning", 1, 1, NULL, pin},
	{"prune", "prune DATASET", "remove old generations and the points that only they have", 1, 1, "keep before",
	 ctl_dataset_prune},
	{"restore", "restore REMOVED", "bring a removed dataset back, by name or number", 1, 1, "as", restore},
	{"revert", "revert DATASET [GENERATION]", "undo a generation (the newest)", 1, 2, NULL, ctl_dataset_revert},
	{"rm", "rm DATASET", "remove it; it can be restored for seven days", 1, 1, NULL, rm},
	{"show", "show DATASET", "print its content", 1, 1, "at generation", show},
	{"unpin", "unpin DATASET", "allow its removal and pruning again", 1, 1, NULL, unpin},
	{0},
};
