/* Reports on jobs, pushes and files, for people and as JSON. */
#ifndef CTL_REPORT_H
#define CTL_REPORT_H

#include "ctl_stage.h"

struct outfile;

/* ---- parts of JSON objects ---- */

/* lattice as an object, null if the text is not one */
void ctl_report_lattice(struct term_json *, const char *lattice);
void ctl_report_units(struct term_json *, const char *crs, const char *unit_xy, const char *unit_z);
/* The rest of the coordinate system of a dataset: "epsg", "epsg_z", "vertical", "wkt", "geoid". */
void ctl_report_system(struct term_json *, const struct acut_dataset *);
/* The keys of a report, from "points" to "most"; all null without one. */
void ctl_report_mesh(struct term_json *, const struct acut_report * /* or NULL */);
/* The position that most points share, as "most". */
void ctl_report_most(struct term_json *, uint64_t points, const double at[2]);
/* "notes": the sentences of a report, none without one, and two more, or "". */
void ctl_report_notes(struct term_json *, const struct acut_report * /* or NULL */, const char *more, const char *last);
/* Keys "projection" and "geoid" of one file, or (NULL) of all that were staged; NULL both: null. */
void ctl_report_heights_json(struct term_json *, const struct ctl_staged *, const struct ctl_staged_file *);

/* ---- jobs ---- */

void ctl_report_job(struct console *, const struct acut_job *);                        /* a line, or as JSON */
void ctl_report_job_json(struct console *, const struct acut_job *, const char *note); /* of this command, or "" */
/* Exit status of a job that is over; prints why it failed. */
int ctl_report_job_status(struct session *, const struct acut_job *);
/* "12 of 340 domains made", or "340 domains". Returns buf. */
char *ctl_report_domains(const struct acut_report *, char *buf, size_t size);
/* Of a view with a bound of errors: "0.1 (largest 0.0997): 1,234 of 5,678 positions kept (21.7 %), 3 rounds". Returns buf. */
char *ctl_report_bound(const struct acut_report *, char *buf, size_t size);
/* Whether so many points at one position, of all at so many positions, are worth a word. */
bool ctl_report_crowded(uint64_t at_one, uint64_t points, uint64_t positions);
/* A warning of many points at one position, where that is worth it. */
void ctl_report_warn_crowded(struct console *, const struct acut_report *);

/* ---- pushes ---- */

/* Each file and the sum. moved_to: where each file is now, NULL where it was; NULL itself: of a push, which moves nothing. Prints
 * its failure; exit status. */
int ctl_report_push(struct session *, const struct ctl_staged *, const char *const *moved_to);
/* Shifted heights, and inputs whose records were overridden. */
void ctl_report_heights(struct console *, const struct ctl_staged *);
void ctl_report_overridden(struct console *, const struct ctl_staged * /* or NULL */);

/* ---- lines ---- */

/* "4 hard, 1 lake: 7 lines, 1,200 vertices". Returns buf. */
char *ctl_report_lines_text(const uint64_t features[4], uint64_t lines, uint64_t vertices, char *buf, size_t size);
/* Keys of an object of lines: "hard", "lake", "boundary", "hole", "lines", "vertices". */
void ctl_report_lines_keys(struct term_json *, const uint64_t features[4], uint64_t lines, uint64_t vertices);

void ctl_report_lines(struct console *, const struct ctl_staged *); /* what became of them, if the push changed them */
/* The same as "line_set"; null without it. */
void ctl_report_lines_json(struct term_json *, const struct ctl_staged * /* or NULL */);
/* Where they cross, and where vertices have several heights, as GeoJSON in the plane of the dataset. Prints its failure; exit
 * status. */
int ctl_report_line_places(struct session *, const struct ctl_staged *, const char *path);

/* ---- places ---- */

/* The head of a FeatureCollection, up to its features. epsg: of the plane; 0: the system has no number. */
int ctl_report_geojson_head(struct outfile *, unsigned epsg, const char *unit_xy, struct err *err);

/* ---- weights ---- */

/* Opens the report before the job that it is of is made. -ERR_USAGE: it is one of the outputs (a NULL at the end of them). */
int ctl_report_hidden_open(const char *path, bool no_clobber, const char *const *outputs, struct outfile **ret, struct err *err);
/* -ERR_USAGE: a mesh of this view, its canonical text, has no such report. */
int ctl_report_hidden_check(const char *view, struct err *err);
/* The positions that the weights of a view (a request, or its canonical text) hide, with class and file, as GeoJSON in the plane
 * of the dataset. Prints its failure; exit status. */
int ctl_report_hidden(struct session *, const char *dataset, uint64_t generation, const char *view, struct outfile *);
void ctl_report_hidden_close(struct outfile * /* or NULL */); /* removes what was not completed */

/* ---- the records of a file ---- */

void ctl_report_inspected(struct console *, const struct acut_inspected *);
/* Its keys; NULL: the records were not read, so all are null. */
void ctl_report_inspected_json(struct term_json *, const struct acut_inspected *);

/* The text of a view for people, to be freed: "weight=#1-2+5:50" is "weight=a.laz+b.laz+c.laz:50", or has the first names and how
 * many more there are. NULL: no memory. */
char *ctl_report_view(struct acut *, const char *dataset, const char *view);

#endif
