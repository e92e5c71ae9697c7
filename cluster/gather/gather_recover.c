/*
 * What is done first when a run is resumed: results that are gone are made again.
 *
 * The model: a record says that a result is there. Somebody, or the file system, may have lost it since, and a task that needs it
 * fails, and would fail for ever. So where a task without a record has failed, the files that records name are looked for, and
 * a record whose file is gone, or has another size, is removed. All attempts at a task make the same, so nothing else follows
 * but for names: the sums name the packs, and are made again if a record names another one. If this node does not see a file that
 * is there, its task is done once more.
 *
 * Outputs that have no name yet are not in the work folder. That one is gone is said by the failure of who needed it.
 */
#include <stdlib.h>
#include <string.h>

#include "gather_priv.h"
#include "outfile.h"

struct recovery {
	const struct gather_params *p;
	bool failed, gone; /* a task has; because an output is gone */
	uint32_t n;
};

static bool says_gone(const struct work *w, enum work_phase phase, uint32_t task)
{
	struct work_failure failure;
	struct err ignored = ERR_INIT;

	return !work_failure_look(w, phase, task, &failure, &ignored) && !strcmp(failure.code, err_wire_name(ERR_GONE));
}

/* What tasks without a record have said last. */
static int look(struct recovery *v, enum work_phase phase, struct err *err)
{
	const struct work *w = v->p->work;

	for (uint32_t i = 0; i < work_about(w)->tasks[phase]; i++) {
		struct work_failure failure;
		struct work_record *record = NULL;
		struct err ignored = ERR_INIT;
		int r = work_record_look(w, phase, i, &record, err);

		work_record_free(record);
		if (r < 0)
			return r;
		if (r != WORK_E_ABSENT || work_failure_look(w, phase, i, &failure, &ignored))
			continue;
		v->failed = true;
		v->gone |= phase >= WORK_GATHER && says_gone(w, phase, i);
	}
	return 0;
}

static int forget(struct recovery *v, enum work_phase phase, uint32_t task, struct err *err)
{
	v->n++;
	return work_forget(v->p->work, phase, task, err);
}

static int forget_lost(struct recovery *v, enum work_phase phase, struct err *err)
{
	const struct work *w = v->p->work;
	int r = 0;

	for (uint32_t i = 0; i < work_about(w)->tasks[phase] && !r; i++) {
		struct work_record *record = NULL;
		bool lost;

		r = work_record_look(w, phase, i, &record, err);
		lost = !r && work_record_lost(w, record);
		work_record_free(record);
		r = r == WORK_E_ABSENT ? 0 : r;
		if (lost)
			r = forget(v, phase, i, err);
	}
	return r;
}

/* *ret: the sums are of the packs that the records name, and all of these are there. */
static int look_packs(const struct gather_input *in, bool *ret, struct err *err)
{
	const struct work *w = in->p->work;
	int r = 0;

	*ret = true;
	for (uint32_t i = 0; i < in->npacks && *ret && !r; i++) {
		struct work_record *record = NULL;

		r = work_record_look(w, WORK_MESH, i, &record, err);
		*ret = !r && gather_sum_is_of(in, i, record) && !work_record_lost(w, record);
		work_record_free(record);
		r = r == WORK_E_ABSENT ? 0 : r;
	}
	return r;
}

/* Before the record of a pack is removed, so that no pack is made again under another name while the sums have the old one, also
 * if this is interrupted. An attempt at the sums that is late may still have read the old record: then they differ next time. */
static int forget_sums(struct recovery *v, struct err *err)
{
	struct work_record *record = NULL;
	struct gather_input in;
	bool good = false;
	int r = work_record_look(v->p->work, WORK_SUM, 0, &record, err);

	if (r)
		return r == WORK_E_ABSENT ? 0 : r;
	work_record_free(record);
	r = gather_input_packs(&in, v->p, err);
	if (!r)
		r = gather_sum_read(&in, 0, err);
	if (!r)
		r = look_packs(&in, &good, err);
	gather_input_done(&in);
	if (r == -ERR_CORRUPT) {
		err_clear(err);
		r = 0;
	}
	return r || good ? r : forget(v, WORK_SUM, 0, err);
}

