/* A daemon of a few lines: greets, then leaves the rest to the test's own function. */
#include "fake.h"

#include <assert.h>
#include <dirent.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

bool fake_recv(struct fake *f, uint32_t *ret_id, Acut__V1__Message **ret, int *ret_fd)
{
	struct err err = ERR_INIT;
	int r;

	while ((r = frame_conn_recv(f->conn, ret_id, ret, ret_fd, &err)) == FRAME_E_AGAIN) {
		struct pollfd p = {.fd = frame_conn_fd(f->conn), .events = POLLIN};

		poll(&p, 1, -1);
	}
	return r == 0;
}

void fake_send(struct fake *f, uint32_t id, const Acut__V1__Message *m, int fd)
{
	struct err err = ERR_INIT;
	int r = frame_conn_send(f->conn, id, m, fd, &err);

	assert(r == 0);
	while ((r = frame_conn_flush(f->conn, &err)) == FRAME_E_AGAIN) {
		struct pollfd p = {.fd = frame_conn_fd(f->conn), .events = POLLOUT};

		poll(&p, 1, -1);
	}
}

void fake_close(struct fake *f)
{
	f->conn = frame_conn_free(f->conn);
}

static void *run(void *arg)
{
	struct fake *f = arg;

	f->serve(f);
	fake_close(f);
	return NULL;
}

struct fake *fake_start(void (*serve)(struct fake *), void *ctx, int *ret_fd)
{
	struct fake *f = calloc(1, sizeof *f);
	struct err err = ERR_INIT;
	int sv[2], r;

	signal(SIGPIPE, SIG_IGN);
	r = socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sv);
	assert(r == 0);
	r = frame_conn_new(sv[0], NULL, &f->conn, &err);
	assert(r == 0);
	f->serve = serve;
	f->ctx = ctx;
	r = pthread_create(&f->thread, NULL, run, f);
	assert(r == 0);
	*ret_fd = sv[1];
	return f;
}

void fake_stop(struct fake *f)
{
	pthread_join(f->thread, NULL);
	free(f);
}

void fake_pipe(int fds[2])
{
	int r = pipe2(fds, O_CLOEXEC);

	assert(r == 0);
}

bool fake_write(int fd, const struct stream_piece *piece, unsigned n)
{
	for (unsigned i = 0; i < n; i++)
		for (size_t done = 0; done < piece[i].size;) {
			ssize_t w = write(fd, (const char *)piece[i].bytes + done, piece[i].size - done);

			if (w < 0)
				return false;
			done += (size_t)w;
		}
	return true;
}

static _Atomic uint64_t stopped_ns; /* 0: time goes on */

uint64_t __real_clock_mono_ns(void);
uint64_t __wrap_clock_mono_ns(void);
double __wrap_clock_since(uint64_t mono_ns);

uint64_t __wrap_clock_mono_ns(void)
{
	return stopped_ns ? stopped_ns : __real_clock_mono_ns();
}

double __wrap_clock_since(uint64_t mono_ns)
{
	uint64_t now = __wrap_clock_mono_ns();

	return now > mono_ns ? (double)(now - mono_ns) / 1e9 : 0;
}

void fake_stop_time(void)
{
	stopped_ns = __real_clock_mono_ns();
}

void fake_let_time(void)
{
	stopped_ns = 0;
}

void fake_wait(const atomic_bool *event)
{
	for (int i = 0; i < 100000 && !*event; i++)
		poll(NULL, 0, 1);
}

unsigned fake_open_descriptors(void)
{
	DIR *dir = opendir("/proc/self/fd");
	unsigned n = 0;

	while (readdir(dir))
		n++;
	closedir(dir);
	return n;
}

struct acut *fake_attach(struct fake **ret_fake, void (*serve)(struct fake *), void *ctx, const struct acut_options *options)
{
	struct acut *a;
	int fd, r;

	*ret_fake = fake_start(serve, ctx, &fd);
	r = acut_attach(fd, options, &a);
	assert(r == 0);
	return a;
}
