// LASzip's own library on a whole file, for bench-laz. Built only with -Dlaszip=PREFIX.
#include <laszip/laszip_api.h>

extern "C" unsigned long long laszip_pass(const char *path, int all);

// Decodes every point; 0 on failure. `all` 0: only what terrain needs, as far as LASzip can leave out fields.
unsigned long long laszip_pass(const char *path, int all)
{
	laszip_POINTER reader;
	laszip_header *header;
	laszip_BOOL compressed;
	unsigned long long n = 0, points;

	if (laszip_create(&reader))
		return 0;
	if (!all)
		laszip_decompress_selective(reader, laszip_DECOMPRESS_SELECTIVE_CHANNEL_RETURNS_XY |
					    laszip_DECOMPRESS_SELECTIVE_Z | laszip_DECOMPRESS_SELECTIVE_CLASSIFICATION |
					    laszip_DECOMPRESS_SELECTIVE_FLAGS);
	if (!laszip_open_reader(reader, path, &compressed) && !laszip_get_header_pointer(reader, &header)) {
		points = header->number_of_point_records ? header->number_of_point_records :
							   header->extended_number_of_point_records;
		while (n < points && !laszip_read_point(reader))
			n++;
		laszip_close_reader(reader);
	}
	laszip_destroy(reader);
	return n;
}
