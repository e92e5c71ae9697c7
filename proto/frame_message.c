/*
 * Messages from untrusted bytes.
 *
 * A message and everything in it are in one arena. The message is the first thing in the arena's first chunk, so
 * frame_message_free finds the arena from the message. The arena does not grow beyond its cap (64 KiB of protobuf can
 * require megabytes: each empty element of a list is two bytes on the wire and a whole struct in memory), and is
 * charged to the ledger.
 *
 * A message with texts that are not UTF-8 is rejected, because the protobuf libraries of other languages reject
 * messages in which acutd would repeat such a text.
 */
#include "frame.h"

#include <stdalign.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "utf8.h"

/* CHUNK_MORE: for callers without a ledger, whose pages of lists take hundreds of KiB. */
enum { CHUNK_SIZE = 2048, CHUNK_MORE = 32 << 10, DEPTH_MAX = 16 };

struct chunk {
	struct chunk *next;
	size_t size, used; /* of bytes */
	alignas(16) uint8_t bytes[];
};

struct arena {
	size_t taken, cap; /* bytes, chunk headers included */
	struct ledger *ledger;
	bool over_cap, over_ledger;
	struct chunk *chunks; /* the newest first; the arena itself is in the oldest */
};

/* At the start of the first chunk. */
struct arena_start {
	struct arena arena;
	alignas(16) uint8_t message[];
};

static struct chunk *arena_chunk(struct arena *a, size_t size)
{
	size_t all = sizeof(struct chunk) + size;
	struct chunk *chunk;

	if (all > a->cap - a->taken) {
		a->over_cap = true;
		return NULL;
	}
	if (a->ledger && !ledger_take(a->ledger, LEDGER_MESSAGE, all)) {
		a->over_ledger = true;
		return NULL;
	}
	chunk = malloc(all);
	if (!chunk) {
		if (a->ledger)
			ledger_give(a->ledger, LEDGER_MESSAGE, all);
		a->over_ledger = true;
		return NULL;
	}
	a->taken += all;
	*chunk = (struct chunk){.next = a->chunks, .size = size};
	a->chunks = chunk;
	return chunk;
}

/* Size of the next chunk, which must have `size` bytes: more than that only if it fits the cap. */
static size_t chunk_size(const struct arena *a, size_t size)
{
	size_t more = !a->ledger && a->cap - a->taken > CHUNK_MORE + sizeof(struct chunk) ? CHUNK_MORE : CHUNK_SIZE;

	return size > more ? size : more;
}

static void *arena_alloc(void *ctx, size_t size)
{
	struct arena *a = ctx;
	struct chunk *chunk = a->chunks;
	void *at;

	if (size > SIZE_MAX - 15) {
		a->over_cap = true;
		return NULL;
	}
	size = (size + 15) & ~(size_t)15;
	if (!chunk || chunk->size - chunk->used < size) {
		struct chunk *newest = chunk;
		bool alone = newest && size > CHUNK_MORE / 8;

		chunk = arena_chunk(a, alone ? size : chunk_size(a, size));
		if (!chunk)
			return NULL;
		/* A large chunk wastes little; the newest one still has memory for small objects. */
		if (alone) {
			chunk->next = newest->next;
			newest->next = chunk;
			a->chunks = newest;
		}
	}
	at = chunk->bytes + chunk->used;
	chunk->used += size;
	return at;
}

static void arena_keep(void *ctx, void *pointer)
{
	/* Everything is freed at once, with the arena. */
}

static void arena_drop(struct arena *a)
{
	struct ledger *ledger = a->ledger;
	size_t taken = a->taken;

	for (struct chunk *chunk = a->chunks, *next; chunk; chunk = next) {
		next = chunk->next;
		free(chunk);
	}
	if (ledger && taken > 0)
		ledger_give(ledger, LEDGER_MESSAGE, taken);
}

/* ---- texts ---- */

