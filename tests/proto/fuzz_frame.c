/* Any bytes as from a client: frames are split, and messages are unpacked under the daemon's limits and charged to a
 * ledger, which must be balanced at the end. */
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "err.h"
#include "frame.h"
#include "fuzz.h"

static size_t put(const Acut__V1__Message *m, uint32_t id, uint8_t *bytes)
{
	struct frame_header header = {.length = (uint32_t)acut__v1__message__get_packed_size(m), .request_id = id};

	frame_header_put(&header, bytes);
	return FRAME_HEADER_SIZE + acut__v1__message__pack(m, bytes + FRAME_HEADER_SIZE);
}

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;
	Acut__V1__Submit submit = ACUT__V1__SUBMIT__INIT;
	Acut__V1__Probed probed = ACUT__V1__PROBED__INIT;
	Acut__V1__Job job = ACUT__V1__JOB__INIT, *rows[] = {&job, &job};
	Acut__V1__Jobs jobs = ACUT__V1__JOBS__INIT;
	Acut__V1__Report report = ACUT__V1__REPORT__INIT;
	Acut__V1__Error error = ACUT__V1__ERROR__INIT;
	char *features[] = {"a", "b\xc3\xa4"};
	double numbers[3] = {1, 2, 3};
	size_t n = 0;

	hello.version_min = hello.version_max = 1;
	hello.build = "build";
	hello.features = features;
	hello.n_features = 2;
	n += put(FRAME_MESSAGE(HELLO, hello, &hello), 1, bytes + n);
	submit.dataset = "alps";
	submit.view = "class=2";
	submit.generation = i;
	n += put(FRAME_MESSAGE(SUBMIT, submit, &submit), 2, bytes + n);
	probed.min = probed.max = numbers;
	probed.n_min = probed.n_max = 3;
	probed.scale = features;
	probed.n_scale = 2;
	n += put(FRAME_MESSAGE(PROBED, probed, &probed), 3, bytes + n);
	error.code = "io";
	error.has_offset = true;
	job.error = &error;
	job.report = &report;
	jobs.jobs = rows;
	jobs.n_jobs = 2;
	n += put(FRAME_MESSAGE(JOBS, jobs, &jobs), 4, bytes + n);
	return n;
}

static void drain(struct frame_conn *conn)
{
	struct err err = ERR_INIT;
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	while (frame_conn_recv(conn, &id, &m, &fd, &err) == 0) {
		struct frame_error again;
		struct err copy = ERR_INIT;

		if (m->body_case == ACUT__V1__MESSAGE__BODY_ERROR) {
			frame_error_to_err(m->error, &copy);
			frame_error_from_err(&copy, &again);
		}
		frame_message_free(m);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static struct ledger *ledger;
	struct frame_limits limits = {0};
	struct frame_conn *conn;
	struct err err = ERR_INIT;
	int sv[2];

	if (!ledger)
		ledger = ledger_new(8 << 20);
	limits.ledger = ledger;
	if (size > 100000 || socketpair(AF_UNIX, SOCK_STREAM, 0, sv) < 0 || frame_conn_new(sv[0], &limits, &conn, &err) < 0)
		return 0;
	for (size_t at = 0, n; at < size; at += n) {
		n = size - at < 4096 ? size - at : 4096;
		if (send(sv[1], bytes + at, n, MSG_NOSIGNAL) != (ssize_t)n)
			break;
		drain(conn);
	}
	close(sv[1]);
	drain(conn);
	frame_conn_free(conn);
	if (ledger_held(ledger, LEDGER_MESSAGE) != 0)
		abort();
	return 0;
}
