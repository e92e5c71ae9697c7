/*
 * The schema and statements of the catalogue. AUTOINCREMENT makes SQLite remember the largest id in sqlite_sequence, also for
 * rows whose id we chose, so an id is never used twice.
 */
#include "catalogue_sql.h"

const char catalogue_sql_setup[] = "PRAGMA journal_mode = WAL;"
				   "PRAGMA synchronous = FULL;"
				   "PRAGMA foreign_keys = OFF;"
				   "PRAGMA temp_store = MEMORY;"
				   "PRAGMA mmap_size = 0;"
				   "PRAGMA cache_size = -256;";

/* The last column of each table is a checksum of the others (catalogue_sum.c). It is NULL in rows that an older version wrote. */

/* A removed dataset keeps its row for a while, but not its name: the names of the other datasets differ. */
#define DATASET_COLUMNS(more)                                                                                    \
	"(id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, uid INTEGER NOT NULL,"                       \
	" created_us INTEGER NOT NULL, pushed_us INTEGER NOT NULL, manifest TEXT NOT NULL,"                      \
	" generation INTEGER NOT NULL, points INTEGER NOT NULL, bytes INTEGER NOT NULL, files INTEGER NOT NULL," \
	" lattice TEXT NOT NULL, crs TEXT NOT NULL, unit_xy TEXT NOT NULL, unit_z TEXT NOT NULL,"                \
	" box_min INTEGER NOT NULL, box_max INTEGER NOT NULL, removed_us INTEGER NOT NULL DEFAULT 0,"            \
	" pinned INTEGER NOT NULL DEFAULT 0, oldest INTEGER NOT NULL DEFAULT 0,"                                 \
	" segments INTEGER NOT NULL DEFAULT 0," more " sum INTEGER);"
#define DATASET_RIGHTS " gid INTEGER NOT NULL, mode INTEGER NOT NULL,"
#define JOB_COLUMNS                                                                                     \
	"(id INTEGER PRIMARY KEY AUTOINCREMENT, dataset INTEGER NOT NULL, generation INTEGER NOT NULL," \
	" view TEXT NOT NULL, state TEXT NOT NULL, uid INTEGER NOT NULL, pid INTEGER NOT NULL,"         \
	" submitted_us INTEGER NOT NULL, finished_us INTEGER NOT NULL, report TEXT NOT NULL,"           \
	" error_code TEXT NOT NULL, error_message TEXT NOT NULL, error_file TEXT NOT NULL,"             \
	" error_field TEXT NOT NULL, error_hint TEXT NOT NULL, error_offset INTEGER NOT NULL,"          \
	" priority INTEGER NOT NULL DEFAULT 0, area TEXT NOT NULL DEFAULT '',"                          \
	" admin INTEGER NOT NULL DEFAULT 0, sum INTEGER);"
#define DATASET_NAMES "CREATE UNIQUE INDEX dataset_name ON dataset (name) WHERE removed_us = 0;"

const char catalogue_sql_schema[] = "BEGIN IMMEDIATE;"
				    "CREATE TABLE dataset " DATASET_COLUMNS(DATASET_RIGHTS) DATASET_NAMES
	"CREATE TABLE job " JOB_COLUMNS "CREATE TABLE push ("
	" id INTEGER PRIMARY KEY AUTOINCREMENT, dataset INTEGER NOT NULL, uid INTEGER NOT NULL,"
	" files INTEGER NOT NULL, begun_us INTEGER NOT NULL, sum INTEGER);"
	"PRAGMA user_version = 4;"
	"COMMIT;";

/* Columns of the checksums, as they were in version 3. */
#define DATASET_3                                                                                                          \
	"id, name, uid, created_us, pushed_us, manifest, generation, points, bytes, files, lattice, crs, unit_xy, unit_z," \
	" box_min, box_max, removed_us, pinned, oldest, segments"
#define JOB_3                                                                                                           \
	"id, dataset, generation, view, state, uid, pid, submitted_us, finished_us, report, error_code, error_message," \
	" error_file, error_field, error_hint, error_offset, priority, area"
/* A row with a valid checksum gets the checksum of its new form. Any other row keeps one that does not match. */
#define SUM(was, is) "CASE WHEN sum IS row_sum(" was ") THEN row_sum(" is ") ELSE sum END"
/* A row older than groups gets no group, and the mode that everybody had: rw-r--r--. */
#define OLD_RIGHTS "4294967295, 420"
#define MADE_ANEW(table)                                                            \
	"DELETE FROM sqlite_sequence WHERE name = '" table "_4';"                   \
	"UPDATE sqlite_sequence SET name = '" table "_4' WHERE name = '" table "';" \
	"DROP TABLE " table ";"                                                     \
	"ALTER TABLE " table "_4 RENAME TO " table ";"

