"""Hostile clients beside a quiet one, which pings, pushes, meshes and reconnects all the time. Each attack runs in processes of
its own, as another user where that is possible. Every answer to the quiet client must be right, the daemon's memory must stay
within its bound, and afterwards it has no more descriptors and no more memory than before. The waits of the quiet client are
printed, before and during each attack; on a loaded machine they mean little."""
import array
import fcntl
import json
import mmap
import os
import random
import select
import signal
import socket
import struct
import sys
import threading
import time

import e2e
from e2e import Folder, expect, main
from protocol import some_points, write_las
from acut_wire import Client, HEADER, Refused, pack, pb

SECONDS = float(os.environ.get("ACUT_HOSTILE_SECONDS", "0.35"))
# On a machine that has other things to do: acutd and the quiet client before all of these, so that they wait for one another only;
# acutd's loop before its workers, as one that mostly waits is where all share the cores fairly.
ALONE = bool(os.environ.get("ACUT_HOSTILE_ALONE"))
PROCESSES = 2
GONE = 16 << 20
NOBODY = 65534
DAEMON = LAS = None
COUNTS = mmap.mmap(-1, 4096)


def hello(version=1):
    return pack(1, pb.Message(hello=pb.Hello(version_min=version, version_max=version, build="hostile", program="hostile")))


def message(body, value=None):
    m = pb.Message()
    getattr(m, body).SetInParent()
    if value is not None:
        getattr(m, body).CopyFrom(value)
    return m


def connect():
    s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    s.settimeout(2)
    s.connect(DAEMON.socket)
    return s


def greeted():
    s = connect()
    s.sendall(hello())
    s.recv(4096)
    return s


def swallow(call, *args):
    try:
        return call(*args)
    except OSError:
        return None


# ---- attacks: each is called again and again until its time is over; what it returns is kept open until the next but 200th ----

def connects():
    """A thousand connections a second for each process."""
    swallow(lambda: connect().close())
    time.sleep(0.001)


def connects_without_end():
    """Connects as fast as possible: the kernel's queue of the socket is always full."""
    swallow(lambda: connect().close())


def connects_that_stay():
    time.sleep(0.0005)
    return swallow(connect)


def greetings_that_stay():
    s = connect()
    swallow(s.sendall, hello())
    return s


def half_frames():
    s = greeted()
    s.sendall(pack(2, message("ping"))[:random.randrange(1, 20)])
    return s


def half_messages():
    """Sends a frame of 64 KiB without its last byte."""
    s = greeted()
    s.settimeout(0.2)
    swallow(s.sendall, HEADER.pack(0x4341, 1, 65520, 2, 0, b"\0\0\0") + bytes(65519))
    return s


def one_byte_writes():
    s = greeted()
    for byte in pack(3, message("ping")) * 20:
        s.send(bytes([byte]))
    s.recv(4096)
    s.close()


def lengths_of_64_megabytes():
    s = greeted()
    swallow(s.sendall, HEADER.pack(0x4341, 1, 64 << 20, 2, 0, b"\0\0\0") + bytes(4096))
    swallow(s.recv, 4096)
    s.close()


def unread_answers():
    """Sends requests as fast as possible and reads nothing."""
    s = greeted()
    s.settimeout(0.05)
    questions = b"".join(pack(n, message("status_request")) for n in range(2, 66))
    for _ in range(40):
        if swallow(s.sendall, questions) is None and s.fileno() < 0:
            break
    return s


def deep_queues():
    """Keeps the greatest permitted number of unanswered requests, again and again, and reads the answers."""
    s = greeted()
    question = b"".join(pack(n, message("ping")) for n in range(2, 66))
    s.sendall(question)
    for _ in range(30):
        s.sendall(question)
        s.recv(65536)
    s.close()


def the_same_number_again():
    s = greeted()
    swallow(s.sendall, pack(7, message("wait", pb.Wait(job=1, watch=True))) * 2 + pack(7, message("ping")) * 2)
    swallow(s.recv, 4096)
    s.close()


