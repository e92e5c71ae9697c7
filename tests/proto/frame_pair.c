/* See frame_pair.h. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "err.h"
#include "frame_pair.h"

unsigned open_descriptors(void)
{
	DIR *dir = opendir("/proc/self/fd");
	unsigned n = 0;

	assert_non_null(dir);
	while (readdir(dir))
		n++;
	closedir(dir);
	return n;
}

struct pair pair_new(const struct frame_limits *limits)
{
	struct err err = ERR_INIT;
	struct pair pair;
	int sv[2];

	assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sv), 0);
	assert_int_equal(frame_conn_new(sv[0], limits, &pair.conn, &err), 0);
	pair.raw = sv[1];
	return pair;
}

void pair_free(struct pair *pair)
{
	pair->conn = frame_conn_free(pair->conn);
	if (pair->raw >= 0)
		close(pair->raw);
}

void raw_send(int fd, const void *bytes, size_t n, unsigned nfd)
{
	union {
		struct cmsghdr align;
		char bytes[CMSG_SPACE(64 * sizeof(int))];
	} control = {0};
	struct iovec iov = {.iov_base = (void *)bytes, .iov_len = n};
	struct msghdr msg = {.msg_iov = &iov, .msg_iovlen = 1};

	if (nfd > 0) {
		struct cmsghdr *c = &control.align;
		int two = 2;

		msg.msg_control = &control;
		msg.msg_controllen = CMSG_SPACE(nfd * sizeof(int));
		c->cmsg_level = SOL_SOCKET;
		c->cmsg_type = SCM_RIGHTS;
		c->cmsg_len = CMSG_LEN(nfd * sizeof(int));
		for (unsigned i = 0; i < nfd; i++)
			memcpy(CMSG_DATA(c) + i * sizeof two, &two, sizeof two);
	}
	assert_int_equal(sendmsg(fd, &msg, MSG_NOSIGNAL), (ssize_t)n);
}

const Acut__V1__Message *hello(void)
{
	static char *features[] = {"a", "b"};
	static Acut__V1__Hello h = {.base = PROTOBUF_C_MESSAGE_INIT(&acut__v1__hello__descriptor),
				    .version_min = 1,
				    .version_max = 7,
				    .build = "0.1 \xc3\xa4",
				    .n_features = 2,
				    .features = features,
				    .program = "test"};
	static Acut__V1__Message m = {.base = PROTOBUF_C_MESSAGE_INIT(&acut__v1__message__descriptor),
				      .body_case = ACUT__V1__MESSAGE__BODY_HELLO,
				      .hello = &h};
	return &m;
}

size_t frame_bytes(const Acut__V1__Message *m, uint32_t id, unsigned descriptors, uint8_t *to)
{
	struct frame_header header = {
		.length = (uint32_t)acut__v1__message__get_packed_size(m), .request_id = id, .descriptors = (uint8_t)descriptors};

	frame_header_put(&header, to);
	return FRAME_HEADER_SIZE + acut__v1__message__pack(m, to + FRAME_HEADER_SIZE);
}

void check_hello(struct frame_conn *conn, uint32_t want_id, bool want_fd)
{
	struct err err = ERR_INIT;
	Acut__V1__Message *m = NULL;
	uint32_t id = 0;
	int fd = -5;

	assert_int_equal(frame_conn_recv(conn, &id, &m, &fd, &err), 0);
	assert_int_equal(id, want_id);
	assert_int_equal(m->body_case, ACUT__V1__MESSAGE__BODY_HELLO);
	assert_int_equal(m->hello->version_max, 7);
	assert_int_equal(m->hello->n_features, 2);
	assert_string_equal(m->hello->features[1], "b");
	assert_string_equal(m->hello->build, "0.1 \xc3\xa4");
	if (want_fd) {
		assert_true(fd >= 0);
		assert_true(fcntl(fd, F_GETFD) & FD_CLOEXEC);
		close(fd);
	} else {
		assert_int_equal(fd, -1);
	}
	assert_null(frame_message_free(m));
}

int recv_result(struct frame_conn *conn, struct err *err)
{
	Acut__V1__Message *m = NULL;
	uint32_t id;
	int fd = -1;
	int r = frame_conn_recv(conn, &id, &m, &fd, err);

	if (r != 0) {
		assert_null(m);
		assert_int_equal(fd, -1);
	}
	if (fd >= 0)
		close(fd);
	frame_message_free(m);
	return r;
}
