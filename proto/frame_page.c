/*
 * A page of a list, packed row by row: whoever makes a page of a hundred rows has one of them in memory, not all.
 *
 * The model: a list is a message with rows as its field 1 and "more follow" as its field 2; it is a field of Message.
 * What protobuf would write for it is written here.
 */
#include <string.h>

#include "frame.h"

enum { WIRE_VARINT = 0, WIRE_BYTES = 2, LENGTH_MOST = 3 }; /* LENGTH_MOST: bytes of a length within a frame */

static size_t varint_put(uint8_t *at, size_t v)
{
	size_t n = 0;

	for (; v >= 0x80; v >>= 7)
		at[n++] = (uint8_t)(v | 0x80);
	at[n++] = (uint8_t)v;
	return n;
}

bool frame_page_add(struct frame_page *page, const ProtobufCMessage *row)
{
	size_t size = protobuf_c_message_get_packed_size(row);

	if (size > sizeof page->rows || size + 1 + LENGTH_MOST > sizeof page->rows - page->n)
		return false;
	page->rows[page->n++] = 1 << 3 | WIRE_BYTES;
	page->n += varint_put(page->rows + page->n, size);
	page->n += protobuf_c_message_pack(row, page->rows + page->n);
	return true;
}

size_t frame_page_pack(const struct frame_page *page, Acut__V1__Message__BodyCase list, bool more, uint8_t *ret)
{
	size_t size = page->n + (more ? 2 : 0), n;

	n = varint_put(ret, (size_t)list << 3 | WIRE_BYTES);
	n += varint_put(ret + n, size);
	memcpy(ret + n, page->rows, page->n);
	n += page->n;
	if (more) {
		ret[n++] = 2 << 3 | WIRE_VARINT;
		ret[n++] = true;
	}
	return n;
}