def unknown_kinds():
    s = greeted()
    swallow(s.sendall, b"".join(pack(n, b"\x82\x4b\x01\x00") for n in range(2, 60)))
    swallow(s.recv, 65536)
    s.close()


def huge_texts():
    s = greeted()
    for n, m in enumerate((message("submit", pb.Submit(dataset="x" * 60000)), message("submit", pb.Submit(view="view 1 " + "a" * 60000)),
                           message("push_begin", pb.PushBegin(dataset="y" * 65000)), message("log_request", pb.LogRequest(dataset="z" * 60000)))):
        swallow(s.sendall, pack(2 + n, m))
        swallow(s.recv, 65536)
    s.close()


def bombs():
    """Messages that are small on the wire and large in memory: lists of empty messages, nested as deep as a frame permits."""
    s = greeted()
    nested = b""
    for _ in range(8000):
        nested = b"\x0a" + (bytes([len(nested)]) if len(nested) < 128 else
                            bytes([len(nested) & 0x7f | 0x80, len(nested) >> 7 & 0x7f | (0x80 if len(nested) > 16383 else 0)]) +
                            (bytes([len(nested) >> 14]) if len(nested) > 16383 else b"")) + nested
        if len(nested) > 60000:
            break
    for body in (b"\xb2\x02\x80\xfa\x01" + b"\x0a\x00" * 16000, nested, b"\x0a\x00" * 32000, os.urandom(60000)):
        swallow(s.sendall, pack(2, body))
        swallow(s.recv, 4096)
        s.close()
        s = greeted()
    s.close()


def forty_descriptors():
    s = greeted()
    fds = array.array("i", [NULL] * random.choice((2, 40, 253)))
    frame = bytearray(pack(2, message("ping")))
    frame[12] = random.randrange(2)
    swallow(s.sendmsg, [bytes(frame)], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, fds)])
    swallow(s.recv, 4096)
    s.close()


def files_that_are_gone():
    """The last descriptors of large deleted files, with requests that do not use them, and in a socket that nobody reads: closing
    them frees their blocks, which takes time."""
    s = greeted()
    for i in range(4):
        fd = os.memfd_create("gone")
        os.ftruncate(fd, GONE)
        with mmap.mmap(fd, GONE) as m:
            for at in range(0, GONE, 4096):
                m[at] = 1
        if i < 2:
            swallow(socket.send_fds, s, [pack(2 + i, message("ping"), 1)], [fd])
        else:
            swallow(socket.send_fds, s, [HEADER.pack(0x4341, 1, 9, 3, 0, b"\0\0\0")[:5] if i == 2 else b"x" * 60], [fd])
        os.close(fd)
    swallow(s.recv, 4096)
    s.close()


def send_fd(c, body, value, fd):
    try:
        c.ask(body, value, fd)
        return True
    except Refused:
        return False


def wrong_descriptors():
    """A folder, devices, a terminal, ends of pipes, sockets, and descriptors that cannot be read, in place of a file."""
    pipe, pair, pty = os.pipe(), socket.socketpair(), os.openpty()
    out = os.memfd_create("out")
    fds = {"folder": os.open("/", os.O_RDONLY | os.O_DIRECTORY), "zero": os.open("/dev/zero", os.O_RDONLY),
           "null": os.open("/dev/null", os.O_RDWR), "random": os.open("/dev/urandom", os.O_RDONLY), "path only": os.open(LAS, os.O_PATH),
           "write only": os.open("/proc/self/fd/%d" % out, os.O_WRONLY), "pipe": pipe[0], "pipe's other end": pipe[1],
           "terminal": pty[0], "terminal's other end": pty[1]}
    with Client(DAEMON.socket, timeout=5) as c:
        begun = c.ask("push_begin", pb.PushBegin())
        for name, fd in list(fds.items()) + [("socket", pair[0].fileno())]:
            for body, value in (("probe", pb.Probe(push=begun.push, name=name)), ("file", pb.File(push=begun.push, name=name)),
                                ("info_request", pb.InfoRequest(name=name))):
                expect(not send_fd(c, body, value, fd), "%s was taken as %s" % (name, body))
    for fd in list(fds.values()) + [out]:
        os.close(fd)
    for s in pair:
        s.close()


