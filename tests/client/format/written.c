#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "folder.h"
#include "written.h"

static char out[512];

const struct meshes_spec written_grid = {.columns = 50,
					 .rows = 33,
					 .strip = 5,
					 .x0 = -7000,
					 .y0 = 123,
					 .step = 100,
					 .slope_x = 10,
					 .slope_y = -7,
					 .scale_xy = "0.01",
					 .scale_z = "0.001",
					 .k = {50000000, 400000000, -12}};

int written_as(const char *name, const struct meshes *m, const struct format_options *opt, const struct outputs_options *ropt,
	       struct outputs_report *report, struct err *err)
{
	const struct outputs_options plain = {0};

	snprintf(out, sizeof(out), "%s/out.%s", folder_own, name);
	return meshes_write(m, out, format_find(name), opt, ropt ? ropt : &plain, report, err);
}

const char *written_path(void)
{
	return out;
}

int written_run(const struct CMUnitTest *tests, size_t n)
{
	return _cmocka_run_group_tests("tests", tests, n, folder_begin, folder_end);
}
