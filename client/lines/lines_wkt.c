/*
 * What the text of a coordinate system (WKT 1 and 2, ESRI's too) says at its top: name, EPSG numbers, units. The daemon
 * understands all of it (engine/crs); here it is only named. A text that is none gives nothing.
 *
 * A system of heights is part of a compound system, or follows as a tree of its own: ESRI writes PROJCS[...],VERTCS[...].
 */
#include "lines_priv.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { NEST_MOST = 32, WORD = 24, NAME_MOST = 256 };

#define COMPOUND " COMPD_CS COMPOUNDCRS "
#define VERTICAL " VERT_CS VERTCRS VERTCS VERTICALCRS "
#define GEOGRAPHIC " GEOGCS GEOGCRS GEODCRS GEOGRAPHICCRS "

struct nest {
	char word[NEST_MOST][WORD]; /* keywords of the brackets that are open */
	int depth;
	unsigned trees; /* that have begun */
	bool up;        /* of the last axis: it is one of heights */
};

static bool is_word(const char *word, const char *list)
{
	size_t n = strlen(word);

	for (const char *p = strcasestr(list, word); n && p; p = strcasestr(p + 1, word))
		if (p[-1] == ' ' && p[n] == ' ')
			return true;
	return false;
}

/* The system whose own properties stand at this depth: 1 for the whole, 2 in a compound one. */
static bool is_system(const struct nest *n, int depth)
{
	return depth == 1 || (depth == 2 && is_word(n->word[0], COMPOUND));
}

static void authority(const char *of, const char *at, struct lines_crs *crs)
{
	unsigned long v;

	if (strncasecmp(at, "\"EPSG\"", 6))
		return;
	at += 6;
	at += strspn(at, ", \"");
	v = isdigit((unsigned char)*at) ? strtoul(at, NULL, 10) : 0;
	if (!v || v > 1000000)
		return;
	if (is_word(of, VERTICAL))
		crs->epsg_z = (uint32_t)v;
	else if (!is_word(of, COMPOUND))
		crs->epsg = (uint32_t)v;
}

/* The length of the quoted name that begins behind `at`, as far as it is read. Texts of many brackets are not read once for
 * each of them. */
static size_t name_length(const char *at)
{
	size_t n = 0;

	while (n < NAME_MOST && at[n] && at[n] != '"')
		n++;
	while (n == NAME_MOST && n && ((unsigned char)at[n] & 0xc0) == 0x80) /* it is cut between two characters */
		n--;
	return n;
}

/* Puts the name at `at` into `ret`; false: there is none. */
static bool take_name(const char *at, char *ret, size_t size)
{
	if (*at != '"')
		return false;
	lines_utf8(at + 1, name_length(at + 1), ret, size);
	return true;
}

static void take_unit(const struct nest *n, const char *of, const char *at, struct lines_crs *crs)
{
	char unit[32];

	if (!take_name(at, unit, sizeof unit))
		return;
	for (char *p = unit; *p; p++)
		*p = *p == '_' ? ' ' : *p;
	if (is_word(of, VERTICAL) || n->up)
		lines_unit_of(unit, crs->unit_z);
	else if (!is_word(of, GEOGRAPHIC))
		lines_unit_of(unit, crs->unit);
}

/* AXIS["name",direction */
static bool is_up(const char *at)
{
	size_t n = *at == '"' ? name_length(at + 1) : 0;

	if (!n || at[n + 1] != '"')
		return false;
	at += n + 2;
	at += *at == ',';
	at += *at == ' ';
	return !strncasecmp(at, "up", 2) || !strncasecmp(at, "down", 4);
}

/* Of a second tree. */
static void add_name(const char *at, struct lines_crs *crs)
{
	size_t n = strlen(crs->name);
	char name[LINES_NAME_SIZE];

	if (n + 4 < sizeof crs->name && take_name(at, name, sizeof name)) {
		memcpy(crs->name + n, " + ", 4);
		lines_utf8(name, strlen(name), crs->name + n + 3, sizeof crs->name - n - 3);
	}
}

/* A bracket was opened: `at` is behind it. */
static void enter(struct nest *n, const char *at, struct lines_crs *crs)
{
	const char *word = n->word[n->depth - 1], *of = n->depth > 1 ? n->word[n->depth - 2] : "";

	at += strspn(at, " \t\r\n");
	n->trees += n->depth == 1;
	if (n->trees > 1 && !is_word(n->word[0], VERTICAL))
		return;
	if (n->depth == 1 && n->trees == 1)
		take_name(at, crs->name, sizeof crs->name);
	else if (n->depth == 1)
		add_name(at, crs);
	if (is_word(word, GEOGRAPHIC) && is_system(n, n->depth))
		crs->degrees = true;
	if (is_word(word, " AUTHORITY ID ") && is_system(n, n->depth - 1))
		authority(of, at, crs);
	if (is_word(word, " AXIS "))
		n->up = is_up(at);
	if (!is_word(word, " UNIT LENGTHUNIT "))
		return;
	/* WKT 2 has it in the system, or in each axis of it. */
	if (n->depth > 2 && is_word(of, " AXIS ") && is_system(n, n->depth - 2)) {
		take_unit(n, n->word[n->depth - 3], at, crs);
	} else if (is_system(n, n->depth - 1)) {
		n->up = false;
		take_unit(n, of, at, crs);
	}
}

void lines_crs_of_wkt(const char *wkt, struct lines_crs *crs)
{
	struct nest n = {.depth = 0};
	char word[WORD] = "";
	size_t k = 0;
	bool quoted = false;

	for (const char *p = wkt; *p && n.depth < NEST_MOST; p++) {
		if (*p == '"')
			quoted = !quoted;
		if (quoted)
			continue;
		if (*p == '[' || *p == '(') {
			word[k] = 0;
			strcpy(n.word[n.depth++], word);
			if (n.depth < NEST_MOST)
				enter(&n, p + 1, crs);
		} else if ((*p == ']' || *p == ')') && n.depth) {
			n.depth--;
		}
		if (isalpha((unsigned char)*p) || *p == '_')
			k += k + 1 < WORD ? (word[k] = *p, 1) : 0;
		else
			k = 0;
	}
}