def endless_pipes():
    """A pipe as an input, filled endlessly with garbage, or never filled."""
    with Client(DAEMON.socket, timeout=5) as c:
        try:
            begun = c.ask("push_begin", pb.PushBegin(format=random.choice(("xyz", "las"))))
            c.send("stream", pb.Stream(push=begun.push, name="p"))
            got, fd = c.answer(c.last, "streaming") if "streaming" in pb.Message.DESCRIPTOR.fields_by_name else (None, -1)
        except Refused:
            return
        c.send("probe", pb.Probe(push=begun.push, name="p"))
        if fd >= 0:
            os.set_blocking(fd, False)
            end = time.monotonic() + 0.1
            while time.monotonic() < end and random.random() < 0.98:
                if swallow(os.write, fd, b"1.5 2.5 3.5\n" * 4000) is None:
                    time.sleep(0.005)
            os.close(fd)


def files_that_shrink():
    """Files that are truncated and written to while they are read."""
    memory = os.memfd_create("unsealed")
    with open(LAS, "rb") as f:
        data = f.read() * 40
    os.write(memory, data)
    struct_points = struct.pack("<I", (len(data) - 227) // 20)
    os.pwrite(memory, struct_points, 107)
    over = threading.Event()

    def shake():
        while not over.is_set():
            os.ftruncate(memory, random.randrange(len(data)))
            os.pwrite(memory, data[:5000], random.randrange(len(data)))
            os.ftruncate(memory, len(data))
            time.sleep(0.001)
    t = threading.Thread(target=shake)
    t.start()
    try:
        with Client(DAEMON.socket, timeout=10) as c:
            try:
                begun = c.ask("push_begin", pb.PushBegin())
                c.ask("probe", pb.Probe(push=begun.push, name="m"), memory)
                c.ask("push_plan", pb.PushPlan(push=begun.push))
                c.ask("file", pb.File(push=begun.push, name="m"), memory)
            except Refused as e:
                expect(e.code in ("changed", "truncated", "bad-input", "usage", "not-found", "busy", "does-not-fit"), "a file that changes: %s" % e)
    finally:
        over.set()
        t.join()
        os.close(memory)


def streams_that_nobody_reads():
    """Sixty-four streams of one job at once; then the client leaves."""
    c = Client(DAEMON.socket, timeout=5)
    try:
        job = c.ask("submit", pb.Submit(view="view 1", dataset="shared"))
        ids = [c.send("fetch", pb.Fetch(job=job.id)) for _ in range(64)]
        for n in ids:
            try:
                os.close(c.answer(n, "fetching")[1]) if random.random() < 0.3 else c.answer(n, "fetching")
            except Refused:
                pass
    except Refused:
        pass
    for fd in range(3, 300):
        try:
            if "pipe" in os.readlink("/proc/self/fd/%d" % fd) and fcntl.fcntl(fd, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
                os.close(fd)
        except OSError:
            pass
    c.close()


def jobs_and_gone():
    """Jobs bound to the client, one after the other, without a look at them."""
    c = Client(DAEMON.socket, timeout=5)
    for n in range(20):
        swallow(c.send, "submit", pb.Submit(view="view 1", dataset="shared", fresh=True, bound=True))
    c.close()


def ends_in_the_middle():
    """Leaves at a random byte of a push."""
    s = greeted()
    begin = pack(2, message("push_begin", pb.PushBegin()))
    stream = begin + pack(3, message("probe", pb.Probe(push=1, name="x")), 1) + pack(4, message("push_plan", pb.PushPlan(push=1)))
    s.sendall(begin[:random.randrange(len(begin))]) if random.random() < 0.3 else swallow(
        socket.send_fds, s, [stream[:random.randrange(len(begin), len(stream))]], [NULL])
    s.close()


# ---- the quiet client ----

class Quiet:
    """Pings every few milliseconds, each time also from a new connection. A process of its own, so that it waits for acutd
    only."""

    def __init__(self):
        self.end_in, self.end_out = os.pipe()
        self.result, out = os.pipe()
        self.pid = os.fork()
        if self.pid:
            os.close(self.end_in)
            os.close(out)
            return
        os.close(self.end_out)
        if ALONE:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(6))
        try:
            answer = json.dumps(self.work())
        except BaseException as e:
            answer = json.dumps("%s: %s" % (type(e).__name__, e))
        with open(out, "w") as f:
            f.write(answer)
        os._exit(0)

    def work(self):
        pings, news = [], []
        with Client(DAEMON.socket, timeout=e2e.PATIENCE) as c:
            while not pings or not select.select([self.end_in], [], [], 0)[0]:
                for _ in range(5):
                    pings.append(c.ping())
                    time.sleep(0.002)
                start = time.monotonic()
                with Client(DAEMON.socket, timeout=e2e.PATIENCE) as fresh:
                    fresh.ping()
                news.append(time.monotonic() - start)
        return pings, news

    def end(self):
        os.close(self.end_out)
        with open(self.result) as f:
            answer = json.load(f)
        os.waitpid(self.pid, 0)
        expect(not isinstance(answer, str), "the quiet client: %s" % answer)
        return answer


def one_mesh(want):
    """A push, a job and a fetch, and the right triangles."""
    if ALONE:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(5))
    start = time.monotonic()
    with Client(DAEMON.socket, timeout=e2e.PATIENCE) as c:
        while True:
            try:
                job = c.ask("submit", pb.Submit(view="view 1", dataset=c.push([LAS]).dataset, bound=True))
                break
            except Refused as e:
                expect(e.code == "busy" and time.monotonic() - start < e2e.PATIENCE, "the quiet client is refused: %s" % e)
                time.sleep(0.02)
        mesh = c.fetch(job.id)
    if ALONE:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    digests = (str(mesh.digest), str(mesh.vertex_digest))
    expect(want is None or digests == want, "another mesh: %s, not %s" % (digests, want))
    return digests, time.monotonic() - start


