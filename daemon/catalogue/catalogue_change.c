/*
 * Changes of the catalogue. Values are copied. Changes that wait are charged: if the account is full, the caller waits for the
 * disk.
 */
#include "catalogue_priv.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "ledger.h"
#include "progress.h"
#include "thread.h"

enum { MALLOC_OVERHEAD = 24 };

void catalogue_change_free(struct change *ch)
{
	for (unsigned i = 0; i < ch->n; i++)
		free(ch->value[i].text);
	free(ch->err);
	free(ch);
}

static struct change *change_new(enum catalogue_sql sql, catalogue_done_fn done, void *ctx)
{
	struct change *ch = calloc(1, sizeof *ch);

	if (ch) {
		ch->sql = sql;
		ch->done = done;
		ch->ctx = ctx;
	}
	return ch;
}

static void add_number(struct change *ch, int64_t number)
{
	if (ch)
		ch->value[ch->n++] = (struct value){.kind = VALUE_NUMBER, .number = number};
}

/* If there is no memory for the text, change_queue refuses the change. */
static void add_text(struct change *ch, const char *t)
{
	if (ch)
		ch->value[ch->n++] = (struct value){.kind = VALUE_TEXT, .text = strdup(t ? t : "")};
}

/* Charges a change. If the account is full, waits until others are written: a slow disk slows down whoever makes more changes
 * than it can take. */
static bool charge_change(struct catalogue *c, struct change *ch)
{
	size_t bytes = sizeof *ch;

	assert(lock_held(LOCK_CATALOGUE));
	if (!c->ledger)
		return true;
	for (unsigned i = 0; i < ch->n; i++)
		bytes += ch->value[i].kind == VALUE_TEXT ? strlen(ch->value[i].text) + MALLOC_OVERHEAD : 0;
	while (!ledger_take(c->ledger, LEDGER_CATALOGUE, bytes)) {
		if (!c->started || (!c->queued && !c->writing))
			return false;
		lock_wait(&c->lock, &c->written);
		progress_step(); /* the disk is slow, but it answers */
	}
	ch->charged = bytes;
	return true;
}

static int change_queue(struct catalogue *c, struct change *ch, struct err *err)
{
	if (!ch)
		return err_set(err, ERR_NOMEM, "no memory for a change of the catalogue");
	for (unsigned i = 0; i < ch->n; i++)
		if (ch->value[i].kind == VALUE_TEXT && !ch->value[i].text) {
			catalogue_change_free(ch);
			return err_set(err, ERR_NOMEM, "no memory for a change of the catalogue");
		}
	THREAD_LOOP_ONLY();
	lock_take(&c->lock);
	if (!charge_change(c, ch)) {
		lock_give(&c->lock);
		catalogue_change_free(ch);
		return err_set(err, ERR_BUSY, "there is no memory left for a change of the catalogue");
	}
	*c->queued_end = ch;
	c->queued_end = &ch->next;
	c->busy++;
	pthread_cond_signal(&c->wake);
	lock_give(&c->lock);
	return 0;
}

int catalogue_put_dataset(struct catalogue *c, const struct catalogue_dataset *d, uint64_t push, catalogue_done_fn done,
			  void *ctx, struct err *err)
{
	struct change *ch = change_new(CATALOGUE_PUT_DATASET, done, ctx);

	add_number(ch, (int64_t)d->id);
	add_text(ch, d->name);
	add_number(ch, d->uid);
	add_number(ch, d->created_us);
	add_number(ch, d->pushed_us);
	add_text(ch, d->manifest);
	add_number(ch, (int64_t)d->generation);
	add_number(ch, (int64_t)d->points);
	add_number(ch, (int64_t)d->bytes);
	add_number(ch, d->files);
	add_text(ch, d->lattice);
	add_text(ch, d->crs);
	add_text(ch, d->unit_xy);
	add_text(ch, d->unit_z);
	add_number(ch, (int64_t)((uint64_t)(uint32_t)d->box[0] << 32 | (uint32_t)d->box[1]));
	add_number(ch, (int64_t)((uint64_t)(uint32_t)d->box[2] << 32 | (uint32_t)d->box[3]));
	add_number(ch, d->removed_us);
	add_number(ch, d->pinned);
	add_number(ch, (int64_t)d->oldest);
	add_number(ch, d->segments);
	add_number(ch, d->gid);
	add_number(ch, d->mode);
	if (ch)
		ch->drop_push = push;
	return change_queue(c, ch, err);
}

int catalogue_put_job(struct catalogue *c, const struct catalogue_job *j, catalogue_done_fn done, void *ctx, struct err *err)
{
	struct change *ch = change_new(CATALOGUE_PUT_JOB, done, ctx);

	add_number(ch, (int64_t)j->id);
	add_number(ch, (int64_t)j->dataset);
	add_number(ch, (int64_t)j->generation);
	add_text(ch, j->view);
	add_text(ch, j->state);
	add_number(ch, j->uid);
	add_number(ch, j->pid);
	add_number(ch, j->submitted_us);
	add_number(ch, j->finished_us);
	add_text(ch, j->report);
	add_text(ch, j->error_code);
	add_text(ch, j->error_message);
	add_text(ch, j->error_file);
	add_text(ch, j->error_field);
	add_text(ch, j->error_hint);
	add_number(ch, j->error_offset);
	add_number(ch, j->priority);
	add_text(ch, j->area);
	add_number(ch, j->admin);
	return change_queue(c, ch, err);
}

int catalogue_put_push(struct catalogue *c, const struct catalogue_push *p, catalogue_done_fn done, void *ctx, struct err *err)
{
	struct change *ch = change_new(CATALOGUE_PUT_PUSH, done, ctx);

	add_number(ch, (int64_t)p->id);
	add_number(ch, (int64_t)p->dataset);
	add_number(ch, p->uid);
	add_number(ch, p->files);
	add_number(ch, p->begun_us);
	return change_queue(c, ch, err);
}

static int queue_drop(struct catalogue *c, enum catalogue_sql sql, uint64_t id, catalogue_done_fn done, void *ctx,
		      struct err *err)
{
	struct change *ch = change_new(sql, done, ctx);

	add_number(ch, (int64_t)id);
	return change_queue(c, ch, err);
}

int catalogue_drop_dataset(struct catalogue *c, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err)
{
	return queue_drop(c, CATALOGUE_DROP_DATASET, id, done, ctx, err);
}

int catalogue_drop_job(struct catalogue *c, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err)
{
	return queue_drop(c, CATALOGUE_DROP_JOB, id, done, ctx, err);
}

int catalogue_drop_push(struct catalogue *c, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err)
{
	return queue_drop(c, CATALOGUE_DROP_PUSH, id, done, ctx, err);
}

int catalogue_check(struct catalogue *c, catalogue_done_fn done, void *ctx, struct err *err)
{
	return change_queue(c, change_new(CATALOGUE_CHECK, done, ctx), err);
}
