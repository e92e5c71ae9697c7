/*
 * What became of degrees and heights: told when it is planned, summed up at the end. The daemon says it a file;
 * means are weighted by points.
 */
#include <string.h>

#include "ctl.h"

int ctl_height_geoid(struct program *ctl, char ret_name[128])
{
	const char *geoid = ctl->args.geoid;
	const struct acut_geoid *g;
	size_t n = strlen(geoid);

	if (n > 4 && !strcmp(geoid + n - 4, ".pgm"))
		return ctl_geoid_file(ctl, geoid, NULL, ret_name, &g);
	snprintf(ret_name, 128, "%s", geoid);
	return 0;
}

static const char *zone_kind(const char *zone)
{
	return !strncmp(zone, "UPS", 3) ? "" : "UTM zone ";
}

void ctl_height_planned(struct program *ctl, const struct acut_push_planned *p, struct ctl_staged *s)
{
	snprintf(s->zone, sizeof(s->zone), "%s", p->zone);
	snprintf(s->datum, sizeof(s->datum), "%s", p->datum);
	snprintf(s->geoid, sizeof(s->geoid), "%s", p->geoid);
	if (*s->zone)
		console_line(&ctl->session.console, "degrees of %s are projected to %s%s (%s)", s->datum, zone_kind(s->zone),
			     s->zone, p->crs);
}

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

static void geoid_json(struct term_json *j, const struct ctl_staged *s, const struct ctl_staged_file *f)
{
	char way[16], hash[40], name[80];
	struct shift sum;

	if (!s || !split(s->geoid, way, hash, name)) {
		term_json_text(j, "geoid", NULL);
		return;
	}
	sum = sum_of(s, f);
	term_json_open(j, "geoid", '{');
	term_json_text(j, "name", name);
	term_json_text(j, "hash", hash);
	term_json_text(j, "way", way);
	term_json_u64(j, "points", sum.n);
	if (sum.n) {
		term_json_number(j, "min", sum.min);
		term_json_number(j, "mean", sum.mean);
		term_json_number(j, "max", sum.max);
	} else {
		term_json_text(j, "min", NULL);
		term_json_text(j, "mean", NULL);
		term_json_text(j, "max", NULL);
	}
	term_json_close(j, '}');
}

void ctl_height_json(struct term_json *j, const struct ctl_staged *s, const struct ctl_staged_file *f)
{
	if (!s || !*s->zone || (f && !f->projected_from)) {
		term_json_text(j, "projection", NULL);
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

void ctl_height_text(struct program *ctl, const struct ctl_staged *s)
{
	char way[16], hash[40], name[80], count[32];
	struct shift sum = sum_of(s, NULL);

	if (split(s->geoid, way, hash, name) && sum.n)
		console_line(&ctl->session.console,
			     "heights of %s points made %s by %s: %+.3f to %+.3f m, %+.3f m in the mean (grid %s)",
			     term_count(sum.n, count), way, name, sum.min, sum.max, sum.mean, hash);
}