def p(values, part):
    return 1e3 * sorted(values)[int(part * (len(values) - 1))]


def figures(name, pings, news, mesh):
    rounds = sum(struct.unpack("512Q", COUNTS[:]))
    COUNTS[:] = bytes(4096)
    print("     %-26s %6d times; ping p50 %6.2f, p99 %7.2f of %4d; newcomer p99 %7.2f; mesh %5.0f ms" %
          (name, rounds, p(pings, 0.5), p(pings, 0.99), len(pings), p(news, 0.99), 1e3 * mesh), flush=True)


def attacker(attack, seed, ready, go):
    """Runs an attack in a process of its own, for SECONDS from when nobody has the writing end of `go` open; reports first that
    it is `ready`. With 22 at once one may complete no round in SECONDS, since the others take all connections: it goes on until
    it has completed one."""
    pid = os.fork()
    if pid:
        return pid
    status = 1
    try:
        os.close(go[1])
        random.seed(seed)
        os.nice(5)
        if ALONE:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(4))
        if os.geteuid() == 0:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
        Client(DAEMON.socket).close()  # it may; nobody attacks yet
        os.write(ready[1], b".")
        os.close(ready[1])
        os.read(go[0], 1)
        start, kept, rounds = time.monotonic(), [], 0
        while (lasts := time.monotonic() - start) < SECONDS or (not rounds and lasts < e2e.PATIENCE):
            try:
                one = attack()
                rounds += 1
                COUNTS[seed * 8:seed * 8 + 8] = struct.pack("Q", rounds)
            except (OSError, EOFError):
                one = None
            except Exception as e:
                if type(e).__name__ not in ("Gone", "Breach", "Refused"):
                    raise
                one = None
            if one is not None:
                kept.append(one)
            if len(kept) > 200:
                kept.pop(0).close()
        status = 0 if rounds else 3
    except BaseException as e:
        print("     attacker: %s: %s" % (type(e).__name__, e), flush=True)
    finally:
        os._exit(status)


