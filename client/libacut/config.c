/* The settings of the daemon. */
#include "call.h"

int acut_config(struct acut *a, void (*each)(void *ctx, const struct acut_setting *), void *ctx)
{
	Acut__V1__SettingsRequest req = ACUT__V1__SETTINGS_REQUEST__INIT;
	const Acut__V1__Settings *s;
	int r = call_ask(a, FRAME_MESSAGE(SETTINGS_REQUEST, settings_request, &req), -1, ACUT__V1__MESSAGE__BODY_SETTINGS);

	if (r < 0)
		return r;
	s = a->answer->settings;
	for (size_t i = 0; i < s->n_settings; i++) {
		const Acut__V1__Setting *m = s->settings[i];
		const struct acut_setting out = {
			.name = m->name,
			.value = m->value,
			.preset = m->preset,
			.preset_told = m->preset_told,
			.unit = m->unit,
			.help = m->help,
			.origin = m->origin,
			.file = m->file,
			.line = m->line,
			.reload = m->reload,
		};

		each(ctx, &out);
	}
	return 0;
}
