/* The packed image of a job: struct job without its zero bytes, which most of them are. Any thread. */
#ifndef HISTORY_IMAGE_H
#define HISTORY_IMAGE_H

#include "job_priv.h"

/* MAP: bytes of a bit for each word. SLACK: bytes behind the image that unpacking may read. */
enum {
	HISTORY_IMAGE_WORDS = (sizeof(struct job) + 7) / 8,
	HISTORY_IMAGE_MAP = (HISTORY_IMAGE_WORDS + 7) / 8,
	HISTORY_IMAGE_SLACK = 8,
	HISTORY_IMAGE_MAX = HISTORY_IMAGE_MAP + 9 * HISTORY_IMAGE_WORDS + HISTORY_IMAGE_SLACK
};

/* Returns the size, with the slack. */
size_t history_image_pack(const struct job *, uint8_t out[HISTORY_IMAGE_MAX]);
void history_image_unpack(const uint8_t *image, struct job *ret);

#endif
