/*
 * Pushes of up to six files of points, each named by a digit, that are interrupted, and the pushes after them.
 */
#ifndef PENDING_H
#define PENDING_H

#include "fixture.h"
#include "dataset_priv.h"
#include "io.h"
#include "log.h"

enum { FILES = 6, EACH = 400 };

static int fd[FILES];
static enum push_known_as known[FILES];

static const struct peer bert = {.uid = 1001, .pid = 2};

static const struct push_input *input_of(unsigned i)
{
	static char name[FILES][16];
	static struct push_input input[FILES];

	snprintf(name[i], sizeof name[i], "/%u.xyz", i);
	input[i].name = input[i].path = name[i];
	return &input[i];
}

static void begin_as(const struct push_params *in)
{
	memset(&got, 0, sizeof got);
	got.why = ERR_INIT;
	ask(push_begin(h.service->pushes, in, NULL));
	assert_int_equal(got.why.code, 0);
}

static void begin_of(const struct peer *who)
{
	begin_as(&(struct push_params){.dataset = "a", .peer = *who, .calls = &calls, .has_mode = true, .mode = 0666});
}

static enum push_known_as probe(unsigned i)
{
	ask(push_probe(got.push, dup(fd[i]), input_of(i), NULL));
	assert_int_equal(got.why.code, 0);
	return known[i] = got.known;
}

/* Files of this push, as digits; it has begun. */
static void stage(const char *files)
{
	bool any = false;

	for (const char *f = files; *f; f++)
		any |= probe((unsigned)(*f - '0')) == PUSH_NEW;
	if (any)
		ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	for (const char *f = files; *f; f++) {
		unsigned i = (unsigned)(*f - '0');

		if (known[i] == PUSH_NEW)
			ask(push_file(got.push, dup(fd[i]), input_of(i), NULL));
		assert_int_equal(got.why.code, 0);
	}
}

static void leave(void)
{
	push_leave(got.push);
	turn_until(!pushes_open(h.service->pushes));
}

static void interrupt_of(const struct peer *who, const char *files)
{
	begin_of(who);
	stage(files);
	leave();
}

static void interrupt(const char *files)
{
	interrupt_of(&me, files);
}

static void commit(void)
{
	ask(push_commit(got.push, NULL));
	if (got.why.code)
		fail_msg("%s %s", got.why.file, got.why.message);
	dataset_release(got.committed.dataset);
	leave();
}

static void push_of(const struct peer *who, const char *files)
{
	begin_of(who);
	stage(files);
	commit();
}

static void push_all(const char *files)
{
	push_of(&me, files);
}

static struct dataset_info info(void)
{
	struct dataset *d = dataset_find(h.service->datasets, "a", &me);
	struct dataset_info ret;

	assert_non_null(d);
	dataset_info(d, &ret);
	return ret;
}

/* Another file of this digit. */
static void replace_file(unsigned i, int with)
{
	close(fd[i]);
	fd[i] = with;
}

/* Pending pushes with so many files, and points of the dataset, in files. */
static void expect(unsigned pushes, unsigned files, unsigned in)
{
	assert_int_equal(info().pending, pushes);
	assert_int_equal(info().pending_files, files);
	assert_int_equal(info().pending_points, files * EACH);
	assert_int_equal(info().points, in * EACH);
}

static void expect_known(const char *files, enum push_known_as as)
{
	for (const char *f = files; *f; f++)
		assert_int_equal(known[*f - '0'], as);
}

static void restart(void)
{
	close_service();
	open_service(UINT64_C(32) << 20, 2);
}

static int open_folder(void)
{
	char path[128];
	int dirfd;

	snprintf(path, sizeof path, "%s/datasets/1", h.folder);
	dirfd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	assert_true(dirfd >= 0);
	return dirfd;
}

/* No file is left but those of the newest manifest. */
static void no_leftovers(void)
{
	DIR *dir = fdopendir(open_folder());
	struct dirent *e;

	turn_until(!service_active(h.service));
	while ((e = readdir(dir)))
		if (strstr(e->d_name, ".pending") || strstr(e->d_name, ".run") || strstr(e->d_name, ".stage") ||
		    strstr(e->d_name, ".tmp") || strstr(e->d_name, ".lines-"))
			fail_msg("left behind: %s", e->d_name);
	closedir(dir);
}

static int open_files(void **state)
{
	for (unsigned i = 0; i < FILES; i++)
		fd[i] = text_file(EACH, 10 + i);
	return setup(state);
}

static int close_files(void **state)
{
	for (unsigned i = 0; i < FILES; i++)
		close(fd[i]);
	return teardown(state);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, open_files, close_files)

#endif
