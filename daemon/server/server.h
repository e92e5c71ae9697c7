/*
 * Connections, requests, rights: the wire side of the daemon. One thread, the loop (sd-event).
 */
#ifndef SERVER_H
#define SERVER_H

#include <stdbool.h>
#include <stdint.h>
#include <systemd/sd-event.h>

#include "rights.h"

struct err;
struct job;
struct service;
struct ledger;
struct server;

/* A setting of the daemon, for clients. */
struct server_setting {
	const char *name, *preset, *preset_told, *unit, *help;
	const char *origin; /* as acut.proto says */
	bool reload;
	unsigned line;
	char value[512], file[512];
};

struct server_params {
	sd_event *event; /* borrowed */
	struct ledger *ledger;
	const char *version, *state_dir, *cache_dir;
	uint64_t memory;
	unsigned threads;
	struct rights rights;         /* who is served */
	uint64_t memory_most;         /* that the control group leaves to all of the process; UINT64_MAX: no limit */
	uint64_t (*tasks_most)(void); /* likewise of tasks, as it is now */
	const char *warning;          /* that the start found, and a doctor repeats; NULL: none */
	unsigned user_connections;    /* of one user who is no admin, at once; 0: no limit */
	/* The settings, by number from 0; false: there are no more. */
	bool (*setting)(void *ctx, unsigned i, struct server_setting *ret);
	unsigned settings;
	void *setting_ctx;
};

int server_new(const struct server_params *, struct server **ret, struct err *err);
/* Closes what is open. NULL is fine; returns NULL. */
struct server *server_free(struct server *);
/* Before any connection. */
void server_set_service(struct server *, struct service *);
/* Other rules, also for who is connected: who is not served any more is cut off. */
void server_set_rights(struct server *, const struct rights *, unsigned user_connections);
/* Takes over a listening or a connected stream socket. */
int server_listen(struct server *, int fd, struct err *err);
int server_adopt(struct server *, int fd, struct err *err);
/* For service_params.changed (ctx is the server). */
void server_job_changed(void *server, struct job *);
/* After every round of the loop: what was closed goes. */
void server_settle(struct server *);
/* Whoever waits at a listening socket that nobody will serve is told why. Needs no server. */
void server_turn_away(int fd, const struct err *why);
/* No new connections; those that are there end, their pushes and bound jobs with them. */
void server_stop(struct server *);
/* One round of accept on all listening sockets; true if somebody came. */
bool server_accept_last(struct server *);
unsigned server_connections(const struct server *);
bool server_listens(const struct server *);

#endif
