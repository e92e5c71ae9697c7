/*
 * "Did you mean ...": the nearest of the words that there are. Distance: letters put in, left out, exchanged, or two
 * neighbours swapped, each counts one (Damerau's, in the form in which no part is changed twice).
 */
#ifndef CLI_GUESS_H
#define CLI_GUESS_H

#include <stddef.h>

struct cli_guess {
	const char *given;
	char best[64];
	unsigned distance; /* of best; 0: none */
};

unsigned cli_guess_distance(const char *a, const char *b); /* capped at 64 */
/* One that could be meant. Kept if it is near enough (a third of its letters) and nearer than those before. */
void cli_guess_offer(struct cli_guess *, const char *word);
/* The same for each of "a|b|c". */
void cli_guess_offer_choices(struct cli_guess *, const char *choices);
/* "did you mean X? " with prefix before X, or "". buf has room for 128 bytes; returns it. */
const char *cli_guess_text(const struct cli_guess *, const char *prefix, char *buf);

#endif
