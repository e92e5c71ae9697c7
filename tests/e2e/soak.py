"""Eight clients with random jobs against one daemon with little memory: meshes, pushes, submissions, fetches, questions,
cancels, clients that are killed, that read 1 MB/s, and that never read. When all is quiet again: descriptors, threads,
memory, temporary files, disk and the ledger are what they were, jobs are over, and every mesh that was finished has the
digest that its input has under a daemon with much memory.

usage: soak.py [SECONDS [SEED]]     else the environment: ACUT_SOAK_SECONDS (300), ACUT_SOAK_SEED (chosen and printed)

Kept by design, and counted apart: datasets (state/datasets), plans of jobs until rm (state/plans), parts of pushes that were interrupted (they are taken up
again at the end, and must then be gone), finished domains and selections (cache/domains, cache/selected).
"""
import collections
import json
import os
import random
import re
import signal
import stat
import subprocess
import sys
import threading
import time

import e2e
from e2e import Daemon, Fault, Folder, expect

CLIENTS = 8
ROUNDS = 4
PATIENCE = 240  # seconds that any command may take, on a busy machine
MIB = 1 << 20
# What malloc may keep beside the ledger, and what it may add from round to round once all threads have worked.
RSS_SLACK, RSS_GROWTH = 8 * MIB, 4 * MIB
VIEWS = ((), ("--ground",), ("--surface",), ("--every", "7"), ("--thin", "3"), ("--thin", "3", "--thin-pick", "median"),
         ("--crop", "500010,5400010,500060,5400070"), ("--duplicates", "highest"))
# Endings that a race between clients may have: no memory for a push at this moment, a file that another push has put
# there meanwhile, a job that another client has cancelled or removed. (exit status, part of the message)
RACES = ((75, "another push"), (1, "interrupted push"), (75, "interrupted push"), (4, "there is no job"), (1, "was cancelled"),
         (130, ""), (1, "is not over"), (1, "not done"))


class World:
    """Inputs, their expected meshes, and what has been seen."""

    def __init__(self, base, rng):
        self.base, self.files, self.digests, self.lock = base, {}, {}, threading.Lock()
        self.done, self.faults, self.races = collections.Counter(), [], collections.Counter()
        self.jobs = []
        shapes = (("a", 150000, ()), ("b", 60000, ("--seed", "2")), ("c", 20000, ("--distribution", "clustered")),
                  ("d", 300, ()), ("e", 90000, ("--format", "6", "--seed", "3")), ("f", 40000, ("--distribution", "grid")))
        for name, points, options in shapes:
            path = os.path.join(base, name + ".las")
            e2e.run([e2e.SYNTH, "--points", points, *options, path]).ok()
            self.files[name] = path
        data = e2e.data_dir()
        for i, name in enumerate(("las14_pdrf8.laz", "las12_pdrf1_lake_103k.laz") if data else ()):
            self.files["z%d" % i] = os.path.join(data, "lidar", name)

    def learn(self):
        """The digests, by a daemon with much memory and one thread."""
        folder = os.path.join(self.base, "learn")
        os.mkdir(folder)
        with Daemon(folder, memory="512M", threads=1) as d:
            for name, path in self.files.items():
                self.digests[name] = d.ctl("mesh", path, "-o", os.path.join(folder, "x.ply"), "--json").ok().json()["digest"]

    def note(self, what):
        with self.lock:
            self.done[what] += 1

    def fault(self, text):
        with self.lock:
            self.faults.append(text)

    def same(self, key, digest):
        """The first result is recorded; all others must agree."""
        with self.lock:
            want = self.digests.setdefault(key, digest)
        if want != digest:
            self.fault("%s: digest %s, expected %s" % (key, digest, want))


