/*
 * Modes, as chmod reads and ls writes them. Bits that a dataset cannot have (setuid, setgid, sticky) are errors, not
 * ignored.
 */
#include "mode.h"

#include <string.h>

#include "err.h"

static int bad(const char *text, struct err *err)
{
	err_set(err, ERR_USAGE, "\"%.60s\" is not a mode", text);
	return err_add_hint(err, "give it as 640 or 0640, or as u=rw,g=r,o= or g+w");
}

static int octal(const char *text, uint32_t *ret, struct err *err)
{
	uint32_t mode = 0;
	const char *c;

	for (c = text; *c; c++) {
		if (*c < '0' || *c > '7' || c - text > 5)
			return bad(text, err);
		mode = mode << 3 | (uint32_t)(*c - '0');
	}
	if (mode > MODE_ALL) {
		err_set(err, ERR_USAGE, "the mode %.8s has more than the rights of owner, group and others", text);
		return err_add_hint(err, "only the last three digits mean something for a dataset");
	}
	*ret = mode;
	return 0;
}

/* Repeats three bits for each of u, g, o in `who`. */
static uint32_t repeat_bits(uint32_t bits, uint32_t who)
{
	return (bits << 6 | bits << 3 | bits) & who;
}

static uint32_t parse_who(const char **at)
{
	uint32_t who = 0;

	for (;; ++*at) {
		if (**at == 'u')
			who |= 0700;
		else if (**at == 'g')
			who |= 0070;
		else if (**at == 'o')
			who |= 0007;
		else if (**at == 'a')
			who |= 0777;
		else
			return who;
	}
}

/* "u", "g", "o": the bits that it has now; otherwise letters of rwxX, perhaps none. */
static uint32_t parse_bits(const char **at, uint32_t mode)
{
	uint32_t bits = 0;

	if (**at && strchr("ugo", **at)) {
		bits = **at == 'u' ? mode >> 6 : **at == 'g' ? mode >> 3 : mode;
		++*at;
		return bits & 7;
	}
	for (;; ++*at) {
		if (**at == 'r')
			bits |= 4;
		else if (**at == 'w')
			bits |= 2;
		else if (**at == 'x')
			bits |= 1;
		else if (**at == 'X')
			bits |= mode & 0111 ? 1 : 0;
		else
			return bits;
	}
}

int mode_parse(const char *text, uint32_t old, uint32_t mask, uint32_t *ret, struct err *err)
{
	uint32_t mode = old & MODE_ALL;
	const char *at = text;

	if (*text >= '0' && *text <= '9')
		return octal(text, ret, err);
	do {
		uint32_t who = parse_who(&at), named = who ? who : MODE_ALL & ~mask;

		if (!*at || !strchr("+-=", *at))
			return bad(text, err);
		while (*at && strchr("+-=", *at)) {
			char what = *at++;
			uint32_t bits = repeat_bits(parse_bits(&at, mode), named);

			if (what == '=')
				mode = (mode & ~(who ? who : (uint32_t)MODE_ALL)) | bits;
			else
				mode = what == '+' ? mode | bits : mode & ~bits;
		}
	} while (*at == ',' && *++at);
	if (*at || at[-1] == ',')
		return bad(text, err);
	*ret = mode;
	return 0;
}

char *mode_text(uint32_t mode, char *buf)
{
	static const char letters[] = "rwxrwxrwx";

	for (int i = 0; i < 9; i++)
		buf[i] = mode >> (8 - i) & 1 ? letters[i] : '-';
	buf[9] = 0;
	return buf;
}