/* Whether all n bytes are ASCII, as in nearly all texts: by eights or fours, of which the last may overlap. */
static bool text_plain(const char *text, size_t n)
{
	uint64_t all = 0, eight;

	if (n < 4) {
		for (size_t i = 0; i < n; i++)
			all |= (uint8_t)text[i];
		return all < 0x80;
	}
	if (n < 8) {
		uint32_t four[2];

		memcpy(&four[0], text, 4);
		memcpy(&four[1], text + n - 4, 4);
		return !((four[0] | four[1]) & UINT32_C(0x80808080));
	}
	for (size_t i = 0; i < n; i += 8) {
		memcpy(&eight, text + (n - i < 8 ? n - 8 : i), 8);
		all |= eight;
	}
	return !(all & UINT64_C(0x8080808080808080));
}

static bool text_valid(const char *text)
{
	const uint8_t *s = (const uint8_t *)text;

	if (text_plain(text, strlen(text)))
		return true;
	while (*s) {
		size_t n = *s < 0x80 ? 1 : utf8_length(s, SIZE_MAX);

		if (n == 0)
			return false;
		s += n;
	}
	return true;
}

char *frame_text_clean(char *text)
{
	uint8_t *s = (uint8_t *)text;

	while (*s) {
		size_t n = utf8_length(s, SIZE_MAX);

		if (n == 0)
			*s = '?';
		s += n > 0 ? n : 1;
	}
	return text;
}

static int check_texts(const ProtobufCMessage *message, unsigned depth, struct err *err);

static int check_text(const ProtobufCFieldDescriptor *field, const char *text, struct err *err)
{
	if (!text || !*text || text_valid(text))
		return 0;
	err_set(err, ERR_PROTO, "the text of a message's field is not UTF-8");
	return err_add_place(err, ERR_NO_OFFSET, field->name);
}

/* The field's value is there or not, or as many as a list has. */
static int check_field(const ProtobufCFieldDescriptor *field, const uint8_t *message, unsigned depth, struct err *err)
{
	void *const *at = (void *const *)(message + field->offset);
	size_t count = 1;
	int r = 0;

	if ((field->flags & PROTOBUF_C_FIELD_FLAG_ONEOF) && *(const uint32_t *)(message + field->quantifier_offset) != field->id)
		return 0;
	if (field->label == PROTOBUF_C_LABEL_REPEATED) {
		count = *(const size_t *)(message + field->quantifier_offset);
		at = *at;
	}
	for (size_t k = 0; k < count && r == 0; k++) {
		if (field->type == PROTOBUF_C_TYPE_STRING)
			r = check_text(field, at[k], err);
		else if (at[k])
			r = check_texts(at[k], depth + 1, err);
	}
	return r;
}

/* The most common field with a text: a single text, and ASCII. */
static bool text_ascii(const ProtobufCFieldDescriptor *field, const uint8_t *message)
{
	const char *text;

	if (field->type != PROTOBUF_C_TYPE_STRING || field->label == PROTOBUF_C_LABEL_REPEATED ||
	    field->flags & PROTOBUF_C_FIELD_FLAG_ONEOF)
		return false;
	text = *(char *const *)(message + field->offset);
	return text && (!*text || text_plain(text, strlen(text)));
}

/* Checks every text of the message and of nested messages. */
static int check_texts(const ProtobufCMessage *message, unsigned depth, struct err *err)
{
	const ProtobufCMessageDescriptor *what = message->descriptor;

	if (depth > DEPTH_MAX)
		return err_set(err, ERR_PROTO, "a message holds messages deeper than %d", DEPTH_MAX);
	for (unsigned i = 0; i < what->n_fields; i++) {
		const ProtobufCFieldDescriptor *field = &what->fields[i];
		int r;

		if (field->type != PROTOBUF_C_TYPE_STRING && field->type != PROTOBUF_C_TYPE_MESSAGE)
			continue;
		if (text_ascii(field, (const uint8_t *)message))
			continue;
		r = check_field(field, (const uint8_t *)message, depth, err);
		if (r < 0)
			return r;
	}
	return 0;
}

/* ---- unpacking ---- */

/* The allocator's first call is for the message itself, which is placed behind the arena. All other calls allocate from
 * the arena. */
