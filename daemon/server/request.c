/* The table of requests: the handler of each message, and whether a descriptor comes with it. */
#include "io.h"
#include "server_priv.h"

static void request_hello(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	static char *features[] = {(char *)"push",          (char *)"mesh",     (char *)"mode",
				   (char *)"decimal-comma", (char *)"override", (char *)"lines"};
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;
	struct err err = ERR_INIT;

	if (m->hello->version_min > FRAME_PROTOCOL_MAX || m->hello->version_max < FRAME_PROTOCOL_MIN) {
		err_set(&err, ERR_VERSION, "acutd speaks versions %u to %u of the protocol, the client %u to %u",
			FRAME_PROTOCOL_MIN, FRAME_PROTOCOL_MAX, m->hello->version_min, m->hello->version_max);
		request_refuse(q, &err);
		return;
	}
	c->hello = true;
	hello.version_min = FRAME_PROTOCOL_MIN;
	hello.version_max = FRAME_PROTOCOL_MAX;
	hello.build = (char *)c->server->p.version;
	hello.program = (char *)"acutd";
	hello.n_features = sizeof features / sizeof features[0];
	hello.features = features;
	request_answer(q, FRAME_MESSAGE(HELLO, hello, &hello));
}

static void request_ping(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	request_answer_done(q);
}

static const struct {
	Acut__V1__Message__BodyCase body;
	request_fn *handle;
	bool file; /* counts among the unanswered files, and takes a descriptor */
} table[] = {
#define ROW(CASE, fn, file)                              \
	{                                                \
		ACUT__V1__MESSAGE__BODY_##CASE, fn, file \
	}
	ROW(HELLO, request_hello, false),
	ROW(PING, request_ping, false),
	ROW(STATUS_REQUEST, request_status, false),
	ROW(PUSH_BEGIN, request_push_begin, false),
	ROW(PROBE, request_probe, true),
	ROW(PUSH_PLAN, request_push_plan, false),
	ROW(FILE, request_file, true),
	ROW(STREAM, request_stream, false),
	ROW(PUSH_COMMIT, request_push_commit, false),
	ROW(PUSH_ABORT, request_push_abort, false),
	ROW(INFO_REQUEST, request_info, true),
	ROW(INSPECT, request_inspect, true),
	ROW(SUBMIT, request_submit, false),
	ROW(FETCH, request_fetch, false),
	ROW(WAIT, request_wait, false),
	ROW(CANCEL, request_cancel, false),
	ROW(REMOVE, request_remove, false),
	ROW(JOBS_REQUEST, request_jobs, false),
	ROW(DATASETS_REQUEST, request_datasets, false),
	ROW(DATASET_CREATE, request_dataset_create, false),
	ROW(LOG_REQUEST, request_log, false),
	ROW(FILES_REQUEST, request_files, false),
	ROW(PLACES_REQUEST, request_places, false),
	ROW(REVERT, request_revert, false),
	ROW(DATASET_CHANGE, request_dataset_change, false),
	ROW(PRUNE, request_prune, false),
	ROW(DISCARD, request_discard, false),
	ROW(PLAN_REQUEST, request_plan, false),
	ROW(GEOID_ADD, request_geoid_add, true),
	ROW(GEOIDS_REQUEST, request_geoids, false),
	ROW(CACHE_STAT_REQUEST, request_cache_stat, false),
	ROW(CACHE_VERIFY, request_cache_verify, false),
	ROW(CACHE_GC, request_cache_gc, false),
	ROW(CACHE_ADOPT, request_cache_adopt, true),
	ROW(GEOID_REMOVE, request_geoid_remove, false),
	ROW(DOCTOR_REQUEST, request_doctor, false),
	ROW(METRICS_REQUEST, request_metrics, false),
	ROW(BACKUP, request_backup, false),
	ROW(BACKUP_NEXT, request_backup_next, false),
	ROW(BACKUP_END, request_backup_end, false),
	ROW(IMPORT, request_import, false),
	ROW(IMPORT_FILE, request_import_file, true),
	ROW(IMPORT_COMMIT, request_import_commit, false),
	ROW(SETTINGS_REQUEST, request_config, false),
#undef ROW
};

/* A violation of the protocol that the frames do not show. */
static bool is_violation(struct conn *c, uint32_t id, const Acut__V1__Message *m, struct err *err)
{
	struct request *q;

	if (!id) {
		err_set(err, ERR_PROTO, "a request has number 0");
		return true;
	}
	for (q = c->requests; q; q = q->next)
		if (q->id == id) {
			err_set(err, ERR_PROTO, "request %u is still being answered", id);
			return true;
		}
	if (!c->hello && m->body_case != ACUT__V1__MESSAGE__BODY_HELLO) {
		err_set(err, ERR_PROTO, "the first message is not Hello");
		return true;
	}
	return false;
}

static bool has_too_many(const struct conn *c, bool file, struct err *err)
{
	if (c->nrequests >= CONN_REQUESTS_MAX)
		err_set(err, ERR_BUSY, "more than %d requests are not answered yet", CONN_REQUESTS_MAX);
	else if (file && c->nfiles >= CONN_FILES_MAX)
		err_set(err, ERR_BUSY, "more than %d files are not answered yet", CONN_FILES_MAX);
	else
		return false;
	return true;
}

/* Closes the descriptor unless the handler takes one. */
void request_handle(struct conn *c, uint32_t id, Acut__V1__Message *m, int fd)
{
	const size_t rows = sizeof table / sizeof table[0];
	struct err err = ERR_INIT;
	struct request *q;
	size_t i;

	THREAD_LOOP_ONLY();
	for (i = 0; i < rows && table[i].body != m->body_case; i++)
		;
	if (is_violation(c, id, m, &err)) {
		io_close(fd);
		conn_fail(c, &err);
		return;
	}
	if (i == rows)
		err_set(&err, ERR_UNSUPPORTED, "this acutd does not know the request");
	else if (has_too_many(c, table[i].file, &err))
		;
	else if (table[i].file && fd < 0 && m->body_case == ACUT__V1__MESSAGE__BODY_INFO_REQUEST)
		err_set(&err, ERR_INPUT, "no descriptor came with the file");
	q = err.code ? NULL : request_new(c, id, 2 * frame_message_size(m), &err);
	if (err.code) {
		io_close(fd);
		conn_send_error(c, id, &err);
		return;
	}
	if (table[i].file) {
		q->files = 1;
		c->nfiles++;
	} else {
		fd = io_close(fd);
	}
	table[i].handle(c, q, m, fd);
}
