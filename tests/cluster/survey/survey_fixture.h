/* Inputs, runs and their datasets, for the tests of the phases from inputs to a dataset. Room tests only. */
#ifndef SURVEY_FIXTURE_H
#define SURVEY_FIXTURE_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <setjmp.h>
#include <cmocka.h>

#include "err.h"
#include "point.h"
#include "survey.h"

enum { FILES = 12, POINTS = 300 };

extern char survey_top[64]; /* the folder of a test */

/* What the callbacks were told. */
struct told {
	unsigned refused, warned;
	char all[4096];       /* "FILE: MESSAGE" lines */
	unsigned asked, stop; /* work is interrupted from that question on; 0: never */
	bool kills;           /* ... or the process is killed */
	bool left;            /* a commit was killed: the dataset's folder may have files that are not of the dataset */
};
extern struct told told;

void check(int r, const struct err *err);
struct survey_params params(void);

/* ---- inputs ---- */

struct inputs {
	char path[FILES + 4][128];
	struct work_input file[FILES + 4];
	size_t n;
};
void see(struct work_input *in); /* its size and time of now */
void add(struct inputs *in, const char *name, const char *text);
/* Three points, LAS 1.2 format 0, with the EPSG number of a projected system. */
void add_las(struct inputs *in, const char *name, uint16_t epsg, int32_t x);
/* Tiles in rows of four; some have more points than others. */
struct inputs tiles(void);

/* ---- runs ---- */

struct shape {
	uint32_t stages;
	uint64_t memory;
	uint32_t sorts;
};
extern const struct shape one_stage; /* stage */
struct work *open_work(const char *folder);
struct work *make_run(const struct inputs *in, const struct shape *shape);
void run_all(struct work *w, const struct survey_params *p);
uint64_t value_of(struct work *w, enum work_phase phase, uint32_t task, const char *key);

struct content {
	struct digest digest;
	uint64_t points;
	size_t sources, segments;
	struct digest hash[FILES]; /* of the sources, by their names */
	uint32_t id[FILES];
};
/* Also checks that the folder has what the manifest names, and no more, or no more that would be imported (told.left). */
struct content content_of(struct work *w);
void same(const struct content *a, const struct content *b);

int setup(void **state);
int teardown(void **state);
#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

#endif
