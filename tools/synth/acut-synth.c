/*
 * acut-synth: a deterministic generator of surveys as LAS files, of any size in constant memory.
 *
 * A file is written once, and its header again at the end, when counts and box are known. A pipe cannot be rewound, so
 * the points are generated twice for it: once for the header, once to write; or once, with the header of an earlier run
 * (synth_head.c). The bytes are the same. A file gets its name only when it is complete.
 */
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "parse.h"
#include "synth.h"

enum { PIPE_BYTES = 1 << 20, SWATH = 640 /* metres */ };

static const char *const shape_names[SYNTH_SHAPES] = {
	"survey", "uniform",   "grid",     "clustered",         "two-clusters",     "circle",
	"ring",   "parabola",  "corridor", "corridor-diagonal", "collinear",        "duplicates",
	"swath",  "gaussians", "pipeline", "pipeline-diagonal", "pipeline-slanted", "few",
};

static const char help[] =
	"Usage: acut-synth [OPTION]... OUT\n"
	"Write a made-up LiDAR survey, the same bytes for the same options. OUT - is standard output.\n"
	"\n"
	"  --points N         how many, exactly; 10M and 1G are millions and thousands of them (1M)\n"
	"  --density D        points a square metre (8)\n"
	"  --area WxH         metres; unset: a square that the density asks for\n"
	"  --scale S          metres a step of the coordinates (0.01)\n"
	"  --origin X,Y[,Z]   the header's offset (500000,5400000,0)\n"
	"  --seed N           another seed, another survey (1)\n"
	"  --format 1|6       point format: LAS 1.2, or LAS 1.4 (1)\n"
	"  --no-crs           say nothing of the coordinate system\n"
	"  --distribution D   survey, uniform, grid, clustered, two-clusters, circle, ring, parabola, "
	"corridor,\n"
	"                     corridor-diagonal, collinear, duplicates, swath (one flight line), gaussians (1,000\n"
	"                     over six orders of magnitude of spread), pipeline, pipeline-diagonal, pipeline-slanted\n"
	"                     (--area is LENGTHxWIDTH, 300000x500), few (--positions) (survey)\n"
	"  --positions N      of few: how many positions all points lie on (1000)\n"
	"  --step N           of grid and collinear: steps from point to point\n"
	"  --range N          of the other shapes: steps from end to end, up to 4294967296\n"
	"  --head FILE        to a pipe: keep the header in FILE, or take it from there; points are then made "
	"once,\n"
	"                     not twice\n"
	"  --help, --version\n"
	"\n"
	"Exit status: 0 written, 1 FILE is of other options, 2 usage, 74 writing failed, 141 the pipe was closed.\n";

static bool parse_area(char *text, struct synth_options *o)
{
	char *x = strchr(text, 'x');

	if (!x)
		return false;
	*x = '\0';
	return parse_double(text, &o->width) && parse_double(x + 1, &o->height) && o->width > 0 && o->height > 0;
}

static bool parse_origin(char *text, struct synth_options *o)
{
	unsigned n = 0;

	for (char *word = strtok(text, ","); word; word = strtok(NULL, ","))
		if (n == 3 || !decimal_parse(word, &o->origin[n++]))
			return false;
	return n >= 2;
}

static bool parse_shape(const char *text, enum synth_shape *ret)
{
	for (unsigned i = 0; i < SYNTH_SHAPES; i++) {
		if (strcmp(text, shape_names[i]) == 0) {
			*ret = (enum synth_shape)i;
			return true;
		}
	}
	return false;
}

enum {
	OPT_POINTS = 256,
	OPT_DENSITY,
	OPT_AREA,
	OPT_SCALE,
	OPT_ORIGIN,
	OPT_SEED,
	OPT_FORMAT,
	OPT_SHAPE,
	OPT_STEP,
	OPT_RANGE,
	OPT_POSITIONS,
	OPT_NO_CRS,
	OPT_HEAD,
	OPT_HELP,
	OPT_VERSION
};

static const struct option long_options[] = {
	{"points", 1, NULL, OPT_POINTS},       {"density", 1, NULL, OPT_DENSITY},
	{"area", 1, NULL, OPT_AREA},           {"scale", 1, NULL, OPT_SCALE},
	{"origin", 1, NULL, OPT_ORIGIN},       {"seed", 1, NULL, OPT_SEED},
	{"format", 1, NULL, OPT_FORMAT},       {"distribution", 1, NULL, OPT_SHAPE},
	{"step", 1, NULL, OPT_STEP},           {"range", 1, NULL, OPT_RANGE},
	{"positions", 1, NULL, OPT_POSITIONS}, {"no-crs", 0, NULL, OPT_NO_CRS},
	{"head", 1, NULL, OPT_HEAD},           {"help", 0, NULL, OPT_HELP},
	{"version", 0, NULL, OPT_VERSION},     {0},
};

