/*
 * Users and groups by name on this machine; the daemon uses numbers.
 */
#include "ctl_names.h"

#include <errno.h>
#include <grp.h>
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>

#include "acut.h"
#include "err.h"
#include "parse.h"

const char *ctl_user_name(uint32_t uid)
{
	const struct passwd *p = getpwuid(uid);

	return p && *p->pw_name ? p->pw_name : NULL;
}

const char *ctl_group_name(uint32_t gid)
{
	const struct group *g = gid == ACUT_NO_GROUP ? NULL : getgrgid(gid);

	return g && *g->gr_name ? g->gr_name : NULL;
}

char *ctl_user_text(uint32_t uid, char *buf)
{
	const char *name = ctl_user_name(uid);

	if (name)
		snprintf(buf, CTL_NAME_SIZE, "%s", name);
	else
		snprintf(buf, CTL_NAME_SIZE, "%u", uid);
	return buf;
}

char *ctl_group_text(uint32_t gid, char *buf)
{
	const char *name = ctl_group_name(gid);

	if (name)
		snprintf(buf, CTL_NAME_SIZE, "%s", name);
	else if (gid == ACUT_NO_GROUP)
		snprintf(buf, CTL_NAME_SIZE, "-");
	else
		snprintf(buf, CTL_NAME_SIZE, "%u", gid);
	return buf;
}

/* A name of digits is a number only if no user has it. */
static int number(const char *text, const char *what, uint32_t *ret, struct err *err)
{
	uint64_t n;

	if (!parse_u64(text, &n) || n >= UINT32_MAX) {
		err_set(err, ERR_USAGE, "there is no %s \"%.100s\"", what, text);
		return err_add_hint(err, "give the name or the number of a %s that this machine knows: getent %s", what,
				    *what == 'u' ? "passwd" : "group");
	}
	*ret = (uint32_t)n;
	return 0;
}

int ctl_user_find(const char *text, uint32_t *ret, struct err *err)
{
	const struct passwd *p = getpwnam(text);

	if (!p)
		return number(text, "user", ret, err);
	*ret = p->pw_uid;
	return 0;
}

int ctl_group_find(const char *text, uint32_t *ret, struct err *err)
{
	const struct group *g = getgrnam(text);

	if (!g)
		return number(text, "group", ret, err);
	*ret = g->gr_gid;
	return 0;
}
