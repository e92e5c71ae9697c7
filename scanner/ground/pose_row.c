/*
 * The columns of a pose file, and its rows. The first line names the columns, in any order; nothing is inferred from
 * the numbers.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "err.h"
#include "parse.h"
#include "pose_parts.h"

static const char *const names[POSE_COLUMNS] = {
	[POSE_TIME] = "time",
	[POSE_EASTING] = "easting",
	[POSE_NORTHING] = "northing",
	[POSE_LATITUDE] = "latitude",
	[POSE_LONGITUDE] = "longitude",
	[POSE_HEIGHT] = "height",
	[POSE_ELLIPSOIDAL_HEIGHT] = "ellipsoidal_height",
	[POSE_ROLL] = "roll",
	[POSE_PITCH] = "pitch",
	[POSE_HEADING] = "heading",
};

/* Splits the line at its commas; removes spaces and quotes around fields. At most `max` fields. */
static unsigned split_line(char *line, char comma, char *field[], unsigned max)
{
	unsigned n = 0;

	for (char *at = line;;) {
		char *to, *end;

		while (*at == ' ' || (*at == '\t' && comma != '\t'))
			at++;
		if (*at == '"') {
			for (to = ++at, end = at; *end && !(*end == '"' && end[1] != '"'); end++) {
				end += *end == '"';
				*to++ = *end;
			}
			end += *end == '"';
			while (*end && *end != comma)
				end++;
		} else {
			for (end = at; *end && *end != comma; end++)
				;
			for (to = end; to > at && (to[-1] == ' ' || (to[-1] == '\t' && comma != '\t')); to--)
				;
		}
		if (n < max)
			field[n] = at;
		n++;
		if (!*end) {
			*to = 0;
			return n;
		}
		*to = 0;
		at = end + 1;
	}
}

/* ---- the line of names ---- */

static int parse_name(struct pose_form *f, unsigned i, const char *name, struct err *err)
{
	f->column[i] = -1;
	if (!*name || *name == '_')
		return 0;
	for (int c = 0; c < POSE_COLUMNS; c++) {
		if (strcasecmp(name, names[c]))
			continue;
		for (unsigned k = 0; k < i; k++)
			if (f->column[k] == c)
				return err_set(err, ERR_INPUT, "the column %s is there twice", names[c]);
		f->column[i] = c;
		return 0;
	}
	err_set(err, ERR_INPUT, "\"%.60s\" is no column of poses", name);
	return err_add_hint(err, "time; easting, northing or latitude, longitude; height or ellipsoidal_height; roll, pitch, "
				 "heading; a name that begins with _ is left out");
}

static bool has_column(const struct pose_form *f, int column)
{
	for (unsigned i = 0; i < f->fields; i++)
		if (f->column[i] == column)
			return true;
	return false;
}

static int check_names(struct pose_form *f, struct err *err)
{
	static const int always[] = {POSE_TIME, POSE_ROLL, POSE_PITCH, POSE_HEADING};
	bool plane = has_column(f, POSE_EASTING) || has_column(f, POSE_NORTHING);

	f->degrees = has_column(f, POSE_LATITUDE) || has_column(f, POSE_LONGITUDE);
	f->ellipsoidal = has_column(f, POSE_ELLIPSOIDAL_HEIGHT);
	for (size_t i = 0; i < sizeof always / sizeof *always; i++)
		if (!has_column(f, always[i]))
			err_set(err, ERR_INPUT, "there is no column %s", names[always[i]]);
	if (plane == f->degrees)
		err_set(err, ERR_INPUT,
			plane ? "it has both easting, northing and latitude, longitude" :
				"it has neither easting, northing nor latitude, longitude");
	else if (f->degrees ? !has_column(f, POSE_LATITUDE) || !has_column(f, POSE_LONGITUDE) :
			      !has_column(f, POSE_EASTING) || !has_column(f, POSE_NORTHING))
		err_set(err, ERR_INPUT,
			f->degrees ? "of latitude and longitude one is not there" : "of easting and northing one is not there");
	if (f->ellipsoidal == has_column(f, POSE_HEIGHT))
		err_set(err, ERR_INPUT,
			f->ellipsoidal ? "it has both height and ellipsoidal_height" :
					 "it has neither height nor ellipsoidal_height");
	if (!err->code)
		return 0;
	return err_add_hint(err, "the first line names the columns: acut-pose(5)");
}

