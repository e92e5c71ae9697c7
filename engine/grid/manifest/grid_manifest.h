/*
 * Manifests: a file that describes a dataset. It names the segments, the sources (the files that were pushed) and the
 * generations, and says in which generations each source counts. What else is known of sources of points may be in files of their
 * own, which it names, so that not every generation writes all of it again. format.md describes the bytes.
 */
#ifndef GRID_MANIFEST_H
#define GRID_MANIFEST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "grid_segment_info.h"
#include "lattice.h"

struct err;
struct ledger;

/* The generations from `added` on and before `removed`. */
struct grid_span {
	uint64_t added, removed;
};

/* The records of lines are in a file of their own, "lines-ID" (breakline.h). Those that count in a generation together make its
 * line set: a source of kind GRID_LINE_VERTICES, whose records are in a segment, with the file "lineset-ID" (lineset.h). A
 * generation has at most one of these. It may have none: then it can be made of the files of lines. */
enum grid_source_kind { GRID_POINTS, GRID_LINES, GRID_LINE_VERTICES, GRID_SOURCE_KINDS };

/* Of a source of lines: its file "lines-ID" and its content. Of line vertices: the file "lineset-ID", the sum of the contents of
 * all lines that it is made of, and the records of "places-ID"; all else is 0. */
enum { GRID_LINE_KINDS = 4 }; /* as enum breakline_kind */
struct grid_lines {
	uint64_t features[GRID_LINE_KINDS], lines, vertices;
	uint64_t bytes; /* of the file */
	uint64_t places;
	struct digest content;
};
/* Bytes of a record of "places-ID": where lines cross, or their vertices differ in height (format.md). */
enum { GRID_PLACE_BYTES = 24 };

struct grid_source {
	uint32_t id;             /* > 0, never used twice in a dataset */
	uint8_t kind;            /* enum grid_source_kind */
	uint64_t added, removed; /* its generations; removed 0: it was not; added == removed: it never counted */
	/* Earlier spans of a source that was removed and then restored by generation `added`; ascending, all before it. */
	const struct grid_span *earlier;
	size_t nearlier;
	uint64_t points;
	const char *name;               /* file name as pushed, at most 255 bytes; NULL is "" */
	const char *path;               /* absolute path on the client, at most 4095 bytes; "": none (a pipe) */
	uint64_t size;                  /* of the input, in bytes; 0 if unknown */
	int64_t mtime_ns;               /* last change of the input, ns since 1970; 0 if unknown */
	struct digest hash;             /* XXH3-128 (seed 0) of the input's bytes, zero if unknown */
	const char *overridden;         /* the coordinate system that its header named and the push replaced; NULL is "": none */
	uint64_t left_out;              /* lines of a text that have no value for a coordinate */
	const char *reading;            /* how it was read (format.md); NULL is "": unknown */
	const struct grid_lines *lines; /* NULL: its kind is GRID_POINTS */
	/* The check of the file of sources that all of this is in (grid_sources_file), but its lives; 0: none. Who changes it
	 * sets this to 0. */
	uint64_t file;
};
/* Sizes of these texts, with the zero at the end. */
enum { GRID_SOURCE_NAME = 256, GRID_SOURCE_PATH = 4096, GRID_SOURCE_OVERRIDDEN = 512, GRID_SOURCE_READING = 1024 };

/* Whether the points of the source count in that generation. */
bool grid_source_live(const struct grid_source *, uint64_t generation);
/* One that was removed counts again from `generation` on. `spans` has room for nearlier + 1, which become its earlier ones.
 * -ERR_LIMIT: it has as many as a manifest can hold. */
int grid_source_restore(struct grid_source *, uint64_t generation, struct grid_span *spans, struct err *err);

/* Sources with consecutive numbers, of one kind and with the same lives. */
struct grid_batch {
	uint32_t first, n;
	uint8_t kind;            /* enum grid_source_kind */
	bool apart;              /* what else is known of them is in files of sources */
	uint64_t added, removed; /* as of a source, and the next two */
	const struct grid_span *earlier;
	size_t nearlier;
};
bool grid_batch_live(const struct grid_batch *, uint64_t generation);

