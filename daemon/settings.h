/* The configuration of a daemon that runs: telling it, and reading it again. */
#ifndef SETTINGS_H
#define SETTINGS_H

#include <stdbool.h>

struct config;
struct service;
struct rights;
struct server;
struct server_setting;

/* For server_params.setting; ctx is the struct config. */
bool settings_tell(void *config, unsigned i, struct server_setting *ret);
void settings_rights(const struct config *, struct rights *ret);
/* Reads all again, tells the service manager, and lets hold what can be changed; the rest is told to need a restart. With
 * errors nothing changes. */
void settings_reload(struct config *, struct service *, struct server *);

#endif
