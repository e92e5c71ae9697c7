/*
 * The columns of texts, with names and without.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "fixture.h"

static const struct input_options defaults;

/* Lines of names: the letters that come of them, or what the refusal says. */
static const struct {
	const char *names, *columns, *unit_xy, *unit_z, *warning;
} heads[] = {
	{"X,Y,Z", "xyz"},
	{"x;y;z;intensity", "xyz"},
	{"POINT_X,POINT_Y,POINT_Z", "xyz"},
	{"X_utm,Y_utm,elev", "xyz"},
	{"//X Y Z", "xyz"},
	{"# Y X H", NULL},
	{"X-Koordinate;Y-Koordinate;Z-Koordinate", "xyz"},
	{"Pt,E,N,Z", "_xyz"},
	{"Pt,N,E,Z,D", "_yxz"},
	{"Point #,Northing,Easting,Elevation,Description", "_yxz"},
	{"E [m],N [m],H [m]", "xyz", "metre", "metre"},
	{"E [m] N [m] H [m]", "xyz", "metre", "metre"},
	{"Easting (m),Northing (m),Elevation (US survey feet)", "xyz", "metre", "us-survey-foot"},
	{"Easting (ft),Northing (ft),Z", "xyz", "unknown", "unknown", "ft or ftUS"},
	{"E [m],N [ft],Z", "xyz", "unknown", "unknown", "two units"},
	{"E [mm],N [mm],Z [m]", "xyz", "unknown", "metre", "not known"},
	{"easting_ift,northing_ift,z_ift", "xyz", "foot", "foot"},
	{"Punktnr;Rechtswert;Hochwert;H\xc3\xb6he", "_xyz"},
	{"Nr;Hochwert (X);Rechtswert (Y);H\xf6he [m]", "_yxz", "unknown", "metre"}, /* Latin-1 */
	{"HOEHE,OSTWERT,NORDWERT", "zxy"},
	{"Este;Norte;Cota", "xyz"},
	{"Point ID,Easting (UTM 32N),Northing (UTM 32N),Ortho. Height [m]", "_xyz", "unknown", "metre"},
	{"lat,lon,ele", "yxz", "degree"},
	{"Y;X;ux;uy;uz;Z", NULL, "whether X is the easting", "--columns ne___z if"},
	{"Nombre,Norte,Este,Altitud", "_yxz"},
	{"Est,Nord,Quota", "xyz"},
	{"N\xc2\xb0;Est;Nord;Altitude", "_xyz"},
	{"N\xc2\xba,Norte,Este,Cota s.n.m.", "_yxz"},
	{"N.;Est;Nord;Quota s.l.m.", NULL, "twice"},
	{"Nome;Coordinata Est;Coordinata Nord;Quota s.l.m.", "_xyz"},
	{"Nom;X_L93;Y_L93;Z_NGF", "_xyz"},
	{"id;coord_x;coord_y;alti", "_xyz"},
	{"X,Y,Altitude", "xyz"},
	{"Id\tX (East)\tY (North)\tH", "_xyz"},
	{"Noord,Oost,Hoogte", "yxz"},
	{"Nord,\xc3\x98st,Kote", "yxz"},
	{"Nr,P\xc3\xb3\xc5\x82noc,Wsch\xc3\xb3"
	 "d,Wysoko\xc5\x9b\xc4\x87",
	 "_yxz"},
	{"\"Easting\" , \"Northing\" , \"Height above ground\" , \"Elev.\"", "xy_z"},
	{"x,y,z,n", "xyz"},
	{"ID,Latitude,Longitude,Easting,Northing,Height", "___xyz"},
	{"X,Y,Z,lat,lon", "xyz"},
	{"z error,std x,x,y,z", "__xyz"},
	{"latitude,longitude,altitude", "yxz", "degree"},
	{"Lon (deg);Lat (deg);Ellipsoidal height [m]", "xyz", "degree", "metre"},
	{"z y x", "zyx"},
	/* refused, with the letters for this file */
	{"Y,X,H", NULL, "whether X is the easting", "--columns nez if X is the easting, --columns enz if"},
	{"Y X Z", NULL, "whether X is the easting", "--columns nez if X is the easting, --columns enz if"},
	{"Nr,X,Y,H,c", NULL, "whether X is the easting", "--columns _enz_ if X is the easting, --columns _nez_ if"},
	{"Nr;Y;X;Z;Class", NULL, "whether X is the easting", "--columns _nezc if X is the easting, --columns _enzc"},
	{"X,Y,H\xc3\xb6he", NULL, "whether X is the easting", "--columns enz"},
	{"zip,latitude,longitude", NULL, "which column is the height", "--columns _yx has no column for z yet"},
	{"id,lat,lon,code", NULL, "which column is the height", "--columns _yx_ has no column for z yet"},
	{"x,y,class,lat", NULL, "which column is the height", "--columns xyc_ has no column for z yet"},
	{"id,lat,lon,foo", NULL, "which column is the height", "--columns _yxz, or"},
	{"id,code,name,zip", NULL, "not understood", "as in --columns _xyz"},
	{"a,b,c,d", NULL, "", "--columns"},
	{"\xe7\x82\xb9,\xe4\xb8\x9c,\xe5\x8c\x97,\xe9\xab\x98", NULL, "not understood", "--columns xyz_"},
	{"x,y,z,x", NULL, "twice", "--columns xyz_"},
	{"E,N,elevation,altitude", NULL, "twice", "--columns xyz_"},
	{"E,N,X,Y,Z", NULL, "easting and a northing", "--columns en__z for easting and northing, --columns __enz"},
	{"x,y,z,class,classification", NULL, "class twice", "--columns xyz"},
	{"lon [gon],lat [gon],z", NULL, "decimal degrees", "--columns xyz"},
	{"West,South,Z", NULL, "which columns are x and y", "--columns xyz"},
};

