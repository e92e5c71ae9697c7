/*
 * Pushes, and the headers of single files. The caller opens the files; here each goes to the daemon as a
 * descriptor with one question and comes back as one answer. Durable comes unasked on the push's own request
 * and is kept until somebody asks.
 */
#include "call.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* Names are for people: bytes that are not UTF-8 become '?', since messages carry only UTF-8. */
static char *clean_copy(struct acut *a, const char *text)
{
	char *copy = strdup(text ? text : "");

	if (!copy)
		err_set(&a->err, ERR_NOMEM, "there is no memory for a name");
	return copy ? frame_text_clean(copy) : NULL;
}

char *call_text(const char *text)
{
	return text ? (char *)text : (char *)protobuf_c_empty_string;
}

/* The daemon takes regular files only; say so here, where the name is known, before it refuses. */
static int check_file(struct acut *a, int fd, const char *name)
{
	struct stat st;

	if (fstat(fd, &st) < 0) {
		err_sys(&a->err, errno, "cannot look at the file");
		return err_add_file(&a->err, name);
	}
	if (!S_ISREG(st.st_mode)) {
		err_set(&a->err, ERR_INPUT, "it is not a regular file");
		return err_add_file(&a->err, name);
	}
	return 0;
}

static void get_text3(char *const *from, size_t n, const char *to[3])
{
	for (size_t i = 0; i < 3; i++)
		to[i] = i < n ? from[i] : "";
}

static void get_double3(const double *from, size_t n, double to[3])
{
	for (size_t i = 0; i < 3; i++)
		to[i] = i < n ? from[i] : 0;
}

void call_progress(const Acut__V1__Progress *p, struct acut_progress *ret)
{
	*ret = (struct acut_progress){
	    .phase = p->phase,
	    .points = p->points,
	    .points_total = p->points_total,
	    .domains = p->domains,
	    .domains_total = p->domains_total,
	};
}

void call_probe(const Acut__V1__Probed *p, struct acut_probe *ret)
{
	*ret = (struct acut_probe){
	    .name = p->name,
	    .format = p->format,
	    .variant = p->variant,
	    .crs = p->crs,
	    .unit_xy = p->unit_xy,
	    .unit_z = p->unit_z,
	    .plane = p->plane,
	    .warning = p->warning,
	    .points = p->points,
	};
	get_double3(p->min, p->n_min, ret->min);
	get_double3(p->max, p->n_max, ret->max);
	get_text3(p->scale, p->n_scale, ret->scale);
	get_text3(p->offset, p->n_offset, ret->offset);
}

int acut_push_begin(struct acut *a, const struct acut_push_options *o, struct acut_push **ret)
{
	Acut__V1__PushBegin question = ACUT__V1__PUSH_BEGIN__INIT;
	struct acut_push *push;
	int r = call_begin(a);

	if (r < 0)
		return r;
	push = calloc(1, sizeof *push);
	if (!push)
		return err_set(&a->err, ERR_NOMEM, "there is no memory for a push");
	push->format = clean_copy(a, o->format);
	if (!push->format) {
		free(push);
		return -(int)a->err.code;
	}
	question.dataset = call_text(o->dataset);
	question.scale_xy = call_text(o->scale_xy);
	question.scale_z = call_text(o->scale_z);
	question.planar = o->planar;
	question.accept_truncated = o->accept_truncated;
	question.format = push->format;
	r = call_again(a, FRAME_MESSAGE(PUSH_BEGIN, push_begin, &question), -1,
		       ACUT__V1__MESSAGE__BODY_PUSH_BEGUN, &push->request_id, &a->answer);
	if (r < 0) {
		free(push->format);
		free(push);
		return r;
	}
	push->failed = ERR_INIT;
	push->acut = a;
	push->push = a->answer->push_begun->push;
	push->progress = o->progress;
	push->ctx = o->ctx;
	push->next = a->pushes;
	a->pushes = push;
	*ret = push;
	return 0;
}

/* A question about the push: what went wrong unasked comes first. */
static int push_ask(struct acut_push *push, const Acut__V1__Message *question, int fd,
		    Acut__V1__Message__BodyCase want)
{
	struct acut *a = push->acut;
	uint32_t id;
	int r = call_begin(a);

	if (r < 0)
		return r;
	if (push->failed.code) {
		a->err = push->failed;
		return -(int)a->err.code;
	}
	a->progress = push->progress;
	a->progress_ctx = push->ctx;
	return call_again(a, question, fd, want, &id, &a->answer);
}

