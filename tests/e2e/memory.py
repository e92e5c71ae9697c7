"""The one number: acutd inside a memory cgroup of memory + 32 MiB + the pipes in use, under every kind of load.

After each load: no OOM kill, VmHWM <= memory + 32 MiB, and while it ran no growth of the resident size beyond what
the ledger said (both come in one Status). Where no memory cgroup can be made the rest is checked all the same, and
the test ends as skipped, with the reason. ACUT_MEMORY_LONG=1: millions of points, thousands of files and jobs.
"""
import json
import math
import os
import random
import socket
import struct
import sys
import threading
import time

import e2e
from e2e import Daemon, Folder, expect, run

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import acut_wire
from acut_wire import Client, HEADER, Refused, pack, pb

MIB = 1 << 20
SPARE = 32 * MIB
# Of the resident size at rest and what is not charged because its bound is small (docs/design/memory.md).
UNCHARGED = 14 * MIB
LONG = bool(os.environ.get("ACUT_MEMORY_LONG"))
BASE = None


def size_of(text):
    return int(text[:-1]) * {"M": MIB, "G": 1 << 30}[text[-1]]


# ---- the cgroup ----

def own_group():
    with open("/proc/self/cgroup") as f:
        for line in f:
            _, controllers, path = line.strip().split(":", 2)
            if "memory" in controllers.split(","):
                return "/sys/fs/cgroup/memory" + path
    raise OSError("there is no memory controller of cgroup version 1")


class Group:
    """A memory cgroup below the test's own."""

    def __init__(self, limit):
        self.path = "%s/acut-test-%d-%d" % (own_group(), os.getpid(), random.getrandbits(32))
        os.mkdir(self.path)
        try:
            self.put("memory.limit_in_bytes", limit)
        except OSError:
            self.remove()
            raise

    def put(self, name, value):
        with open("%s/%s" % (self.path, name), "w") as f:
            f.write(str(value))

    def get(self, name):
        with open("%s/%s" % (self.path, name)) as f:
            return f.read()

    def word(self, name, key):
        return int(dict(line.split() for line in self.get(name).splitlines())[key])

    def remove(self):
        for _ in range(50):
            try:
                os.rmdir(self.path)
                return
            except OSError:
                time.sleep(0.1)


def groups():
    """Why no cgroup can be made; None: they can."""
    if e2e.sanitized():
        return "a sanitizer's memory is not the product's"
    try:
        group = Group(64 * MIB)
    except OSError as e:
        return "no memory cgroup can be made here: %s" % e
    group.remove()
    return None


NO_GROUPS = groups()


class Watcher(threading.Thread):
    """Requests the status all the time: records the most that was resident beyond the ledger."""

    def __init__(self, d):
        super().__init__(daemon=True)
        self.d, self.over, self.most, self.ended = d, 0, 0, False
        self.names = {}
        self.fault = None

    def run(self):
        try:
            with Client(self.d.socket) as c:
                while not self.ended:
                    self.look(c.ask("status_request", pb.StatusRequest()))
                    time.sleep(0.01)
        except (acut_wire.Fault, OSError) as e:
            self.fault = e

    def look(self, s):
        held = sum(e.bytes for e in s.ledger)
        self.most = max(self.most, held)
        self.over = max(self.over, s.rss_bytes - held)
        for e in s.ledger:
            self.names[e.name] = e.peak
        by_name = {}
        for h in s.holders:
            for e in h.held:
                by_name[e.name] = by_name.get(e.name, 0) + e.bytes
        for e in s.ledger:
            # Index pages and the like come and go on workers between two looks at them.
            if by_name.get(e.name, 0) > e.bytes and e.name in ("stage", "domain", "emitter", "jobs", "files"):
                self.fault = self.fault or AssertionError("holders have %d bytes of %s, the ledger %d" %
                                                          (by_name[e.name], e.name, e.bytes))

    def end(self):
        self.ended = True
        self.join(60)


