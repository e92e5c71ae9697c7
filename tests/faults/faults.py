"""Shared by the tests of faults on a real acutd: a daemon that is started many times and timed, work whose acknowledgements are
recorded, and a check of what must be there after a fault. The rest is in ../e2e/e2e.py."""
import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from e2e import Fault, expect  # noqa: E402,F401

POINTS = (6000, 9000)


unavailable = e2e.unavailable


def need_tools(*names):
    for name in names:
        if not shutil.which(name):
            unavailable("%s is not installed" % name)


def setting(name, otherwise):
    return int(os.environ.get(name) or otherwise)


class Killed(Exception):
    """The daemon was killed, as intended."""


class Store:
    """State and cache below `base`, and the daemons that use them, one after the other."""

    quiet = False  # True: the log of a failure is not printed
    acutd, acutctl = e2e.ACUTD, e2e.ACUTCTL

    def __init__(self, base, memory="24M", args=(), state=None, cache=None):
        self.base, self.args, self.memory = base, list(args), memory
        self.state, self.cache = state or os.path.join(base, "state"), cache or os.path.join(base, "cache")
        self.socket, self.log = os.path.join(base, "d.sock"), os.path.join(base, "log")
        self.process, self.starts, self.worked = None, [], []

    def start(self, prefix=(), env=None, within=100):
        """Starts acutd and waits for READY=1. Without a prefix, records how long that took, and acutd's CPU time."""
        notify = os.path.join(self.base, "notify")
        if os.path.exists(notify):
            os.unlink(notify)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as s, open(self.log, "ab") as log:
            s.bind(notify)
            s.settimeout(0.05)
            begun = time.monotonic()
            self.process = subprocess.Popen(
                [*prefix, self.acutd, "--no-config", "--init", "--socket", self.socket, "--state", self.state, "--cache", self.cache, "--memory",
                 self.memory, "--threads", "2", *self.args],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=dict(os.environ, NOTIFY_SOCKET=notify, **(env or {})))
            while time.monotonic() - begun < within:
                try:
                    if b"READY=1" in s.recv(4096):
                        break
                except socket.timeout:
                    if self.process.poll() is not None:
                        self.ended()
            else:
                raise Fault("acutd is not ready within %d s\n%s" % (within, self.log_text()))
            if not prefix and not env:
                self.starts.append(time.monotonic() - begun)
                self.worked.append(e2e.cpu_of(self.process.pid))
        return self

    def ended(self):
        if self.process.returncode == -signal.SIGKILL:
            raise Killed()
        raise Fault("acutd ended with %s\n%s" % (self.process.returncode, self.log_text()))

    def log_text(self):
        with open(self.log, errors="replace") as f:
            return f.read()[-3000:]

    def alive(self):
        return self.process.poll() is None

    def pid(self):
        """The process id of acutd itself, also with a prefix."""
        try:
            with open("/proc/%d/task/%d/children" % (self.process.pid, self.process.pid)) as f:
                inner = f.read().split()
        except OSError:
            return self.process.pid
        return int(inner[0]) if inner else self.process.pid

    def kill(self):
        if self.process and self.alive():
            self.kill_inner()
        if self.process:
            self.process.wait()

    def kill_inner(self):
        """Kills acutd itself; a prefix ends with it."""
        with contextlib.suppress(ProcessLookupError):  # strace has killed it just now
            os.kill(self.pid(), signal.SIGKILL)

    def stop(self):
        if self.alive():
            self.process.send_signal(signal.SIGTERM)
        self.process.wait(100)
        return self.process.returncode

    def ctl(self, *args, **kw):
        return e2e.run([self.acutctl, *args], env={"ACUT_SOCKET": self.socket}, timeout=kw.pop("timeout", 300), **kw)

    def rows(self, what):
        return [json.loads(line) for line in self.ctl(what, "--json").ok().out.splitlines() if line]

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        if exc[0] is not None and not self.quiet and os.path.exists(self.log):
            print(self.log_text())
        self.kill()


class Inputs:
    """Two files of points, a file of lines that is pushed with the second, another one that is pushed alone, and the digests of their
    meshes: of three generations, and of a fourth one, which undoes the second."""

    def __init__(self, base):
        self.files = []
        for i, n in enumerate(POINTS):
            self.files.append(os.path.join(base, "f%d.las" % i))
            e2e.run([e2e.SYNTH, "--points", n, "--seed", i + 1, self.files[-1]]).ok()
        self.lines = os.path.join(base, "lines.txt")
        with open(self.lines, "w") as f:
            f.write("acut-lines 1\ncrs EPSG:32633\nunit-z m\ndensify 2\nfeature 1 hard\nline\n500001 5400001 200\n500020 5400022 201\n"
                    "feature 2 hard\nline\n500001 5400020 203\n500021 5400002 204\nfeature 3 lake\nring\n500008 5400001 199\n500012 5400001 199\n"
                    "500010 5400004 199\n")
        self.more = os.path.join(base, "more.txt")
        with open(self.more, "w") as f:
            f.write("acut-lines 1\ncrs EPSG:32633\nunit-z m\nfeature 1 hard\nline\n500003 5400018 200\n500018 5400003 201\n500019 5400004 202\n")
        self.pushed = [self.files[:1], self.files[1:] + [self.lines], [self.more]]
        where = os.path.join(base, "want")
        os.mkdir(where)
        self.want = {}
        with Store(where) as s:
            s.start()
            for n in (1, 2, 3):
                s.ctl("push", "w", *self.pushed[n - 1]).ok()
                for view in VIEWS:
                    self.want[n, view] = digests(s.ctl("submit", "w", *view, "--wait", "--json").ok().json())
            s.ctl("push", "v", self.files[0], self.more).ok()
            self.want[4, ()] = digests(s.ctl("submit", "v", "--wait", "--json").ok().json())
            s.stop()
        shutil.rmtree(where)


