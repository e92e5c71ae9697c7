/*
 * A page of a list, packed row by row, so that only one row at a time is in memory as a message.
 *
 * A list is a message with rows as its field 1 and "more follow" as its field 2; it is a field of Message. This file
 * writes what protobuf would write for it. Texts that all rows share are fields of the list, and come before the rows.
 *
 * A row is packed from its last byte to its first, into the free part of the page: the length of a nested message is
 * then known when it is needed, so each field is visited only once and not also for its size. Ten thousand jobs have
 * three quarters of a million fields. Rows with kinds of fields that lists have not had so far are packed by the
 * library.
 */
#include <string.h>

#include "frame.h"

/* LENGTH_MOST: the most bytes of a length within a frame */
enum { WIRE_VARINT = 0, WIRE_EIGHT = 1, WIRE_BYTES = 2, LENGTH_MOST = 3 };

static size_t varint_put(uint8_t *at, uint64_t v)
{
	size_t n = 0;

	for (; v >= 0x80; v >>= 7)
		at[n++] = (uint8_t)(v | 0x80);
	at[n++] = (uint8_t)v;
	return n;
}

/* ---- a row, backwards ---- */

struct packing {
	uint8_t *least, *at; /* start of the free part; start of the row so far */
	bool full, strange;  /* it does not fit; it has a field that cannot be written here */
};

static uint8_t *reserve(struct packing *p, size_t n)
{
	if ((size_t)(p->at - p->least) < n) {
		p->full = true;
		return NULL;
	}
	return p->at -= n;
}

static void put_varint(struct packing *p, uint64_t v)
{
	uint8_t *to;
	size_t n = 1;

	for (uint64_t rest = v >> 7; rest; rest >>= 7)
		n++;
	to = reserve(p, n);
	if (to)
		varint_put(to, v);
}

static void put_key(struct packing *p, const ProtobufCFieldDescriptor *field, unsigned wire)
{
	put_varint(p, (uint64_t)field->id << 3 | wire);
}

static void put_text(struct packing *p, const ProtobufCFieldDescriptor *field, const char *text)
{
	size_t n = strlen(text);
	uint8_t *to = reserve(p, n);

	if (!to)
		return;
	memcpy(to, text, n);
	put_varint(p, n);
	put_key(p, field, WIRE_BYTES);
}

static void put_message(struct packing *p, const ProtobufCMessage *m);

static void put_inside(struct packing *p, const ProtobufCFieldDescriptor *field, const ProtobufCMessage *m)
{
	const uint8_t *end = p->at;

	put_message(p, m);
	put_varint(p, (size_t)(end - p->at));
	put_key(p, field, WIRE_BYTES);
}

/* The value as in a varint; false: not such a number. */
static bool number_of(const ProtobufCFieldDescriptor *field, const void *at, uint64_t *ret)
{
	switch (field->type) {
	case PROTOBUF_C_TYPE_UINT32:
		*ret = *(const uint32_t *)at;
		return true;
	case PROTOBUF_C_TYPE_INT32:
		*ret = (uint64_t)(int64_t) * (const int32_t *)at;
		return true;
	case PROTOBUF_C_TYPE_UINT64:
	case PROTOBUF_C_TYPE_INT64:
		*ret = *(const uint64_t *)at;
		return true;
	case PROTOBUF_C_TYPE_BOOL:
		*ret = *(const protobuf_c_boolean *)at != 0;
		return true;
	default:
		return false;
	}
}

static void put_double(struct packing *p, const void *at)
{
	uint8_t *to = reserve(p, 8);

	if (to)
		memcpy(to, at, 8); /* little-endian, as in memory (asserted in digest.c) */
}

/* A field that is there or not: messages and texts if not NULL; a number if `has`, or without it if not zero. */
static void put_one(struct packing *p, const ProtobufCFieldDescriptor *field, const void *at, const protobuf_c_boolean *has)
{
	uint64_t n;

	if (field->type == PROTOBUF_C_TYPE_MESSAGE) {
		if (*(const ProtobufCMessage *const *)at)
			put_inside(p, field, *(const ProtobufCMessage *const *)at);
	} else if (field->type == PROTOBUF_C_TYPE_STRING) {
		if (!has && *(const char *const *)at && **(const char *const *)at)
			put_text(p, field, *(const char *const *)at);
		p->strange |= has != NULL;
	} else if (field->type == PROTOBUF_C_TYPE_DOUBLE) {
		if (has ? !*has : *(const double *)at == 0)
			return;
		put_double(p, at);
		put_key(p, field, WIRE_EIGHT);
	} else if (number_of(field, at, &n)) {
		if (has ? !*has : !n)
			return;
		put_varint(p, n);
		put_key(p, field, WIRE_VARINT);
	} else {
		p->strange = true;
	}
}

