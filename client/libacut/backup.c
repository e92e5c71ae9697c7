/* Backups, exports, imports: one descriptor after the other, each a request with one answer. */
#include <string.h>
#include <unistd.h>

#include "call.h"

/* Relative, of plain parts: a malicious daemon must not lead a client out of its folder. */
static bool name_ok(const char *name)
{
	size_t n = strlen(name);

	if (!n || n > 300 || *name == '/' || name[n - 1] == '/')
		return false;
	for (const char *part = name; part; part = strchr(part, '/') ? strchr(part, '/') + 1 : NULL)
		if (*part == '.' || *part == '/' || !*part)
			return false;
	return true;
}

/* 0: *ret_more is whether there was one. */
static int one(struct acut *a, uint64_t backup, const struct acut_backup_sink *sink, bool *ret_more)
{
	Acut__V1__BackupNext req = ACUT__V1__BACKUP_NEXT__INIT;
	struct acut_backup_file f;
	Acut__V1__Message *m;
	int fd = -1, r;
	uint32_t id;

	req.backup = backup;
	r = call_send(a, FRAME_MESSAGE(BACKUP_NEXT, backup_next, &req), -1, &id);
	if (r == 0)
		r = call_next(a, id, &m, &fd);
	if (r < 0)
		return r;
	if (m->body_case != ACUT__V1__MESSAGE__BODY_BACKUP_FILE) {
		r = call_unexpected(a, m);
	} else if (m->backup_file->last) {
		*ret_more = false;
	} else if (fd < 0 || !name_ok(m->backup_file->name)) {
		r = err_set(&a->err, ERR_PROTO, "the daemon sent %s",
			    fd < 0 ? "a name without a descriptor" : "a name that climbs");
	} else {
		f = (struct acut_backup_file){
			.name = m->backup_file->name, .size = m->backup_file->size, .lasting = m->backup_file->lasting, .fd = fd};
		r = sink->file(sink->ctx, &f);
	}
	if (fd >= 0)
		close(fd);
	frame_message_free(m);
	return r;
}

int acut_backup(struct acut *a, const char *dataset, const struct acut_backup_sink *sink)
{
	Acut__V1__Backup req = ACUT__V1__BACKUP__INIT;
	Acut__V1__BackupEnd end = ACUT__V1__BACKUP_END__INIT;
	struct acut_backup_ready ready;
	Acut__V1__Message *m;
	bool more = true;
	uint32_t id;
	int r;

	/* On the wire no name is all of them. */
	if (dataset && !*dataset) {
		r = call_begin(a);
		return r < 0 ? r : err_set(&a->err, ERR_NOTFOUND, "there is no dataset \"\"");
	}
	req.dataset = call_text(dataset);
	r = call_ask(a, FRAME_MESSAGE(BACKUP, backup, &req), -1, ACUT__V1__MESSAGE__BODY_BACKUP_READY);
	if (r < 0)
		return r;
	end.backup = a->answer->backup_ready->backup;
	ready = (struct acut_backup_ready){.files = a->answer->backup_ready->files,
					   .bytes = a->answer->backup_ready->bytes,
					   .damaged = a->answer->backup_ready->damaged};
	if (a->answer->backup_ready->damage)
		call_wire_failure(a->answer->backup_ready->damage, &ready.damage);
	else
		ready.damaged = 0;
	ready.identity = a->answer->backup_ready->identity;
	if (a->answer->backup_ready->n_places == 4) {
		ready.state_device = a->answer->backup_ready->places[0];
		ready.state_inode = a->answer->backup_ready->places[1];
		ready.cache_device = a->answer->backup_ready->places[2];
		ready.cache_inode = a->answer->backup_ready->places[3];
	}
	if (sink->ready)
		r = sink->ready(sink->ctx, &ready);
	while (!r && more)
		r = one(a, end.backup, sink, &more);
	/* After a failure too, as far as possible: otherwise the daemon keeps it until the connection ends. */
	if (a->dead.code)
		return r;
	if (r) {
		call_send(a, FRAME_MESSAGE(BACKUP_END, backup_end, &end), -1, &id);
		return r;
	}
	r = call_again(a, FRAME_MESSAGE(BACKUP_END, backup_end, &end), -1, ACUT__V1__MESSAGE__BODY_DONE, &id, &m);
	if (r == 0)
		frame_message_free(m);
	return r;
}

static int send_files(struct acut *a, uint64_t import, int (*next)(void *ctx, const char **ret_name, int *ret_fd), void *ctx)
{
	Acut__V1__ImportFile req = ACUT__V1__IMPORT_FILE__INIT;
	Acut__V1__Message *m;
	const char *name;
	uint32_t id;
	int fd, r;

	req.import = import;
	for (;;) {
		name = NULL;
		r = next(ctx, &name, &fd);
		if (r || !name)
			return r;
		r = call_file(a, fd, name);
		req.name = (char *)name;
		if (r == 0)
			r = call_again(a, FRAME_MESSAGE(IMPORT_FILE, import_file, &req), fd, ACUT__V1__MESSAGE__BODY_DONE, &id,
				       &m);
		if (r)
			return r;
		frame_message_free(m);
	}
}

int acut_import(struct acut *a, const char *dataset, int (*next)(void *ctx, const char **ret_name, int *ret_fd), void *ctx,
		const struct acut_imported **ret)
{
	Acut__V1__Import req = ACUT__V1__IMPORT__INIT;
	Acut__V1__ImportCommit commit = ACUT__V1__IMPORT_COMMIT__INIT;
	Acut__V1__BackupEnd end = ACUT__V1__BACKUP_END__INIT;
	Acut__V1__Message *m = NULL;
	uint32_t id;
	int r;

	req.mode = call_mode(a);
	req.dataset = call_text(dataset);
	r = call_ask(a, FRAME_MESSAGE(IMPORT, import, &req), -1, ACUT__V1__MESSAGE__BODY_IMPORTING);
	if (r < 0)
		return r;
	commit.import = end.import = a->answer->importing->import;
	r = send_files(a, end.import, next, ctx);
	if (!r)
		r = call_again(a, FRAME_MESSAGE(IMPORT_COMMIT, import_commit, &commit), -1, ACUT__V1__MESSAGE__BODY_IMPORTED, &id,
			       &m);
	if (!a->dead.code)
		call_send(a, FRAME_MESSAGE(BACKUP_END, backup_end, &end), -1, &id);
	if (r)
		return r;
	frame_message_free(a->answer);
	a->answer = m;
	a->imported = (struct acut_imported){
		.dataset = m->imported->dataset, .generation = m->imported->generation, .points = m->imported->points};
	*ret = &a->imported;
	return 0;
}