const char *const catalogue_sql_step[CATALOGUE_VERSION] = {
	[1] = "BEGIN IMMEDIATE;"
	      "ALTER TABLE job ADD COLUMN priority INTEGER NOT NULL DEFAULT 0;"
	      "PRAGMA user_version = 2;"
	      "COMMIT;",
	/* A column cannot lose its UNIQUE. So the table is made again, and keeps its entry in sqlite_sequence. */
	[2] = "BEGIN IMMEDIATE;"
	      "CREATE TABLE dataset_3 " DATASET_COLUMNS(
		      "") "INSERT INTO dataset_3 SELECT id, name, uid, created_us, pushed_us, manifest, generation, points, bytes,"
			  " files, lattice, crs, unit_xy, unit_z, box_min, box_max, 0, 0, 0, 0, NULL FROM dataset;"
			  "DELETE FROM sqlite_sequence WHERE name = 'dataset_3';"
			  "UPDATE sqlite_sequence SET name = 'dataset_3' WHERE name = 'dataset';"
			  "DROP TABLE dataset;"
			  "ALTER TABLE dataset_3 RENAME TO dataset;" DATASET_NAMES
			  "ALTER TABLE job ADD COLUMN area TEXT NOT NULL DEFAULT '';"
			  "ALTER TABLE job ADD COLUMN sum INTEGER;"
			  "ALTER TABLE push ADD COLUMN sum INTEGER;"
			  "PRAGMA user_version = 3;"
			  "COMMIT;",
	/* The checksum stays the last column. */
	[3] = "BEGIN IMMEDIATE;"
	      "CREATE TABLE dataset_4 " DATASET_COLUMNS(
		      DATASET_RIGHTS) "INSERT INTO dataset_4 SELECT " DATASET_3 ", " OLD_RIGHTS
				      ", " SUM(DATASET_3, DATASET_3 ", " OLD_RIGHTS) " FROM dataset;" MADE_ANEW("dataset")
					      DATASET_NAMES
	"CREATE TABLE job_4 " JOB_COLUMNS "INSERT INTO job_4 SELECT " JOB_3
	", 0, " SUM(JOB_3, JOB_3 ", 0") " FROM job;" MADE_ANEW("job") "PRAGMA user_version = 4;"
								      "COMMIT;",
};

/* If another dataset has the name, nothing is written: REPLACE would remove that dataset. */
const char *const catalogue_sql_text[CATALOGUE_SQLS] = {
	[CATALOGUE_PUT_DATASET] =
		"INSERT INTO dataset VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)"
		" ON CONFLICT (id) DO UPDATE SET name = excluded.name, uid = excluded.uid,"
		" created_us = excluded.created_us, pushed_us = excluded.pushed_us, manifest = excluded.manifest,"
		" generation = excluded.generation, points = excluded.points, bytes = excluded.bytes,"
		" files = excluded.files, lattice = excluded.lattice, crs = excluded.crs,"
		" unit_xy = excluded.unit_xy, unit_z = excluded.unit_z, box_min = excluded.box_min,"
		" box_max = excluded.box_max, removed_us = excluded.removed_us, pinned = excluded.pinned,"
		" oldest = excluded.oldest, segments = excluded.segments, gid = excluded.gid, mode = excluded.mode, sum = excluded.sum",
	[CATALOGUE_PUT_JOB] = "INSERT OR REPLACE INTO job VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)",
	[CATALOGUE_PUT_PUSH] = "INSERT OR REPLACE INTO push VALUES (?,?,?,?,?,?)",
	[CATALOGUE_DROP_DATASET] = "DELETE FROM dataset WHERE id = ?",
	[CATALOGUE_DROP_JOB] = "DELETE FROM job WHERE id = ?",
	[CATALOGUE_DROP_PUSH] = "DELETE FROM push WHERE id = ?",
};

const char catalogue_sql_datasets[] = "SELECT * FROM dataset ORDER BY id";
const char catalogue_sql_jobs[] = "SELECT * FROM job ORDER BY id";
const char catalogue_sql_pushes[] = "SELECT * FROM push ORDER BY id";
