/*
 * What the text of a coordinate system (WKT 1 and 2, ESRI's too) says at its top: name, EPSG numbers, units. The daemon
 * understands all of it (engine/crs); here it is only named. A text that is none gives nothing.
 */
#include "lines_priv.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { NEST_MOST = 32, WORD = 24 };

struct nest {
	char word[NEST_MOST][WORD]; /* keywords of the brackets that are open */
	int depth;
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
	return depth == 1 || (depth == 2 && is_word(n->word[0], " COMPD_CS COMPOUNDCRS "));
}

static void authority(const struct nest *n, const char *at, struct lines_crs *crs)
{
	unsigned long v;

	if (strncasecmp(at, "\"EPSG\"", 6))
		return;
	at += 6;
	at += strspn(at, ", \"");
	v = isdigit((unsigned char)*at) ? strtoul(at, NULL, 10) : 0;
	if (!v || v > 1000000)
		return;
	if (n->depth == 3 && is_word(n->word[1], " VERT_CS VERTCRS "))
		crs->epsg_z = (uint32_t)v;
	else if (n->depth == 3 || !is_word(n->word[0], " COMPD_CS COMPOUNDCRS "))
		crs->epsg = (uint32_t)v;
}

static void take_name(const char *at, char *ret, size_t size)
{
	size_t n;

	at += *at == '"';
	n = strcspn(at, "\"");
	lines_utf8(at, n, ret, size);
}

/* A bracket was opened: `at` is behind it. */
static void enter(struct nest *n, const char *at, struct lines_crs *crs)
{
	const char *word = n->word[n->depth - 1], *of = n->depth > 1 ? n->word[n->depth - 2] : "";
	char unit[32];

	at += strspn(at, " \t\r\n");
	if (n->depth == 1)
		take_name(at, crs->name, sizeof crs->name);
	if (is_word(word, " GEOGCS GEOGCRS GEODCRS GEOGRAPHICCRS ") && is_system(n, n->depth))
		crs->degrees = true;
	if (is_word(word, " AUTHORITY ID ") && is_system(n, n->depth - 1))
		authority(n, at, crs);
	if (is_word(word, " UNIT LENGTHUNIT ") && is_system(n, n->depth - 1)) {
		take_name(at, unit, sizeof unit);
		for (char *p = unit; *p; p++)
			*p = *p == '_' ? ' ' : *p;
		if (is_word(of, " VERT_CS VERTCRS "))
			lines_unit_of(unit, crs->unit_z);
		else if (!is_word(of, " GEOGCS GEOGCRS GEODCRS "))
			lines_unit_of(unit, crs->unit);
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
