"""Messages of acutd to a service manager, received by a stand-in: ready when it serves, its status, watchdog messages while the
disk does not answer but not when the loop hangs, more time for a long start; and no wake-ups while idle."""
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "e2e"))
import e2e
from e2e import Daemon, Folder, expect, main, run, unavailable, until
from held import Held

SIGNS = int(os.environ.get("ACUT_SLOW_FSYNC", 6)) # watchdog messages while an fsync does not return
WATCHDOG = 2.0
IDLE_CLIENTS = 10


class Manager:
    """Receives the messages of one acutd, with the time of each."""

    def __init__(self, base, name="notify"):
        self.path = os.path.join(base, name)
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(self.path)
        self.told = []
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        while True:
            data = self.socket.recv(4096).decode()
            now = time.monotonic()
            self.told += [(now, line) for line in data.split("\n") if line]

    def env(self, watchdog=None):
        env = {"NOTIFY_SOCKET": self.path}
        if watchdog:
            env["WATCHDOG_USEC"] = str(int(watchdog * 1e6))
        return env

    def all(self, prefix):
        return [(t, line[len(prefix):]) for t, line in list(self.told) if line.startswith(prefix)]

    def wait(self, prefix, n=1):
        """Waits for the n-th of these messages."""
        return until(lambda: self.all(prefix)[n - 1:], lambda: "%s was not told %d times: %s" % (prefix, n, self.told))[0]

    def rests(self, seconds):
        """No message for that long, after the earlier ones were received."""
        def silent():
            n = len(self.told)
            time.sleep(seconds)
            return n == len(self.told)
        deadline = time.monotonic() + 60
        while not silent():
            expect(time.monotonic() < deadline, "told while there is nothing to tell: %s" % self.told[-20:])

    def mark(self):
        """Drops all messages received so far."""
        n = len(self.all("MARK=")) + 1
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as s:
            s.sendto(b"MARK=%d" % n, self.path)
        self.wait("MARK=", n)
        return len(self.told)


def survey(base, points, seed=1):
    path = os.path.join(base, "s%d.las" % seed)
    run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), path]).ok()
    return path


def switches(pid):
    """Voluntary context switches of each thread of a process."""
    counts = {}
    for task in os.listdir("/proc/%d/task" % pid):
        with open("/proc/%d/task/%s/status" % (pid, task)) as f:
            lines = dict(line.split(":", 1) for line in f if ":" in line)
        counts[task] = int(lines["voluntary_ctxt_switches"]) # threads that sleep; a preemption is no wake-up
    return counts


def rss(pid):
    with open("/proc/%d/status" % pid) as f:
        return next(int(line.split()[1]) for line in f if line.startswith("VmRSS:")) << 10


def says_what_it_does():
    if not shutil.which("strace"):
        unavailable("strace is not installed")
    with Folder() as base:
        m, begun = Manager(base), time.monotonic()
        with Daemon(base, env=m.env(), threads=1) as d:
            m.wait("READY=1")
            # A long start asks for more time before it is ready.
            first = until(lambda: [x for x in m.all("STATUS=") if not x[1].startswith("Starting")], "nothing is told")
            expect(first[0][1] == "Serving", "at first: %s" % m.all("STATUS="))
            path = survey(base, 300000)
            held = Held(d.process.pid, base + "/held")
            push = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "a", path], stdout=subprocess.DEVNULL)
            until(lambda: "pushes: 1" in m.all("STATUS=")[-1][1], lambda: "a push is not told: %s" % m.all("STATUS="))
            held.let_go()
            expect(push.wait(e2e.PATIENCE) == 0, "the push: %d" % push.returncode)
            d.ctl("submit", "a", "--wait").ok()
            d.ctl("submit", "a", "--view", "z=10", "--wait")
            until(lambda: m.all("STATUS=")[-1][1] == "Serving", lambda: "after the work: %s" % m.all("STATUS="))
            m.rests(2)
            told = [x for x in m.all("STATUS=") if not x[1].startswith("Starting")]
            expect(told[-1][1] == "Serving", "at rest: %s" % told)
            once_a_second(told, begun)
            for before, after in zip(told, told[1:]):
                expect(after[1] != before[1], "the same again: %s" % told)
            extended = len(m.all("EXTEND_TIMEOUT_USEC="))
            d.stop()
            m.wait("STOPPING=1")
            m.wait("EXTEND_TIMEOUT_USEC=", extended + 1)


def once_a_second(told, begun):
    """At most one a second since the first: each may be received late."""
    expect(len(told) <= told[-1][0] - begun + 2, "more than once a second: %s" % told)


