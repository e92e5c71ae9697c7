/*
 * Numbers in texts of areas (area_code.h).
 */
#include "area_code.h"

static const char alphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.";

enum { GROUP_BITS = 5, GROUP_MASK = 31, GROUP_MORE = 32 };

size_t area_code_put(__int128 v, char buf[AREA_CODE_SIZE])
{
	unsigned __int128 u = v < 0 ? ~((unsigned __int128)v << 1) : (unsigned __int128)v << 1;
	size_t n = 0;

	for (; u >> GROUP_BITS; u >>= GROUP_BITS)
		buf[n++] = alphabet[(u & GROUP_MASK) | GROUP_MORE];
	buf[n++] = alphabet[u];
	return n;
}

static int group_of(char c)
{
	if (c >= 'A' && c <= 'Z')
		return c - 'A';
	if (c >= 'a' && c <= 'z')
		return c - 'a' + 26;
	if (c >= '0' && c <= '9')
		return c - '0' + 52;
	return c == '_' ? 62 : c == '.' ? 63 : -1;
}

bool area_code_get(const char **text, const char *end, __int128 *ret)
{
	const char *t = *text;
	unsigned __int128 u = 0;
	__int128 v;
	int group;

	for (unsigned n = 0;; n++, t++) {
		if (t == end || n == AREA_CODE_SIZE || (group = group_of(*t)) < 0)
			return false;
		/* 25 groups are 125 bits, so a 26th group has only three more. */
		if (n == AREA_CODE_SIZE - 1 && group > 7)
			return false;
		u |= (unsigned __int128)(group & GROUP_MASK) << (n * GROUP_BITS);
		if (group & GROUP_MORE)
			continue;
		if (n && !group)
			return false; /* the number had already ended */
		break;
	}
	v = u & 1 ? (__int128)~(u >> 1) : (__int128)(u >> 1);
	if (v > AREA_CODE_MOST || v < -AREA_CODE_MOST)
		return false;
	*text = t + 1;
	*ret = v;
	return true;
}
