/* Tables and texts: nothing harmful comes out, widths are those of a terminal, rows are the same for scripts. */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include <cmocka.h>

#include "console.h"
#include "err.h"

static void safe_is(const char *text, const char *wanted)
{
	char *safe = term_safe(text);

	assert_string_equal(safe, wanted);
	free(safe);
}

static void test_safe(void **state)
{
	(void)state;
	safe_is("", "");
	safe_is("Grüße, 地形.las", "Grüße, 地形.las");
	safe_is("a\033[2J\nb\tc\r", "a\\x1b[2J\\nb\\tc\\x0d");
	safe_is("\x7f\xc2\x9b"
		"31m",
		"\\x7f\\xc2\\x9b31m");
	safe_is("\xff\xc0\xaf\xed\xa0\x80\xc3", "\\xff\\xc0\\xaf\\xed\\xa0\\x80\\xc3");
	safe_is("x\u202egnp", "x\\xe2\\x80\\xaegnp"); /* would turn the name around */
}

static void test_columns(void **state)
{
	(void)state;
	assert_int_equal(term_columns("abc"), 3);
	assert_int_equal(term_columns("Grüße"), 5);
	assert_int_equal(term_columns("地形"), 4);
	assert_int_equal(term_columns("e\u0301"), 1);
	assert_int_equal(term_fit("地形", 3), 3);
	assert_int_equal(term_fit("e\u0301x", 1), 3);
}

static void shorten_is(const char *text, unsigned columns, bool tail, const char *wanted)
{
	char buf[200];

	snprintf(buf, sizeof(buf), "%s", text);
	term_shorten(buf, columns, tail);
	assert_string_equal(buf, wanted);
	assert_true(term_columns(buf) <= columns || !columns);
}

static void test_shorten(void **state)
{
	(void)state;
	shorten_is("valley", 6, false, "valley");
	shorten_is("valley", 5, false, "va…ey");
	shorten_is("valley", 4, false, "va…y");
	shorten_is("valley", 1, false, "…");
	shorten_is("waits for its turn", 10, true, "waits for…");
	shorten_is("地形地形地形", 7, false, "地…形");
	shorten_is("地形地形地形", 8, false, "地形…形");
	shorten_is("abe\u0301e\u0301cd", 5, false, "ab…cd");
	for (unsigned n = 1; n < 30; n++)
		shorten_is("", n, false, "");
}

static const struct term_column columns[] = {
	{"NAME", .shrink = true},  {"POINTS", .right = true}, {"SIZE", .right = true},
	{"PUSHED", .spare = true}, {"NOTE", .tail = true},
};

static void fill(FILE *out)
{
	struct term_table *t = term_table_new(out, columns, 5);

	term_table_text(t, "a-very-long-name-of-a-dataset-that-somebody-made");
	term_table_count(t, 1234567);
	term_table_size(t, 3u << 30);
	term_table_time(t, 1700000000000000);
	term_table_text(t, "waits for its turn, which may be long");
	term_table_text(t, "tab\there");
	term_table_none(t);
	term_table_size(t, 5);
	term_table_time(t, 0);
	term_table_text(t, "%s", "");
	assert_null(term_table_free(t));
}

static void test_plain(void **state)
{
	char *text = NULL;
	size_t size;
	FILE *out = open_memstream(&text, &size);

	(void)state;
	fill(out);
	fclose(out);
	assert_string_equal(text, "a-very-long-name-of-a-dataset-that-somebody-made\t1234567\t3221225472\t2023-11-14T22:13:20Z\t"
				  "waits for its turn, which may be long\ntab\\there\t-\t5\t-\t-\n");
	free(text);
}

/* What fill writes to a terminal of so many columns, in memory of its own. */
static char *shown(unsigned width)
{
	int terminal = posix_openpt(O_RDWR | O_NOCTTY), side;
	struct winsize ws = {.ws_col = (unsigned short)width, .ws_row = 24};
	struct termios raw;
	static char text[4096];
	size_t size = 0;
	ssize_t n;
	FILE *out;

	if (terminal < 0 || grantpt(terminal) || unlockpt(terminal))
		skip();
	side = open(ptsname(terminal), O_RDWR | O_NOCTTY);
	assert_true(side >= 0);
	assert_false(tcgetattr(side, &raw));
	cfmakeraw(&raw);
	assert_false(tcsetattr(side, TCSANOW, &raw));
	assert_false(ioctl(side, TIOCSWINSZ, &ws));
	out = fdopen(side, "w");
	fill(out);
	fclose(out);
	while ((n = read(terminal, text + size, sizeof(text) - 1 - size)) > 0)
		size += (size_t)n;
	text[size] = 0;
	close(terminal);
	return text;
}

