/*
 * Head and tail of LandXML 1.2: units, coordinate system, name of the surface; what other formats have in comments is in
 * properties.
 *
 * The format has one unit of length for all axes and must name it: what is not known to be that is refused. Date and time are
 * required too, and always the same, because the same mesh is the same file.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_axis.h"
#include "format_landxml.h"
#include "format_text.h"
#include "outfile.h"

enum { TEXT = FORMAT_TEXT_GROWTH * FORMAT_COMMENT };

static const char begin[] =
	"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
	"<LandXML xmlns=\"http://www.landxml.org/schema/LandXML-1.2\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
	"xsi:schemaLocation=\"http://www.landxml.org/schema/LandXML-1.2 http://www.landxml.org/schema/LandXML-1.2/LandXML-1.2.xsd\" "
	"version=\"1.2\" date=\"2000-01-01\" time=\"00:00:00\" language=\"English\" readOnly=\"false\">\n";

static const struct {
	const char *name, *word, *text;
} units[] = {
	{"metre", "m",
	 "Metric areaUnit=\"squareMeter\" linearUnit=\"meter\" volumeUnit=\"cubicMeter\" temperatureUnit=\"celsius\" "
	 "pressureUnit=\"milliBars\""},
	{"foot", "ft",
	 "Imperial areaUnit=\"squareFoot\" linearUnit=\"foot\" volumeUnit=\"cubicYard\" temperatureUnit=\"fahrenheit\" "
	 "pressureUnit=\"inHG\""},
	{"us-survey-foot", "ftUS",
	 "Imperial areaUnit=\"squareFoot\" linearUnit=\"USSurveyFoot\" volumeUnit=\"cubicYard\" temperatureUnit=\"fahrenheit\" "
	 "pressureUnit=\"inHG\""},
};

#define UNITS (sizeof(units) / sizeof(*units))

static int put_all(struct outfile *out, struct err *err, const char *const *text)
{
	int r = 0;

	for (; *text && !r; text++)
		r = outfile_write(out, *text, strlen(*text), err);
	return r;
}
#define PUT(out, err, ...) put_all(out, err, (const char *const[]){__VA_ARGS__, NULL})

/* "NAME VALUE" as a property. */
static int put_property(void *ctx, const char *text, struct err *err)
{
	size_t n = strcspn(text, " ");
	char name[80], value[TEXT];

	snprintf(name, sizeof(name), "%.*s", (int)n, text);
	format_text(FORMAT_TEXT_XML, text[n] ? text + n + 1 : "", value, sizeof(value));
	return PUT(ctx, err, "<Property label=\"", name, "\" value=\"", value, "\"/>\n");
}

static int put_units(struct outfile *out, const struct acut_mesh_head *head, const struct format_options *opt, struct err *err)
{
	const char *xy = format_unit_known(head->unit_xy), *z = opt->z_unit ? opt->z_unit : format_unit_known(head->unit_z);
	size_t i = 0;

	while (i < UNITS && strcmp(units[i].name, xy))
		i++;
	if (i == UNITS) {
		err_set(err, ERR_USAGE, "LandXML must name the unit of x and y, and that is %.30s", xy);
		return err_add_hint(err, !strcmp(xy, "degree") ?
						 "stage without --planar: degrees are projected (--utm names the zone)" :
						 "stage inputs without units with --assume-units m or ft or ftUS");
	}
	if (!strcmp(xy, z))
		return PUT(out, err, "<Units>\n<", units[i].text, "/>\n</Units>\n");
	err_set(err, ERR_USAGE, "LandXML has one unit for x, y and z, and they are in %.30s and %.30s", xy, z);
	if (!strcmp(z, "unknown"))
		return err_add_hint(err, "stage inputs without units with --assume-units ,m or ,ft or ,ftUS");
	return err_add_hint(err, "convert the heights: --z-unit %s", units[i].word);
}

static int put_attribute(struct outfile *out, const char *name, const char *value, struct err *err)
{
	size_t size = FORMAT_TEXT_GROWTH * (value ? strlen(value) : 0) + 1;
	char *text;
	int r;

	if (size == 1)
		return 0;
	text = malloc(size);
	if (!text)
		return err_set(err, ERR_NOMEM, "no memory for a coordinate system");
	format_text(FORMAT_TEXT_XML, value, text, size);
	r = PUT(out, err, " ", name, "=\"", text, "\"");
	free(text);
	return r;
}

/* Coordinates less an origin are in no system that has a code, and heights in another unit not in the vertical system. */
static int put_system(struct outfile *out, const struct acut_mesh_head *head, const struct format_options *opt, struct err *err)
{
	bool shifted = opt->has_origin || opt->origin_auto;
	bool converted = opt->z_unit && strcmp(opt->z_unit, format_unit_known(head->unit_z));
	bool heights = head->vertical && *head->vertical;
	char code[32] = "", name[TEXT];
	int r;

	if (!head->crs || !*head->crs || !strcmp(head->crs, "unknown"))
		return 0;
	if (head->epsg && !shifted)
		snprintf(code, sizeof(code), " epsgCode=\"%u\"", head->epsg);
	format_text(FORMAT_TEXT_XML, head->crs, name, sizeof(name));
	r = PUT(out, err, "<CoordinateSystem", code, " desc=\"", name, shifted ? ", less an origin" : "", "\"");
	if (!r && !shifted && !(converted && heights))
		r = put_attribute(out, "ogcWktCode", head->wkt, err);
	if (!r && !shifted && !converted)
		r = put_attribute(out, "verticalDatum", head->vertical, err);
	return r ? r : PUT(out, err, "/>\n");
}

int format_landxml_head(struct outfile *out, const struct acut_mesh_head *head, const struct format_options *opt, struct err *err)
{
	char file[300], name[FORMAT_TEXT_GROWTH * sizeof(file)];
	int r = PUT(out, err, begin);

	if (!r)
		r = put_units(out, head, opt, err);
	if (!r)
		r = put_system(out, head, opt, err);
	format_text(FORMAT_TEXT_XML, format_file_name(out, "TIN", file, sizeof(file)), name, sizeof(name));
	if (!r)
		r = PUT(out, err, "<Project name=\"", name, "\">\n<Feature code=\"acut\">\n");
	if (!r)
		r = format_comment_head(head, opt, put_property, out, err);
	if (!r)
		r = PUT(out, err, "</Feature>\n</Project>\n<Application name=\"acut\"/>\n<Surfaces>\n<Surface name=\"", name,
			"\">\n<Definition surfType=\"TIN\">\n<Pnts>\n");
	return r;
}

int format_landxml_tail(struct outfile *out, const char *counts, const char *digest, struct err *err)
{
	int r = PUT(out, err, "</Faces>\n</Definition>\n<Feature code=\"acut\">\n");

	if (!r)
		r = put_property(out, counts, err);
	if (!r)
		r = put_property(out, digest, err);
	return r ? r : PUT(out, err, "</Feature>\n</Surface>\n</Surfaces>\n</LandXML>\n");
}
