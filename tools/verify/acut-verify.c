/*
 * acut-verify: whether a file is the Delaunay triangulation that it claims to be, and of these points.
 *
 * engine/mesh/verify.h, which shares no code with the kernel, checks the mesh. check_digest.c, which shares no code
 * with base, computes the digests. check_lines.h is about lines that the mesh must have as edges. Everything is in memory.
 */
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "verdict.h"

static const char help[] =
	"Usage: acut-verify [OPTION]... MESH [POINTS]...\n"
	"Check a mesh (PLY as acutctl writes it; - is standard input): shape, exact Delaunay, tie rule,\n"
	"digests; and, if POINTS are named (LAS or XYZ files, or PLY, whose vertices count), that its\n"
	"vertices are just those points.\n"
	"\n"
	"What the mesh was made of, as for acutctl:\n"
	"  --class LIST, --not-class LIST, --returns all|first|last, --ground, --surface,\n"
	"  --duplicates lowest|highest"
#define VIEW_FLAG(field, word, help) ", --" word
#include "view_option.def"
	";\n"
	"  --metric P,Q,K; --planar is always meant\n"
	"  --view TEXT        in place of all of these, the text of any view (acutctl show prints it)\n"
	"  --weight CLASS=RADIUS,...; FILE=RADIUS,... of POINTS; also beside --view, in place of its weights\n"
	"\n"
	"The files of lines that the mesh was made with: each piece must be an edge, and marked.\n"
	"  --breaklines FILE, --lakes FILE, --boundary FILE, --holes FILE, --layer NAME, --kind-field NAME,\n"
	"  --densify LENGTH, --lake-level min|max|mean: as for acutctl mesh; FILE may also be a text of lines\n"
	"\n"
	"  --max-error LENGTH the vertices are some of the POINTS, and none of the others is more than\n"
	"                     LENGTH (0.1m, or in units of the heights) above or below the mesh\n"
	"  --columns LETTERS, --decimal-comma: of POINTS that are texts, as for acutctl\n"
	"  --json             one JSON object\n"
	"  --quiet            say nothing of a good mesh\n"
	"  --help, --version\n"
	"\n"
	"Exit status: 0 good, 1 the mesh is wrong or a file is broken, 2 usage, 74 reading failed.\n";

enum {
	OPT_CLASS = 256,
	OPT_NOT_CLASS,
	OPT_RETURNS,
	OPT_GROUND,
	OPT_SURFACE,
#define VIEW_FLAG(field, ...) OPT_##field,
#include "view_option.def"
	OPT_DUPLICATES,
	OPT_METRIC,
	OPT_WEIGHT,
	OPT_VIEW,
	OPT_BREAKLINES, /* in the order of enum lines_kind */
	OPT_LAKES,
	OPT_BOUNDARY,
	OPT_HOLES,
	OPT_LAYER,
	OPT_KIND_FIELD,
	OPT_DENSIFY,
	OPT_LAKE_LEVEL,
	OPT_PLANAR,
	OPT_MAX_ERROR,
	OPT_COLUMNS,
	OPT_DECIMAL_COMMA,
	OPT_JSON,
	OPT_QUIET,
	OPT_HELP,
	OPT_VERSION
};

static const struct option long_options[] = {
	{"class", 1, NULL, OPT_CLASS},
	{"not-class", 1, NULL, OPT_NOT_CLASS},
	{"returns", 1, NULL, OPT_RETURNS},
	{"ground", 0, NULL, OPT_GROUND},
	{"surface", 0, NULL, OPT_SURFACE},
#define VIEW_FLAG(field, word, help) {word, 0, NULL, OPT_##field},
#include "view_option.def"
	{"duplicates", 1, NULL, OPT_DUPLICATES},
	{"view", 1, NULL, OPT_VIEW},
	{"breaklines", 1, NULL, OPT_BREAKLINES},
	{"lakes", 1, NULL, OPT_LAKES},
	{"boundary", 1, NULL, OPT_BOUNDARY},
	{"holes", 1, NULL, OPT_HOLES},
	{"layer", 1, NULL, OPT_LAYER},
	{"kind-field", 1, NULL, OPT_KIND_FIELD},
	{"densify", 1, NULL, OPT_DENSIFY},
	{"lake-level", 1, NULL, OPT_LAKE_LEVEL},
	{"metric", 1, NULL, OPT_METRIC},
	{"weight", 1, NULL, OPT_WEIGHT},
	{"planar", 0, NULL, OPT_PLANAR},
	{"max-error", 1, NULL, OPT_MAX_ERROR},
	{"columns", 1, NULL, OPT_COLUMNS},
	{"decimal-comma", 0, NULL, OPT_DECIMAL_COMMA},
	{"json", 0, NULL, OPT_JSON},
	{"quiet", 0, NULL, OPT_QUIET},
	{"help", 0, NULL, OPT_HELP},
	{"version", 0, NULL, OPT_VERSION},
	{0},
};

