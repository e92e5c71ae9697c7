/*
 * Interprets the name of a column, in several languages: which coordinate it is, and its unit.
 *
 * Model: a name is split into tokens at everything that is neither letter nor digit; case, accents, quotes and brackets are
 * ignored. A token is a field, a unit, or noise, which has no meaning here (utm, point, coordinate). Some noise may precede or
 * follow a field within a token (PointX, xcoord). A name with any other token is unknown: "z error" is not z. Directions and
 * angles take precedence over X and Y: "X (East)" is an easting and "Hochwert X" a northing.
 *
 * X and Y alone are a field other than easting and northing. Heights in languages whose surveyors call the northing X are a field
 * other than the other heights. input_header.c decides the order of X and Y.
 */
#include "input_text_parts.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

enum { TOKEN = 32, TOKENS = 8 };

static const struct {
	enum input_field field;
	const char *words;
} fields[] = {
	{INPUT_FIELD_X, " x "},
	{INPUT_FIELD_Y, " y "},
	{INPUT_FIELD_Z, " z "},
	{INPUT_FIELD_EAST,
	 " e east easting eastings ost osten rechts rechtswert rw este est estx esting leste oost oosten ostlig ostlich oest "
	 "ita keleti wschod wschodnia vychod istok saga dogu "},
	{INPUT_FIELD_NORTH,
	 " n north northing northings nord norden hoch hochwert hw norte nor noord noorden nordlig nordlich pohjoinen eszaki "
	 "polnoc polnocna sever sjever yukari kuzey "},
	{INPUT_FIELD_HEIGHT,
	 " elevation elev elevations ele height heights hgt ht alt alti altitude cota quota altitud altezza altura hauteur hoogte "
	 "elevacion elevacao elevazione rl quotaslm cotasnm altitudsnm "},
	{INPUT_FIELD_LOCAL_HEIGHT,
	 " h hohe hoehe hohen hoehen hojd hojde hoyde kote kota vyska visina wysokosc rzedna korkeus magassag yukseklik kot "},
	{INPUT_FIELD_LON, " lon long longitude lng longitud longitudine lange laenge lengtegraad langengrad laengengrad "},
	{INPUT_FIELD_LAT, " lat latitude latitud latitudine breite breitengrad breedtegraad breddegrad latitudes "},
	{INPUT_FIELD_CLASS, " class classification classif klasse klass klassifikation classe clase clasificacion "},
	{INPUT_FIELD_RETURN, " return returnnumber returnno returnnr numberofreturn "},
	{INPUT_FIELD_RETURNS, " returns numberofreturns numreturns nreturns returncount "},
	{INPUT_FIELD_OTHER,
	 " id fid oid objectid p pkt punktnr punktnummer ptno ptid pointid pointnumber pointno pointname no nr num number nummer numero name "
	 "nombre nom nokta code kode codigo desc description descripcion beschreibung bemerkung remark comment d intensity "
	 "int intensitat amplitude reflectance time gpstime timestamp date datum zeit r g b red green blue rgb a alpha row "
	 "col column line zip nx ny nz scananglerank scanangle userdata pointsourceid edgeofflightline "},
};

static const struct {
	enum input_unit unit;
	const char *words;
} units[] = {
	{INPUT_UNIT_METRE, " m metre metres meter meters mtr metri metros "},
	{INPUT_UNIT_US_FOOT, " ftus usft usfeet usfoot ussurveyfeet ussurveyfoot surveyfeet surveyfoot usfeet sft "},
	{INPUT_UNIT_FOOT, " ift intlft internationalfeet internationalfoot "},
	{INPUT_UNIT_SOME_FOOT, " ft feet foot "},
	{INPUT_UNIT_DEGREE, " deg degree degrees dd decimaldegree decimaldegrees "},
	{INPUT_UNIT_OTHER_ANGLE, " rad radian radians gon grad grads dms ddmmss "},
	{INPUT_UNIT_OTHER, " mm cm km in inch inches yd yard yards link links chain chains "},
};

