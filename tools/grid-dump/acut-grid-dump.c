/*
 * acut-grid-dump [--check] [--cells] [--records] FILE...: the content of a manifest, segment or sorted run as text.
 *
 * --check reads every byte and derives every number again from the records: checksums, sums, boxes, counts, the order
 * of records, and that every cell is as large as possible. The segments of a manifest are checked with it. The bytes
 * are parsed by format.md, not by the reader of engine/grid. Exit status: 0, 1 damage, 2 usage, 74 I/O.
 */
#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dump_manifest.h"
#include "err.h"
#include "grid.h"
#include "grid_block.h"
#include "grid_disk.h"
#include "grid_run.h"
#include "grow.h"
#include "io.h"
#include "tool_options.h"

static struct {
	bool check, cells, records;
} options;

static int status;                             /* the worst so far */
static const struct grid_segment_info *listed; /* the entry of a manifest whose segment is dumped; NULL: none */

static void raise_status(int to)
{
	status = to > status ? to : status;
}

static void complain(const char *file, uint64_t place, const char *fmt, ...) __attribute__((format(printf, 3, 4)));

static void complain(const char *file, uint64_t place, const char *fmt, ...)
{
	va_list ap;

	va_start(ap, fmt);
	fprintf(stderr, "%s: byte %llu: ", file, (unsigned long long)place);
	vfprintf(stderr, fmt, ap);
	fputc('\n', stderr);
	va_end(ap);
	raise_status(1);
}

static void print_err(const struct err *err)
{
	char text[1200];

	fprintf(stderr, "%s\n", err_format(err, text, sizeof text));
	raise_status(err->code == ERR_CORRUPT || err->code == ERR_VERSION ? 1 : 74);
}

static void print_box(const int32_t b[4])
{
	printf("x %d..%d y %d..%d", b[0], b[2], b[1], b[3]);
}

static void print_sum(uint64_t hi, uint64_t lo)
{
	char hex[DIGEST_HEX_SIZE];

	fputs(digest_hex((struct digest){hi, lo}, hex), stdout);
}

static void print_record(const struct point *p, uint32_t source)
{
	printf("      %d %d %d class %u return %u/%u flags %x source %u\n", p->x, p->y, p->z, p->cls, point_return(p),
	       point_returns(p), point_flags(p), source);
}

/* ---- segments ---- */

struct range {
	uint64_t lo, count;
	unsigned bits;
};

struct segment {
	int fd;
	const char *name;
	struct disk_segment head;
	struct disk_total *totals;  /* as in the file */
	struct disk_total *derived; /* derived from the records */
	struct disk_inner sum;      /* of all cells */
	uint64_t classes[256];
	struct range *ranges;
	size_t nranges, cap;
	bool has_last, outside; /* outside: a record is, of the range of keys in the manifest */
	struct point last;      /* the previous record, without its source */
	uint32_t last_source;
};

static bool segment_read(struct segment *s, void *buf, size_t n, uint64_t place)
{
	struct err err = ERR_INIT;

	if (place > s->head.bytes || n > s->head.bytes - place) {
		complain(s->name, place, "%zu bytes are not there", n);
		return false;
	}
	if (io_read_at(s->fd, buf, n, place, s->name, &err) == 0)
		return true;
	print_err(&err);
	return false;
}

static void add_total(struct segment *s, const struct disk_source *source, uint64_t place)
{
	for (uint32_t i = 0; i < s->head.sources; i++) {
		if (s->derived[i].id != source->id)
			continue;
		s->derived[i].points += source->records;
		s->derived[i].sum_hi += source->sum_hi;
		s->derived[i].sum_lo += source->sum_lo;
		return;
	}
	complain(s->name, place, "source %u is not in the segment's table", source->id);
}