/* Index of a word in a list, -1 if it is not there. */
static int find_choice(const char *word, const char *const *words, int n)
{
	for (int i = 0; i < n; i++)
		if (strcmp(word, words[i]) == 0)
			return i;
	return -1;
}

static int parse_metric(struct verdict *v, const char *text, struct err *err)
{
	long long p, q, k;
	int n = 0;

	if (sscanf(text, "%lld,%lld,%lld%n", &p, &q, &k, &n) != 3 || text[n] || k < 1)
		return err_set(err, ERR_USAGE, "--metric is not P,Q,K: %s", text);
	v->view.metric = (struct view_metric){p, q, k};
	return view_metric_check(v->view.metric, err);
}

static void parse_line_option(struct verdict *v, int option, const char *value)
{
	switch (option) {
	case OPT_LAYER:
		v->line_options.layer = value;
		break;
	case OPT_KIND_FIELD:
		v->line_options.kind_field = value;
		break;
	case OPT_DENSIFY:
		v->line_options.text.densify = value;
		break;
	case OPT_LAKE_LEVEL:
		v->line_options.text.lake_level = value;
		break;
	default:
		v->line_kind[v->line_files] = (uint8_t)(option - OPT_BREAKLINES);
		v->line_file[v->line_files++] = value;
		break;
	}
}

static int parse_option(struct verdict *v, int option, const char *value, struct err *err)
{
	static const char *const returns[] = {"all", "first", "last"};
	static const char *const duplicates[] = {"lowest", "highest"};
	int i = 0;

	v->options |= option < OPT_VIEW && option != OPT_WEIGHT;
	if (option >= OPT_BREAKLINES && option <= OPT_LAKE_LEVEL) {
		parse_line_option(v, option, value);
		return 0;
	}
	switch (option) {
	case OPT_CLASS:
		return view_set_classes(&v->view, value, err);
	case OPT_NOT_CLASS:
		return view_set_not_classes(&v->view, value, err);
	case OPT_METRIC:
		return parse_metric(v, value, err);
	case OPT_WEIGHT:
		v->weight_text = value;
		break;
	case OPT_VIEW:
		v->view_text = value;
		break;
	case OPT_RETURNS:
		v->view.returns = (uint8_t)(i = find_choice(value, returns, 3));
		break;
	case OPT_DUPLICATES:
		v->view.duplicates = (uint8_t)(i = find_choice(value, duplicates, 2));
		break;
	case OPT_GROUND:
		v->view.ground = true;
		break;
	case OPT_SURFACE:
		v->view.surface = true;
		break;
#define VIEW_FLAG(field, ...)         \
	case OPT_##field:             \
		v->view.field = true; \
		break;
#include "view_option.def"
	case OPT_PLANAR:
		break;
	case OPT_MAX_ERROR:
		v->bound_text = value;
		break;
	case OPT_COLUMNS:
		v->points.columns = value;
		break;
	case OPT_DECIMAL_COMMA:
		v->points.decimal_comma = true;
		break;
	case OPT_JSON:
		v->json = true;
		break;
	default:
		v->quiet = true;
		break;
	}
	return i < 0 ? err_set(err, ERR_USAGE, "%s is no choice (see --help)", value) : 0;
}

static void set_fault(struct verdict *v, const char *fault, const char *text)
{
	if (v->fault)
		return;
	v->fault = fault;
	snprintf(v->text, sizeof v->text, "%s", text);
}

