/*
 * The reader of acutd.conf: what it takes, what it refuses and how, and that a value's text is read back as it was.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "config.h"
#include "config_file.h"
#include "config_report.h"
#include "repeat.h"

#define MIB (UINT64_C(1) << 20)

static char root[64], all[8192];

static void note(void *ctx, bool warning, const struct err *err)
{
	char text[1600];
	size_t n = strlen(all);

	snprintf(all + n, sizeof all - n, "%s %s\n", warning ? "warning" : "error", err_format(err, text, sizeof text));
}

/* The settings of a text; errors and warnings in `all`. */
static struct config read_bytes(const char *text, size_t n, unsigned errors)
{
	struct config_report report = {.emit = note};
	struct config c;

	all[0] = 0;
	config_presets(&c);
	config_text("f", text, n, &c, &report);
	if (report.errors == 1)
		note(NULL, false, &report.first);
	if (report.errors != errors)
		fail_msg("%u errors, %u expected:\n%s", report.errors, errors, all);
	return c;
}

static struct config read_text(const char *text, unsigned errors)
{
	return read_bytes(text, strlen(text), errors);
}

static void says(const char *text, const char *what)
{
	read_text(text, 1);
	if (!strstr(all, what))
		fail_msg("\"%s\" is not in: %s", what, all);
}

static void taken(void **state)
{
	struct config c = read_text("# a comment\n"
				    "; another\n"
				    "\n"
				    "  memory = 512M  \r\n"
				    "disk=70%\t\n"
				    "\tstate = \"/srv/my data # 1\"\n"
				    "user-jobs =4\n"
				    "space-wait = 2m\n"
				    "log-level=debug",
				    0);

	assert_int_equal(c.memory, 512 * MIB);
	assert_int_equal(c.disk.unit, SPACE_PERCENT);
	assert_int_equal(c.disk.n, 70);
	assert_string_equal(c.state, "/srv/my data # 1");
	assert_int_equal(c.user_jobs, 4);
	assert_true(c.space_wait == 120);
	assert_int_equal(c.level, LOG_LEVEL_DEBUG);
	assert_int_equal(c.origin[CONFIG_memory].by, CONFIG_BY_FILE);
	assert_int_equal(c.origin[CONFIG_memory].line, 4);
	assert_string_equal(c.origin[CONFIG_memory].file, "f");
	assert_int_equal(c.origin[CONFIG_threads].by, CONFIG_BY_DEFAULT);
	/* What nobody said. */
	assert_true(c.keep_removed == 7 * 86400);
	assert_int_equal(c.keep_free.n, 5);
	assert_int_equal(c.user_disk.unit, SPACE_UNLIMITED);
	assert_string_equal(all, "");
	c = read_text("\xef\xbb\xbfthreads = 3\n", 0);
	assert_int_equal(c.threads, 3);
	c = read_text("", 0);
	c = read_text("user-disk = 0\nuser-memory = 25%\nuser-connections = 7\ngroup = acut\nadmin-group = 0\n", 0);
	assert_int_equal(c.user_disk.unit, SPACE_UNLIMITED);
	assert_int_equal(c.user_memory, 25);
	assert_int_equal(c.user_connections, 7);
	assert_string_equal(c.group, "acut");
}

/* Nothing behind the = takes the setting back. */
static void taken_back(void **state)
{
	struct config c = read_text("keep-free = 50%\ngroup = acut\nmemory = 1G\n", 0), d;
	struct config_report report = {.emit = note};

	d = c;
	config_text("g", "keep-free =\ngroup=\nmemory = \n", 28, &d, &report);
	assert_int_equal(report.errors, 0);
	assert_int_equal(d.keep_free.n, 5);
	assert_string_equal(d.group, "");
	assert_int_equal(d.memory, 0);
	assert_int_equal(d.origin[CONFIG_memory].by, CONFIG_BY_DEFAULT);
}

static void last_holds(void **state)
{
	struct config c = read_text("threads = 2\nthreads = 3\n", 0);

	assert_int_equal(c.threads, 3);
	assert_string_equal(all, "warning f:2: threads was set in line 1 already; this line holds\n");
}