/* A file of sources. It never changes. */
enum { GRID_SOURCES_FILES = 32 }; /* of a manifest, at most */
struct grid_sources_file {
	char name[64];
	uint64_t bytes, check;
	uint32_t n; /* sources in it */
};

enum grid_generation_kind {
	GRID_PUSH = 1,
	GRID_REVERT,  /* of generation `undoes` */
	GRID_REPLACE, /* a push that removes the sources that it replaces */
	GRID_PRUNE,   /* of all before generation `undoes` */
	GRID_IMPORT,
	GRID_KINDS
};
const char *grid_generation_kind_text(enum grid_generation_kind); /* "push" ... */

enum { GRID_USER = 64 };
struct grid_generation {
	uint64_t number;
	int64_t time_us; /* since 1970; 0 if unknown */
	uint32_t uid;
	const char *user; /* name of uid at that time, at most 63 bytes; NULL is "": unknown */
	enum grid_generation_kind kind;
	uint64_t undoes; /* 0: none */
	/* Sources that it added (restored ones too) and removed, and their points. */
	uint32_t files, files_removed;
	uint64_t points_added, points_removed;
	uint64_t lines_added, lines_removed; /* of the sources of lines */
	struct digest content;               /* sum of the hashes of the files that it added */
};

enum { GRID_GEOID = 128, GRID_WKT = 32769 };

struct grid_manifest {
	struct lattice lattice;
	char crs[512], unit_xy[16], unit_z[16];
	/* How the heights of the sources were converted: "", or "orthometric HASH NAME" or "ellipsoidal HASH NAME" of
	 * the geoid grid that was used. */
	char geoid[GRID_GEOID];
	/* The coordinate system as an input carries it, one line of at most 32,768 bytes; NULL is "": none did. The generation
	 * from which on it is known. */
	const char *wkt;
	uint64_t wkt_since;
	char choices[256];   /* of a push that is not committed: how its files were read; else "" */
	uint64_t generation; /* the newest */
	uint64_t oldest;     /* the oldest that can still be read; 0 is 1 */
	struct grid_segment_info *segments;
	size_t nsegments;
	struct grid_source *sources;
	size_t nsources;
	/* They may be of an older manifest: sources in other files than these are written again. */
	struct grid_sources_file *files;
	size_t nfiles;
	/* Ascending by number. Some may be missing: the manifest of a selection has none. For a manifest before version 4
	 * they are derived from its sources, as pushes of unknown times and users. */
	struct grid_generation *generations;
	size_t ngenerations;
	/* Only in a manifest that was read, up to the end. All sources in their order; how many these are; whether `sources` has
	 * only those that are not in files of sources. */
	struct grid_batch *batches;
	size_t nbatches;
	uint64_t nall;
	bool bare;
	/* Memory of its texts (those of files of sources: names) and spans, and what it charges to LEDGER_MANIFEST. */
	char *texts, *names;
	size_t texts_bytes;
	struct grid_span *spans;
	size_t nspans;
	struct grid_lines *lines;
	size_t nlines;
	struct ledger *ledger;
	uint64_t charged;
};

/* With all sources in the manifest itself. */
int grid_manifest_write(int dirfd, const char *name, const struct grid_manifest *, struct err *err);
/* With files of sources: those of m->files that have no source which is gone, and a new one if more than grid_sources_here
 * sources of points are in none. Then it also takes in older files, so that there are few. */
