/*
 * Names of files in the weights of a request ("weight=@old.laz:0.5m") become numbers of sources ("weight=#4-9:0.5m"), which
 * never mean other files: later pushes do not change what a job is of.
 *
 * A name is compared with the last parts of the path of a source, as many as it has itself, with a whole path if it begins with a
 * slash, and with the name of the source. One that ends with a slash is a folder: it names all files below. In the request
 * letters that words of a view cannot have are %XX.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "job_priv.h"
#include "order.h"
#include "utf8.h"

#define WORD " weight="
#define NAME_SEVERAL "name several at once, as in survey-2024/*.laz or survey-2024/"
/* Nearest names: those of so many sources are compared, by so many letters, and so many are told. */
enum { COMPARED = 2000, LETTERS = 64, TOLD = 3 };
/* Names in one request, and how often one is compared with a file: each is with all. That takes seconds at most. */
enum { NAMES_MOST = 1000, COMPARISONS_MOST = 20000000 };

/* The radius of a name, as it was written in the request. */
struct radius {
	const char *at;
	size_t n;
};

struct naming {
	const struct grid_manifest *m;
	uint64_t generation;
	bool paths;
	char name[GRID_SOURCE_PATH]; /* this name, decoded */
	uint32_t *id;                /* of the sources that it means; room for all */
	uint16_t *of;                /* the name that each source is in, from 1 */
	struct radius radius[NAMES_MOST];
	unsigned names;
	uint64_t comparisons;
	const atomic_bool *left; /* nobody waits any more; may be NULL */
	char *made;              /* VIEW_TEXT_MAX bytes, and a zero */
	size_t size;
	struct err *err;
};

bool job_names_files(const char *text)
{
	const char *word = strstr(text, WORD);

	return word && memchr(word + strlen(WORD), '@', strcspn(word + strlen(WORD), " "));
}

/* ---- one name ---- */

