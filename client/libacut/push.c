/*
 * Pushes, and the headers of single files. The caller opens the files; each goes to the daemon as a descriptor with one
 * request and comes back as one answer. Durable comes unasked under the push's own request and is kept until the caller asks.
 */
#include "call.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

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

/* The daemon takes regular files only; fail here, where the name is known, before it refuses. */
int call_file(struct acut *a, int fd, const char *name)
{
	struct stat st;

	if (fstat(fd, &st) < 0) {
		err_sys(&a->err, errno, "cannot examine the file");
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
		.seconds_left = p->seconds_left,
		.waiting = p->waiting,
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
		.datum = p->datum,
		.crs_name = p->crs_name,
		.epsg = p->epsg,
		.epsg_z = p->epsg_z,
		.left_out = p->left_out,
		.left_out_line = p->left_out_line,
		.replaced = p->replaced,
		.points = p->points,
		.wkt = p->wkt,
		.known = p->known > ACUT_KNOWN_ADOPTED ? ACUT_KNOWN : (int)p->known,
	};
	get_double3(p->min, p->n_min, ret->min);
	get_double3(p->max, p->n_max, ret->max);
	get_text3(p->scale, p->n_scale, ret->scale);
	get_text3(p->offset, p->n_offset, ret->offset);
}

int acut_push_begin(struct acut *a, const struct acut_push_options *o, struct acut_push **ret)
{
	Acut__V1__PushBegin req = ACUT__V1__PUSH_BEGIN__INIT;
	struct acut_push *push;
	int r = call_begin(a);

	if (r < 0)
		return r;
	/* On the wire, no name means a push that ends with its connection: an empty name from the caller is not that. */
	if (o->dataset && !*o->dataset) {
		err_set(&a->err, ERR_USAGE, "\"\" cannot name a dataset");
		return err_add_hint(&a->err, "use up to 64 letters, digits, '_', '-' and '.', not starting with '.' or '-'");
	}
	if (*call_text(o->override_crs) || *call_text(o->override_unit_xy) || *call_text(o->override_unit_z))
		r = call_needs(a, CALL_OVERRIDE);
	if (r < 0)
		return r;
	push = calloc(1, sizeof *push);
	if (!push)
		return err_set(&a->err, ERR_NOMEM, "there is no memory for a push");
	push->format = clean_copy(a, o->format);
	push->columns = clean_copy(a, o->columns);
	push->replaces = clean_copy(a, o->replaces);
	if (!push->format || !push->columns || !push->replaces) {
		free(push->format);
		free(push->columns);
		free(push->replaces);
		free(push);
		return -(int)a->err.code;
	}
	req.dataset = call_text(o->dataset);
	req.mode = call_mode(a);
	req.scale_xy = call_text(o->scale_xy);
	req.scale_z = call_text(o->scale_z);
	req.assume_crs = call_text(o->assume_crs);
	req.assume_unit_xy = call_text(o->assume_unit_xy);
	req.assume_unit_z = call_text(o->assume_unit_z);
	req.override_crs = call_text(o->override_crs);
	req.override_unit_xy = call_text(o->override_unit_xy);
	req.override_unit_z = call_text(o->override_unit_z);
	req.utm = call_text(o->utm);
	req.geoid = call_text(o->geoid);
	req.geoid_way = call_text(o->geoid_way);
	req.planar = o->planar;
	req.accept_truncated = o->accept_truncated;
	req.strict = o->strict;
	req.format = push->format;
	req.crop = (double *)o->crop;
	req.n_crop = o->crop ? 4 : 0;
	r = call_again(a, FRAME_MESSAGE(PUSH_BEGIN, push_begin, &req), -1, ACUT__V1__MESSAGE__BODY_PUSH_BEGUN, &push->request_id,
		       &a->answer);
	if (r < 0) {
		free(push->format);
		free(push->columns);
		free(push->replaces);
		free(push);
		return r;
	}
	push->failed = ERR_INIT;
	push->acut = a;
	push->push = a->answer->push_begun->push;
	push->note = strdup(a->answer->push_begun->note);
	push->first = !*a->answer->push_begun->lattice;
	push->decimal_comma = a->decimal_comma;
	push->checksum = o->checksum;
	push->add = o->add;
	push->replace = o->replace;
	push->progress = o->progress;
	push->ctx = o->ctx;
	push->next = a->pushes;
	a->pushes = push;
	*ret = push;
	return 0;
}

