/* The table of decisions: who is served, who may do what with a dataset or a job, and modes as texts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmocka.h>

#include "err.h"
#include "ledger.h"
#include "mode.h"
#include "rights.h"

enum { OWNER = 1000, OTHER = 1001, SELF = 990, GROUP = 50, SERVED = 60, ADMINS = 70 };

static const uint32_t in_group[] = {GROUP, SERVED}, in_served[] = {SERVED}, in_admins[] = {10, ADMINS, 80};

static struct peer peer(uint32_t uid, uint32_t gid, const uint32_t *groups, uint32_t n)
{
	return (struct peer){.uid = uid, .pid = 1, .gid = gid, .groups = groups, .ngroups = n};
}

static void datasets(void **state)
{
	const struct peer owner = peer(OWNER, 1, NULL, 0), first = peer(OTHER, GROUP, NULL, 0),
			  more = peer(OTHER, 1, in_group, 2), other = peer(OTHER, 1, in_served, 1), root = peer(0, 0, NULL, 0);

	for (uint32_t mode = 0; mode <= MODE_ALL; mode++) {
		assert_int_equal(rights_allow(&owner, RIGHT_READ, OWNER, GROUP, mode), mode >> 8 & 1);
		assert_int_equal(rights_allow(&owner, RIGHT_WRITE, OWNER, GROUP, mode), mode >> 7 & 1);
		assert_int_equal(rights_allow(&first, RIGHT_READ, OWNER, GROUP, mode), mode >> 5 & 1);
		assert_int_equal(rights_allow(&more, RIGHT_READ, OWNER, GROUP, mode), mode >> 5 & 1);
		assert_int_equal(rights_allow(&first, RIGHT_WRITE, OWNER, GROUP, mode), mode >> 4 & 1);
		assert_int_equal(rights_allow(&more, RIGHT_WRITE, OWNER, GROUP, mode), mode >> 4 & 1);
		assert_int_equal(rights_allow(&other, RIGHT_READ, OWNER, GROUP, mode), mode >> 2 & 1);
		assert_int_equal(rights_allow(&other, RIGHT_WRITE, OWNER, GROUP, mode), mode >> 1 & 1);
		/* A dataset without a group: no user counts as a member. */
		assert_int_equal(rights_allow(&first, RIGHT_READ, OWNER, RIGHTS_NOBODY, mode), mode >> 2 & 1);
		assert_true(rights_allow(&owner, RIGHT_OWN, OWNER, GROUP, mode));
		assert_false(rights_allow(&owner, RIGHT_CHOWN, OWNER, GROUP, mode));
		assert_false(rights_allow(&more, RIGHT_OWN, OWNER, GROUP, mode));
		for (int right = RIGHT_READ; right <= RIGHT_CHOWN; right++)
			assert_true(rights_allow(&root, (enum right)right, OWNER, GROUP, mode));
	}
}

static void admins(void **state)
{
	const struct rights rules = {.self = SELF, .gid = SERVED, .admin_gid = ADMINS, .group = "acut"},
			    open = {.self = SELF, .gid = RIGHTS_NOBODY, .admin_gid = RIGHTS_NOBODY};
	const struct {
		struct peer peer;
		bool admin, served;
	} row[] = {
		{peer(0, 0, NULL, 0), true, true},           {peer(SELF, 1, NULL, 0), true, true},
		{peer(OTHER, ADMINS, NULL, 0), true, true},  {peer(OTHER, 1, in_admins, 3), true, true},
		{peer(OTHER, SERVED, NULL, 0), false, true}, {peer(OTHER, 1, in_served, 1), false, true},
		{peer(OTHER, 1, NULL, 0), false, false},     {peer(OTHER, RIGHTS_NOBODY, NULL, 0), false, false},
	};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct peer p = row[i].peer, kept;
		struct err err = ERR_INIT;

		rights_set_admin(&rules, &p);
		assert_int_equal(p.admin, row[i].admin);
		assert_int_equal(rights_connect(&rules, &p, &err), row[i].served ? 0 : -ERR_PERM);
		assert_true(row[i].served || strstr(err.message, "acut"));
		kept = rights_without_groups(&p);
		assert_null(kept.groups);
		assert_int_equal(rights_admin(&kept), row[i].admin);
		assert_int_equal(rights_acts_as(&kept, OWNER), row[i].admin);
		assert_true(rights_acts_as(&kept, p.uid));
		/* Without a group whoever comes is served, and only root and the daemon's own user are admins. */
		rights_set_admin(&open, &p);
		assert_int_equal(p.admin, !p.uid || p.uid == SELF);
		assert_int_equal(rights_connect(&open, &p, &err), 0);
	}
}

/* What the kernel says of this process is what getgroups says of it; all of it is given back. */
static void groups(void **state)
{
	struct ledger *ledger = ledger_new(1 << 20);
	struct peer p = {.gid = RIGHTS_NOBODY};
	struct err err = ERR_INIT;
	gid_t mine[64];
	int n = getgroups(64, mine), pair[2];

	assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, pair), 0);
	assert_int_equal(rights_groups(pair[0], ledger, &p, &err), 0);
	assert_int_equal(p.ngroups, n);
	for (int i = 0; i < n; i++)
		assert_true(rights_in_group(&p, mine[i]));
	assert_false(rights_in_group(&p, 4242424));
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), (uint64_t)n * sizeof(gid_t));
	rights_groups_free(ledger, &p);
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), 0);
	ledger_free(ledger);
	close(pair[0]);
	close(pair[1]);
}

static void modes(void **state)
{
	static const struct {
		const char *text;
		uint32_t old, mask, want; /* MODE_ALL + 1: refused */
	} row[] = {
		{"640", 0, 0, 0640},      {"0640", 0777, 0, 0640},       {"0", 0777, 0, 0},           {"777", 0, 0, 0777},
		{"g+w", 0640, 0, 0660},   {"o-r", 0644, 0, 0640},        {"u=rw,g=r,o=", 0, 0, 0640}, {"a+r", 0, 0, 0444},
		{"+w", 0444, 022, 0644},  {"ug+rwX,o-w", 0402, 0, 0660}, {"u+rwX", 0100, 0, 0700},    {"g=u", 0640, 0, 0660},
		{"g=u-w", 0640, 0, 0640}, {"go=", 0777, 0, 0700},        {"", 0, 0, 01000},           {"8", 0, 0, 01000},
		{"1777", 0, 0, 01000},    {"u+s", 0, 0, 01000},          {"rw", 0, 0, 01000},         {"u+r,", 0, 0, 01000},
		{"u", 0, 0, 01000},       {"640 ", 0, 0, 01000},         {"+t", 0, 0, 01000},         {"00000640", 0, 0, 01000},
	};
	char text[MODE_TEXT_SIZE];

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct err err = ERR_INIT;
		uint32_t mode = 07777;
		int r = mode_parse(row[i].text, row[i].old, row[i].mask, &mode, &err);

		if (row[i].want > MODE_ALL) {
			assert_int_equal(r, -ERR_USAGE);
			assert_int_equal(mode, 07777);
		} else {
			assert_int_equal(r, 0);
			assert_int_equal(mode, row[i].want);
		}
	}
	assert_string_equal(mode_text(0640, text), "rw-r-----");
	assert_string_equal(mode_text(0777, text), "rwxrwxrwx");
	assert_string_equal(mode_text(0, text), "---------");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(datasets),
		cmocka_unit_test(admins),
		cmocka_unit_test(groups),
		cmocka_unit_test(modes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