static void check_order(struct segment *s, const struct point *p, uint32_t source, uint64_t place)
{
	struct point bare = *p;

	bare.tag &= POINT_FLAGS;
	int c = s->has_last ? point_compare(&s->last, &bare) : -1;
	uint64_t key = point_morton(bare.x, bare.y);

	if (c > 0 || (c == 0 && s->last_source > source))
		complain(s->name, place, "the records are not in order");
	s->outside |= listed && (key < listed->lo || key > listed->hi);
	s->last = bare;
	s->last_source = source;
	s->has_last = true;
}

/* Dumps a block of a cell, and adds its records to *sum. Returns its size, 0 if it cannot be read. */
static size_t dump_block(struct segment *s, uint64_t place, struct disk_leaf *sum)
{
	static _Alignas(16) uint8_t buf[DISK_BLOCK_MAX];
	static struct disk_source derived[GRID_CELL_RECORDS];
	uint32_t classes[256] = {0};
	uint64_t left = s->head.bytes - place;
	struct grid_block b;

	if (!segment_read(s, buf, left < sizeof buf ? left : sizeof buf, place))
		return 0;
	if (!grid_block_open(buf, left < sizeof buf ? left : sizeof buf, place, true, &b)) {
		complain(s->name, place, "a block is damaged");
		return 0;
	}
	memset(derived, 0, b.head->sources * sizeof *derived);
	for (uint32_t i = 0; i < b.head->records; i++) {
		const struct point *p = &b.records[i];
		unsigned k = point_source(p);

		if (k >= b.head->sources) {
			complain(s->name, place, "record %u has no source", i);
			return 0;
		}
		struct digest h = grid_record_hash(p);

		sum->distinct = (uint16_t)(sum->distinct + (!sum->count || p->x != s->last.x || p->y != s->last.y));
		check_order(s, p, b.sources[k].id, place);
		sum->count++;
		sum->sum_hi += h.hi;
		sum->sum_lo += h.lo;
		point_box_join(sum->box, (const int32_t[4]){p->x, p->y, p->x, p->y});
		derived[k].records++;
		derived[k].sum_hi += h.hi;
		derived[k].sum_lo += h.lo;
		classes[p->cls]++;
		s->classes[p->cls]++;
		if (options.records)
			print_record(p, b.sources[k].id);
	}
	for (unsigned k = 0; k < b.head->sources; k++) {
		if (derived[k].records != b.sources[k].records || derived[k].sum_hi != b.sources[k].sum_hi ||
		    derived[k].sum_lo != b.sources[k].sum_lo || !derived[k].records)
			complain(s->name, place, "source %u of a block does not add up", b.sources[k].id);
		add_total(s, &b.sources[k], place);
		sum->source = b.head->sources > 1 || (sum->blocks && sum->source != b.sources[k].id) ? 0 : b.sources[k].id;
	}
	for (unsigned k = 0; k < b.head->classes; k++) {
		if (classes[b.classes[k].cls] != b.classes[k].records)
			complain(s->name, place, "class %u of a block does not add up", b.classes[k].cls);
		classes[b.classes[k].cls] = 0;
	}
	for (unsigned c = 0; c < 256; c++)
		if (classes[c])
			complain(s->name, place, "a block does not count its class %u", c);
	sum->head_bytes = sum->blocks ? sum->head_bytes : (uint32_t)b.head_bytes;
	sum->check += b.head->check;
	sum->blocks++;
	return b.bytes;
}

static void add_range(struct segment *s, const struct disk_leaf *leaf)
{
	if (!grow(&s->ranges, &s->cap, s->nranges + 1, 1024, sizeof *s->ranges)) {
		fputs("no memory\n", stderr);
		exit(74);
	}
	s->ranges[s->nranges++] = (struct range){leaf->lo, leaf->count, leaf->bits};
}

