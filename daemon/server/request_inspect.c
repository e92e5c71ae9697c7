/* Requests about one file: its header, and all of its records. */
#include <stdio.h>
#include <string.h>

#include "inspect.h"
#include "server_priv.h"

/* A Probed with its texts. Scales and offsets are exact decimals. */
struct message_probed {
	Acut__V1__Probed probed;
	char scale[3][DECIMAL_TEXT_SIZE], offset[3][DECIMAL_TEXT_SIZE], *scales[3], *offsets[3];
	struct input_info info;
	char name[256], crs_name[256], warning[704];
};

/* The names of the EPSG codes: "PLANE", or "PLANE + HEIGHTS". */
static void crs_name_text(const struct crs_system *s, char *ret, size_t size)
{
	const char *plane = crs_epsg_name(s->epsg), *heights = crs_epsg_name(s->epsg_z);

	snprintf(ret, size, "%s%s%s", plane, *plane && *heights ? " + " : "", heights);
}

static void warning_text(const struct input_info *info, char *ret, size_t size)
{
	char remark[400];

	crs_epsg_remark(&info->crs, remark, sizeof remark);
	snprintf(ret, size, "%s%s%s", info->warning, *info->warning && *remark ? "; " : "", remark);
}

static void message_probed(const char *name, const struct input_info *info, const char *wkt, struct message_probed *m)
{
	static const char *const planes[] = {"unknown", "projected", "geographic", "geocentric"};
	int k;

	acut__v1__probed__init(&m->probed);
	m->info = *info;
	strncpy(m->name, name, sizeof m->name - 1);
	m->name[sizeof m->name - 1] = 0;
	for (k = 0; k < 3; k++) {
		m->scales[k] = decimal_text(info->coords.scale[k], m->scale[k]);
		m->offsets[k] = decimal_text(info->coords.offset[k], m->offset[k]);
	}
	m->probed.name = frame_text_clean(m->name);
	m->probed.format = (char *)info->format;
	m->probed.variant = frame_text_clean(m->info.variant);
	m->probed.points = info->claimed;
	m->probed.left_out = info->left_out;
	m->probed.left_out_line = info->left_out_line;
	m->probed.n_min = m->probed.n_max = m->probed.n_scale = m->probed.n_offset = 3;
	m->probed.min = m->info.coords.min;
	m->probed.max = m->info.coords.max;
	m->probed.scale = m->scales;
	m->probed.offset = m->offsets;
	m->probed.crs = frame_text_clean(m->info.crs.text);
	m->probed.unit_xy = frame_text_clean(m->info.crs.unit_xy);
	m->probed.unit_z = frame_text_clean(m->info.crs.unit_z);
	m->probed.datum = frame_text_clean(m->info.crs.system.datum);
	m->probed.epsg = info->crs.system.epsg;
	m->probed.epsg_z = info->crs.system.epsg_z;
	m->probed.plane = (char *)planes[info->crs.plane];
	crs_name_text(&info->crs.system, m->crs_name, sizeof m->crs_name);
	m->probed.crs_name = frame_text_clean(m->crs_name);
	warning_text(info, m->warning, sizeof m->warning);
	m->probed.warning = frame_text_clean(m->warning);
	m->probed.wkt = (char *)wkt;
}

void request_answer_probed(struct request *q, const char *name, const struct input_info *info, const char *wkt)
{
	struct message_probed m;

	message_probed(name, info, wkt, &m);
	request_answer(q, FRAME_MESSAGE(PROBED, probed, &m.probed));
}

static void on_header(void *token, const struct err *why, const char *name, const struct input_info *info, const char *wkt)
{
	if (why)
		request_refuse(token, why);
	else
		request_answer_probed(token, name, info, wkt);
}

static void on_inspected(void *token, const struct err *why, const struct inspect_result *res)
{
	Acut__V1__Inspected m = ACUT__V1__INSPECTED__INIT;
	char lattice[LATTICE_TEXT_SIZE], difference[INSPECT_DIFFERENCES][sizeof res->difference[0]];
	char *differences[INSPECT_DIFFERENCES];
	struct message_probed header;

	if (why) {
		request_refuse(token, why);
		return;
	}
	message_probed(res->name, &res->info, res->wkt, &header);
	m.header = &header.probed;
	m.points = res->in.points;
	m.distinct = res->in.distinct;
	m.n_min = m.n_max = res->in.points ? 3 : 0;
	m.min = (double *)res->in.min;
	m.max = (double *)res->in.max;
	m.n_inner_min = m.n_inner_max = m.n_min;
	m.inner_min = (double *)res->in.inner_min;
	m.inner_max = (double *)res->in.inner_max;
	m.most_points = res->in.most.points;
	m.most_x = res->in.most_at[0];
	m.most_y = res->in.most_at[1];
	m.n_classes = 256;
	m.classes = (uint64_t *)res->in.classes;
	m.n_returns = m.n_return_counts = 16;
	m.returns = (uint64_t *)res->in.returns;
	m.return_counts = (uint64_t *)res->in.return_counts;
	m.n_flags = 4;
	m.flags = (uint64_t *)res->in.flags;
	m.hull_corners = (uint32_t)res->in.nhull;
	m.hull_thinned = res->in.hull_thinned;
	m.hull_area = res->in.hull_area;
	m.lattice = lattice_text(&res->lattice, lattice);
	m.has_place = res->has_place;
	m.no_place = (char *)res->no_place;
	m.area = res->area;
	m.perimeter = res->perimeter;
	m.south = res->south;
	m.west = res->west;
	m.north = res->north;
	m.east = res->east;
	m.mgrs = (char *)res->mgrs;
	m.n_differences = res->ndifferences;
	m.differences = differences;
	for (unsigned i = 0; i < res->ndifferences; i++) {
		memcpy(difference[i], res->difference[i], sizeof difference[i]);
		differences[i] = frame_text_clean(difference[i]);
	}
	request_answer(token, FRAME_MESSAGE(INSPECTED, inspected, &m));
}

void request_info(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const Acut__V1__InfoRequest *r = m->info_request;
	const struct inspect_input in = {fd, r->name, r->format, r->columns, r->decimal_comma};

	inspect_header(c->server->service->core, &in, &c->peer, on_header, q);
}

void request_inspect(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const Acut__V1__Inspect *r = m->inspect;
	const struct inspect_input in = {fd, r->name, r->format, r->columns, r->decimal_comma};

	inspect_file(c->server->service->core, &in, &c->peer, on_inspected, q);
}
