/*
 * Where the client's time goes: a recorded mesh stream through a pipe, each line with one more of the steps that
 * acutctl does, CPU time a vertex of this process alone and what the step adds. The best of three.
 * usage: bench-client STREAM FOLDER (bench/client/record makes STREAM)
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"
#include "decimal.h"
#include "err.h"
#include "outputs.h"
#include "stream.h"

enum { PIPE, READER, CHECK, FORMAT };

struct bench {
	int step;
	const char *stream, *folder;
	struct stream_reader *reader;
	struct check *check;
	struct outputs *run;
	struct acut_mesh_sink sink;
	char scale[2][DECIMAL_TEXT_SIZE];
	struct err err;
};

static double seconds(struct timeval t)
{
	return (double)t.tv_sec + (double)t.tv_usec * 1e-6;
}

static void die(const char *what, const struct err *err)
{
	fprintf(stderr, "bench-client: %s: %s\n", what, err ? err->message : "failed");
	exit(1);
}

/* A process that writes the file into a pipe like the daemon's. */
static pid_t feeder(const char *path, int *ret_fd)
{
	int file = open(path, O_RDONLY), end[2];
	pid_t pid;

	if (file < 0 || pipe(end) || (pid = fork()) < 0)
		die(path, NULL);
	fcntl(end[1], F_SETPIPE_SZ, 1 << 20);
	if (!pid) {
		char *buf = malloc(1 << 20);
		ssize_t n;

		close(end[0]);
		while ((n = read(file, buf, 1 << 20)) > 0)
			for (ssize_t k, at = 0; at < n; at += k)
				if ((k = write(end[1], buf + at, (size_t)(n - at))) < 0)
					_exit(1);
		_exit(0);
	}
	close(file);
	close(end[1]);
	*ret_fd = end[0];
	return pid;
}

static int on_head(struct bench *b)
{
	const struct stream_head *h = stream_reader_head(b->reader);
	struct acut_mesh_head head = {.lattice = h->lattice,
				      .scale_xy = b->scale[0],
				      .scale_z = b->scale[1],
				      .crs = h->crs,
				      .unit_xy = h->unit_xy,
				      .unit_z = h->unit_z,
				      .view = h->view,
				      .stream_id = ""};
	long long k[3];

	if (sscanf(h->lattice, "%31s %31s %lld %lld %lld", b->scale[0], b->scale[1], &k[0], &k[1], &k[2]) != 5)
		die("lattice", NULL);
	for (int i = 0; i < 3; i++)
		head.k[i] = k[i];
	memcpy(head.box, h->box, sizeof(head.box));
	if (b->step >= CHECK)
		b->check = check_new(head.k);
	return b->step >= FORMAT ? b->sink.head(b->sink.ctx, &head) : 0;
}

static int on_block(struct bench *b)
{
	const struct stream_block *s = stream_reader_block(b->reader);
	struct acut_mesh_block out = {.index = s->index,
				      .first = s->first,
				      .foreign = s->foreign,
				      .vertex = s->vertex,
				      .triangle = s->triangle,
				      .final = s->final,
				      .flags = s->flags,
				      .nforeign = s->nforeign,
				      .nnew = s->nnew,
				      .ntriangle = s->ntriangle};

	memcpy(out.box, s->box, sizeof(out.box));
	if (b->step >= CHECK && check_block(b->check, s, &out.local, &b->err))
		return 1;
	return b->step >= FORMAT ? b->sink.block(b->sink.ctx, &out) : 0;
}

static int on_tail(struct bench *b)
{
	const struct stream_tail *t = stream_reader_tail(b->reader);
	char digest[2][DIGEST_HEX_SIZE];
	struct acut_mesh_tail tail = {.blocks = t->blocks,
				      .vertices = t->vertices,
				      .triangles = t->triangles,
				      .hull = t->hull,
				      .digest = digest_hex(t->digest, digest[0]),
				      .vertex_digest = digest_hex(t->vertex_digest, digest[1]),
				      .report = t->report};

	if (b->step >= CHECK && check_tail(b->check, t, true, &b->err))
		return 1;
	return b->step >= FORMAT ? b->sink.tail(b->sink.ctx, &tail) : 0;
}