class Box:
    """A daemon in its cgroup: with Box("24M", pipes=2) as b: b.load("name", function)."""

    def __init__(self, memory, pipes=1, threads=2):
        self.memory, self.pipes, self.threads = size_of(memory), pipes, threads
        self.text = memory

    def __enter__(self):
        prefix = ()
        self.group = None
        if not NO_GROUPS:
            # A service wants 48 MiB beside its memory and would not start; what it uses is held to less.
            self.group = Group(self.memory + 48 * MIB)
            prefix = ("/bin/sh", "-c", 'echo $$ > "$0"/cgroup.procs && exec "$@"', self.group.path)
        self.folder = Folder()
        self.base = self.folder.__enter__()
        self.d = Daemon(self.base, memory=self.text, threads=self.threads, prefix=prefix)
        try:
            self.d.start()
            if self.group:
                self.group.put("memory.limit_in_bytes", self.memory + SPARE + self.pipes * MIB)
        except BaseException:
            self.__exit__(None, None, None)
            raise
        self.ctl = self.d.ctl
        self.socket = self.d.socket
        return self

    def __exit__(self, *exc):
        if exc[0] is not None:
            print(self.d.log_text()[-3000:])
        self.d.__exit__(None, None, None)
        self.folder.__exit__(None, None, None)
        if self.group:
            self.group.remove()

    def load(self, name, what, *args):
        """Runs it, then checks its memory."""
        try:
            with open("/proc/%d/clear_refs" % self.d.process.pid, "w") as f:
                f.write("5")
        except OSError:
            pass
        if self.group:
            self.group.put("memory.max_usage_in_bytes", 0)
        watcher = Watcher(self.d)
        start = time.monotonic()
        watcher.start()
        try:
            what(self, *args)
        finally:
            watcher.end()
        killed = self.group.word("memory.oom_control", "oom_kill") if self.group else 0
        expect(killed == 0, "%s: %d OOM kills" % (name, killed))
        expect(self.d.process.poll() is None, "%s: acutd ended with %s" % (name, self.d.process.returncode))
        expect(watcher.fault is None, "%s: %s" % (name, watcher.fault))
        hwm = self.d.vmhwm()
        line = "     %-4s %-28s %5.1f s  VmHWM %5.1f  held %5.1f  beside %4.1f" % (
            self.text, name, time.monotonic() - start, hwm / MIB, watcher.most / MIB, watcher.over / MIB)
        if self.group:
            line += "  max_usage %5.1f  rss %4.1f" % (int(self.group.get("memory.max_usage_in_bytes")) / MIB,
                                                    self.group.word("memory.stat", "total_rss") / MIB)
        print(line + " MiB", flush=True)
        expect(hwm <= self.memory + SPARE, "%s: VmHWM %.1f MiB" % (name, hwm / MIB))
        if not e2e.sanitized():
            expect(watcher.over <= UNCHARGED, "%s: %.1f MiB beside what the ledger says" % (name, watcher.over / MIB))


# ---- inputs ----

def synth(name, points, *args):
    path = os.path.join(BASE, name)
    if not os.path.exists(path):
        run([e2e.SYNTH, "--points", points, *args, path]).ok()
    return path


def las(path, points, x0):
    body = b"".join(struct.pack("<iiiHBBbBH", x, y, z, 0, 0x09, 2, 0, 0, 0) for x, y, z in points)
    head = struct.pack("<4sHH16sBB32s32sHHHIIBHI5I3d3d6d", b"LASF", 0, 0, b"", 1, 2, b"", b"", 1, 2026, 227, 227, 0, 0, 20,
                       len(points), len(points), 0, 0, 0, 0, .01, .01, .01, 0, 0, 0, 1e5, -1e5, 1e5, -1e5, 1e3, -1e3)
    with open(path, "wb") as f:
        f.write(head + body)