static void dump_cell(struct segment *s, const struct disk_leaf *leaf)
{
	struct disk_leaf sum = {
		.lo = leaf->lo, .place = leaf->place, .bits = leaf->bits, .box = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN}};
	uint64_t end = disk_range_end(leaf->lo, leaf->bits);

	if (options.cells || options.records) {
		printf("    cell %016llx..%016llx %llu records, %u positions, %u blocks at %llu, source ",
		       (unsigned long long)leaf->lo, (unsigned long long)end, (unsigned long long)leaf->count, leaf->distinct,
		       leaf->blocks, (unsigned long long)leaf->place);
		printf(leaf->source ? "%u, " : "several, ", leaf->source);
		print_box(leaf->box);
		fputs(", sum ", stdout);
		print_sum(leaf->sum_hi, leaf->sum_lo);
		putchar('\n');
	}
	add_range(s, leaf);
	if (!options.check && !options.records)
		return;
	for (uint32_t i = 0; i < leaf->blocks; i++) {
		size_t n = dump_block(s, leaf->place + sum.bytes, &sum);

		if (!n)
			return;
		sum.bytes += n;
	}
	if (memcmp(&sum, leaf, sizeof sum))
		complain(s->name, leaf->place, "the cell is not what its index entry says");
	if (point_morton(leaf->box[0], leaf->box[1]) < leaf->lo || point_morton(leaf->box[2], leaf->box[3]) > end ||
	    (leaf->bits < 64 && leaf->lo & (((uint64_t)1 << leaf->bits) - 1)))
		complain(s->name, leaf->place, "the cell's range is not aligned or not that of its records");
}

static void add_inner(struct disk_inner *sum, const struct disk_inner *by)
{
	if (!sum->cells) {
		uint64_t place = sum->place, check = sum->check;

		*sum = *by;
		sum->place = place;
		sum->check = check;
		return;
	}
	sum->hi = by->hi;
	sum->count += by->count;
	sum->distinct += by->distinct;
	sum->cells += by->cells;
	sum->sum_hi += by->sum_hi;
	sum->sum_lo += by->sum_lo;
	point_box_join(sum->box, by->box);
}

static void dump_page(struct segment *s, unsigned level, uint64_t place, uint64_t check, struct disk_inner *ret);

static void dump_entry(struct segment *s, const uint8_t *entry, unsigned level, struct disk_inner *ret)
{
	if (!level) {
		const struct disk_leaf *leaf = (const struct disk_leaf *)entry;

		*ret = (struct disk_inner){.lo = leaf->lo,
					   .hi = disk_range_end(leaf->lo, leaf->bits),
					   .count = leaf->count,
					   .distinct = leaf->distinct,
					   .cells = 1,
					   .sum_hi = leaf->sum_hi,
					   .sum_lo = leaf->sum_lo};
		memcpy(ret->box, leaf->box, sizeof ret->box);
		dump_cell(s, leaf);
		return;
	}
	const struct disk_inner *inner = (const struct disk_inner *)entry;

	ret->place = inner->place;
	ret->check = inner->check;
	dump_page(s, level - 1, inner->place, inner->check, ret);
	if (memcmp(ret, inner, sizeof *ret))
		complain(s->name, inner->place, "an index page is not what the entry above says");
}

/* *ret: totals of the page's entries. */
static void dump_page(struct segment *s, unsigned level, uint64_t place, uint64_t check, struct disk_inner *ret)
{
	uint8_t *page = aligned_alloc(64, DISK_PAGE);
	const struct disk_page *head = (const struct disk_page *)page;

	if (!page || !segment_read(s, page, DISK_PAGE, place)) {
		free(page);
		return;
	}
	if (head->check != check || head->check != grid_check(page + 8, DISK_PAGE - 8, place) || head->magic != DISK_PAGE_MAGIC ||
	    head->level != level || !head->entries || head->entries > DISK_ENTRIES) {
		complain(s->name, place, "an index page is damaged");
		free(page);
		return;
	}
	printf("  page at %llu, level %u, %u entries\n", (unsigned long long)place, level, head->entries);
	for (unsigned i = 0; i < head->entries; i++) {
		struct disk_inner sum = {0};

		dump_entry(s, page + sizeof *head + i * (size_t)DISK_ENTRY, level, &sum);
		if (ret->cells && sum.cells && sum.lo <= ret->hi)
			complain(s->name, place, "entry %u of an index page is not behind the one before", i);
		if (sum.cells)
			add_inner(ret, &sum);
	}
	free(page);
}