def descriptors():
    return len(os.listdir("/proc/%d/fd" % DAEMON.process.pid))


def held():
    with Client(DAEMON.socket) as c:
        return {e.name: e.bytes for e in c.ask("status_request", pb.StatusRequest()).ledger}


def settled(before, ledger):
    deadline = time.monotonic() + e2e.PATIENCE
    while True:
        now, has = descriptors(), held()
        more = {k: (ledger.get(k, 0), v) for k, v in has.items() if k in ("message", "pipe", "stage", "input", "files") and v > ledger.get(k, 0) + 8192}
        if now <= before and not more:
            return 0
        expect(time.monotonic() < deadline, "left behind: %d descriptors, before %d; memory %s" % (now, before, more))
        time.sleep(0.05)


ATTACKS = [connects, connects_without_end, connects_that_stay, greetings_that_stay, half_frames, half_messages, one_byte_writes, lengths_of_64_megabytes,
           unread_answers, deep_queues, the_same_number_again, unknown_kinds, huge_texts, bombs, forty_descriptors, files_that_are_gone, wrong_descriptors,
           endless_pipes, files_that_shrink, streams_that_nobody_reads, jobs_and_gone, ends_in_the_middle]


def under(name, attacks, want, before, ledger):
    quiet = Quiet()
    ready, go = os.pipe(), os.pipe()
    pids = [attacker(a, n, ready, go) for n, a in enumerate(attacks)]
    try:
        os.close(ready[1])
        there = 0
        while there < len(pids) and (more := os.read(ready[0], 64)):
            there += len(more)
        os.close(go[1])
        time.sleep(0.1)
        _, seconds = one_mesh(want)
        bad = [(a.__name__, s) for a, s in [(a, os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])) for a, pid in zip(attacks, pids)] if s]
        pids = []
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        os.close(ready[0])
        os.close(go[0])
        pings, news = quiet.end()
    figures(name, pings, news, seconds)
    expect(not bad, "%s: the attackers ended with %s" % (name, bad))
    expect(DAEMON.process.poll() is None, "acutd is gone")
    settled(before, ledger)


def attacks_beside_a_quiet_client():
    global NULL
    NULL = os.open("/dev/null", os.O_RDONLY)
    with Client(DAEMON.socket) as c:
        c.push([LAS], dataset="shared")
    want, _ = one_mesh(None)
    time.sleep(0.3)
    before, ledger = descriptors(), held()
    quiet = Quiet()
    time.sleep(SECONDS)
    _, seconds = one_mesh(want)
    figures("alone", *quiet.end(), seconds)
    wanted = os.environ.get("ACUT_HOSTILE_ATTACKS", "").split()
    for attack in ATTACKS:
        if not wanted or attack.__name__ in wanted:
            under(attack.__name__, [attack] * PROCESSES, want, before, ledger)
    if not wanted:
        under("all at once", ATTACKS, want, before, ledger)
    left = settled(before, ledger)
    peak = DAEMON.vmhwm()
    print("     %d attacks, %d descriptors and no memory left behind, VmHWM %.1f MiB of %d + 32" %
          (len(ATTACKS), left, peak / (1 << 20), MEMORY))
    expect(peak <= (MEMORY + 32) << 20, "VmHWM %d" % peak)
    os.close(NULL)


MEMORY = 96


def whole():
    global DAEMON, LAS
    with Folder() as base:
        os.chmod(base, 0o755)
        with e2e.Daemon(base, memory="%dM" % MEMORY, prefix=("chrt", "-f", "5") if ALONE else ()) as daemon:
            os.chmod(daemon.socket, 0o666)
            if ALONE:
                os.sched_setscheduler(daemon.process.pid, os.SCHED_FIFO, os.sched_param(6))
            DAEMON, LAS = daemon, os.path.join(base, "x.las")
            write_las(LAS, some_points(2000, 11))
            try:
                main(attacks_beside_a_quiet_client)
            except SystemExit as e:
                status = e.code
            if status:
                print(daemon.log_text()[-3000:])
    sys.exit(status)


if __name__ == "__main__":
    whole()
