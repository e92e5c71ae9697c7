/* Profiles: every key is read, every fault has its line, later folders override earlier ones, the right profile matches. */
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

#include "decoder.h"
#include "err.h"
#include "profile.h"

static int parse(const char *text, struct profile *p, struct err *err)
{
	*err = ERR_INIT;
	memset(p, 0xaa, sizeof *p);
	return profile_parse(text, strlen(text), "some", "/x/some.conf", p, err);
}

static const char all_keys[] =
	"title = A scanner\nnote = \" for service only \"\n"
	"[match]\nvendor = 0x19A2\nproduct = 20481\ndevice-class = 0xff\ninterface-class = 0x0a\nserial = SN*?7\n"
	"[usb]\nconfiguration = 2\ninterface = 1\nalternate = 3\nendpoint-in = 0x83\nendpoint-out = 0x04\n"
	"transfer-size = 32K\ntransfers = 12\ntimeout = 1.5s\n"
	"[start]\nsend = \\x02on\\x03\nanswer = \\x02ok\nsend = \\r\\n\\t\\0\\\\\n"
	"[stop]\nsend = off\n"
	"[framer]\nkind = length\ntelegram-max = 9K\nsync = \\xaa\\x55\nlength = u16be@2\nlength-add = 4\n"
	"[decoder]\nname = ranges\ncolumns = xyzi\nahead = -90.5\nstamp = last\nkind = u8@4\ndata-kind = 0x10\ncount = u16le@5\nshots = 360\n"
	"range = u32be@7\nrange-stride = 6\nrange-scale = 0.004\nrange-least = 2\nrange-most = 65534\nintensity = u16le@11\n"
	"intensity-stride = 6\nintensity-full = 4095\nangle-first = 135\nangle-step = -0.5\nperiod = 0.1\ncounter = u32le@0\ntime = u32be@4\n"
	"time-scale = 0.001\n"
	"[geometry]\nmount-roll = 180\nmount-pitch = 1.5\nmount-heading = -90\nlever-x = 0.1\nlever-y = -0.2\nlever-z = 1e-1\n"
	"range-min = 0.05\nrange-max = 25\n"
	"[time]\nsource = device\nlatency = 0.004\n";

static void test_all(void **state)
{
	struct profile p;
	struct err err;

	assert_int_equal(parse(all_keys, &p, &err), 0);
	assert_string_equal(p.name, "some");
	assert_string_equal(p.note, " for service only ");
	assert_int_equal(p.vendor, 0x19a2);
	assert_int_equal(p.product, 0x5001);
	assert_int_equal(p.device_class, 255);
	assert_int_equal(p.interface_class, 10);
	assert_string_equal(p.serial, "SN*?7");
	assert_true(p.configuration == 2 && p.interface == 1 && p.alternate == 3 && p.endpoint_in == 0x83 && p.endpoint_out == 4);
	assert_true(p.transfer_size == 32768 && p.transfers == 12 && p.timeout_ms == 1500);
	assert_true(p.starts == 2 && p.stops == 1);
	assert_true(p.start[0].size == 4 && !memcmp(p.start[0].at, "\2on\3", 4));
	assert_true(p.start[0].answer_size == 3 && !memcmp(p.start[0].answer, "\2ok", 3));
	assert_true(p.start[1].size == 5 && !memcmp(p.start[1].at, "\r\n\t\0\\", 5) && !p.start[1].answer_size);
	assert_true(p.framer == PROFILE_FRAMER_LENGTH && p.telegram_max == 9216 && p.sync_size == 2 && p.sync[0] == 0xaa);
	assert_true(p.length_offset == 2 && p.length_size == 2 && p.length_big_endian && p.length_add == 4);
	assert_string_equal(p.decoder, "ranges");
	assert_string_equal(p.columns, "xyzi");
	assert_true(p.angle_ahead == -90.5 && p.stamp == PROFILE_STAMP_LAST);
	assert_true(p.ranges.kind.offset == 4 && p.ranges.kind.size == 1 && p.ranges.data_kind == 16);
	assert_true(p.ranges.count.offset == 5 && p.ranges.count.size == 2 && !p.ranges.count.big_endian &&
		    p.ranges.shots == 360);
	assert_true(p.ranges.range.offset == 7 && p.ranges.range.size == 4 && p.ranges.range.big_endian &&
		    p.ranges.range_stride == 6);
	assert_true(p.ranges.range_scale == 0.004 && p.ranges.range_least == 2 && p.ranges.range_most == 65534);
	assert_true(p.ranges.intensity.offset == 11 && p.ranges.intensity_stride == 6 && p.ranges.intensity_full == 4095);
	assert_true(p.ranges.angle_first == 135 && p.ranges.angle_step == -0.5 && p.ranges.period_s == 0.1);
	assert_true(p.ranges.counter.offset == 0 && p.ranges.time.offset == 4 && p.ranges.time_scale == 0.001);
	assert_true(p.mount_roll == 180 && p.mount_pitch == 1.5 && p.mount_heading == -90);
	assert_true(p.lever[0] == 0.1 && p.lever[1] == -0.2 && p.lever[2] == 0.1 && p.range_min == 0.05 && p.range_max == 25);
	assert_true(p.time == PROFILE_TIME_DEVICE && p.latency_s == 0.004);
}