static bool parse_option(struct synth_options *o, int option, char *value, double *density)
{
	uint64_t v;

	switch (option) {
	case OPT_POINTS:
		return parse_many(value, &o->points) && o->points <= UINT64_C(1) << 48;
	case OPT_DENSITY:
		return parse_double(value, density) && *density > 0;
	case OPT_AREA:
		return parse_area(value, o);
	case OPT_SCALE:
		return decimal_parse(value, &o->scale) && o->scale.mantissa > 0 && o->scale.exponent >= -12 &&
		       o->scale.exponent <= 6;
	case OPT_ORIGIN:
		return parse_origin(value, o);
	case OPT_SEED:
		return parse_u64(value, &o->seed);
	case OPT_FORMAT:
		if (!parse_u64(value, &v) || (v != 1 && v != 6))
			return false;
		o->format = (unsigned)v;
		return true;
	case OPT_SHAPE:
		return parse_shape(value, &o->shape);
	case OPT_STEP:
		return parse_many(value, &o->step) && o->step > 0;
	case OPT_POSITIONS:
		return parse_many(value, &o->step) && o->step > 0;
	case OPT_RANGE:
		return parse_many(value, &o->range) && o->range > 0;
	default:
		o->no_crs = true;
		return true;
	}
}

/* Computes area from density, or density from area; both must fit the numbers of the file. */
static int fit_area(struct synth_options *o, double density, struct err *err)
{
	double per_scale = 1 / decimal_double(o->scale), many = (double)(o->points ? o->points : 1);

	if (!(o->width > 0) && synth_shape_length(o->shape) > 0) {
		o->width = synth_shape_length(o->shape);
		o->height = density > 0 ? many / density / o->width : 500;
		o->density = many / (o->width * o->height);
	} else if (o->width > 0) {
		if (density > 0)
			return err_set(err, ERR_USAGE, "--area and --density: give one, the other follows");
		o->density = many / (o->width * o->height);
	} else {
		o->density = density > 0 ? density : 8;
		o->width = o->height = __builtin_sqrt(many / o->density);
		if (o->shape == SYNTH_SWATH) {
			o->width = o->width < SWATH ? o->width : SWATH;
			o->height = many / o->density / o->width;
		}
	}
	if (!synth_flown(o->shape))
		return synth_shape_fit(o, err);
	if (o->width * per_scale > 0x1p31 - 1 || o->height * per_scale > 0x1p31 - 1 || 1000 * per_scale > 0x1p31 - 1) {
		err_set(err, ERR_USAGE, "%g x %g metres at this scale do not fit into 32 bits", o->width, o->height);
		return err_add_hint(err, "give a coarser --scale or a higher --density");
	}
	return 0;
}

/* Writes all points to `las`. */
static int write_points(const struct synth_options *o, struct synth_las *las, struct err *err)
{
	struct synth_point ret[SYNTH_RETURNS];
	struct synth_survey survey;
	struct synth_noise height = synth_noise_of(o->seed + 11, 1.0 / (o->range ? (double)o->range / 16 : 5000));
	int rc = 0;

	if (!synth_flown(o->shape)) {
		for (uint64_t i = 0; i < o->points && rc == 0; i++) {
			synth_shape_point(o, &height, i, ret);
			rc = synth_las_put(las, ret, 1, err);
		}
	} else {
		synth_survey_init(&survey, o);
		for (uint64_t left = o->points; left && rc == 0;) {
			unsigned n = synth_survey_next(&survey, ret);

			n = n < left ? n : (unsigned)left;
			rc = synth_las_put(las, ret, n, err);
			left -= n;
		}
	}
	return rc ? rc : synth_las_flush(las, err);
}

static int write_head(const struct synth_las *las, struct err *err)
{
	uint8_t head[SYNTH_KEPT_MAX];

	synth_las_head(las, head);
	return synth_write(las->fd, head, synth_las_head_size(las->options), las->name, err);
}

static const char stdout_name[] = "standard output";

/* Makes the header before the points: from `kept`, or by generating them all (NULL). */
static int make_header(const struct synth_options *o, const char *kept, uint8_t *head, struct err *err)
{
	struct synth_las las;
	int rc = kept ? synth_head_load(o, kept, head, err) : SYNTH_E_NONE;

	if (rc != SYNTH_E_NONE)
		return rc;
	rc = synth_las_open(&las, o, -1, stdout_name, err);
	if (rc)
		return rc;
	las.dry = true;
	rc = write_points(o, &las, err);
	synth_las_head(&las, head);
	free(las.buffer);
	return rc || !kept ? rc : synth_head_save(o, kept, head, err);
}