static int hex_of(char c)
{
	return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* False: it is none, or too long. */
static bool decode(const char *at, size_t n, char ret[GRID_SOURCE_PATH])
{
	size_t m = 0;

	for (size_t i = 0; i < n; i++) {
		int c = (unsigned char)at[i];

		if (c == '%') {
			int high = i + 2 < n ? hex_of(at[i + 1]) : -1, low = high < 0 ? -1 : hex_of(at[i + 2]);

			if (low < 0)
				return false;
			c = high * 16 + low;
			i += 2;
		}
		if (!c || m == GRID_SOURCE_PATH - 1)
			return false;
		ret[m++] = (char)c;
	}
	ret[m] = '\0';
	return m > 0;
}

/* "./a" is "a". */
static const char *bare(const char *name)
{
	while (!strncmp(name, "./", 2) && name[2])
		name += 2;
	return name;
}

/* At "[": whether c is in it, and what follows it. NULL: it has no end, and is a letter. */
static const char *in_set(const char *at, unsigned char c, bool *ret)
{
	bool not = at[1] == '!', found = false;
	const char *p = at + 1 + not ;

	for (bool first = true; *p && (first || *p != ']'); first = false) {
		unsigned char low = (unsigned char)*p++, high = low;

		if (*p == '-' && p[1] && p[1] != ']') {
			high = (unsigned char)p[1];
			p += 2;
		}
		found |= c >= low && c <= high;
	}
	*ret = c != '/' && found != not ;
	return *p ? p + 1 : NULL;
}

/* Whether the pattern begins with something that means the letter at `text`, and not with a star. */
static bool step(const char **pattern, const char **text)
{
	const char *after = NULL;
	size_t n = 1;
	bool in = **text && **pattern == **text, found;

	if (**pattern == '?') {
		n = utf8_length(*text, SIZE_MAX);
		n = n ? n : 1;
		in = **text && **text != '/';
	} else if (**pattern == '[' && **text && (after = in_set(*pattern, (unsigned char)**text, &found))) {
		in = found;
		*pattern = after - 1;
	}
	*pattern += in;
	*text += in ? n : 0;
	return in;
}

/* Like fnmatch with FNM_PATHNAME, but for its time, which is exponential in the number of stars: only the last star is tried
 * again, as what is before it need not take more. */
static bool same(const char *pattern, const char *text)
{
	const char *star = NULL, *from = NULL;

	if (!strcmp(pattern, text))
		return true;
	while (*text || *pattern) {
		const char *at = pattern;

		if (*pattern == '*') {
			star = ++pattern;
			from = text;
		} else if (!step(&at, &text)) {
			if (!star || !*from || *from == '/')
				return false;
			pattern = star;
			text = ++from;
		} else {
			pattern = at;
		}
	}
	return true;
}

/* The last parts of the path, as many as the pattern has. NULL: it has fewer. */
static const char *last_parts(const char *pattern, const char *path)
{
	const char *at = path + strlen(path);
	unsigned slashes = 0;

	for (const char *p = pattern; *p; p++)
		slashes += *p == '/';
	for (; at > path; at--)
		if (at[-1] == '/' && !slashes--)
			return at;
	return slashes ? NULL : path;
}

static bool means_path(const char *pattern, const char *path)
{
	const char *part = *pattern == '/' ? path : last_parts(pattern, path);

	return part && same(pattern, part);
}

/* `folder`: without the slash at its end. */
static bool means_folder(const char *folder, const char *path)
{
	char above[GRID_SOURCE_PATH];
	char *slash;

	snprintf(above, sizeof above, "%s", path);
	while ((slash = strrchr(above, '/')) && slash > above) {
		*slash = '\0';
		if (means_path(folder, above))
			return true;
	}
	return false;
}

static bool means(const struct naming *n, const struct grid_source *s)
{
	const char *name = bare(n->name), *path = n->paths ? s->path : "";
	size_t length = strlen(name);
	char folder[GRID_SOURCE_PATH];

	if (length > 1 && name[length - 1] == '/') {
		snprintf(folder, sizeof folder, "%.*s", (int)length - 1, name);
		return means_folder(folder, path);
	}
	return same(name, s->name) || (*path && means_path(name, path));
}

/* ---- a name that means nothing ---- */

static unsigned distance(const char *a, const char *b)
{
	size_t n = strnlen(b, LETTERS);
	unsigned row[LETTERS + 1];

	for (size_t j = 0; j <= n; j++)
		row[j] = (unsigned)j;
	for (size_t i = 0; i < LETTERS && a[i]; i++) {
		unsigned above = row[0]++;

		for (size_t j = 1; j <= n; j++) {
			unsigned change = above + (a[i] != b[j - 1]);

			above = row[j];
			row[j] = row[j] + 1 < change ? row[j] + 1 : change;
			row[j] = row[j - 1] + 1 < row[j] ? row[j - 1] + 1 : row[j];
		}
	}
	return row[n];
}

static const char *base_of(const char *name)
{
	const char *slash = strrchr(name, '/');

	return slash && slash[1] ? slash + 1 : name;
}

static bool points_here(const struct naming *n, const struct grid_source *s)
{
	return s->kind == GRID_POINTS && grid_source_live(s, n->generation);
}

/* The nearest names, as "a.laz, b.laz"; "": there are none. */
static void nearest(const struct naming *n, char *ret, size_t size)
{
	const struct grid_source *best[TOLD] = {NULL};
	unsigned far[TOLD] = {0}, seen = 0;
	size_t at = 0;

	for (size_t i = 0; i < n->m->nsources && seen < COMPARED; i++) {
		const struct grid_source *s = &n->m->sources[i];
		unsigned d, k = TOLD;

		if (!points_here(n, s))
			continue;
		seen++;
		d = distance(base_of(n->name), s->name);
		for (; k > 0 && (!best[k - 1] || d < far[k - 1]); k--)
			if (k < TOLD) {
				best[k] = best[k - 1];
				far[k] = far[k - 1];
			}
		if (k < TOLD) {
			best[k] = s;
			far[k] = d;
		}
	}
	*ret = '\0';
	for (unsigned k = 0; k < TOLD && best[k] && at < size; k++)
		at += (size_t)snprintf(ret + at, size - at, "%s%.60s", k ? ", " : "", best[k]->name);
}

static int no_file(const struct naming *n)
{
	const struct grid_source *lines = NULL, *gone = NULL;
	char names[TOLD * 64];

	for (size_t i = 0; i < n->m->nsources; i++) {
		const struct grid_source *s = &n->m->sources[i];

		if (s->kind == GRID_LINE_VERTICES || !means(n, s))
			continue;
		lines = s->kind == GRID_LINES ? s : lines;
		gone = s->kind == GRID_POINTS ? s : gone;
	}
	err_set(n->err, ERR_NOTFOUND, "--weight: no file of points in generation %llu is \"%.100s\"",
		(unsigned long long)n->generation, n->name);
	nearest(n, names, sizeof names);
	if (gone)
		return err_add_hint(n->err, "%.100s is in other generations only (acutctl dataset log --files, --at)",
				    gone->name);
	if (lines)
		return err_add_hint(n->err, "%.100s has lines, which have no weight", lines->name);
	return err_add_hint(
		n->err,
		"the nearest: %s; acutctl dataset log --files lists all. A name may have * and ?, or end with a / for "
		"a folder",
		*names ? names : "(there are none)");
}

/* ---- the request ---- */

static int too_long(const struct naming *n)
{
	err_set(n->err, ERR_LIMIT, "the files that --weight names have too many numbers for a view");
	return err_add_hint(n->err, "push files that shall have the same weight together, so that their numbers follow");
}

static int put(struct naming *n, const char *text, size_t length)
{
	if (length > VIEW_TEXT_MAX - n->size)
		return too_long(n);
	memcpy(n->made + n->size, text, length);
	n->size += length;
	n->made[n->size] = '\0';
	return 0;
}

static int put_ids(struct naming *n, size_t count)
{
	char text[32];
	int r = 0;

	qsort(n->id, count, sizeof *n->id, order_u32);
	for (size_t i = 0, k; i < count && !r; i = k) {
		int length;

		for (k = i + 1; k < count && n->id[k] == n->id[k - 1] + 1; k++)
			;
		length = snprintf(text, sizeof text, "%s%u", i ? "+" : "#", n->id[i]);
		if (k > i + 1)
			length += snprintf(text + length, sizeof text - (size_t)length, "-%u", n->id[k - 1]);
		r = put(n, text, (size_t)length);
	}
	return r;
}

static bool same_radius(const struct radius *a, const struct radius *b)
{
	return view_same_length(a->at, a->n, b->at, b->n);
}

static int two_radii(const struct naming *n, const struct grid_source *s, struct radius a, struct radius b)
{
	err_set(n->err, ERR_USAGE, "--weight: %.100s has two radii: %.*s, and %.*s as \"%.100s\"", s->name,
		(int)(a.n < 40 ? a.n : 40), a.at, (int)(b.n < 40 ? b.n : 40), b.at, n->name);
	return err_add_hint(n->err, "give each file one radius");
}

static int too_many(const struct naming *n)
{
	err_set(n->err, ERR_LIMIT, "--weight names too many files for a dataset of %zu", n->m->nsources);
	return err_add_hint(n->err, NAME_SEVERAL);
}

/* The sources that the name means, and of them those in no earlier name: n->id[0..*ret_fresh). Two names may mean one source if
 * they give it the same radius; the first has its number then. */
static int find_sources(struct naming *n, size_t *ret_fresh)
{
	const struct radius radius = n->radius[n->names - 1];
	bool found = false;

	*ret_fresh = 0;
	if (n->left && atomic_load(n->left))
		return err_set(n->err, ERR_CANCELLED, "the client has left");
	n->comparisons += n->m->nsources;
	if (n->comparisons > COMPARISONS_MOST)
		return too_many(n);
	for (size_t i = 0; i < n->m->nsources; i++) {
		const struct grid_source *s = &n->m->sources[i];

		if (!points_here(n, s) || !means(n, s))
			continue;
		found = true;
		if (n->of[i] && !same_radius(&n->radius[n->of[i] - 1], &radius))
			return two_radii(n, s, n->radius[n->of[i] - 1], radius);
		if (n->of[i])
			continue;
		n->of[i] = (uint16_t)n->names;
		n->id[(*ret_fresh)++] = s->id;
	}
	return found ? 0 : no_file(n);
}

static int name_of(struct naming *n, const char *at, size_t length)
{
	const char *colon = memchr(at, ':', length);
	size_t name = colon ? (size_t)(colon - at) : length;

	if (n->names == NAMES_MOST) {
		err_set(n->err, ERR_LIMIT, "--weight names more than %d files", NAMES_MOST);
		return err_add_hint(n->err, NAME_SEVERAL);
	}
	if (!colon || !decode(at + 1, name - 1, n->name))
		return err_set(n->err, ERR_PROTO, "\"%.*s\" is not the name of a file with a radius",
			       (int)(length < 200 ? length : 200), at);
	n->radius[n->names++] = (struct radius){colon + 1, length - name - 1};
	return 0;
}

/* Without the names of files that earlier names mean, too. */
static int put_item(struct naming *n, const char *at, size_t length, bool first)
{
	size_t fresh = 0, radius;
	int r;

	if (*at != '@') {
		r = first ? 0 : put(n, ",", 1);
		return r ? r : put(n, at, length);
	}
	if ((r = name_of(n, at, length)) || (r = find_sources(n, &fresh)) || !fresh)
		return r;
	radius = n->radius[n->names - 1].n;
	if (!first)
		r = put(n, ",", 1);
	if (!r)
		r = put_ids(n, fresh);
	return r ? r : put(n, at + length - radius - 1, radius + 1);
}

static int put_items(struct naming *n, const char *at, const char *end)
{
	bool first = true;
	int r = 0;

	for (;; at++) {
		size_t length = strcspn(at, ", ");

		r = put_item(n, at, length, first);
		first = false; /* nothing is before it, so it is not left out */
		at += length;
		if (r || at == end)
			return r;
	}
}

static int put_request(struct naming *n, const char *text)
{
	const char *word = strstr(text, WORD) + strlen(WORD), *end = word + strcspn(word, " ");
	int r = put(n, text, (size_t)(word - text));

	if (!r)
		r = put_items(n, word, end);
	return r ? r : put(n, end, strlen(end));
}

size_t job_sources_bytes(const struct grid_manifest *m)
{
	const struct naming *n;

	return sizeof *n + VIEW_TEXT_MAX + 1 + (m->nsources + 1) * (sizeof *n->id + sizeof *n->of);
}

int job_sources(const char *text, const struct grid_manifest *m, uint64_t generation, bool paths, const atomic_bool *left,
		char **ret, struct err *err)
{
	struct naming *n;
	int r;

	if (strlen(text) > VIEW_TEXT_MAX) {
		err_set(err, ERR_LIMIT, "a view of %zu bytes is too long: %d fit", strlen(text), VIEW_TEXT_MAX);
		return err_add_hint(err, "name several files at once, as in --weight survey-2024/*.laz=0.5m");
	}
	n = calloc(1, sizeof *n);
	if (!n)
		return err_set(err, ERR_NOMEM, "no memory for the names of files");
	n->m = m;
	n->generation = generation;
	n->paths = paths;
	n->left = left;
	n->err = err;
	n->id = calloc(m->nsources + 1, sizeof *n->id);
	n->of = calloc(m->nsources + 1, sizeof *n->of);
	n->made = malloc(VIEW_TEXT_MAX + 1);
	if (!n->id || !n->of || !n->made)
		r = err_set(err, ERR_NOMEM, "no memory for the names of files");
	else
		r = put_request(n, text);
	free(n->id);
	free(n->of);
	if (r)
		free(n->made);
	else
		*ret = n->made;
	free(n);
	return r;
}
