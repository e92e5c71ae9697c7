"""One system call of a real acutd fails (strace): the N-th write, fsync, rename, unlink, open or read of a thread, once or
always. The client gets an answer, acutd does not end, and when the fault is gone the same work gives the right mesh. test_errors.c
does this in process for every call.

ACUT_FAULT_CALLS: how many (30); ACUT_FAULT_SEED.
"""
import random
import subprocess

import faults
from faults import Acks, Fault, Inputs, Store, e2e, expect

CALLS = (("pwrite64", "ENOSPC"), ("pwrite64", "EDQUOT"), ("pwrite64", "EIO"), ("fsync", "EIO"), ("fdatasync", "EIO"), ("renameat,renameat2", "EIO"),
         ("unlinkat", "EIO"), ("mkdirat", "ENOSPC"), ("mkdirat", "EDQUOT"), ("ftruncate", "EIO"))
STATUS = (1, 69, 74, 75)


def attempt(store, inputs, name):
    """All the work with a fault somewhere: every failure has a reason."""
    failed = 0
    for args in (("push", name, *sum(inputs.pushed, [])), ("submit", name, "--wait", "--timeout", "10"), ("push", name + "x", inputs.files[0])):
        for _ in range(2):
            r = store.ctl(*args, timeout=300)
            expect(store.alive(), "acutd ended: %s" % store.log_text())
            if r.status == 0:
                break
            failed += 1
            expect(r.status in STATUS + (4, 124) and r.err.startswith("acutctl: "), "%s: %d %s" % (args[0], r.status, r.err))
    return failed


def refused_start(store):
    """An error of the disk is none that another start cannot help against: the exit status is that of such an error, and systemd starts
    acutd again."""
    store.start()
    store.stop()
    try:
        store.start(prefix=["strace", "-f", "-qq", "-o", "/dev/null", "-e", "trace=pwrite64", "-e", "inject=pwrite64:error=EIO:when=1+"])
    except Fault:
        expect(store.process.returncode == 74, "a start ended with %d\n%s" % (store.process.returncode, store.log_text()))
        return
    raise Fault("it starts, and cannot write")


def main():
    faults.need_tools("strace")
    points, rng = faults.setting("ACUT_FAULT_CALLS", 30), random.Random(faults.setting("ACUT_FAULT_SEED", 1))
    failed = refused = 0
    with e2e.Folder() as base, Store(base, args=("--space-wait", "1")) as store:
        inputs = Inputs(base)
        refused_start(store)
        for i in range(points):
            call, error = CALLS[i % len(CALLS)]
            when = "%d%s" % (rng.randrange(1, 30), "+" if rng.random() < 0.3 else "")
            inject = "inject=%s:error=%s:when=%s" % (call, error, when)
            try:
                store.start(prefix=["strace", "-f", "-qq", "-o", "/dev/null", "-e", "trace=" + call, "-e", inject])
                failed += attempt(store, inputs, "e%d" % i)
                store.kill_inner()
                store.process.wait()
            except Fault as e:
                if "acutd ended with 7" not in str(e) and "acutd ended with 1" not in str(e):
                    raise Fault("%s: %s" % (inject, e))
                refused += 1  # the start failed, with a reason
            except subprocess.TimeoutExpired as e:
                raise Fault("%s: no answer: %s" % (inject, e))
            finally:
                store.kill()
            store.start()
            store.ctl("push", "e%d" % i, *sum(inputs.pushed, [])).ok()
            job = store.ctl("submit", "e%d" % i, "--wait", "--json").ok().json()
            expect(faults.digests(job) == inputs.want[3, ()], "%s: another mesh" % inject)
            faults.work(store, inputs, Acks(), "w%d" % i)
            store.stop()
            left = [x for x in faults.leftovers(store) if x.endswith(".tmp")]
            expect(not left, "%s: left behind: %s" % (inject, left))
    expect(failed or points < len(CALLS), "no fault was felt by anybody")
    print("%d error points, %d requests failed with an error, %d starts refused, 0 losses" % (points, failed, refused))


if __name__ == "__main__":
    e2e.main(main)
