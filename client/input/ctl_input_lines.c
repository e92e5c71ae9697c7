/*
 * Files of lines as inputs. The daemon reads one format of lines; the others are read here and become a file of that format,
 * without a name, in place of the input.
 */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "ctl_input_priv.h"

int ctl_inputs_add_lines(struct ctl_inputs *in, const char *name, const struct lines_export_options *options, struct err *err)
{
	struct stat st;

	if (!strcmp(name, "-") || (!stat(name, &st) && !S_ISREG(st.st_mode))) {
		err_set(err, ERR_USAGE, "lines are read from files that are named, not from folders, devices or pipes");
		return err_add_file(err, name);
	}
	/* The daemon knows an input by its name, and each of them would be a text of its own. */
	for (size_t i = 0; i < in->n; i++) {
		if (strcmp(in->input[i].name, name))
			continue;
		err_set(err, ERR_USAGE, "the file is given twice, and once or more for its lines");
		err_add_hint(
			err,
			"give it once; --kind-field takes kinds from its features, and rings of every kind are breaklines, too");
		return err_add_file(err, name);
	}
	return ctl_input_append(in, &(struct ctl_input){.fd = -1, .lines = options}, name, err);
}

static int interrupted(void *session)
{
	return session_interrupted(session);
}

static int write_text(struct ctl_inputs *inputs, struct ctl_input *in, int fd, struct err *err)
{
	const struct ctl_input_options *o = inputs->opt;
	/* Among files of lines any text is CSV. */
	struct lines_options opt = {
		.layer = o->layer, .kind_field = o->kind_field, .interrupted = interrupted, .ctx = inputs->session, .csv = true};
	struct lines *lines = NULL;
	FILE *out = fdopen(dup(fd), "w");
	int r;

	if (!out)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	r = lines_open(in->name, &opt, &lines, err);
	if (!r)
		r = lines_export(lines, in->lines, out, &in->exported, err);
	lines_close(lines);
	if (fclose(out) && !r)
		r = err_sys(err, errno, "its text cannot be written");
	return r;
}

/* The daemon compares times of files: those of the original. */
int ctl_lines_keep(struct ctl_inputs *inputs, struct ctl_input *in, struct err *err)
{
	struct stat st = {0};
	const char *folder;
	int fd, original, r;

	if (in->kept)
		return 0;
	if (ctl_input_open_file(in->name, &original, err))
		return -(int)err->code;
	r = fstat(original, &st) ? err_sys(err, errno, "cannot look at it") : ctl_temp_open(&folder, &fd, err);
	close(original);
	if (r)
		return err_add_file(err, in->name);
	r = write_text(inputs, in, fd, err);
	if (!r && futimens(fd, (const struct timespec[2]){st.st_mtim, st.st_mtim}))
		r = err_sys(err, errno, "the time of a file in %s cannot be set", folder);
	if (!r) {
		in->kept = fd;
		return 0;
	}
	close(fd);
	return err_add_file(err, in->name);
}
