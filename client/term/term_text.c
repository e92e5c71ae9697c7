/* Numbers and times as people read them. Times are UTC, in the one form that sorts. */
#include "term_text.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

char *term_count(uint64_t n, char buf[32])
{
	char digits[24];
	int len = snprintf(digits, sizeof(digits), "%llu", (unsigned long long)n), at = 0;

	for (int i = 0; i < len; i++) {
		if (i && (len - i) % 3 == 0)
			buf[at++] = ',';
		buf[at++] = digits[i];
	}
	buf[at] = 0;
	return buf;
}

char *term_time(int64_t us, char buf[32])
{
	static _Thread_local char day_text[32]; /* of the day before this one: lists have many times of a day */
	static _Thread_local int64_t day_kept;
	int64_t s = us / 1000000, day = s / 86400;
	time_t at = (time_t)s;
	unsigned rest = (unsigned)(s % 86400);
	struct tm tm;

	if (us <= 0)
		return strcpy(buf, "-");
	if (!*day_text || day != day_kept) {
		if (!gmtime_r(&at, &tm) || !strftime(day_text, sizeof(day_text), "%Y-%m-%dT", &tm))
			return *day_text = 0, strcpy(buf, "-");
		day_kept = day;
	}
	char *p = stpcpy(buf, day_text);
	const unsigned part[3] = {rest / 3600, rest / 60 % 60, rest % 60};

	for (int i = 0; i < 3; i++) {
		*p++ = (char)('0' + part[i] / 10);
		*p++ = (char)('0' + part[i] % 10);
		*p++ = "::Z"[i];
	}
	*p = 0;
	return buf;
}
