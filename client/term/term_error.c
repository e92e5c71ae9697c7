/* An error names the file, the place in it, the problem, and what to do. */
#include <stdio.h>
#include <string.h>

#include "term.h"
#include "term_error.h"

void term_error_json(struct term_json *j, const char *key, const struct err *err)
{
	if (!err->code) {
		term_json_put_null(j, key, TERM_JSON_UNKNOWN);
		return;
	}
	term_json_open(j, key, '{');
	term_json_text(j, "code", err_wire_name(err->code));
	term_json_text(j, "file", err->file[0] ? err->file : NULL);
	if (err->offset == ERR_NO_OFFSET)
		term_json_text(j, "offset", NULL);
	else
		term_json_u64(j, "offset", err->offset);
	term_json_text(j, "field", err->field[0] ? err->field : NULL);
	term_json_text(j, "message", err->message);
	term_json_text(j, "hint", err->hint[0] ? err->hint : NULL);
	term_json_close(j, '}');
}

/* The place is left out where the message names the line, or the push, itself. */
void term_error_text(const char *program, const struct err *err)
{
	bool named = !strcmp(err->field, "line") || !strcmp(err->field, "push"), place = err->offset != ERR_NO_OFFSET && !named;
	char at[64] = "";

	if (place)
		snprintf(at, sizeof(at), "byte %llu%s", (unsigned long long)err->offset, err->field[0] ? ", " : ": ");
	term_line(stderr, "%s: %s%s%s%s%s%s", program, err->file, err->file[0] ? ": " : "", at, named ? "" : err->field,
		  err->field[0] && !named ? ": " : "", err->message[0] ? err->message : err_wire_name(err->code));
	if (err->hint[0])
		term_line(stderr, "hint: %s", err->hint);
}
