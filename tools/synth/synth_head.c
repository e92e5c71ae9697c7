/*
 * The header of a survey, saved in a file between two runs with the same options. A pipe cannot be rewound, so its
 * header requires generating all points first; with the header of an earlier run that is not necessary.
 *
 * The file is the header's bytes and then the options as text. If the options differ, nothing is written. The points
 * are checked against the header in any case (acut-synth.c).
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "synth.h"

/* Everything on which the points depend, exactly. */
static size_t options_text(const struct synth_options *o, char text[SYNTH_KEPT_MAX])
{
	int n = snprintf(text, SYNTH_KEPT_MAX,
			 "\nshape %d points %llu seed %llu density %a area %a %a scale %lld %d step %llu range %llu "
			 "format %u crs %d origin %lld %d %lld %d %lld %d\n",
			 (int)o->shape, (unsigned long long)o->points, (unsigned long long)o->seed, o->density, o->width,
			 o->height, (long long)o->scale.mantissa, o->scale.exponent, (unsigned long long)o->step,
			 (unsigned long long)o->range, o->format, !o->no_crs, (long long)o->origin[0].mantissa,
			 o->origin[0].exponent, (long long)o->origin[1].mantissa, o->origin[1].exponent,
			 (long long)o->origin[2].mantissa, o->origin[2].exponent);

	return n < SYNTH_KEPT_MAX ? (size_t)n : SYNTH_KEPT_MAX - 1;
}

static int failed(const char *what, const char *path, struct err *err)
{
	err_sys(err, errno, "cannot %s", what);
	return err_add_file(err, path);
}

int synth_head_load(const struct synth_options *o, const char *path, uint8_t *head, struct err *err)
{
	char text[SYNTH_KEPT_MAX];
	uint8_t bytes[2 * SYNTH_KEPT_MAX];
	size_t size = synth_las_head_size(o), more = options_text(o, text);
	int fd = open(path, O_RDONLY | O_CLOEXEC);

	if (fd < 0)
		return errno == ENOENT ? SYNTH_E_NONE : failed("open", path, err);
	ssize_t n = read(fd, bytes, sizeof bytes);

	close(fd);
	if (n < 0)
		return failed("read", path, err);
	if ((size_t)n != size + more || memcmp(bytes + size, text, more)) {
		err_set(err, ERR_INPUT, "is not the header of a survey with these options");
		err_add_file(err, path);
		return err_add_hint(err, "name another file for --head, or remove this one");
	}
	memcpy(head, bytes, size);
	return 0;
}

int synth_head_save(const struct synth_options *o, const char *path, const uint8_t *head, struct err *err)
{
	char part[4096], text[SYNTH_KEPT_MAX];
	size_t size = synth_las_head_size(o), more = options_text(o, text);

	if (snprintf(part, sizeof part, "%s.part", path) >= (int)sizeof part)
		return err_set(err, ERR_USAGE, "the name of the header's file is too long");
	int fd = open(part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);

	if (fd < 0)
		return failed("open", part, err);
	int rc = synth_write(fd, head, size, part, err);

	if (rc == 0)
		rc = synth_write(fd, text, more, part, err);
	if (close(fd) != 0 && rc == 0)
		rc = failed("write", part, err);
	if (rc == 0 && rename(part, path) != 0)
		rc = failed("rename to", path, err);
	if (rc)
		unlink(part);
	return rc;
}
