/* Monitoring: the daemon's metrics, page by page, and its health check. */
#include <string.h>

#include "call.h"
#include "clock.h"

enum { LABELS = 8 }; /* of a sample; further ones are left out */

static void tell_family(const Acut__V1__MetricFamily *f, void (*each)(void *ctx, const struct acut_metric *), void *ctx)
{
	for (size_t i = 0; i < f->n_samples; i++) {
		const Acut__V1__MetricSample *s = f->samples[i];
		char *label[2 * LABELS];
		struct acut_metric out = {.name = f->name, .type = f->type, .help = f->help, .label = label, .value = s->value};

		for (size_t k = 0; k < s->n_labels && k < LABELS; k++) {
			label[2 * k] = s->labels[k]->name;
			label[2 * k + 1] = s->labels[k]->value;
			out.nlabel++;
		}
		each(ctx, &out);
	}
}

int acut_metrics(struct acut *a, void (*each)(void *ctx, const struct acut_metric *), void *ctx)
{
	Acut__V1__MetricsRequest req = ACUT__V1__METRICS_REQUEST__INIT;
	char cursor[256] = "";
	bool more = true;
	uint32_t id;
	int r = call_begin(a);

	req.cursor = cursor;
	while (r == 0 && more) {
		Acut__V1__Message *page;

		r = call_again(a, FRAME_MESSAGE(METRICS_REQUEST, metrics_request, &req), -1, ACUT__V1__MESSAGE__BODY_METRICS, &id,
			       &page);
		if (r < 0)
			break;
		for (size_t i = 0; i < page->metrics->n_families; i++)
			tell_family(page->metrics->families[i], each, ctx);
		more = *page->metrics->next != 0;
		/* For ever is too long. */
		if (more && (strlen(page->metrics->next) >= sizeof cursor || !strcmp(page->metrics->next, cursor)))
			r = err_set(&a->err, ERR_PROTO, "the daemon's pages of metrics do not come to an end");
		else
			strcpy(cursor, page->metrics->next);
		frame_message_free(page);
	}
	return r;
}

int acut_doctor(struct acut *a, void (*each)(void *ctx, const struct acut_check *), void *ctx)
{
	Acut__V1__DoctorRequest req = ACUT__V1__DOCTOR_REQUEST__INIT;
	int r;

	req.now_us = clock_real_us();
	r = call_ask(a, FRAME_MESSAGE(DOCTOR_REQUEST, doctor_request, &req), -1, ACUT__V1__MESSAGE__BODY_DOCTOR);
	for (size_t i = 0; r == 0 && i < a->answer->doctor->n_checks; i++) {
		const Acut__V1__DoctorCheck *c = a->answer->doctor->checks[i];

		each(ctx, &(const struct acut_check){.name = c->name, .state = c->state, .message = c->message, .hint = c->hint});
	}
	return r;
}