/* A cell is maximal if the range twice as large would have too many records. */
static void check_maximal(const struct segment *s)
{
	for (size_t i = 0; i < s->nranges; i++) {
		const struct range *r = &s->ranges[i];

		if (r->bits >= 64 || (r->count > GRID_CELL_RECORDS && !r->bits))
			continue;
		unsigned bits = r->bits + 1;
		uint64_t lo = bits >= 64 ? 0 : r->lo >> bits << bits, hi = disk_range_end(lo, bits);
		uint64_t count = 0;
		size_t k = i;

		while (k > 0 && s->ranges[k - 1].lo >= lo)
			k--;
		for (; k < s->nranges && s->ranges[k].lo <= hi; k++)
			count += s->ranges[k].count;
		if (count <= GRID_CELL_RECORDS || r->count > GRID_CELL_RECORDS)
			complain(s->name, 0, "the cell at %016llx is not as large as it may be", (unsigned long long)r->lo);
	}
}

static void check_totals(const struct segment *s)
{
	const struct disk_segment *h = &s->head;

	if (s->sum.count != h->points || s->sum.cells != h->cells || s->sum.sum_hi != h->sum_hi || s->sum.sum_lo != h->sum_lo ||
	    (h->cells && memcmp(s->sum.box, h->box, sizeof h->box)))
		complain(s->name, 0, "the header is not what the cells come to");
	if (!options.check)
		return;
	if (memcmp(s->classes, h->classes, sizeof h->classes))
		complain(s->name, 0, "the header's classes are not those of the records");
	if (h->sources && memcmp(s->totals, s->derived, h->sources * sizeof *s->totals))
		complain(s->name, h->sources_place, "the table of sources is not what the blocks come to");
	if (s->outside)
		complain(s->name, 0, "it has a record outside of the range of keys in the manifest");
	check_maximal(s);
}

static void print_segment(const struct segment *s)
{
	const struct disk_segment *h = &s->head;

	printf("%s: segment, version %u, %llu bytes\n  %llu points in %llu cells, ", s->name, h->version,
	       (unsigned long long)h->bytes, (unsigned long long)h->points, (unsigned long long)h->cells);
	print_box(h->box);
	fputs(", sum ", stdout);
	print_sum(h->sum_hi, h->sum_lo);
	printf("\n  index: %u levels, root at %llu\n  classes:", h->height, (unsigned long long)h->root);
	for (unsigned c = 0; c < 256; c++)
		if (h->classes[c])
			printf(" %u:%llu", c, (unsigned long long)h->classes[c]);
	putchar('\n');
	for (uint32_t i = 0; i < h->sources; i++) {
		printf("  source %u: %llu points, sum ", s->totals[i].id, (unsigned long long)s->totals[i].points);
		print_sum(s->totals[i].sum_hi, s->totals[i].sum_lo);
		putchar('\n');
	}
}

static void dump_segment(int fd, const char *name)
{
	struct segment s = {.fd = fd, .name = name};
	struct disk_segment *h = &s.head;
	struct stat st;

	h->bytes = DISK_HEADER;
	if (!segment_read(&s, h, sizeof *h, 0))
		return;
	if (h->check != grid_check((uint8_t *)h + 8, DISK_HEADER - 8, 0) || h->version != DISK_VERSION || fstat(fd, &st) ||
	    (uint64_t)st.st_size != h->bytes || h->height > DISK_LEVELS || h->sources_place > h->bytes ||
	    h->sources > (h->bytes - h->sources_place) / sizeof *s.totals) {
		complain(name, 0, "the header is damaged");
		return;
	}
	size_t bytes = h->sources * sizeof *s.totals;

	s.totals = malloc(bytes + 1);
	s.derived = calloc(h->sources + 1, sizeof *s.derived);
	if (s.totals && s.derived && segment_read(&s, s.totals, bytes, h->sources_place)) {
		if (h->sources_check != grid_check(s.totals, bytes, h->sources_place))
			complain(name, h->sources_place, "the table of sources is damaged");
		for (uint32_t i = 0; i < h->sources; i++)
			s.derived[i].id = s.totals[i].id;
		print_segment(&s);
		if (h->height)
			dump_page(&s, h->height - 1, h->root, h->root_check, &s.sum);
		check_totals(&s);
	}
	free(s.totals);
	free(s.derived);
	free(s.ranges);
}

