/* The configuration of a running daemon: reporting it, and reading it again. Loop. */
#ifndef SETTINGS_H
#define SETTINGS_H

#include <stdbool.h>

struct config;
struct core_limits;
struct service;
struct rights;
struct server;
struct server_setting;

/* For server_params.setting. */
bool settings_get(void *config, unsigned i, struct server_setting *ret);
/* What a start and a reload set. */
void settings_rights(const struct config *, struct rights *ret);
void settings_limits(const struct config *, struct core_limits *ret);
/* Reads everything again, and applies what a reload can change; a warning names what needs a restart. Notifies the service
 * manager. If there are errors, nothing changes. */
void settings_reload(struct config *, struct service *, struct server *);

#endif
