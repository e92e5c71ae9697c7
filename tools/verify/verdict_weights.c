/*
 * --weight of acut-verify: classes, and names of POINTS, each with a radius (verdict.h). The rules of names are those of acutctl,
 * found by fnmatch(3) and so by other code than the daemon's. The files are numbered from 1, in the order of the arguments.
 */
#include <ctype.h>
#include <fnmatch.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "verdict.h"

enum { NAME_MOST = 4096, NO_RADIUS = -1 };

struct weights {
	const struct verdict *v;
	char **points;
	size_t n;
	char **path;     /* absolute, of each file */
	int32_t *radius; /* likewise */
	FILE *classes;   /* "2:1.5,9:1m" */
	char *class_text;
	size_t class_size;
	struct err *err;
};

/* ---- names ---- */

/* Without "." and empty parts; ".." may lead through a link and stays. */
static char *absolute(const char *name)
{
	char *here = *name == '/' ? NULL : get_current_dir_name(), *whole = NULL, *path = NULL, *part, *rest;
	int length = asprintf(&whole, "%s/%s", here ? here : "", name);

	if (length >= 0 && (path = calloc(1, (size_t)length + 2)))
		for (part = strtok_r(whole, "/", &rest); part; part = strtok_r(NULL, "/", &rest))
			if (strcmp(part, ".") != 0)
				strcat(strcat(path, "/"), part);
	if (length >= 0)
		free(whole);
	free(here);
	return path;
}

static bool matches(const char *pattern, const char *text)
{
	return !strcmp(pattern, text) || !fnmatch(pattern, text, FNM_PATHNAME | FNM_NOESCAPE);
}

/* The whole path, or as many of its last parts as the pattern has. */
static bool names_path(const char *pattern, const char *path)
{
	if (*pattern == '/')
		return matches(pattern, path);
	for (const char *at = strchr(path, '/'); at; at = strchr(at + 1, '/'))
		if (matches(pattern, at + 1)) /* a star is never a slash */
			return true;
	return false;
}

/* One of the folders that the file is in. */
static bool names_folder(const char *pattern, const char *path)
{
	char *above = strdup(path), *slash;
	bool found = false;

	while (above && !found && (slash = strrchr(above, '/')) && slash > above) {
		*slash = '\0';
		found = names_path(pattern, above);
	}
	free(above);
	return found;
}

static bool names_file(const char *name, const char *path)
{
	char folder[NAME_MOST];
	size_t n;

	while (!strncmp(name, "./", 2) && name[2])
		name += 2;
	n = strlen(name);
	if (n < 2 || name[n - 1] != '/')
		return names_path(name, path);
	snprintf(folder, sizeof folder, "%.*s", (int)n - 1, name);
	return names_folder(folder, path);
}

/* ---- radii ---- */

static int bad_item(const struct weights *w, const char *item)
{
	return err_set(w->err, ERR_USAGE, "--weight is not CLASS=RADIUS or FILE=RADIUS, ...: \"%.100s\"", item);
}

/* Has what a number does not. */
static bool is_name(const char *text)
{
	for (; *text; text++)
		if (isalpha((unsigned char)*text) || (unsigned char)*text >= 0x80 || strchr("/*?", *text))
			return true;
	return false;
}

/* In steps of the lattice. */
static int read_radius(const struct weights *w, const char *item, const char *text, int32_t *ret)
{
	char request[64];
	struct view asked;
	int r = 1;

	if (snprintf(request, sizeof request, "#1:%s", text) < (int)sizeof request && !strchr(text, ','))
		r = verdict_resolve(w->v, "weight", request, &asked, w->err);
	if (r)
		return r == 1 ? bad_item(w, item) : r;
	*ret = asked.nweight ? asked.weight[0].radius : 0;
	view_done(&asked);
	return 0;
}