static int read_mesh(struct verdict *v, struct err *err)
{
	bool standard = strcmp(v->name, "-") == 0;
	int fd = standard ? STDIN_FILENO : open(v->name, O_RDONLY | O_CLOEXEC), rc;

	if (fd < 0) {
		err_sys(err, errno, "cannot open");
		return err_add_file(err, v->name);
	}
	rc = check_ply_read(fd, standard ? "standard input" : v->name, &v->mesh, err);
	if (!standard)
		close(fd);
	return rc;
}

static void check_digests(struct verdict *v)
{
	v->digest = check_triangle_digest(&v->mesh);
	v->vertex_digest = check_vertex_digest(&v->mesh);
	if (!v->mesh.has_digest)
		return;
	if (!digest_equal(v->digest, v->mesh.digest))
		set_fault(v, "digest", "the digest of the triangles is not the one in the file");
	else if (!digest_equal(v->vertex_digest, v->mesh.vertex_digest))
		set_fault(v, "vertex-digest", "the digest of the vertices is not the one in the file");
}

static int read_points(struct verdict *v, const char *path, struct err *err)
{
	struct check_mesh points;
	bool ply;
	int r = check_ply_is(path, &ply, err), fd;

	if (r)
		return err_add_file(err, path);
	if (!ply)
		return check_points_read(&v->points, path, &v->mesh.lattice, &v->view, err);
	if (check_points_by_class(&v->points, &v->view)) {
		err_set(err, ERR_USAGE, "points of a PLY have no classes, and so no weights");
		return err_add_file(err, path);
	}
	r = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);
	if (r)
		return err_add_file(err, path);
	r = check_ply_read(fd, path, &points, err);
	io_close(fd);
	if (r)
		return r;
	r = check_points_mesh(&v->points, &points, &v->mesh.lattice, err);
	check_mesh_clear(&points);
	return r ? err_add_file(err, path) : 0;
}

static void set_place(struct verdict *v, const struct point *p)
{
	v->report.has_place = true;
	v->report.place[0] = p->x;
	v->report.place[1] = p->y;
	v->report.place[2] = p->z;
}

/* Points that no vertex has. verify_points has left one point of each position, at the front. A part of a mesh, and one with
 * lines, which may be a boundary or holes, need not cover all. */
static int check_errors(struct verdict *v, struct err *err)
{
	const struct check_fraction bound = {v->bound, 1};
	const struct check_error *e = &v->errors;
	int r = check_error(&v->mesh, v->points.pts, v->report.positions, &v->errors, err);

	if (r)
		return r;
	if (e->outside && !v->mesh.trimmed && !v->mesh.edges) {
		set_place(v, &e->stray);
		set_fault(v, "uncovered", "a point is in no triangle of the mesh");
	} else if (v->bounded && check_fraction_compare(e->largest, bound) > 0) {
		set_place(v, &e->worst);
		set_fault(v, "error", "a point is further from the mesh than the bound allows");
	}
	return 0;
}

static int read_lines(struct verdict *v, struct err *err)
{
	struct check_lines_options o = v->line_options;
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < v->line_files; i++) {
		o.text.kind = lines_kind_text[v->line_kind[i]];
		rc = check_lines_read(&v->lines, v->line_file[i], &o, &v->mesh, err);
	}
	if (rc == 0 && v->line_files && v->view.no_breaklines) {
		err_set(err, ERR_USAGE, "the view leaves all lines out");
		return err_add_hint(err, "leave out --no-breaklines, or the files of lines");
	}
	if (rc || !v->line_files)
		return rc;
	v->points.lines = &v->lines;
	return check_lines_round(&v->lines, (double)v->view.breakline_clear, err);
}

/* What lines say of the mesh comes before what its edges say: an edge that is not Delaunay may be a piece without a mark. */
static int compare_lines(struct verdict *v, struct err *err)
{
	struct verify_report *r = &v->report;
	int rc;

	if (r->fault && r->fault != VERIFY_DELAUNAY && r->fault != VERIFY_TIE && r->fault != VERIFY_PIECE)
		return 0;
	rc = check_lines_mesh(&v->lines, &v->mesh, &v->view, &v->line_fault, err);
	if (rc || !v->line_fault.fault)
		return rc;
	set_fault(v, v->line_fault.fault, v->line_fault.text);
	r->has_place = true;
	memcpy(r->place, v->line_fault.place, sizeof r->place);
	return 0;
}

