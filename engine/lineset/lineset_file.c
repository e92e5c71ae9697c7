/*
 * Opening a line set file and reading its pages (lineset_file.h). Every page is checked before it is used: against its own
 * checksum, and against the one in the entry that leads to it, so a page of another file fails too.
 */
#include "lineset_file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "grid_file.h"
#include "io.h"
#include "ledger.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are written as they lie in memory");

static uint64_t divide_up(uint64_t n, uint64_t by)
{
	return n / by + (n % by != 0);
}

bool lineset_shape(uint64_t pieces, struct lineset_shape *ret)
{
	struct lineset_shape s = {0};

	for (uint64_t n = pieces; n && (!s.height || n > 1); s.height++) {
		if (s.height == LINESET_LEVELS)
			return false;
		s.first[s.height] = s.all;
		s.entries[s.height] = n;
		n = divide_up(n, s.height ? LINESET_ENTRIES : LINESET_PIECES);
		s.pages[s.height] = n;
		s.all += n;
	}
	*ret = s;
	return true;
}

unsigned lineset_shape_entries(const struct lineset_shape *s, unsigned level, uint64_t i)
{
	uint64_t full = level ? LINESET_ENTRIES : LINESET_PIECES, left = s->entries[level] - i * full;

	return (unsigned)(left < full ? left : full);
}

struct digest lineset_piece_sum(const struct lineset_piece *p)
{
	return digest_hash(p, sizeof *p);
}

static struct digest content_of(struct digest sum, uint64_t pieces, unsigned far)
{
	const uint64_t all[4] = {sum.hi, sum.lo, pieces, far};

	return digest_hash(all, sizeof all);
}

/* ---- opening ---- */

static int damaged(const struct lineset *s, uint64_t place, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the line set is damaged: %s", what);
	err_add_place(err, place, NULL);
	err_add_file(err, s->name);
	return err_add_hint(err, "check the disk, and restore the file or push the lines again");
}

static int read_at(const struct lineset *s, void *buf, uint64_t place, struct err *err)
{
	int rc = io_read_at(s->fd, buf, LINESET_PAGE, place, s->name, err);

	if (rc != -ERR_TRUNCATED)
		return rc;
	err_clear(err);
	return damaged(s, place, "it ends too early", err);
}