def tiny_files(n):
    folder = os.path.join(BASE, "tiny-%d" % n)
    if not os.path.exists(folder):
        os.mkdir(folder)
        for i in range(n):
            x, y = 1000 * (i % 100), 1000 * (i // 100)
            las("%s/survey-of-a-valley-tile-%06d.las" % (folder, i), [(x, y, i), (x + 700, y + 10, 5), (x + 9, y + 800, 7)], 0)
    return folder


def star(corners):
    """A polygon of many corners around the middle of the synthetic survey of 1 M points, as GeoJSON."""
    path = os.path.join(BASE, "star-%d.json" % corners)
    ring = []
    for i in range(corners):
        a, r = 2 * math.pi * i / corners, 170 if i % 2 else 60
        ring.append([round(500177 + r * math.cos(a), 2), round(5400177 + r * math.sin(a), 2)])
    with open(path, "w") as f:
        json.dump({"type": "Polygon", "coordinates": [ring + ring[:1]]}, f)
    return path


# ---- loads ----

def ctl_ok(b, *args, **kw):
    return b.ctl(*args, "--quiet", timeout=900, **kw).ok()


def mesh(b, path, *args):
    ctl_ok(b, "mesh", path, "--format", "null", *args)


def at_once(n, fn):
    faults = []

    def one(i):
        try:
            fn(i)
        except Exception as e:
            faults.append(e)

    threads = [threading.Thread(target=one, args=(i,)) for i in range(n)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    if faults:
        raise faults[0]


def laz(b):
    data = e2e.data_dir()
    names = [n for n in sorted(os.listdir(data + "/lidar")) if n.endswith("k.laz")] if data else []
    at_once(len(names), lambda i: mesh(b, data + "/lidar/" + names[i]))


def tiny(b, n):
    ctl_ok(b, "push", "tiny", tiny_files(n))
    again = b.ctl("push", "tiny", tiny_files(n), "--json", timeout=900)
    expect(again.status == 0, again.err[:500])
    mesh(b, tiny_files(n // 4))


def views(b, survey):
    ctl_ok(b, "push", "views", survey)
    texts = [("--thin", "1"), ("--thin", "0.5", "--thin-pick", "median"), ("--crop", star(2400)), ("--every", "3"),
             ("--crop", star(300), "--ground")]
    ids = [b.ctl("submit", "views", *t, "--json").ok().json()["job"] for t in texts]
    ctl_ok(b, "wait", *map(str, ids))


def areas(b):
    """Plans and jobs with view texts of the greatest length, waiting at once."""
    area = star(2600)
    at_once(6, lambda i: b.ctl("plan", "views", "--crop", area, "--zmax", str(1000 + i)))
    for i in range(60):
        got = b.ctl("submit", "views", "--crop", area, "--zmin", str(-i), "--quiet")
        expect(got.status in (0, 75), "%d %s" % (got.status, got.err))
    for job in b.ctl("jobs", "--json").out.splitlines():
        j = json.loads(job)
        if j["state"] not in ("done", "failed", "cancelled"):
            b.ctl("cancel", str(j["job"]))
    for job in b.ctl("jobs", "--json").out.splitlines():
        b.ctl("rm", str(json.loads(job)["job"]))


def eight(b, survey):
    at_once(8, lambda i: mesh(b, survey, "--zmin", str(-1000 - i)))


def slow(b, survey, n):
    """Clients that never read, and one that does."""
    clients = []
    try:
        for _ in range(n):
            c = Client(b.socket)
            clients.append(c)
            done = c.push([survey])
            job = c.ask("submit", pb.Submit(dataset=done.dataset, bound=True))
            c.pipe = c.ask("fetch", pb.Fetch(job=job.id))[1]
        time.sleep(1.0)
        with Client(b.socket) as c:
            s = c.ask("status_request", pb.StatusRequest())
            expect(s.pipe_capacity >= n * 65536, "pipes: %d" % s.pipe_capacity)
        mesh(b, survey)
    finally:
        for c in clients:
            if hasattr(c, "pipe"):
                os.close(c.pipe)
            c.close()


def crowd(b, n):
    """Connections that send requests and never read."""
    question = pack(7, pb.Message(status_request=pb.StatusRequest()))
    hello = pack(1, pb.Message(hello=pb.Hello(version_min=1, version_max=1, program="crowd")))
    wires = []
    for _ in range(n):
        s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        s.settimeout(e2e.PATIENCE)
        s.connect(b.socket)
        s.sendall(hello)
        s.setblocking(False)
        wires.append(s)
    for _ in range(30):
        for s in wires:
            try:
                s.send(question * 20)
            except OSError:
                pass
        with Client(b.socket, timeout=e2e.PATIENCE) as c:
            c.ping()
    with Client(b.socket, timeout=e2e.PATIENCE) as c:
        c.ping()
    if b.group:
        # Unread answers that lie in sockets are the kernel's memory, but count with the group.
        kernel = int(b.group.get("memory.kmem.usage_in_bytes"))
        expect(kernel <= n * 64 * 1024, "the kernel keeps %.1f MiB for %d who do not read" % (kernel / MIB, n))
    for s in wires:
        s.close()


def lengths(b):
    """Headers that claim 64 MB, and frames without their last byte."""
    wires = []
    hello = pack(1, pb.Message(hello=pb.Hello(version_min=1, version_max=1, program="hostile")))
    for i in range(150):
        s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        s.settimeout(e2e.PATIENCE)
        s.connect(b.socket)
        try:
            s.sendall(hello)
            if i % 2:
                s.sendall(HEADER.pack(acut_wire.MAGIC, acut_wire.VERSION, 64 << 20, 2, 0, bytes(3)))
            else:
                s.sendall(HEADER.pack(acut_wire.MAGIC, acut_wire.VERSION, acut_wire.BODY_MAX, 2, 0, bytes(3)) + bytes(60000))
        except OSError:
            pass
        wires.append(s)
        if i % 10 == 0:
            with Client(b.socket, timeout=e2e.PATIENCE) as c:
                c.ping()
    for s in wires:
        s.close()


def lines(b):
    path = os.path.join(BASE, "long.xyz")
    with open(path, "w") as f:
        f.write("1 2 3\n" * 1000 + "4 5 " + "6" * (20 << 20) + "\n")
    got = b.ctl("mesh", path, "--format", "null")
    expect(got.status in (1, 3), "%d %s" % (got.status, got.err[:300]))
    with open(path, "w") as f:
        f.write("# " + "x" * (8 << 20) + "\n" + "".join("%d %d %d\n" % (i % 300, i // 300, i % 7) for i in range(90000)))
    b.ctl("mesh", path, "--format", "null")


def lists(b, datasets, jobs):
    small = os.path.join(BASE, "small.las")
    las(small, [(0, 0, 0), (900, 0, 1), (0, 900, 2), (900, 900, 3)], 0)
    with Client(b.socket) as c:
        for i in range(datasets):
            c.ask("dataset_create", pb.DatasetCreate(name="made-%d" % i, scale_xy="0.01", scale_z="0.01"))
    ctl_ok(b, "push", "small", small)
    refused = 0
    with Client(b.socket) as c:
        for i in range(jobs):
            try:
                c.ask("submit", pb.Submit(dataset="small", view="view 1", fresh=True))
            except Refused as e:
                expect(e.code == "busy", str(e))
                refused += 1
    at_once(4, lambda i: [b.ctl("jobs").ok(), b.ctl("datasets").ok()])
    for _ in range(300):
        s = b.ctl("status", "--json").ok().json()
        if not s["jobs_running"] and not s["jobs_waiting"]:
            break
        time.sleep(0.1)
    if refused:
        print("     %d of %d jobs had to come later" % (refused, jobs))


def infos(b, survey):
    at_once(6, lambda i: b.ctl("info", survey, *(("--records",) if i % 2 else ())))


def degrees(b, n):
    path = os.path.join(BASE, "degrees.xyz")
    rng = random.Random(1)
    with open(path, "w") as f:
        for _ in range(n):
            f.write("%.7f %.7f %.2f\n" % (9 + rng.random() * 2, 47 + rng.random() * 2, rng.random() * 50))
    ctl_ok(b, "mesh", path, "--format", "null", "--assume-crs", "EPSG:4326")


def names(b, n):
    """Memory that a push keeps for each of its files is charged: an open push of many names."""
    small = os.path.join(BASE, "small.las")
    las(small, [(0, 0, 0), (900, 0, 1), (0, 900, 2)], 0)
    with Client(b.socket) as c, open(small, "rb") as f:
        begun = c.ask("push_begin", pb.PushBegin(dataset="names"))
        before = b.ctl("status", "--json").ok().json()
        kept = 0
        for i in range(n):
            name = "a-folder-of-the-survey/another-one/tile-%d.las" % i
            try:
                c.ask("probe", pb.Probe(push=begun.push, name=name, path=("/data/" + name).encode(), add=True), f.fileno())
                kept += 1
            except Refused as e:
                expect(e.code in ("does-not-fit", "busy") and "files" in str(e), str(e))
                break
        after = b.ctl("status", "--json").ok().json()
        grown = after["rss_bytes"] - before["rss_bytes"]
        charged = sum(after["ledger"].values()) - sum(before["ledger"].values())
        print("     %d of %d names: resident grew by %.1f MiB, the ledger by %.1f" % (kept, n, grown / MIB, charged / MIB))
        expect(kept > 2000, "only %d names fit" % kept)
        expect(e2e.sanitized() or grown - charged <= 2 * MIB, "%d bytes are charged for %d" % (charged, grown))
        holder = [h for h in after["holders"] if h["kind"] == "push"]
        expect(len(holder) == 1 and holder[0]["held"].get("files", 0) > 100 * kept, str(after["holders"]))
        c.ask("push_abort", pb.PushAbort(push=begun.push))


def at_rest(b):
    """All memory is released."""
    held = {}

    def is_released():
        ledger = b.ctl("status", "--json").ok().json()["ledger"]
        held.update(ledger)
        return sum(ledger.values()) < 8 * MIB and not any(
            ledger[name] for name in ("stage", "domain", "emitter", "pipe", "input", "index", "plan", "files", "manifest"))
    e2e.until(is_released, lambda: "memory is still held: %s" % held)


# ---- the cases ----

def least_memory():
    survey = synth("survey.las", "3M" if LONG else "700k")
    with Box("24M", pipes=9) as b:
        b.load("mesh", mesh, survey)
        b.load("LAZ, several at once", laz)
        b.load("tiny files", tiny, 6000 if LONG else 5000)
        b.load("views", views, survey)
        b.load("large areas", areas)
        b.load("eight jobs at once", eight, synth("eight.las", "2M" if LONG else "250k"))
        b.load("readers that stopped", slow, synth("eight.las", "2M" if LONG else "250k"), 6)
        b.load("400 that do not read", crowd, 400)
        b.load("hostile lengths", lengths)
        b.load("absurd lines", lines)
        b.load("lists", lists, 2000 if LONG else 300, 4000 if LONG else 400)
        b.load("info", infos, survey)
        b.load("names of files", names, 20000)
        b.load("duplicates", mesh, synth("duplicates.las", "3M" if LONG else "400k", "--distribution", "duplicates"))
        b.load("degrees", degrees, 500000 if LONG else 100000)
        b.load("at rest", at_rest)


def other_memories():
    # Meson has malloc fill what it gives, and with it what lies before a block of huge pages, 2 MiB each, which nobody uses.
    os.environ.pop("MALLOC_PERTURB_", None)
    survey = synth("large.las", "12M" if LONG else "2M")
    for memory in ("64M", "256M"):
        with Box(memory, pipes=9, threads=4 if LONG else 2) as b:
            b.load("mesh", mesh, survey)
            b.load("LAZ, several at once", laz)
            b.load("at rest", at_rest)


def whole():
    global BASE
    if NO_GROUPS:
        print("without a cgroup:", NO_GROUPS)
    with Folder() as BASE:
        try:
            e2e.main(least_memory, other_memories)
        except SystemExit as e:
            if not e.code and NO_GROUPS:
                e2e.skip(NO_GROUPS) if not os.path.isdir("/sys/fs/cgroup/memory") else e2e.unavailable(NO_GROUPS)
            raise


if __name__ == "__main__":
    whole()
