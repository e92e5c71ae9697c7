/*
 * Actions on the row of a dataset: remove, restore, pin, unpin, and another mode, group or owner.
 *
 * The model: a removed dataset keeps its number, its folder and its row. Its name is free at once, and nobody finds the dataset
 * by it. Its jobs go on, and their meshes can be fetched. It is restored unchanged, or is deleted when its time is over
 * (dataset_expire.c).
 *
 * The loop changes the dataset in memory, then its row. The catalogue keeps the order of changes, so a name is free on the disk
 * before another dataset has it. While a row with the next manifest is on its way, an action waits: its own row would name the
 * old manifest, whose files are about to be removed. A removal waits for the manifest of a merge, too, which nobody asked for.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "dataset_priv.h"
#include "dataset_rewrite.h"
#include "log.h"
#include "mode.h"

enum { ACTION_WAITS = 1 };

struct action {
	struct action *next; /* in datasets.actions */
	struct dataset_action_params params;
	char text[DATASET_NAME_MAX + 1], as[DATASET_NAME_MAX + 1];
	struct dataset *dataset;
	/* The dataset as it was, in case the row cannot be written. */
	char name[DATASET_NAME_MAX + 1];
	int64_t removed_us;
	bool pinned;
	uint32_t uid, gid, mode;
	bool joins; /* the peer is in the new group; decided now, since the groups are those of the connection */
	dataset_action_fn *answer;
	void *token;
};

/* ---- checks ---- */

static int check_remove(const struct dataset *d, struct err *err)
{
	if (d->pinned) {
		err_set(err, ERR_CONFLICT, "the dataset %s is pinned", d->name);
		return err_add_hint(err, "acutctl dataset unpin %s lets it go", d->name);
	}
	if (!d->pushes && !d->reverts && (!d->committer || merge_commits(d)))
		return 0;
	err_set(err, ERR_BUSY, "a push into the dataset %s is open, or it is being changed", d->name);
	return err_add_hint(err, "remove it when that is over");
}

/* Finds a removed dataset by its name, or else by its number. */
static int find_removed(struct datasets *ds, const struct dataset_action_params *p, struct dataset **ret, struct err *err)
{
	char text[80], ids[120] = "";
	struct dataset *d, *found = NULL;
	unsigned n = 0;

	for (d = ds->first; d; d = d->next)
		if (dataset_restorable(d, &p->peer) && !strcmp(d->name, p->name)) {
			found = d;
			snprintf(text, sizeof text, "%s%llu", n++ ? ", " : "", (unsigned long long)d->id);
			if (strlen(ids) + strlen(text) < sizeof ids)
				strcat(ids, text);
		}
	for (d = ds->first; !n && p->id && d; d = d->next)
		if (dataset_restorable(d, &p->peer) && d->id == p->id)
			found = d;
	if (n > 1) {
		err_set(err, ERR_USAGE, "%u datasets were called %s: numbers %s", n, p->name, ids);
		return err_add_hint(err, "acutctl datasets --removed shows them; restore one by its number");
	}
	if (!found)
		return dataset_not_found(p->name, true, err);
	*ret = found;
	return 0;
}

static int check_name(struct datasets *ds, const char *name, const struct peer *peer, struct err *err)
{
	int r = dataset_name_check(name, err);

	if (r || !dataset_find(ds, name, peer))
		return r;
	err_set(err, ERR_CONFLICT, "there is a dataset %s already", name);
	return err_add_hint(err, "restore it under another name, with --as");
}

/* As with files, an owner can only give a group that he is in. */
static int check_group(const struct dataset *d, const struct dataset_action_params *p, const struct action *a, struct err *err)
{
	if (p->action != DATASET_CHGRP || rights_admin(&p->peer) || a->joins)
		return 0;
	err_set(err, ERR_PERM, "you are not in the group with id %u", p->gid);
	return err_add_hint(err, "give the dataset %s a group that you are in, or ask an administrator", d->name);
}

static int action_check(struct datasets *ds, const struct dataset_action_params *p, struct dataset **ret, uint32_t *ret_mode,
			const struct action *a, struct err *err)
{
	bool restores = p->action == DATASET_RESTORE;
	struct dataset *d = NULL;
	int r = 0;

	if (restores) {
		datasets_expire(ds);
		r = find_removed(ds, p, &d, err);
	} else {
		d = dataset_find(ds, p->name, &p->peer);
		if (!d || d->onestep)
			r = dataset_not_found(p->name, false, err);
	}
	if (!r)
		r = dataset_rights(d, &p->peer, p->action == DATASET_CHOWN ? RIGHT_CHOWN : RIGHT_OWN, err);
	if (!r && restores)
		r = check_name(ds, *p->as ? p->as : d->name, &p->peer, err);
	if (!r && p->action == DATASET_REMOVE)
		r = check_remove(d, err);
	if (!r && p->action == DATASET_CHMOD)
		r = mode_parse(p->mode, d->mode, 0, ret_mode, err);
	if (!r)
		r = check_group(d, p, a, err);
	*ret = d;
	return r;
}

static void action_set(struct dataset *d, const struct dataset_action_params *p, uint32_t mode)
{
	switch (p->action) {
	case DATASET_RESTORE:
		if (*p->as)
			snprintf(d->name, sizeof d->name, "%s", p->as);
		d->removed_us = 0;
		break;
	case DATASET_REMOVE:
		d->removed_us = clock_real_us();
		break;
	case DATASET_PIN:
	case DATASET_UNPIN:
		d->pinned = p->action == DATASET_PIN;
		break;
	case DATASET_CHMOD:
		d->mode = mode;
		break;
	case DATASET_CHGRP:
		d->gid = p->gid;
		break;
	case DATASET_CHOWN:
		d->uid = p->uid;
		break;
	}
}