/* Longer ones before those that they begin with. */
static const char *const noise[] = {
	"coordinate",  "coordenada", "coordinata", "coordinaat", "coordonnee", "coords", "coord", "koordinate",
	"koordinaten", "koordinat",  "koord",      "position",   "point",      "punkt",  "punto", "ponto",
	"punt",        "pos",        "pt",         "utm",        "wert",       "deger",  "gps",   "wgs84",
	"etrs89",      "nad83",      "local",      "grid",       "map",
};
/* Tokens that are noise only as a whole, as are tokens that begin with a digit ("UTM 32N"). */
static const char silent[] =
	" value msl nn nhn nap ngf navd88 ellipsoidal ellip ell orthometric ortho wgs etrs epsg lv95 lv03 ln02 lambert93 l93 rd gk osgb "
	"gda94 gda2020 mga dhhn2016 dhhn92 u uber ueber ";

static bool has(const char *words, const char *token)
{
	char padded[TOKEN + 2];

	snprintf(padded, sizeof padded, " %s ", token);
	return *token && strstr(words, padded);
}

static enum input_field field_of(const char *token)
{
	for (size_t i = 0; i < sizeof fields / sizeof *fields; i++)
		if (has(fields[i].words, token))
			return fields[i].field;
	return INPUT_FIELD_NONE;
}

static enum input_unit unit_of(const char *token)
{
	for (size_t i = 0; i < sizeof units / sizeof *units; i++)
		if (has(units[i].words, token))
			return units[i].unit;
	return INPUT_UNIT_NONE;
}

/* A single letter counts only as x, y or z: "Punkte" is no easting. */
static enum input_field field_beside_noise(const char *rest)
{
	return rest[1] || strchr("xyz", *rest) ? field_of(rest) : INPUT_FIELD_NONE;
}

/* The field in a token, with noise before or after it. *ret_noise: the token is only noise. */
static enum input_field field_in(const char *token, bool *ret_noise)
{
	enum input_field field = field_of(token);
	size_t n = strlen(token);
	char rest[TOKEN];

	*ret_noise = field == INPUT_FIELD_NONE && (isdigit((unsigned char)*token) || has(silent, token));
	for (size_t i = 0; field == INPUT_FIELD_NONE && i < sizeof noise / sizeof *noise; i++) {
		size_t k = strlen(noise[i]);

		if (!strcmp(token, noise[i])) {
			*ret_noise = true;
			return INPUT_FIELD_NONE;
		}
		if (n <= k)
			continue;
		if (!memcmp(token, noise[i], k))
			field = field_beside_noise(token + k);
		snprintf(rest, sizeof rest, "%.*s", (int)(n - k), token);
		if (field == INPUT_FIELD_NONE && !strcmp(token + n - k, noise[i]))
			field = field_beside_noise(rest);
	}
	return field;
}

/* ---- letters ---- */

/* U+00C0 to U+017F without their accents; '-': no letter. */
static const char plain[] =
	"AAAAAAACEEEEIIIIDNOOOOO-OUUUUYTsaaaaaaaceeeeiiiidnooooo-ouuuuyty"
	"AaAaAaCcCcCcCcDdDdEeEeEeEeEeGgGgGgGgHhHhIiIiIiIiIiIiJjKkkLlLlLlLlLlNnNnNnnNnOoOoOoOoRrRrRrSsSsSsSsTtTtTtUuUuUuUuUuUuWwYyYZzZzZzs";

/* The next letter or digit as lower-case ASCII, 0 for a separator of tokens, '?' for a letter of another script. Bytes that are
 * not UTF-8 are read as Latin-1. */
static char letter_next(const char **at, const char *end)
{
	unsigned char c = (unsigned char)*(*at)++;
	unsigned code = c;
	bool follows = *at < end && ((unsigned char)**at & 0xc0) == 0x80;

	if (c < 0x80)
		return (char)(isalnum(c) ? tolower(c) : 0);
	if ((c & 0xe0) == 0xc0 && follows)
		code = (c & 0x1fu) << 6 | ((unsigned char)*(*at)++ & 0x3f);
	else if (c < 0xc0 || follows)
		return '?';
	if (code < 0xc0)
		return 0; /* signs: a degree, a no-break space */
	if (code >= 0x180)
		return '?';
	c = (unsigned char)plain[code - 0xc0];
	return (char)(isalpha(c) ? tolower(c) : 0);
}

struct tokens {
	char token[TOKENS][TOKEN], joined[TOKEN];
	unsigned n;
	bool too_long;
};

static void append(char text[TOKEN], char c, bool *too_long)
{
	size_t n = strlen(text);

	if (n + 1 >= TOKEN) {
		*too_long = true;
		return;
	}
	text[n] = c;
	text[n + 1] = 0;
}

