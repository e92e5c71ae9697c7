/*
 * The connection: connect, greet, close; its error; the short requests. Both sides send HELLO first, which settles the
 * version of the messages.
 */
#include "call.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include "clock.h"

#define ERR(name, wire, status, text) \
	_Static_assert((int)ACUT_E_##name == (int)ERR_##name, "acut.h and err.def disagree on " #name);
#include "err.def"
#undef ERR

static struct acut *acut_alloc(const struct acut_options *options)
{
	struct acut *a = calloc(1, sizeof *a);

	if (!a)
		return NULL;
	a->err = a->dead = ERR_INIT;
	if (options)
		a->options = *options;
	snprintf(a->program, sizeof a->program, "%s", options && options->program ? options->program : "libacut");
	frame_text_clean(a->program);
	a->options.program = a->program;
	return a;
}

static const struct {
	enum call_feature bit;
	const char *name, *what;
} features[] = {
	{CALL_MODE, "mode", "a mode for new datasets (--mode)"},
	{CALL_DECIMAL_COMMA, "decimal-comma", "decimal commas (--decimal-comma)"},
	{CALL_OVERRIDE, "override", "systems and units in place of those of files (--override-crs, --override-units)"},
};
enum { FEATURES = sizeof features / sizeof *features };

static unsigned features_of(const Acut__V1__Hello *hello)
{
	unsigned all = 0;

	for (size_t i = 0; i < hello->n_features; i++)
		for (unsigned k = 0; k < FEATURES; k++)
			all |= strcmp(hello->features[i], features[k].name) ? 0 : (unsigned)features[k].bit;
	return all;
}

int call_needs(struct acut *a, enum call_feature bit)
{
	unsigned k = 0;

	if (a->features & bit)
		return 0;
	while (features[k].bit != bit)
		k++;
	err_set(&a->err, ERR_VERSION, "the daemon (acutd %s) does not know %s", a->build, features[k].what);
	return err_add_hint(&a->err, "leave the option out, or use an acutd of the release of this program (%s)", ACUT_VERSION);
}

static int check_hello(struct acut *a, const Acut__V1__Hello *hello)
{
	if (hello->version_min > FRAME_PROTOCOL_MAX || hello->version_max < FRAME_PROTOCOL_MIN) {
		err_set(&a->err, ERR_VERSION, "the daemon speaks protocol versions %u to %u, this program %u to %u",
			hello->version_min, hello->version_max, FRAME_PROTOCOL_MIN, FRAME_PROTOCOL_MAX);
		return err_add_hint(&a->err, "use acutctl and acutd of the same release");
	}
	snprintf(a->build, sizeof a->build, "%s", hello->build);
	a->features = features_of(hello);
	return 0;
}

static int greet(struct acut *a)
{
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;
	int r;

	hello.version_min = FRAME_PROTOCOL_MIN;
	hello.version_max = FRAME_PROTOCOL_MAX;
	hello.build = ACUT_VERSION;
	hello.program = a->program;
	r = call_ask(a, FRAME_MESSAGE(HELLO, hello, &hello), -1, ACUT__V1__MESSAGE__BODY_HELLO);
	return r < 0 ? r : check_hello(a, a->answer->hello);
}

static int attach(struct acut *a, int fd)
{
	static const struct frame_limits limits = {.message = 16 << 20};
	int r = frame_conn_new(fd, &limits, &a->conn, &a->err);

	if (r < 0)
		close(fd);
	else
		r = greet(a);
	if (r < 0 && !a->dead.code)
		a->dead = a->err;
	return r;
}

int acut_attach(int fd, const struct acut_options *options, struct acut **ret)
{
	*ret = acut_alloc(options);
	if (!*ret) {
		close(fd);
		return -ACUT_E_NOMEM;
	}
	return attach(*ret, fd);
}

/* While the daemon's queue of connections is full, this waits in the kernel's queue and checks now and then whether it was
 * asked to stop. A client that connected again and again would lose its turn each time. */
static int connect_fd(struct acut *a, int fd, const struct sockaddr_un *address)
{
	const struct timeval now_and_then = {.tv_usec = 50000};
	uint64_t since = clock_mono_ns();

	if (setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &now_and_then, sizeof now_and_then) != 0)
		return err_sys(&a->err, errno, "cannot set up a socket");
	while (connect(fd, (const struct sockaddr *)address, sizeof *address) < 0) {
		if (errno == EISCONN)
			return 0;
		if (errno == ENOENT || errno == ECONNREFUSED || errno == ENOTDIR || errno == ENOTSOCK) {
			err_set(&a->err, ERR_NODAEMON, "no daemon answers at %s: %s", address->sun_path, strerror(errno));
			return err_add_hint(&a->err, "start acutd, or give its socket with --socket");
		}
		if (errno != EAGAIN && errno != EINTR)
			return err_sys(&a->err, errno, "cannot connect to %s", address->sun_path);
		if (a->options.interrupted && a->options.interrupted(a->options.ctx))
			return err_set(&a->err, ERR_CANCELLED, "interrupted");
		if (a->options.timeout > 0 && clock_since(since) > a->options.timeout)
			return err_set(&a->err, ERR_TIMEOUT, "the daemon at %s took no connection within %g s", address->sun_path,
				       a->options.timeout);
	}
	return 0;
}

static int connect_path(struct acut *a, const char *path)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	int fd, r;

	if (strlen(path) >= sizeof address.sun_path)
		return err_set(&a->err, ERR_USAGE, "the socket's path is longer than %zu bytes: %s", sizeof address.sun_path - 1,
			       path);
	strcpy(address.sun_path, path);
	fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	if (fd < 0)
		return err_sys(&a->err, errno, "cannot make a socket");
	r = connect_fd(a, fd, &address);
	if (r < 0) {
		close(fd);
		a->dead = a->err;
		return r;
	}
	return attach(a, fd);
}