/* A request about the push: a failure that came unasked is reported first. */
static int push_ask(struct acut_push *push, const Acut__V1__Message *req, int fd, Acut__V1__Message__BodyCase want)
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
	return call_again(a, req, fd, want, &id, &a->answer);
}

/* ---- files: Probe and File ---- */

/* One request about an open file, sent. A failure that came unasked is reported first. */
static int file_send(struct acut_push *push, bool probe, const struct acut_push_input *in, uint32_t *ret_id)
{
	Acut__V1__Probe p = ACUT__V1__PROBE__INIT;
	Acut__V1__File f = ACUT__V1__FILE__INIT;
	struct acut *a = push->acut;
	char *name;
	int r;

	if (push->failed.code) {
		a->err = push->failed;
		return -(int)a->err.code;
	}
	r = in->fd < 0 ? 0 : call_file(a, in->fd, in->name);
	if (r < 0)
		return r;
	name = clean_copy(a, in->name);
	if (!name)
		return -(int)a->err.code;
	p.push = f.push = push->push;
	p.name = f.name = name;
	p.format = f.format = in->format ? (char *)in->format : push->format;
	p.columns = f.columns = push->columns;
	p.decimal_comma = f.decimal_comma = push->decimal_comma;
	p.checksum = push->checksum || in->checksum;
	p.add = push->add;
	p.replace = push->replace;
	p.replaces = push->replaces;
	if (in->hash) {
		p.hash = (char *)in->hash;
		p.size = in->size;
	}
	if (in->path) {
		p.path.data = (uint8_t *)in->path;
		p.path.len = strlen(in->path);
	}
	r = call_send(a, probe ? FRAME_MESSAGE(PROBE, probe, &p) : FRAME_MESSAGE(FILE, file, &f), in->fd, ret_id);
	free(name);
	return r;
}

/* The daemon's answer to it, kept as acut->answer: a->probe or a->file, or the call's failure. */
static int file_result(struct acut *a, bool probe, Acut__V1__Message *m)
{
	const Acut__V1__FileDone *done;

	frame_message_free(a->answer);
	a->answer = m;
	if (m->body_case == ACUT__V1__MESSAGE__BODY_ERROR)
		return frame_error_to_err(m->error, &a->err);
	if (m->body_case != (probe ? ACUT__V1__MESSAGE__BODY_PROBED : ACUT__V1__MESSAGE__BODY_FILE_DONE))
		return call_unexpected(a, m);
	if (probe) {
		call_probe(m->probed, &a->probe);
		return 0;
	}
	done = m->file_done;
	a->file = (struct acut_file_result){
		.name = done->name,
		.warning = done->warning,
		.points = done->points,
		.moved = done->moved,
		.projected_from = done->projected_from,
		.geoid = done->geoid,
		.shifted = done->shifted,
		.shift_min = done->shift_min,
		.shift_mean = done->shift_mean,
		.shift_max = done->shift_max,
		.bytes_read = done->bytes_read,
		.bytes = done->bytes,
		.partial = done->partial,
		.left_out = done->left_out,
		.left_out_line = done->left_out_line,
		.replaced = done->replaced,
		.overridden = done->overridden,
	};
	get_double3(done->max_shift, done->n_max_shift, a->file.max_shift);
	return 0;
}

static int file_ask(struct acut_push *push, bool probe, const struct acut_push_input *in)
{
	struct acut *a = push->acut;
	Acut__V1__Message *m;
	uint32_t id;
	int r = call_begin(a);

	if (r == 0)
		r = file_send(push, probe, in, &id);
	if (r < 0)
		return r;
	a->progress = push->progress;
	a->progress_ctx = push->ctx;
	r = call_next(a, id, &m, NULL);
	return r < 0 ? r : file_result(a, probe, m);
}

int acut_push_probe_input(struct acut_push *push, const struct acut_push_input *in, const struct acut_probe **ret)
{
	int r = file_ask(push, true, in);

	if (r == 0)
		*ret = &push->acut->probe;
	return r;
}

int acut_push_file_input(struct acut_push *push, const struct acut_push_input *in, const struct acut_file_result **ret)
{
	int r = file_ask(push, false, in);

	if (r == 0)
		*ret = &push->acut->file;
	return r;
}

int acut_push_probe(struct acut_push *push, int fd, const char *name, const struct acut_probe **ret)
{
	return acut_push_probe_input(push, &(struct acut_push_input){.fd = fd, .name = name}, ret);
}