/* A row of as many numbers as there are names, as the separators are. */
static void text_of(const char *names, char *ret, size_t size)
{
	char kind = strchr(names, ';') ? ';' : strchr(names, ',') ? ',' : strchr(names, '\t') ? '\t' : ' ';
	size_t n = (size_t)snprintf(ret, size, "%s\n5", names);

	names += strspn(names, "#/ ");
	for (int i = 6; *names; names++)
		if (*names == kind && names[1] != '[')
			n += (size_t)snprintf(ret + n, size - n, "%c%d", kind, i++);
}

static void names_in_heads(void **state)
{
	const struct input_options options = {.planar = true};

	for (size_t i = 0; i < sizeof heads / sizeof *heads; i++) {
		const char *says = heads[i].unit_xy, *hint = heads[i].unit_z, *columns = heads[i].columns;
		char text[256], want[64];
		struct outcome out;

		text_of(heads[i].names, text, sizeof text);
		out = fixture_read(text, strlen(text), "a.csv", &options, 10);
		if (!columns) {
			if (out.code != ERR_INPUT || out.err.offset != 1 || (says && !strstr(out.err.message, says)) ||
			    (hint && !strstr(out.err.hint, hint)))
				fail_msg("%s: %d, %s (%s)", text, out.code, out.err.message, out.err.hint);
			continue;
		}
		snprintf(want, sizeof want, "columns %s,", columns);
		if (out.code || !strstr(out.info.variant, "text, ") ||
		    (strcmp(columns, "xyz") ? !strstr(out.info.variant, want) : strstr(out.info.variant, "columns") != NULL))
			fail_msg("%s: %d, %s%s (%s)", text, out.code, out.info.variant, out.err.message, out.err.hint);
		if (strcmp(out.info.crs.unit_xy, says ? says : "unknown") || strcmp(out.info.crs.unit_z, hint ? hint : "unknown"))
			fail_msg("%s: %s, %s", text, out.info.crs.unit_xy, out.info.crs.unit_z);
		if (heads[i].warning ? !strstr(out.info.warning, heads[i].warning) : *out.info.warning)
			fail_msg("%s: %s", text, out.info.warning);
		assert_int_equal(out.info.crs.plane, says && !strcmp(says, "degree") ? CRS_PLANE_GEOGRAPHIC : CRS_PLANE_UNKNOWN);
	}
}

/* Names of several words between blanks, and rows of more and of fewer columns: the letters that come of them (* an x y z), or
 * the refusal's message and hint. */