/* The sign in the abbreviation of "number" (N\u00b0): a degree, or a small raised o. */
static bool is_number_sign(const char *token, const char *at, const char *end)
{
	return !strcmp(token, "n") && end - at >= 2 && (!memcmp(at, "\xc2\xb0", 2) || !memcmp(at, "\xc2\xba", 2));
}

static void tokens_of(struct input_line word, struct tokens *ret)
{
	bool within = false;

	memset(ret, 0, sizeof *ret);
	for (const char *p = word.at; p < word.end;) {
		bool number = within && is_number_sign(ret->token[ret->n - 1], p, word.end);
		char c = letter_next(&p, word.end);

		c = number ? 'o' : c;

		if (!c) {
			within = false;
			continue;
		}
		if (!within && ret->n == TOKENS) {
			ret->too_long = true;
			return;
		}
		ret->n += !within;
		within = true;
		append(ret->token[ret->n - 1], c, &ret->too_long);
		append(ret->joined, c, &ret->too_long);
	}
}

/* ---- names ---- */

static bool is_letter_axis(enum input_field f)
{
	return f == INPUT_FIELD_X || f == INPUT_FIELD_Y;
}

static bool is_direction(enum input_field f)
{
	return f == INPUT_FIELD_EAST || f == INPUT_FIELD_NORTH || f == INPUT_FIELD_LON || f == INPUT_FIELD_LAT;
}

static bool is_height(enum input_field f)
{
	return f == INPUT_FIELD_Z || f == INPUT_FIELD_HEIGHT || f == INPUT_FIELD_LOCAL_HEIGHT;
}

/* Two tokens of one name. */
static enum input_field both(enum input_field a, enum input_field b)
{
	if (a == b)
		return a;
	if (is_height(a) && is_height(b))
		return a == INPUT_FIELD_Z || b == INPUT_FIELD_Z ? INPUT_FIELD_Z : INPUT_FIELD_HEIGHT;
	if (is_direction(a) && is_letter_axis(b))
		return a;
	if (is_letter_axis(a) && is_direction(b))
		return b;
	return INPUT_FIELD_OTHER;
}

/* The unit that begins with token i: "us survey feet" has three. */
static enum input_unit unit_at(const struct tokens *t, unsigned i, unsigned *ret_n)
{
	char joined[3 * TOKEN];
	enum input_unit unit = INPUT_UNIT_NONE;

	for (unsigned n = 3; n && unit == INPUT_UNIT_NONE; n--) {
		if (i + n > t->n)
			continue;
		snprintf(joined, sizeof joined, "%s%s%s", t->token[i], n > 1 ? t->token[i + 1] : "",
			 n > 2 ? t->token[i + 2] : "");
		unit = strlen(joined) < TOKEN ? unit_of(joined) : INPUT_UNIT_NONE;
		*ret_n = n; /* 1 at the end, if there is none */
	}
	return unit;
}

struct input_name input_name_of(struct input_line word)
{
	struct input_name name = {INPUT_FIELD_NONE, INPUT_UNIT_NONE};
	bool any = false, noisy;
	struct tokens t;

	tokens_of(word, &t);
	if (t.too_long)
		return name;
	name.field = field_of(t.joined);
	if (name.field != INPUT_FIELD_NONE)
		return name;
	for (unsigned i = 0, n = 1; i < t.n; i += n, n = 1) {
		enum input_field field = field_in(t.token[i], &noisy);
		enum input_unit unit = field == INPUT_FIELD_NONE ? unit_at(&t, i, &n) : INPUT_UNIT_NONE;

		any |= noisy;
		if (field != INPUT_FIELD_NONE)
			name.field = name.field == INPUT_FIELD_NONE ? field : both(name.field, field);
		else if (unit != INPUT_UNIT_NONE)
			name.unit = unit;
		else if (!noisy)
			return (struct input_name){INPUT_FIELD_NONE, INPUT_UNIT_NONE};
	}
	if (name.field == INPUT_FIELD_NONE && any)
		name.field = INPUT_FIELD_OTHER; /* "Point" */
	return name;
}

bool input_name_is_phrase(struct input_line words)
{
	struct tokens t;

	tokens_of(words, &t);
	return !t.too_long && field_of(t.joined) != INPUT_FIELD_NONE;
}
