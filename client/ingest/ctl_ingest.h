/* One pass over a drop folder. */
#ifndef CTL_INGEST_H
#define CTL_INGEST_H

#include "ctl_report.h"

/* Pushes what has settled into the dataset, and moves it to done/ or failed/. `settle`: a time without changes; NULL: 30 s.
 * Prints its failures; exit status. */
int ctl_ingest(struct session *, const struct ctl_stage_options *, const struct ctl_input_options *, const char *dataset,
	       const char *folder, const char *settle);

#endif
