/*
 * Views that name files of a dataset. A worker reads the manifest and puts the numbers of the sources in their place; then the
 * request goes on as others do, in the generation that was read.
 */
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "ledger.h"
#include "rights.h"
#include "server_priv.h"

struct named_view {
	struct request *request;
	struct ledger *ledger;
	struct job_params params; /* the texts are copies */
	bool plan, paths;
	atomic_bool left; /* the connection is closed */
	char *view, *priority, *made;
};

static void named_free(struct named_view *v)
{
	free(v->view);
	free(v->priority);
	free(v->made);
	free(v);
}

static int look_for_files(void *token, int dirfd, const struct grid_manifest *m, struct err *err)
{
	struct named_view *v = token;
	size_t bytes = job_sources_bytes(m);
	int r;

	(void)dirfd;
	v->params.generation = v->params.generation ? v->params.generation : m->generation;
	if (!ledger_take(v->ledger, LEDGER_MANIFEST, bytes)) {
		err_set(err, ERR_BUSY, "no memory for the names of files: %zu bytes are not free", bytes);
		return err_add_hint(err, "try again later, or start acutd with more --memory");
	}
	r = job_sources(v->view, m, v->params.generation, v->paths, &v->left, &v->made, err);
	ledger_give(v->ledger, LEDGER_MANIFEST, bytes);
	return r;
}

static void on_files(void *token, const struct err *why, const struct dataset *d, const struct grid_manifest *m)
{
	struct named_view *v = token;
	struct jobs *jobs = v->request->conn->server->service->jobs;
	struct err err = ERR_INIT;

	v->request->named = NULL;
	if (!why && !m) {
		err_set(&err, ERR_NOTFOUND, "the dataset has no files yet");
		why = &err;
	}
	/* A generation that is gone has a better message. */
	if (v->params.generation && dataset_check_generation(d, v->params.generation, &err))
		why = &err;
	/* Nobody would know the job. */
	if (!why && atomic_load(&v->left)) {
		err_set(&err, ERR_CANCELLED, "the client has left");
		why = &err;
	}
	v->params.view = v->made;
	if (why)
		request_refuse(v->request, why);
	else if (v->plan)
		job_plan(jobs, v->params.dataset, v->params.generation, v->made, &v->params.peer, request_planned, v->request);
	else
		job_submit(jobs, &v->params, request_submitted, v->request);
	named_free(v);
}

void request_named_leave(struct named_view *v)
{
	atomic_store(&v->left, true);
}

void request_named_view(struct request *q, const struct job_params *params, bool plan)
{
	struct named_view *v = calloc(1, sizeof *v);
	struct err err = ERR_INIT;
	struct dataset_info info;

	if (v) {
		v->view = strdup(params->view);
		v->priority = strdup(params->priority ? params->priority : "");
	}
	if (!v || !v->view || !v->priority) {
		if (v)
			named_free(v);
		err_set(&err, ERR_NOMEM, "no memory for a view");
		request_refuse(q, &err);
		return;
	}
	/* Only who may see paths can name files by them. */
	dataset_info(params->dataset, &info);
	v->paths = rights_allow(&params->peer, RIGHT_OWN, info.uid, info.gid, info.mode);
	v->request = q;
	q->named = v;
	v->ledger = q->conn->server->p.ledger;
	v->plan = plan;
	v->params = *params;
	v->params.priority = v->priority;
	dataset_look(params->dataset, &params->peer, look_for_files, on_files, v);
}
