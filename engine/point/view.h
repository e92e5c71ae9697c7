/*
 * Views: which points a mesh is made of. They apply when reading, never when storing. Each rule looks
 * at one point, or at all points of one position, never at order.
 */
#ifndef VIEW_H
#define VIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "digest.h"
#include "point.h"

struct err;

enum view_returns { VIEW_RETURNS_ALL, VIEW_RETURNS_FIRST, VIEW_RETURNS_LAST };
enum view_duplicates { VIEW_LOWEST, VIEW_HIGHEST };

/* Rules in the order in which they apply; the one that removed a point is counted. */
enum view_rule {
	VIEW_KEPT,
	VIEW_BY_CLASS,
	VIEW_BY_NOISE,
	VIEW_BY_RETURNS,
	VIEW_BY_WITHHELD,
	VIEW_BY_DUPLICATE, /* another point of the same position was taken */
	VIEW_RULES
};

struct view {
	uint64_t classes[4];   /* bit set of the classes asked for; meaningful if has_classes */
	bool has_classes;
	bool ground;           /* classes 2, 8 and key-points of any class; lowest; fails if none */
	bool surface;          /* first returns, highest */
	bool keep_withheld, keep_noise;
	uint8_t returns;       /* enum view_returns */
	uint8_t duplicates;    /* enum view_duplicates */
};

#define VIEW_INIT ((struct view){ .returns = VIEW_RETURNS_ALL, .duplicates = VIEW_LOWEST })
#define VIEW_TEXT_SIZE 2048

/* The same view with --surface and --ground spelt out (surface: first returns, highest; ground: lowest). */
struct view view_normal(const struct view *);
/* -ERR_USAGE if what is asked for contradicts itself (ground and surface, surface of last returns ...). */
int view_check(const struct view *, struct err *err);

/* Canonical text of the normal view: the view's identity is its hash. view_parse accepts exactly what
 * view_text writes. */
char *view_text(const struct view *, char buf[VIEW_TEXT_SIZE]);
int view_parse(const char *text, struct view *ret, struct err *err);
struct digest view_hash(const struct view *);
/* "2,8" or "2-5,9": sets classes; -ERR_USAGE for rubbish. */
int view_set_classes(struct view *, const char *list, struct err *err);

/* The rule that removes this point, or VIEW_KEPT. Never VIEW_BY_DUPLICATE. Return number 0 (none known)
 * counts as a first return, and as a last one where the count is 0 or 1. */
enum view_rule view_judge(const struct view *, const struct point *);
/* Of two kept points of one position: true if a is the one to take rather than b. False for equals (the
 * source never decides). */
bool view_prefers(const struct view *, const struct point *a, const struct point *b);
const char *view_rule_text(enum view_rule);

#endif
