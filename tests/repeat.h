/* How often a test repeats itself, and where it writes. */
#ifndef REPEAT_H
#define REPEAT_H

#include <assert.h>
#include <ftw.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* The number of cases: `usual`, or ACUT_FUZZ_CASES; a tenth of either, at least one, where ACUT_TEST_QUICK is set (./check
 * --quick). */
static inline uint64_t repeat_cases(uint64_t usual)
{
	const char *asked = getenv("ACUT_FUZZ_CASES");
	uint64_t n = asked ? strtoull(asked, NULL, 10) : usual;

	return !getenv("ACUT_TEST_QUICK") ? n : n / 10 ? n / 10 : 1;
}

/* The step of a loop over all combinations: 1, or `quick` where ACUT_TEST_QUICK is set. */
static inline unsigned repeat_step(unsigned quick)
{
	return getenv("ACUT_TEST_QUICK") ? quick : 1;
}

/* The number of the first case: 1, or ACUT_FUZZ_SEED. */
static inline uint64_t repeat_first(void)
{
	const char *asked = getenv("ACUT_FUZZ_SEED");

	return asked ? strtoull(asked, NULL, 10) : 1;
}

/* Makes a folder of its own, acut-NAME-..., in TMPDIR, or in /tmp if that is not set or too long; `ret` holds `size` bytes. The
 * test removes it. */
static inline void repeat_folder(char *ret, size_t size, const char *name)
{
	const char *base = getenv("TMPDIR");
	int n = base && *base ? snprintf(ret, size, "%s/acut-%s-XXXXXX", base, name) : -1;

	if (n < 0 || (size_t)n >= size)
		n = snprintf(ret, size, "/tmp/acut-%s-XXXXXX", name);
	assert(n > 0 && (size_t)n < size);
	if (!mkdtemp(ret)) {
		perror(ret);
		abort();
	}
}

static inline int repeat_remove_one(const char *path, const struct stat *st, int kind, struct FTW *ftw)
{
	(void)st, (void)kind, (void)ftw;
	return remove(path);
}

/* Removes a folder with everything in it. */
static inline int repeat_remove(const char *folder)
{
	return nftw(folder, repeat_remove_one, 16, FTW_DEPTH | FTW_PHYS);
}

#endif
