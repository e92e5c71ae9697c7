/*
 * Notes about what a push waits for: each file that gives nothing is named once, also after another one.
 *
 * Linked with --wrap=console_note.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "session.h"

static unsigned notes;
static char note[600];

void __wrap_console_note(struct console *c, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

void __wrap_console_note(struct console *c, const char *fmt, ...)
{
	va_list ap;

	notes++;
	va_start(ap, fmt);
	vsnprintf(note, sizeof note, fmt, ap);
	va_end(ap);
}

static struct session session;
static struct session_progress progress;

/* With what the new notes begin; NULL: there is none. */
static void show(const char *waiting, const char *says)
{
	const struct acut_progress now = {.phase = "probe", .waiting = waiting};
	unsigned before = notes;

	session_progress_show(&progress, &now);
	session_progress_show(&progress, &now);
	assert_int_equal(notes - before, says != NULL);
	if (says)
		assert_int_equal(strncmp(note, says, strlen(says)), 0);
}

static void stalled_files(void **state)
{
	char name[600] = "stalled-file: ";

	session_progress_init(&progress, &session);
	show("", NULL);
	show(NULL, NULL);
	show("stalled-file: a.las", "a.las gives nothing");
	show("stalled-file: b.las", "b.las gives nothing");
	show("", NULL);
	show("stalled-file: b.las", "b.las gives nothing");
	show("stalled-files: 4", "this push waits: 4 other files");
	/* The push that waited has a worker now, and its own file hangs. */
	show("stalled-file: c.las", "c.las gives nothing");
	show("stalled-files: 4", "this push waits: 4 other files");
	memset(name + strlen(name), 'x', sizeof name - 1 - strlen(name));
	show(name, "xxx");
	show("waiting-space: 5", "5 ");
	show("stalled-file: c.las", "c.las gives nothing");
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(stalled_files)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