/* Writes to a descriptor that cannot seek, so the header is made first. */
static int write_pipe(const struct synth_options *o, const char *kept, int fd, struct err *err)
{
	uint8_t head[SYNTH_KEPT_MAX], made[SYNTH_KEPT_MAX];
	size_t size = synth_las_head_size(o);
	struct synth_las las;
	int rc = make_header(o, kept, head, err);

	fcntl(fd, F_SETPIPE_SZ, PIPE_BYTES); /* fewer context switches; fails if it is not a pipe, or not allowed */
	if (rc == 0)
		rc = synth_write(fd, head, size, stdout_name, err);
	if (rc || (rc = synth_las_open(&las, o, fd, stdout_name, err)))
		return rc;
	rc = write_points(o, &las, err);
	synth_las_head(&las, made);
	free(las.buffer);
	if (rc || memcmp(head, made, size) == 0)
		return rc;
	err_set(err, ERR_INPUT, "is not the header of the points that were written");
	return err_add_file(err, kept ? kept : stdout_name);
}

static int write_file(const struct synth_options *o, int fd, const char *name, struct err *err)
{
	struct synth_las las;
	int rc = synth_las_open(&las, o, fd, name, err);

	if (rc)
		return rc;
	rc = write_head(&las, err); /* a placeholder until the counts are known */
	if (rc == 0)
		rc = write_points(o, &las, err);
	if (rc == 0 && lseek(fd, 0, SEEK_SET) < 0) {
		err_sys(err, errno, "cannot go back to the header");
		rc = err_add_file(err, name);
	}
	if (rc == 0)
		rc = write_head(&las, err);
	free(las.buffer);
	return rc;
}

static int write_path(const struct synth_options *o, const char *kept, const char *path, struct err *err)
{
	char part[4096];
	struct stat st;
	bool whole = stat(path, &st) != 0 || S_ISREG(st.st_mode); /* a device or pipe is written directly */
	int n = snprintf(part, sizeof part, "%s%s", path, whole ? ".part" : "");

	if (n >= (int)sizeof part)
		return err_set(err, ERR_USAGE, "the name of the output is too long");
	int fd = open(part, O_WRONLY | O_CREAT | (whole ? O_TRUNC : 0) | O_CLOEXEC, 0666);

	if (fd < 0) {
		err_sys(err, errno, "cannot open");
		return err_add_file(err, part);
	}
	int rc = whole ? write_file(o, fd, path, err) : write_pipe(o, kept, fd, err);

	if (close(fd) != 0 && rc == 0) {
		err_sys(err, errno, "cannot write");
		rc = err_add_file(err, path);
	}
	if (rc == 0 && whole && rename(part, path) != 0) {
		err_sys(err, errno, "cannot rename %s", part);
		rc = err_add_file(err, path);
	}
	if (rc && whole)
		unlink(part);
	return rc;
}

static int report_result(int rc, const struct err *err)
{
	char text[1400];

	if (rc == 0)
		return 0;
	if (err->sys == EPIPE)
		return 141; /* the reader has closed the pipe */
	fprintf(stderr, "acut-synth: %s\n", err_format(err, text, sizeof text));
	return err->code == ERR_USAGE ? 2 : err->code == ERR_PERM ? 74 : err_exit_status(err->code);
}

int main(int argc, char **argv)
{
	struct synth_options o = {
		.points = 1000000, .seed = 1, .scale = {1, -2}, .format = 1, .origin = {{5, 5}, {54, 5}, {0, 0}}};
	struct err err = ERR_INIT;
	const char *kept = NULL;
	double density = 0;
	int option, rc;

	io_reserve_standard();
	signal(SIGPIPE, SIG_IGN);
	while ((option = getopt_long(argc, argv, "", long_options, NULL)) != -1) {
		if (option == OPT_HELP)
			return fputs(help, stdout) < 0 || fflush(stdout) ? 74 : 0;
		if (option == OPT_VERSION)
			return printf("acut-synth %s\n", ACUT_VERSION) < 0 || fflush(stdout) ? 74 : 0;
		if (option == '?')
			return 2; /* getopt has printed the error */
		if (option == OPT_HEAD) {
			kept = optarg;
			continue;
		}
		if (!parse_option(&o, option, optarg, &density)) {
			fprintf(stderr, "acut-synth: %s: not a value for --%s (see --help)\n", optarg,
				long_options[option - OPT_POINTS].name);
			return 2;
		}
	}
	if (optind + 1 != argc) {
		fputs("acut-synth: give one OUT, or - for standard output (see --help)\n", stderr);
		return 2;
	}
	rc = fit_area(&o, density, &err);
	if (rc == 0)
		rc = strcmp(argv[optind], "-") == 0 ? write_pipe(&o, kept, STDOUT_FILENO, &err) :
						      write_path(&o, kept, argv[optind], &err);
	return report_result(rc, &err);
}
