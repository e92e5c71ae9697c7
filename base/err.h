/*
 * Errors: what a function returns and what a person reads.
 *
 * A function that can fail returns int: 0 is success, a negative number is -ERR_X (forwarded
 * unchanged, details in the struct err that the caller handed in), a positive number is a condition
 * documented by that function (ROOM_E_X), which the caller must handle and must not forward.
 * `struct err *err` is always the last parameter, never NULL. The first error wins: raising into an
 * err that is set already keeps the first.
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
	uint64_t need;        /* of a LIMIT: how much would do, in the unit of whoever raised it; 0 unknown */
	uint64_t offset;      /* byte offset (or line for text) in `file`; ERR_NO_OFFSET if unknown */
	char file[256];       /* the file it is about, "" if none */
	char field[64];       /* the field it is about, "" if none */
	char message[512];    /* one sentence: what is wrong */
	char hint[384];       /* one sentence: what to do, "" if nothing can be said */
	const char *src_file; /* where it was raised, for the debug log */
	int src_line;
};

#define ERR_INIT ((struct err){.offset = ERR_NO_OFFSET})

/* Raise: fills *err and returns -code. Truncates long texts safely. */
#define err_set(err, code, ...) err_raise((err), (code), 0, __FILE__, __LINE__, __VA_ARGS__)
/* Raise from errno: ENOSPC and EDQUOT become NOSPACE, ENOMEM NOMEM, EACCES and EPERM PERM, the rest
 * IO; the text of `sys` is appended to the message. */
#define err_sys(err, sys, ...) err_raise_sys((err), (sys), __FILE__, __LINE__, __VA_ARGS__)

int err_raise(struct err *err, enum err_code code, int sys, const char *src_file, int src_line, const char *fmt, ...)
	__attribute__((format(printf, 6, 7)));
int err_raise_sys(struct err *err, int sys, const char *src_file, int src_line, const char *fmt, ...)
	__attribute__((format(printf, 5, 6)));

/* Add what is known one floor up; each keeps a value that is already there. Return -err->code. */
int err_add_file(struct err *err, const char *file);
int err_add_place(struct err *err, uint64_t offset, const char *field);
int err_add_hint(struct err *err, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

void err_clear(struct err *err);
const char *err_wire_name(enum err_code code);
enum err_code err_from_wire_name(const char *name); /* unknown names: ERR_INTERNAL */
int err_exit_status(enum err_code code);
/* "FILE: byte N, FIELD: MESSAGE (HINT)" with the parts that are there. Returns buf. */
char *err_format(const struct err *err, char *buf, unsigned long size);

#endif