static const struct {
	const char *text, *columns, *says, *hint;
} widths[] = {
	/* joined, where only that fits */
	{"Point Number Easting Northing Elevation Intensity\n1 2 3 4 5\n", "_xyz"},
	{"GPS Time X Y Z\n1 2 3 4\n", "_xyz"},
	{"X Y Z Scan Angle Rank Return Number Number of Returns\n2 3 4 0 1 2\n", "xyz_rn"},
	{"X Y Z R G B\n2 3 4 0 1 2\n", "*"},
	{"GPS Time X Y Z\n1 2 3 4 5\n", "__xyz"},
	{"# Point Number Easting Northing Elevation\n9 4 5 6\n", "_xyz"},
	{"Point Number X Y Z Description\n1 2 3 4 old iron pin\n", "_xyz"},
	{"Point Number X Y Z Code Description\n1 2 3 4 5 iron pin\n", NULL, "may be 6 or 7",
	 "--columns _xyz___ if names of several words are one column each, --columns __xyz__ if each"},
	{"Point Number Y X H\n1 2 3 4\n", NULL, "whether X is", "--columns _nez if"},
	/* not known, so refused with the letters of both alignments */
	{"Shot Label X Y Z Amount\n1 2 3 4 5\n", NULL, "names 6 columns (Shot Label X Y Z Amount), but the points have 5",
	 "--columns _xyz_ if a name before the coordinates has several words, --columns __xyz if one behind"},
	{"Shot Label X Y Z\n1 2 3 4\n", NULL, "names 5 columns", "as in --columns _xyz"},
	{"X Y Z Big Class\n1 2 3 4\n", NULL, "names 5 columns", "as in --columns xyz"},
	{"X val Y val Z val\n1 2 3\n", NULL, "names 6 columns", "a letter for each column"},
	{"x y z intensity\n1 2 3\n", NULL, "names 4 columns", "--columns xyz"},
	{"x,y,z,intensity\n1 2 3\n", NULL, "names 4 columns", "--columns xyz"},
	{"x,y,z\n1,2,3,4\n", NULL, "names 3 columns", "--columns _xyz if the first column has no name, --columns xyz_ if"},
	/* empty columns at the end of a row */
	{"id,x,y,z,class,remark\n1,2,3,4,5\n", "_xyzc"},
	{"id;x;y;z;remark\n1;2;3;4\n", "_xyz"},
	{"id\tx\ty\tz\tremark\n1\t2\t3\t4\t\n", "_xyz"},
	{"x,y,z,\n1,2,3,\n", "*"},
	{"remark,id,x,y,z\n1,2,3,4\n", NULL, "names 5 columns", "as in --columns _xyz"},
	{"x,y,remark,z\n1,2,3\n", NULL, "names 4 columns", "a letter for each column"},
};

static void names_and_widths(void **state)
{
	for (size_t i = 0; i < sizeof widths / sizeof *widths; i++) {
		const char *text = widths[i].text, *columns = widths[i].columns;
		struct outcome out = fixture_read(text, strlen(text), "a.txt", &defaults, 10);
		char want[64];

		snprintf(want, sizeof want, columns && *columns == '*' ? "text, 0" : "text, columns %s,", columns ? columns : "");
		if (columns ? out.code || !strstr(out.info.variant, want) || out.points != 1 :
			      out.code != ERR_INPUT || out.err.offset != 1 || !strstr(out.err.message, widths[i].says) ||
				      !strstr(out.err.hint, widths[i].hint))
			fail_msg("%s: %d, %s%s (%s)", text, out.code, out.info.variant, out.err.message, out.err.hint);
	}
}

/* Lines of numbers before the points: what is read, and what the warning (NULL: none), or of a refusal the message, says. */
static const struct {
	const char *text, *columns;
	uint64_t points;
	double min_x;
	const char *says;
	uint64_t line;
	const char *hint;
} preambles[] = {
	/* before longer rows */
	{"Survey of field\n2024 05 13\n4.5 5 6 GND\n7 8 9.5 GND old\n", NULL, 2, 4.5,
	 "line 1 names no columns and is skipped (Survey of field); 1 line before the points, up to line 2, is skipped", 0, NULL},
	{"2024 05 13\n4 5 6 7\n7 8 9 7\n", NULL, 2, 4, "1 line before the points, up to line 1, is skipped", 0, NULL},
	{"# a\n10 20 30\n0.5 0.5 0.5\n# b\n\n4 5 6 7\n7 8 9 7\n", NULL, 2, 4,
	 "2 lines before the points, up to line 3, are skipped", 0, NULL},
	{"2024,05,13\n4.5,5,6,\n7,8,9,GND\n", NULL, 2, 4.5, "1 line before the points", 0, NULL},
	{"//X Y Z C\n2024 05 13\n4 5 6 7\n7 8 9 7\n", NULL, 2, 4, "1 line before the points", 0, NULL},
	/* points for all that is known */
	{"2024 05 13\n4 5 6 7\n", NULL, 2, 4, NULL, 0, NULL},
	{"2024 05 13\n4 5 6\n7 8 9 7\n", NULL, 3, 4, NULL, 0, NULL},
	{"1.5 2 3\n4.5 5 6 GND\n7 8 9.5 GND\n", NULL, 3, 1.5, NULL, 0, NULL},
	{"1 2 3\n4 5 6 GND\n7 8 9 GND\n", NULL, 3, 1, NULL, 0, NULL},
	{"1 2 3\n1 2 3\n1 2 3\n1 2 3\n4 5 6 7\n7 8 9 7\n", NULL, 6, 1, NULL, 0, NULL},
	{"2024 05 13\n4 5 6 7\n7 8 9 7\n", "xyz", 3, 4, NULL, 0, NULL},
	{"Survey 7\n2024 05 13\n4 5 6 7\n7 8 9 7\n", NULL, 0, 0, "\"Survey 7\"", 1, "other text may stand"},
	{"2024 05 13\n4.5 5.5 6.5\n7.5 8.5 9.5\n7.5 8.5 1.5\n", NULL, 4, 4.5,
	 "line 1 is read as a point, but has whole numbers only", 0, NULL},
	{"2024 05 13\n4.5 5.5 6.5\n7.5 8.5 9.5\n7.5 8.5 1\n", NULL, 4, 4.5, NULL, 0, NULL},
	/* before a line of names */
	{"2024,05,13,survey\nx,y,z\n4,5,6\n", NULL, 1, 4, "1 line before the points, up to line 2, is skipped", 0, NULL},
	{"2024,05,13\n12,30,00\nz,y,x\nm,m,m\n6.5,5,4\n", NULL, 1, 4, "2 lines before the points", 0, NULL},
	{"Survey of a field\n2024,05,13,7\nid,z,y,x,c\n1,6,5,4,2\n", NULL, 1, 4,
	 "1 line before the points, beside that of names, is skipped; 1 line", 0, NULL},
	{"2024,05,13,survey\nx,y,z\n4,5,6\n", "zyx", 1, 6, "1 line before the points", 0, NULL},
	{"1,2,3\nx,y,z\n4,5,6\n", NULL, 0, 0, "not a number: \"x,y,z\"", 2, "what stands before it"},
	{"1.5,2,3\n1,2,3,4\nx,y,z\n4,5,6.5\n", NULL, 0, 0, "not a number: \"x,y,z\"", 3, "what stands before it"},
	{"x,y,z\n4,5,6\nx,y,z\n", NULL, 0, 0, "not a number", 3, "names of columns stand once"},
};

