/* The nearest word, for commands, verbs, options and values that were mistyped. */
#include <stdio.h>
#include <string.h>

#include "cli_guess.h"

enum { LONGEST = 40, FAR = 64 };

unsigned cli_guess_distance(const char *a, const char *b)
{
	size_t n = strlen(a), m = strlen(b);
	unsigned row[3][LONGEST + 1]; /* of i - 2, i - 1 and i letters of a */

	if (n > LONGEST || m > LONGEST)
		return FAR;
	for (size_t j = 0; j <= m; j++)
		row[1][j] = (unsigned)j;
	for (size_t i = 1; i <= n; i++) {
		row[2][0] = (unsigned)i;
		for (size_t j = 1; j <= m; j++) {
			unsigned d = row[1][j - 1] + (a[i - 1] != b[j - 1]);

			d = row[1][j] + 1 < d ? row[1][j] + 1 : d;
			d = row[2][j - 1] + 1 < d ? row[2][j - 1] + 1 : d;
			if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] && row[0][j - 2] + 1 < d)
				d = row[0][j - 2] + 1;
			row[2][j] = d;
		}
		memcpy(row[0], row[1], sizeof(row[0]));
		memcpy(row[1], row[2], sizeof(row[1]));
	}
	return row[1][m];
}

void cli_guess_offer(struct cli_guess *g, const char *word)
{
	size_t n = strlen(word), given = strlen(g->given);
	unsigned d = cli_guess_distance(g->given, word), most = n < 4 ? 1 : (unsigned)(n + 2) / 3;

	/* one that was cut short is as near as a mistyped letter */
	if (d > 1 && given >= 3 && !strncmp(word, g->given, given))
		d = 1;
	if (!d || d > most || (g->distance && d >= g->distance) || n >= sizeof(g->best))
		return;
	g->distance = d;
	memcpy(g->best, word, n + 1);
}

void cli_guess_offer_choices(struct cli_guess *g, const char *choices)
{
	char word[64];

	while (*choices) {
		size_t n = strcspn(choices, "|");

		snprintf(word, sizeof(word), "%.*s", (int)n, choices);
		cli_guess_offer(g, word);
		choices += n + (choices[n] == '|');
	}
}

const char *cli_guess_text(const struct cli_guess *g, const char *prefix, char *buf)
{
	buf[0] = 0;
	if (g->distance)
		snprintf(buf, 128, "did you mean %s%s? ", prefix, g->best);
	return buf;
}
