/* See format_png_file.h. libpng reports an error by a long jump, so each call that may have one sets its target. */
#include "format_png_file.h"

#include <png.h>
#include <setjmp.h>

#include "err.h"
#include "outfile.h"

static void put(png_structp png, png_bytep bytes, png_size_t n)
{
	struct format_png_file *f = png_get_io_ptr(png);

	if (outfile_write(f->out, bytes, n, f->err))
		png_error(png, "output");
}

static void put_flush(png_structp png) {}

static void fail(png_structp png, png_const_charp text)
{
	struct format_png_file *f = png_get_error_ptr(png);

	if (!f->err->code)
		err_set(f->err, ERR_INTERNAL, "the picture cannot be encoded: %s", text);
	png_longjmp(png, 1);
}

static void warn(png_structp png, png_const_charp text) {}

int format_png_begin(struct format_png_file *f, struct outfile *out, uint64_t width, uint64_t height, bool color, struct err *err)
{
	format_png_done(f);
	f->out = out;
	f->err = err;
	f->png = png_create_write_struct(PNG_LIBPNG_VER_STRING, f, fail, warn);
	f->info = f->png ? png_create_info_struct(f->png) : NULL;
	if (!f->info)
		return err_set(err, ERR_NOMEM, "no memory to encode a picture");
	if (setjmp(png_jmpbuf(f->png)))
		return -(int)err->code;
	png_set_write_fn(f->png, f, put, put_flush);
	png_set_user_limits(f->png, 0x7fffffff, 0x7fffffff);
	png_set_IHDR(f->png, f->info, (png_uint_32)width, (png_uint_32)height, 8,
		     color ? PNG_COLOR_TYPE_RGB_ALPHA : PNG_COLOR_TYPE_GRAY_ALPHA, PNG_INTERLACE_NONE,
		     PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
	png_set_compression_level(f->png, 4);
	png_write_info(f->png, f->info);
	return 0;
}

int format_png_row(struct format_png_file *f, const uint8_t *row, struct err *err)
{
	f->err = err;
	if (setjmp(png_jmpbuf(f->png)))
		return -(int)err->code;
	png_write_row(f->png, row);
	return 0;
}

int format_png_end(struct format_png_file *f, struct err *err)
{
	f->err = err;
	if (setjmp(png_jmpbuf(f->png)))
		return -(int)err->code;
	png_write_end(f->png, f->info);
	return 0;
}

void format_png_done(struct format_png_file *f)
{
	if (f->png)
		png_destroy_write_struct(&f->png, &f->info);
}