static void lines_before_points(void **state)
{
	for (size_t i = 0; i < sizeof preambles / sizeof *preambles; i++) {
		const char *text = preambles[i].text, *says = preambles[i].says;
		const struct input_options options = {.columns = preambles[i].columns};
		struct outcome out = fixture_read(text, strlen(text), "a.txt", &options, 10);

		if (preambles[i].points ?
			    out.code || out.points != preambles[i].points || out.info.coords.min[0] != preambles[i].min_x ||
				    (says ? !strstr(out.info.warning, says) : *out.info.warning) :
			    out.code != ERR_INPUT || out.err.offset != preambles[i].line || !strstr(out.err.message, says) ||
				    !strstr(out.err.hint, preambles[i].hint))
			fail_msg("%s: %d, %s%s (%s)", text, out.code, out.info.warning, out.err.message, out.err.hint);
	}
}

/* A line of units behind the names is read as if they were in these. */
static void lines_of_units(void **state)
{
	static const struct {
		const char *text, *unit_xy, *unit_z, *warns;
	} rows[] = {
		{"x,y,z\nm,m,ft\n1,2,3\n", "metre", "unknown", "ft or ftUS"},
		{"id,x,y,z,class\n,us-ft,us-ft,[m],-\n1,2,3,4,5\n", "us-survey-foot", "metre", NULL},
		{"Point Number X Y Z\n- (m) (m) (m)\n1 2 3 4\n", "metre", "metre", NULL},
		{"x [m],y [m],z\nm,m,m\n1,2,3\n", "metre", "metre", NULL},
		{"x [m],y [m],z\nm,m,m\nall in feet\n1,2,3\n", "metre", "metre", "1 line before the points"},
		{"x [m],y [m],z\nm,us-ft,m\n1,2,3\n", "unknown", "unknown",
		 "line 1 and the one behind it have other units: none is taken"},
		{"x,y,z\nmetre,second,metre\n1,2,3\n", "unknown", "unknown", "1 line before the points"},
		{"x,y,z\nm,m\n1,2,3\n", NULL, NULL, NULL},
		{"x,y,z\nm,m,m,m\n1,2,3\n", "unknown", "unknown", "1 line before the points"},
		{"lon,lat,z\ngon,gon,m\n1,2,3\n", NULL, NULL, "decimal degrees"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct outcome out = fixture_read(rows[i].text, strlen(rows[i].text), "a.txt", &defaults, 10);

		if (!rows[i].unit_xy ? out.code != ERR_INPUT || (rows[i].warns && !strstr(out.err.message, rows[i].warns)) :
				       out.code || out.points != 1 || strcmp(out.info.crs.unit_xy, rows[i].unit_xy) ||
					       strcmp(out.info.crs.unit_z, rows[i].unit_z) ||
					       (rows[i].warns ? !strstr(out.info.warning, rows[i].warns) : *out.info.warning))
			fail_msg("%s: %d, %s, %s, %s%s", rows[i].text, out.code, out.info.crs.unit_xy, out.info.crs.unit_z,
				 out.info.warning, out.err.message);
	}
}

/* Names that do not fit the rows, and degrees that nobody projects. */
static void heads_and_rows(void **state)
{
	static const struct {
		const char *columns, *text, *says;
		uint64_t line;
		enum err_code code;
	} cases[] = {
		{NULL, "X Y Z\n\"1\" 4 5 6\n", "names 3 columns", 1, ERR_INPUT},
		{NULL, "Pt,E,N,Z\nP1,4,5,6,iron pin\n", "", 0, 0},
		{NULL, "x y z\n1 4 5 6\n", "--columns _xyz if", 1, ERR_INPUT},
		{NULL, ",x,y,z\n1,4,5,6\n", "", 0, 0},
		{NULL, "Survey of 2024\n# here\nNr;Y;X;H\n1;4;5;6\n", "_nez", 3, ERR_INPUT},
		{NULL, "GND 4 5 6\nGND 7 8 9\n", "--columns _enz, or --columns _nez", 1, ERR_INPUT},
		{NULL, "1,GND,4.5,5.5,6.5\n", "--columns __enz", 1, ERR_INPUT},
		{NULL, "12A 4.125 5.125 600.5\n", "not a number: \"12A 4.125", 1, ERR_INPUT},
		{NULL, "12A 4.125 5.125 600.5\n", "--columns _enz, or --columns _nez", 1, ERR_INPUT},
		{NULL, "2024-05-13 12:00:07.5 4.125 5.125 600.5\n", "--columns __enz", 1, ERR_INPUT},
		{NULL, "12:00:07,4.125,5.125,600.5\n", "--columns _enz", 1, ERR_INPUT},
		{"__enz", "2024-05-13 12:00:07.5 4.125 5.125 600.5\n", "", 0, 0},
		{"_enz", "12:00:07,4.125,5.125,600.5\n", "", 0, 0},
		{NULL, "1 4.125 5.125 600.5\n2 4 5 6\n2A 4 5 6\n", "--columns _enz", 3, ERR_INPUT},
		{NULL, "1 4.125 5.125 600.5\n2 4x 5 6\n", "run together", 2, ERR_INPUT},
		{NULL, "a 1 4.5 5.5 6.5 b\n", "--columns __enz_", 1, ERR_INPUT},
		{NULL, "Survey 7\n1 2 3\n", "comments begin", 1, ERR_INPUT},
		{NULL, "lat lon z\n47 9 400\n", "are no plane", ERR_NO_OFFSET, ERR_UNSUPPORTED},
		{"yxz", "lat lon z\n47 9 400\n", "are no plane", ERR_NO_OFFSET, ERR_UNSUPPORTED},
		{"xyz", "lat lon z\n47 9 400\n", "", 0, 0},
		{"xyz", "Y X H\n47 9 400\n", "", 0, 0},
	};

	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		const struct input_options options = {.columns = cases[i].columns};
		struct outcome out = fixture_read(cases[i].text, strlen(cases[i].text), "a.csv", &options, 10);

		if (out.code != cases[i].code || (out.code && out.err.offset != cases[i].line) ||
		    (out.code && !strstr(out.err.message, cases[i].says) && !strstr(out.err.hint, cases[i].says)))
			fail_msg("%s: %d %d, %s (%s)", cases[i].text, out.code, (int)out.err.offset, out.err.message,
				 out.err.hint);
	}
}

