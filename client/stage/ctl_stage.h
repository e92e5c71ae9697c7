/* Inputs into a dataset: all headers, then all points, then the commit that makes them visible. */
#ifndef CTL_STAGE_H
#define CTL_STAGE_H

#include "ctl_input.h"

struct ctl_stage_options {
	const char *scale, *utm, *geoid, *geoid_way, *mode, *replaces; /* NULL: not given */
	const char *assume_crs, *assume_units, *override_crs, *override_units;
	bool planar, strict, checksum, add, replace;
};

struct ctl_staged {
	const struct ctl_stage_options *opt;
	char dataset[256];
	uint64_t generation, points;
	bool committed; /* also where that made no generation: then the dataset may have none, and not be there */
	bool unchanged; /* it made none */
	unsigned good, refused, known, adopted; /* adopted ones are known ones too */
	struct ctl_staged_file {
		char *name;
		bool refused;
		int known; /* of struct acut_probe */
		uint64_t points, moved, bytes_read, bytes;
		uint64_t left_out; /* lines */
		bool partial;
		uint32_t replaced; /* files of the dataset */
		double shift[3];
		char *warning;        /* NULL: none */
		char *projected_from; /* of its degrees; NULL: they were not projected */
		char *overridden;     /* what its records declare, which was overridden; NULL: nothing was */
		uint64_t shifted;     /* heights, by a geoid; by how many metres */
		double height[3];     /* smallest, mean, largest */
		bool text_of_lines;   /* of an input that is a text of lines itself: its points are vertices of them */
		bool has_lines;       /* a file of lines: */
		struct lines_exported lines;
		struct err err;
	} * file;
	size_t nfile;
	bool has_line_set; /* the push changed the lines of the dataset: */
	struct acut_line_set line_set;
	double seconds;
	char zone[16], datum[64], geoid[160]; /* that degrees and heights went to; "": nothing did */
};

/* Pushes all inputs; refused ones are printed. `dataset` NULL: one of its own. Prints its failure; exit status, where
 * SESSION_SOME_REFUSED means that the push is done without those. */
int ctl_stage(struct ctl_inputs *, const struct ctl_stage_options *, const char *dataset, struct ctl_staged *ret);
void ctl_stage_done(struct ctl_staged *);
/* -ERR_USAGE if options of a push contradict each other. */
int ctl_stage_check(const struct ctl_stage_options *, const struct ctl_input_options *, struct err *err);

/* --scale: "XY[,Z]" into buf, as two texts. *ret_z: NULL, there is none. */
enum { CTL_SCALE_SIZE = 128 };
int ctl_stage_scale(const char *scale, char buf[CTL_SCALE_SIZE], const char **ret_z, struct err *err);
/* The text of a CRS: the word, or what is in the file of that name. *ret is the caller's. */
int ctl_stage_crs(const char *word, const char *option, char **ret, struct err *err);
/* Adds the file to the daemon's geoid grids; `name` NULL: named after it. Prints its failure; exit status. */
int ctl_stage_geoid(struct session *, const char *path, const char *name, char ret_name[128], const struct acut_geoid **ret);

/* ---- for the files of this room: assumed and overridden coordinate systems and units ---- */

struct ctl_assume {
	char *crs, unit_xy[16], unit_z[16]; /* NULL, "": nothing */
	bool overrides;                     /* in place of what the inputs declare */
	bool no_crs, no_unit_xy, no_unit_z; /* of the inputs seen: still unknown */
};
int ctl_assume_read(const struct ctl_stage_options *, struct ctl_assume *ret, struct err *err);
void ctl_assume_options(const struct ctl_assume *, struct acut_push_options *); /* borrows the texts */
void ctl_assume_see(struct ctl_assume *, const struct acut_probe *);
void ctl_assume_warn(struct console *, const struct ctl_assume *); /* once a dataset */
void ctl_assume_done(struct ctl_assume *);

#endif