/* ACTION_WAITS: a row of the dataset is on its way, or the manifest of a merge. */
static int action_apply(struct datasets *ds, const struct dataset_action_params *p, struct action *a, struct err *err)
{
	struct dataset *d;
	uint32_t mode = 0;
	int r = action_check(ds, p, &d, &mode, a, err);

	if (r)
		return r;
	if (d->rows_queued || (d->committer && p->action == DATASET_REMOVE))
		return ACTION_WAITS;
	a->dataset = dataset_hold(d);
	memcpy(a->name, d->name, sizeof a->name);
	a->removed_us = d->removed_us;
	a->pinned = d->pinned;
	a->uid = d->uid;
	a->gid = d->gid;
	a->mode = d->mode;
	action_set(d, p, mode);
	return 0;
}

static void action_event(const struct action *a)
{
	const struct dataset *d = a->dataset;
	const struct log_about about = {
		.dataset = d->name, .generation = d->generation, ABOUT_USER(a->params.peer.uid), .pid = a->params.peer.pid};
	char mode[MODE_TEXT_SIZE];

	if (a->params.action == DATASET_REMOVE)
		log_event(LOG_EVENT_DATASET_REMOVED, &about, "the dataset %s was removed", d->name);
	else if (a->params.action == DATASET_RESTORE)
		log_event(LOG_EVENT_DATASET_RESTORED, &about, "the dataset %s was restored", d->name);
	else if (a->params.action == DATASET_PIN || a->params.action == DATASET_UNPIN)
		log_event(LOG_EVENT_DATASET_CHANGED, &about, "the dataset %s was %s", d->name, d->pinned ? "pinned" : "unpinned");
	else
		log_event(LOG_EVENT_DATASET_CHANGED, &about, "the dataset %s has owner %u, group %d, mode %s", d->name, d->uid,
			  (int)d->gid, mode_text(d->mode, mode));
}

static void action_finish(struct action *a, const struct err *why)
{
	struct dataset *d = a->dataset;
	struct datasets *ds = d->datasets;

	if (why) {
		memcpy(d->name, a->name, sizeof d->name);
		d->removed_us = a->removed_us;
		d->pinned = a->pinned;
		d->uid = a->uid;
		d->gid = a->gid;
		d->mode = a->mode;
	} else {
		action_event(a);
	}
	datasets_count(ds); /* the owner may have changed */
	a->answer(a->token, why, why ? NULL : d);
	dataset_release(d);
	uncharge(ds->core, sizeof *a);
	free(a);
}

static void row_written(void *ctx, int r, const struct err *why)
{
	action_finish(ctx, r ? why : NULL);
}

/* Queues the action behind those that wait already. */
static void wait_for_row(struct datasets *ds, struct action *a, const struct dataset_action_params *p)
{
	struct action **at;

	/* A longer name cannot be that of a dataset. */
	snprintf(a->text, sizeof a->text, "%s", p->name);
	snprintf(a->as, sizeof a->as, "%s", p->mode ? p->mode : p->as);
	a->params = *p;
	a->params.peer = rights_without_groups(&p->peer);
	a->params.name = a->text;
	a->params.as = p->mode ? "" : a->as;
	a->params.mode = p->mode ? a->as : NULL;
	for (at = &ds->actions; *at; at = &(*at)->next)
		;
	*at = a;
	a->next = NULL;
}

/* Takes `a`. */
static void action_run(struct datasets *ds, struct action *a, const struct dataset_action_params *p)
{
	struct catalogue_dataset row;
	struct err err = ERR_INIT;
	int r = action_apply(ds, p, a, &err);

	if (r == ACTION_WAITS) {
		wait_for_row(ds, a, p);
	} else if (r) {
		a->answer(a->token, &err, NULL);
		uncharge(ds->core, sizeof *a);
		free(a);
	} else {
		a->params.action = p->action;
		a->params.peer = rights_without_groups(&p->peer);
		dataset_row(a->dataset, &row);
		if (catalogue_put_dataset(ds->core->p.catalogue, &row, 0, row_written, a, &err))
			action_finish(a, &err);
	}
}

void dataset_actions_settle(struct datasets *ds)
{
	struct action *waiting = ds->actions, *a;

	ds->actions = NULL;
	while ((a = waiting)) {
		char text[sizeof a->text], as[sizeof a->as];
		struct dataset_action_params p = a->params;

		waiting = a->next;
		memcpy(text, a->text, sizeof text);
		memcpy(as, a->as, sizeof as);
		p.name = text;
		p.as = p.mode ? "" : as;
		p.mode = p.mode ? as : NULL;
		action_run(ds, a, &p);
	}
}

void dataset_act(struct datasets *ds, const struct dataset_action_params *p, dataset_action_fn *answer, void *token)
{
	struct action *a = NULL;
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (p->mode && strlen(p->mode) >= sizeof a->as)
		err_set(&err, ERR_USAGE, "\"%.60s...\" is not a mode", p->mode);
	else if (!charge(ds->core, sizeof *a, "a request", &err) && !(a = calloc(1, sizeof *a))) {
		uncharge(ds->core, sizeof *a);
		err_set(&err, ERR_NOMEM, "no memory for a request");
	}
	if (!a) {
		answer(token, &err, NULL);
		return;
	}
	a->answer = answer;
	a->token = token;
	a->joins = rights_in_group(&p->peer, p->gid);
	action_run(ds, a, p);
}
