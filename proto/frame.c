/*
 * The 16-byte header of a frame: writing and checking. Pure functions.
 */
#include "frame.h"

#include "cursor.h"
#include "err.h"

void frame_header_put(const struct frame_header *header, uint8_t bytes[FRAME_HEADER_SIZE])
{
	struct packer p = packer_of(bytes, FRAME_HEADER_SIZE);

	packer_u16(&p, FRAME_MAGIC);
	packer_u16(&p, FRAME_VERSION);
	packer_u32(&p, header->length);
	packer_u32(&p, header->request_id);
	packer_u8(&p, header->descriptors);
	packer_zero(&p, 3);
}

int frame_header_get(const uint8_t bytes[FRAME_HEADER_SIZE], struct frame_header *ret, struct err *err)
{
	struct cursor c = cursor_of(bytes, FRAME_HEADER_SIZE);
	unsigned magic = cursor_u16(&c);
	unsigned version = cursor_u16(&c);
	struct frame_header header = {
		.length = cursor_u32(&c),
		.request_id = cursor_u32(&c),
		.descriptors = cursor_u8(&c),
	};
	unsigned padding = cursor_u8(&c) | (unsigned)cursor_u16(&c) << 8;

	if (magic != FRAME_MAGIC) {
		err_set(err, ERR_PROTO, "what was received is no frame: it starts with 0x%04x, not 0x%04x", magic, FRAME_MAGIC);
		return err_add_place(err, 0, "magic");
	}
	if (version != FRAME_VERSION) {
		err_set(err, ERR_VERSION, "a frame of version %u was received; this build knows version %u", version,
			FRAME_VERSION);
		err_add_place(err, 2, "version");
		return err_add_hint(err, "use acutctl and acutd of the same release");
	}
	if (header.length > FRAME_BODY_MAX) {
		err_set(err, ERR_PROTO, "a frame announces a message of %u bytes; at most %u are allowed", header.length,
			FRAME_BODY_MAX);
		return err_add_place(err, 4, "length");
	}
	if (header.descriptors > 1) {
		err_set(err, ERR_PROTO, "a frame announces %u descriptors; at most 1 is allowed", header.descriptors);
		return err_add_place(err, 12, "descriptors");
	}
	if (padding != 0) {
		err_set(err, ERR_PROTO, "the padding of a frame's header is 0x%06x, not zero", padding);
		return err_add_place(err, 13, "padding");
	}
	*ret = header;
	return 0;
}
