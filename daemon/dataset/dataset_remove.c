/*
 * Datasets that are removed, restored and pinned, and get another mode, group or owner.
 *
 * The model: a removed dataset keeps its number, its folder and its row, and its name is free at once. Nobody finds it by
 * that name any more, but the jobs that it has go on, and their meshes can be fetched. It comes back as it was, or goes
 * for good when its time is over: first its jobs forget it, then its row goes, then the folder. What still runs is waited
 * for. The loop changes the dataset and then the row; the catalogue keeps the order of its changes, so a name
 * is free on the disk before another dataset has it. While a row with the next manifest is on its way none follows: it
 * would name the last manifest again, whose files go. What is asked then waits for that one.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "dataset_priv.h"
#include "dataset_rewrite.h"
#include "log.h"
#include "mode.h"

#define KEEP_SECONDS (7 * 86400.)
#define LOOK_SECONDS 1.0
#define SURE_SECONDS 3600. /* that a clock which jumped ahead has to stay there */
#define SLACK_US INT64_C(60000000)

enum { WAITS = 1 };

struct verb {
	struct verb *next; /* of those that wait */
	struct dataset_wanted wanted;
	char text[DATASET_NAME_MAX + 1], as[DATASET_NAME_MAX + 1];
	struct dataset *dataset;
	/* As it was. */
	char name[DATASET_NAME_MAX + 1];
	int64_t removed_us;
	bool pinned;
	uint32_t uid, gid, mode;
	bool joins; /* the peer is in the new group: said by groups that he has while he asks */
	dataset_verb_fn *answer;
	void *token;
};

static double keep_seconds(const struct datasets *ds)
{
	return ds->core->p.keep_removed > 0 ? ds->core->p.keep_removed : KEEP_SECONDS;
}

int64_t dataset_until_us(const struct dataset *d)
{
	double us = keep_seconds(d->datasets) * 1e6;

	return d->removed_us ? d->removed_us + (us < 9e17 ? (int64_t)us : (int64_t)9e17) : 0;
}

/* ---- what is asked ---- */

static int no_dataset(const char *name, bool removed, struct err *err)
{
	err_set(err, ERR_NOTFOUND, "there is no %sdataset \"%.100s\"", removed ? "removed " : "", name);
	return err_add_hint(err,
			    removed ? "acutctl datasets --removed lists what can be restored" : "acutctl datasets lists them");
}

static int check_remove(const struct dataset *d, struct err *err)
{
	if (d->pinned) {
		err_set(err, ERR_CONFLICT, "the dataset %s is pinned", d->name);
		return err_add_hint(err, "acutctl dataset unpin %s lets it go", d->name);
	}
	if (!d->pushes && !d->committer)
		return 0;
	err_set(err, ERR_BUSY, "a push into the dataset %s is open, or it is being changed", d->name);
	return err_add_hint(err, "remove it when that is over");
}

static bool may_have(const struct dataset *d, const struct peer *peer)
{
	return d->removed_us && rights_allow(peer, RIGHT_OWN, d->uid, d->gid, d->mode);
}

/* By its name, or where that is no removed dataset's by its number. */
static int find_removed(struct datasets *ds, const struct dataset_wanted *w, struct dataset **ret, struct err *err)
{
	char text[80], ids[120] = "";
	struct dataset *d, *found = NULL;
	unsigned n = 0;

	for (d = ds->first; d; d = d->next)
		if (may_have(d, &w->peer) && !strcmp(d->name, w->name)) {
			found = d;
			snprintf(text, sizeof text, "%s%llu", n++ ? ", " : "", (unsigned long long)d->id);
			if (strlen(ids) + strlen(text) < sizeof ids)
				strcat(ids, text);
		}
	for (d = ds->first; !n && w->id && d; d = d->next)
		if (may_have(d, &w->peer) && d->id == w->id)
			found = d;
	if (n > 1) {
		err_set(err, ERR_USAGE, "%u datasets were called %s: numbers %s", n, w->name, ids);
		return err_add_hint(err, "acutctl datasets --removed shows them; restore one by its number");
	}
	if (!found)
		return no_dataset(w->name, true, err);
	*ret = found;
	return 0;
}