class Client:
    """One of the eight: its own random numbers, folder, and files."""

    def __init__(self, world, daemon, index, seed, until):
        self.world, self.daemon, self.index, self.until = world, daemon, index, until
        self.rng = random.Random("%s client %d" % (seed, index))
        self.folder = os.path.join(world.base, "client%d" % index)
        os.makedirs(self.folder, exist_ok=True)
        self.kinds = [(12, self.mesh), (8, self.mesh_killed), (4, self.mesh_interrupted), (4, self.mesh_slow), (4, self.mesh_dead),
                      (8, self.submit), (6, self.submit_cancelled), (8, self.fetch), (4, self.fetch_killed), (6, self.push),
                      (4, self.push_killed), (8, self.question), (2, self.remove), (2, self.rude)]

    def run(self):
        while time.monotonic() < self.until:
            weight, kinds = zip(*self.kinds)
            act = self.rng.choices(kinds, weight)[0]
            try:
                act()
                self.world.note(act.__name__)
            except Fault as e:
                self.world.fault("client %d, %s: %s" % (self.index, act.__name__, e))
            except subprocess.TimeoutExpired as e:
                self.world.fault("client %d, %s: hangs: %s" % (self.index, act.__name__, e))

    # ---- commands ----

    def out(self, name="m.ply"):
        return os.path.join(self.folder, name)

    def ctl(self, *args):
        """A command that must succeed or lose a race; its JSON, or None."""
        r = self.daemon.ctl(*args, "--json", "--no-progress", timeout=PATIENCE)
        if r.status == 0:
            lines = r.out.splitlines()
            return json.loads(lines[-1]) if lines else {}
        said = r.out + r.err
        for status, words in RACES:
            if r.status == status and words in said:
                with self.world.lock:
                    self.world.races["%s: %d %s" % (args[0], status, words)] += 1
                return None
        raise Fault("%s ended with %d\n%s" % (" ".join(r.args), r.status, said))

    def begin(self, *args, stdout=subprocess.DEVNULL):
        env = dict(os.environ, ACUT_SOCKET=self.daemon.socket)
        return subprocess.Popen([e2e.ACUTCTL, *args, "--no-progress"], stdin=subprocess.DEVNULL, stdout=stdout,
                                stderr=subprocess.DEVNULL, env=env)

    def end(self, p, sig=signal.SIGKILL):
        if p.poll() is None:
            p.send_signal(sig)
        try:
            return p.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            p.kill()
            p.wait()
            raise

    def pick(self):
        return self.rng.choice(sorted(self.world.files))

    def nap(self, most):
        """Mostly short, since most happens at the beginning."""
        time.sleep(most * self.rng.random() ** 3)

    # ---- one-step meshes ----

    def mesh(self):
        name = self.pick()
        out = self.out(self.rng.choice(("m.ply", "m.obj")))
        got = self.ctl("mesh", self.world.files[name], "-o", out)
        if got:
            self.world.same(name, got["digest"])
            os.unlink(out)

    def mesh_killed(self):
        p = self.begin("mesh", self.world.files[self.pick()], "-o", self.out("killed.ply"))
        self.nap(0.6)
        self.end(p)

    def mesh_interrupted(self):
        p = self.begin("mesh", self.world.files[self.pick()], "-o", self.out("interrupted.ply"))
        self.nap(0.6)
        status = self.end(p, signal.SIGINT)
        expect(status in (0, 130, -signal.SIGINT), "SIGINT: %d" % status)

    def mesh_slow(self):
        """Reads 1 MB/s for some seconds, then stops."""
        p = self.begin("mesh", self.world.files["a"], "-o", "-", "--format", "obj", stdout=subprocess.PIPE)
        enough = time.monotonic() + self.rng.uniform(1, 6)
        while time.monotonic() < min(enough, self.until + 3):
            if not p.stdout.read(100000):
                break
            time.sleep(0.1)
        p.stdout.close()
        self.end(p)

    def mesh_dead(self):
        """Stops reading at some point; the connection stays."""
        p = self.begin("mesh", self.world.files[self.rng.choice("ab")], "-o", self.out("dead.ply"))
        self.nap(0.5)
        p.send_signal(signal.SIGSTOP)
        time.sleep(self.rng.uniform(0.5, 5))
        if self.rng.random() < 0.3:
            p.send_signal(signal.SIGCONT)
            self.nap(0.5)
        self.end(p)

    # ---- datasets and jobs ----

    def dataset(self):
        return "survey-%d" % self.rng.randrange(3)

    def push(self):
        self.ctl("push", self.dataset(), self.world.files[self.rng.choice("abdf")])

    def push_killed(self):
        p = self.begin("push", self.dataset(), self.world.files[self.rng.choice("abf")])
        self.nap(0.4)
        self.end(p)

    def remember(self, got):
        if got and got.get("digest"):
            self.world.same((got["dataset"], got["generation"], got["view"]), got["digest"])
        if got:
            with self.world.lock:
                self.world.jobs.append(got["job"])

    def submit(self):
        new = ("--new",) if self.rng.random() < 0.3 else ()
        self.remember(self.ctl("submit", "base", *self.rng.choice(VIEWS), *new, "--wait"))

    def submit_cancelled(self):
        got = self.ctl("submit", self.rng.choice(("base", "base", self.dataset())), *self.rng.choice(VIEWS), "--new")
        if got:
            self.nap(0.5)
            self.ctl("cancel", str(got["job"]))

    def some_job(self):
        with self.world.lock:
            return str(self.rng.choice(self.world.jobs)) if self.world.jobs else "1"

    def fetch(self):
        out = self.out("f.ply")
        got = self.ctl("fetch", self.some_job(), "-o", out)
        if got and os.path.exists(out):
            os.unlink(out)

    def fetch_killed(self):
        p = self.begin("fetch", self.some_job(), "-o", self.out("killed.ply"))
        self.nap(0.4)
        self.end(p)

    def question(self):
        name = self.pick()
        what = self.rng.choice((("info", self.world.files[name]), ("plan", "base", *self.rng.choice(VIEWS)), ("status",), ("jobs",),
                                ("datasets",), ("dataset", "show", "base"), ("show", self.some_job()), ("ping",)))
        self.ctl(*what)

    def remove(self):
        with self.world.lock:
            job = self.world.jobs.pop(self.rng.randrange(len(self.world.jobs))) if len(self.world.jobs) > 5 else None
        if job:
            self.ctl("rm", str(job))

    def rude(self):
        """A connection that sends garbage, or nothing."""
        import socket
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as s:
            s.settimeout(5)
            try:
                s.connect(self.daemon.socket)
                if self.rng.random() < 0.5:
                    s.sendall(self.rng.randbytes(self.rng.randrange(1, 100)))
                self.nap(0.5)
            except OSError:
                pass


