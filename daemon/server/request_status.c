/*
 * Status: the daemon's parameters, and the holders of its memory.
 *
 * The model: the ledger has the sums by account. The service reports what each job, stream, plan and push holds; the server knows
 * the connections. An answer is one frame, so if there are very many holders, only the largest are listed. A user who is no
 * administrator sees of the holders of others the user and the bytes, but neither number nor dataset.
 */
#include <stdlib.h>
#include <unistd.h>

#include "clock.h"
#include "rights.h"
#include "process.h"
#include "server_priv.h"

enum { HOLDERS_MAX = 200 };

struct holder {
	struct core_holder h;
	uint64_t sum;
	Acut__V1__LedgerHolder message;
	Acut__V1__LedgerEntry entry[LEDGER_NAMES], *list[LEDGER_NAMES];
};

/* A heap of the largest holders. The first is the smallest of them, and the next to be replaced. */
struct answer {
	const struct peer *peer; /* of the request */
	size_t n, more;
	struct holder *heap[HOLDERS_MAX];
	struct holder holder[HOLDERS_MAX];
	Acut__V1__LedgerHolder *list[HOLDERS_MAX];
	Acut__V1__LedgerEntry entry[LEDGER_NAMES], *entries[LEDGER_NAMES];
	uint64_t pipes;
};

static void sift_down(struct answer *a, size_t i)
{
	for (;;) {
		size_t least = i, k;

		for (k = 2 * i + 1; k <= 2 * i + 2 && k < a->n; k++)
			if (a->heap[k]->sum < a->heap[least]->sum)
				least = k;
		if (least == i)
			return;
		struct holder *h = a->heap[i];

		a->heap[i] = a->heap[least];
		a->heap[least] = h;
		i = least;
	}
}

static void add_holder(void *ctx, const struct core_holder *h)
{
	struct answer *a = ctx;
	struct holder *to;
	uint64_t sum = 0;

	for (int i = 0; i < LEDGER_NAMES; i++)
		sum += h->held[i];
	if (a->n < HOLDERS_MAX) {
		to = a->heap[a->n] = &a->holder[a->n];
		a->n++;
	} else {
		a->more++;
		to = a->heap[0];
		if (sum <= to->sum)
			return;
	}
	to->h = *h;
	if (!rights_acts_as(a->peer, h->peer.uid)) {
		to->h.id = 0;
		to->h.dataset = "";
	}
	to->sum = sum;
	if (a->n == HOLDERS_MAX)
		for (size_t i = a->more ? 1 : HOLDERS_MAX / 2; i-- > 0;)
			sift_down(a, i);
}

static void add_conns(struct answer *a, const struct server *s)
{
	const struct conn *c;

	for (c = s->conns; c; c = c->next) {
		struct core_holder h = {.kind = "connection", .id = c->number, .peer = c->peer, .dataset = ""};

		h.held[LEDGER_MESSAGE] = conn_held(c);
		h.held[LEDGER_PIPE] = stream_out_held(c);
		add_holder(a, &h);
		a->pipes += stream_out_pipes(c);
	}
}

static int most_first(const void *a, const void *b)
{
	const struct holder *x = *(struct holder *const *)a, *y = *(struct holder *const *)b;

	return x->sum < y->sum ? 1 : x->sum > y->sum ? -1 : 0;
}

static void holder_message(struct holder *h)
{
	Acut__V1__LedgerHolder *m = &h->message;

	acut__v1__ledger_holder__init(m);
	m->kind = (char *)h->h.kind;
	m->id = h->h.id;
	m->uid = h->h.peer.uid;
	m->pid = h->h.peer.pid;
	m->what = (char *)(h->h.dataset ? h->h.dataset : "");
	m->held = h->list;
	for (int i = 0; i < LEDGER_NAMES; i++) {
		Acut__V1__LedgerEntry *e = &h->entry[m->n_held];

		if (!h->h.held[i])
			continue;
		acut__v1__ledger_entry__init(e);
		e->name = (char *)ledger_name_text((enum ledger_name)i);
		e->bytes = h->h.held[i];
		h->list[m->n_held++] = e;
	}
}

static void ledger_message(struct answer *a, struct ledger *l, Acut__V1__Status *ret)
{
	for (int i = 0; i < LEDGER_NAMES; i++) {
		acut__v1__ledger_entry__init(&a->entry[i]);
		a->entry[i].name = (char *)ledger_name_text((enum ledger_name)i);
		a->entry[i].bytes = ledger_held(l, (enum ledger_name)i);
		a->entry[i].peak = ledger_peak(l, (enum ledger_name)i);
		a->entries[i] = &a->entry[i];
	}
	ret->n_ledger = LEDGER_NAMES;
	ret->ledger = a->entries;
	ret->ledger_peak = ledger_peak_all(l);
}

void request_status(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct server *s = c->server;
	Acut__V1__Status status = ACUT__V1__STATUS__INIT;
	struct answer *a = calloc(1, sizeof *a);
	Acut__V1__CacheSide state, cache;
	struct cache_stat disk;
	struct err err = ERR_INIT;

	if (!a) {
		err_set(&err, ERR_NOMEM, "no memory for a status");
		request_refuse(q, &err);
		return;
	}
	/* Workers take memory meanwhile, and only the loop gives it back. So the holders and the resident size are read before
	 * the sums of the ledger. Otherwise they could exceed the sums. For the same reason the peak is read after the size. */
	status.rss_bytes = process_rss();
	status.peak_rss_bytes = process_peak_rss();
	a->peer = &c->peer;
	service_holders(s->service, add_holder, a);
	add_conns(a, s);
	ledger_message(a, s->p.ledger, &status);
	qsort(a->heap, a->n, sizeof *a->heap, most_first);
	for (size_t i = 0; i < a->n; i++) {
		holder_message(a->heap[i]);
		a->list[i] = &a->heap[i]->message;
	}
	status.version = (char *)s->p.version;
	status.pid = (uint64_t)getpid();
	status.memory = s->p.memory;
	status.threads = s->p.threads;
	status.uptime_seconds = clock_since(s->started_ns);
	status.pipe_capacity = a->pipes;
	status.n_holders = a->n;
	status.holders = a->list;
	status.holders_more = (uint32_t)a->more;
	jobs_count(s->service->jobs, &status.jobs_running, &status.jobs_waiting);
	status.connections = server_connection_count(s);
	status.state_dir = (char *)s->p.state_dir;
	status.cache_dir = (char *)s->p.cache_dir;
	cache_stat(s->service->maintenance, &disk);
	message_side(&disk.space.state, &state);
	message_side(&disk.space.cache, &cache);
	status.disk_limit = disk.disk;
	status.keep_free_limit = disk.keep_free;
	status.state_space = &state;
	status.cache_space = &cache;
	status.one_file_system = disk.space.one_fs;
	while (status.n_holders && frame_message_size(FRAME_MESSAGE(STATUS, status, &status)) > FRAME_MAX) {
		status.n_holders--;
		status.holders_more++;
	}
	request_answer(q, FRAME_MESSAGE(STATUS, status, &status));
	free(a);
}
