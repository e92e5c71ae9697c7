"""No memory: the N-th allocation of acutd fails while it answers one request, for N = 1, 2, ... until the request has fewer
allocations. The client gets the right answer or an error about memory; acutd does not end, and answers the same request
afterwards. After a restart all that was acknowledged is there, and every dataset has its mesh. test_memory.c tests more.

ACUT_FAULT_STEP: N grows by this number (2).
"""
import mmap
import os
import struct
import subprocess

import faults
from faults import Fault, Inputs, Store, e2e, expect

BUILD = os.environ.get("ACUT_FAULT_BUILD", ".")


class Allocations:
    def __init__(self, path):
        with open(path, "wb") as f:
            f.truncate(4096)
        self.path, f = path, open(path, "r+b")
        self.map = mmap.mmap(f.fileno(), 24)
        f.close()

    def fail_at(self, n):
        self.map[0:8] = struct.pack("<Q", 0)
        self.map[8:24] = struct.pack("<QQ", 0, 0)
        self.map[0:8] = struct.pack("<Q", n)

    def failed(self):
        return struct.unpack("<Q", self.map[16:24])[0]


def requests(inputs, base):
    """(name, arguments with N in them, statuses besides 0)"""
    out = os.path.join(base, "out.ply")
    yield "ping", ("ping",)
    yield "status", ("status",)
    yield "datasets", ("datasets",)
    yield "dataset show", ("dataset", "show", "a")
    yield "dataset log", ("dataset", "log", "a")
    yield "dataset create", ("dataset", "create", "c%d", "--scale", "0.01")
    yield "jobs", ("jobs",)
    yield "show", ("show", "1")
    yield "plan", ("plan", "a")
    yield "submit", ("submit", "a", "--new", "--wait")
    yield "push", ("push", "p%d", inputs.files[0])
    yield "fetch", ("fetch", "1", "-o", out)
    yield "cache stat", ("cache", "stat")


def whole(store, inputs, pushed):
    """After a restart."""
    there = [d["name"] for d in store.rows("datasets") if d["generation"]]
    missing = set(pushed) - set(there)
    expect(not missing, "acknowledged, and gone after a restart: %s" % sorted(missing))
    for name in there:
        job = store.ctl("submit", name, "--new", "--wait", "--json").ok().json()
        expect(faults.digests(job) == inputs.want[1, ()], "%s has another mesh after a restart" % name)


def main():
    preload = os.path.join(BUILD, "no_memory.so")
    if e2e.sanitized():
        e2e.skip("a sanitizer has its own allocator")
    step = faults.setting("ACUT_FAULT_STEP", 2)
    points = answers = cut_off = 0
    pushed = ["a"]
    with e2e.Folder() as base:
        inputs = Inputs(base)
        a = Allocations(os.path.join(base, "allocations"))
        with Store(base, memory="64M") as store:
            store.start(env={"LD_PRELOAD": preload, "ACUT_NO_MEMORY": a.path})
            store.ctl("push", "a", inputs.files[0]).ok()
            store.ctl("submit", "a", "--wait").ok()
            for name, args in requests(inputs, base):
                n, many = 1, 0
                while n < 3000:
                    this = [w % n if "%d" in w else w for w in args]
                    a.fail_at(n)
                    try:
                        r = store.ctl(*this, timeout=300)
                    except subprocess.TimeoutExpired:
                        raise Fault("%s, allocation %d: no answer" % (name, n))
                    failed = a.failed()
                    a.fail_at(0)
                    expect(store.alive(), "%s, allocation %d: acutd ended with %s" % (name, n, store.process.poll()))
                    if not failed:
                        break
                    many += 1
                    points += 1
                    if r.status == 0:
                        answers += 1
                        if name == "push":
                            pushed.append("p%d" % n)
                    else:
                        expect(r.err.startswith("acutctl: ") and r.status in (1, 69, 74, 75), "%s, allocation %d: %d %s" % (name, n, r.status, r.err))
                        cut_off += r.status == 69
                    n += step
                r = store.ctl(*[w % 999999 if "%d" in w else w for w in args])
                expect(r.status == 0, "%s does not work afterwards: %s" % (name, r.err))
                print("%-16s %4d points" % (name, many), flush=True)
            store.stop()
            store.start()
            whole(store, inputs, pushed)
            # Interrupted pushes may be pending.
            left = [x for x in faults.leftovers(store) if x.endswith(".tmp")]
            expect(not left, "left behind: %s" % left)
            store.stop()
    expect(points >= 50, "hardly an allocation failed: %d" % points)
    print("%d allocations failed, %d requests done all the same, %d clients cut off for want of memory for their answer, 0 crashes" %
          (points, answers, cut_off))


if __name__ == "__main__":
    e2e.main(main)
