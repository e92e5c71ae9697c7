/* Prints what acut-verify found. */
#include "verdict.h"

#include <stdio.h>

static void place_text(const struct verdict *v, char buf[3][DECIMAL_TEXT_SIZE])
{
	const struct lattice *l = &v->mesh.lattice;

	for (unsigned i = 0; i < 3; i++)
		decimal_scaled_text(i < 2 ? l->scale_xy : l->scale_z, v->report.place[i] + l->k[i], buf[i]);
}

/* A thousandth of a step more exactly than the lattice, rounded up: what is within the bound stays so. */
static char *error_text(const struct verdict *v, char buf[DECIMAL_TEXT_SIZE])
{
	const struct check_fraction f = v->errors.largest;
	struct decimal step = v->mesh.lattice.scale_z;
	__int128 whole = f.up / f.down, rest = f.up % f.down;

	step.exponent -= 3;
	return decimal_scaled_text(step, (int64_t)(whole * 1000 + (rest * 1000 + f.down - 1) / f.down), buf);
}

static bool has_errors(const struct verdict *v)
{
	return v->errors.inside || v->errors.outside;
}

static void print_string(FILE *out, const char *text)
{
	fputc('"', out);
	for (; *text; text++) {
		unsigned char c = (unsigned char)*text;

		if (c < 0x20)
			fprintf(out, "\\u%04x", c);
		else
			fprintf(out, c == '"' || c == '\\' ? "\\%c" : "%c", c);
	}
	fputc('"', out);
}

void verdict_print_json(const struct verdict *v)
{
	const struct verify_report *r = &v->report;
	char hex[2][DIGEST_HEX_SIZE], place[3][DECIMAL_TEXT_SIZE], lattice[LATTICE_TEXT_SIZE];

	printf("{\"mesh\":");
	print_string(stdout, v->name);
	printf(",\"good\":%s,\"fault\":", v->fault ? "false" : "true");
	if (v->fault) {
		printf("\"%s\",\"message\":", v->fault);
		print_string(stdout, v->text);
	} else {
		printf("null,\"message\":null");
	}
	place_text(v, place);
	if (r->has_place)
		printf(",\"place\":[%s,%s,%s]", place[0], place[1], place[2]);
	else
		printf(",\"place\":null");
	printf(",\"vertices\":%zu,\"triangles\":%zu,\"edges\":%llu,\"inner_edges\":%llu,\"ties\":%llu,"
	       "\"pieces\":%llu,\"hull\":%llu",
	       v->mesh.nvertex, v->mesh.ntriangle, (unsigned long long)r->edges, (unsigned long long)r->inner,
	       (unsigned long long)r->ties, (unsigned long long)r->pieces, (unsigned long long)r->hull);
	printf(",\"trimmed\":%s,\"lattice\":\"%s\",\"crs\":", v->mesh.trimmed ? "true" : "false",
	       lattice_text(&v->mesh.lattice, lattice));
	print_string(stdout, v->mesh.crs[0] ? v->mesh.crs : "unknown");
	printf(",\"digest\":\"%s\",\"vertex_digest\":\"%s\",\"digest_in_file\":%s", digest_hex(v->digest, hex[0]),
	       digest_hex(v->vertex_digest, hex[1]), v->mesh.has_digest ? "true" : "false");
	if (v->with_points) {
		printf(",\"points\":%llu,\"used\":%llu,\"positions\":%llu,\"rounded\":%llu,\"removed\":{",
		       (unsigned long long)v->points.read, (unsigned long long)v->points.n, (unsigned long long)r->positions,
		       (unsigned long long)v->points.rounded);
		for (int rule = VIEW_KEPT + 1; rule < VIEW_RULES; rule++)
			if (rule != VIEW_BY_DUPLICATE) /* verify_points has these */
				printf("%s\"%s\":%llu", rule > VIEW_KEPT + 1 ? "," : "", view_rule_text((enum view_rule)rule),
				       (unsigned long long)v->points.removed[rule]);
		printf("}");
	} else {
		printf(",\"points\":null,\"used\":null,\"positions\":null,\"rounded\":null,\"removed\":null");
	}
	if (v->bounded)
		printf(",\"max_error\":%s", decimal_scaled_text(v->mesh.lattice.scale_z, v->bound, place[0]));
	else
		printf(",\"max_error\":null");
	if (has_errors(v))
		printf(",\"largest_error\":%s,\"outside\":%llu", error_text(v, place[0]), (unsigned long long)v->errors.outside);
	else
		printf(",\"largest_error\":null,\"outside\":null");
	if (v->view.nweight)
		printf(",\"hidden\":%llu", (unsigned long long)v->power.hidden);
	else
		printf(",\"hidden\":null");
	if (v->line_files)
		printf(",\"lines\":{\"files\":%zu,\"pieces\":%zu,\"found\":%llu,\"out\":%llu}", v->line_files,
		       v->lines.npiece - (size_t)v->lines.left_out, (unsigned long long)v->lines.checked,
		       (unsigned long long)v->lines.left_out);
	else
		printf(",\"lines\":null");
	printf(",\"seconds\":%.3f}\n", v->seconds);
}

