/* Changes the catalogue of the fixture behind the back of the service. Include fixture.h first. */
#ifndef JOB_SQL_H
#define JOB_SQL_H

#include <sqlite3.h>

static void sql(const char *text)
{
	char path[128], *why = NULL;
	sqlite3 *db;

	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
	if (sqlite3_exec(db, text, NULL, NULL, &why) != SQLITE_OK)
		fail_msg("%s", why);
	sqlite3_close(db);
}

#endif
