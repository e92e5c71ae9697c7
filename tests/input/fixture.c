#include "fixture.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cursor.h"
#include "io.h"

unsigned fixture_length(unsigned format)
{
	static const unsigned length[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};

	return length[format];
}

size_t fixture_header_size(unsigned minor)
{
	return minor < 3 ? 227 : minor == 3 ? 235 : minor == 4 ? 375 : 393;
}

static const struct io_table *before;
struct fixture_faults fixture_faults;

static bool fails(void)
{
	bool fail = ++fixture_faults.calls == fixture_faults.fail_at;

	if (fail)
		errno = EIO;
	return fail;
}

static ssize_t faulty_pread(int fd, void *buf, size_t n, off_t off)
{
	size_t most = fixture_faults.at_most;

	return fails() ? -1 : before->pread(fd, buf, most && n > most ? most : n, off);
}

static int faulty_fstat(int fd, struct stat *st)
{
	return fails() ? -1 : before->fstat(fd, st);
}

void fixture_faults_begin(void)
{
	static struct io_table table;

	before = io;
	table = *before;
	table.pread = faulty_pread;
	table.fstat = faulty_fstat;
	io = &table;
	fixture_faults = (struct fixture_faults){0};
}

void fixture_faults_end(void)
{
	io = before;
}

uint32_t fixture_random(uint64_t *state)
{
	*state = *state * 6364136223846793005u + 1442695040888963407u;
	return (uint32_t)(*state >> 32);
}

void fixture_record(unsigned format, unsigned length, uint64_t i, uint8_t *ret)
{
	uint64_t state = i * 0x9e3779b97f4a7c15u + format;

	for (unsigned k = 0; k < length; k++)
		ret[k] = (uint8_t)(fixture_random(&state) >> 8);
	if (i == 0)
		memcpy(ret, "\0\0\0\x80\xff\xff\xff\x7f\xff\xff\xff\xff", 12); /* int32 extremes, -1 */
}

static void put_vlr(struct packer *p, const char *wkt, bool extended)
{
	char user[16] = "LASF_Projection";

	packer_u16(p, 0);
	packer_bytes(p, user, 16);
	packer_u16(p, 2112);
	if (extended)
		packer_u64(p, strlen(wkt));
	else
		packer_u16(p, (uint16_t)strlen(wkt));
	packer_zero(p, 32);
	packer_bytes(p, wkt, strlen(wkt));
}

static void put_header(struct packer *p, const struct las_spec *s, uint32_t point_offset, uint64_t behind)
{
	bool legacy = s->format < 6 || s->minor < 4;
	uint32_t n = legacy ? (uint32_t)s->n : 0, n_vlrs = (s->wkt && !s->wkt_behind) + s->vlrs_more;

	packer_bytes(p, "LASF", 4);
	packer_u16(p, 0);
	packer_u16(p, s->encoding);
	packer_zero(p, 16);
	packer_u8(p, 1);
	packer_u8(p, (uint8_t)s->minor);
	packer_zero(p, 64);
	packer_zero(p, 4);
	packer_u16(p, (uint16_t)(fixture_header_size(s->minor) + s->header_extra));
	packer_u32(p, point_offset);
	packer_u32(p, n_vlrs);
	packer_u8(p, (uint8_t)s->format);
	packer_u16(p, (uint16_t)(fixture_length(s->format) + s->extra));
	packer_u32(p, n);
	packer_zero(p, 20);
	packer_f64(p, 0.01);
	packer_f64(p, 0.01);
	packer_f64(p, 0.001);
	packer_f64(p, 500000);
	packer_f64(p, 4000000);
	packer_f64(p, 0);
	for (int i = 0; i < 3; i++) {
		packer_f64(p, 1000);
		packer_f64(p, -1000);
	}
	if (s->minor >= 3)
		packer_u64(p, 0);
	if (s->minor >= 4) {
		packer_u64(p, s->wkt_behind ? behind : 0);
		packer_u32(p, s->wkt_behind);
		packer_u64(p, s->n);
		packer_zero(p, 120);
	}
	if (s->minor >= 5)
		packer_zero(p, 18);
	packer_zero(p, s->header_extra);
}

struct bytes fixture_las(const struct las_spec *s)
{
	unsigned length = fixture_length(s->format) + s->extra;
	size_t wkt = s->wkt ? strlen(s->wkt) : 0, header = fixture_header_size(s->minor) + s->header_extra;
	size_t point_offset = header + (wkt && !s->wkt_behind ? 54 + wkt : 0) + s->gap;
	size_t behind = point_offset + s->n * length;
	struct bytes b = {.size = behind + (s->wkt_behind ? 60 + wkt : 0)};
	struct packer p;

	b.at = calloc(1, b.size);
	p = packer_of(b.at, b.size);
	put_header(&p, s, (uint32_t)point_offset, behind);
	if (packer_size(&p) != header)
		abort();
	if (wkt && !s->wkt_behind)
		put_vlr(&p, s->wkt, false);
	packer_zero(&p, s->gap);
	for (uint64_t i = 0; i < s->n; i++, p.at += length)
		fixture_record(s->format, length, i, p.at);
	if (s->wkt_behind)
		put_vlr(&p, s->wkt, true);
	if (p.bad || packer_size(&p) != b.size)
		abort();
	return b;
}

int fixture_fd(const void *bytes, size_t size)
{
	int fd = memfd_create("input", MFD_CLOEXEC);

	if (fd < 0 || (size && pwrite(fd, bytes, size, 0) != (ssize_t)size))
		abort();
	return fd;
}

void fixture_points_new(struct input_points *pts, size_t cap)
{
	*pts = (struct input_points){.cap = cap};
	pts->raw = malloc(cap * sizeof *pts->raw);
	pts->cls = malloc(cap);
	pts->ret = malloc(cap);
	pts->flags = malloc(cap);
}

void fixture_points_free(struct input_points *pts)
{
	free(pts->raw);
	free(pts->cls);
	free(pts->ret);
	free(pts->flags);
}

struct outcome fixture_read_fd(int fd, const char *name, const struct input_options *options, size_t batch)
{
	struct outcome out = {.err = ERR_INIT};
	struct input_points pts;
	struct input *in = NULL;
	int rc = input_open(fd, name, options, &in, &out.err);

	out.code = (enum err_code) - rc;
	if (rc)
		return out;
	out.info = *input_info(in);
	fixture_points_new(&pts, batch);
	do {
		rc = input_read(in, &pts, &out.err);
		if (!rc)
			out.points += pts.n;
	} while (!rc && pts.n);
	out.code = (enum err_code) - rc;
	memcpy(out.info.warning, input_info(in)->warning, sizeof out.info.warning);
	fixture_points_free(&pts);
	input_close(in);
	return out;
}

struct outcome fixture_read(const void *bytes, size_t size, const char *name, const struct input_options *options, size_t batch)
{
	int fd = fixture_fd(bytes, size);
	struct outcome out = fixture_read_fd(fd, name, options, batch);

	close(fd);
	return out;
}

const char *fixture_data(void)
{
	static char path[4096];
	const char *env = getenv("ACUT_TEST_DATA"), *source = getenv("ACUT_TEST_SOURCE");
	struct stat st;

	if (env && *env)
		snprintf(path, sizeof path, "%s", env);
	else
		snprintf(path, sizeof path, "%s/../shared/data", source ? source : ".");
	if (stat(path, &st) == 0 && S_ISDIR(st.st_mode))
		return path;
	printf("skipped: no test data in %s (set ACUT_TEST_DATA)\n", path);
	return "";
}
