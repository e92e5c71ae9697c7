/*
 * Errors: what a function returns, and what a person reads.
 *
 * A function that can fail returns int. 0 is success. A negative number is -ERR_X: the details are in the caller's
 * struct err, and it is forwarded unchanged. A positive number is a condition that this function documents (ROOM_E_X);
 * the caller must handle it and must not forward it. `struct err *err` is always the last parameter and never NULL.
 * Raising an error in an err that is already set keeps the first one.
 */
#ifndef ERR_H
#define ERR_H

#include <stdbool.h>
#include <stdint.h>

enum err_code {
	ERR_NONE = 0,
#define ERR(name, wire, status, text) ERR_##name,
#include "err.def"
#undef ERR
	ERR_COUNT
};

#define ERR_NO_OFFSET UINT64_MAX

struct err {
	enum err_code code;
	int sys;              /* errno, 0 if none */
	uint64_t need;        /* for LIMIT: how much would suffice, in the unit of whoever raised it; 0: unknown */
	uint64_t offset;      /* byte offset (or line for text) in `file`; ERR_NO_OFFSET if unknown */
	char file[256];       /* the file concerned, or "" */
	char field[64];       /* the field concerned, or "" */
	char message[512];    /* one sentence: what is wrong */
	char hint[384];       /* one sentence: what to do, or "" */
	const char *src_file; /* where it was raised, for the debug log */
	int src_line;
};

#define ERR_INIT ((struct err){.offset = ERR_NO_OFFSET})

/* Raises an error: fills *err and returns -code. Truncates long texts. */
#define err_set(err, code, ...) err_raise((err), (code), 0, __FILE__, __LINE__, __VA_ARGS__)
/* Raises an error from errno: ENOSPC and EDQUOT become NOSPACE, ENOMEM becomes NOMEM, EACCES and EPERM become PERM, all
 * others IO. Appends the text of `sys` to the message. */
#define err_sys(err, sys, ...) err_raise_sys((err), (sys), __FILE__, __LINE__, __VA_ARGS__)

int err_raise(struct err *err, enum err_code code, int sys, const char *src_file, int src_line, const char *fmt, ...)
	__attribute__((format(printf, 6, 7)));
int err_raise_sys(struct err *err, int sys, const char *src_file, int src_line, const char *fmt, ...)
	__attribute__((format(printf, 5, 6)));

/* Add what only the caller knows. A value that is already set stays. Return -err->code. */
int err_add_file(struct err *err, const char *file);
int err_add_place(struct err *err, uint64_t offset, const char *field);
int err_add_hint(struct err *err, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

void err_clear(struct err *err);
const char *err_wire_name(enum err_code code);
enum err_code err_from_wire_name(const char *name); /* unknown names: ERR_INTERNAL */
int err_exit_status(enum err_code code);
/* "FILE: byte N, FIELD: MESSAGE (HINT)", without the parts that are empty. Returns buf. */
char *err_format(const struct err *err, char *buf, unsigned long size);

#endif