int pose_form_read(char *line, struct pose_form *f, struct err *err)
{
	char *field[POSE_FIELDS_MAX];
	int r = 0;

	f->comma = strchr(line, ',') ? ',' : strchr(line, ';') ? ';' : strchr(line, '\t') ? '\t' : ',';
	f->fields = split_line(line, f->comma, field, POSE_FIELDS_MAX);
	if (f->fields > POSE_FIELDS_MAX)
		return err_set(err, ERR_INPUT, "it has %u columns, more than %d", f->fields, POSE_FIELDS_MAX);
	for (unsigned i = 0; i < f->fields && !r; i++)
		r = parse_name(f, i, field[i], err);
	return r ? r : check_names(f, err);
}

/* ---- a row ---- */

static int bad_field(int column, const char *text, const char *want, struct err *err)
{
	err_set(err, ERR_INPUT, "\"%.40s\" is no %s", text, want);
	if (strchr(text, ','))
		err_add_hint(err, "numbers have a point, never a comma");
	return err_add_place(err, ERR_NO_OFFSET, names[column]);
}

static int parse_number(const struct pose_form *f, int column, const char *text, struct pose_row *row, struct err *err)
{
	static const struct {
		double least, most;
		const char *what;
	} of[POSE_COLUMNS] = {
		[POSE_EASTING] = {-1e9, 1e9, "number of the plane"},
		[POSE_NORTHING] = {-1e9, 1e9, "number of the plane"},
		[POSE_LATITUDE] = {-90, 90, "latitude in degrees"},
		[POSE_LONGITUDE] = {-180, 360, "longitude in degrees"},
		[POSE_HEIGHT] = {-1e6, 1e6, "height"},
		[POSE_ELLIPSOIDAL_HEIGHT] = {-1e6, 1e6, "height"},
		[POSE_ROLL] = {-360, 360, "angle in degrees"},
		[POSE_PITCH] = {-360, 360, "angle in degrees"},
		[POSE_HEADING] = {-360, 720, "angle in degrees"},
	};
	double v;

	if (column == POSE_TIME) {
		if (!pose_time_parse(text, f->clock, &row->time))
			return bad_field(column, text,
					 f->clock == POSE_GPS ? "time of GPS (seconds less 10^9, or a date and time without Z)" :
								"time (seconds since 1970, or 2026-05-04T10:00:00.25Z)",
					 err);
		row->time += f->offset_s;
		return 0;
	}
	if (!parse_double(text, &v) || v < of[column].least || v > of[column].most)
		return bad_field(column, text, of[column].what, err);
	switch (column) {
	case POSE_EASTING:
	case POSE_LONGITUDE:
		row->at[0] = v;
		break;
	case POSE_NORTHING:
	case POSE_LATITUDE:
		row->at[1] = v;
		break;
	case POSE_HEIGHT:
	case POSE_ELLIPSOIDAL_HEIGHT:
		row->at[2] = v;
		break;
	default:
		row->angle[column - POSE_ROLL] = v;
	}
	return 0;
}

int pose_row_read(const struct pose_form *f, char *line, struct pose_row *ret, struct err *err)
{
	char *field[POSE_FIELDS_MAX];
	unsigned n = split_line(line, f->comma, field, POSE_FIELDS_MAX);
	int r = 0;

	if (n != f->fields)
		return err_set(err, ERR_INPUT, "the line has %u fields, the first line names %u", n, f->fields);
	for (unsigned i = 0; i < n && !r; i++)
		if (f->column[i] >= 0)
			r = parse_number(f, f->column[i], field[i], ret, err);
	return r;
}