static void put_list(struct packing *p, const ProtobufCFieldDescriptor *field, const void *list, size_t n)
{
	const uint8_t *end = p->at;

	if (field->type == PROTOBUF_C_TYPE_MESSAGE) {
		for (size_t i = n; i-- > 0 && !p->full;)
			put_inside(p, field, ((ProtobufCMessage *const *)list)[i]);
	} else if (field->type == PROTOBUF_C_TYPE_STRING) {
		for (size_t i = n; i-- > 0 && !p->full;)
			put_text(p, field, ((char *const *)list)[i]);
	} else if (field->type == PROTOBUF_C_TYPE_UINT64 && field->flags & PROTOBUF_C_FIELD_FLAG_PACKED) {
		for (size_t i = n; i-- > 0 && !p->full;)
			put_varint(p, ((const uint64_t *)list)[i]);
		put_varint(p, (size_t)(end - p->at));
		put_key(p, field, WIRE_BYTES);
	} else if (field->type == PROTOBUF_C_TYPE_DOUBLE && field->flags & PROTOBUF_C_FIELD_FLAG_PACKED) {
		for (size_t i = n; i-- > 0 && !p->full;)
			put_double(p, (const double *)list + i);
		put_varint(p, (size_t)(end - p->at));
		put_key(p, field, WIRE_BYTES);
	} else {
		p->strange = true;
	}
}

static void put_message(struct packing *p, const ProtobufCMessage *m)
{
	const ProtobufCMessageDescriptor *what = m->descriptor;

	p->strange |= m->n_unknown_fields != 0;
	for (unsigned i = what->n_fields; i-- > 0 && !p->full && !p->strange;) {
		const ProtobufCFieldDescriptor *field = &what->fields[i];
		const uint8_t *at = (const uint8_t *)m + field->offset;

		if (field->flags & PROTOBUF_C_FIELD_FLAG_ONEOF || field->label == PROTOBUF_C_LABEL_REQUIRED) {
			p->strange = true;
		} else if (field->label == PROTOBUF_C_LABEL_REPEATED) {
			size_t n = *(const size_t *)((const uint8_t *)m + field->quantifier_offset);

			if (n)
				put_list(p, field, *(const void *const *)at, n);
		} else {
			put_one(p, field, at,
				field->label == PROTOBUF_C_LABEL_OPTIONAL && field->type != PROTOBUF_C_TYPE_MESSAGE ?
					(const void *)((const uint8_t *)m + field->quantifier_offset) :
					NULL);
		}
	}
}

/* ---- the page ---- */

bool frame_page_add(struct frame_page *page, const ProtobufCMessage *row)
{
	uint8_t *const end = page->rows + sizeof page->rows, *to = page->rows + page->n;
	size_t size, lead = 1 + LENGTH_MOST;
	struct packing p = {.at = end};

	if ((size_t)(end - to) < lead)
		return false;
	p.least = to + lead;
	put_message(&p, row);
	size = p.strange ? protobuf_c_message_get_packed_size(row) : (size_t)(end - p.at);
	if (p.strange ? size > (size_t)(end - to) - lead : p.full)
		return false;
	*to++ = 1 << 3 | WIRE_BYTES;
	to += varint_put(to, size);
	if (p.strange)
		protobuf_c_message_pack(row, to);
	else
		memmove(to, p.at, size);
	page->n = (size_t)(to - page->rows) + size;
	return true;
}

bool frame_page_text(struct frame_page *page, unsigned field, const char *text)
{
	uint8_t *to = page->rows + page->n;
	size_t size = strlen(text), key = (size_t)field << 3 | WIRE_BYTES;

	if (size > sizeof page->rows || sizeof page->rows - page->n < size + 2 * LENGTH_MOST)
		return false;
	to += varint_put(to, key);
	to += varint_put(to, size);
	memcpy(to, text, size);
	page->n = (size_t)(to - page->rows) + size;
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