/* ---- manifests and runs ---- */

static void dump_file(int dirfd, const char *name, const char *shown);

static void dump_manifest(int dirfd, const char *name)
{
	struct grid_manifest *m;
	const char *fault;
	struct err err = ERR_INIT;
	struct digest lines;
	char text[LATTICE_TEXT_SIZE];

	if (grid_manifest_read(dirfd, name, &m, &err)) {
		print_err(&err);
		return;
	}
	printf("%s: manifest\n  lattice %s\n  crs %s, units %s and %s\n  geoid %s\n  generation %llu", name,
	       lattice_text(&m->lattice, text), m->crs, m->unit_xy, m->unit_z, *m->geoid ? m->geoid : "none",
	       (unsigned long long)m->generation);
	if (grid_manifest_oldest(m) > 1)
		printf(", oldest %llu", (unsigned long long)m->oldest);
	putchar('\n');
	if (m->wkt && *m->wkt)
		printf("  wkt since generation %llu: %s\n", (unsigned long long)m->wkt_since, m->wkt);
	dump_manifest_lists(m);
	if (options.check && (fault = dump_manifest_fault(m)))
		complain(name, 0, "%s", fault);
	for (size_t i = 0; options.check && i < m->nsegments; i++) {
		listed = &m->segments[i];
		dump_file(dirfd, listed->file, listed->file);
	}
	listed = NULL;
	if (options.check) { /* whether each segment belongs to this manifest */
		/* The line vertices of a selection have no lines, and their pieces are in the folder of the dataset. */
		const struct grid_use use = {.no_lines = !grid_manifest_lines(m, m->generation, &lines) ||
							 grid_manifest_lacks_line_set(m, m->generation)};
		struct grid *g;

		if (grid_open_use(dirfd, name, m->generation, &use, NULL, 0, &g, &err))
			print_err(&err);
		else
			grid_close(g);
	}
	grid_manifest_free(m);
}

static void dump_run(int dirfd, const char *name)
{
	static _Alignas(16) uint8_t buf[DISK_RUN_BLOCK];
	struct grid_run_reader r;
	struct grid_run run;
	struct err err = ERR_INIT;
	const struct point *pts;
	const uint32_t *ids;
	struct point last;
	uint32_t last_source = 0;
	bool any = false;
	size_t n = 1;
	int rc = grid_run_open(&run, dirfd, name, false, &err);

	if (rc) {
		print_err(&err);
		return;
	}
	printf("%s: sorted run, %llu records, %llu bytes\n", name, (unsigned long long)run.records,
	       (unsigned long long)(run.blocks + 1) * DISK_RUN_BLOCK);
	grid_run_read(&r, &run, 0, run.blocks, buf, 1);
	while (n && (options.check || options.records)) {
		uint64_t place = (r.next + 1) * DISK_RUN_BLOCK;

		rc = grid_run_next(&r, &pts, &n, &ids, &err);
		if (rc) {
			print_err(&err);
			break;
		}
		for (size_t i = 0; i < n; i++) {
			struct point bare = pts[i];
			uint32_t source = ids[point_source(&pts[i])];

			bare.tag &= POINT_FLAGS;
			int c = any ? point_compare(&last, &bare) : -1;

			if (c > 0 || (c == 0 && last_source > source))
				complain(name, place, "the records are not in order");
			last = bare;
			last_source = source;
			any = true;
			if (options.records)
				print_record(&pts[i], source);
		}
	}
	grid_run_close(&run);
}