int acut_connect(const char *socket_path, const struct acut_options *options, struct acut **ret)
{
	int r;

	*ret = acut_alloc(options);
	if (!*ret)
		return -ACUT_E_NOMEM;
	r = connect_path(*ret, socket_path);
	if (r < 0 && !(*ret)->dead.code)
		(*ret)->dead = (*ret)->err;
	return r;
}

struct acut *acut_close(struct acut *a)
{
	if (!a)
		return NULL;
	while (a->pushes)
		acut_push_leave(a->pushes);
	fetch_free(a->fetch);
	free(a->area);
	frame_message_free(a->answer);
	free(a->rows);
	frame_conn_free(a->conn);
	free(a);
	return NULL;
}

void call_failure(const struct err *err, struct acut_failure *ret)
{
	*ret = (struct acut_failure){
		.code = (int)err->code,
		.name = err->code ? err_wire_name(err->code) : "",
		.exit_status = err->code ? err_exit_status(err->code) : 0,
		.message = err->message,
		.file = err->file,
		.field = err->field,
		.hint = err->hint,
		.offset = err->offset,
	};
}

const struct acut_failure *acut_error(const struct acut *a)
{
	static const struct acut_failure no_memory = {
		.code = ACUT_E_NOMEM,
		.name = "out-of-memory",
		.exit_status = 75,
		.message = "there is no memory for a connection",
		.file = "",
		.field = "",
		.hint = "",
		.offset = UINT64_MAX,
	};

	if (!a)
		return &no_memory;
	/* The texts live in a->err; only the view of them is made anew. */
	call_failure(&a->err, &((struct acut *)a)->failure);
	return &a->failure;
}

int acut_fd(const struct acut *a)
{
	return a->conn ? frame_conn_fd(a->conn) : -1;
}

const char *acut_version(void)
{
	return ACUT_VERSION;
}

const char *acut_daemon_build(const struct acut *a)
{
	return a->build;
}

int acut_dispatch(struct acut *a)
{
	Acut__V1__Message *m;
	int fd, r = call_begin(a);

	while (r == 0)
		r = call_pump(a, 0, &m, &fd);
	return r == FRAME_E_AGAIN ? 0 : r;
}

int acut_ping(struct acut *a, double *ret_seconds)
{
	Acut__V1__Ping ping = ACUT__V1__PING__INIT;
	uint64_t start = clock_mono_ns();
	int r = call_ask(a, FRAME_MESSAGE(PING, ping, &ping), -1, ACUT__V1__MESSAGE__BODY_DONE);

	if (r == 0)
		*ret_seconds = clock_since(start);
	return r;
}

/* Everything in one allocation: the holders, then the entries of all. */
static int status_rows(struct acut *a, const Acut__V1__Status *s)
{
	size_t n = s->n_ledger;
	struct acut_holder *holders;
	struct acut_ledger_entry *rows;

	for (size_t i = 0; i < s->n_holders; i++)
		n += s->holders[i]->n_held;
	a->rows = calloc(1, (s->n_holders + 1) * sizeof *holders + (n + 1) * sizeof *rows);
	if (!a->rows)
		return err_set(&a->err, ERR_NOMEM, "there is no memory for a status");
	holders = a->rows;
	rows = (struct acut_ledger_entry *)(holders + s->n_holders + 1);
	a->status.ledger = rows;
	a->status.nledger = s->n_ledger;
	for (size_t i = 0; i < s->n_ledger; i++)
		*rows++ = (struct acut_ledger_entry){s->ledger[i]->name, s->ledger[i]->bytes, s->ledger[i]->peak};
	for (size_t i = 0; i < s->n_holders; i++) {
		const Acut__V1__LedgerHolder *h = s->holders[i];

		holders[i] = (struct acut_holder){h->kind, h->what, h->id, h->uid, h->pid, rows, h->n_held};
		for (size_t k = 0; k < h->n_held; k++)
			*rows++ = (struct acut_ledger_entry){h->held[k]->name, h->held[k]->bytes, 0};
	}
	a->status.holders = holders;
	a->status.nholders = s->n_holders;
	return 0;
}

int acut_status(struct acut *a, const struct acut_status **ret)
{
	Acut__V1__StatusRequest req = ACUT__V1__STATUS_REQUEST__INIT;
	const Acut__V1__Status *s;
	int r = call_ask(a, FRAME_MESSAGE(STATUS_REQUEST, status_request, &req), -1, ACUT__V1__MESSAGE__BODY_STATUS);

	if (r < 0)
		return r;
	s = a->answer->status;
	a->status = (struct acut_status){
		.version = s->version,
		.state_dir = s->state_dir,
		.cache_dir = s->cache_dir,
		.pid = s->pid,
		.memory = s->memory,
		.peak_rss_bytes = s->peak_rss_bytes,
		.threads = s->threads,
		.jobs_running = s->jobs_running,
		.jobs_waiting = s->jobs_waiting,
		.connections = s->connections,
		.uptime_seconds = s->uptime_seconds,
		.holders_more = s->holders_more,
		.pipe_capacity = s->pipe_capacity,
		.ledger_peak = s->ledger_peak,
		.rss_bytes = s->rss_bytes,
		.disk_limit = s->disk_limit,
		.keep_free_limit = s->keep_free_limit,
		.one_file_system = s->one_file_system,
	};
	call_side(s->state_space, &a->status.state_side);
	call_side(s->cache_space, &a->status.cache_side);
	r = status_rows(a, s);
	if (r == 0)
		*ret = &a->status;
	return r;
}
