/* volume: its results as text, CSV and JSON. Each says its units. */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ctl.h"
#include "term.h"

enum { NUMBER = 64 };

/* 1,234.567: three decimals, thousands apart. */
static char *number(double v, char buf[NUMBER])
{
	char digits[NUMBER], *to = buf;
	size_t n, whole;

	snprintf(digits, sizeof(digits), "%.3f", fabs(v));
	n = strlen(digits);
	whole = n - 4;
	if (v < 0 && strspn(digits, "0.") < n)
		*to++ = '-';
	for (size_t i = 0; i < n && to < buf + NUMBER - 2; i++) {
		if (i && i < whole && !((whole - i) % 3))
			*to++ = ',';
		*to++ = digits[i];
	}
	*to = '\0';
	return buf;
}

/* The shortest decimal that is read back as v. */
static char *exact(double v, char buf[NUMBER])
{
	for (int digits = 15; digits <= 17; digits++) {
		snprintf(buf, NUMBER, "%.*g", digits, v);
		if (strtod(buf, NULL) == v)
			break;
	}
	return buf;
}

/* ---- text ---- */

static const char *name_of(const struct volume_result *p, size_t i, char buf[NUMBER])
{
	if (*p->name)
		return p->name;
	snprintf(buf, NUMBER, "%zu", i + 1);
	return buf;
}

static void meshes_text(FILE *out, const struct ctl_volume *v, const struct volume_total *t)
{
	char a[NUMBER];

	if (v->has_level)
		term_field(out, "from", "the level %s %s", exact(v->level, a), t->unit_mesh);
	for (int i = 0; i < (v->has_level ? 1 : 2); i++)
		term_field(out, i || v->has_level ? "to" : "from", "job %" PRIu64 ": %s, generation %" PRIu64 ", %s triangles",
			   v->mesh[i].job, v->mesh[i].dataset, v->mesh[i].generation, term_count(t->triangles[i], a));
}

static void one_text(FILE *out, const struct ctl_volume *v, const struct volume_total *t)
{
	struct volume_result p;
	char a[NUMBER], b[NUMBER];

	volume_result(v->volume, 0, &p);
	term_field(out, "fill", "%s %s on %s %s", number(p.fill, a), t->unit_volume, number(p.fill_area, b), t->unit_area);
	term_field(out, "cut", "%s %s on %s %s", number(p.cut, a), t->unit_volume, number(p.cut_area, b), t->unit_area);
	term_field(out, "net", "%s %s", number(p.net, a), t->unit_volume);
	term_field(out, "error", "at most %.2g %s", p.error, t->unit_volume);
	term_field(out, "compared", "%s %s, %s %s of them without a difference", number(p.area, a), t->unit_area,
		   number(p.same_area, b), t->unit_area);
	if (!v->has_level)
		term_field(out, "one only", "%s %s in job %" PRIu64 ", %s %s in job %" PRIu64, number(p.only[0], a), t->unit_area,
			   v->mesh[0].job, number(p.only[1], b), t->unit_area, v->mesh[1].job);
}

static void table(const struct console *c, const struct ctl_volume *v, const struct volume_total *t)
{
	static const struct term_column columns[] = {{"NAME", .shrink = true},
						     {"FILL", .right = true},
						     {"CUT", .right = true},
						     {"NET", .right = true},
						     {"UNIT"},
						     {"AREA", .right = true},
						     {"FILLED", .right = true, .spare = true},
						     {"LOWERED", .right = true, .spare = true},
						     {"SAME", .right = true, .spare = true},
						     {"ONLY 1", .right = true, .spare = true},
						     {"ONLY 2", .right = true, .spare = true},
						     {"UNIT"},
						     {"ERROR", .right = true, .spare = true}};
	struct term_table *rows = CONSOLE_TABLE(c, columns);
	char a[NUMBER];

	for (size_t i = 0; i < volume_results(v->volume); i++) {
		struct volume_result p;

		volume_result(v->volume, i, &p);
		term_table_text(rows, "%s", name_of(&p, i, a));
		term_table_text(rows, "%.3f", p.fill);
		term_table_text(rows, "%.3f", p.cut);
		term_table_text(rows, "%.3f", p.net);
		term_table_text(rows, "%s", t->unit_volume);
		term_table_text(rows, "%.3f", p.area);
		term_table_text(rows, "%.3f", p.fill_area);
		term_table_text(rows, "%.3f", p.cut_area);
		term_table_text(rows, "%.3f", p.same_area);
		term_table_text(rows, "%.3f", p.only[0]);
		term_table_text(rows, "%.3f", p.only[1]);
		term_table_text(rows, "%s", t->unit_area);
		term_table_text(rows, "%.2g", p.error);
	}
	term_table_free(rows);
}