static void refused(void **state)
{
	char long_line[4096];

	says("memroy = 1G\n", "f:1: there is no setting \"memroy\" (is memory meant?)");
	says("\n\nUser_Jobs = 1\n", "f:3: there is no setting \"User_Jobs\" (is user-jobs meant?)");
	says("--disk = 1G\n", "is disk meant?");
	says("colour = red\n", "acutd.conf(5)");
	says("memory 1G\n", "write memory = VALUE");
	says("something\n", "key = value");
	says("= 3\n", "there is no setting \"\"");
	says("[Service]\n", "there are no sections here: [Service]");
	says("threads = 2 # two\n", "a comment stands on a line of its own");
	says("threads = 2\t; two\n", "a comment stands on a line of its own");
	says("state = \"/srv\n", "do not pair");
	says("state = '\n", "do not pair");
	says("memory = 1\\\nthreads = 2\n", "does not go on in the next line");
	says("memory = lots\n", "memory = lots: a size as 256M is wanted");
	says("memory = 0\n", "a size as 256M");
	says("threads = 0\n", "a number from 1 to 256");
	says("threads = 257\n", "a number from 1 to 256");
	says("disk = 0%\n", "1% to 100%");
	says("disk = 101%\n", "1% to 100%");
	says("keep-free = 100%\n", "0% to 99%");
	says("user-memory = 5\n", "a percentage");
	says("user-memory = 101%\n", "a percentage");
	says("keep-removed = 0\n", "a time above 0");
	says("space-wait = -1\n", "a time");
	says("log-level = loud\n", "error, warning, notice, info or debug");
	says("state = data\n", "not an absolute path");
	says("init = yes\n", "an option of the command line");
	says("idle-exit = 3\n", "an option of the command line");
	memset(long_line, 'x', sizeof long_line);
	memcpy(long_line, "state=/", 7);
	read_bytes(long_line, sizeof long_line, 1);
	assert_non_null(strstr(all, "too long"));
	read_bytes(long_line, 1000, 1);
	assert_non_null(strstr(all, "a folder is wanted"));
	read_bytes("threads = 2\nmem\0ory = 1G\n", 25, 1);
	assert_non_null(strstr(all, "f:2: there is a zero byte"));
}

/* All of them, with what is right between taken. */
static void all_are_told(void **state)
{
	struct config c = read_text("a = 1\nthreads = 4\nb = 2\nthreads = x\n", 3);

	assert_non_null(strstr(all, "f:1: "));
	assert_non_null(strstr(all, "f:3: "));
	assert_non_null(strstr(all, "f:4: "));
	assert_int_equal(c.threads, 4);
}

/* What a configuration is told as is what it was read from. */
static void texts(void **state)
{
	static const char *const values[CONFIG_SETTINGS][6] = {
		[CONFIG_state] = {"/srv/acut"},
		[CONFIG_memory] = {"256M", "4G", "1000000", "1T", "512K"},
		[CONFIG_threads] = {"1", "256"},
		[CONFIG_disk] = {"80%", "200G", "1"},
		[CONFIG_keep_free] = {"0%", "99%", "10G"},
		[CONFIG_keep_removed] = {"7d", "5h", "90s", "0.5s", "3m"},
		[CONFIG_space_wait] = {"0s", "1m", "2h"},
		[CONFIG_group] = {"acut", "1000"},
		[CONFIG_user_jobs] = {"0", "5"},
		[CONFIG_user_memory] = {"0%", "33%"},
		[CONFIG_user_datasets] = {"0", "1000"},
		[CONFIG_user_disk] = {"0", "10%", "50G"},
		[CONFIG_level] = {"error", "warning", "notice", "info", "debug"},
	};
	char text[CONFIG_PATH_SIZE];
	const char *wanted;

	for (int i = 0; i < CONFIG_SETTINGS; i++)
		for (int k = 0; k < 6 && values[i][k]; k++) {
			struct config c, d;

			config_presets(&c);
			assert_true(config_value_parse(&config_settings[i], values[i][k], &c, &wanted));
			assert_string_equal(config_value_text(&config_settings[i], &c, text), values[i][k]);
			config_presets(&d);
			config_value_copy(&config_settings[i], &c, &d);
			assert_true(config_value_equal(&config_settings[i], &c, &d));
		}
}

/* A time is told as briefly as it can be, and read again as the same number to its last bit. */
static void times(void **state)
{
	static const struct {
		const char *given, *told; /* NULL: whatever it is, it is the same */
	} row[] = {
		{"5000.1d", "432008640.00000006s"},
		{"0.1s", "0.1s"},
		{"0.3m", "18s"},
		{"1.5m", "90s"},
		{"90m", "90m"},
		{"24h", "1d"},
		{"0.7h", NULL},
		{"1.1d", NULL},
		{"0.123456789012345678s", NULL},
		{"9999.3d", NULL},
	};
	const struct config_setting *s = &config_settings[CONFIG_keep_removed];
	char text[CONFIG_PATH_SIZE];
	const char *wanted;

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct config c, again;

		config_presets(&c);
		config_presets(&again);
		assert_true(config_value_parse(s, row[i].given, &c, &wanted));
		config_value_text(s, &c, text);
		if (row[i].told)
			assert_string_equal(text, row[i].told);
		assert_true(config_value_parse(s, text, &again, &wanted));
		if (again.keep_removed != c.keep_removed)
			fail_msg("%s is told as %s, which is %.17g and not %.17g s", row[i].given, text, again.keep_removed,
				 c.keep_removed);
	}
}

