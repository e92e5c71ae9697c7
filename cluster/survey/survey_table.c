/*
 * The inputs of a run, as its head knows them.
 *
 * The model: an input has some hundred bytes. Coordinate systems and texts, which most files of a survey share, are kept once.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "survey_priv.h"
#include "utf8.h"

/* A file that is named twice counts once, as in a push. */
static int fill(struct survey_table *t, struct err *err)
{
	struct names paths = {0};
	int r = 0;

	t->input = calloc(t->nfiles + 1, sizeof *t->input);
	if (!t->input)
		return err_set(err, ERR_NOMEM, "no memory for %zu inputs", t->nfiles);
	for (size_t i = 0; !r && i < t->nfiles; i++) {
		size_t at = NAMES_START;
		uint32_t before;

		if (names_next(&paths, t->files[i].path, &at, &before))
			continue;
		r = names_put(&paths, t->files[i].path, (uint32_t)i, err);
		t->input[t->n].file = &t->files[i];
		t->input[t->n++].in.name = t->files[i].path;
	}
	names_free(&paths);
	return r;
}

int survey_table_read(struct survey_table *t, const struct work *w, struct err *err)
{
	int r = work_inputs(w, &t->files, &t->nfiles, err);

	t->first = ERR_INIT;
	if (!r && !t->nfiles)
		r = err_set(err, ERR_INPUT, "the run has no inputs");
	return r ? r : fill(t, err);
}

void survey_table_free(struct survey_table *t)
{
	for (size_t i = 0; i < t->nkept; i++) {
		free(t->kept[i]->bytes);
		free(t->kept[i]);
	}
	free(t->kept);
	names_free(&t->keys);
	free(t->input);
	free(t->files);
	*t = (struct survey_table){.n = 0};
}

const void *survey_keep(struct survey_table *t, const void *bytes, size_t size)
{
	struct survey_kept *k, **more;
	struct err ignored = ERR_INIT;
	size_t at = NAMES_START;
	char key[DIGEST_HEX_SIZE];
	uint32_t i;

	digest_hex(digest_hash(bytes, size), key);
	while (names_next(&t->keys, key, &at, &i))
		if (t->kept[i]->size == size && !memcmp(t->kept[i]->bytes, bytes, size))
			return t->kept[i]->bytes;
	more = realloc(t->kept, (t->nkept + 1) * sizeof *more);
	if (!more)
		return NULL;
	t->kept = more;
	k = calloc(1, sizeof *k);
	if (!k)
		return NULL;
	k->bytes = malloc(size);
	k->size = size;
	memcpy(k->key, key, sizeof key);
	if (!k->bytes || names_put(&t->keys, k->key, (uint32_t)t->nkept, &ignored)) {
		free(k->bytes);
		free(k);
		return NULL;
	}
	t->kept[t->nkept++] = k;
	return memcpy(k->bytes, bytes, size);
}

void survey_clean_text(const char *text, char *ret, size_t size)
{
	size_t n = 0, left = strlen(text);

	while (left) {
		size_t one = utf8_printable(text, left);

		if (n + (one ? one : 1) >= size)
			break;
		if (one)
			memcpy(ret + n, text, one);
		else
			ret[n] = '?';
		n += one ? one : 1;
		text += one ? one : 1;
		left -= one ? one : 1;
	}
	ret[n] = 0;
}
