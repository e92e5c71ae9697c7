/*
 * Counts the fields of a message before it is unpacked.
 *
 * The cost of unpacking grows with the number of fields, and 64 KiB can have thirty thousand; a request has some tens.
 * The packed bytes are walked, also in nested messages if the descriptors have them, until there is one field too many.
 * Malformed bytes end the walk; unpacking finds them again, after no more fields.
 */
#include "frame.h"

enum { DEPTH_MAX = 16, WIRE_VARINT = 0, WIRE_EIGHT = 1, WIRE_LENGTH = 2, WIRE_FOUR = 5 };

struct bytes {
	const uint8_t *at, *end;
};

/* False: it does not end, or not within 64 bits. */
static bool read_varint(struct bytes *b, uint64_t *ret)
{
	uint64_t value = 0;

	for (unsigned shift = 0; b->at < b->end && shift < 64; shift += 7) {
		uint8_t byte = *b->at++;

		value |= (uint64_t)(byte & 0x7f) << shift;
		if (!(byte & 0x80)) {
			*ret = value;
			return true;
		}
	}
	return false;
}

/* Reads the key, and the part of the value before its content; *ret_length: bytes of the content. False: malformed. */
static bool field_head(struct bytes *b, uint64_t *ret_key, uint64_t *ret_length)
{
	uint64_t value;

	*ret_length = 0;
	if (!read_varint(b, ret_key))
		return false;
	switch (*ret_key & 7) {
	case WIRE_VARINT:
		return read_varint(b, &value);
	case WIRE_EIGHT:
		*ret_length = 8;
		break;
	case WIRE_FOUR:
		*ret_length = 4;
		break;
	case WIRE_LENGTH:
		if (!read_varint(b, ret_length))
			return false;
		break;
	default:
		return false;
	}
	return *ret_length <= (uint64_t)(b->end - b->at);
}

/* Upper bound of the numbers in a packed list. */
static uint64_t packed_numbers(const ProtobufCFieldDescriptor *field, uint64_t bytes)
{
	switch (field->type) {
	case PROTOBUF_C_TYPE_STRING:
	case PROTOBUF_C_TYPE_BYTES:
	case PROTOBUF_C_TYPE_MESSAGE:
		return 0;
	case PROTOBUF_C_TYPE_DOUBLE:
	case PROTOBUF_C_TYPE_FIXED64:
	case PROTOBUF_C_TYPE_SFIXED64:
		return bytes / 8;
	default:
		return bytes;
	}
}

/* False: there are more than *left. */
static bool walk_fields(struct bytes b, const ProtobufCMessageDescriptor *what, unsigned depth, uint64_t *left)
{
	const ProtobufCFieldDescriptor *field;
	uint64_t key, length, n;

	while (b.at < b.end && field_head(&b, &key, &length)) {
		field = (key & 7) == WIRE_LENGTH && key >> 3 <= UINT32_MAX ?
				protobuf_c_message_descriptor_get_field(what, (unsigned)(key >> 3)) :
				NULL;
		n = 1 + (field ? packed_numbers(field, length) : 0);
		if (n > *left)
			return false;
		*left -= n;
		if (field && field->type == PROTOBUF_C_TYPE_MESSAGE && depth < DEPTH_MAX &&
		    !walk_fields((struct bytes){b.at, b.at + length}, field->descriptor, depth + 1, left))
			return false;
		b.at += length;
	}
	return true;
}

bool frame_message_fields(const void *bytes, size_t size, unsigned most)
{
	uint64_t left = most;

	return walk_fields((struct bytes){bytes, (const uint8_t *)bytes + size}, &acut__v1__message__descriptor, 0, &left);
}
