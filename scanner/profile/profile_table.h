/* The keys of a profile: profile_table.c has the rows; profile_parse.c and profile_value.c use them. */
#ifndef PROFILE_TABLE_H
#define PROFILE_TABLE_H

#include "profile.h"

enum profile_type {
	PROFILE_TEXT,    /* UTF-8 without control characters; size: of the array */
	PROFILE_PATTERN, /* the same, for a serial number */
	PROFILE_NAME,    /* a-z 0-9 - _ */
	PROFILE_INT,     /* int; decimal or 0x.. */
	PROFILE_U8,
	PROFILE_U32,
	PROFILE_SIZE,   /* uint32_t; 16K */
	PROFILE_MS,     /* uint32_t milliseconds; written as seconds */
	PROFILE_REAL,   /* double */
	PROFILE_CHOICE, /* int-sized enum: `words` are its values in order */
	PROFILE_YES,    /* bool */
	PROFILE_FIELD,  /* struct profile_field */
	PROFILE_BYTES,  /* uint8_t[size] followed by its size_t */
	PROFILE_LENGTH, /* the length of a LENGTH telegram: three members */
	PROFILE_SEND,   /* a command; may be repeated */
	PROFILE_ANSWER, /* of the command before it */
};

struct profile_key {
	const char *section, *name;
	enum profile_type type;
	size_t offset, size;
	double least, most;
	const char *words; /* "a|b|c" */
};

const struct profile_key *profile_key_find(const char *section, const char *name);
const struct profile_key *profile_key_at(size_t i); /* NULL at the end */
/* The key of the section that was probably meant; or NULL. */
const char *profile_key_near(const char *section, const char *name);
bool profile_section_is(const char *name);

/* The value of a key; `text` is zero-terminated and has no quotes. false: *ret_wanted describes the valid values. */
enum { PROFILE_WANTED_SIZE = 160 };
bool profile_value_read(const struct profile_key *, const char *text, struct profile *to, char ret_wanted[PROFILE_WANTED_SIZE]);

/* Rules that concern several keys. */
int profile_check(const struct profile *, struct err *);

#endif
