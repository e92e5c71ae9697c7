/*
 * The segments, sources and generations of a manifest as text, for acut-grid-dump, and whether they agree.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "dump_manifest.h"
#include "grid.h"

/* An untrusted text, in quotes. */
static void print_text(const char *text)
{
	putchar('"');
	for (const char *c = text; *c; c++)
		printf((unsigned char)*c < 32 || *c == '"' || *c == '\\' ? "\\x%02x" : "%c", (unsigned char)*c);
	putchar('"');
}

static void print_entry(const struct grid_segment_info *s)
{
	char hex[DIGEST_HEX_SIZE];

	printf("  segment %s: %llu points in %llu cells, %llu bytes, x %d..%d y %d..%d, keys %016llx..%016llx, sum %s\n", s->file,
	       (unsigned long long)s->points, (unsigned long long)s->cells, (unsigned long long)s->bytes, s->box[0], s->box[2],
	       s->box[1], s->box[3], (unsigned long long)s->lo, (unsigned long long)s->hi, digest_hex(s->sum, hex));
}

static void print_source(const struct grid_source *s)
{
	char hex[DIGEST_HEX_SIZE];

	printf("  source %u: generation", s->id);
	for (size_t i = 0; i < s->nearlier; i++)
		printf(" %llu until %llu,", (unsigned long long)s->earlier[i].added, (unsigned long long)s->earlier[i].removed);
	printf(" %llu", (unsigned long long)s->added);
	if (s->removed)
		printf(" until %llu", (unsigned long long)s->removed);
	printf(", %llu points, hash %s, ", (unsigned long long)s->points, digest_hex(s->hash, hex));
	print_text(s->name);
	if (s->kind == GRID_LINES)
		printf(", %llu lines, %llu vertices in lines-%u", (unsigned long long)s->lines->lines,
		       (unsigned long long)s->lines->vertices, s->id);
	else if (s->kind == GRID_LINE_VERTICES)
		printf(", of the lines in lineset-%u", s->id);
	putchar('\n');
}

static void print_generation(const struct grid_generation *g)
{
	time_t seconds = (time_t)(g->time_us / 1000000);
	char hex[DIGEST_HEX_SIZE], when[32] = "an unknown time";
	struct tm tm;

	if (g->time_us && gmtime_r(&seconds, &tm))
		strftime(when, sizeof when, "%Y-%m-%dT%H:%M:%SZ", &tm);
	printf("  generation %llu: %s", (unsigned long long)g->number, grid_generation_kind_text(g->kind));
	if (g->undoes)
		printf(" of %llu", (unsigned long long)g->undoes);
	printf(" at %s by ", when);
	print_text(g->user);
	printf(" (%u), %u files and %llu points more, %u files and %llu points less, ", g->uid, g->files,
	       (unsigned long long)g->points_added, g->files_removed, (unsigned long long)g->points_removed);
	if (g->lines_added || g->lines_removed)
		printf("%llu lines more, %llu less, ", (unsigned long long)g->lines_added, (unsigned long long)g->lines_removed);
	printf("content %s\n", digest_hex(g->content, hex));
}

/* Compares what can be derived from the sources; pruned sources are missing. */
const char *dump_manifest_fault(const struct grid_manifest *m)
{
	uint64_t oldest = grid_manifest_oldest(m);
	struct grid_generation *derived = calloc(m->ngenerations + 1, sizeof *derived);

	const char *fault = NULL;

	if (!derived)
		return "no memory to check its generations";
	memcpy(derived, m->generations, m->ngenerations * sizeof *derived);
	grid_generations_tally(m, derived, m->ngenerations);
	for (size_t i = 0; i < m->ngenerations; i++) {
		const struct grid_generation *g = &m->generations[i], *d = &derived[i];

		if (g->number < oldest || (g->number == oldest && oldest > 1))
			continue;
		if (g->files != d->files || g->files_removed != d->files_removed || g->points_added != d->points_added ||
		    g->points_removed != d->points_removed || g->lines_added != d->lines_added ||
		    g->lines_removed != d->lines_removed || !digest_equal(g->content, d->content))
			fault = "a generation is not what its sources say";
	}
	free(derived);
	return fault;
}

void dump_manifest_lists(const struct grid_manifest *m)
{
	for (size_t i = 0; i < m->nsegments; i++)
		print_entry(&m->segments[i]);
	for (size_t i = 0; i < m->nfiles; i++)
		printf("  sources %s: %u sources, %llu bytes\n", m->files[i].name, m->files[i].n,
		       (unsigned long long)m->files[i].bytes);
	for (size_t i = 0; i < m->nsources; i++)
		print_source(&m->sources[i]);
	for (size_t i = 0; i < m->ngenerations; i++)
		print_generation(&m->generations[i]);
}