def start_gets_more_time():
    """A start whose fsyncs are slow asks for more time; one that hangs does not."""
    if not shutil.which("strace"):
        unavailable("strace is not installed")
    with Folder() as base:
        m, begun = Manager(base), time.monotonic()
        d = Daemon(base, env=m.env(), prefix=["strace", "-f", "-qq", "-o", "/dev/null", "-e",
                                              "inject=fsync,fdatasync:delay_exit=200000"])
        with d:
            ready, _ = m.wait("READY=1")
            early = [x for x in m.all("EXTEND_TIMEOUT_USEC=") if x[0] < ready]
            expect(early and int(early[0][1]) >= 10e6, "no more time was asked for: %s" % m.told)
            once_a_second(early, begun)
        e2e.end_daemons(base) # the process that ended is strace
        m = Manager(base, "hung")
        trace = base + "/trace"
        d = Daemon(base, name="-hung", env=m.env(), prefix=["strace", "-f", "-qq", "-o", trace, "-e", "trace=fsync,fdatasync", "-e",
                                              "inject=fsync,fdatasync:delay_exit=3600000000"])
        log = open(d.log, "ab")
        p = subprocess.Popen(d.command, stdout=log, stderr=log, env=d.env)
        until(lambda: os.path.exists(trace) and "(DELAYED)" in open(trace).read(), "no fsync came to be held")
        time.sleep(2.5)
        m.mark()
        expect(not m.all("EXTEND") and not m.all("READY"), "a start that hangs asks for more time: %s" % m.told)
        e2e.end_daemons(base)
        p.kill()
        p.wait()
        log.close()


def alive_while_the_disk_is_not():
    """An fsync does not return for six watchdog messages (ACUT_SLOW_FSYNC=30 for more), during a push and a mesh, with clients
    that send requests all the time. Beside it, an idle daemon with clients is woken by its watchdog only."""
    if not shutil.which("strace"):
        unavailable("strace is not installed")
    with Folder() as base:
        m, quiet = Manager(base), Manager(base, "quiet")
        with Daemon(base, env=m.env(WATCHDOG), threads=2) as d, Daemon(base, env=quiet.env(4), name="-idle") as idle:
            path, other = survey(base, 20000), survey(base, 20000, 2)
            clients = [socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) for _ in range(IDLE_CLIENTS)]
            for c in clients:
                c.connect(idle.socket)
            idle.ctl("ping").ok()

            d.ctl("push", "b", other).ok()
            held = Held(d.process.pid, base + "/held")
            work = [subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket] + args, stdout=subprocess.DEVNULL,
                                     stderr=subprocess.DEVNULL)
                    for args in (["push", "a", path], ["submit", "b", "--wait"], ["push", "b", path])]
            held.wait()
            signs, slowest = len(m.all("WATCHDOG=1")), 0.0
            while len(m.all("WATCHDOG=1")) < signs + SIGNS:
                asked = time.monotonic()
                d.ctl("ping").ok()
                d.ctl("datasets").ok()
                slowest = max(slowest, time.monotonic() - asked)
                expect(asked - m.told[-1][0] < e2e.PATIENCE, "no sign of life while an fsync does not come back: %s" % m.told)
                time.sleep(0.05)
            expect(work[0].poll() is None, "the push has ended, with its fsync not done")
            held.let_go()
            expect(all(p.wait(e2e.PATIENCE) == 0 for p in work), "work failed: %s" % [p.returncode for p in work])
            print("     an fsync of %d signs of life: slowest answer %.2f s" % (SIGNS, slowest))

            until(lambda: at_rest(quiet, idle.process.pid), "an idle daemon is woken by more than its watchdog")
            expect(e2e.sanitized() or rss(idle.process.pid) < 12 << 20, "resident: %d" % rss(idle.process.pid))


def at_rest(manager, pid):
    """True if a process was woken for two watchdog messages only; earlier work may still go on at the first."""
    n = len(manager.all("WATCHDOG=1"))
    try:
        woken = switches(pid)
        manager.wait("WATCHDOG=1", n + 2)
        now = switches(pid)
    except OSError:
        return False  # a thread has just ended
    count = sum(now.values()) - sum(woken.values())
    print("     idle for 2 signs of life with %d clients: woken %d times; resident %.1f MB" % (IDLE_CLIENTS, count, rss(pid) / 1e6))
    return now.keys() == woken.keys() and count <= 3


def new_dataset_stops_nobody():
    """The fsync of a new dataset's folder does not return; jobs and clients of others do not wait for it."""
    if not shutil.which("strace"):
        unavailable("strace is not installed")
    with Folder() as base, Daemon(base, threads=2) as d:
        path = survey(base, 5000)
        d.ctl("push", "b", path).ok()
        held = Held(d.process.pid, base + "/held", "-P", d.state + "/datasets", calls="fsync")
        push = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "a", path], stdout=subprocess.DEVNULL)
        held.wait()
        for _ in range(3):
            d.ctl("submit", "b", "--new", "--wait").ok()
        expect(push.poll() is None, "the push has ended, with its folder's name not on the disk")
        held.let_go()
        expect(push.wait(e2e.PATIENCE) == 0, "the push: %d" % push.returncode)


def hung_loop_is_silent():
    with Folder() as base:
        m = Manager(base)
        with Daemon(base, env=m.env(1.0)) as d:
            m.wait("WATCHDOG=1")
            os.kill(d.process.pid, signal.SIGSTOP)
            until(lambda: open("/proc/%d/stat" % d.process.pid).read().rsplit(")", 1)[1].split()[0] == "T", "it does not stop")
            n = m.mark()
            time.sleep(1.5)
            expect(m.mark() == n + 1, "a stopped daemon says that it lives")
            signs = len(m.all("WATCHDOG=1"))
            os.kill(d.process.pid, signal.SIGCONT)
            m.wait("WATCHDOG=1", signs + 1)


CASES = [says_what_it_does, start_gets_more_time, alive_while_the_disk_is_not, new_dataset_stops_nobody, hung_loop_is_silent]
main(*[c for c in CASES if not sys.argv[1:] or c.__name__ in sys.argv[1:]])
