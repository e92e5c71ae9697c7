/* The head of a spool: encoding and decoding. Texts are sanitized in both directions, because a device is not trusted. */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include <xxhash.h>

#include "clock.h"
#include "cursor.h"
#include "spool_priv.h"
#include "utf8.h"

enum { TEXTS = 6 };

/* Copies up to `size` bytes, or up to a zero; invalid bytes become '?'; no character is cut. */
static void clean_text(const void *from, size_t n, char *to, size_t room)
{
	const unsigned char *p = from;
	size_t at = 0;

	n = strnlen(from, n);
	while (n) {
		size_t k = utf8_printable(p, n), step = k ? k : 1;

		if (at + step >= room)
			break;
		if (k)
			memcpy(to + at, p, k);
		else
			to[at] = '?';
		at += step;
		p += step;
		n -= step;
	}
	memset(to + at, 0, room - at);
}

static void texts_of(const struct spool_head *h, const char *ret[TEXTS])
{
	const char *all[TEXTS] = {h->manufacturer, h->model, h->serial, h->port, h->profile_name, h->boot_id};

	memcpy(ret, all, sizeof(all));
}

void spool_head_clear(struct spool_head *h)
{
	free(h->profile);
	*h = (struct spool_head){0};
}

int spool_head_copy(const struct spool_head *from, struct spool_head *ret, struct err *err)
{
	char *profile = malloc(from->profile_size + 1);

	if (!profile)
		return err_set(err, ERR_NOMEM, "no memory for the profile of a spool");
	*ret = *from;
	ret->profile = profile;
	if (from->profile_size)
		memcpy(profile, from->profile, from->profile_size);
	profile[from->profile_size] = 0;
	return 0;
}

/* In a unit with ProcSubset=pid the file does not exist; the unit passes the id (ACUT_BOOT_ID=%b), without dashes. */
static void boot_id_of_unit(char text[40])
{
	const char *from = getenv("ACUT_BOOT_ID");
	size_t n = 0;

	if (!from || strlen(from) != 32 || strspn(from, "0123456789abcdef") != 32)
		return;
	for (size_t i = 0; i < 32; i++) {
		if (i == 8 || i == 12 || i == 16 || i == 20)
			text[n++] = '-';
		text[n++] = from[i];
	}
	text[n] = 0;
}

void spool_boot_id(char ret[40])
{
	char text[40] = "";
	int fd = open("/proc/sys/kernel/random/boot_id", O_RDONLY | O_CLOEXEC);
	ssize_t n = fd < 0 ? 0 : read(fd, text, sizeof(text) - 1);

	if (fd >= 0)
		close(fd);
	text[n > 0 ? n : 0] = 0;
	text[strcspn(text, "\n")] = 0;
	if (!*text)
		boot_id_of_unit(text);
	clean_text(text, strlen(text), ret, 40);
}

void spool_head_fill(struct spool_head *h)
{
	static const uint8_t zero[16];
	char *text[TEXTS - 1] = {h->manufacturer, h->model, h->serial, h->port, h->profile_name}, copy[SPOOL_TEXT_SIZE];

	if (!memcmp(h->id, zero, 16) && getrandom(h->id, 16, 0) != 16) {
		const uint64_t seed[2] = {clock_mono_ns(), (uint64_t)clock_real_us() ^ (uint64_t)getpid() << 32};
		const XXH128_hash_t hash = XXH3_128bits(seed, sizeof(seed));

		memcpy(h->id, &hash, 16);
	}
	if (!*h->boot_id)
		spool_boot_id(h->boot_id);
	if (!h->utc_ns && !h->monotonic_ns) {
		h->utc_ns = clock_real_us() * 1000;
		h->monotonic_ns = (int64_t)clock_mono_ns();
	}
	for (int i = 0; i < TEXTS - 1; i++) {
		memcpy(copy, text[i], sizeof(copy));
		clean_text(copy, sizeof(copy), text[i], SPOOL_TEXT_SIZE);
	}
}