void ctl_volume_text(const struct console *c, const struct ctl_volume *v)
{
	struct volume_total t;
	char a[NUMBER];

	volume_total(v->volume, &t);
	if (v->opt->within) {
		table(c, v, &t);
	} else {
		meshes_text(c->report, v, &t);
		one_text(c->report, v, &t);
	}
	if (t.range > 0)
		term_field(c->report, "colors", "red to -%s %s, white at 0, blue to %s %s", exact(t.range, a), t.unit, a, t.unit);
}

/* ---- CSV ---- */

static void csv_name(FILE *out, const char *name)
{
	if (!strpbrk(name, ",\"\r\n")) {
		fputs(name, out);
		return;
	}
	fputc('"', out);
	for (; *name; name++) {
		if (*name == '"')
			fputc('"', out);
		fputc(*name, out);
	}
	fputc('"', out);
}

void ctl_volume_csv(const struct console *c, const struct ctl_volume *v)
{
	FILE *out = c->report;
	struct volume_total t;
	char a[NUMBER];

	volume_total(v->volume, &t);
	fprintf(out,
		"name,fill,cut,net,error,unit_volume,area,fill_area,cut_area,same_area,only_first,only_second,area_error,unit_area\n");
	for (size_t i = 0; i < volume_results(v->volume); i++) {
		struct volume_result p;

		volume_result(v->volume, i, &p);
		csv_name(out, v->opt->within ? name_of(&p, i, a) : "");
		for (int k = 0; k < 4; k++)
			fprintf(out, ",%s", exact((const double[]){p.fill, p.cut, p.net, p.error}[k], a));
		fprintf(out, ",%s", t.unit_volume);
		for (int k = 0; k < 7; k++)
			fprintf(out, ",%s",
				exact((const double[]){p.area, p.fill_area, p.cut_area, p.same_area, p.only[0], p.only[1],
						       p.area_error}[k],
				      a));
		fprintf(out, ",%s\n", t.unit_area);
	}
}

/* ---- JSON ---- */

static void result_json(struct term_json *j, const struct volume_result *p)
{
	term_json_open(j, NULL, '{');
	term_json_known(j, "name", p->name);
	term_json_number(j, "fill", p->fill);
	term_json_number(j, "cut", p->cut);
	term_json_number(j, "net", p->net);
	term_json_number(j, "error", p->error);
	term_json_number(j, "area", p->area);
	term_json_number(j, "fill_area", p->fill_area);
	term_json_number(j, "cut_area", p->cut_area);
	term_json_number(j, "same_area", p->same_area);
	term_json_number(j, "only_first", p->only[0]);
	term_json_number(j, "only_second", p->only[1]);
	term_json_number(j, "area_error", p->area_error);
	term_json_close(j, '}');
}

void ctl_volume_json(const struct console *c, const struct ctl_volume *v)
{
	struct term_json j = console_json(c);
	struct volume_total t;

	volume_total(v->volume, &t);
	term_json_open(&j, "meshes", '[');
	for (int i = 0; i < (v->has_level ? 1 : 2); i++) {
		term_json_open(&j, NULL, '{');
		term_json_u64(&j, "job", v->mesh[i].job);
		term_json_text(&j, "dataset", v->mesh[i].dataset);
		term_json_u64(&j, "generation", v->mesh[i].generation);
		term_json_u64(&j, "triangles", t.triangles[i]);
		term_json_text(&j, "digest", t.digest[i]);
		term_json_text(&j, "vertex_digest", t.vertex_digest[i]);
		term_json_close(&j, '}');
	}
	term_json_close(&j, ']');
	term_json_number(&j, "level", v->has_level ? v->level : NAN);
	term_json_known(&j, "unit_level", v->has_level ? t.unit_mesh : NULL);
	term_json_text(&j, "unit_volume", t.unit_volume);
	term_json_text(&j, "unit_area", t.unit_area);
	term_json_u64(&j, "pairs", t.pairs);
	term_json_open(&j, "volumes", '[');
	for (size_t i = 0; i < volume_results(v->volume); i++) {
		struct volume_result p;

		volume_result(v->volume, i, &p);
		result_json(&j, &p);
	}
	term_json_close(&j, ']');
	term_json_open(&j, "outputs", '[');
	for (unsigned i = 0; i < v->opt->output.n; i++)
		term_json_text(&j, NULL, v->opt->output.text[i]);
	term_json_close(&j, ']');
	term_json_number(&j, "color_range", t.range > 0 ? t.range : NAN);
	term_json_known(&j, "unit_color_range", t.range > 0 ? t.unit : NULL);
	term_json_open(&j, "warnings", '[');
	for (size_t i = 0; i < c->nwarning; i++)
		term_json_text(&j, NULL, c->warning[i]);
	term_json_close(&j, ']');
	term_json_end(&j);
}