static int check_name(struct datasets *ds, const char *name, const struct peer *peer, struct err *err)
{
	if (!dataset_name_valid(name)) {
		err_set(err, ERR_USAGE, "\"%.80s\" cannot name a dataset", name);
		return err_add_hint(err, "use up to %d letters, digits, '_', '-' and '.', not starting with '.' or '-'",
				    DATASET_NAME_MAX);
	}
	if (!dataset_find(ds, name, peer))
		return 0;
	err_set(err, ERR_CONFLICT, "there is a dataset %s already", name);
	return err_add_hint(err, "restore it under another name, with --as");
}

/* Files go to no group either that their owner is not in. */
static int check_group(const struct dataset *d, const struct dataset_wanted *w, const struct verb *v, struct err *err)
{
	if (w->verb != DATASET_CHGRP || rights_admin(&w->peer) || v->joins)
		return 0;
	err_set(err, ERR_PERM, "you are not in the group with id %u", w->gid);
	return err_add_hint(err, "give the dataset %s a group that you are in, or ask an administrator", d->name);
}

static int check_wanted(struct datasets *ds, const struct dataset_wanted *w, struct dataset **ret, uint32_t *ret_mode,
			const struct verb *v, struct err *err)
{
	bool restores = w->verb == DATASET_RESTORE;
	struct dataset *d = NULL;
	int r = 0;

	if (restores) {
		datasets_expire(ds);
		r = find_removed(ds, w, &d, err);
	} else {
		d = dataset_find(ds, w->name, &w->peer);
		if (!d || d->onestep)
			r = no_dataset(w->name, false, err);
	}
	if (!r)
		r = dataset_rights(d, &w->peer, w->verb == DATASET_CHOWN ? RIGHT_CHOWN : RIGHT_OWN, err);
	if (!r && restores)
		r = check_name(ds, *w->as ? w->as : d->name, &w->peer, err);
	if (!r && w->verb == DATASET_REMOVE)
		r = check_remove(d, err);
	if (!r && w->verb == DATASET_CHMOD)
		r = mode_parse(w->mode, d->mode, 0, ret_mode, err);
	if (!r)
		r = check_group(d, w, v, err);
	*ret = d;
	return r;
}

static void set_wanted(struct dataset *d, const struct dataset_wanted *w, uint32_t mode)
{
	switch (w->verb) {
	case DATASET_RESTORE:
		if (*w->as)
			snprintf(d->name, sizeof d->name, "%s", w->as);
		d->removed_us = 0;
		break;
	case DATASET_REMOVE:
		d->removed_us = clock_real_us();
		break;
	case DATASET_PIN:
	case DATASET_UNPIN:
		d->pinned = w->verb == DATASET_PIN;
		break;
	case DATASET_CHMOD:
		d->mode = mode;
		break;
	case DATASET_CHGRP:
		d->gid = w->gid;
		break;
	case DATASET_CHOWN:
		d->uid = w->uid;
		break;
	}
}

/* WAITS: not now. */
static int change(struct datasets *ds, const struct dataset_wanted *w, struct verb *v, struct err *err)
{
	struct dataset *d;
	uint32_t mode = 0;
	int r = check_wanted(ds, w, &d, &mode, v, err);

	if (r)
		return r;
	if (d->rows)
		return WAITS;
	v->dataset = dataset_hold(d);
	memcpy(v->name, d->name, sizeof v->name);
	v->removed_us = d->removed_us;
	v->pinned = d->pinned;
	v->uid = d->uid;
	v->gid = d->gid;
	v->mode = d->mode;
	set_wanted(d, w, mode);
	return 0;
}

