"""What acutd tells a service manager, judged by a stand-in of it: ready when it serves, what it does, signs of life while the
disk does not answer and none when the loop hangs, more time for a start that gets on; and that idleness costs nothing."""
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
from e2e import Daemon, Folder, expect, main, run, unavailable

SLOW_FSYNC = float(os.environ.get("ACUT_SLOW_FSYNC", 6))
WATCHDOG = 2.0
IDLE_CLIENTS = 10


class Manager:
    """Takes the messages of one acutd, with the time of each."""

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

    def wait(self, prefix, seconds=20, after=0.0):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            hits = [x for x in self.all(prefix) if x[0] > after]
            if hits:
                return hits[0]
            time.sleep(0.01)
        raise e2e.Fault("%s was not told within %d s: %s" % (prefix, seconds, self.told))


def survey(base, points, seed=1):
    path = os.path.join(base, "s%d.las" % seed)
    run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), path]).ok()
    return path


def switches(pid):
    """How often threads of a process were woken, for each."""
    counts = {}
    for task in os.listdir("/proc/%d/task" % pid):
        with open("/proc/%d/task/%s/status" % (pid, task)) as f:
            lines = dict(line.split(":", 1) for line in f if ":" in line)
        counts[task] = int(lines["voluntary_ctxt_switches"]) # those who sleep; a preemption is no wake-up
    return counts


def rss(pid):
    with open("/proc/%d/status" % pid) as f:
        return next(int(line.split()[1]) for line in f if line.startswith("VmRSS:")) << 10


def says_what_it_does():
    with Folder() as base:
        m = Manager(base)
        with Daemon(base, env=m.env(), threads=1) as d:
            ready, _ = m.wait("READY=1")
            expect(m.wait("STATUS=")[1] == "Serving", "at first: %s" % m.all("STATUS="))
            path = survey(base, 300000)
            time.sleep(1)
            d.ctl("push", "a", path).ok()
            d.ctl("submit", "a", "--wait").ok()
            d.ctl("submit", "a", "--view", "z=10", "--wait")
            m.wait("STATUS=Serving", after=m.all("STATUS=")[-1][0] - 1e-6)
            deadline = time.monotonic() + 5
            while m.all("STATUS=")[-1][1] != "Serving" and time.monotonic() < deadline:
                time.sleep(0.05)
            told = m.all("STATUS=")
            expect(told[-1][1] == "Serving", "after the work: %s" % told)
            expect(any("running" in text or "pushes" in text for _, text in told), "no work is told: %s" % told)
            once_a_second(told)
            for before, after in zip(told, told[1:]):
                expect(after[1] != before[1], "the same again: %s" % told)
            n = len(m.told)
            time.sleep(2)
            expect(len(m.told) == n, "told while idle: %s" % m.told[n:])
            d.stop()
            m.wait("STOPPING=1")
            m.wait("EXTEND_TIMEOUT_USEC=", after=ready)


def once_a_second(told):
    """At most, from the first to the last of them: single ones may be taken late here."""
    expect(len(told) <= told[-1][0] - told[0][0] + 3, "more than once a second: %s" % told)


def start_gets_more_time():
    """Where each fsync of the start takes its time, the start says that it gets on; one that hangs says nothing."""
    if not shutil.which("strace"):
        unavailable("strace is not installed")
    with Folder() as base:
        m = Manager(base)
        d = Daemon(base, env=m.env(), prefix=["strace", "-f", "-qq", "-o", "/dev/null", "-e",
                                              "inject=fsync,fdatasync:delay_exit=200000"])
        with d:
            ready, _ = m.wait("READY=1")
            early = [x for x in m.all("EXTEND_TIMEOUT_USEC=") if x[0] < ready]
            expect(early and int(early[0][1]) >= 10e6, "no more time was asked for: %s" % m.told)
            once_a_second(early)
        m = Manager(base, "hung")
        d = Daemon(base, env=m.env(), prefix=["strace", "-f", "-qq", "-o", "/dev/null", "-e",
                                              "inject=fsync,fdatasync:delay_enter=60000000"])
        log = open(d.log, "ab")
        p = subprocess.Popen(d.command, stdout=log, stderr=log, env=d.env)
        time.sleep(2.5)
        expect(not m.all("EXTEND") and not m.all("READY"), "a start that hangs asks for more time: %s" % m.told)
        e2e.end_daemons(base)
        p.kill()
        p.wait()
        log.close()