# ---- what the daemon holds ----

def descriptors(pid):
    """The number of descriptors of each kind; deleted files are a kind."""
    kinds = collections.Counter()
    for fd in os.listdir("/proc/%d/fd" % pid):
        try:
            to = os.readlink("/proc/%d/fd/%s" % (pid, fd))
        except OSError:
            continue
        kinds["unlinked file" if to.endswith("(deleted)") else re.sub(r"\[.*|/.*", "", to) or "file"] += 1
    return dict(kinds)


def status_number(pid, key):
    with open("/proc/%d/status" % pid) as f:
        for row in f:
            if row.startswith(key + ":"):
                return int(row.split()[1])
    raise Fault("no %s of process %d" % (key, pid))


def files_below(folder):
    found = {}
    for top, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(top, name)
            try:
                s = os.lstat(path)
            except OSError:
                continue
            if stat.S_ISREG(s.st_mode):
                found[os.path.relpath(path, folder)] = s.st_size
    return found


def held(d):
    """The numbers that must be the same at the end as at the beginning."""
    status = d.ctl("status", "--json").ok().json()
    cache, state = files_below(d.cache), files_below(d.state)
    jobs = {"plans/plan-%d" % j["job"] for j in rows(d, "jobs")}
    time.sleep(0.3)  # the daemon hears that those who asked have gone
    return {
        "descriptors": descriptors(d.process.pid),
        "threads": status_number(d.process.pid, "Threads"),
        "ledger": {k: v for k, v in status["ledger"].items() if k != "jobs"},
        "ledger, for the jobs that are there": status["ledger"].get("jobs", 0),
        "jobs running and waiting": (status["jobs_running"], status["jobs_waiting"]),
        "connections": status["connections"],
        "files of the cache that are not kept by design":
            sorted(f for f in cache if not re.match(r"domains/[0-9a-f]{2}/d-[0-9a-f]{32}-[0-9a-f]{32}$|acut-cache$|"
                                                    r"selected/[0-9a-f]{32}/[a-z.]+$", f)),
        "plans of jobs that are not there": sorted(f for f in state if f.startswith("plans/") and f not in jobs),
        "unknown files of the state": sorted(f for f in state if not re.match(
            r"catalogue\.db(-wal|-shm)?$|lock$|acut-state$|datasets/\d+/|geoids/|plans/", f)),
    }


def rows(d, what):
    return [json.loads(row) for row in d.ctl(what, "--json").ok().out.splitlines() if row]


def quiet(d):
    """Waits until nobody is connected and nothing is left to do; returns the state."""
    deadline, last = time.monotonic() + PATIENCE, None
    while time.monotonic() < deadline:
        status = d.ctl("status", "--json").ok().json()
        going = [j["job"] for j in rows(d, "jobs") if j["state"] not in ("done", "failed", "cancelled")]
        now = held(d)
        if status["connections"] == 1 and not going and now == last:
            return now
        last = now
        time.sleep(0.5)
    raise Fault("the daemon does not come to rest: %s" % json.dumps(last, indent=1))


def warm(world, d):
    """Does each kind of work at least once, so that every worker has done everything."""
    d.ctl("push", "base", world.files["a"]).ok()
    for i in range(3):
        d.ctl("push", "survey-%d" % i, world.files["d"]).ok()
    clients = [Client(world, d, i, "warm", 0) for i in range(4)]
    for c in clients:
        for act in (c.mesh, c.submit, c.fetch, c.question, c.mesh_killed, c.submit_cancelled, c.mesh_slow):
            act()