static void tell(const struct verb *v)
{
	const struct dataset *d = v->dataset;
	const struct log_about about = {
		.dataset = d->name, .generation = d->generation, ABOUT_USER(v->wanted.peer.uid), .pid = v->wanted.peer.pid};
	char mode[MODE_TEXT_SIZE];

	if (v->wanted.verb == DATASET_REMOVE)
		log_event(LOG_EVENT_DATASET_REMOVED, &about, "the dataset %s was removed", d->name);
	else if (v->wanted.verb == DATASET_RESTORE)
		log_event(LOG_EVENT_DATASET_RESTORED, &about, "the dataset %s was restored", d->name);
	else if (v->wanted.verb == DATASET_PIN || v->wanted.verb == DATASET_UNPIN)
		log_event(LOG_EVENT_DATASET_CHANGED, &about, "the dataset %s was %s", d->name, d->pinned ? "pinned" : "unpinned");
	else
		log_event(LOG_EVENT_DATASET_CHANGED, &about, "the dataset %s is that of uid %u, group %d, mode %s", d->name,
			  d->uid, (int)d->gid, mode_text(d->mode, mode));
}

static void finish(struct verb *v, const struct err *why)
{
	struct dataset *d = v->dataset;
	struct datasets *ds = d->datasets;

	if (why) {
		memcpy(d->name, v->name, sizeof d->name);
		d->removed_us = v->removed_us;
		d->pinned = v->pinned;
		d->uid = v->uid;
		d->gid = v->gid;
		d->mode = v->mode;
	} else {
		tell(v);
	}
	datasets_count(ds); /* it may be of another user now */
	v->answer(v->token, why, why ? NULL : d);
	dataset_release(d);
	uncharge(ds->core, sizeof *v);
	free(v);
}

static void row_done(void *ctx, int r, const struct err *why)
{
	finish(ctx, r ? why : NULL);
}

/* Behind those that wait already. */
static void wait_for_row(struct datasets *ds, struct verb *v, const struct dataset_wanted *w)
{
	struct verb **at;

	/* A name that is longer is that of no dataset. */
	snprintf(v->text, sizeof v->text, "%s", w->name);
	snprintf(v->as, sizeof v->as, "%s", w->mode ? w->mode : w->as);
	v->wanted = *w;
	v->wanted.peer = rights_without_groups(&w->peer);
	v->wanted.name = v->text;
	v->wanted.as = w->mode ? "" : v->as;
	v->wanted.mode = w->mode ? v->as : NULL;
	for (at = &ds->verbs; *at; at = &(*at)->next)
		;
	*at = v;
	v->next = NULL;
}

/* Takes `v`. */
static void run(struct datasets *ds, struct verb *v, const struct dataset_wanted *w)
{
	struct catalogue_dataset row;
	struct err err = ERR_INIT;
	int r = change(ds, w, v, &err);

	if (r == WAITS) {
		wait_for_row(ds, v, w);
	} else if (r) {
		v->answer(v->token, &err, NULL);
		uncharge(ds->core, sizeof *v);
		free(v);
	} else {
		v->wanted.verb = w->verb;
		v->wanted.peer = rights_without_groups(&w->peer);
		dataset_row(v->dataset, &row);
		if (catalogue_put_dataset(ds->core->p.catalogue, &row, 0, row_done, v, &err))
			finish(v, &err);
	}
}

void dataset_verbs_settle(struct datasets *ds)
{
	struct verb *waiting = ds->verbs, *v;

	ds->verbs = NULL;
	while ((v = waiting)) {
		char text[sizeof v->text], as[sizeof v->as];
		struct dataset_wanted w = v->wanted;

		waiting = v->next;
		memcpy(text, v->text, sizeof text);
		memcpy(as, v->as, sizeof as);
		w.name = text;
		w.as = w.mode ? "" : as;
		w.mode = w.mode ? as : NULL;
		run(ds, v, &w);
	}
}

void dataset_verb(struct datasets *ds, const struct dataset_wanted *w, dataset_verb_fn *answer, void *token)
{
	struct verb *v = NULL;
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (w->mode && strlen(w->mode) >= sizeof v->as)
		err_set(&err, ERR_USAGE, "\"%.60s...\" is not a mode", w->mode);
	else if (!charge(ds->core, sizeof *v, "a request", &err) && !(v = calloc(1, sizeof *v))) {
		uncharge(ds->core, sizeof *v);
		err_set(&err, ERR_NOMEM, "no memory for a request");
	}
	if (!v) {
		answer(token, &err, NULL);
		return;
	}
	v->answer = answer;
	v->token = token;
	v->joins = rights_in_group(&w->peer, w->gid);
	run(ds, v, w);
}

