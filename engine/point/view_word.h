/* What the two texts of a view have in common (view_text.c, view_request.c): words, lists of classes, areas. */
#ifndef VIEW_WORD_H
#define VIEW_WORD_H

#include <stddef.h>

#include "view.h"

/* Part of a text; not ended by a zero byte. */
struct view_word {
	const char *at;
	size_t n;
};

bool view_word_is(struct view_word, const char *text);
/* Takes what stands before it off the word: "crop=" of "crop=box:1,2,3,4". */
bool view_word_after(struct view_word *, const char *before);
/* Takes up to the next `end`, or all; false if nothing is left. */
bool view_word_part(struct view_word *, char end, struct view_word *ret);
/* Whole numbers without a sign too many or a zero in front. */
bool view_word_i64(struct view_word, int64_t *ret);
/* "2-5,9" into a bit set. */
bool view_word_classes(struct view_word, uint64_t classes[4]);

/* The words without numbers of the lattice, alike in both texts. */
bool view_word_plain(struct view *, struct view_word);

/* The rings of an area: '+' begins a polygon, '-' a hole; then x and y of each corner as steps from the one
 * before, over rings too, in the code of area_code.h. `corner` gets each as it was meant; non-zero ends it. */
struct view_rings {
	int (*ring)(void *ctx, bool shell);
	int (*corner)(void *ctx, __int128 x, __int128 y);
	void *ctx;
};
/* 0, what a call gave, or 1: not the text of an area. */
int view_word_rings(struct view_word, const struct view_rings *);

size_t view_text_size(const struct view *); /* of the canonical text, its end not counted */

/* Fits words of one view together as they are read: no word twice. */
struct view_seen {
	unsigned words;
};
bool view_word_new(struct view_seen *, struct view_word);

#endif
