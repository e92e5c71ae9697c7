/* A mesh in a web page: the text of the page, and what of a mesh is in it, as lines of base64 (docs/design/page.md). */
#ifndef PAGE_H
#define PAGE_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

struct acut_mesh_block;
struct err;
struct outfile;

#define PAGE_TRIANGLES 2000000u /* most of a page; of vertices, too */

/* The page, in the order of these: each ends where something of the mesh goes in. */
enum page_text {
	PAGE_UP_TO_SOURCES, /* of scripts beside the page's own */
	PAGE_UP_TO_TITLE,
	PAGE_UP_TO_VERTICES,
	PAGE_UP_TO_FACES,
	PAGE_UP_TO_FACTS,
	PAGE_UP_TO_END,
	PAGE_TEXTS,
};
extern const char *const page_text[PAGE_TEXTS];
int page_put(struct outfile *, enum page_text, struct err *err);

/* A member of JSON and its comma: a whole number of any size, as text, with zeros behind it. */
void page_put_whole(FILE *, const char *name, __int128 n, int zeros);

struct page_pack;
int page_pack_new(struct page_pack **ret, struct err *err);
struct page_pack *page_pack_free(struct page_pack *);
/* Lines for n vertices. */
int page_pack_vertices(struct page_pack *, struct outfile *, const int32_t (*vertex)[3], size_t n, struct err *err);
/* Lines for the triangles of a block, whose numbers are below 2^32. `domain` tells domains apart. */
int page_pack_faces(struct page_pack *, struct outfile *, const struct acut_mesh_block *, uint32_t domain, struct err *err);
/* A line of n numbers, at most PAGE_NUMBERS. */
#define PAGE_NUMBERS (3u << 16)
int page_pack_numbers(struct page_pack *, struct outfile *, const uint64_t *, size_t n, struct err *err);

#endif