/* Texts without names: what the refusal or (w) the warning says, or NULL: x y z without a word. */
static const struct {
	const char *text, *says, *letters;
} nameless[] = {
	{"1,5400073.990,500094.245,109.2,GND\n2,5400074.990,500095.1,109.3,GND\n3,5400073,500099.2,109.1,TREE, old\n",
	 "counts up", "--columns _nez_ if the northing comes first (PNEZD), --columns _enz_ if"},
	{"1 440750.1 3751290.2 107.5\n2 440751.1 3751290.9 107\n4 440750.9 3751291.1 107.1\n", "counts up", "_enz"},
	{"1001 12.25 8.5 101.25\n1002 13.25 8.75 101.5\n1003 12.75 9.5 101.75\n", "counts up", "_enz"},
	{"1 9.123 47.321 400.5\n2 9.124 47.320 401.5\n3 9.125 47.322 401.5\n", "counts up", "_enz"},
	{"2 440750.1 3751290.2 107.5\n9 440751.1 3751290.9 107\n2 440750.9 3751291.1 107.1\n", "whole numbers", "_enz"},
	{"2,440750,3751290,107\n", "whole numbers", "_nez"},
	{"7001 440750.1 3751290.2 107.5\n903 440751.1 3751290.9 107.1\n", "whole numbers", "_enz"},
	{"415000.10 440750.1 3751290.2 107.5\n415000.10 440751.1 3751290.9 107.1\n415000.35 440750 3751291.1 107.2\n",
	 "only rises", "_nez"},
	{"0 0 440750 3751290 107\n0 1 440760 3751290 108\n1 0 440750 3751300 109\n", "rows and columns", "__enz"},
	{"A Title of it all here\n1 440750.1 3751290.2 107.5\n2 440751.1 3751290.9 107\n3 440750.9 3751291.1 107.1\n",
	 "counts up", "_enz"},
	{"371,1013.436,10084.743,107.638,GND\n12,1020.5,10080.25,107.5,\n55,1021.5,10081.25,107.25,TREE, old\n", "a word follows",
	 "--columns _nez_ if the northing comes first (PNEZD), --columns _enz_ if"},
	{"371 13.436 84.743 7.638 GND\n", "a word follows", "_nez_"},
	/* passes with a warning */
	{"2 1.5 4.5 5.5\n2 2.5 7.5 5.25\n2 4.5 1.5 6.5\n5 9.5 9.5 5.5\n2 3.5 2.5 2.5\n2 9.1 9.1 5.5\n2 4.5 3.1 5.5\n"
	 "2 1.5 3.5 1.5\n2 9.5 0.5 1.5\n2 3.5 4.5 5.5\n",
	 "w has only whole numbers, 2 of them", NULL},
	{"1 9 4 5\n2 1 7 5\n3 4 1 6\n4 9 9 5\n5 3 2 2\n6 9 9 5\n7 4 3 5\n8 1 3 1\n9 9 0 1\n10 3 4 5\n", "w counts up", NULL},
	/* x y z */
	{"2 1.5 4.5 5.5\n2 2.5 7.5 5.5\n2 4.5 1.5 6.5\n5 9.5 9.5 5.5\n2 3.5 2.5 2.5\n2 9.1 9.1 5.5\n2 4.5 3.1 5.5\n"
	 "2 1.5 3.5 1.5\n2 9.5 0.5 1.5\n",
	 NULL, NULL}, /* nine rows: too few to say */
	{"2 1.5 4.5 5\n2 2.5 7.5 5\n2 4.5 1.5 6\n5 9.5 9.5 5\n2 3.5 2.5 2\n2 9.1 9.1 5\n2 4.5 3.1 5\n2 1.5 3.5 1\n2 9.5 0.5 1\n"
	 "2 3.5 4.5 5\n",
	 NULL, NULL}, /* the fourth is whole, as an intensity */
	{"2.5 13.436 84.743 7.638 GND\n3 13.5 84.5 7.5 GND\n", NULL, NULL},
	{"371 13.436 84.743 7 GND\n", NULL, NULL},
	{"371 13.436 84.743 7.638 GND\n372 13.436 84.743 7.638 5\n", NULL, NULL},
	{"1 1.5 4.5 5.5\n2 2.5 7.5 5.25\n7 4.5 1.5 6.5\n3 9.5 9.5 5.5\n4 3.5 2.5 2.5\n5 9.1 9.1 5.5\n6 4.5 3.1 5.5\n"
	 "8 1.5 3.5 1.5\n9 9.5 0.5 1.5\n2 3.5 4.5 5.5\n",
	 NULL, NULL}, /* nine whole values are not few */
	{"0 0 0\n1 0 0\n2 0 0\n", NULL, NULL},
	{"1 0.5 1.5 9.5\n1 1.5 1.75 9.5\n2 2.5 1.25 9.5\n3 1.5 1.25 9.5\n", NULL, NULL}, /* x comes again */
	/* no heights */
	{"1 5400073.990 500094.245\n2 5400074.990 500095.1\n3 5400074.990 500095.1\n", "neither is a height", "--columns xyz"},
	{"7 5400073.990 500094.245 GND\n8 5400074.990 500095.1 GND\n10 5400074.990 500095.1 TREE\n", "neither is a height",
	 "--columns xyz"},
	{"1 5400073.990 500094.245\n2 5400074.990 500095.1\n2 5400074.990 500095.1\n", "w and the first may be one", NULL},
	{"1 5400073.990 29000\n2 5400074.990 30095.1\n3 5400074.990 500095.1\n", NULL, NULL},
	{"440750.1 107.5 3751290.2\n440750.9 -29999 3751291.1\n", "w and the second may be one", NULL},
	{"107.5 -440750.1 3751290.2\n107.1 -440750.9 3751291.1\n", "w and the first may be one", NULL},
	{"440750.1 107.5 3751290.2\n440750.9 30000 3751291.1\n", NULL, NULL},
	{"440750.1 3751290.2 31107.5\n440750.9 3751291.1 31107.1\n", NULL, NULL},
	{"12.5 440750.1 44076000.2\n12.5 440750.1 44076100.2\n", NULL, NULL}, /* a hundred times as far */
	/* degrees */
	{"48.00100 9.01000 400.5\n48.00200 9.02000 401.1\n", "w look like degrees", NULL},
	{"-170.5 48.00100 400.5\n-170.49 48.00200 401.1\n", NULL, NULL},
	{"-170.51234 48.00100 400.5\n-170.50123 48.00200 401.1\n", "w look like degrees", NULL},
	{"170.51234 98.00100 400.5\n170.50123 98.00200 401.1\n", NULL, NULL},
	{"1.00100 9.01000 4.5\n2.00200 9.02000 41.1\n", NULL, NULL}, /* something that stands, in metres */
	{"0 0 5 100\n1 0 6 120\n2 0 7 110\n3 0 7 90\n", NULL, NULL},
	{"0 0.0 5.5 0.5\n1 0.0 6.5 0.25\n2 0.0 7.5 0.5\n3 0.0 7.25 0.5\n", NULL, NULL},
	{"5 0.5 1.5 9.5\n5 1.5 1.75 9.5\n5 2.5 1.25 9.5\n", NULL, NULL},
	{"440750 3751290 107 9\n440810 3751290 123 8\n440870 3751290 132 9\n", NULL, NULL},
	{"440750 3751290 31000 9\n440750 3751291 31001 8\n440751 3751291 31000 9\n", NULL, NULL}, /* strange, and x y z */
	{"500000123 5400000456 109200 77\n500000124 5400000457 109201 78\n500000125 5400000458 109202 79\n", NULL, NULL},
	{"12000 45000 31000 50\n12010 45020 31010 60\n12005 45090 31500 70\n", NULL, NULL}, /* millimetres */
};

