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
/* "9": the number of a class. */
bool view_word_class(struct view_word, unsigned *ret);
/* "1-3+7": calls slots_list_add for each range. 0; 1: it is no list of sources; -ERR_NOMEM, without a message. */
int view_word_sources(struct view_word, int32_t radius, struct slots_list *);

/* The rows of base/view_option.def, in the order of the canonical text. */
enum view_word_id {
#define VIEW_FLAG(field, ...) VIEW_WORD_##field,
#define VIEW_COUNT(field, ...) VIEW_WORD_##field,
#define VIEW_HEIGHT(field, ...) VIEW_WORD_##field,
#define VIEW_OWN(field, ...) VIEW_WORD_##field,
#include "view_option.def"
	VIEW_WORDS
};
struct view_word_row {
	const char *word; /* "=" ends it if it has a value */
	enum { VIEW_KIND_FLAG, VIEW_KIND_COUNT, VIEW_KIND_HEIGHT, VIEW_KIND_OWN } kind;
	size_t at, has; /* places of the field, and of has_FIELD of a height */
};
extern const struct view_word_row view_word_rows[VIEW_WORDS];
static inline bool *view_word_flag(struct view *v, size_t at)
{
	return (bool *)((char *)v + at);
}
static inline int64_t *view_word_height(struct view *v, const struct view_word_row *row)
{
	return (int64_t *)((char *)v + row->at);
}
static inline uint64_t *view_word_count(struct view *v, const struct view_word_row *row)
{
	return (uint64_t *)((char *)v + row->at);
}

/* Words of one view, as they are read: removes the word, so that its value is left. VIEW_WORDS: it is no word, or was read
 * before. */
struct view_seen {
	unsigned words;
};
enum view_word_id view_word_next(struct view_seen *, struct view_word *);
/* The value of a word that has no lattice numbers, equal in both texts. False for any other word, and for a wrong value. */
bool view_word_plain(struct view *, enum view_word_id, struct view_word value);

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

#endif
