/* The bytes of a file of lines (docs/formats/format.md, "Files of lines"). Internal. */
#ifndef BREAKLINE_FILE_H
#define BREAKLINE_FILE_H

#include <stddef.h>
#include <stdint.h>

#include "breakline.h"

#define BREAKLINE_MAGIC "ACUTLIN1"

enum { BREAKLINE_VERSION = 1, BREAKLINE_PAGE = 4096 };

struct breakline_head {
	uint64_t check; /* of the other bytes of the head, which has the size of a page */
	char magic[8];
	uint32_t version, page_bytes;
	uint64_t vertices, lines, features[BREAKLINE_KINDS];
	int32_t box[4];
	uint64_t content_hi, content_lo; /* hash of all vertices, in order */
	uint8_t rest[BREAKLINE_PAGE - 104];
};
_Static_assert(sizeof(struct breakline_head) == BREAKLINE_PAGE && offsetof(struct breakline_head, box) == 72 &&
		       offsetof(struct breakline_head, rest) == 104,
	       "format.md");

struct breakline_page {
	uint64_t check; /* of the other bytes of the page; seed: its place */
	uint32_t vertices, zero;
};
_Static_assert(sizeof(struct breakline_vertex) == 20 && offsetof(struct breakline_vertex, number) == 16, "format.md");

enum { BREAKLINE_PAGE_VERTICES = (BREAKLINE_PAGE - sizeof(struct breakline_page)) / sizeof(struct breakline_vertex) };
_Static_assert(BREAKLINE_PAGE_VERTICES == 204, "format.md");

#endif
