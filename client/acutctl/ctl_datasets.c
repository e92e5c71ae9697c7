/* datasets: one line a dataset. */
#include "ctl.h"
#include "ctl_dataset.h"
#include "parse.h"

static void each(void *ctx, const struct acut_dataset *d)
{
	struct ctl *ctl = ctx;
	char count[32], size[32];

	if (ctl->args.json)
		ctl_dataset_json(ctl, d);
	else
		fprintf(ctl->report, "%-24s generation %-4llu %14s points  %5u files  %s%s\n", d->name,
			(unsigned long long)d->generation, ctl_job_count(d->points, count), d->files,
			parse_size_text(d->bytes, size), d->pending[0] ? "  (push pending)" : "");
}

static void each_removed(void *ctx, const struct acut_dataset *d)
{
	struct ctl *ctl = ctx;
	char count[32], size[32], until[32];

	if (ctl->args.json)
		ctl_dataset_json(ctl, d);
	else
		fprintf(ctl->report, "%6llu  %-24s %14s points  %5u files  %s  until %s\n", (unsigned long long)d->id, d->name,
			ctl_job_count(d->points, count), d->files, parse_size_text(d->bytes, size),
			ctl_job_time_text(d->until_us, until));
}

int ctl_datasets_run(struct ctl *ctl)
{
	int status = ctl_connect(ctl);

	ctl->list = true;

	if (!status && (ctl->args.removed ? acut_datasets_removed(ctl->acut, each_removed, ctl)
					  : acut_datasets(ctl->acut, NULL, each, ctl)))
		status = ctl_error_acut(ctl);
	return status;
}