/* Of a mesh without triangles all points are vertices. */
static int compare_points(struct verdict *v, struct verify_mesh m, struct err *err)
{
	bool some = v->partial && m.ntriangle;
	int rc = 0;

	if (v->view.thin.cell)
		rc = check_points_thin(&v->points, &v->view, err);
	if (v->line_files) { /* so it is known what must be there */
		m.edges = NULL;
		m.trimmed = v->lines.part;
		rc = rc ? rc : check_lines_points(&v->lines, &v->view, &v->points, err);
	}
	if (rc || v->report.fault || v->fault)
		return rc;
	m.trimmed = m.trimmed || some;
	rc = verify_points(&m, &v->view, v->points.pts, v->points.n, &v->report, err);
	return !rc && some && !v->report.fault ? check_errors(v, err) : rc;
}

static int read_inputs(struct verdict *v, char **inputs, struct err *err)
{
	int rc = 0;

	for (uint32_t number = 1; !rc && *inputs; inputs++, number++) {
		v->with_points = true;
		v->points.slot = v->view.slots ? slots_of(v->view.slots, number) : 0;
		rc = read_points(v, *inputs, err);
	}
	return rc;
}

static int refuse_weighted(const struct verdict *v, char **inputs, struct err *err)
{
	if (v->view.hidden)
		return err_set(err, ERR_UNSUPPORTED, "a mesh of what weights hide has no triangles to check");
	if (v->view.slots && !v->weight_text) {
		err_set(err, ERR_UNSUPPORTED, "the weights of the view are those of files, by their numbers in the dataset");
		return err_add_hint(err, "give --weight beside --view, with names of POINTS: --weight b.las=0.5m");
	}
	if (v->line_files)
		return err_set(err, ERR_USAGE, "a mesh with weights has no lines");
	if (v->bound_text)
		return err_set(err, ERR_USAGE, "a mesh with weights has no bound of errors");
	if (*inputs)
		return 0;
	err_set(err, ERR_USAGE, "with weights the points are needed: they have the classes, and the mesh does not");
	return err_add_hint(err, "name the files of points after the mesh");
}

/* All points that are no vertices must be hidden. */
static int check_hidden(struct verdict *v, struct err *err)
{
	const struct check_power *p = &v->power;
	int rc = check_power(&v->mesh, v->weight, &v->view, v->points.pts, v->report.positions, &v->power, err);

	v->points.removed[VIEW_BY_WEIGHT] = p->hidden;
	if (rc || !(p->found || (p->outside && !v->mesh.trimmed)))
		return rc;
	set_place(v, p->found ? &p->visible : &p->stray);
	if (p->found)
		set_fault(v, "hidden", "a point is no vertex, and is not hidden: it has less power than the mesh there");
	else
		set_fault(v, "uncovered", "a point is in no triangle of the mesh");
	return 0;
}

/* Points come first: they have the weights. */
static int check_weighted(struct verdict *v, struct verify_mesh m, char **inputs, struct err *err)
{
	struct verify_mesh some = m;
	struct verify_report points = {0}, *r = &v->report;
	int rc;

	some.trimmed = m.trimmed || m.ntriangle; /* without triangles nothing is hidden */
	if ((rc = read_inputs(v, inputs, err)) || (v->view.thin.cell && (rc = check_points_thin(&v->points, &v->view, err))) ||
	    (rc = verify_points(&some, &v->view, v->points.pts, v->points.n, &points, err)) ||
	    (rc = check_power_weights(&v->mesh, &v->view, v->points.pts, points.positions, &v->weight, err)))
		return rc;
	m.weight = v->weight;
	if ((rc = verify_mesh(&m, r, err)))
		return rc;
	if (!r->fault)
		check_digests(v);
	if (!r->fault && points.fault) {
		r->fault = points.fault;
		r->has_place = points.has_place;
		memcpy(r->text, points.text, sizeof r->text);
		memcpy(r->place, points.place, sizeof r->place);
	}
	r->points = points.points;
	r->positions = points.positions;
	r->absent = points.absent;
	return r->fault || v->fault || !m.ntriangle ? 0 : check_hidden(v, err);
}