static void print_points(const struct verdict *v)
{
	const struct check_error *e = &v->errors;
	char text[4][DECIMAL_TEXT_SIZE];
	const struct lattice *l = &v->mesh.lattice;

	printf("  points    %llu read, %zu in the view, %llu positions: %s\n", (unsigned long long)v->points.read, v->points.n,
	       (unsigned long long)v->report.positions,
	       v->mesh.edges && !v->line_files                ? "each vertex beside lines is one of them, with its height" :
	       v->line_files && !v->lines.part && !v->partial ? "each a vertex with its height, and no other but those of lines" :
	       v->mesh.trimmed || v->partial || v->power.hidden ? "each vertex is one of them, with its height" :
								  "each a vertex with its height, and no other");
	if (v->view.nweight) {
		printf("  hidden    %llu of them: none has less power than the mesh there", (unsigned long long)v->power.hidden);
		if (v->power.outside)
			printf("; %llu more are in no triangle", (unsigned long long)v->power.outside);
		putchar('\n');
	}
	if (!has_errors(v))
		return;
	printf("  error     %s at most%s%s", error_text(v, text[0]), v->bounded ? ", within " : "",
	       v->bounded ? decimal_scaled_text(l->scale_z, v->bound, text[1]) : "");
	if (e->largest.up)
		printf("; at %s %s %s", decimal_scaled_text(l->scale_xy, e->worst.x + l->k[0], text[1]),
		       decimal_scaled_text(l->scale_xy, e->worst.y + l->k[1], text[2]),
		       decimal_scaled_text(l->scale_z, e->worst.z + l->k[2], text[3]));
	if (e->outside)
		printf("; %llu points are in no triangle", (unsigned long long)e->outside);
	putchar('\n');
}

void verdict_print_text(const struct verdict *v)
{
	const struct verify_report *r = &v->report;
	char hex[2][DIGEST_HEX_SIZE], place[3][DECIMAL_TEXT_SIZE];

	if (v->fault) {
		place_text(v, place);
		if (r->has_place)
			printf("%s: wrong (%s): %s, at %s %s %s\n", v->name, v->fault, v->text, place[0], place[1], place[2]);
		else
			printf("%s: wrong (%s): %s\n", v->name, v->fault, v->text);
		return;
	}
	printf("%s: good\n", v->name);
	if (v->mesh.ntriangle)
		printf("  shape     %zu vertices, %zu triangles, %llu edges; %s %llu %s\n", v->mesh.nvertex, v->mesh.ntriangle,
		       (unsigned long long)r->edges,
		       v->line_files && v->mesh.bounded && !v->lines.part ?
			       "it ends at boundaries or holes and at the hull, with" :
		       v->mesh.trimmed ? "a part of a mesh, with boundaries of" :
					 "one convex boundary of",
		       (unsigned long long)r->hull, v->mesh.trimmed ? "edges" : "vertices");
	else
		printf("  shape     %zu vertices, no triangles: fewer than three, or all on one line\n", v->mesh.nvertex);
	printf("  %s  %llu inner edges, %llu of them between %s vertices, by the tie rule\n",
	       v->view.nweight ? "regular " : "delaunay", (unsigned long long)r->inner, (unsigned long long)r->ties,
	       v->view.nweight ? "equally lifted" : "cocircular");
	if (v->mesh.edges)
		printf("  lines     %llu edges are pieces of lines, which need not be Delaunay%s\n",
		       (unsigned long long)r->pieces,
		       !v->line_files ? "" :
		       v->lines.part  ? ": those of the files that are in it" :
					": all that the files have");
	printf("  digest    %s %s, %s\n", digest_hex(v->digest, hex[0]), digest_hex(v->vertex_digest, hex[1]),
	       v->mesh.has_digest ? "as the file says" : "not in the file");
	if (v->with_points)
		print_points(v);
}
