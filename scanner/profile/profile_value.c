/*
 * Values of keys. Strict: the whole text must be a value within its bounds. Numbers may be hexadecimal (0x19a2), bytes
 * have escapes, fields of binary telegrams are "u16le@4".
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "parse.h"
#include "profile_table.h"
#include "utf8.h"

static int hex_digit(char c)
{
	return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

static bool parse_number(const char *text, uint64_t *ret)
{
	uint64_t v = 0;
	size_t n = 2;

	if (text[0] != '0' || (text[1] != 'x' && text[1] != 'X'))
		return parse_u64(text, ret);
	for (; hex_digit(text[n]) >= 0 && n < 18; n++)
		v = v << 4 | (uint64_t)hex_digit(text[n]);
	if (n == 2 || text[n])
		return false;
	*ret = v;
	return true;
}

/* \xHH \r
 *  \t \0 \\ \" ; false: an invalid escape, or longer than `room`. */
static bool bytes_of(const char *text, uint8_t *to, size_t room, size_t *ret)
{
	static const char letters[] = "rnt0\\\"", means[] = "\r\n\t\0\\\"";
	size_t n = 0;

	for (; *text; text++, n++) {
		const char *letter;

		if (n == room)
			return false;
		to[n] = (uint8_t)*text;
		if (*text != '\\')
			continue;
		text++;
		if (*text == 'x' && hex_digit(text[1]) >= 0 && hex_digit(text[2]) >= 0) {
			to[n] = (uint8_t)(hex_digit(text[1]) << 4 | hex_digit(text[2]));
			text += 2;
		} else if (*text && (letter = strchr(letters, *text))) {
			to[n] = (uint8_t)means[letter - letters];
		} else {
			return false;
		}
	}
	*ret = n;
	return true;
}

/* u8@OFFSET, u16le@, u16be@, u32le@, u32be@ */
static bool parse_field(const char *text, struct profile_field *ret)
{
	static const struct {
		const char *name;
		uint8_t size;
		bool big;
	} types[] = {
		{"u8@", 1, false}, {"u16le@", 2, false}, {"u16be@", 2, true}, {"u32le@", 4, false}, {"u32be@", 4, true},
	};
	uint64_t at;

	for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
		size_t n = strlen(types[i].name);

		if (strncmp(text, types[i].name, n))
			continue;
		if (!parse_number(text + n, &at) || at > 1 << 20)
			return false;
		*ret = (struct profile_field){(int32_t)at, types[i].size, types[i].big};
		return true;
	}
	return false;
}

/* Index of the word in "a|b|c"; -1. */
static int find_choice(const char *words, const char *text)
{
	size_t n = strlen(text);

	for (int i = 0; *words; i++) {
		size_t w = strcspn(words, "|");

		if (w == n && !memcmp(words, text, n))
			return i;
		words += w + (words[w] == '|');
	}
	return -1;
}

/* UTF-8 without control characters. */
static bool is_text(const char *text)
{
	size_t n;

	while (*text && (n = utf8_printable(text, SIZE_MAX)))
		text += n;
	return !*text;
}

static bool text_value(const struct profile_key *k, const char *text, char *to, char *wanted)
{
	size_t n = strlen(text);

	snprintf(wanted, PROFILE_WANTED_SIZE,
		 k->type == PROFILE_NAME ? "a name of letters a to z, digits and -, at most %zu" :
					   "UTF-8 text without control characters, at most %zu bytes",
		 k->size - 1);
	if (n >= k->size || !is_text(text))
		return false;
	if (k->type == PROFILE_NAME && (!n || strspn(text, "abcdefghijklmnopqrstuvwxyz0123456789-") != n))
		return false;
	memcpy(to, text, n + 1);
	return true;
}

static bool whole_value(const struct profile_key *k, const char *text, void *to, char *wanted)
{
	uint64_t v;

	snprintf(wanted, PROFILE_WANTED_SIZE,
		 k->most == 0xffff || k->type == PROFILE_U8 || k->most == 0xff ? "a number from 0x%.2llx to 0x%.2llx" :
										 "a whole number from %llu to %llu",
		 (unsigned long long)k->least, (unsigned long long)k->most);
	if (k->type == PROFILE_SIZE ? !parse_size(text, &v) && !parse_number(text, &v) : !parse_number(text, &v))
		return false;
	if ((double)v < k->least || (double)v > k->most)
		return false;
	if (k->type == PROFILE_U8)
		*(uint8_t *)to = (uint8_t)v;
	else if (k->type == PROFILE_INT)
		*(int *)to = (int)v;
	else
		*(uint32_t *)to = (uint32_t)v;
	return true;
}

