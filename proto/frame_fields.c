/*
 * How many fields a message has, before anything is made of it.
 *
 * The model: what unpacking costs goes by fields, and 64 KiB can have thirty thousand of them; a request has some tens. The
 * bytes are walked as they lie there, into messages inside messages where the descriptors say that there are some, and no
 * further than to one field too many. What is malformed ends the walk: unpacking finds it again, after no more fields.
 */
#include "frame.h"

enum { DEPTH_MAX = 16, WIRE_VARINT = 0, WIRE_EIGHT = 1, WIRE_LENGTH = 2, WIRE_FOUR = 5 };

struct bytes {
	const uint8_t *at, *end;
};

/* False: it does not end, or not within 64 bits. */
static bool varint(struct bytes *b, uint64_t *ret)
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

/* Its key and what of its value is no content; *ret_length: of that. False: malformed. */
static bool field_head(struct bytes *b, uint64_t *ret_key, uint64_t *ret_length)
{
	uint64_t value;

	*ret_length = 0;
	if (!varint(b, ret_key))
		return false;
	switch (*ret_key & 7) {
	case WIRE_VARINT:
		return varint(b, &value);
	case WIRE_EIGHT:
		*ret_length = 8;
		break;
	case WIRE_FOUR:
		*ret_length = 4;
		break;
	case WIRE_LENGTH:
		if (!varint(b, ret_length))
			return false;
		break;
	default:
		return false;
	}
	return *ret_length <= (uint64_t)(b->end - b->at);
}

/* Numbers of a list that lie there as one field; at least so many as that. */
static uint64_t packed(const ProtobufCFieldDescriptor *field, uint64_t bytes)
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
static bool walk(struct bytes b, const ProtobufCMessageDescriptor *what, unsigned depth, uint64_t *left)
{
	const ProtobufCFieldDescriptor *field;
	uint64_t key, length, n;

	while (b.at < b.end && field_head(&b, &key, &length)) {
		field = (key & 7) == WIRE_LENGTH && key >> 3 <= UINT32_MAX ?
				protobuf_c_message_descriptor_get_field(what, (unsigned)(key >> 3)) :
				NULL;
		n = 1 + (field ? packed(field, length) : 0);
		if (n > *left)
			return false;
		*left -= n;
		if (field && field->type == PROTOBUF_C_TYPE_MESSAGE && depth < DEPTH_MAX &&
		    !walk((struct bytes){b.at, b.at + length}, field->descriptor, depth + 1, left))
			return false;
		b.at += length;
	}
	return true;
}

bool frame_message_fields(const void *bytes, size_t size, unsigned most)
{
	uint64_t left = most;

	return walk((struct bytes){bytes, (const uint8_t *)bytes + size}, &acut__v1__message__descriptor, 0, &left);
}
