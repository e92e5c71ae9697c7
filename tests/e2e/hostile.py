"""Hostile or faulty clients: broken frames, wrong descriptors, silence, and a connection that ends at each step of a push, a job
and a fetch. After each, a quiet client that is connected all the time and a new client are served at once. At the end the daemon
has no more descriptors and no more memory than before."""
import fcntl
import os
import select
import socket
import statistics
import sys
import time

import e2e
from e2e import Fault, Folder, expect, main
from protocol import some_points, write_las
from acut_wire import Breach, Client, Gone, HEADER, Refused, Wire, pack, pb

DAEMON = QUIET = LAS = None


def hello():
    return pb.Message(hello=pb.Hello(version_min=1, version_max=1, build="hostile", program="hostile"))


def ping():
    m = pb.Message()
    m.ping.SetInParent()
    return m


def others_are_served():
    """The quiet client and a new one get their answers in time."""
    QUIET.ping()
    with Client(DAEMON.socket, timeout=e2e.PATIENCE) as fresh:
        fresh.ping()


def expect_cut_off(wire, code="protocol"):
    """The daemon may send an error with the reason, and closes the connection."""
    try:
        while True:
            _, message, _ = wire.recv()
            if message.WhichOneof("body") == "error":
                expect(message.error.code == code, "cut off with %s: %s" % (message.error.code, message.error.message))
                expect(message.error.message, "no sentence")
    except (Gone, Breach, ConnectionResetError):
        return
    except socket.timeout:
        raise Fault("the connection stays open")


def greeted():
    wire = Wire(DAEMON.socket, timeout=e2e.PATIENCE)
    wire.send(1, hello())
    wire.recv()
    return wire


def breach(data, fds=(), code="protocol", greet=True):
    wire = greeted() if greet else Wire(DAEMON.socket, timeout=e2e.PATIENCE)
    try:
        wire.send_raw(data, fds)
    except (BrokenPipeError, ConnectionResetError):
        pass
    expect_cut_off(wire, code)
    wire.close()
    others_are_served()


def half_frames():
    frame = pack(2, ping())
    for cut in range(1, len(frame)):
        wire = greeted()
        wire.send_raw(frame[:cut])
        wire.close()
    for cut in (1, 8, 15, 16, 20):
        wire = Wire(DAEMON.socket)
        wire.send_raw(pack(1, hello())[:cut])
        wire.close()
    # One that stays, with half a frame, for the rest of this case.
    wire = greeted()
    wire.send_raw(frame[:10])
    others_are_served()
    wire.close()
    others_are_served()


def wrong_lengths():
    for length in (65521, 64 << 20, 0xffffffff):
        breach(HEADER.pack(0x4341, 1, length, 2, 0, b"\0\0\0"))
    # Shorter than the message: the rest is taken for a header. Longer: the daemon waits for what never comes.
    body = ping().SerializeToString()
    breach(HEADER.pack(0x4341, 1, len(body) - 1, 2, 0, b"\0\0\0") + body + bytes(16))
    wire = greeted()
    wire.send_raw(HEADER.pack(0x4341, 1, len(body) + 100, 2, 0, b"\0\0\0") + body)
    others_are_served()
    wire.close()
    others_are_served()


