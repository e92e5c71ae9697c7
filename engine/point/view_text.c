/*
 * A view as its canonical text and back (view.h): "view 1", then the words of what differs from taking all
 * but noise and withheld points, in one fixed order. Parsing reads the words and then demands that the text
 * written for the result is the text read, so there is one text for each view.
 */
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "view.h"

static bool class_bit(const uint64_t classes[4], unsigned cls)
{
	return classes[cls >> 6] >> (cls & 63) & 1;
}

/* "2-5,9": at most 256 numbers of four bytes each. */
static size_t classes_text(const uint64_t classes[4], char *buf, size_t size)
{
	size_t n = 0;

	for (unsigned c = 0; c < 256; c++) {
		unsigned last = c;

		if (!class_bit(classes, c))
			continue;
		while (last < 255 && class_bit(classes, last + 1))
			last++;
		n += (size_t)snprintf(buf + n, size - n, last > c ? "%s%u-%u" : "%s%u", n ? "," : "", c,
				      last);
		c = last;
	}
	return n;
}

char *view_text(const struct view *view, char buf[VIEW_TEXT_SIZE])
{
	struct view v = view_normal(view);
	size_t n = (size_t)snprintf(buf, VIEW_TEXT_SIZE, "view 1");

	if (v.has_classes) {
		n += (size_t)snprintf(buf + n, VIEW_TEXT_SIZE - n, " class=");
		n += classes_text(v.classes, buf + n, VIEW_TEXT_SIZE - n);
	}
	snprintf(buf + n, VIEW_TEXT_SIZE - n, "%s%s%s%s%s", v.ground ? " ground" : "",
		 v.returns == VIEW_RETURNS_FIRST  ? " returns=first"
		 : v.returns == VIEW_RETURNS_LAST ? " returns=last"
						  : "",
		 v.keep_withheld ? " keep-withheld" : "", v.keep_noise ? " keep-noise" : "",
		 v.duplicates == VIEW_HIGHEST ? " duplicates=highest" : "");
	return buf;
}

/* A class number at *text; what follows it, or NULL. */
static const char *take_class(const char *text, unsigned *ret)
{
	unsigned v = 0;
	const char *t = text;

	for (; *t >= '0' && *t <= '9' && v < 256; t++)
		v = v * 10 + (unsigned)(*t - '0');
	if (t == text || v > 255)
		return NULL;
	*ret = v;
	return t;
}

/* Classes at *text up to `end`; false for rubbish. */
static bool take_classes(const char *text, const char *end, uint64_t classes[4])
{
	memset(classes, 0, 4 * sizeof *classes);
	for (;;) {
		unsigned first, last;

		text = take_class(text, &first);
		if (!text)
			return false;
		last = first;
		if (*text == '-') {
			text = take_class(text + 1, &last);
			if (!text || last < first)
				return false;
		}
		for (unsigned c = first; c <= last; c++)
			classes[c >> 6] |= UINT64_C(1) << (c & 63);
		if (text == end)
			return true;
		if (*text++ != ',')
			return false;
	}
}

int view_set_classes(struct view *view, const char *list, struct err *err)
{
	uint64_t classes[4];

	if (!take_classes(list, list + strlen(list), classes)) {
		err_set(err, ERR_USAGE, "\"%s\" is not a list of classes", list);
		return err_add_hint(err, "give numbers from 0 to 255, as in 2,8 or 2-5,9");
	}
	memcpy(view->classes, classes, sizeof classes);
	view->has_classes = true;
	return 0;
}

static bool word_is(const char *word, size_t n, const char *text)
{
	return n == strlen(text) && memcmp(word, text, n) == 0;
}

static bool take_word(struct view *v, const char *word, size_t n)
{
	if (n > 6 && memcmp(word, "class=", 6) == 0) {
		v->has_classes = true;
		return take_classes(word + 6, word + n, v->classes);
	}
	if (word_is(word, n, "ground"))
		v->ground = true;
	else if (word_is(word, n, "returns=first"))
		v->returns = VIEW_RETURNS_FIRST;
	else if (word_is(word, n, "returns=last"))
		v->returns = VIEW_RETURNS_LAST;
	else if (word_is(word, n, "keep-withheld"))
		v->keep_withheld = true;
	else if (word_is(word, n, "keep-noise"))
		v->keep_noise = true;
	else if (word_is(word, n, "duplicates=highest"))
		v->duplicates = VIEW_HIGHEST;
	else
		return false;
	return true;
}

int view_parse(const char *text, struct view *ret, struct err *err)
{
	static const char head[] = "view 1";
	struct view v = VIEW_INIT;
	char again[VIEW_TEXT_SIZE];
	bool good = strncmp(text, head, sizeof head - 1) == 0;
	const char *t = text + (good ? sizeof head - 1 : 0);

	while (good && *t == ' ') {
		size_t n = strcspn(++t, " ");

		good = take_word(&v, t, n);
		t += n;
	}
	if (!good || *t || strcmp(view_text(&v, again), text) != 0)
		return err_set(err, ERR_PROTO, "\"%.200s\" is not the text of a view of this version", text);
	*ret = v;
	return 0;
}

struct digest view_hash(const struct view *view)
{
	char text[VIEW_TEXT_SIZE];

	view_text(view, text);
	return digest_hash(text, strlen(text));
}