def a_round(world, d, seed, seconds):
    until = time.monotonic() + seconds
    threads = [threading.Thread(target=Client(world, d, i, seed, until).run) for i in range(CLIENTS)]
    for t in threads:
        t.start()
    for t in threads:
        t.join(seconds + 2 * PATIENCE)
    expect(not any(t.is_alive() for t in threads), "a client hangs")
    expect(d.process.poll() is None, "acutd ended with %s\n%s" % (d.process.returncode, d.log_text()[-3000:]))


def check_same(before, after, what, but=()):
    for key, want in before.items():
        expect(key in but or after[key] == want, "%s: %s: %s, was %s" % (what, key, after[key], want))


def check_memory(d, samples):
    print("resident when quiet, MiB:", " ".join("%.1f" % (s / MIB) for s in samples))
    if e2e.sanitized():
        print("(a sanitizer's memory is not judged)")
        return
    expect(max(samples[1:]) <= samples[0] + RSS_SLACK, "resident memory does not come back")
    if len(samples) > 2:
        expect(samples[-1] <= max(samples[1:-1]) + RSS_GROWTH, "resident memory grows from round to round")


def finish_pushes(world, d):
    """Continues interrupted pushes; then the files of each dataset are its manifests and the segments that they name."""
    for i in range(3):
        for name in "abdf":
            d.ctl("push", "survey-%d" % i, world.files[name], timeout=PATIENCE).ok()
    names = {x["name"]: x for x in rows(d, "datasets")}
    expect(not [n for n, x in names.items() if x["pending"]], "interrupted pushes are left: %s" % names)
    files = [f for f in files_below(d.state) if f.startswith("datasets/")]
    odd = [f for f in files if not re.match(r"datasets/\d+/(manifest-[0-9-]+|push-\d+\.seg)$", f)]
    expect(not odd, "left in the datasets: %s" % odd)
    manifests = [f for f in files if "/manifest-" in f]
    expect(len(manifests) == len(names), "a manifest a dataset: %s" % manifests)
    size = sum(s for f, s in files_below(d.state).items() if f.endswith(".seg"))
    expect(size == sum(x["bytes"] for x in names.values()), "segments have %d bytes, datasets say %s" % (size, names))


def remove_jobs(d):
    for job in rows(d, "jobs"):
        d.ctl("rm", str(job["job"]), timeout=PATIENCE).ok()
    expect(not rows(d, "jobs"), "jobs are left after rm of all")


def soak(seconds, seed):
    print("soak: %g seconds, seed %s" % (seconds, seed), flush=True)
    rounds = ROUNDS if seconds >= 60 else 2
    with Folder() as base:
        world = World(base, random.Random(seed))
        world.learn()
        with Daemon(base, memory="32M", threads=4) as d:
            warm(world, d)
            remove_jobs(d)
            before = quiet(d)
            samples = [e2e.resident(d.process.pid)]
            for i in range(rounds):
                a_round(world, d, "%s round %d" % (seed, i), seconds / rounds)
                after = quiet(d)
                samples.append(e2e.resident(d.process.pid))
                check_same(before, after, "after round %d" % (i + 1), ("ledger, for the jobs that are there",))
            print("done:", ", ".join("%d %s" % (n, k) for k, n in sorted(world.done.items())))
            print("lost races:", dict(world.races))
            for text in world.faults[:10]:
                print("FAULT", text)
            expect(not world.faults, "%d things went wrong (seed %s)" % (len(world.faults), seed))
            finish_pushes(world, d)
            remove_jobs(d)
            check_same(before, quiet(d), "after everything was removed")
            check_memory(d, samples)
            peak = d.vmhwm()
            print("VmHWM %.1f MiB of 32; %d finished domains and %d files of selections kept, %.1f MiB" %
                  (peak / MIB, *kept(d)))
            expect(peak <= (32 + 32) * MIB, "VmHWM is %d" % peak)
            d.stop()
            expect(d.process.returncode == 0, "acutd ended with %s" % d.process.returncode)
            expect("Sanitizer" not in d.log_text(), d.log_text()[-5000:])


def kept(d):
    files = files_below(d.cache)
    domains = [s for f, s in files.items() if f.startswith("domains/")]
    selected = [s for f, s in files.items() if f.startswith("selected/")]
    return len(domains), len(selected), sum(domains + selected) / MIB


if __name__ == "__main__":
    argv = sys.argv[1:]
    SECONDS = float(argv[0] if argv else os.environ.get("ACUT_SOAK_SECONDS", 300))
    SEED = argv[1] if len(argv) > 1 else os.environ.get("ACUT_SOAK_SEED") or str(random.randrange(10**9))

    def soaked():
        soak(SECONDS, SEED)

    e2e.main(soaked)