static uint64_t head_check(const uint8_t *at, size_t size)
{
	uint8_t fixed[SPOOL_HEAD_FIXED];
	XXH3_state_t *state = XXH3_createState();
	uint64_t check = 0;

	if (!state)
		return 0;
	memcpy(fixed, at, sizeof(fixed));
	memset(fixed + 16, 0, 8);
	XXH3_64bits_reset(state);
	XXH3_64bits_update(state, fixed, sizeof(fixed));
	XXH3_64bits_update(state, at + sizeof(fixed), size - sizeof(fixed));
	check = XXH3_64bits_digest(state);
	XXH3_freeState(state);
	return check;
}

int spool_head_encode(const struct spool_head *h, uint8_t **ret, size_t *ret_size, struct err *err)
{
	const char *text[TEXTS];
	size_t size = 256;
	struct packer p;
	uint8_t *at;

	if (h->profile_size > SPOOL_PROFILE_MAX)
		return err_set(err, ERR_LIMIT, "the profile has %zu bytes; a spool takes %d", h->profile_size, SPOOL_PROFILE_MAX);
	texts_of(h, text);
	for (int i = 0; i < TEXTS; i++)
		size += strlen(text[i]);
	size = (size + h->profile_size + SPOOL_BLOCK - 1) / SPOOL_BLOCK * SPOOL_BLOCK;
	at = calloc(1, size);
	if (!at)
		return err_set(err, ERR_NOMEM, "no memory for the head of a spool");
	p = packer_of(at, size);
	packer_bytes(&p, SPOOL_MAGIC, 8);
	packer_u32(&p, SPOOL_VERSION);
	packer_u32(&p, (uint32_t)size);
	packer_u64(&p, 0);
	packer_bytes(&p, h->id, 16);
	packer_u16(&p, h->vendor);
	packer_u16(&p, h->product);
	packer_u32(&p, 0);
	packer_u64(&p, (uint64_t)h->utc_ns);
	packer_u64(&p, (uint64_t)h->monotonic_ns);
	for (int i = 0; i < TEXTS; i++) {
		packer_u16(&p, (uint16_t)strlen(text[i]));
		packer_bytes(&p, text[i], strlen(text[i]));
	}
	packer_u32(&p, (uint32_t)h->profile_size);
	packer_bytes(&p, h->profile, h->profile_size);
	if (p.bad) {
		free(at);
		return err_set(err, ERR_INTERNAL, "the head of a spool is longer than was counted");
	}
	p = packer_of(at + 16, 8);
	packer_u64(&p, head_check(at, size));
	*ret = at;
	*ret_size = size;
	return 0;
}

bool spool_head_whole(const uint8_t *at, size_t size)
{
	struct cursor c = cursor_of(at + 12, 12);

	return size >= SPOOL_BLOCK && !memcmp(at, SPOOL_MAGIC, 8) && cursor_u32(&c) == size &&
	       cursor_u64(&c) == head_check(at, size);
}

int spool_head_decode(const uint8_t *at, size_t size, struct spool_head *ret, struct err *err)
{
	struct cursor c = cursor_of(at, size);
	struct spool_head h = {0};
	char *text[TEXTS] = {h.manufacturer, h.model, h.serial, h.port, h.profile_name, h.boot_id};
	const uint8_t *from;
	size_t n;

	cursor_skip(&c, SPOOL_HEAD_FIXED);
	from = cursor_bytes(&c, 16);
	if (from)
		memcpy(h.id, from, 16);
	h.vendor = cursor_u16(&c);
	h.product = cursor_u16(&c);
	cursor_skip(&c, 4);
	h.utc_ns = cursor_i64(&c);
	h.monotonic_ns = cursor_i64(&c);
	for (int i = 0; i < TEXTS; i++) {
		n = cursor_u16(&c);
		from = cursor_bytes(&c, n);
		if (from)
			clean_text(from, n, text[i], i == TEXTS - 1 ? sizeof(h.boot_id) : SPOOL_TEXT_SIZE);
	}
	n = cursor_u32(&c);
	from = n <= SPOOL_PROFILE_MAX ? cursor_bytes(&c, n) : NULL;
	if (!from || c.bad)
		return err_set(err, ERR_INPUT, "the head of the spool is not well formed");
	h.profile = malloc(n + 1);
	if (!h.profile)
		return err_set(err, ERR_NOMEM, "no memory for the profile of a spool");
	memcpy(h.profile, from, n);
	h.profile[n] = 0;
	h.profile_size = n;
	*ret = h;
	return 0;
}
