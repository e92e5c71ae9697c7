/* Names of the files of a dataset, by their numbers. */
#ifndef CTL_REPORT_NAMES_H
#define CTL_REPORT_NAMES_H

#include "ctl_report.h"

struct ctl_report_names {
	struct ctl_report_name {
		uint32_t source, at; /* at: in the text */
	} * row;
	char *text;
	size_t n, room, used, size;
	bool full;
};

/* Names are a help: where they cannot be read there are none. At most 16 MiB of them are kept. */
void ctl_report_names_read(struct acut *, const char *dataset, struct ctl_report_names *);
const char *ctl_report_name_of(const struct ctl_report_names *, uint32_t source); /* NULL: it is not known */
void ctl_report_names_free(struct ctl_report_names *);

#endif