def alive_while_the_disk_is_not():
    """An fsync of 6 s (ACUT_SLOW_FSYNC=30 for longer) against a watchdog of 2 s, in a push and a mesh, with clients that ask all the while; beside it an idle
    daemon with clients is woken by its watchdog alone."""
    if not shutil.which("strace"):
        unavailable("strace is not installed")
    with Folder() as base:
        m, quiet = Manager(base), Manager(base, "quiet")
        with Daemon(base, env=m.env(WATCHDOG), threads=2) as d, Daemon(base, env=quiet.env(4), name="-idle") as idle:
            path, other = survey(base, 20000), survey(base, 20000, 2)
            clients = [socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) for _ in range(IDLE_CLIENTS)]
            for c in clients:
                c.connect(idle.socket)
            time.sleep(1.5)
            slept, woken, first = time.monotonic(), switches(idle.process.pid), len(quiet.all("WATCHDOG"))

            d.ctl("push", "b", other).ok()
            tracer = subprocess.Popen(["strace", "-f", "-qq", "-o", "/dev/null", "-p", str(d.process.pid), "-e",
                                       "inject=fsync,fdatasync:delay_exit=%d:when=1" % int(SLOW_FSYNC * 1e6)],
                                      stderr=subprocess.DEVNULL)
            time.sleep(1)
            begun = time.monotonic()
            work = [subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket] + args, stdout=subprocess.DEVNULL,
                                     stderr=subprocess.DEVNULL)
                    for args in (["push", "a", path], ["submit", "b", "--wait"], ["push", "b", path])]
            slowest = 0.0
            while any(p.poll() is None for p in work) and time.monotonic() < begun + 90 + 10 * SLOW_FSYNC:
                asked = time.monotonic()
                d.ctl("ping").ok()
                d.ctl("datasets").ok()
                slowest = max(slowest, time.monotonic() - asked)
                time.sleep(0.05)
            took = time.monotonic() - begun
            tracer.send_signal(signal.SIGINT)
            tracer.wait()
            expect(all(p.wait(30) == 0 for p in work), "work failed: %s" % [p.returncode for p in work])
            expect(took > SLOW_FSYNC, "no fsync was slow: all took %.1f s" % took)
            pings = [t for t, _ in m.all("WATCHDOG=1")]
            gap = max(b - a for a, b in zip(pings, pings[1:]))
            expect(len(pings) > took / WATCHDOG and gap < WATCHDOG, "%d signs of life, %.2f s apart at most" % (len(pings), gap))
            print("     fsync %.0f s, watchdog %.0f s: signs of life %.2f s apart at most, slowest answer %.2f s, all took %.1f s" %
                  (SLOW_FSYNC, WATCHDOG, gap, slowest, took))

            time.sleep(max(0, 10 - (time.monotonic() - slept)))
            slept, now = time.monotonic() - slept, switches(idle.process.pid)
            count = sum(now.values()) - sum(woken.values())
            pings = len(quiet.all("WATCHDOG")) - first
            print("     idle for %.0f s with %d clients: woken %d times, %d of them signs of life; resident %.1f MB" %
                  (slept, IDLE_CLIENTS, count, pings, rss(idle.process.pid) / 1e6))
            expect(pings >= slept / 4, "%d signs of life in %.1f s" % (pings, slept))
            expect(count <= pings + 2, "woken %d times for %d signs of life: %s, before %s" % (count, pings, now, woken))
            expect(e2e.sanitized() or rss(idle.process.pid) < 12 << 20, "resident: %d" % rss(idle.process.pid))


def new_dataset_stops_nobody():
    """The name of a new dataset's folder takes 4 s to come to the disk; the jobs and clients of others do not wait for that."""
    if not shutil.which("strace"):
        unavailable("strace is not installed")
    with Folder() as base, Daemon(base, threads=2) as d:
        path = survey(base, 5000)
        d.ctl("push", "b", path).ok()
        tracer = subprocess.Popen(["strace", "-f", "-qq", "-o", "/dev/null", "-p", str(d.process.pid), "-P", d.state + "/datasets",
                                   "-e", "inject=fsync:delay_exit=4000000"], stderr=subprocess.DEVNULL)
        time.sleep(1)
        begun, slowest, jobs = time.monotonic(), 0.0, 0
        push = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "a", path], stdout=subprocess.DEVNULL)
        while push.poll() is None:
            asked = time.monotonic()
            d.ctl("submit", "b", "--new", "--wait").ok()
            slowest = max(slowest, time.monotonic() - asked)
            jobs += 1
        took = time.monotonic() - begun
        tracer.send_signal(signal.SIGINT)
        tracer.wait()
        expect(push.returncode == 0 and took > 4, "the push: %d after %.1f s" % (push.returncode, took))
        print("     a folder's name takes 4 s: %d jobs meanwhile, the slowest %.2f s" % (jobs, slowest))
        expect(jobs > 2, "the slowest of %d jobs took %.1f s" % (jobs, slowest))


def hung_loop_is_silent():
    with Folder() as base:
        m = Manager(base)
        with Daemon(base, env=m.env(1.0)) as d:
            m.wait("WATCHDOG=1")
            os.kill(d.process.pid, signal.SIGSTOP)
            time.sleep(0.2)
            n = len(m.told)
            time.sleep(1.5)
            expect(len(m.told) == n, "a stopped daemon says that it lives")
            os.kill(d.process.pid, signal.SIGCONT)
            m.wait("WATCHDOG=1", after=m.told[-1][0])


main(says_what_it_does, start_gets_more_time, alive_while_the_disk_is_not, new_dataset_stops_nobody, hung_loop_is_silent)
