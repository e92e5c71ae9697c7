/*
 * The catalogue after a disk error, or without memory within a change.
 *
 * The model: a commit whose fsync failed may or may not be durable, and a second fsync would report success either way. So
 * nothing is tried again on that connection. It is closed, which discards what was not committed, and the database is opened
 * again. A checkpoint rewrites everything that counts, and syncs it. Then the failed change is looked up: if it is there, it was
 * made; otherwise it has failed. If even that fails, the catalogue is uncertain: the objects of the change must stay, since the
 * next start follows the catalogue. Every later change fails, or begins by opening the database.
 */
#include "catalogue_priv.h"

#include <string.h>

#include "err.h"
#include "log.h"

static int reopen(struct catalogue *c, struct err *err)
{
	int r;

	catalogue_close(c);
	c->io_failed = false;
	r = catalogue_open(c, c->path, err);
	if (!r && c->io_failed)
		r = err_set(err, ERR_IO, "the catalogue cannot be written to the disk");
	if (r)
		catalogue_close(c);
	return r;
}

static const char *select_row(enum catalogue_sql sql)
{
	switch (sql) {
	case CATALOGUE_PUT_DATASET:
	case CATALOGUE_DROP_DATASET:
		return "SELECT * FROM dataset WHERE id = ?";
	case CATALOGUE_PUT_JOB:
	case CATALOGUE_DROP_JOB:
		return "SELECT * FROM job WHERE id = ?";
	case CATALOGUE_PUT_PUSH:
	case CATALOGUE_DROP_PUSH:
		return "SELECT * FROM push WHERE id = ?";
	default:
		return NULL;
	}
}

/* Columns are in the order of a change's values, followed by their checksum. */
static bool row_equals(sqlite3_stmt *s, const struct change *ch)
{
	if ((unsigned)sqlite3_column_count(s) != ch->n + 1)
		return false;
	for (unsigned i = 0; i < ch->n; i++) {
		const struct value *v = &ch->value[i];
		const char *text = v->kind == VALUE_TEXT ? (const char *)sqlite3_column_text(s, (int)i) : NULL;

		if (v->kind == VALUE_TEXT ? !text || strcmp(text, v->text) != 0 : sqlite3_column_int64(s, (int)i) != v->number)
			return false;
	}
	return true;
}

/* Looks up whether the database has the change. */
static int find_change(struct catalogue *c, const struct change *ch, bool *ret_made, struct err *err)
{
	const char *sql = select_row(ch->sql);
	sqlite3_stmt *s;
	int step;

	*ret_made = false;
	if (!sql)
		return 0;
	if (sqlite3_prepare_v2(c->db, sql, -1, &s, NULL) != SQLITE_OK)
		return catalogue_failed(c, err, "the catalogue cannot be read");
	sqlite3_bind_int64(s, 1, ch->value[0].number);
	step = sqlite3_step(s);
	if (step == SQLITE_ROW)
		*ret_made = ch->n > 1 && row_equals(s, ch);
	else if (step == SQLITE_DONE)
		*ret_made = ch->n == 1;
	sqlite3_finalize(s);
	return step == SQLITE_ROW || step == SQLITE_DONE ? 0 : catalogue_failed(c, err, "the catalogue cannot be read");
}

void catalogue_after_error(struct catalogue *c, struct change *ch, struct err *why)
{
	struct err err = ERR_INIT;
	bool made = false;
	int r;

	log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL,
		      why->code == ERR_NOMEM ? "no memory for the catalogue: it is opened again" :
					       "an error of the disk: the catalogue is opened again",
		      why);
	r = reopen(c, &err);
	if (!r && ch->r)
		r = find_change(c, ch, &made, &err);
	if (r) {
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue is closed", &err);
		if (ch->r)
			atomic_store(&c->uncertain, true);
		catalogue_close(c);
		err_add_hint(why, "check the disk of the state folder, then start acutd again: what was acknowledged is there");
		return;
	}
	if (ch->r && made)
		ch->r = 0;
}

int catalogue_reopen(struct catalogue *c, struct err *err)
{
	struct err why = ERR_INIT;

	if (c->db || !reopen(c, &why))
		return 0;
	err_set(err, ERR_IO, "the catalogue is closed after an error of the disk: %.300s", why.message);
	return err_add_hint(err, "check the disk of the state folder, then start acutd again: what was acknowledged is there");
}

bool catalogue_is_uncertain(struct catalogue *c)
{
	return atomic_load(&c->uncertain);
}