static void test_defaults(void **state)
{
	struct profile p;
	struct err err;

	assert_int_equal(parse("\xef\xbb\xbf# nothing\r\n\r\n;\n", &p, &err), 0);
	assert_false(profile_matches_some(&p));
	assert_true(p.endpoint_in == 0x81 && !p.endpoint_out && p.transfer_size == 16384 && p.transfers == 8);
	assert_string_equal(p.decoder, "raw");
	assert_int_equal(decoder_check(&p, &err), 0);
}

/* Text, line, a part of the sentence. */
static void test_faults(void **state)
{
	static const struct {
		const char *text;
		uint64_t line;
		const char *part;
	} faults[] = {
		{"title = a\nvendro = 1\n", 2, "no key vendro before the sections"},
		{"[match]\nvendr = 1\n", 2, "no key vendr in [match]"},
		{"[match]\ntransfers = 8\n", 2, "no key transfers"},
		{"[mach]\n", 1, "no section [mach]"},
		{"[match\n", 1, "written [name]"},
		{"[]\n", 1, "no section"},
		{"[usb]\n[match]\n[usb]\n", 3, "twice"},
		{"[usb]\ntransfers = 8\ntransfers = 9\n", 3, "stands twice"},
		{"[usb]\ntransfers = 0\n", 2, "from 1 to 256"},
		{"[usb]\ntransfers = 8x\n", 2, "wanted"},
		{"[usb]\ntransfers = -1\n", 2, "wanted"},
		{"[usb]\ntransfers =\n", 2, "a value is missing"},
		{"[usb]\ntransfers\n", 2, "neither"},
		{"[usb]\ntransfer-size = 1000\n", UINT64_MAX, "multiple of 512"},
		{"[usb]\nendpoint-in = 0x01\n", 2, "0x81 to 0x8f"},
		{"[usb]\nendpoint-out = 0x82\n", 2, "0x00 to 0x0f"},
		{"[usb]\nendpoint-in = 0x\n", 2, "wanted"},
		{"[usb]\ntimeout = 1 h\n", 2, "seconds"},
		{"[match]\nvendor = 0x10000\n", 2, "0xffff"},
		{"[match]\nproduct = 1\n", UINT64_MAX, "without its vendor"},
		{"[match]\ninterface-class = 8\n", UINT64_MAX, "mass storage"},
		{"[start]\nsend = a\\q\n", 2, "escapes"},
		{"[start]\nsend = a\\\n", 2, "escapes"},
		{"[start]\nsend = a\\x0\n", 2, "escapes"},
		{"[start]\nanswer = a\n", 2, "behind each send"},
		{"[start]\nsend = a\n", UINT64_MAX, "endpoint-out"},
		{"[framer]\nkind = xml\n", 2, "one of stream|stx-etx"},
		{"[framer]\nkind = fixed\n", UINT64_MAX, "needs the size"},
		{"[framer]\nkind = length\n", UINT64_MAX, "needs the place"},
		{"[framer]\nkind = line\nsync = a\n", UINT64_MAX, "sync belongs"},
		{"[framer]\nkind = fixed\nsize = 4\nsync = abcde\n", UINT64_MAX, "longer than the telegram"},
		{"[framer]\nkind = length\nlength = u16@4\n", 3, "u16le"},
		{"[framer]\nkind = length\nlength = u16le@1\nsync = ab\n", UINT64_MAX, "stands in the sync"},
		{"[framer]\nkind = length\nlength = u16le@100\ntelegram-max = 50\n", UINT64_MAX, "behind telegram-max"},
		{"[framer]\nstarts-torn = maybe\n", 2, "yes or no"},
		{"[decoder]\nname = Cola A\n", 2, "a name of letters"},
		{"[decoder]\nrange-scale = nan\n", 2, "wanted"},
		{"[decoder]\nrange-scale = inf\n", 2, "wanted"},
		{"[geometry]\nrange-min = 5\nrange-max = 4\n", UINT64_MAX, "less than range-min"},
		{"title = a\x01"
		 "b\n",
		 1, "UTF-8"},
		{"title = a\xc0\x80\n", 1, "UTF-8"},
		{"title = \"a\n", 1, "not closed"},
		{"[time]\nsource = sun\n", 2, "arrival|device"},
	};
	struct profile p;
	struct err err;

	for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
		int rc = parse(faults[i].text, &p, &err);

		if (rc != -ERR_INPUT || !strstr(err.message, faults[i].part) || err.offset != faults[i].line)
			fail_msg("%s: %d line %llu %s", faults[i].text, rc, (unsigned long long)err.offset, err.message);
		assert_string_equal(err.file, "/x/some.conf");
		assert_int_equal(((unsigned char *)&p)[100], 0xaa); /* untouched */
	}
}

