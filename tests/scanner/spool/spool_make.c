#include "io.h"
#include "spool_make.h"

#include <fcntl.h>
#include <unistd.h>

void make_head(struct spool_head *ret)
{
	static char profile[] = "title = a test\n";

	*ret = (struct spool_head){.vendor = 0x19a2,
				   .product = 0x5001,
				   .manufacturer = "SICK",
				   .model = "TiM\0x",
				   .serial = "20370043",
				   .port = "1-2.4",
				   .profile_name = "sick-tim",
				   .profile_size = sizeof(profile) - 1,
				   .utc_ns = 1700000000000000000,
				   .monotonic_ns = 5000000000};
	ret->profile = malloc(sizeof(profile));
	memcpy(ret->profile, profile, sizeof(profile));
	for (int i = 0; i < 16; i++)
		ret->id[i] = (uint8_t)(i * 7 + 1);
}

enum spool_kind make_kind(uint64_t seq)
{
	return seq % 3 == 2 ? SPOOL_EVENT : seq % 7 == 3 ? SPOOL_SENT : SPOOL_DATA;
}

size_t make_payload(uint64_t seq, uint8_t at[MAKE_SIZE_MAX])
{
	size_t n = make_kind(seq) == SPOOL_EVENT ? 0 : (size_t)(seq * 37 % (MAKE_SIZE_MAX - 1));
	uint64_t x = seq * 0x9e3779b97f4a7c15u + 1;

	if (make_kind(seq) == SPOOL_EVENT)
		return (size_t)sprintf((char *)at, "stall record %llu", (unsigned long long)seq);
	for (size_t i = 0; i < n; i++) {
		x ^= x << 13, x ^= x >> 7, x ^= x << 17;
		at[i] = (uint8_t)x;
	}
	return n;
}

void make_append(struct spool_writer *w, uint64_t seq)
{
	uint8_t at[MAKE_SIZE_MAX];
	size_t n = make_payload(seq, at);
	struct err err = ERR_INIT;

	if (spool_append(w, make_kind(seq), SPOOL_SHORT, (int64_t)seq * 1000, at, n, &err))
		fail_msg("%s", err.message);
}

void make_spool(const char *path, uint64_t n, bool end)
{
	struct spool_writer *w;
	struct spool_head head;
	struct err err = ERR_INIT;

	make_head(&head);
	assert_int_equal(spool_create(path, &head, &w, &err), 0);
	for (uint64_t i = 0; i < n; i++)
		make_append(w, i);
	if (end)
		assert_int_equal(spool_end(w, &err), 0);
	spool_writer_free(w);
	spool_head_clear(&head);
}

void make_check(const struct spool_record *r)
{
	uint8_t at[MAKE_SIZE_MAX];
	size_t n = make_payload(r->seq, at);

	assert_int_equal(r->kind, make_kind(r->seq));
	assert_int_equal(r->flags, SPOOL_SHORT);
	assert_int_equal(r->time_ns, r->seq * 1000);
	assert_int_equal(r->size, n);
	assert_memory_equal(r->at, at, n);
}

uint8_t *make_read(const char *path, size_t *ret_size)
{
	FILE *f = fopen(path, "rb");
	uint8_t *at;
	long n;

	assert_non_null(f);
	fseek(f, 0, SEEK_END);
	n = ftell(f);
	rewind(f);
	at = malloc((size_t)n + 1);
	assert_int_equal(fread(at, 1, (size_t)n, f), n);
	fclose(f);
	*ret_size = (size_t)n;
	return at;
}

void make_write(const char *path, const void *at, size_t size)
{
	FILE *f;

	unlink(path); /* file systems make a file durable that is overwritten in this way */
	f = fopen(path, "wb");
	assert_non_null(f);
	assert_int_equal(fwrite(at, 1, size, f), size);
	assert_int_equal(fclose(f), 0);
}

void make_read_all(const char *path, uint64_t base, struct make_seen *ret)
{
	struct spool_record record;
	struct spool_reader *r;
	struct err err = ERR_INIT;
	int fd = open(path, O_RDONLY | O_CLOEXEC), rc;

	*ret = (struct make_seen){0};
	ret->error = fd < 0 ? -ERR_IO : spool_open(fd, path, &r, &err);
	if (ret->error)
		return;
	while ((rc = spool_next(r, &record, &err))) {
		uint64_t skipped = 0;

		if (rc < 0) {
			assert_int_equal(rc, -ERR_INPUT);
			assert_true(err.message[0]);
			assert_true(err.offset != ERR_NO_OFFSET);
			if (!ret->damages++)
				ret->first_damage = err.offset;
			err = ERR_INIT;
			/* it returns the error until the damage is skipped */
			assert_int_equal(spool_next(r, &record, &err), -ERR_INPUT);
			err = ERR_INIT;
			assert_int_equal(spool_skip(r, &skipped, &err), 0);
			ret->skipped += skipped;
			continue;
		}
		assert_true(record.seq >= ret->next);
		ret->next = record.seq + 1;
		ret->prefix += record.seq == ret->prefix;
		if (record.seq < base && record.kind != SPOOL_END) {
			make_check(&record);
			ret->records++;
		} else {
			ret->others++;
		}
	}
	spool_tail(r, &ret->tail);
	spool_reader_free(r);
}

char make_folder[64], make_path[96], make_other[96];

int make_setup(void **state)
{
	strcpy(make_folder, "/tmp/acut-spool-XXXXXX");
	if (!mkdtemp(make_folder))
		return -1;
	snprintf(make_path, sizeof(make_path), "%s/a.spool", make_folder);
	snprintf(make_other, sizeof(make_other), "%s/b.spool", make_folder);
	return 0;
}

int make_teardown(void **state)
{
	unlink(make_path);
	unlink(make_other);
	io = &io_system;
	return rmdir(make_folder);
}