static void columns_without_names(void **state)
{
	const struct input_options taken = {.columns = "xyz"};

	for (size_t i = 0; i < sizeof nameless / sizeof *nameless; i++) {
		const char *text = nameless[i].text, *says = nameless[i].says;
		bool warned = says && *says == 'w' && says[1] == ' ';
		struct outcome out = fixture_read(text, strlen(text), "a.txt", &defaults, 10);

		if (says && !warned ? out.code != ERR_INPUT || !strstr(out.err.message, says) ||
					      !strstr(out.err.hint, nameless[i].letters) :
				      out.code || (warned ? !strstr(out.info.warning, says + 2) : *out.info.warning))
			fail_msg("%s: %d, %s (%s) %s", text, out.code, out.err.message, out.err.hint, out.info.warning);
		if (!out.code)
			continue;
		assert_true(strstr(out.err.hint, "--columns xyz takes") && out.err.offset == 1 + !strncmp(text, "A Title", 7));
		out = fixture_read(text, strlen(text), "a.txt", &taken, 10);
		assert_int_equal(out.code, 0);
	}
	/* in .pts the first three are x y z */
	assert_int_equal(fixture_read("1\n2,440750,3751290,107\n", 23, "a.pts", &defaults, 10).code, 0);
}

/* A pipe is judged by its head. */
static void columns_of_a_pipe(void **state)
{
	static const char text[] = "1,5400073.990,500094.245,109.2,GND\n2,5400074.990,500095.1,109.3,GND\n3,5400073,500099.2,1";
	struct input_options options = {.format = "xyz", .has_pipe = true};
	struct err err = ERR_INIT;
	struct input *in;
	int fd = fixture_fd(text, sizeof text - 1), rc;

	options.pipe = fixture_fd("09.1,GND\n", 9);
	rc = input_open(fd, "a.txt", &options, &in, &err);
	assert_int_equal(rc, -ERR_INPUT);
	assert_non_null(strstr(err.hint, "_nez_"));
	close(options.pipe);
	close(fd);
}