VIEWS = ((), ("--every", "3"))


def digests(job):
    return job["digest"], job["vertex_digest"]


class Acks:
    """All that the daemon has acknowledged."""

    def __init__(self):
        self.generation, self.jobs, self.lock = {}, {}, threading.Lock()
        self.checked = 0

    def check(self, store):
        """Checks that all of it is there."""
        with self.lock:
            generation, jobs = dict(self.generation), dict(self.jobs)
        have = {d["name"]: d["generation"] for d in store.rows("datasets")}
        for name, g in generation.items():
            expect(have.get(name, 0) >= g, "dataset %s had generation %d, has %s" % (name, g, have.get(name)))
        found = {j["job"]: j for j in store.rows("jobs")}
        for number in jobs:
            expect(number in found, "job %d is gone" % number)
            # The job is acknowledged, not its end: if the end was not on disk, the job runs again.
            expect(found[number]["state"] not in ("failed", "cancelled"), "job %d was done, is %s" % (number, found[number]["state"]))
        for number in sorted(jobs)[-3:]:
            if found[number]["state"] != "done":
                store.ctl("wait", str(number)).ok()
            got = store.ctl("show", str(number), "--json").ok().json()
            expect(digests(got) == jobs[number], "job %d has another mesh" % number)
        self.checked += len(generation) + len(jobs)
        with self.lock:
            for number in list(jobs)[:-4]:  # older ones were checked often enough
                self.jobs.pop(number, None)


def work(store, inputs, acks, name):
    """Three pushes, a job for each view after each push, a revert that makes a line set, and the mesh of the last job. Raises Killed
    if the daemon has ended. The work can be repeated then; acknowledged parts of it are not done again."""
    def ctl(*args):
        r = store.ctl(*args)
        if r.status and not store.alive():
            raise Killed()
        if r.status in (69, 74) and "closed" in r.out + r.err:
            raise Killed()
        # The socket is closed before the process ends. Nobody kills those of control runs.
        deadline = time.monotonic() + (0 if store.quiet else e2e.PATIENCE)
        while r.status and time.monotonic() < deadline:
            if not store.alive():
                raise Killed()
            time.sleep(0.02)
        return r.ok()

    have = {d["name"]: d["generation"] for d in map(json.loads, ctl("datasets", "--json").out.splitlines())}.get(name, 0)
    for n in (1, 2, 3):
        if have > 3:
            break  # it was reverted
        known = acks.generation.get(name, 0) >= n
        r = ctl("push", name, *sum(inputs.pushed[:n], []), "--json")
        got = [json.loads(line) for line in r.out.splitlines()]
        expect(not known or all(g["state"] == "known" for g in got), "was pushed, is pushed again: %s" % r.out)
        with acks.lock:
            acks.generation[name] = max(acks.generation.get(name, 0), got[-1]["generation"])
        generation = got[-1]["generation"]
        if generation > n:
            continue  # from an earlier run
        for view in VIEWS:
            job = ctl("submit", name, *view, "--wait", "--json").json()
            expect(digests(job) == inputs.want[n, view], "%s %s: another mesh" % (name, view))
            with acks.lock:
                acks.jobs[job["job"]] = digests(job)
    if have <= 3:
        got = ctl("dataset", "revert", name, "2", "--json").json()
        with acks.lock:
            acks.generation[name] = got["generation"]
    job = ctl("submit", name, "--wait", "--json").json()
    expect(digests(job) == inputs.want[4, ()], "%s: another mesh after the revert" % name)
    # The line set of this generation is made again.
    before = ctl("submit", name, "--at", "2", "--wait", "--json").json()
    expect(digests(before) == inputs.want[2, ()], "%s: another mesh of generation 2" % name)
    with acks.lock:
        acks.jobs[job["job"]] = digests(job)
    out = os.path.join(store.base, "out.ply")
    ctl("fetch", str(job["job"]), "-o", out)  # checks the digests
    os.unlink(out)


def leftovers(store):
    """Files of a store at rest that should not be there."""
    bad = []
    for top, _, names in os.walk(store.state):
        for name in names:
            if name.endswith((".tmp", ".run", ".pending", ".stage", ".part")) or ".lines-" in name:
                bad.append(os.path.relpath(os.path.join(top, name), store.state))
    return bad


def percentile(values, p):
    values = sorted(values)
    return values[min(len(values) - 1, int(p * len(values)))] if values else 0