static void test_limits(void **state)
{
	static char text[PROFILE_FILE_MAX + 2];
	struct profile p;
	struct err err = ERR_INIT;
	char name[PROFILE_NAME_SIZE + 1];

	memset(text, '\n', sizeof text);
	assert_int_equal(profile_parse(text, PROFILE_FILE_MAX, "a", "f", &p, &err), 0);
	assert_int_equal(profile_parse(text, PROFILE_FILE_MAX + 1, "a", "f", &p, &err), -ERR_INPUT);
	memset(text, '#', sizeof text);
	err = ERR_INIT;
	assert_int_equal(profile_parse(text, PROFILE_LINE_MAX, "a", "f", &p, &err), 0);
	assert_int_equal(profile_parse(text, PROFILE_LINE_MAX + 1, "a", "f", &p, &err), -ERR_INPUT);
	memset(name, 'n', sizeof name);
	name[PROFILE_NAME_SIZE] = '\0';
	err = ERR_INIT;
	assert_int_equal(profile_parse("", 0, name, "f", &p, &err), -ERR_INPUT);
	err = ERR_INIT;
	assert_int_equal(profile_parse("a\0b", 3, "a", "f", &p, &err), -ERR_INPUT);
	assert_non_null(strstr(err.message, "zero byte"));
}

/* ---- folders ---- */

static void write_file(const char *folder, const char *name, const char *text)
{
	char path[300];
	FILE *f;

	snprintf(path, sizeof path, "%s/%s", folder, name);
	f = fopen(path, "w");
	assert_non_null(f);
	fputs(text, f);
	assert_int_equal(fclose(f), 0);
}

static void test_folders(void **state)
{
	char base[] = "/tmp/acut-profile-XXXXXX", a[100], b[100], path[200];
	const char *folders[] = {a, b, "/nowhere/at/all", NULL};
	struct profile_set *set;
	struct profile_entry *one;
	struct err err = ERR_INIT;

	assert_non_null(mkdtemp(base));
	snprintf(a, sizeof a, "%s/a", base);
	snprintf(b, sizeof b, "%s/b", base);
	assert_int_equal(mkdir(a, 0700) | mkdir(b, 0700), 0);
	write_file(a, "two.conf", "title = shipped\n");
	write_file(a, "one.conf", "title = one\n");
	write_file(a, "gone.conf", "title = gone\n");
	write_file(a, "null.conf", "title = null\n");
	write_file(a, "bad.conf", "title = x\n[oops]\n");
	write_file(a, "not.conf~", "rubbish\n");
	write_file(a, ".conf", "rubbish\n");
	write_file(b, "two.conf", "title = mine\n");
	write_file(b, "gone.conf", "");
	snprintf(path, sizeof path, "%s/null.conf", b);
	assert_int_equal(symlink("/dev/null", path), 0);
	snprintf(path, sizeof path, "%s/fold.conf", b);
	assert_int_equal(mkdir(path, 0700), 0);
	assert_int_equal(profile_set_read(folders, &set, &err), 0);
	assert_int_equal(profile_set_count(set), 4); /* bad, fold, one, two */
	assert_string_equal(profile_set_at(set, 2)->profile.title, "one");
	assert_null(profile_set_at(set, 4));
	assert_string_equal(profile_set_find(set, "two")->profile.title, "mine");
	assert_string_equal(profile_set_find(set, "two")->text, "title = mine\n");
	assert_non_null(strstr(profile_set_find(set, "two")->path, "/b/two.conf"));
	assert_non_null(strstr(profile_set_find(set, "bad")->fault, "no section [oops]"));
	assert_non_null(strstr(profile_set_find(set, "bad")->fault, "/a/bad.conf"));
	assert_non_null(strstr(profile_set_find(set, "fold")->fault, "regular"));
	assert_null(profile_set_find(set, "gone"));
	assert_null(profile_set_find(set, "null"));
	profile_set_free(set);

	snprintf(path, sizeof path, "%s/one.conf", a);
	assert_int_equal(profile_entry_read(path, &one, &err), 0);
	assert_string_equal(one->profile.name, "one");
	profile_entry_free(one);
	snprintf(path, sizeof path, "%s/bad.conf", a);
	assert_int_equal(profile_entry_read(path, &one, &err), -ERR_INPUT);
	err = ERR_INIT;
	assert_int_equal(profile_entry_read("/nowhere/x.conf", &one, &err), -ERR_IO);
	err = ERR_INIT;
	assert_int_equal(profile_entry_read("/nowhere/x", &one, &err), -ERR_INPUT);
	snprintf(path, sizeof path, "rm -r %s", base);
	assert_int_equal(system(path), 0);
}