struct survey {
	double at[3], step[2], noise;
	unsigned n[2], more;
	int places, order; /* rows first, columns first, any */
	bool general;      /* numbers as %g, without zeros behind */
};

static double between(uint64_t *roll, double low, double high)
{
	return low + (high - low) * (fixture_random(roll) / 4294967296.0);
}

static struct survey survey_of(uint64_t *roll)
{
	static const double origins[][2] = {{0, 0},     {1000, 5000},     {440750, 3751290}, {3500000, 5600000},
					    {-120, 30}, {984000, 200000}, {6500000, 25000}};
	const double *o = origins[fixture_random(roll) % 7];
	struct survey s = {{o[0], o[1], between(roll, -50, 9000)}, {1, 1}, 0};

	s.step[0] = fixture_random(roll) % 3 ? 1 : between(roll, 0.1, 60);
	s.step[1] = fixture_random(roll) % 3 ? s.step[0] : between(roll, 0.1, 60);
	s.noise = fixture_random(roll) % 2 ? 0 : 0.3;
	s.places = s.noise > 0 ? 1 + (int)(fixture_random(roll) % 4) : (int)(fixture_random(roll) % 5);
	s.order = (int)(fixture_random(roll) % 3);
	s.general = s.noise == 0 && fixture_random(roll) % 2;
	s.n[0] = 1 + fixture_random(roll) % 12;
	s.n[1] = 1 + fixture_random(roll) % 12;
	s.more = fixture_random(roll) % 6;
	return s;
}

static size_t number(const struct survey *s, double v, char end, char *ret)
{
	return (size_t)(s->general ? sprintf(ret, "%.10g%c", v, end) : sprintf(ret, "%.*f%c", s->places, v, end));
}