int acut_push_probe(struct acut_push *push, int fd, const char *name, const struct acut_probe **ret)
{
	struct acut *a = push->acut;
	Acut__V1__Probe question = ACUT__V1__PROBE__INIT;
	char *copy;
	int r = call_begin(a);

	if (r == 0)
		r = check_file(a, fd, name);
	if (r < 0)
		return r;
	copy = clean_copy(a, name);
	if (!copy)
		return -(int)a->err.code;
	question.push = push->push;
	question.name = copy;
	question.format = push->format;
	r = push_ask(push, FRAME_MESSAGE(PROBE, probe, &question), fd, ACUT__V1__MESSAGE__BODY_PROBED);
	free(copy);
	if (r < 0)
		return r;
	call_probe(a->answer->probed, &a->probe);
	*ret = &a->probe;
	return 0;
}

int acut_push_plan(struct acut_push *push, const char **ret_lattice)
{
	Acut__V1__PushPlan question = ACUT__V1__PUSH_PLAN__INIT;
	int r;

	question.push = push->push;
	r = push_ask(push, FRAME_MESSAGE(PUSH_PLAN, push_plan, &question), -1,
		     ACUT__V1__MESSAGE__BODY_PUSH_PLANNED);
	if (r == 0)
		*ret_lattice = push->acut->answer->push_planned->lattice;
	return r;
}

int acut_push_file(struct acut_push *push, int fd, const char *name, const struct acut_file_result **ret)
{
	struct acut *a = push->acut;
	Acut__V1__File question = ACUT__V1__FILE__INIT;
	const Acut__V1__FileDone *done;
	char *copy;
	int r = call_begin(a);

	if (r == 0)
		r = check_file(a, fd, name);
	if (r < 0)
		return r;
	copy = clean_copy(a, name);
	if (!copy)
		return -(int)a->err.code;
	question.push = push->push;
	question.name = copy;
	question.format = push->format;
	r = push_ask(push, FRAME_MESSAGE(FILE, file, &question), fd, ACUT__V1__MESSAGE__BODY_FILE_DONE);
	free(copy);
	if (r < 0)
		return r;
	done = a->answer->file_done;
	a->file = (struct acut_file_result){
	    .name = done->name, .warning = done->warning, .points = done->points, .moved = done->moved};
	get_double3(done->max_shift, done->n_max_shift, a->file.max_shift);
	*ret = &a->file;
	return 0;
}

int acut_push_commit(struct acut_push *push, const struct acut_push_result **ret)
{
	struct acut *a = push->acut;
	Acut__V1__PushCommit question = ACUT__V1__PUSH_COMMIT__INIT;
	const Acut__V1__PushCommitted *c;
	int r;

	question.push = push->push;
	r = push_ask(push, FRAME_MESSAGE(PUSH_COMMIT, push_commit, &question), -1,
		     ACUT__V1__MESSAGE__BODY_PUSH_COMMITTED);
	if (r < 0)
		return r;
	push->committed = true;
	c = a->answer->push_committed;
	a->pushed = (struct acut_push_result){
	    .dataset = c->dataset, .generation = c->generation, .points = c->points};
	*ret = &a->pushed;
	return 0;
}

uint64_t acut_push_durable(const struct acut_push *push)
{
	return push->durable;
}

struct acut_push *acut_push_leave(struct acut_push *push)
{
	struct acut_push **at;

	if (!push)
		return NULL;
	for (at = &push->acut->pushes; *at != push; at = &(*at)->next)
		;
	*at = push->next;
	free(push->format);
	free(push);
	return NULL;
}

struct acut_push *acut_push_end(struct acut_push *push)
{
	Acut__V1__PushAbort question = ACUT__V1__PUSH_ABORT__INIT;

	if (!push)
		return NULL;
	if (!push->committed && !push->acut->dead.code) {
		/* The caller still wants to see why it gave up, not how the abort went: a push that cannot be
		 * aborted stays pending, which the daemon shows. */
		struct acut *a = push->acut;
		struct err why = a->err;

		question.push = push->push;
		call_ask(a, FRAME_MESSAGE(PUSH_ABORT, push_abort, &question), -1,
			 ACUT__V1__MESSAGE__BODY_DONE);
		if (why.code)
			a->err = why;
	}
	return acut_push_leave(push);
}

int acut_info(struct acut *a, int fd, const char *name, const char *format, const struct acut_probe **ret)
{
	Acut__V1__InfoRequest question = ACUT__V1__INFO_REQUEST__INIT;
	char *copy;
	uint32_t id;
	int r = call_begin(a);

	if (r == 0)
		r = check_file(a, fd, name);
	if (r < 0)
		return r;
	copy = clean_copy(a, name);
	if (!copy)
		return -(int)a->err.code;
	question.name = copy;
	question.format = call_text(format);
	r = call_again(a, FRAME_MESSAGE(INFO_REQUEST, info_request, &question), fd,
		       ACUT__V1__MESSAGE__BODY_PROBED, &id, &a->answer);
	free(copy);
	if (r < 0)
		return r;
	call_probe(a->answer->probed, &a->probe);
	*ret = &a->probe;
	return 0;
}