/* What is in it is shown with its manifest. */
static void dump_sources(int fd, int dirfd, const char *name)
{
	struct grid_sources_file file = {0};
	const struct grid_manifest m = {.files = &file, .nfiles = 1};
	struct err err = ERR_INIT;
	uint8_t head[24], check[8];
	struct stat st;

	if (fstat(fd, &st) || st.st_size < 32) {
		complain(name, 0, "it is too short for a file of sources");
		return;
	}
	if (io_read_at(fd, head, sizeof head, 0, name, &err) ||
	    io_read_at(fd, check, sizeof check, (uint64_t)st.st_size - sizeof check, name, &err)) {
		print_err(&err);
		return;
	}
	snprintf(file.name, sizeof file.name, "%s", name);
	file.bytes = (uint64_t)st.st_size;
	memcpy(&file.n, head + 12, sizeof file.n);
	memcpy(&file.check, check, sizeof check);
	printf("%s: file of sources, %u sources, %llu bytes\n", name, file.n, (unsigned long long)file.bytes);
	if (grid_sources_verify(dirfd, &m, 0, &err))
		print_err(&err);
}

static void dump_file(int dirfd, const char *name, const char *shown)
{
	struct err err = ERR_INIT;
	char magic[16] = "";
	size_t n;
	int fd = -1;

	if (io_open(dirfd, name, O_RDONLY, 0, &fd, &err) || io_read_some(fd, magic, 16, 0, name, &n, &err))
		print_err(&err);
	else if (!memcmp(magic, DISK_MANIFEST_MAGIC, 8))
		dump_manifest(dirfd, name);
	else if (!memcmp(magic, DISK_SOURCES_MAGIC, 8))
		dump_sources(fd, dirfd, name);
	else if (!memcmp(magic + 8, DISK_SEGMENT_MAGIC, 8))
		dump_segment(fd, shown);
	else if (!memcmp(magic + 8, DISK_RUN_MAGIC, 8))
		dump_run(dirfd, name);
	else
		complain(shown, 0, "this is no manifest, file of sources, segment or sorted run");
	io_close(fd);
}

static const struct tool_option OPTIONS[] = {
	{"check", NULL, "read everything, and derive every number again from the records", 'k'},
	{"cells", NULL, "one line for each cell", 'c'},
	{"records", NULL, "one line for each record", 'r'},
};
static const struct tool TOOL = {
	.name = "acut-grid-dump",
	.usage = "usage: acut-grid-dump [--check] [--cells] [--records] FILE...\n",
	.about = "Shows manifests, files of sources, segments and sorted runs of the grid cache (format.md).\n",
	.end = "\nExit status: 0 all is good; 1 damage; 2 usage; 74 reading failed.\n",
	.option = OPTIONS,
	.n = sizeof OPTIONS / sizeof *OPTIONS,
};

/* -1: continue; otherwise the exit status. */
static int parse_options(int argc, char **argv)
{
	const char *value;
	int c, rc;

	while ((c = tool_next(&TOOL, argc, argv, &value, &rc)) != TOOL_END) {
		switch (c) {
		case 'k':
			options.check = true;
			break;
		case 'c':
			options.cells = true;
			break;
		case 'r':
			options.records = true;
			break;
		default:
			return rc;
		}
	}
	return optind == argc ? tool_usage_error(&TOOL, "give a FILE") : -1;
}

int main(int argc, char **argv)
{
	int rc;

	io_reserve_standard();
	rc = parse_options(argc, argv);
	if (rc >= 0)
		return rc;
	for (int i = optind; i < argc; i++) {
		char *folder = strdup(argv[i]), *base = strdup(argv[i]);
		struct err err = ERR_INIT;
		int dirfd = -1;

		if (!folder || !base || io_open(AT_FDCWD, dirname(folder), O_RDONLY | O_DIRECTORY, 0, &dirfd, &err))
			print_err(&err);
		else
			dump_file(dirfd, basename(base), argv[i]);
		io_close(dirfd);
		free(folder);
		free(base);
	}
	if (options.check && !status)
		puts("all checks passed");
	if (fflush(stdout) || ferror(stdout)) {
		perror("acut-grid-dump: standard output");
		raise_status(74);
	}
	return status;
}
