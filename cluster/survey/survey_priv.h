/* What the files of this room share. Internal. */
#ifndef SURVEY_PRIV_H
#define SURVEY_PRIV_H

#include <stdatomic.h>

#include "err.h"
#include "grid_manifest.h"
#include "input.h"
#include "names.h"
#include "survey.h"

/* The process itself, beside what a phase counts. */
enum { SURVEY_PROCESS_BYTES = 8 << 20 };
/* A source of a manifest that is read or written, with its texts. */
enum { SURVEY_SOURCE_BYTES = sizeof(struct grid_source) + 512 };

/* A phase that runs. */
struct survey;
typedef int (*survey_fn)(struct survey *, uint32_t task, struct err *err);
struct survey {
	struct work *work;
	const struct survey_params *p;
	survey_fn run;
	struct work_attempt *attempt;
	struct agree agree;
	struct grid_manifest *head; /* of the head's record, if it was read */
	size_t read_bytes;          /* the most that reading an input takes, by the head */
	atomic_bool impatient;      /* an input was waited for in vain: others are not */
};

/* Runs a task (work_run). 0: it has its record. */
int survey_run(struct work *, enum work_phase, uint32_t task, const struct survey_params *, survey_fn, struct err *err);
/* -ERR_LIMIT: a task has less memory. */
int survey_check_memory(const struct survey *, uint64_t bytes, const char *what, struct err *err);

/* Prepares survey.agree: what the command says. A geoid is read whole only in `head`; later it must be what the head saw. */
int survey_agree(struct survey *, const struct work_record *head, struct err *err);
/* The head's record and manifest, and what was agreed. */
int survey_take_head(struct survey *, struct err *err);

/* A manifest that a record names as that file; it is waited for. */
int survey_read_part(const struct survey *, const struct work_record *, size_t file, struct grid_manifest **ret, struct err *err);
/* The sources of a stage: a run of those of the head. */
void survey_share(const struct grid_manifest *head, uint32_t task, uint32_t tasks, size_t *ret_first, size_t *ret_end);

/* Keys that divide a segment into so many parts, for sort tasks (survey_sort.c). */
enum { SURVEY_PARTS = 64 };
int survey_note_keys(struct survey *, const struct grid_segment_info *, struct err *err);

/* Opens an input, which must be a regular file with that size and time; it is waited for. `check` again after it was read. */
int survey_open(struct survey *, const char *path, uint64_t size, int64_t mtime_ns, int *ret_fd, struct err *err);
int survey_unchanged(int fd, const char *path, uint64_t size, int64_t mtime_ns, const char *since, struct err *err);
struct input_options survey_input_options(const struct survey *, bool projects);

/* ---- survey_scratch.c ---- */

enum { SURVEY_SCRATCH_NAME = 4096 };
/* A new folder in that of --scratch, open; first removes those that killed tasks left there. ret "": there is none to remove. */
int survey_scratch_make(const struct survey *, uint32_t task, char ret[SURVEY_SCRATCH_NAME], int *ret_fd, struct err *err);
void survey_scratch_remove(const char *name); /* with everything in it */

/* ---- survey_table.c: the inputs of a head ---- */

struct survey_input {
	struct agree_input in;
	const struct work_input *file;          /* of survey_table.files */
	const char *overridden, *reading, *wkt; /* of survey_table.texts; NULL: none */
	uint64_t claimed, key;
	bool refused;
};

struct survey_table {
	struct work_input *files; /* an allocation with their texts */
	size_t nfiles;
	struct survey_input *input;
	size_t n;
	/* What many inputs share, each once. */
	struct survey_kept {
		void *bytes;
		size_t size;
		char key[DIGEST_HEX_SIZE];
	} * *kept;
	size_t nkept;
	struct names keys;
	size_t read_bytes; /* the most that reading one takes */
	size_t refused, first_refused;
	struct err first; /* of the first that is refused */
};

/* The inputs of the command, each path once. */
int survey_table_read(struct survey_table *, const struct work *, struct err *err);
void survey_table_free(struct survey_table *);
/* A copy that lives as long as the table. NULL: no memory. */
const void *survey_keep(struct survey_table *, const void *bytes, size_t size);

/* A text of a manifest: what is not UTF-8, or cannot be printed, becomes '?'. `text` may be longer than the result. */
void survey_clean_text(const char *text, char *ret, size_t size);

#endif
