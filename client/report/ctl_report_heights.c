/* Shifted heights, which the daemon reports by file; means are weighted by points. */
#include <math.h>
#include <string.h>

#include "ctl_report.h"

struct shift {
	uint64_t n;
	double min, mean, max;
};

static void add(struct shift *sum, const struct ctl_staged_file *f)
{
	if (f->refused || !f->shifted)
		return;
	if (!sum->n || f->height[0] < sum->min)
		sum->min = f->height[0];
	if (!sum->n || f->height[2] > sum->max)
		sum->max = f->height[2];
	sum->n += f->shifted;
	sum->mean += (f->height[1] - sum->mean) * (double)f->shifted / (double)sum->n;
}

static struct shift sum_of(const struct ctl_staged *s, const struct ctl_staged_file *f)
{
	struct shift sum = {0};

	if (f)
		add(&sum, f);
	for (size_t i = 0; !f && i < s->nfile; i++)
		add(&sum, &s->file[i]);
	return sum;
}

/* "WAY HASH NAME" */
static bool split(const char *geoid, char way[16], char hash[40], char name[80])
{
	return sscanf(geoid, "%15s %39s %79s", way, hash, name) == 3;
}

void ctl_report_system(struct term_json *j, const struct acut_dataset *d)
{
	char way[16], hash[40], name[80];

	term_json_known_u64(j, "epsg", d->epsg);
	term_json_known_u64(j, "epsg_z", d->epsg_z);
	term_json_known(j, "vertical", d->vertical);
	term_json_known(j, "wkt", d->wkt);
	if (!split(d->geoid, way, hash, name)) {
		term_json_null(j, "geoid");
		return;
	}
	term_json_open(j, "geoid", '{');
	term_json_text(j, "name", name);
	term_json_text(j, "hash", hash);
	term_json_text(j, "way", way);
	term_json_close(j, '}');
}

static void geoid_json(struct term_json *j, const struct ctl_staged *s, const struct ctl_staged_file *f)
{
	char way[16], hash[40], name[80];
	struct shift sum;

	if (!s || !split(s->geoid, way, hash, name)) {
		term_json_null(j, "geoid");
		return;
	}
	sum = sum_of(s, f);
	term_json_open(j, "geoid", '{');
	term_json_text(j, "name", name);
	term_json_text(j, "hash", hash);
	term_json_text(j, "way", way);
	term_json_u64(j, "points", sum.n);
	term_json_number(j, "min", sum.n ? sum.min : NAN);
	term_json_number(j, "mean", sum.n ? sum.mean : NAN);
	term_json_number(j, "max", sum.n ? sum.max : NAN);
	term_json_close(j, '}');
}

void ctl_report_heights_json(struct term_json *j, const struct ctl_staged *s, const struct ctl_staged_file *f)
{
	if (!s || !*s->zone || (f && !f->projected_from)) {
		term_json_null(j, "projection");
	} else {
		term_json_open(j, "projection", '{');
		term_json_text(j, "zone", s->zone);
		term_json_text(j, "datum", s->datum);
		if (f)
			term_json_text(j, "from", f->projected_from);
		term_json_close(j, '}');
	}
	geoid_json(j, s, f);
}

void ctl_report_heights(struct console *c, const struct ctl_staged *s)
{
	char way[16], hash[40], name[80], count[32];
	struct shift sum = sum_of(s, NULL);

	if (split(s->geoid, way, hash, name) && sum.n)
		console_line(c, "heights of %s points made %s by %s: %+.3f to %+.3f m, %+.3f m in the mean (grid %s)",
			     term_count(sum.n, count), way, name, sum.min, sum.max, sum.mean, hash);
}

/* The first input by name, of the others their number. */
void ctl_report_overridden(struct console *c, const struct ctl_staged *staged)
{
	const struct ctl_staged_file *first = NULL;
	unsigned n = 0;
	char more[64] = "";

	for (size_t i = 0; staged && i < staged->nfile; i++) {
		if (staged->file[i].refused || !staged->file[i].overridden)
			continue;
		first = first ? first : &staged->file[i];
		n++;
	}
	if (!first)
		return;
	if (n > 1)
		snprintf(more, sizeof(more), ", and those of %u more input%s", n - 1, n == 2 ? "" : "s");
	console_line(c, "overridden: the system in the records of %s (%s)%s", first->name, first->overridden, more);
}