static int add_file(struct weights *w, const char *name, int32_t radius)
{
	bool found = false;

	for (size_t i = 0; i < w->n; i++) {
		if (!names_file(name, w->path[i]))
			continue;
		found = true;
		if (w->radius[i] != NO_RADIUS && w->radius[i] != radius) {
			err_set(w->err, ERR_USAGE, "--weight: %.100s has two radii, one of them as \"%.100s\"", w->points[i],
				name);
			return err_add_hint(w->err, "give each file one radius");
		}
		w->radius[i] = radius;
	}
	if (found)
		return 0;
	err_set(w->err, ERR_USAGE, "--weight: none of the POINTS is \"%.100s\"", name);
	return err_add_hint(w->err,
			    "name the files after the mesh by their names, the ends of their paths, or their folders (old/)");
}

/* The last "=" is the one before the radius. */
static int add_item(struct weights *w, char *item)
{
	char *equal = strrchr(item, '='), *shown = NULL;
	int32_t radius = 0;
	int r;

	if (!equal || equal == item || !equal[1] || strlen(item) >= NAME_MOST)
		return bad_item(w, item);
	if (!(shown = strdup(item)))
		return err_set(w->err, ERR_NOMEM, "no memory for --weight");
	*equal = '\0';
	if (is_name(item)) {
		r = read_radius(w, shown, equal + 1, &radius);
		r = r ? r : add_file(w, item, radius);
	} else {
		r = *item == '#' ? bad_item(w, shown) : 0;
		fprintf(w->classes, "%s%s:%s", ftell(w->classes) ? "," : "", item, equal + 1);
	}
	free(shown);
	return r;
}

static int add_items(struct weights *w, char *text)
{
	int r = 0;

	for (char *item; !r && (item = strsep(&text, ","));)
		r = add_item(w, item);
	return r;
}

static int settle(const struct weights *w, struct view *view)
{
	struct slots_list files = {NULL, 0, 0};
	struct view asked;
	int r = 0;

	view->nweight = 0;
	if (*w->class_text)
		r = verdict_resolve(w->v, "weight", w->class_text, &asked, w->err);
	if (r)
		return r == 1 ? bad_item(w, w->v->weight_text) : r;
	if (*w->class_text) {
		view->nweight = asked.nweight;
		memcpy(view->weight, asked.weight, sizeof asked.weight);
		view_done(&asked);
	}
	for (size_t i = 0; !r && i < w->n; i++)
		if (w->radius[i] != NO_RADIUS && !slots_list_add(&files, (uint32_t)i + 1, (uint32_t)i + 1, w->radius[i]))
			r = err_set(w->err, ERR_NOMEM, "no memory for --weight");
	if (!r)
		r = view_weight_sources(view, &files, w->err);
	slots_list_free(&files);
	return r ? r : view_check(view, w->err);
}

static bool weights_init(struct weights *w)
{
	while (w->points[w->n])
		w->n++;
	w->path = calloc(w->n + 1, sizeof *w->path);
	w->radius = calloc(w->n + 1, sizeof *w->radius);
	w->classes = open_memstream(&w->class_text, &w->class_size);
	if (!w->path || !w->radius || !w->classes)
		return false;
	for (size_t i = 0; i < w->n; i++) {
		w->radius[i] = NO_RADIUS;
		if (!(w->path[i] = absolute(w->points[i])))
			return false;
	}
	return true;
}

int verdict_weights(struct verdict *v, char **points, struct err *err)
{
	struct weights w = {.v = v, .points = points, .err = err};
	char *text;
	int r;

	if (!v->weight_text)
		return 0;
	slots_free(v->view.slots); /* those of --view */
	v->view.slots = NULL;
	text = strdup(v->weight_text);
	r = text && weights_init(&w) ? add_items(&w, text) : err_set(err, ERR_NOMEM, "no memory for --weight");
	if (w.classes && fclose(w.classes) && !r)
		r = err_set(err, ERR_NOMEM, "no memory for --weight");
	r = r ? r : settle(&w, &v->view);
	for (size_t i = 0; w.path && i < w.n; i++)
		free(w.path[i]);
	free(w.path);
	free(w.radius);
	free(w.class_text);
	free(text);
	return r;
}
