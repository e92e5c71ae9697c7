/* The settings of the daemon, for every client. The server gets them by a callback of its parameters. */
#include <stdlib.h>

#include "server_priv.h"

struct setting_row {
	struct server_setting setting;
	Acut__V1__Setting message;
};

static void setting_message(struct setting_row *r)
{
	const struct server_setting *s = &r->setting;
	Acut__V1__Setting *m = &r->message;

	acut__v1__setting__init(m);
	m->name = (char *)s->name;
	m->value = (char *)s->value;
	m->preset = (char *)s->preset;
	m->preset_told = (char *)s->preset_text;
	m->unit = (char *)s->unit;
	m->help = (char *)s->help;
	m->origin = (char *)s->origin;
	m->file = (char *)s->file;
	m->line = s->line;
	m->reload = s->reload;
}

void request_config(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const struct server_params *p = &c->server->p;
	Acut__V1__Settings answer = ACUT__V1__SETTINGS__INIT;
	struct setting_row *rows = calloc(p->settings + 1, sizeof *rows);
	Acut__V1__Setting **list = calloc(p->settings + 1, sizeof *list);
	struct err err = ERR_INIT;

	if (rows && list) {
		while (answer.n_settings < p->settings &&
		       p->setting(p->setting_ctx, (unsigned)answer.n_settings, &rows[answer.n_settings].setting)) {
			setting_message(&rows[answer.n_settings]);
			list[answer.n_settings] = &rows[answer.n_settings].message;
			answer.n_settings++;
		}
		answer.settings = list;
		request_answer(q, FRAME_MESSAGE(SETTINGS, settings, &answer));
	} else {
		err_set(&err, ERR_NOMEM, "there is no memory for an answer");
		request_refuse(q, &err);
	}
	free(list);
	free(rows);
}