int acut_push_file(struct acut_push *push, int fd, const char *name, const struct acut_file_result **ret)
{
	return acut_push_file_input(push, &(struct acut_push_input){.fd = fd, .name = name}, ret);
}

/* ---- many files at once ---- */

struct many {
	struct acut_push *push;
	const struct acut_push_each *each;
	bool probe;
};

static int tell(const struct many *m, size_t i, bool failed)
{
	struct acut *a = m->push->acut;
	struct acut_failure why;
	int r;

	call_failure(&a->err, &why);
	if (m->probe)
		r = m->each->probed(m->each->ctx, i, failed ? &why : NULL, failed ? NULL : &a->probe);
	else
		r = m->each->staged(m->each->ctx, i, failed ? &why : NULL, failed ? NULL : &a->file);
	if (r == 0)
		err_clear(&a->err);
	else if (!a->err.code)
		err_set(&a->err, ERR_CANCELLED, "the caller ended it");
	return r ? -(int)a->err.code : 0;
}

/* Sends the next input, unless the caller leaves it out or no request can be sent. */
static int many_send(const struct many *m, size_t i)
{
	struct call_window *w = m->push->acut->window;
	struct acut_push_input in = {.fd = -1, .name = ""};
	struct acut *a = m->push->acut;
	uint32_t id;
	int r = m->each->open(m->each->ctx, i, &in);

	if (r > 0)
		return 0;
	if (r < 0)
		return a->err.code ? -(int)a->err.code : err_set(&a->err, ERR_CANCELLED, "the caller ended it");
	r = file_send(m->push, m->probe, &in, &id);
	if (in.fd >= 0)
		close(in.fd);
	if (r < 0)
		return a->dead.code || m->push->failed.code ? r : tell(m, i, true);
	w->slot[(w->first + w->n++) % CALL_WINDOW] = (struct call_slot){.id = id, .i = i};
	return 0;
}

/* The answer of the first in the window. */
static int many_take(const struct many *m)
{
	struct acut *a = m->push->acut;
	struct call_window *w = a->window;
	struct call_slot slot;
	int r = call_window_wait(a);

	if (r < 0)
		return r;
	slot = w->slot[w->first];
	w->slot[w->first] = (struct call_slot){0};
	w->first = (w->first + 1) % CALL_WINDOW;
	w->n--;
	r = file_result(a, m->probe, slot.answer);
	return tell(m, slot.i, r < 0);
}

static int push_many(struct acut_push *push, size_t n, const struct acut_push_each *each, bool probe)
{
	const struct many m = {.push = push, .each = each, .probe = probe};
	struct call_window window = {0};
	struct acut *a = push->acut;
	size_t next = 0;
	int r = call_begin(a);

	a->window = &window;
	a->progress = push->progress;
	a->progress_ctx = push->ctx;
	while (r == 0 && (next < n || window.n)) {
		if (next < n && window.n < CALL_WINDOW)
			r = many_send(&m, next++);
		else
			r = many_take(&m);
	}
	a->window = NULL;
	for (unsigned i = 0; i < CALL_WINDOW; i++)
		frame_message_free(window.slot[i].answer);
	return r;
}

int acut_push_probe_each(struct acut_push *push, size_t n, const struct acut_push_each *each)
{
	return push_many(push, n, each, true);
}

int acut_push_file_each(struct acut_push *push, size_t n, const struct acut_push_each *each)
{
	return push_many(push, n, each, false);
}

/* ---- plan, commit, the end ---- */

int acut_push_stream(struct acut_push *push, const char *name, int *ret_fd)
{
	struct acut *a = push->acut;
	Acut__V1__Stream req = ACUT__V1__STREAM__INIT;
	int fd = -1, r = call_begin(a);
	uint32_t id;
	char *copy;

	if (r < 0)
		return r;
	copy = clean_copy(a, name);
	if (!copy)
		return -(int)a->err.code;
	req.push = push->push;
	req.name = copy;
	r = call_send(a, FRAME_MESSAGE(STREAM, stream, &req), -1, &id);
	free(copy);
	if (r == 0)
		r = call_next(a, id, &a->answer, &fd);
	if (r == 0 && a->answer->body_case != ACUT__V1__MESSAGE__BODY_STREAMING)
		r = call_unexpected(a, a->answer);
	if (r == 0 && fd < 0)
		r = err_set(&a->err, ERR_PROTO, "the daemon announced a pipe and sent none");
	if (r < 0) {
		if (fd >= 0)
			close(fd);
		return r;
	}
	*ret_fd = fd;
	return 0;
}