/* Tasks whose outputs are not those of `part`; NULL: all that have some. */
static int forget_parts(struct recovery *v, const char *part, struct err *err)
{
	const struct work *w = v->p->work;
	int r = 0;

	for (uint32_t i = 0; i < work_about(w)->tasks[WORK_GATHER] && !r; i++) {
		struct work_record *record = NULL;
		const char *own;
		bool other;

		r = work_record_look(w, WORK_GATHER, i, &record, err);
		if (r) {
			r = r == WORK_E_ABSENT ? 0 : r;
			continue;
		}
		own = work_record_text(record, "part");
		other = own && (!part || strcmp(own, part) != 0);
		work_record_free(record);
		if (other)
			r = forget(v, WORK_GATHER, i, err);
	}
	return r;
}

static bool all_there(const struct gather_params *p, const char *part)
{
	for (unsigned i = 1; i <= ctl_fetch_count(p->outputs); i++) {
		struct outfile *o = NULL;
		struct err ignored = ERR_INIT;

		if (outfile_shared_open(ctl_fetch_output(p->outputs, i).path, part, &o, &ignored) == -ERR_GONE)
			return false;
		outfile_free(o);
	}
	return true;
}

/* Files of all tasks: if one is gone, these agree upon others. A task that was late with its record may have written the old
 * ones. */
static int forget_outputs(struct recovery *v, struct err *err)
{
	const struct gather_params *p = v->p;
	const bool shared = work_about(p->work)->tasks[WORK_GATHER] > 1 && gather_shares(p->outputs);
	char part[GATHER_PART];
	int r = shared ? gather_share_agreed(p, part, err) : WORK_E_ABSENT;

	if (r == WORK_E_ABSENT)
		return forget_parts(v, NULL, err);
	if (!r && all_there(p, part))
		return forget_parts(v, part, err);
	if (!r)
		r = gather_share_forget(p, part, err);
	return r ? r : forget_parts(v, NULL, err);
}

/* With --no-clobber: finish may have given some outputs their names before it missed another one. No task could make these
 * again, so they become parts again. */
static int take_back(const struct gather_params *p, struct err *err)
{
	const struct ctl_fetch_options *a = p->outputs;
	const char *folder = a->tile || a->levels ? ctl_fetch_output(a, 1).path : NULL;
	int r = 0;

	for (uint32_t i = 0; i < work_about(p->work)->tasks[WORK_GATHER] && !r; i++) {
		struct work_record *record = NULL;
		const char *part;
		uint8_t *bytes = NULL;
		size_t size = 0;

		r = work_record_look(p->work, WORK_GATHER, i, &record, err);
		part = r ? NULL : work_record_text(record, "part");
		if (!r && part && record->nfile)
			r = gather_list_read(p, &record->file[0], &bytes, &size, err);
		if (bytes)
			r = outputs_part_take_back(folder, part, bytes, size, err);
		free(bytes);
		work_record_free(record);
		r = r == WORK_E_ABSENT ? 0 : r;
	}
	return r;
}

/* That outputs are gone has been dealt with, and is not to be read once more next time. */
static int forget_failures(const struct work *w, struct err *err)
{
	int r = 0;

	for (enum work_phase phase = WORK_GATHER; phase <= WORK_FINISH; phase++)
		for (uint32_t i = 0; i < work_about(w)->tasks[phase] && !r; i++)
			if (says_gone(w, phase, i))
				r = work_failure_forget(w, phase, i, err);
	return r;
}

int gather_recover(const struct gather_params *p, uint32_t *ret, struct err *err)
{
	static const enum work_phase phases[] = {WORK_COMMIT, WORK_PLAN, WORK_MESH, WORK_SUM, WORK_GATHER, WORK_FINISH};
	struct recovery v = {.p = p};
	int r = 0;

	*ret = 0;
	for (size_t i = 0; i < sizeof(phases) / sizeof(phases[0]) && !r; i++)
		r = look(&v, phases[i], err);
	if (!r && v.failed)
		r = forget_lost(&v, WORK_SUM, err);
	if (!r && v.failed)
		r = forget_sums(&v, err);
	for (size_t i = 0; phases[i] < WORK_FINISH && v.failed && !r; i++)
		r = forget_lost(&v, phases[i], err);
	if (!r && v.gone && p->outputs->no_clobber)
		r = take_back(p, err);
	if (!r && v.gone)
		r = forget_outputs(&v, err);
	if (!r && v.gone)
		r = forget_failures(p->work, err);
	*ret = v.n;
	return r;
}
