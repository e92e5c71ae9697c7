/* The statements of the catalogue, apart from the code that runs them. Only this room includes it. */
#ifndef CATALOGUE_SQL_H
#define CATALOGUE_SQL_H

#include <stdbool.h>

enum { CATALOGUE_VERSION = 4 };

enum catalogue_sql {
	CATALOGUE_PUT_DATASET,
	CATALOGUE_PUT_JOB,
	CATALOGUE_PUT_PUSH,
	CATALOGUE_DROP_DATASET,
	CATALOGUE_DROP_JOB,
	CATALOGUE_DROP_PUSH,
	CATALOGUE_SQLS,
	CATALOGUE_CHECK = CATALOGUE_SQLS /* has no statement: catalogue_verify */
};

extern const char *const catalogue_sql_text[CATALOGUE_SQLS];
extern const char catalogue_sql_setup[], catalogue_sql_schema[];
extern const char *const catalogue_sql_step[CATALOGUE_VERSION]; /* [n]: from version n to n + 1 */
/* With the columns in the order of the schema, as catalogue_load.c reads them. */
extern const char catalogue_sql_datasets[], catalogue_sql_jobs[], catalogue_sql_pushes[];

#endif
