/* What the two texts of a view have in common (view_text.c, view_request.c): words, lists of classes, areas. */
#ifndef VIEW_WORD_H
#define VIEW_WORD_H

#include <stddef.h>

#include "view.h"

/* Part of a text, without a terminating zero. */
struct view_word {
	const char *at;
	size_t n;
};

bool view_word_is(struct view_word, const char *text);
/* Removes a prefix of the word: "crop=" of "crop=box:1,2,3,4". False if it does not begin with it. */
bool view_word_after(struct view_word *, const char *before);
/* Returns the part up to the next `end`, or the rest; false if nothing is left. */
bool view_word_part(struct view_word *, char end, struct view_word *ret);
/* Whole numbers in their only spelling: no redundant sign, no leading zero. */
bool view_word_i64(struct view_word, int64_t *ret);
/* "2-5,9" into a bit set. */
bool view_word_classes(struct view_word, uint64_t classes[4]);

/* Words without lattice numbers, equal in both texts. */
bool view_word_plain(struct view *, struct view_word);

/* The rings of an area: '+' begins a polygon, '-' a hole; then x and y of each corner as differences to the previous
 * corner, across rings, in the code of area_code.h. `corner` gets the absolute numbers; non-zero ends it. */
struct view_rings {
	int (*ring)(void *ctx, bool shell);
	int (*corner)(void *ctx, __int128 x, __int128 y);
	void *ctx;
};
/* 0, the result of a callback, or 1: not the text of an area. */
int view_word_rings(struct view_word, const struct view_rings *);

size_t view_text_size(const struct view *); /* of the canonical text, without the terminating zero */

/* Combines words of one view as they are read: no word twice. */
struct view_seen {
	unsigned words;
};
bool view_word_new(struct view_seen *, struct view_word);

#endif