/* The table itself: names once, a preset that its own row takes, and words for people. */
static void table(void **state)
{
	struct config c;
	const char *wanted;

	config_presets(&c);
	for (int i = 0; i < CONFIG_SETTINGS; i++) {
		const struct config_setting *s = &config_settings[i];

		for (int k = 0; k < i; k++)
			assert_string_not_equal(s->name, config_settings[k].name);
		assert_true(s->preset || s->preset_text);
		assert_true(!s->preset || config_value_parse(s, s->preset, &c, &wanted));
		if (!*s->help || s->help[strlen(s->help) - 1] != '.')
			fail_msg("the help of %s must be a sentence that ends with '.'", s->name);
		if (!*s->more || s->more[strlen(s->more) - 1] != '\n')
			fail_msg("the `more` of %s must be a text for the manual that ends with a line break", s->name);
	}
}

static void put(const char *name, const char *text)
{
	char path[128];
	FILE *f;

	snprintf(path, sizeof path, "%s/%s", root, name);
	f = fopen(path, "w");
	assert_non_null(f);
	fputs(text, f);
	fclose(f);
}

static struct config parse(unsigned errors, char **words, unsigned n)
{
	struct config_report report = {.emit = note};
	struct err err = ERR_INIT;
	struct config c = {0};
	int what;

	all[0] = 0;
	config_parse((int)n, words, &c, &what, &report, &err);
	if (errors == 1)
		note(NULL, false, &err);
	if (report.errors != errors)
		fail_msg("%u errors, %u expected:\n%s", report.errors, errors, all);
	return c;
}

#define PARSE(errors, ...)                                                                                        \
	parse(errors, (char *[]){"acutd", "--config", file, "--state", root, "--cache", root, __VA_ARGS__, NULL}, \
	      (unsigned)(sizeof((char *[]){__VA_ARGS__}) / sizeof(char *) + 7))

/* The main file, what lies beside it in the order of names, and the command line over all. */
static void files(void **state)
{
	char file[80], folder[90];
	struct config c;

	snprintf(file, sizeof file, "%s/a.conf", root);
	snprintf(folder, sizeof folder, "%s.d", file);
	PARSE(1, "--threads=1");
	assert_non_null(strstr(all, "a.conf: it cannot be read"));
	put("a.conf", "disk = 10%\nkeep-free = 1%\nuser-jobs = 1\nuser-connections = 1\n");
	assert_int_equal(mkdir(folder, 0700), 0);
	put("a.conf.d/20-b.conf", "user-jobs = 20\n");
	put("a.conf.d/10-a.conf", "user-jobs = 10\nkeep-free = 2%\n");
	put("a.conf.d/30-c.conf~", "no setting at all\n");
	put("a.conf.d/.30-c.conf", "no setting at all\n");
	put("a.conf.d/README", "no setting at all\n");
	c = PARSE(0, "--user-connections=3");
	assert_int_equal(c.disk.n, 10);
	assert_int_equal(c.keep_free.n, 2);
	assert_int_equal(c.user_jobs, 20);
	assert_int_equal(c.user_connections, 3);
	assert_int_equal(c.origin[CONFIG_user_connections].by, CONFIG_BY_LINE);
	assert_non_null(strstr(c.origin[CONFIG_user_jobs].file, "20-b.conf"));
	put("a.conf.d/40-d.conf", "user-job = 20\ngroup = no-such-group-here\n");
	PARSE(2, "--threads=1");
	assert_non_null(strstr(all, "40-d.conf:1: "));
	assert_non_null(strstr(all, "40-d.conf:2: there is no group no-such-group-here"));
	/* --no-config: not even the default one. */
	c = parse(0, (char *[]){"acutd", "--no-config", "--state", root, "--cache", root, NULL}, 6);
	assert_string_equal(c.file, "");
	put("a.conf.d/40-d.conf", "");
	snprintf(folder, sizeof folder, "%s/a.conf.d/50.conf", root);
	assert_int_equal(mkfifo(folder, 0600), 0);
	PARSE(1, "--threads=1");
	assert_non_null(strstr(all, "not a regular file"));
}

/* More than the limit leaves is refused with the numbers; a private daemon has one client. */
static void memory(void **state)
{
	assert_true(config_memory_most(UINT64_MAX, false) == UINT64_MAX);
	assert_int_equal(config_memory_most(300 * MIB, false), 252 * MIB);
	assert_int_equal(config_memory_most(300 * MIB, true), 268 * MIB);
	assert_int_equal(config_memory_most(40 * MIB, false), 0);
}

static int setup(void **state)
{
	repeat_folder(root, sizeof root, "config");
	return 0;
}

static int teardown(void **state)
{
	return repeat_remove(root);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(taken),        cmocka_unit_test(taken_back),
		cmocka_unit_test(last_holds),   cmocka_unit_test(refused),
		cmocka_unit_test(all_are_told), cmocka_unit_test(texts),
		cmocka_unit_test(times),        cmocka_unit_test(table),
		cmocka_unit_test(memory),       cmocka_unit_test_setup_teardown(files, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