static int check_head(struct lineset *s, const struct lineset_head *h, struct err *err)
{
	struct stat st;

	if (h->check != grid_check((const uint8_t *)h + 8, LINESET_PAGE - 8, 0) ||
	    memcmp(h->magic, LINESET_MAGIC, sizeof h->magic))
		return damaged(s, 0, "its head is invalid", err);
	if (h->version != LINESET_VERSION || h->page_bytes != LINESET_PAGE) {
		err_set(err, ERR_VERSION, "a line set of version %u; this acut reads version %u", h->version, LINESET_VERSION);
		return err_add_file(err, s->name);
	}
	if (!lineset_shape(h->pieces, &s->shape) || s->shape.all != h->pages || s->shape.height != h->height ||
	    (h->far != 0 && h->far != LINESET_OUT) || h->turns > (LINESET_LAKE | LINESET_OUT) || h->box[0] > h->box[2] ||
	    h->box[1] > h->box[3])
		return damaged(s, 0, "its head contradicts itself", err);
	if (io->fstat(s->fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		return err_add_file(err, s->name);
	}
	if ((uint64_t)st.st_size != lineset_place(h->pages))
		return damaged(s, 0, "its size differs from its head", err);
	s->sum = (struct digest){h->sum_hi, h->sum_lo};
	s->root_check = h->root_check;
	s->turns = h->turns;
	s->info = (struct lineset_info){.pieces = h->pieces,
					.areas = h->turns || h->far,
					.turns = h->turns,
					.far = h->far,
					.content = content_of(s->sum, h->pieces, h->far)};
	memcpy(s->info.box, h->box, sizeof s->info.box);
	return 0;
}

static int open_file(struct lineset *s, int dirfd, const char *name, struct err *err)
{
	struct lineset_head h;
	int rc;

	s->name = strdup(name);
	if (!s->name)
		return err_set(err, ERR_NOMEM, "no memory to open %s", name);
	rc = grid_file_open(dirfd, s->name, "the line set", &s->fd, err);
	if (rc == 0)
		rc = read_at(s, &h, 0, err);
	return rc ? rc : check_head(s, &h, err);
}

/* Charges the object and as many frames as the memory has room for, but no more than the file has pages. */
static int make_cache(struct lineset *s, size_t memory, struct err *err)
{
	uint64_t frames = memory / (LINESET_PAGE + LINESET_FRAME), most = s->shape.all + LINESET_WAYS - 1, bytes;

	frames = (frames < most ? frames : most) / LINESET_WAYS * LINESET_WAYS;
	bytes = sizeof *s + lineset_cache_bytes(frames);
	if (s->ledger && !ledger_take(s->ledger, LEDGER_INDEX, bytes)) {
		err_set(err, ERR_BUSY, "no %llu bytes are free for the lines of the dataset", (unsigned long long)bytes);
		return err_add_hint(err, "try again when other jobs are done, or give acutd more memory");
	}
	s->charged = bytes;
	s->cache = lineset_cache_new(frames);
	return s->cache ? 0 : err_set(err, ERR_NOMEM, "no memory for %llu pages of lines", (unsigned long long)frames);
}

int lineset_open(int dirfd, const char *name, struct ledger *ledger, size_t memory, struct lineset **ret, struct err *err)
{
	struct lineset *s = calloc(1, sizeof *s);
	int rc;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory to open %s", name);
	s->fd = -1;
	s->ledger = ledger;
	rc = open_file(s, dirfd, name, err);
	if (rc == 0)
		rc = make_cache(s, memory, err);
	if (rc) {
		lineset_close(s);
		return rc;
	}
	*ret = s;
	return 0;
}

struct lineset *lineset_close(struct lineset *s)
{
	if (!s)
		return NULL;
	s->fd = io_close(s->fd);
	lineset_cache_free(s->cache);
	if (s->charged && s->ledger)
		ledger_give(s->ledger, LEDGER_INDEX, s->charged);
	free(s->name);
	free(s);
	return NULL;
}

const struct lineset_info *lineset_info(const struct lineset *s)
{
	return &s->info;
}

uint64_t lineset_charged(const struct lineset *s)
{
	return s->charged;
}

/* ---- a reader ---- */

size_t lineset_reader_bytes(void)
{
	return sizeof(struct lineset_reader) + _Alignof(struct lineset_reader);
}

struct lineset_reader *lineset_reader_init(void *memory, const struct lineset *set)
{
	uintptr_t align = _Alignof(struct lineset_reader);
	struct lineset_reader *r = (struct lineset_reader *)(((uintptr_t)memory + align - 1) & ~(align - 1));

	r->set = set;
	r->clock = 0;
	memset(r->slot, 0, sizeof r->slot);
	return r;
}

/* Of the slots of level 0 the one that has the page, or the least recently used one. */
static unsigned find_slot(const struct lineset_reader *r, unsigned level, uint64_t page)
{
	unsigned at = LINESET_LEVELS - 1;

	if (level)
		return level - 1;
	for (unsigned i = at; i < LINESET_SLOTS; i++) {
		if (r->slot[i].page == page + 1)
			return i;
		at = r->slot[i].used < r->slot[at].used ? i : at;
	}
	return at;
}

static int check_page(const struct lineset *s, unsigned level, uint64_t i, const struct lineset_page *p, struct err *err)
{
	uint64_t place = lineset_place(s->shape.first[level] + i);
	const struct lineset_piece *piece = lineset_page_pieces(p);

	if (p->level != level || p->entries != lineset_shape_entries(&s->shape, level, i))
		return damaged(s, place, "a page is not the one that its place requires", err);
	for (unsigned k = 0; level == 0 && k < p->entries; k++) {
		const int32_t *a = piece[k].a, *b = piece[k].b;

		if (a[0] > b[0] || (a[0] == b[0] && a[1] >= b[1]) || piece[k].turns > (LINESET_LAKE | LINESET_OUT))
			return damaged(s, place, "a piece is impossible", err);
	}
	return 0;
}

static int read_page(const struct lineset *s, unsigned level, uint64_t i, uint64_t check, uint8_t *to, struct err *err)
{
	uint64_t place = lineset_place(s->shape.first[level] + i), found;
	int rc = read_at(s, to, place, err);

	if (rc)
		return rc;
	memcpy(&found, to, sizeof found);
	if (found != check || found != grid_check(to + 8, LINESET_PAGE - 8, place))
		return damaged(s, place, "the checksum of a page does not agree", err);
	return check_page(s, level, i, (const struct lineset_page *)to, err);
}

int lineset_page(struct lineset_reader *r, unsigned level, uint64_t i, uint64_t check, const struct lineset_page **ret,
		 struct err *err)
{
	const struct lineset *s = r->set;
	uint64_t page = s->shape.first[level] + i;
	unsigned slot = find_slot(r, level, page);
	int rc;

	*ret = (const struct lineset_page *)r->bytes[slot];
	r->slot[slot].used = ++r->clock;
	if (r->slot[slot].page == page + 1)
		return 0;
	r->slot[slot].page = page + 1;
	if (lineset_cache_get(s->cache, page, r->bytes[slot]))
		return 0;
	rc = read_page(s, level, i, check, r->bytes[slot], err);
	if (rc)
		r->slot[slot].page = 0;
	else
		lineset_cache_put(s->cache, page, r->bytes[slot]);
	return rc;
}
