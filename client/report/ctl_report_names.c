/*
 * Names of files, from the log of a dataset. Those that were removed later are among them, since views and meshes of earlier
 * generations have their numbers.
 */
#include "ctl_report_names.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "grow.h"
#include "order.h"

enum { NAMES_MOST = 16 << 20, TOLD = 3 };

/* Room for n, of which each has `size` bytes. */
static bool room_for(void *array, size_t *room, size_t n, size_t size)
{
	return n <= NAMES_MOST / 2 / size && grow(array, room, n, 1024, size);
}

static void keep_name(void *ctx, const struct acut_log_file *f)
{
	struct ctl_report_names *k = ctx;
	size_t n = strlen(f->name) + 1;

	if (k->full || f->of_lines || f->removed)
		return;
	k->full = !room_for(&k->row, &k->room, k->n + 1, sizeof *k->row) || !room_for(&k->text, &k->size, k->used + n, 1);
	if (k->full)
		return;
	k->row[k->n++] = (struct ctl_report_name){f->source, (uint32_t)k->used};
	memcpy(k->text + k->used, f->name, n);
	k->used += n;
}

static void pass_generation(void *ctx, const struct acut_generation *g) {}

void ctl_report_names_read(struct acut *acut, const char *dataset, struct ctl_report_names *ret)
{
	const struct acut_log_sink log = {.generation = pass_generation, .file = keep_name, .ctx = ret};

	*ret = (struct ctl_report_names){NULL};
	/* A dataset of one step has no log. */
	if (!acut_dataset_log(acut, dataset, &log) && ret->n)
		qsort(ret->row, ret->n, sizeof *ret->row, order_u32);
}

const char *ctl_report_name_of(const struct ctl_report_names *k, uint32_t source)
{
	const struct ctl_report_name key = {source, 0};
	const struct ctl_report_name *hit = k->n ? bsearch(&key, k->row, k->n, sizeof key, order_u32) : NULL;

	return hit ? k->text + hit->at : NULL;
}

void ctl_report_names_free(struct ctl_report_names *k)
{
	free(k->row);
	free(k->text);
}

/* ---- views ---- */

/* "#1-3+7", up to `end`. */
static void print_sources(FILE *f, const struct ctl_report_names *k, const char *at, const char *end)
{
	uint64_t all = 0, told = 0;
	char *to;

	for (at++; at < end; at = to + 1) {
		uint64_t first = strtoul(at, &to, 10), last = *to == '-' ? strtoul(to + 1, &to, 10) : first;

		all += last - first + 1;
		for (; first <= last && told < TOLD; first++, told++) {
			const char *name = ctl_report_name_of(k, (uint32_t)first);

			fputs(told ? "+" : "", f);
			if (name)
				fputs(name, f);
			else
				fprintf(f, "#%llu", (unsigned long long)first);
		}
	}
	if (all > told)
		fprintf(f, " and %llu more", (unsigned long long)(all - told));
}

static void print_view(FILE *f, const struct ctl_report_names *k, const char *view)
{
	const char *weights = strstr(view, " weight="), *end = weights ? weights + 1 + strcspn(weights + 1, " ") : view;

	for (const char *at = view; *at;) {
		const char *colon = *at == '#' && at < end ? strchr(at, ':') : NULL;

		if (colon) {
			print_sources(f, k, at, colon);
			at = colon;
		} else {
			fputc(*at++, f);
		}
	}
}

char *ctl_report_view(struct acut *acut, const char *dataset, const char *view)
{
	const char *weights = strstr(view, " weight=");
	struct ctl_report_names names;
	char *text = NULL;
	size_t size;
	FILE *f;

	if (!weights || !strchr(weights, '#'))
		return strdup(view);
	f = open_memstream(&text, &size);
	if (!f)
		return NULL;
	ctl_report_names_read(acut, dataset, &names);
	print_view(f, &names, view);
	ctl_report_names_free(&names);
	if (!fclose(f))
		return text;
	free(text);
	return NULL;
}