struct grid_apart {
	const char *name; /* of the new file in the manifest; NULL: "sources-" and its check, so that it never has other bytes */
	const char *as;   /* the name that it gets now; the caller gives it the other one. NULL: the same, which is not NULL */
	bool made;        /* there is a new file */
	struct grid_sources_file file; /* ... this one, as the manifest names it */
	/* Of m->files: not named any more. */
	char dropped[GRID_SOURCES_FILES][64];
	unsigned ndropped;
};
extern unsigned grid_sources_here; /* tests set less */
int grid_manifest_write_apart(int dirfd, const char *name, struct grid_apart *, const struct grid_manifest *m, struct err *err);
int grid_manifest_read(int dirfd, const char *name, struct grid_manifest **ret, struct err *err);
/* The same; its memory is charged to `ledger` (LEDGER_MANIFEST; may be NULL) before the file is read, until it is
 * freed. -ERR_BUSY: the memory is not free now; -ERR_LIMIT: it is more than half of the total. */
int grid_manifest_load(int dirfd, const char *name, struct ledger *, struct grid_manifest **ret, struct err *err);
/* The same without files of sources: of those in it, only the batches are known. For who needs no names, sizes and points of
 * sources. */
int grid_manifest_load_bare(int dirfd, const char *name, struct ledger *, struct grid_manifest **ret, struct err *err);
/* Then reads these files, too; pointers to sources are no longer valid. */
int grid_manifest_complete(int dirfd, struct grid_manifest *, struct err *err);
/* Reads one of them, and checks it. */
int grid_sources_verify(int dirfd, const struct grid_manifest *, size_t file, struct err *err);
struct grid_manifest *grid_manifest_free(struct grid_manifest *);
/* All sources of a manifest, also of one that was not read, as batches ascending by number; to be freed. NULL: no memory. */
struct grid_batch *grid_batches_sorted(const struct grid_manifest *, size_t *ret_n);
uint64_t grid_manifest_all(const struct grid_manifest *); /* how many sources these are */
/* Of these. NULL: there is no such source. */
const struct grid_batch *grid_batches_find(const struct grid_batch *, size_t n, uint32_t source);
/* A file that a manifest names, in its folder. */
struct grid_named {
	char name[64];
	uint64_t bytes;
	const struct grid_source *source; /* NULL: a segment, or of_sources */
	bool of_sources;                  /* it is a file of sources */
};
enum { GRID_SOURCE_FILES = 2 };
/* The files of a source beside its records in segments, at most GRID_SOURCE_FILES. */
size_t grid_source_files(const struct grid_source *, struct grid_named ret[GRID_SOURCE_FILES]);
/* All files, the segments first, whether it is bare or not. `at` is zero at the beginning. False: there are no more. */
struct grid_named_at {
	size_t i;
	unsigned of;
};
bool grid_manifest_next_file(const struct grid_manifest *, struct grid_named_at *at, struct grid_named *ret);
size_t grid_manifest_files(const struct grid_manifest *); /* how many */
bool grid_manifest_has_file(const struct grid_manifest *, const char *name);
/* Bytes of all of them. */
uint64_t grid_manifest_bytes(const struct grid_manifest *);
/* The number of live sources of lines in that generation, and the sum of their contents. */
size_t grid_manifest_lines(const struct grid_manifest *, uint64_t generation, struct digest *ret);
/* The live source of line vertices in that generation; NULL: there are no lines, or their line set was not kept. */
const struct grid_source *grid_manifest_line_vertices(const struct grid_manifest *, uint64_t generation);
/* That generation has lines, and no line set. */
bool grid_manifest_lacks_line_set(const struct grid_manifest *, uint64_t generation);
/* The records of a source of line vertices are in a segment of their own, which has this name without ".seg". */
void grid_line_segment(uint32_t source, char ret_stem[32]);
bool grid_is_line_segment(const char *file);
/* The WKT that is known in that generation; "": none. */
const char *grid_manifest_wkt(const struct grid_manifest *, uint64_t generation);
uint64_t grid_manifest_oldest(const struct grid_manifest *); /* `oldest`, or 1; 0: no generation can be read */
/* Sets files, points and content of these generations (ascending by number) from the sources. Correct for all
 * generations after the oldest, and for the oldest if it is 1; earlier sources may have been pruned. */
void grid_generations_tally(const struct grid_manifest *, struct grid_generation *, size_t n);

#endif
