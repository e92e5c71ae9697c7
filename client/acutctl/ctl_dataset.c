/* dataset show NAME: what is in one dataset. Its other verbs belong to a later version. */
#include <math.h>
#include <string.h>

#include "ctl.h"
#include "ctl_dataset.h"
#include "parse.h"

void ctl_dataset_json(struct ctl *ctl, const struct acut_dataset *d)
{
	struct ctl_json j = { .out = ctl->report };

	ctl_json_open(&j, NULL, '{');
	ctl_json_text(&j, "name", d->name);
	ctl_json_u64(&j, "generation", d->generation);
	ctl_json_u64(&j, "points", d->points);
	ctl_json_u64(&j, "bytes", d->bytes);
	ctl_json_u64(&j, "files", d->files);
	ctl_json_u64(&j, "uid", d->uid);
	ctl_job_time(&j, "created", d->created_us);
	ctl_job_time(&j, "pushed", d->pushed_us);
	ctl_job_lattice(&j, d->lattice);
	ctl_job_units(&j, d->crs, d->unit_xy, d->unit_z);
	ctl_json_open(&j, "min", '[');
	for (int i = 0; i < 3; i++)
		ctl_json_number(&j, NULL, d->min[i]);
	ctl_json_close(&j, ']');
	ctl_json_open(&j, "max", '[');
	for (int i = 0; i < 3; i++)
		ctl_json_number(&j, NULL, d->max[i]);
	ctl_json_close(&j, ']');
	ctl_json_known(&j, "pending", d->pending);
	ctl_json_close(&j, '}');
	ctl_json_line(&j);
}

struct found {
	struct ctl *ctl;
	const char *name;
	bool any;
};

static void show(void *ctx, const struct acut_dataset *d)
{
	struct found *f = ctx;
	FILE *out = f->ctl->report;
	char a[32], b[32];

	if (strcmp(d->name, f->name))
		return;
	f->any = true;
	if (f->ctl->args.json) {
		ctl_dataset_json(f->ctl, d);
		return;
	}
	fprintf(out, "dataset     %s\ngeneration  %llu, of %u files\npoints      %s, %s\n", d->name,
		(unsigned long long)d->generation, d->files, ctl_job_count(d->points, a),
		parse_size_text(d->bytes, b));
	fprintf(out, "created     %s by user %u\npushed      %s\n", ctl_job_time_text(d->created_us, a),
		d->uid, ctl_job_time_text(d->pushed_us, b));
	fprintf(out, "lattice     %s\ncrs         %s\nunits       %s, heights %s\n", d->lattice, d->crs,
		d->unit_xy, d->unit_z);
	if (isfinite(d->min[0]) && isfinite(d->min[1]))
		fprintf(out, "box         %.15g %.15g to %.15g %.15g\n", d->min[0], d->min[1], d->max[0], d->max[1]);
	if (d->pending[0])
		fprintf(out, "pending     %s\n", d->pending);
}

int ctl_dataset_run(struct ctl *ctl)
{
	static const char *const later[] = { "log", "rm", "pin", "unpin" };
	char **word = ctl->args.word;
	struct found f = { .ctl = ctl, .name = word[1] };
	struct err err = ERR_INIT;
	int status;

	for (unsigned i = 0; i < sizeof(later) / sizeof(*later); i++) {
		if (!strcmp(word[0], later[i])) {
			err_set(&err, ERR_UNSUPPORTED, "dataset %s is not in this version of acut", later[i]);
			return ctl_error(ctl, &err);
		}
	}
	if (!strcmp(word[0], "create") && ctl->args.nword == 2)
		return ctl_dataset_create(ctl, word[1]);
	if (ctl->args.scale || ctl->args.crs) {
		err_set(&err, ERR_USAGE, "dataset %s takes no --%s", word[0], ctl->args.crs ? "crs" : "scale");
		return ctl_error(ctl, &err);
	}
	if (strcmp(word[0], "show") || ctl->args.nword != 2) {
		err_set(&err, ERR_USAGE,
			strcmp(word[0], "show") && strcmp(word[0], "create") ? "there is no command dataset %s"
						: "dataset %s takes one name",
			word[0]);
		err_add_hint(&err, "acutctl dataset show NAME, or create NAME");
		return ctl_error(ctl, &err);
	}
	status = ctl_connect(ctl);
	if (status)
		return status;
	if (acut_datasets(ctl->acut, f.name, show, &f))
		return ctl_error_acut(ctl);
	if (!f.any) {
		err_set(&err, ERR_NOTFOUND, "there is no dataset %s", f.name);
		return ctl_error(ctl, &err);
	}
	return CTL_DONE;
}
