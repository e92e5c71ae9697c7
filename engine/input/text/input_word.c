/*
 * Words of a text line: what stands between its separators, be it a number or not.
 *
 * Model: one kind of separator a line: a semicolon, comma or tab where it has one, else blanks. Quotes hold what is
 * between them together. This is for looking at heads and at columns that are not read; the numbers of points are read by
 * input_line.c, which is strict.
 */
#include "input_text_parts.h"

#include <string.h>

static bool is_blank(char c)
{
	return c == ' ' || c == '\t';
}

char input_word_kind(struct input_line line)
{
	static const char kinds[] = ";,\t";

	for (const char *k = kinds; *k; k++)
		if (memchr(line.at, *k, (size_t)(line.end - line.at)))
			return *k;
	return ' ';
}

bool input_word_next(const char **at, const char *end, char kind, struct input_line *ret)
{
	const char *p = *at, *quote;

	while (p < end && is_blank(*p) && *p != kind)
		p++;
	while (kind == ' ' && p < end && is_blank(*p))
		p++;
	if (p >= end)
		return false;
	ret->at = p;
	if (*p == '"' && (quote = memchr(p + 1, '"', (size_t)(end - p - 1))))
		p = quote + 1;
	while (p < end && *p != kind && (kind != ' ' || *p != '\t'))
		p++;
	ret->end = p;
	while (ret->end > ret->at && is_blank(ret->end[-1]))
		ret->end--;
	*at = p < end ? p + 1 : p;
	return true;
}

bool input_word_trails(struct input_line line, char kind)
{
	while (line.end > line.at && is_blank(line.end[-1]) && line.end[-1] != kind)
		line.end--;
	return kind != ' ' && line.end > line.at && line.end[-1] == kind;
}

bool input_word_number(struct input_line word, struct input_number *ret)
{
	const char *p;

	if (word.end - word.at >= 2 && *word.at == '"' && word.end[-1] == '"') {
		word.at++;
		word.end--;
	}
	p = word.at;
	return input_number_read(&p, word.end, ret) == INPUT_NUMBER_OK && p == word.end;
}

struct input_words input_words_of(struct input_line line)
{
	const char *p = line.at;
	char kind = input_word_kind(line);
	struct input_words row = {.kind = kind};
	struct input_line word;
	struct input_number n;

	for (; input_word_next(&p, line.end, kind, &word); row.words++) {
		if (!input_word_number(word, &n))
			continue;
		row.leading += row.leading == row.words;
		if (row.words < INPUT_COLUMNS) {
			row.numbers |= (uint64_t)1 << row.words;
			row.whole |= (uint64_t)!n.written << row.words;
		}
	}
	row.words += input_word_trails(line, kind);
	return row;
}