static void feed(struct bench *b, int fd)
{
	enum stream_event event;
	size_t room;
	ssize_t n;
	void *to;

	for (;;) {
		int r = 0;

		if (stream_reader_space(b->reader, &to, &room, &b->err))
			die("space", &b->err);
		n = read(fd, to, room);
		if (n <= 0)
			return;
		if (stream_reader_feed(b->reader, (size_t)n, &event, &b->err))
			die("stream", &b->err);
		r = event == STREAM_HEAD  ? on_head(b) :
		    event == STREAM_BLOCK ? on_block(b) :
		    event == STREAM_TAIL  ? on_tail(b) :
					    0;
		if (r)
			die("block", b->run && outputs_error(b->run)->code ? outputs_error(b->run) : &b->err);
	}
}

static void swallow(int fd)
{
	const size_t size = 24 << 20; /* a block's */
	char *buf = malloc(size);
	size_t at = 0;
	ssize_t n;

	while ((n = read(fd, buf + at, size - at)) > 0)
		at = at + (size_t)n < size ? at + (size_t)n : 0;
	free(buf);
}

static void open_format(struct bench *b, const char *name)
{
	const struct outputs_options ropt = {.edges = true};
	const struct format_options opt = {0};
	const struct format *f = format_find(name);
	char path[512];

	snprintf(path, sizeof(path), "%s/bench-client.%s", b->folder, name);
	if (outputs_new(&ropt, &b->run, &b->err) ||
	    outputs_add(b->run, f->kind == FORMAT_NOTHING ? NULL : path, f, &opt, &b->err))
		die(path, &b->err);
	b->sink = outputs_sink(b->run);
}

/* user and system time, seconds; the number of vertices */
static uint64_t once(const char *stream, const char *folder, int step, const char *format, double ret[2])
{
	struct bench b = {.step = step, .stream = stream, .folder = folder, .err = ERR_INIT};
	struct rusage from, to;
	uint64_t vertices = 0;
	int fd, status;
	pid_t pid = feeder(stream, &fd);

	getrusage(RUSAGE_SELF, &from);
	if (step == PIPE) {
		swallow(fd);
	} else {
		b.reader = stream_reader_new();
		if (step >= FORMAT)
			open_format(&b, format);
		feed(&b, fd);
		if (step >= FORMAT && outputs_publish(b.run, &b.err))
			die("publish", &b.err);
		vertices = stream_reader_tail(b.reader)->vertices;
		outputs_free(b.run);
		check_free(b.check);
		stream_reader_free(b.reader);
	}
	getrusage(RUSAGE_SELF, &to);
	close(fd);
	waitpid(pid, &status, 0);
	ret[0] = seconds(to.ru_utime) - seconds(from.ru_utime);
	ret[1] = seconds(to.ru_stime) - seconds(from.ru_stime);
	return vertices;
}

int main(int argc, char **argv)
{
	static const struct {
		const char *name;
		int step;
		const char *format;
		int below;
	} row[] = {
		{"pipe", PIPE, NULL, -1},           {"+ checksum, numbering", READER, NULL, 0},
		{"+ digests", CHECK, NULL, 1},      {"+ edges, format null", FORMAT, "null", 2},
		{"+ format ply", FORMAT, "ply", 2}, {"+ format obj", FORMAT, "obj", 2},
	};
	double best[6];
	struct rusage ru;

	if (argc < 3)
		return fprintf(stderr, "usage: bench-client STREAM FOLDER\n"), 2;
	printf("%-22s %8s %8s %8s  %s\n", "", "user s", "sys s", "us/point", "of the step");
	for (int i = 0; i < 6; i++) {
		uint64_t n = 0;
		double t[2], user = 0, sys = 0;

		best[i] = 1e9;
		for (int k = 0; k < 3; k++) {
			n = once(argv[1], argv[2], row[i].step, row[i].format, t);
			if (t[0] + t[1] < best[i]) {
				best[i] = t[0] + t[1];
				user = t[0];
				sys = t[1];
			}
		}
		if (row[i].step == PIPE) {
			double ignored[2];
			n = once(argv[1], argv[2], READER, NULL, ignored);
		}
		printf("%-22s %8.3f %8.3f %8.4f  %+.4f\n", row[i].name, user, sys, best[i] * 1e6 / (double)n,
		       (best[i] - (row[i].below < 0 ? 0 : best[row[i].below])) * 1e6 / (double)n);
		fflush(stdout);
	}
	getrusage(RUSAGE_SELF, &ru);
	printf("largest resident size %ld KiB\n", ru.ru_maxrss);
	return 0;
}
