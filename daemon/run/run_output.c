/*
 * A run and its output: the head, slow readers, and the end.
 *
 * The model: output_busy lasts from the encoding of a block until run_output_sent; output_working while a worker is in a call of
 * the output. A block whose reader takes nothing for a while is spooled into a file without a name, which frees its memory; it is
 * read back through one small buffer.
 */
#include <assert.h>
#include <string.h>

#include "clock.h"
#include "log.h"
#include "run_priv.h"

#define SPOOL_AGAIN_SECONDS 5.0
/* A block whose reader is slow but not stalled is spooled when others lack memory, or after the longer time. */
#define SLOW_SECONDS 0.5
#define SLOWEST_SECONDS 5.0

static struct run *run_of_output_task(struct sched_task *t)
{
	return (struct run *)((char *)t - offsetof(struct run, output_task));
}

bool run_attach(struct run *w, struct run_output *output)
{
	THREAD_LOOP_ONLY();
	if (w->output || w->sums_only || w->next_emit || w->emitting || w->stopping || w->state >= RUN_FINISHING)
		return false;
	w->output = output;
	output->run = w;
	if (w->state == RUN_RUNNING)
		run_output_head(w);
	run_settle(w);
	return true;
}

struct run_output *run_output(const struct run *w)
{
	return w->output_freed ? NULL : w->output;
}

struct run_output *run_detach(struct run *w)
{
	struct run_output *output = w->output_freed ? NULL : w->output;

	THREAD_LOOP_ONLY();
	if (output)
		output->run = NULL;
	w->output = NULL;
	return output;
}

/* The same generation, view and plan, and the same version of the kernel, give the same blocks in the same order. Splits follow
 * from the plan and its cap. */
static struct digest stream_id(const struct run *w)
{
	struct digest id = digest_hash(w->view_text, strlen(w->view_text)), key;
	int32_t box[4] = {0, 0, 0, 0};
	struct cut_region root;

	grid_box(w->grid, box);
	cut_region_root(box, &root);
	key = pipe_key_mesh(&w->key, &root);
	digest_add(&id, digest_hash(&w->generation, sizeof w->generation));
	digest_add(&id, digest_hash(&key, sizeof key));
	digest_add(&id, digest_hash(&w->kept.base, sizeof w->kept.base));
	run_area_id(w, &id);
	if (w->change)
		digest_add(&id, w->change->id);
	return digest_hash(&id, sizeof id);
}

/* False: another stream was to be resumed, and the run fails. */
static bool check_stream(struct run *w, struct digest id)
{
	char have[DIGEST_HEX_SIZE], want[DIGEST_HEX_SIZE];
	struct err err = ERR_INIT;

	if (!w->output->wants || digest_equal(id, w->output->want))
		return true;
	err_set(&err, ERR_GONE, "the stream %s cannot be continued, the job's is %s now", digest_hex(w->output->want, want),
		digest_hex(id, have));
	err_add_hint(&err, "fetch it from its start");
	run_fail(w, &err);
	return false;
}

bool run_output_check_end(struct run *w)
{
	struct err err = ERR_INIT;

	if (!w->output || w->output->from <= w->blocks)
		return true;
	err_set(&err, ERR_GONE, "the stream cannot go on at block %llu, it has %llu", (unsigned long long)w->output->from,
		(unsigned long long)w->blocks);
	err_add_hint(&err, "fetch it from its start");
	run_fail(w, &err);
	return false;
}

void run_output_head(struct run *w)
{
	struct run_head head = {
		.manifest = NULL,
		.view = w->view_text,
		.box = {0, 0, 0, 0, 0, 0},
	};
	int32_t box[4];

	if (!w->output || w->stopping)
		return;
	head.id = stream_id(w);
	if (w->output_head) {
		/* The run has begun again: it must be the same stream. */
		if (!digest_equal(head.id, w->head_id)) {
			struct err err = ERR_INIT;

			err_set(&err, ERR_GONE, "the mesh had to be started again, and has other regions now");
			err_add_hint(&err, "request it again");
			run_fail(w, &err);
		}
		return;
	}
	if (!check_stream(w, head.id))
		return;
	w->output_head = true;
	w->head_id = head.id;
	head.lines = grid_lines(w->grid);
	head.bounded = pipe_has_out(w->grid);
	head.window = w->view.window;
	head.manifest = grid_manifest(w->grid);
	head.wkt = w->wkt ? w->wkt : "";
	head.geoid = w->geoid;
	head.changes = w->change ? &w->change->summary : NULL;
	if (grid_box(w->grid, box)) {
		/* The grid has mapped positions. */
		if (w->grid_view.map.is.k)
			memcpy(box, w->select.counts.box, sizeof box);
		head.box[0] = box[0];
		head.box[1] = box[1];
		head.box[2] = INT32_MIN;
		head.box[3] = box[2];
		head.box[4] = box[3];
		head.box[5] = INT32_MAX;
	}
	w->output->calls->head(w->output, &head);
}

