/* ingest: one pass over a drop folder. */
#include "ctl.h"
#include "ctl_ingest.h"

int ctl_ingest_run(struct program *ctl)
{
	return ctl_ingest(&ctl->session, &ctl->stage, &ctl->input, ctl->line.word[0], ctl->line.word[1], ctl->opt.settle);
}
