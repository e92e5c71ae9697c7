/*
 * The report of a window that was fetched from a job comes from the tail of its stream: the job's own report is of its whole
 * mesh, or not there yet. Times and coordinate system are the job's.
 */
#include <json-c/json.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ctl_fetch.h"

static uint64_t number_of(struct json_object *o, const char *key)
{
	struct json_object *value;

	return json_object_object_get_ex(o, key, &value) ? (uint64_t)json_object_get_int64(value) : 0;
}

void ctl_window_tail(struct ctl_window *w, const struct acut_mesh_tail *tail)
{
	struct json_object *o = json_tokener_parse(tail->report), *note;
	struct acut_report *p = &w->report;

	*p = (struct acut_report){
		.window = true,
		.vertices = tail->vertices,
		.triangles = tail->triangles,
		.digest = w->digest,
		.vertex_digest = w->vertex_digest,
		.note = w->note,
		.max_error = w->max_error,
		.largest_error = w->largest_error,
		.stage_seconds = NAN,
		.first_triangle_seconds = NAN,
		.seal_seconds = NAN,
		.plan_seconds = NAN,
		.domains_seconds = NAN,
	};
	snprintf(w->digest, sizeof(w->digest), "%s", tail->digest);
	snprintf(w->vertex_digest, sizeof(w->vertex_digest), "%s", tail->vertex_digest);
	w->max_error[0] = w->largest_error[0] = 0;
	if (!o)
		return;
	p->points = number_of(o, "points");
	p->points_read = number_of(o, "points_read");
	p->cells_read = number_of(o, "cells_read");
	p->domains = number_of(o, "domains");
	p->peak_rss_bytes = number_of(o, "peak_rss_bytes");
	if (json_object_object_get_ex(o, "seconds", &note))
		p->seconds = json_object_get_double(note);
	if (json_object_object_get_ex(o, "note", &note))
		snprintf(w->note, sizeof(w->note), "%s", json_object_get_string(note));
	if (json_object_object_get_ex(o, "max_error", &note))
		snprintf(w->max_error, sizeof(w->max_error), "%s", json_object_get_string(note));
	if (json_object_object_get_ex(o, "largest_error", &note))
		snprintf(w->largest_error, sizeof(w->largest_error), "%s", json_object_get_string(note));
	p->positions = number_of(o, "positions");
	p->kept = number_of(o, "kept");
	p->rounds = number_of(o, "rounds");
	p->attempts = number_of(o, "attempts");
	json_object_put(o);
}