static void release_buffer(struct run *w)
{
	if (w->output_buffer)
		sched_give(w->runs->core->p.sched, LEDGER_PIPE, RUN_OUTPUT_BUFFER);
	w->output_buffer = false;
	run_space_unspool(w);
}

static void release_sending(struct run *w)
{
	if (w->sending)
		run_domain_release(w->sending);
	w->sending = NULL;
}

/* ---- spooling ---- */

static void spool_run(struct sched_task *t)
{
	struct run *w = run_of_output_task(t);

	w->err = ERR_INIT;
	w->r = run_space_spool(w, w->sending->held, &w->err);
	if (!w->r)
		w->r = w->output->calls->spool(w->output, w->runs->core->tempfd, &w->err);
}

static void refill_run(struct sched_task *t)
{
	struct run *w = run_of_output_task(t);

	w->err = ERR_INIT;
	w->r = w->output->calls->refill(w->output, &w->err);
}

static void output_task_done(struct sched_task *t)
{
	struct run *w = run_of_output_task(t);
	bool refill = t->run == refill_run;

	w->tasks--;
	w->output_working = false;
	if (refill && t->ran && t->bytes)
		w->output_buffer = true;
	if (w->output_freed) {
		run_output_drop(w);
	} else if (t->ran && w->r && refill) {
		run_fail(w, &w->err);
	} else if (t->ran && w->r) {
		log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_RUN(w), "a block for a slow reader cannot be spooled", &w->err);
		run_space_unspool(w);
		w->spool_failed_ns = clock_mono_ns();
		w->output->calls->send(w->output);
	} else if (t->ran) {
		if (!refill)
			release_sending(w);
		w->output->calls->send(w->output);
	}
	run_settle(w);
}

static void output_submit(struct run *w, void (*run)(struct sched_task *), uint64_t bytes)
{
	w->output_task = (struct sched_task){
		.run = run,
		.done = output_task_done,
		.owner = w->owner,
		.priority = SCHED_FIRST,
		.name = LEDGER_PIPE,
		.bytes = bytes,
	};
	assert(!w->output_working);
	w->output->calls->pause(w->output);
	w->output_working = true;
	w->tasks++;
	sched_submit(w->runs->core->p.sched, &w->output_task);
}

static bool can_spool(const struct run *w)
{
	if (!w->output || !w->output_busy || w->output_working || !w->sending || w->stopping)
		return false;
	return !w->spool_failed_ns || clock_since(w->spool_failed_ns) >= SPOOL_AGAIN_SECONDS;
}

void run_output_tick(struct run *w)
{
	if (can_spool(w) &&
	    (w->output->calls->stalled(w->output) > RUN_STALL_SECONDS || clock_since(w->sending_ns) > SLOWEST_SECONDS) &&
	    run_must_store(w))
		output_submit(w, spool_run, 0);
}

void run_output_relieve(struct run *w)
{
	if (can_spool(w) && clock_since(w->sending_ns) > SLOW_SECONDS)
		output_submit(w, spool_run, 0);
}

void run_output_drained(struct run_output *output)
{
	struct run *w = output->run;

	THREAD_LOOP_ONLY();
	if (!w || w->output_working)
		return;
	output_submit(w, refill_run, w->output_buffer ? 0 : RUN_OUTPUT_BUFFER);
}

/* ---- closing ---- */

void run_output_sent(struct run_output *output)
{
	struct run *w = output->run;

	THREAD_LOOP_ONLY();
	if (!w || !w->output_busy)
		return;
	w->output_busy = false;
	release_buffer(w);
	release_sending(w);
	run_settle(w);
}

/* No worker uses the output any more. */
void run_output_drop(struct run *w)
{
	struct run_output *output = w->output;
	void (*freed)(struct run_output *) = w->output_freed;

	assert(!w->output_working);
	w->output = NULL;
	w->output_freed = NULL;
	w->output_busy = false;
	release_buffer(w);
	release_sending(w);
	output->run = NULL;
	freed(output);
}

void run_output_close(struct run_output *output, void (*freed)(struct run_output *))
{
	struct run *w = output->run;
	struct err why = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (!w) {
		if (output->forget)
			output->forget(output);
		freed(output);
		return;
	}
	w->output_freed = freed;
	if (!w->output_working)
		run_output_drop(w);
	err_set(&why, ERR_CANCELLED, "the stream has no reader any more");
	if (w->calls->abandoned)
		w->calls->abandoned(w->ctx, &why);
	run_settle(w);
}