def bad_headers():
    body = ping().SerializeToString()
    breach(HEADER.pack(0x4342, 1, len(body), 2, 0, b"\0\0\0") + body)
    breach(HEADER.pack(0x4341, 2, len(body), 2, 0, b"\0\0\0") + body, code="version")
    breach(HEADER.pack(0x4341, 1, len(body), 2, 0, b"\0\0\1") + body)
    breach(HEADER.pack(0x4341, 1, len(body), 2, 2, b"\0\0\0") + body)
    breach(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", greet=False)
    breach(os.urandom(4096), greet=False)


def bad_messages():
    breach(pack(2, b"\xff\xff\xff\xff"))                                        # no protobuf
    breach(pack(2, b"\x52\x03\x0a\x01\xff"))                                    # a text that is not UTF-8
    breach(pack(2, b"\xb2\x02\x80\xfa\x01" + b"\x0a\x00" * 16000))              # unpacks to megabytes
    breach(pack(1, ping()), greet=False)                                        # no greeting
    wire = Wire(DAEMON.socket)
    wire.send(1, pb.Message(hello=pb.Hello(version_min=70, version_max=90)))
    _, message, _ = wire.recv()
    expect(message.error.code == "version", "Hello of the future: %s" % message)
    wire.close()
    # Unknown kinds and unknown fields are no breach.
    wire = greeted()
    wire.send(2, b"\x82\x4b\x01\x00")
    request, message, _ = wire.recv()
    expect((request, message.error.code) == (2, "not-in-this-version"), "unknown kind: %s" % message)
    wire.send(3, b"\x22\x04\xf8\x7c\x96\x01")
    request, message, _ = wire.recv()
    expect((request, message.WhichOneof("body")) == (3, "done"), "unknown field: %s" % message)
    # Answers are no questions.
    wire.send(4, pb.Message(done=pb.Done()))
    request, message, _ = wire.recv()
    expect(message.WhichOneof("body") == "error", "an answer was taken for a question: %s" % message)
    wire.close()
    others_are_served()


def descriptors_that_were_not_asked_for():
    null = os.open("/dev/null", os.O_RDONLY)
    for said, sent in ((0, 1), (1, 0), (1, 2), (1, 40), (0, 253), (2, 2)):
        frame = bytearray(pack(2, ping()))
        frame[12] = said
        breach(bytes(frame), [null] * sent)
    # Announced and sent, but nobody wants it: an answer, and no leak.
    wire = greeted()
    wire.send(2, ping(), null)
    wire.recv()
    wire.close()
    # A second descriptor with a later byte of the frame.
    wire = greeted()
    frame = pack(2, ping(), 1)
    wire.send_raw(frame[:4], [null])
    time.sleep(0.05)
    try:
        wire.send_raw(frame[4:], [null])
    except (BrokenPipeError, ConnectionResetError):
        pass
    expect_cut_off(wire)
    wire.close()
    os.close(null)
    others_are_served()


def wrong_kinds_of_descriptor():
    """Refused as answers to their requests; the push and the connection go on."""
    pipe = os.pipe()
    pair = socket.socketpair()
    epoll = select.epoll()
    wrong = {
        "directory": os.open(os.path.dirname(LAS), os.O_RDONLY | os.O_DIRECTORY),
        "/dev/zero": os.open("/dev/zero", os.O_RDONLY),
        "/dev/null": os.open("/dev/null", os.O_RDWR),
        "pipe": pipe[0],
        "pipe, writing end": pipe[1],
        "socket": pair[0].fileno(),
        "epoll": epoll.fileno(),
        "file, write only": os.open(LAS + ".out", os.O_WRONLY | os.O_CREAT, 0o600),
        "file, path only": os.open(LAS, os.O_PATH),
    }
    with Client(DAEMON.socket) as c:
        begun = c.ask("push_begin", pb.PushBegin())
        for name, fd in wrong.items():
            for body, value in (("probe", pb.Probe(push=begun.push, name=name)),
                                ("file", pb.File(push=begun.push, name=name)),
                                ("info_request", pb.InfoRequest(name=name))):
                try:
                    c.ask(body, value, fd)
                except Refused:
                    continue
                raise Fault("%s was taken as %s" % (name, body))
            others_are_served()
        for body, value in (("probe", pb.Probe(push=begun.push, name="none")), ("info_request", pb.InfoRequest())):
            try:
                c.ask(body, value)
                raise Fault("no descriptor was taken for " + body)
            except Refused:
                pass
        # An unsealed memory file is a regular file: it is read, and may change as any file may.
        memory = os.memfd_create("unsealed")
        with open(LAS, "rb") as f:
            os.write(memory, f.read())
        probed = c.ask("probe", pb.Probe(push=begun.push, name="memory"), memory)
        expect(probed.points == 5000, "Probed: %s" % probed)
        os.ftruncate(memory, 300)
        try:
            c.ask("push_plan", pb.PushPlan(push=begun.push))
            c.ask("file", pb.File(push=begun.push, name="memory"), memory)
            raise Fault("a file that shrank was taken")
        except Refused as e:
            expect(e.code in ("changed", "truncated"), "a file that shrank: %s" % e)
        os.close(memory)
        c.ask("push_abort", pb.PushAbort(push=begun.push))
    for name, fd in wrong.items():
        if name not in ("socket", "epoll"):
            os.close(fd)
    for end in pair + (epoll,):
        end.close()
    others_are_served()


def one_byte_at_a_time():
    with Client(DAEMON.socket) as c:
        for byte in pack(99, ping()):
            c.wire.send_raw(bytes([byte]))
        c.answer(99, "done")
    others_are_served()


def never_reads():
    """A client that sends requests and never reads is disconnected; the others do not notice."""
    wire = greeted()
    wire.sock.setblocking(False)
    question = pack(7, pb.Message(status_request=pb.StatusRequest()))
    sent, deadline = 0, time.monotonic() + 10
    cut = False
    while time.monotonic() < deadline and not cut and sent < 200000:
        try:
            wire.sock.send(question)
            sent += 1
        except BlockingIOError:
            time.sleep(0.01)
            cut = bool(select.select([], [], [wire.sock], 0)[2])
            if sent > 1000:
                break  # the daemon reads no further: as good
        except (BrokenPipeError, ConnectionResetError):
            cut = True
    others_are_served()
    wire.close()
    others_are_served()


def many_connections():
    """A thousand connects, many of them idle at the same time."""
    before = [QUIET.ping() for _ in range(200)]
    idle = []
    during = []
    for i in range(1000):
        try:
            s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            s.settimeout(5)
            s.connect(DAEMON.socket)
        except (BlockingIOError, ConnectionRefusedError, socket.timeout):
            continue
        if i % 4 == 0 and len(idle) < 100:
            idle.append(s)
        else:
            s.close()
        if i % 5 == 0:
            during.append(QUIET.ping())
    for s in idle:
        s.close()
    print("     ping p99: %.2f ms before, %.2f ms under 1000 connects" %
          tuple(1e3 * statistics.quantiles(v, n=100)[98] for v in (before, during)))
    others_are_served()


def vanish(step):
    """A client that does the first `step` steps and leaves without a word."""
    dataset = "vanish-%d-%d" % (step, time.monotonic_ns()) if step % 2 else ""
    c = Client(DAEMON.socket)
    at = iter(range(step))
    gone = object()

    def go(kind, *args, **kw):
        """Sends, and waits for the answer unless this is the last step."""
        if next(at, gone) is gone:
            raise StopIteration
        if next(at, gone) is gone:
            c.send(kind, *args, **kw)
            raise StopIteration
        return c.ask(kind, *args, **kw)

    pipe = -1
    try:
        with open(LAS, "rb") as f:
            begun = go("push_begin", pb.PushBegin(dataset=dataset))
            go("probe", pb.Probe(push=begun.push, name="x.las"), f.fileno())
            go("push_plan", pb.PushPlan(push=begun.push))
            go("file", pb.File(push=begun.push, name="x.las"), f.fileno())
        committed = go("push_commit", pb.PushCommit(push=begun.push))
        job = go("submit", pb.Submit(view="view 1", dataset=committed.dataset, bound=step % 4 < 2, fresh=True))
        _, pipe = go("fetch", pb.Fetch(job=job.id))
        select.select([pipe], [], [], 5)
        os.read(pipe, 1 + 1000 * step)
        go("wait", pb.Wait(job=job.id, watch=True))
        raise Fault("there are more steps than that")
    except StopIteration:
        pass
    finally:
        if pipe >= 0 and step % 2:
            os.close(pipe)
            pipe = -1
        c.close()
    others_are_served()
    if pipe >= 0:
        os.close(pipe)
    if dataset:
        push_again(dataset)


def push_again(dataset):
    """A push that was left half-way does not block the next for long. (A requested commit is completed.)"""
    def pushed():
        try:
            with Client(DAEMON.socket) as c:
                return c.push([LAS], dataset=dataset).points
        except Refused as e:
            expect(e.code == "busy", "a second push into %s: %s" % (dataset, e))
    points = e2e.until(pushed, "a second push into %s is refused" % dataset)
    expect(points in (5000, 10000), "%s has %d points" % (dataset, points))


STEPS = 16


def vanishing_at_each_step():
    for step in range(STEPS):
        vanish(step)
    # And all of them at once, then a whole way by somebody else.
    many = []
    with open(LAS, "rb") as f:
        for _ in range(20):
            c = Client(DAEMON.socket)
            try:
                begun = c.ask("push_begin", pb.PushBegin())
                c.send("probe", pb.Probe(push=begun.push, name="x"), f.fileno())
            except Refused:
                pass
            many.append(c)
    for c in many:
        c.close()
    others_are_served()


def slow_reader():
    """A fetch that is never read delays nobody."""
    with Client(DAEMON.socket) as slow, Client(DAEMON.socket) as quick:
        job = slow.ask("submit", pb.Submit(view="view 1", dataset=quick.push([LAS], dataset="slow").dataset))
        _, pipe = slow.ask("fetch", pb.Fetch(job=job.id))
        flags = fcntl.fcntl(pipe, fcntl.F_GETFL)
        expect(flags & os.O_ACCMODE == os.O_RDONLY, "the pipe's end is not for reading")
        mesh = quick.fetch(job.id)
        expect(len(mesh.positions) == 5000, "%d vertices" % len(mesh.positions))
        others_are_served()
        os.close(pipe)


def the_whole_way_still_works():
    with Client(DAEMON.socket) as c:
        job = c.ask("submit", pb.Submit(view="view 1", dataset=c.push([LAS]).dataset, bound=True))
        mesh = c.fetch(job.id)
        expect(len(mesh.positions) == 5000, "%d vertices" % len(mesh.positions))


def nothing_leaks():
    """Runs the cases again: descriptors and resident memory end where they were."""
    def descriptors():
        return e2e.files_of(DAEMON.process.pid)

    def held():
        return {e.name: e.bytes for e in QUIET.ask("status_request", pb.StatusRequest()).ledger}

    time.sleep(0.5)
    before, ledger = descriptors(), held()
    for case in CASES[:-2]:
        case()
    e2e.until(lambda: len(descriptors()) <= len(before), lambda: "descriptors: %s" % sorted(set(descriptors()) - set(before)), 0.05)
    e2e.until(lambda: held().get("message", 0) <= ledger.get("message", 0) + 4096, lambda: "ledger: %s, before %s" % (held(), ledger))
    expect(DAEMON.vmhwm() <= (256 << 20) + (32 << 20), "VmHWM %d" % DAEMON.vmhwm())


CASES = [half_frames, wrong_lengths, bad_headers, bad_messages, descriptors_that_were_not_asked_for,
         wrong_kinds_of_descriptor, one_byte_at_a_time, never_reads, many_connections, vanishing_at_each_step,
         slow_reader, the_whole_way_still_works, nothing_leaks]


def whole(*cases):
    """Runs the cases with a daemon and a quiet client beside them."""
    global DAEMON, QUIET, LAS
    with Folder() as base, e2e.Daemon(base, memory="256M") as daemon:
        os.chmod(base, 0o755)
        DAEMON, LAS = daemon, os.path.join(base, "x.las")
        write_las(LAS, some_points(5000, 11))
        QUIET = Client(daemon.socket)
        try:
            main(*cases)
        except SystemExit as e:
            status = e.code
    sys.exit(status)


if __name__ == "__main__":
    whole(*CASES)