/* ---- matching ---- */

static const char *matched(struct profile_set *set, struct profile_device d)
{
	const struct profile_entry *e = profile_set_match(set, &d);

	return e ? e->profile.name : "none";
}

static void test_match(void **state)
{
	static const uint8_t classes[] = {3, 0xff};
	char base[] = "/tmp/acut-profile-XXXXXX", command[100];
	const char *folders[] = {base, NULL};
	struct profile_set *set;
	struct err err = ERR_INIT;

	assert_non_null(mkdtemp(base));
	write_file(base, "any.conf", "title = matches nothing\n");
	write_file(base, "class.conf", "[match]\ninterface-class = 0xff\n");
	write_file(base, "maker.conf", "[match]\nvendor = 1\n");
	write_file(base, "model.conf", "[match]\nvendor = 1\nproduct = 2\n");
	write_file(base, "own.conf", "[match]\nvendor = 1\nproduct = 2\nserial = A*7?\n");
	write_file(base, "broken.conf", "[match]\nvendor = 9\nx = 1\n");
	assert_int_equal(profile_set_read(folders, &set, &err), 0);
	assert_string_equal(matched(set, (struct profile_device){.vendor = 1, .product = 2, .serial = "AB-777x"}), "own");
	assert_string_equal(matched(set, (struct profile_device){.vendor = 1, .product = 2, .serial = "A7"}), "model");
	assert_string_equal(matched(set, (struct profile_device){.vendor = 1, .product = 2}), "model");
	assert_string_equal(matched(set, (struct profile_device){.vendor = 1, .product = 3}), "maker");
	assert_string_equal(matched(set, (struct profile_device){.vendor = 4, .interface_classes = classes, .interfaces = 2}),
			    "class");
	assert_string_equal(matched(set, (struct profile_device){.vendor = 4, .interface_classes = classes, .interfaces = 1}),
			    "none");
	assert_string_equal(matched(set, (struct profile_device){.vendor = 9}), "none");
	profile_set_free(set);
	snprintf(command, sizeof command, "rm -r %s", base);
	assert_int_equal(system(command), 0);
}

/* The shipped profiles are complete and have the required content. */
static void test_shipped(void **state)
{
	const char *folders[] = {getenv("ACUT_SHIPPED"), NULL};
	struct profile_device tim = {.vendor = 0x19a2, .product = 0x5001};
	struct profile_set *set;
	struct err err = ERR_INIT;

	assert_int_equal(profile_set_read(folders, &set, &err), 0);
	assert_int_equal(profile_set_count(set), 3);
	for (size_t i = 0; i < 3; i++) {
		const struct profile_entry *e = profile_set_at(set, i);

		if (e->fault || decoder_check(&e->profile, &err) < 0)
			fail_msg("%s: %s %s", e->path, e->fault ? e->fault : "", err.message);
		assert_int_equal(profile_matches_some(&e->profile), !strcmp(e->profile.name, "sick-tim"));
		assert_true(*e->profile.title);
	}
	assert_string_equal(matched(set, tim), "sick-tim");
	assert_non_null(strstr(profile_set_find(set, "sick-tim")->profile.note, "does not support"));
	assert_int_equal(profile_set_find(set, "sick-tim")->profile.endpoint_out, 2);
	profile_set_free(set);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_all),     cmocka_unit_test(test_defaults), cmocka_unit_test(test_faults),
		cmocka_unit_test(test_limits),  cmocka_unit_test(test_folders),  cmocka_unit_test(test_match),
		cmocka_unit_test(test_shipped),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
