/*
 * --weight: "2=1.5,9=30ft,flight/b.laz=0.5m". What has a letter, a slash or a wildcard before the "=" is the name of a file,
 * which the daemon finds in the dataset. In the request it follows an "@", and letters that separate words there are %XX.
 */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "ctl_view_weight.h"
#include "err.h"

enum { NAME_MOST = 4095 }; /* bytes of a path */

struct item {
	const char *of, *radius;
	size_t n, nradius;
	bool file;
};

static bool is_name(const char *at, size_t n)
{
	for (size_t i = 0; i < n; i++)
		if (isalpha((unsigned char)at[i]) || (unsigned char)at[i] >= 0x80 || strchr("/*?", at[i]))
			return true;
	return false;
}

static bool is_class(const char *at, size_t n)
{
	return n && n <= 3 && strspn(at, "0123456789") == n && strtoul(at, NULL, 10) <= 255;
}

/* The last "=" of the item is the one before the radius. */
static struct item item_of(const char *at, size_t n)
{
	const char *equal = n ? memrchr(at, '=', n) : NULL;
	struct item i = {.of = at, .n = equal ? (size_t)(equal - at) : n, .radius = equal ? equal + 1 : at + n};

	i.nradius = n - (size_t)(i.radius - at);
	i.file = is_name(i.of, i.n);
	return i;
}

int ctl_view_weight_check(const char *text, bool (*length)(const char *, size_t), struct err *err)
{
	const char *at = text;

	while (at) {
		size_t n = strcspn(at, ",");
		struct item i = item_of(at, n);

		if (i.n > NAME_MOST)
			return err_set(err, ERR_USAGE, "--weight: the name \"%.60s...\" has %zu bytes, more than a path has",
				       i.of, i.n);
		if (!i.n || (!i.file && !is_class(i.of, i.n)) || !length(i.radius, i.nradius)) {
			err_set(err, ERR_USAGE, "--weight is not a class or a file with a radius: \"%.*s\"",
				(int)(n < 200 ? n : 200), at);
			return err_add_hint(err, "give lengths, as in 2=1.5 or 2=1.5m,9=30ft or survey-2024/*.laz=0.5m");
		}
		at = at[n] ? at + n + 1 : NULL;
	}
	return 0;
}

static void put_name(const char *at, size_t n, FILE *out)
{
	putc('@', out);
	for (size_t i = 0; i < n; i++)
		if (isalnum((unsigned char)at[i]) || strchr("/*?.-_[]!", at[i]))
			putc(at[i], out);
		else
			fprintf(out, "%%%02X", (unsigned char)at[i]);
}

void ctl_view_weight_put(const char *text, FILE *out)
{
	const char *at = text;

	while (at) {
		size_t n = strcspn(at, ",");
		struct item i = item_of(at, n);

		if (at != text)
			putc(',', out);
		if (i.file)
			put_name(i.of, i.n, out);
		else
			fprintf(out, "%.*s", (int)i.n, i.of);
		fprintf(out, ":%.*s", (int)i.nradius, i.radius);
		at = at[n] ? at + n + 1 : NULL;
	}
}