int acut_push_plan(struct acut_push *push, const char **ret_lattice)
{
	Acut__V1__PushPlan req = ACUT__V1__PUSH_PLAN__INIT;
	int r;

	req.push = push->push;
	r = push_ask(push, FRAME_MESSAGE(PUSH_PLAN, push_plan, &req), -1, ACUT__V1__MESSAGE__BODY_PUSH_PLANNED);
	if (r == 0) {
		const Acut__V1__PushPlanned *p = push->acut->answer->push_planned;

		push->acut->planned = (struct acut_push_planned){.lattice = p->lattice,
								 .crs = p->crs,
								 .zone = p->zone,
								 .datum = p->datum,
								 .geoid = p->geoid,
								 .note = p->note};
		*ret_lattice = p->lattice;
	}
	return r;
}

const struct acut_push_planned *acut_push_planned(const struct acut_push *push)
{
	return &push->acut->planned;
}

int acut_push_commit(struct acut_push *push, const struct acut_push_result **ret)
{
	struct acut *a = push->acut;
	Acut__V1__PushCommit req = ACUT__V1__PUSH_COMMIT__INIT;
	const Acut__V1__PushCommitted *c;
	int r;

	req.push = push->push;
	r = push_ask(push, FRAME_MESSAGE(PUSH_COMMIT, push_commit, &req), -1, ACUT__V1__MESSAGE__BODY_PUSH_COMMITTED);
	if (r < 0)
		return r;
	push->committed = true;
	c = a->answer->push_committed;
	a->pushed = (struct acut_push_result){
		.dataset = c->dataset, .generation = c->generation, .points = c->points, .unchanged = c->unchanged};
	if (c->line_set) {
		call_line_set(c->line_set, &a->line_set);
		a->pushed.line_set = &a->line_set;
	}
	*ret = &a->pushed;
	return 0;
}

bool acut_push_first(const struct acut_push *push)
{
	return push->first;
}

const char *acut_push_note(const struct acut_push *push)
{
	return push->note ? push->note : "";
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
	free(push->note);
	free(push->columns);
	free(push->replaces);
	free(push);
	return NULL;
}

struct acut_push *acut_push_end(struct acut_push *push)
{
	Acut__V1__PushAbort req = ACUT__V1__PUSH_ABORT__INIT;

	if (!push)
		return NULL;
	if (!push->committed && !push->acut->dead.code) {
		/* The caller still wants to see why it gave up, not how the abort went: a push that cannot be
		 * aborted stays pending, which the daemon shows. */
		struct acut *a = push->acut;
		struct err why = a->err;

		req.push = push->push;
		call_ask(a, FRAME_MESSAGE(PUSH_ABORT, push_abort, &req), -1, ACUT__V1__MESSAGE__BODY_DONE);
		if (why.code)
			a->err = why;
	}
	return acut_push_leave(push);
}

int acut_decimal_comma(struct acut *a, bool decimal_comma)
{
	int r = call_begin(a);

	if (r == 0 && decimal_comma)
		r = call_needs(a, CALL_DECIMAL_COMMA);
	if (r == 0)
		a->decimal_comma = decimal_comma;
	return r;
}

int acut_info(struct acut *a, int fd, const char *name, const char *format, const char *columns, const struct acut_probe **ret)
{
	Acut__V1__InfoRequest req = ACUT__V1__INFO_REQUEST__INIT;
	char *copy;
	uint32_t id;
	int r = call_begin(a);

	if (r == 0)
		r = call_file(a, fd, name);
	if (r < 0)
		return r;
	copy = clean_copy(a, name);
	if (!copy)
		return -(int)a->err.code;
	req.name = copy;
	req.format = call_text(format);
	req.columns = call_text(columns);
	req.decimal_comma = a->decimal_comma;
	r = call_again(a, FRAME_MESSAGE(INFO_REQUEST, info_request, &req), fd, ACUT__V1__MESSAGE__BODY_PROBED, &id, &a->answer);
	free(copy);
	if (r < 0)
		return r;
	call_probe(a->answer->probed, &a->probe);
	*ret = &a->probe;
	return 0;
}