static size_t survey_row(const struct survey *s, unsigned i, unsigned k, uint64_t *roll, char *ret)
{
	static const char *const more[] = {"", "%u", "%u 1 2", "0.%u", "%u 2 255 0 17", "%u 0.5 0.25"};
	size_t n = number(s, s->at[0] + i * s->step[0] + between(roll, -s->noise, s->noise), ' ', ret);

	n += number(s, s->at[1] + k * s->step[1] + between(roll, -s->noise, s->noise), ' ', ret + n);
	n += number(s, s->at[2] + between(roll, 0, 20), ' ', ret + n);
	n += (size_t)sprintf(ret + n, more[s->more], (unsigned)(fixture_random(roll) % 65536));
	ret[n++] = '\n';
	return n;
}

/* Surveys of all kinds are x y z: grids and single lines of them, in either order and in none, whole or with decimals,
 * with and without other columns. Lines along an axis are regular ones. */
static void surveys_are_never_refused(void **state)
{
	static char text[1 << 16];
	uint64_t roll = 16;

	for (int round = 0; round < 20000; round++) {
		struct survey s = survey_of(&roll);
		unsigned all = s.n[0] * s.n[1];
		struct outcome out;
		size_t n = 0;

		for (unsigned j = 0; j < all; j++) {
			unsigned at = s.order == 2 ? fixture_random(&roll) % all : j;
			bool columns = s.order == 1;

			n += survey_row(&s, columns ? at / s.n[1] : at % s.n[0], columns ? at % s.n[1] : at / s.n[0], &roll,
					text + n);
		}
		out = fixture_read(text, n, "a.xyz", &defaults, 200);
		/* whole x of few columns beside decimals may be classes, for all that can be seen */
		if (out.code || (strstr(out.info.warning, "first column") &&
				 !(s.general && s.more == 3 && strstr(out.info.warning, "has only whole numbers"))))
			fail_msg("round %d: %s %s\n%.400s", round, out.err.message, out.info.warning, text);
		assert_int_equal(out.points, all);
	}
}

/* And lists with an index before the coordinates always are, with decimals or far from the origin. */
static void lists_are_always_refused(void **state)
{
	static char text[1 << 16];
	uint64_t roll = 17;

	for (int round = 0; round < 5000; round++) {
		bool far = fixture_random(&roll) % 2;
		unsigned rows = 3 + fixture_random(&roll) % 100, from = fixture_random(&roll) % 2000;
		int places = far ? (int)(fixture_random(&roll) % 4) : 3;
		double side = between(&roll, 5, 2000);
		struct outcome out;
		size_t n = 0;

		for (unsigned i = 0; i < rows; i++)
			n += (size_t)sprintf(text + n, "%u,%.*f,%.*f,%.*f,%s\n", from + i + (i > rows / 2 ? 7 : 0), places,
					     (far ? 5400000 : 1000) + between(&roll, 0, side), places,
					     (far ? 500000 : 1000) + between(&roll, 0, side), places, between(&roll, 90, 120),
					     i % 3 ? "GND" : "old tree");
		out = fixture_read(text, n, "a.xyz", &defaults, 200);
		if (out.code != ERR_INPUT || !strstr(out.err.hint, "_nez_"))
			fail_msg("round %d: %d %s\n%.400s", round, out.code, out.err.message, text);
	}
}

/* So are local ones that are not sorted, if their points have descriptions. */
static void unsorted_lists_are_always_refused(void **state)
{
	static char text[1 << 14];
	uint64_t roll = 18;

	for (int round = 0; round < 5000; round++) {
		unsigned rows = 1 + fixture_random(&roll) % 100;
		struct outcome out;
		size_t n = 0;

		for (unsigned i = 0; i < rows; i++)
			n += (size_t)sprintf(text + n, "%u,%.3f,%.3f,%.3f,%s\n", (unsigned)(fixture_random(&roll) % 5000),
					     between(&roll, 0, 5000), between(&roll, 0, 5000), between(&roll, 90, 120),
					     fixture_random(&roll) % 3 ? "GND" :
					     fixture_random(&roll) % 2 ? "" :
									 "old tree");
		out = fixture_read(text, n, "a.xyz", &defaults, 200);
		if (out.code != ERR_INPUT || !strstr(out.err.hint, "_nez_"))
			fail_msg("round %d: %d %s\n%.400s", round, out.code, out.err.message, text);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(names_in_heads),           cmocka_unit_test(names_and_widths),
		cmocka_unit_test(lines_before_points),      cmocka_unit_test(lines_of_units),
		cmocka_unit_test(heads_and_rows),           cmocka_unit_test(columns_without_names),
		cmocka_unit_test(columns_of_a_pipe),        cmocka_unit_test(surveys_are_never_refused),
		cmocka_unit_test(lists_are_always_refused), cmocka_unit_test(unsorted_lists_are_always_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
