/* Any bytes as what files say of their coordinate system: WKT (FUZZ_WKT), GeoTIFF keys (else), and what people
 * say of it. The answer is printable text. */
#include <stdlib.h>
#include <string.h>

#include "crs.h"
#include "fuzz_input.h"

static void check(const struct crs_info *info)
{
	char remark[64];

	if (!memchr(info->text, 0, sizeof info->text) || !memchr(info->unit_xy, 0, sizeof info->unit_xy) ||
	    !memchr(info->unit_z, 0, sizeof info->unit_z) || !info->text[0])
		abort();
	for (const char *p = info->text; *p; p++)
		if (*p < 0x20 || *p > 0x7e)
			abort();
	crs_epsg_remark(info, remark, sizeof remark);
	if (strlen(remark) >= sizeof remark)
		abort();
}

#if FUZZ_WKT
static const char *const texts[] = {
	"PROJCS[\"NAD83 / UTM 10N\",GEOGCS[\"NAD83\",DATUM[\"North_American_Datum_1983\",SPHEROID[\"GRS 1980\",6378137,"
	"298.257222101]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],"
	"PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_meridian\",-123],PARAMETER[\"scale_factor\",0.9996],"
	"PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",0],UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"26910\"]]",
	"COMPD_CS[\"x + h\",PROJCS[\"x\",UNIT[\"US survey foot\",0.304800609601219]],VERT_CS[\"NAVD88\",VERT_DATUM[\"d\",2005],"
	"UNIT[\"foot\",0.3048],AXIS[\"Up\",UP],AUTHORITY[\"EPSG\",\"5703\"]]]",
	"PROJCRS[\"ETRS89 / UTM zone 32N\",BASEGEOGCRS[\"ETRS89\",DATUM[\"European Terrestrial Reference System 1989\","
	"ELLIPSOID[\"GRS 1980\",6378137,298.257222101,LENGTHUNIT[\"metre\",1]]]],CONVERSION[\"UTM zone 32N\","
	"METHOD[\"Transverse Mercator\",ID[\"EPSG\",9807]],PARAMETER[\"Longitude of natural origin\",9,"
	"ANGLEUNIT[\"degree\",0.0174532925199433]]],CS[Cartesian,2],AXIS[\"(E)\",east],LENGTHUNIT[\"metre\",1],ID[\"EPSG\",25832]]",
	"COMPOUNDCRS[\"a\",GEOGCRS[\"WGS 84\",DATUM[\"World Geodetic System 1984\",ELLIPSOID[\"WGS 84\",6378137,298.257]]],"
	"VERTCRS[\"EGM96 height\",VDATUM[\"EGM96\"],CS[vertical,1],AXIS[\"up\",up],LENGTHUNIT[\"metre\",1.0]]]",
	"GEOCCS[\"WGS 84\",DATUM[\"x\",SPHEROID[\"y\",1,0]],UNIT[\"metre\",1]]",
	"LOCAL_CS[\"\"\"\",UNIT[(\"\")]]",
	"BOUNDCRS[SOURCECRS[GEOGCS[\"a\"]],TARGETCRS[GEOGCS[\"b\"]]]",
	"EPSG:25832 + EPSG:7837",
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

/* A normal text is its own normal form, means the same, and holds for what it says. */
static void check_normal(const uint8_t *bytes, size_t size, const struct crs_info *said)
{
	static char once[CRS_WKT_MAX + 1], twice[CRS_WKT_MAX + 1];
	size_t n = crs_wkt_normal(bytes, size, once);
	struct crs_bytes part;
	struct crs_info info;

	if (!n)
		return;
	if (strlen(once) != n || crs_wkt_normal(once, n, twice) != n || memcmp(once, twice, n))
		abort();
	crs_read_wkt(once, n, &info);
	if (info.plane != said->plane || strcmp(info.unit_xy, said->unit_xy) || strcmp(info.unit_z, said->unit_z))
		abort();
	part = crs_wkt_holds(once, info.text, info.unit_xy, info.unit_z);
	if (part.size && (part.size != n || part.at != once))
		abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct crs_records records = {.wkt = {bytes, size}, .prefer_wkt = true};
	struct err err = ERR_INIT;
	struct crs_info info;
	char *text;
	int rc;

	crs_read(&records, &info);
	check(&info);
	check_normal(bytes, size, &info);
	text = malloc(size + 1);
	if (!text)
		abort();
	memcpy(text, bytes, size);
	text[size] = 0;
	rc = crs_assume_text(text, size, &info, &err);
	fuzz_input_check(rc, &err);
	if (!rc)
		check(&info);
	free(text);
	return 0;
}
#else
/* Sizes of the three records, 16 bits each, then their bytes. */
size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static const uint16_t keys[] = {1, 1,     0,    6, 1024, 0,    1,    1, 1026, 34737, 8,    0,     3072, 0,
					1, 26910, 3076, 0, 1,    9001, 4096, 0, 1,    5703,  2057, 34736, 1,    0};
	static const double doubles[] = {6378137, 298.257222101};
	uint16_t size[3] = {sizeof keys, sizeof doubles, 8};
	size_t n = sizeof size;

	if (i >= 4)
		return 0;
	memcpy(bytes, size, sizeof size);
	memcpy(bytes + n, keys, sizeof keys);
	if (i)
		bytes[n + 14] ^= (uint8_t)i; /* model type */
	n += sizeof keys;
	memcpy(bytes + n, doubles, sizeof doubles);
	n += sizeof doubles;
	memcpy(bytes + n, "NAD83 m|", 8);
	return n + 8;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct crs_records records = {.prefer_wkt = false};
	struct crs_bytes *record[3] = {&records.keys, &records.doubles, &records.ascii};
	struct crs_info info;
	uint16_t n[3];
	uint8_t *copy[3];
	size_t at = sizeof n;

	if (size < sizeof n)
		return 0;
	memcpy(n, bytes, sizeof n);
	for (int i = 0; i < 3; i++) {
		size_t left = size - at, take = n[i] < left ? n[i] : left;

		copy[i] = malloc(take ? take : 1); /* of its own, so that a byte beyond it is seen */
		if (!copy[i])
			abort();
		memcpy(copy[i], bytes + at, take);
		record[i]->at = copy[i];
		record[i]->size = take;
		at += take;
	}
	crs_read(&records, &info);
	check(&info);
	for (int i = 0; i < 3; i++)
		free(copy[i]);
	return 0;
}
#endif