struct first {
	struct arena_start *start;
	ProtobufCAllocator *allocator;
};

static void *first_alloc(void *ctx, size_t size)
{
	struct first *first = ctx;

	first->allocator->alloc = arena_alloc;
	first->allocator->allocator_data = &first->start->arena;
	return size <= sizeof(Acut__V1__Message) ? first->start->message : NULL;
}

static int unpack_error(const struct arena *a, size_t size, struct err *err)
{
	if (a->over_ledger) {
		err_set(err, ERR_BUSY, "there is no memory left for a message");
		return err_add_hint(err, "try again when other clients are done, or set a larger --memory");
	}
	if (a->over_cap)
		return err_set(err, ERR_PROTO, "a message of %zu bytes unpacks to more than %zu bytes", size, a->cap);
	return err_set(err, ERR_PROTO, "a message of %zu bytes is malformed", size);
}

int frame_message_unpack(const void *bytes, size_t size, size_t cap, struct ledger *ledger, Acut__V1__Message **ret,
			 struct err *err)
{
	struct arena a = {.cap = cap, .ledger = ledger};
	size_t lead = (sizeof(struct arena_start) + sizeof(Acut__V1__Message) + 15) & ~(size_t)15;
	struct chunk *chunk = arena_chunk(&a, lead + CHUNK_SIZE);
	struct first first;
	ProtobufCAllocator allocator = {.alloc = first_alloc, .free = arena_keep, .allocator_data = &first};
	Acut__V1__Message *message;
	int r;

	if (!chunk)
		return unpack_error(&a, size, err);
	chunk->used = lead;
	first = (struct first){(struct arena_start *)chunk->bytes, &allocator};
	first.start->arena = a;
	message = acut__v1__message__unpack(&allocator, size, bytes);
	if (!message) {
		r = unpack_error(&first.start->arena, size, err);
		a = first.start->arena;
		arena_drop(&a);
		return r;
	}
	r = check_texts(&message->base, 0, err);
	if (r < 0) {
		frame_message_free(message);
		return r;
	}
	*ret = message;
	return 0;
}

Acut__V1__Message *frame_message_free(Acut__V1__Message *message)
{
	if (message) {
		uint8_t *at = (uint8_t *)message - offsetof(struct arena_start, message);
		struct arena a = ((struct arena_start *)at)->arena;

		arena_drop(&a);
	}
	return NULL;
}

size_t frame_message_size(const Acut__V1__Message *message)
{
	return FRAME_HEADER_SIZE + acut__v1__message__get_packed_size(message);
}

/* ---- errors ---- */

static char *copy_text(char *to, size_t size, const char *from)
{
	size_t n = strnlen(from, size - 1);

	memcpy(to, from, n);
	to[n] = '\0';
	return frame_text_clean(to);
}

void frame_error_from_err(const struct err *err, struct frame_error *ret)
{
	acut__v1__error__init(&ret->body);
	ret->body.code = (char *)err_wire_name(err->code);
	ret->body.message = copy_text(ret->message, sizeof ret->message, err->message);
	ret->body.file = copy_text(ret->file, sizeof ret->file, err->file);
	ret->body.field = copy_text(ret->field, sizeof ret->field, err->field);
	ret->body.hint = copy_text(ret->hint, sizeof ret->hint, err->hint);
	ret->body.has_offset = err->offset != ERR_NO_OFFSET;
	ret->body.offset = ret->body.has_offset ? err->offset : 0;
}

int frame_error_to_err(const Acut__V1__Error *error, struct err *err)
{
	enum err_code code = err_from_wire_name(error->code);

	err_set(err, code == ERR_NONE ? ERR_INTERNAL : code, "%s",
		error->message[0] ? error->message : "the daemon gave no reason");
	if (error->file[0])
		err_add_file(err, error->file);
	err_add_place(err, error->has_offset ? error->offset : ERR_NO_OFFSET, error->field[0] ? error->field : NULL);
	if (error->hint[0])
		err_add_hint(err, "%s", error->hint);
	return -(int)err->code;
}
