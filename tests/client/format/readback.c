/* See readback.h. */
#include <ctype.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "cursor.h"
#include "outfile.h"
#include "folder.h"
#include "readback.h"

const struct meshes_spec readback_small = {.columns = 50,
					   .rows = 33,
					   .strip = 5,
					   .x0 = -7000,
					   .y0 = 123,
					   .step = 100,
					   .slope_x = 10,
					   .slope_y = -7,
					   .scale_xy = "0.01",
					   .scale_z = "0.001",
					   .k = {50000000, 400000000, -12}};
const struct meshes_spec readback_large = {.columns = 300,
					   .rows = 300,
					   .strip = 299,
					   .x0 = -7000,
					   .y0 = 123,
					   .step = 100,
					   .slope_x = 10,
					   .slope_y = -7,
					   .scale_xy = "0.01",
					   .scale_z = "0.001",
					   .k = {50000000, 400000000, -12}};

int readback_write_with(const char *format, const char *name, const struct meshes *m, const struct format_options *opt,
			const struct outputs_options *ropt, struct err *err)
{
	char path[512];

	*err = ERR_INIT;
	return meshes_write(m, folder_path(name, path), format_find(format), opt, ropt, NULL, err);
}

int readback_write(const char *format, const char *name, const struct meshes *m, const struct format_options *opt,
		   struct err *err)
{
	const struct outputs_options plain = {0};

	return readback_write_with(format, name, m, opt, &plain, err);
}

static char *all_of(FILE *f, size_t *ret_size)
{
	char *text = NULL, piece[65536];
	size_t n;

	*ret_size = 0;
	while ((n = fread(piece, 1, sizeof(piece), f)) > 0) {
		text = realloc(text, *ret_size + n + 1);
		memcpy(text + *ret_size, piece, n);
		*ret_size += n;
	}
	assert_non_null(text);
	text[*ret_size] = 0;
	fclose(f);
	return text;
}

char *readback_text(const char *format, const char *name, const struct meshes *m, const struct format_options *opt,
		    size_t *ret_size)
{
	struct err err;
	char path[512];

	assert_int_equal(readback_write(format, name, m, opt, &err), 0);
	return folder_file(folder_path(name, path), ret_size);
}

char *readback_piped(const char *format, const struct meshes *m, const struct format_options *opt, size_t *ret_size)
{
	const struct outputs_options plain = {0};
	struct err err = ERR_INIT;
	int fd[2], status;
	char *text;
	pid_t pid;

	fflush(NULL);
	assert_int_equal(pipe(fd), 0);
	pid = fork();
	if (!pid) {
		dup2(fd[1], STDOUT_FILENO);
		close(fd[0]);
		_exit(-meshes_write(m, "-", format_find(format), opt, &plain, NULL, &err));
	}
	close(fd[1]);
	text = all_of(fdopen(fd[0], "rb"), ret_size);
	assert_int_equal(waitpid(pid, &status, 0), pid);
	assert_int_equal(status, 0);
	return text;
}

void readback_same_piped(const char *format, const struct meshes *m, const struct format_options *opt, const char *text,
			 size_t size)
{
	size_t n;
	char *piped = readback_piped(format, m, opt, &n);

	assert_int_equal(n, size);
	assert_memory_equal(piped, text, size);
	free(piped);
}

int readback_late(const char *format, const uint8_t saved[FORMAT_SAVED], const struct meshes *m, const struct format_options *opt,
		  struct err *err)
{
	const struct format *f = format_find(format);
	struct cursor from = cursor_of(saved, FORMAT_SAVED);
	struct format_block block = {&m->block[0], m->block[0].vertex};
	struct outfile *out;
	char path[512];
	void *writer;
	int r;

	*err = ERR_INIT;
	assert_int_equal(m->block[0].nforeign, 0); /* so that these are all positions */
	assert_int_equal(outfile_new(folder_path("late", path), false, &out, err), 0);
	assert_int_equal(f->open(out, opt, &writer, err), 0);
	r = f->resume(writer, &m->head, &from, err);
	if (!r)
		r = f->block(writer, &block, err);
	f->free(writer);
	outfile_free(out);
	return r;
}

struct readback_mesh readback_flat(const struct meshes *m)
{
	struct readback_mesh f = {.vertex = calloc(m->tail.vertices + 1, sizeof(*f.vertex)),
				  .triangle = calloc(m->tail.triangles + 1, sizeof(*f.triangle))};

	for (size_t i = 0; i < m->nblock; i++) {
		const struct acut_mesh_block *b = &m->block[i];

		if (b->nnew)
			memcpy(f.vertex + f.nvertex, b->vertex, b->nnew * sizeof(*f.vertex));
		f.nvertex += b->nnew;
		for (uint32_t j = 0; j < b->ntriangle; j++, f.ntriangle++) {
			for (int c = 0; c < 3; c++) {
				uint32_t l = b->triangle[j][c];

				f.triangle[f.ntriangle][c] = l < b->nforeign ? b->foreign[l] : b->first + l - b->nforeign;
			}
		}
	}
	assert_int_equal(f.nvertex, m->tail.vertices);
	assert_int_equal(f.ntriangle, m->tail.triangles);
	return f;
}

void readback_flat_done(struct readback_mesh *f)
{
	free(f->vertex);
	free(f->triangle);
}

int64_t readback_number(const char **at, int decimals)
{
	const char *p = *at;
	bool minus = *p == '-';
	int64_t n = 0;
	int behind = -1;

	for (p += minus; isdigit((unsigned char)*p) || (*p == '.' && behind < 0); p++) {
		if (*p == '.')
			behind = 0;
		else
			n = 10 * n + *p - '0';
		behind += *p != '.' && behind >= 0;
	}
	assert_int_equal(behind < 0 ? 0 : behind, decimals);
	*at = p;
	return minus ? -n : n;
}

int readback_begin(void **state)
{
	return folder_begin(state);
}

int readback_end(void **state)
{
	return folder_end(state);
}
