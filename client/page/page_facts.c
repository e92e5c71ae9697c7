/* Numbers of the facts of a page. */
#include "page.h"

void page_put_whole(FILE *f, const char *name, __int128 n, int zeros)
{
	unsigned __int128 rest = n < 0 ? -(unsigned __int128)n : (unsigned __int128)n;
	char digits[48];
	int at = sizeof(digits);

	do {
		digits[--at] = (char)('0' + (int)(rest % 10));
		rest /= 10;
	} while (rest);
	fprintf(f, "\"%s\":\"%s%.*s", name, n < 0 ? "-" : "", (int)sizeof(digits) - at, digits + at);
	for (; zeros > 0 && n; zeros--)
		fputc('0', f);
	fputs("\",", f);
}
