/* A spool as push reads it: its head, its profile, and passes over its records. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "scan_profile.h"
#include "scan_source.h"

enum { ASK_EVERY = 256 }; /* records between two checks for a stop */

/* ---- the head ---- */

static int open_file(const char *file, int *ret, struct err *err)
{
	int fd = open(file, O_RDONLY | O_CLOEXEC);

	if (fd < 0) {
		if (errno == ENOENT || errno == ENOTDIR)
			err_set(err, ERR_INPUT, "there is no such file");
		else
			err_sys(err, errno, "it cannot be opened");
		return err_add_file(err, file);
	}
	*ret = fd;
	return 0;
}

static int reader_open(const char *file, struct spool_reader **ret, struct err *err)
{
	int fd = -1, r = open_file(file, &fd, err);

	return r ? r : spool_open(fd, file, ret, err);
}

static int named(struct program *args, struct profile *ret, struct err *err)
{
	struct scan_profile found;
	struct profile_set *set = NULL;
	int r = scan_profile_set(args, &set, err);

	if (!r)
		r = scan_profile_named(set, args->profile, &found, err);
	if (!r) {
		*ret = found.profile;
		scan_profile_done(&found);
	}
	profile_set_free(set);
	return r;
}

static int find_profile(struct program *args, struct scan_spool *s, struct err *err)
{
	const struct spool_head *h = &s->head;
	char name[SPOOL_TEXT_SIZE + 32];
	int r;

	if (args->profile)
		return named(args, &s->profile, err);
	if (!h->profile_size) {
		err_set(err, ERR_INPUT, "the spool has no profile, which defines its bytes");
		err_add_hint(err, "name it with --profile NAME");
		return err_add_file(err, s->file);
	}
	snprintf(name, sizeof name, "%s (in the spool)", h->profile_name);
	r = profile_parse(h->profile, h->profile_size, h->profile_name, name, &s->profile, err);
	return r ? err_add_hint(err, "decode it by another one, with --profile NAME") : 0;
}

static int copy_head(const struct spool_head *from, struct spool_head *to, struct err *err)
{
	*to = *from;
	to->profile = NULL;
	if (!from->profile)
		return 0;
	to->profile = strndup(from->profile, from->profile_size);
	return to->profile ? 0 : err_set(err, ERR_NOMEM, "no memory for a profile");
}

int scan_spool_open(struct program *args, const char *file, struct scan_spool *ret, struct err *err)
{
	struct spool_reader *reader = NULL;
	int r = reader_open(file, &reader, err);

	memset(ret, 0, sizeof *ret);
	ret->file = file;
	if (!r)
		r = copy_head(spool_reader_head(reader), &ret->head, err);
	spool_reader_free(reader);
	if (!r)
		r = find_profile(args, ret, err);
	if (!r) {
		for (int i = 0; i < 16; i++)
			sprintf(ret->id + 2 * i, "%02x", ret->head.id[i]);
		ret->decoder = decoder_find(ret->profile.decoder);
		if (!ret->decoder) {
			err_set(err, ERR_INPUT, "its profile %.60s asks for a decoder \"%.60s\" that there is not",
				ret->profile.name, ret->profile.decoder);
			r = err_add_file(err, file);
		}
	}
	if (r)
		scan_spool_clear(ret);
	return r;
}

void scan_spool_clear(struct scan_spool *s)
{
	spool_head_clear(&s->head);
	memset(s, 0, sizeof *s);
}

/* ---- a pass ---- */

struct pass {
	struct scan_spool *spool;
	struct spool_reader *reader;
	struct replay *replay;
	bool (*stop)(void *ctx);
	void *ctx;
	uint64_t records, damaged;
};

/* 1: a record; 0: the end of what this pass reads. */
static int next(struct pass *p, struct spool_record *ret, struct err *err)
{
	uint64_t skipped;
	int r;

	if (p->spool->passed && p->records == p->spool->records)
		return 0;
	while ((r = spool_next(p->reader, ret, err)) == -ERR_INPUT) {
		err_clear(err);
		r = spool_skip(p->reader, &skipped, err);
		if (r)
			return r;
		p->damaged += skipped;
		r = replay_gap(p->replay);
		if (r)
			return r;
	}
	p->records += r == 1;
	return r;
}

static int run(struct pass *p, bool *ret_over, struct err *err)
{
	struct spool_record record;
	int r;

	*ret_over = false;
	while ((r = next(p, &record, err)) > 0) {
		if (p->records % ASK_EVERY == 0 && (p->stop ? p->stop(p->ctx) : scan_stopped()))
			return err_set(err, ERR_CANCELLED, "interrupted");
		r = replay_record(p->replay, &record);
		if (r)
			return r;
	}
	*ret_over = r == 0;
	return r ? r : replay_end(p->replay);
}

int scan_spool_pass(struct scan_spool *s, const struct replay_sinks *sinks, bool (*stop)(void *ctx), struct err *err)
{
	const struct replay_clock clock = replay_clock_of(&s->head);
	struct pass p = {.spool = s, .stop = stop, .ctx = sinks->ctx};
	bool over = false;
	int r = reader_open(s->file, &p.reader, err);

	if (!r && memcmp(spool_reader_head(p.reader)->id, s->head.id, sizeof s->head.id))
		r = err_set(err, ERR_CHANGED, "another spool has taken its place");
	if (!r)
		r = replay_new(&s->profile, &clock, sinks, &p.replay, err);
	if (!r)
		r = run(&p, &over, err);
	if (!r && over && s->passed && (p.records != s->records || p.damaged != s->damaged))
		r = err_set(err, ERR_CHANGED, "it became shorter while it was read");
	if (!r && over && !s->passed) {
		s->passed = true;
		s->records = p.records;
		s->damaged = p.damaged;
		spool_tail(p.reader, &s->tail);
		replay_counts(p.replay, &s->counts);
	}
	replay_free(p.replay);
	spool_reader_free(p.reader);
	return r < 0 ? err_add_file(err, s->file) : r;
}