static int check_all(struct verdict *v, char **inputs, struct err *err)
{
	struct view_metric metric;
	struct verify_mesh m;
	int rc = read_mesh(v, err);

	if (rc)
		return rc;
	if ((rc = verdict_view(v, err)) || (rc = verdict_weights(v, inputs, err)) ||
	    (v->view.nweight && (rc = refuse_weighted(v, inputs, err))))
		return rc;
	view_bind(&v->view, &v->mesh.lattice);
	metric = view_metric_normal(v->view.metric);
	if ((rc = read_lines(v, err)) || (rc = verdict_bound(v, err)))
		return rc;
	m = (struct verify_mesh){.vertex = (const int32_t(*)[3])v->mesh.vertex,
				 .triangle = (const uint32_t(*)[3])v->mesh.triangle,
				 .edges = v->mesh.edges,
				 .nvertex = v->mesh.nvertex,
				 .ntriangle = v->mesh.ntriangle,
				 .trimmed = v->mesh.trimmed,
				 .p = metric.p,
				 .q = metric.q,
				 .k = metric.k};
	if (v->view.nweight)
		return check_weighted(v, m, inputs, err);
	if ((rc = verify_mesh(&m, &v->report, err)))
		return rc;
	if (v->report.fault == VERIFY_INDEX) /* nothing else can be checked */
		return 0;
	if (v->line_files && (rc = compare_lines(v, err)))
		return rc;
	if (!v->report.fault)
		check_digests(v);
	rc = read_inputs(v, inputs, err);
	return !rc && v->with_points ? compare_points(v, m, err) : rc;
}

static int print_result(const struct err *err)
{
	char text[1400];

	fprintf(stderr, "acut-verify: %s\n", err_format(err, text, sizeof text));
	return err->code == ERR_PERM || err->code == ERR_NOMEM ? 74 : err_exit_status(err->code);
}

static int verify_file(struct verdict *v, char **inputs)
{
	struct err err = ERR_INIT;
	uint64_t start = clock_mono_ns();
	int status;

	if (check_all(v, inputs, &err)) {
		status = print_result(&err);
	} else {
		if (v->report.fault)
			set_fault(v, verify_fault_text(v->report.fault), v->report.text);
		v->seconds = clock_since(start);
		if (v->json)
			verdict_print_json(v);
		else if (v->fault || !v->quiet)
			verdict_print_text(v);
		status = v->fault ? 1 : 0;
	}
	check_mesh_clear(&v->mesh);
	check_points_clear(&v->points);
	check_lines_clear(&v->lines);
	free(v->line_file);
	free(v->line_kind);
	free(v->weight);
	view_done(&v->view);
	if (fflush(stdout) || ferror(stdout)) {
		fprintf(stderr, "acut-verify: cannot write to standard output: %s\n", strerror(errno));
		return 74;
	}
	return status;
}

int main(int argc, char **argv)
{
	static struct verdict v = {.view = {.returns = VIEW_RETURNS_ALL, .duplicates = VIEW_LOWEST}};
	struct err err = ERR_INIT;
	int option;

	io_reserve_standard();
	setlocale(LC_CTYPE, "C.UTF-8"); /* in names of files a ? is a letter */
	v.line_file = calloc((size_t)argc, sizeof *v.line_file);
	v.line_kind = calloc((size_t)argc, 1);
	if (!v.line_file || !v.line_kind)
		return 74;
	while ((option = getopt_long(argc, argv, "", long_options, NULL)) != -1) {
		if (option == '?')
			return 2; /* getopt has printed the error */
		if (option == OPT_HELP || option == OPT_VERSION) {
			if (option == OPT_HELP)
				fputs(help, stdout);
			else
				printf("acut-verify %s\n", ACUT_VERSION);
			return fflush(stdout) || ferror(stdout) ? 74 : 0;
		}
		if (parse_option(&v, option, optarg, &err))
			return print_result(&err);
	}
	if (optind >= argc) {
		fputs("acut-verify: give a MESH (see --help)\n", stderr);
		return 2;
	}
	if (v.view_text && v.options) {
		fputs("acut-verify: --view stands in place of the other options of a view\n", stderr);
		return 2;
	}
	if (view_check(&v.view, &err) || lines_export_check(&v.line_options.text, &err))
		return print_result(&err);
	v.name = argv[optind];
	return verify_file(&v, argv + optind + 1);
}
