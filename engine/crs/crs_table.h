/*
 * The systems that EPSG numbers, as PROJ's database has them: made by build-aux/epsg-table when acut is built.
 * Read by crs_epsg.c alone.
 */
#ifndef CRS_TABLE_H
#define CRS_TABLE_H

#include <stdint.h>

enum crs_table_kind {
	CRS_TABLE_PROJECTED,
	CRS_TABLE_GEOGRAPHIC,
	CRS_TABLE_GEOGRAPHIC_3D,
	CRS_TABLE_GEOCENTRIC,
	CRS_TABLE_VERTICAL,
	CRS_TABLE_COMPOUND,
};

struct crs_table_row {
	uint32_t name;   /* place in crs_table_text */
	uint32_t code;   /* ascending */
	uint16_t first;  /* its datum; of a compound system that of x and y; 0: none with a number */
	uint16_t second; /* of a compound system that of heights */
	uint8_t kind;
	uint8_t unit, unit_z; /* of x and y, of z: places in crs_table_units; 0: none */
	uint8_t deprecated;
};

struct crs_table_unit {
	uint16_t code; /* EPSG number */
	uint32_t name;
};

extern const struct crs_table_row crs_table_rows[];
extern const unsigned crs_table_n;
extern const struct crs_table_unit crs_table_units[];
extern const char crs_table_text[];

#endif