static void test_terminal(void **state)
{
	static const unsigned widths[] = {200, 132, 100, 80, 60, 50, 40};

	(void)state;
	unsetenv("COLUMNS");
	setenv("TERM", "xterm", 1);
	setenv("NO_COLOR", "1", 1);
	for (unsigned i = 0; i < sizeof(widths) / sizeof(*widths); i++) {
		char *text = shown(widths[i]), *save = NULL;
		unsigned lines = 0;

		assert_null(strchr(text, '\033'));
		assert_null(strchr(text, '\t'));
		assert_non_null(strstr(text, "1,234,567"));
		assert_non_null(strstr(text, "3.0 GB"));
		for (char *line = strtok_r(text, "\n", &save); line; line = strtok_r(NULL, "\n", &save), lines++)
			assert_true(term_columns(line) <= widths[i]);
		assert_int_equal(lines, 3);
	}
	assert_non_null(strstr(shown(200), "a-very-long-name-of-a-dataset-that-somebody-made"));
	assert_non_null(strstr(shown(60), "…"));
	unsetenv("NO_COLOR");
	assert_non_null(strstr(shown(80), "\033[1m"));
	setenv("NO_COLOR", "", 1); /* empty is not set */
	assert_non_null(strstr(shown(80), "\033[1m"));
	unsetenv("NO_COLOR");
	setenv("TERM", "dumb", 1);
	assert_null(strstr(shown(80), "\033"));
}

static size_t refused; /* bytes that malloc does not give; SIZE_MAX: any */

void *__real_malloc(size_t size);
void *__wrap_malloc(size_t size);

void *__wrap_malloc(size_t size)
{
	return size == refused || refused == SIZE_MAX ? NULL : __real_malloc(size);
}

/* Without memory for the first cell of the second row: the later ones do not move into its place. */
static void test_no_memory(void **state)
{
	char *text;

	(void)state;
	refused = 4 * strlen("tab\there") + 4;
	text = shown(100);
	refused = 0;
	assert_non_null(strstr(text, "1,234,567"));
	text = strchr(strstr(text, "1,234,567"), '\n');
	assert_string_equal(text, "\n");
}

static void table_on_terminal(void)
{
	shown(100);
}

static void no_table(void)
{
	term_table_free(term_table_new(stdout, columns, 5));
}

static void one_text(void)
{
	term_put(stdout, "tab\there");
}

static bool told; /* on standard error */

/* The exit status of a program that would end with `status`, and has no memory for `size` bytes while it prints. */
static int status_without(size_t size, void (*print)(void), int status)
{
	struct console console = {.program = "test", .report = stdout};
	int errors = memfd_create("errors", 0);
	pid_t child = fork();

	if (!child) {
		dup2(errors, STDERR_FILENO);
		refused = size;
		print();
		refused = 0;
		_exit(console_end(&console, status));
	}
	assert_int_equal(waitpid(child, &status, 0), child);
	assert_true(WIFEXITED(status));
	told = lseek(errors, 0, SEEK_END) > 0;
	close(errors);
	return WEXITSTATUS(status);
}

/* A list that is not whole does not look as if it were. */
static void test_lost(void **state)
{
	const size_t cell = 4 * strlen("tab\there") + 4;
	int none = err_exit_status(ERR_NOMEM);

	(void)state;
	assert_true(none > 0);
	assert_int_equal(status_without(0, table_on_terminal, 0), 0);
	assert_false(told);
	assert_int_equal(status_without(cell, table_on_terminal, 0), none);
	assert_int_equal(status_without(cell, table_on_terminal, none + 1), none + 1);
	assert_true(told);
	assert_int_equal(status_without(SIZE_MAX, no_table, 0), none);
	assert_int_equal(status_without(cell, one_text, 0), none);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_safe),      cmocka_unit_test(test_columns),  cmocka_unit_test(test_shorten),
		cmocka_unit_test(test_plain),     cmocka_unit_test(test_terminal), cmocka_unit_test(test_lost),
		cmocka_unit_test(test_no_memory),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
