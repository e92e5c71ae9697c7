/*
 * Requests about backups, exports and imports. Each open one belongs to its connection and ends with it. A client sends one
 * request about it at a time.
 */
#include <stdlib.h>

#include "copy.h"
#include "io.h"
#include "server_priv.h"

struct conn_copy {
	struct conn_copy *next;
	struct backup *backup; /* or */
	struct import *import;
};

/* Ends the copy, which is the first of this list. */
static void end_copy(struct conn_copy **at)
{
	struct conn_copy *o = *at;

	*at = o->next;
	if (o->backup)
		backup_end(o->backup);
	else
		import_end(o->import);
	free(o);
}

void conn_copies_end(struct conn *c)
{
	while (c->copies)
		end_copy(&c->copies);
}

/* Adds an open copy to its connection. If the client has left meanwhile, or there is no memory, the copy ends at once. */
static bool add_copy(struct conn *c, struct backup *b, struct import *i)
{
	struct conn_copy *o = c->closed ? NULL : calloc(1, sizeof *o);

	if (!o) {
		if (b)
			backup_end(b);
		else
			import_end(i);
		return false;
	}
	*o = (struct conn_copy){.next = c->copies, .backup = b, .import = i};
	c->copies = o;
	return true;
}

static struct conn_copy **find_copy(struct conn *c, uint64_t backup, uint64_t import)
{
	struct conn_copy **at;

	for (at = &c->copies; *at; at = &(*at)->next)
		if ((*at)->backup ? backup && backup_id((*at)->backup) == backup : import && import_id((*at)->import) == import)
			break;
	return at;
}

/* NULL: there is no such copy, and the request is refused. */
static struct conn_copy *open_copy(struct conn *c, struct request *q, uint64_t backup, uint64_t import)
{
	struct conn_copy *o = *find_copy(c, backup, import);
	struct err err = ERR_INIT;

	if (!o) {
		err_set(&err, ERR_NOTFOUND, "this connection has no %s %llu open", backup ? "backup" : "import",
			(unsigned long long)(backup ? backup : import));
		request_refuse(q, &err);
	}
	return o;
}

static void refuse_no_memory(struct request *q)
{
	struct err err = ERR_INIT;

	err_set(&err, ERR_NOMEM, "no memory for a request");
	request_refuse(q, &err);
}

/* ---- out ---- */

static void on_ready(void *token, const struct err *why, const struct backup_ready *r)
{
	Acut__V1__BackupReady m = ACUT__V1__BACKUP_READY__INIT;
	struct request *q = token;
	struct frame_error error;

	if (why) {
		request_refuse(q, why);
		return;
	}
	m.backup = r->id;
	m.files = r->files;
	m.bytes = r->bytes;
	m.damaged = r->ndamaged;
	if (r->ndamaged) {
		frame_error_from_err(r->damaged, &error);
		m.damage = &error.body;
	}
	m.identity = (char *)r->identity;
	m.n_places = 4;
	m.places = (uint64_t *)r->place;
	if (add_copy(q->conn, r->backup, NULL))
		request_answer(q, FRAME_MESSAGE(BACKUP_READY, backup_ready, &m));
	else
		refuse_no_memory(q);
}

void request_backup(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	backup_begin(c->server->service->copies, m->backup->dataset, &c->peer, on_ready, q);
}

static void on_next(void *token, const struct err *why, const struct backup_file *f)
{
	Acut__V1__BackupFile m = ACUT__V1__BACKUP_FILE__INIT;
	struct request *q = token;
	struct conn *c = q->conn;
	uint32_t id = q->id;

	if (why) {
		request_refuse(q, why);
		return;
	}
	m.last = !f;
	if (f) {
		m.name = (char *)f->name;
		m.size = f->size;
		m.lasting = f->lasting;
	}
	request_free(q);
	conn_send(c, id, FRAME_MESSAGE(BACKUP_FILE, backup_file, &m), f ? f->fd : -1);
}

void request_backup_next(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct conn_copy *o = open_copy(c, q, m->backup_next->backup, 0);

	if (o)
		backup_next(o->backup, on_next, q);
}

void request_backup_end(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	if (!open_copy(c, q, m->backup_end->backup, m->backup_end->import))
		return;
	end_copy(find_copy(c, m->backup_end->backup, m->backup_end->import));
	request_answer_done(q);
}

/* ---- in ---- */

static void on_begun(void *token, const struct err *why, struct import *i)
{
	Acut__V1__Importing m = ACUT__V1__IMPORTING__INIT;
	struct request *q = token;

	if (why) {
		request_refuse(q, why);
		return;
	}
	m.import = import_id(i);
	if (add_copy(q->conn, NULL, i))
		request_answer(q, FRAME_MESSAGE(IMPORTING, importing, &m));
	else
		refuse_no_memory(q);
}

void request_import(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	uint32_t mode = DATASET_MODE;
	struct err err = ERR_INIT;
	bool has;

	if (request_mode(m->import->mode, &has, &mode, &err))
		request_refuse(q, &err);
	else
		import_begin(c->server->service->copies, m->import->dataset, mode, &c->peer, on_begun, q);
}

static void on_file(void *token, const struct err *why)
{
	request_finish(token, why);
}

void request_import_file(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct conn_copy *o = open_copy(c, q, 0, m->import_file->import);

	if (o)
		import_file(o->import, m->import_file->name, fd, on_file, q);
	else
		io_close(fd);
}

static void on_imported(void *token, const struct err *why, const struct imported *i)
{
	Acut__V1__Imported m = ACUT__V1__IMPORTED__INIT;

	if (why) {
		request_refuse(token, why);
		return;
	}
	m.dataset = (char *)i->dataset;
	m.generation = i->generation;
	m.points = i->points;
	request_answer(token, FRAME_MESSAGE(IMPORTED, imported, &m));
}

void request_import_commit(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct conn_copy *o = open_copy(c, q, 0, m->import_commit->import);

	if (o)
		import_commit(o->import, on_imported, q);
}
