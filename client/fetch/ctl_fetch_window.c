/*
 * The report of a window that was fetched from a job comes from the tail of its stream: the job's own report is of its whole
 * mesh, or not there yet. Times and coordinate system are the job's.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "ctl_fetch.h"
#include "err.h"
#include "json_reader.h"
#include "parse.h"

/* The value of a member: of those that the report has here, the others are passed over. */
static int take_member(struct json_reader *j, const char *key, struct ctl_window *w)
{
	struct acut_report *p = &w->report;
	const struct {
		const char *key;
		uint64_t *to;
	} count[] = {
		{"points", &p->points},
		{"points_read", &p->points_read},
		{"cells_read", &p->cells_read},
		{"domains", &p->domains},
		{"peak_rss_bytes", &p->peak_rss_bytes},
		{"positions", &p->positions},
		{"kept", &p->kept},
		{"rounds", &p->rounds},
		{"attempts", &p->attempts},
	};
	const struct {
		const char *key;
		char *to;
		size_t size;
	} text[] = {
		{"note", w->note, sizeof(w->note)},
		{"max_error", w->max_error, sizeof(w->max_error)},
		{"largest_error", w->largest_error, sizeof(w->largest_error)},
	};
	char token[JSON_READER_TOKEN];
	int r;

	for (size_t i = 0; i < sizeof(count) / sizeof(*count); i++)
		if (!strcmp(key, count[i].key)) {
			r = json_reader_token(j, token);
			return r || parse_u64(token, count[i].to) ? r : json_reader_bad(j, "%s is no count", key);
		}
	for (size_t i = 0; i < sizeof(text) / sizeof(*text); i++)
		if (!strcmp(key, text[i].key))
			return json_reader_string(j, text[i].to, text[i].size);
	if (strcmp(key, "seconds"))
		return json_reader_skip(j);
	r = json_reader_token(j, token);
	return r || parse_double(token, &p->seconds) ? r : json_reader_bad(j, "seconds is no number");
}

int ctl_window_tail(struct ctl_window *w, const struct acut_mesh_tail *tail, struct err *err)
{
	struct json_reader json = {.hint = ""};
	struct acut_report *p = &w->report;
	struct err why = ERR_INIT;
	bool first = true, more = true;
	char key[64];
	int r;

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
	w->note[0] = w->max_error[0] = w->largest_error[0] = 0;
	text_source_memory(&json.source, tail->report, strlen(tail->report), &why);
	r = json_reader_take(&json, '{');
	while (!r && !(r = json_reader_more(&json, '}', &first, &more)) && more) {
		r = json_reader_key(&json, key, sizeof(key));
		if (!r)
			r = take_member(&json, key, w);
	}
	if (!r && json_reader_peek(&json) >= 0)
		r = json_reader_bad(&json, "there is more after its end");
	if (!r)
		return 0;
	err_set(err, ERR_PROTO, "the report of the window cannot be read: %s", why.message);
	return err_add_place(err, ERR_NO_OFFSET, why.field);
}