struct dataset *dataset_removed_after(struct datasets *ds, uint64_t id, const struct peer *peer)
{
	struct dataset *d, *best = NULL;

	if (!id)
		datasets_expire(ds);
	for (d = ds->first; d; d = d->next)
		if (may_have(d, peer) && d->id > id && (!best || d->id < best->id))
			best = d;
	return best;
}

/* ---- the end ---- */

/* The latest that is known to have been: of a daemon that starts. */
static int64_t latest_us(const struct datasets *ds)
{
	int64_t us = 0;

	for (const struct dataset *d = ds->first; d; d = d->next) {
		for (const struct pending *q = d->pending; q; q = q->next)
			us = q->left_us > us ? q->left_us : us;
		us = d->removed_us > us ? d->removed_us : us;
		us = d->pushed_us > us ? d->pushed_us : us;
		us = d->created_us > us ? d->created_us : us;
	}
	return us;
}

/*
 * What goes by this time goes for good, and clocks are wrong at times: a box without one of its own has some year until it
 * hears from the network. So time that nobody saw pass, between two looks or since the last that is known of the datasets,
 * counts only when the clock has stood by it for an hour.
 */
int64_t datasets_trusted_us(struct datasets *ds)
{
	int64_t now = clock_real_us(), us = ds->trusted.us;
	uint64_t mono = clock_mono_ns();

	THREAD_LOOP_ONLY();
	if (ds->trusted.at_ns)
		us += (int64_t)((mono - ds->trusted.at_ns) / 1000);
	else
		us = latest_us(ds);
	ds->trusted.at_ns = mono;
	if (us && now > us + SLACK_US) {
		if (!ds->trusted.ahead_ns)
			ds->trusted.ahead_ns = mono;
		if ((double)(mono - ds->trusted.ahead_ns) < SURE_SECONDS * 1e9)
			return ds->trusted.us = us;
	}
	ds->trusted.ahead_ns = 0;
	return ds->trusted.us = now;
}

void datasets_expire(struct datasets *ds)
{
	struct dataset *d, *next;
	int64_t now = datasets_trusted_us(ds);

	THREAD_LOOP_ONLY();
	for (d = ds->first; d && !ds->core->stopping; d = next) {
		next = d->next;
		if (!d->removed_us || now < dataset_until_us(d) || d->pushes || d->committer)
			continue;
		if (ds->calls)
			ds->calls->forget(ds->ctx, d);
		pending_forget(d);
		if (d->users)
			continue;
		log_event(LOG_EVENT_DATASET_GONE, ABOUT_DATASET(d),
			  "the dataset %s (number %llu) was removed and goes with its %llu points", d->name,
			  (unsigned long long)d->id, (unsigned long long)d->points);
		dataset_drop(d);
	}
}

static void expire(struct datasets *ds)
{
	if (ds->expired_ns && clock_since(ds->expired_ns) < LOOK_SECONDS)
		return;
	ds->expired_ns = clock_mono_ns();
	datasets_expire(ds);
	/* What holds an interrupted push goes with it, and may be the dataset's last. */
	for (struct dataset *d = ds->first, *next; d && !ds->core->stopping; d = next) {
		next = d->next;
		if (!d->readers)
			pending_expire(d);
	}
}

/* ---- the loop ---- */

void datasets_settle(struct datasets *ds)
{
	dataset_prune_settle(ds);
	dataset_merge_settle(ds);
	dataset_changes_settle(ds);
	dataset_verbs_settle(ds);
	dataset_old_settle(ds);
}

void datasets_tick(struct datasets *ds)
{
	expire(ds);
	dataset_prune_tick(ds);
	if (ds->merge)
		dataset_rewrite_tick(ds->merge);
}

void datasets_park(struct datasets *ds)
{
	dataset_prunes_park(ds);
	if (ds->merge)
		dataset_rewrite_cancel(ds->merge);
}
