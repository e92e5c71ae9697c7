/*
 * The server: connections, requests and permissions, on the side of the wire. It knows the protocol, and no geometry. One thread,
 * the loop (sd-event); functions belong to it, and assert that.
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

/* A setting of the daemon, as clients see it. */
struct server_setting {
	const char *name, *preset, *preset_text, *unit, *help;
	const char *origin; /* as acut.proto says */
	bool reload;
	unsigned line;
	char value[512], file[512];
};

/* Pointers are borrowed, until server_free. */
struct server_params {
	sd_event *event;
	struct ledger *ledger;
	const char *version, *state_dir, *cache_dir;
	uint64_t memory; /* the budget, in bytes */
	unsigned threads;
	struct rights rights;
	uint64_t memory_most;         /* bytes that the control group allows the process; UINT64_MAX: no limit */
	uint64_t (*tasks_most)(void); /* likewise tasks, as it is now; NULL: no limit */
	const char *warning;          /* of the start, which a doctor repeats; NULL: none */
	unsigned user_connections;    /* open connections of one user who is no administrator; 0: no limit */
	/* The settings, by number from 0; false: there are no more. */
	bool (*setting)(void *ctx, unsigned i, struct server_setting *ret);
	unsigned settings;
	void *setting_ctx;
};

int server_new(const struct server_params *, struct server **ret, struct err *err);
/* Closes listening sockets and connections. NULL is fine; returns NULL. */
struct server *server_free(struct server *);
/* Before the first connection. Borrowed. */
void server_set_service(struct server *, struct service *);
/* New rules and limits. Clients that are not served under them any more are disconnected. */
void server_set_rights(struct server *, const struct rights *, unsigned user_connections);
/* Both take over the descriptor if they succeed: a listening socket; a connected one. */
int server_listen(struct server *, int fd, struct err *err);
int server_adopt(struct server *, int fd, struct err *err);
/* For service_params.changed (ctx is the server). */
void server_job_changed(void *server, struct job *);
/* Frees closed connections. After every round of the loop. */
void server_settle(struct server *);
/* Sends the error to all clients that wait at a listening socket. For a start that failed: needs no server. */
void server_refuse_waiting(int fd, const struct err *why);
/* Closes listening sockets and connections; pushes and bound jobs end with their connections. */
void server_stop(struct server *);
/* Accepts one client of each listening socket. False: none waits. */
bool server_accept_remaining(struct server *);
unsigned server_connection_count(const struct server *);
bool server_is_listening(const struct server *);

#endif