static bool real_value(const struct profile_key *k, const char *text, void *to, char *wanted)
{
	double v;

	snprintf(wanted, PROFILE_WANTED_SIZE, "a number from %g to %g%s", k->least, k->most,
		 k->type == PROFILE_MS ? " (seconds)" : "");
	if (k->type == PROFILE_MS ? !parse_seconds(text, &v) : !parse_double(text, &v))
		return false;
	if (!(v >= k->least && v <= k->most))
		return false;
	if (k->type == PROFILE_MS)
		*(uint32_t *)to = (uint32_t)lround(v * 1000);
	else
		*(double *)to = v;
	return true;
}

/* Commands stand behind one another; an answer belongs to the last. */
static bool command_value(const struct profile_key *k, const char *text, struct profile *p, char *wanted)
{
	bool stop = k->offset == offsetof(struct profile, stop);
	struct profile_command *all = stop ? p->stop : p->start;
	size_t *n = stop ? &p->stops : &p->starts, size;
	uint8_t bytes[PROFILE_COMMAND_SIZE];

	snprintf(wanted, PROFILE_WANTED_SIZE, "1 to %d bytes, with escapes \\xHH \\r \\n \\t \\0 \\\\", PROFILE_COMMAND_SIZE);
	if (!bytes_of(text, bytes, sizeof bytes, &size) || !size)
		return false;
	if (k->type == PROFILE_ANSWER) {
		snprintf(wanted, PROFILE_WANTED_SIZE, "one answer behind each send");
		if (!*n || all[*n - 1].answer_size)
			return false;
		memcpy(all[*n - 1].answer, bytes, size);
		all[*n - 1].answer_size = size;
		return true;
	}
	snprintf(wanted, PROFILE_WANTED_SIZE, "at most %d commands", PROFILE_COMMANDS);
	if (*n == PROFILE_COMMANDS)
		return false;
	memset(&all[*n], 0, sizeof *all);
	memcpy(all[*n].at, bytes, size);
	all[*n].size = size;
	++*n;
	return true;
}

static bool bytes_value(const struct profile_key *k, const char *text, struct profile *p, char *wanted)
{
	uint8_t bytes[sizeof p->sync];
	size_t size;

	snprintf(wanted, PROFILE_WANTED_SIZE, "1 to %zu bytes, with escapes \\xHH", sizeof bytes);
	if (!bytes_of(text, bytes, sizeof bytes, &size) || !size)
		return false;
	memcpy(p->sync, bytes, size);
	p->sync_size = size;
	return true;
}

static bool field_value(const struct profile_key *k, const char *text, struct profile *p, char *wanted)
{
	struct profile_field f;

	snprintf(wanted, PROFILE_WANTED_SIZE, "TYPE@OFFSET, TYPE one of u8, u16le, u16be, u32le, u32be, as u16le@4");
	if (!parse_field(text, &f))
		return false;
	if (k->type == PROFILE_FIELD) {
		memcpy((char *)p + k->offset, &f, sizeof f);
		return true;
	}
	p->length_offset = (uint32_t)f.offset;
	p->length_size = f.size;
	p->length_big_endian = f.big_endian;
	return true;
}

bool profile_value_read(const struct profile_key *k, const char *text, struct profile *to, char ret_wanted[PROFILE_WANTED_SIZE])
{
	void *at = (char *)to + k->offset;
	int word;

	switch (k->type) {
	case PROFILE_TEXT:
	case PROFILE_PATTERN:
	case PROFILE_NAME:
		return text_value(k, text, at, ret_wanted);
	case PROFILE_INT:
	case PROFILE_U8:
	case PROFILE_U32:
	case PROFILE_SIZE:
		return whole_value(k, text, at, ret_wanted);
	case PROFILE_MS:
	case PROFILE_REAL:
		return real_value(k, text, at, ret_wanted);
	case PROFILE_CHOICE:
		snprintf(ret_wanted, PROFILE_WANTED_SIZE, "one of %s", k->words);
		word = find_choice(k->words, text);
		if (word >= 0)
			memcpy(at, &word, sizeof word);
		return word >= 0;
	case PROFILE_YES:
		snprintf(ret_wanted, PROFILE_WANTED_SIZE, "yes or no");
		word = find_choice("no|yes", text);
		*(bool *)at = word > 0;
		return word >= 0;
	case PROFILE_FIELD:
	case PROFILE_LENGTH:
		return field_value(k, text, to, ret_wanted);
	case PROFILE_BYTES:
		return bytes_value(k, text, to, ret_wanted);
	case PROFILE_SEND:
	case PROFILE_ANSWER:
		return command_value(k, text, to, ret_wanted);
	}
	return false;
}
