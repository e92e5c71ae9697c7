/* The bound that holds is a multiple of the step of the heights; one that is not was rounded down, which is worth a word. */
#include <stdio.h>
#include <string.h>

#include "ctl_fetch.h"
#include "decimal.h"

/* Word n of a text with spaces between. False: there is none, or it is no decimal. */
static bool decimal_word(const char *text, unsigned n, struct decimal *ret)
{
	char word[DECIMAL_TEXT_SIZE];
	size_t length;

	for (;; n--) {
		text += strspn(text, " ");
		length = strcspn(text, " ");
		if (!length || length >= sizeof(word))
			return false;
		if (!n)
			break;
		text += length;
	}
	memcpy(word, text, length);
	word[length] = 0;
	return decimal_parse(word, ret);
}

/* "0.1", "0.3ft": the number, and what one of its unit is in `unit`. */
static bool length_of(const char *text, const char *unit, struct decimal *ret, int64_t *up, int64_t *down)
{
	size_t n = strlen(text), digits = n;
	char number[DECIMAL_TEXT_SIZE];

	while (digits && strchr("mftUS", text[digits - 1]))
		digits--;
	*up = *down = 1;
	if (digits >= sizeof(number) ||
	    (digits < n && !format_unit_ratio(format_unit_of_word(text + digits, n - digits), unit, up, down)))
		return false;
	memcpy(number, text, digits);
	number[digits] = 0;
	return decimal_parse(number, ret);
}

const char *ctl_fetch_bound(const struct acut_job *job, const char *asked, char buf[CTL_MESH_NOTE])
{
	struct decimal step, length;
	char text[DECIMAL_TEXT_SIZE], of[DECIMAL_TEXT_SIZE];
	int64_t up, down, n, more;

	*buf = 0;
	if (!asked || !job->lattice || !decimal_word(job->lattice, 1, &step) ||
	    !length_of(asked, job->unit_z, &length, &up, &down))
		return buf;
	/* Rounded up it is the same if nothing was rounded. */
	if (!decimal_steps_down(length.mantissa, length.exponent, up, down, step, &n) ||
	    !decimal_steps_down(-(__int128)length.mantissa, length.exponent, up, down, step, &more) || n == -more)
		return buf;
	snprintf(buf, CTL_MESH_NOTE, "--max-error %.60s is rounded down to %s, a multiple of the step of the heights (%s)", asked,
		 decimal_scaled_text(step, n, text), decimal_text(step, of));
	return buf;
}
