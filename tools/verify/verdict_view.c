/*
 * Options of acut-verify that have lengths: they become lattice numbers when the mesh was read, which has the lattice and the
 * units (verdict.h). They are resolved as the words of a request, so they mean what they mean in acutctl.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "verdict.h"

static const char *known(const char *unit)
{
	return *unit ? unit : "unknown";
}

int verdict_view(struct verdict *v, struct err *err)
{
	if (!v->view_text)
		return 0;
	return view_resolve(v->view_text, &v->mesh.lattice, known(v->mesh.unit_xy), known(v->mesh.unit_z), &v->view, err);
}

int verdict_resolve(const struct verdict *v, const char *word, const char *value, struct view *ret, struct err *err)
{
	char *text;
	int r;

	if (strchr(value, ' '))
		return 1;
	if (asprintf(&text, "ask 1 %s=%s", word, value) < 0)
		return err_set(err, ERR_NOMEM, "no memory for --%s", word);
	r = view_resolve(text, &v->mesh.lattice, known(v->mesh.unit_xy), known(v->mesh.unit_z), ret, err);
	free(text);
	if (r != -ERR_PROTO)
		return r;
	err_clear(err);
	return 1;
}

int verdict_bound(struct verdict *v, struct err *err)
{
	struct view asked;
	int r = 0;

	if (v->bound_text)
		r = verdict_resolve(v, "max-error", v->bound_text, &asked, err);
	if (r == 1)
		return err_set(err, ERR_USAGE, "--max-error: \"%.60s\" is not a length", v->bound_text);
	if (r == -ERR_INPUT) /* the unit is unknown: another option helps, the mesh is not broken */
		err->code = ERR_USAGE;
	if (r)
		return -(int)err->code;
	v->bounded = v->bound_text || v->view.has_max_error;
	v->bound = v->bound_text ? asked.max_error : v->view.max_error;
	v->partial = v->bounded || v->view.max_points;
	if (v->bound_text)
		view_done(&asked);
	return 0;
}
