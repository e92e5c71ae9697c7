"""The disk: quota and keep-free, eviction, jobs that wait for space, and a cache that is removed while the daemon runs. With very
small quotas."""
import json
import os
import shutil
import signal
import subprocess
import time

import e2e
from e2e import expect

try:
    from acut_wire import Client, pb
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)

MIB = 1 << 20


def synth(path, points, seed=1, *options):
    e2e.run([e2e.SYNTH, "--points", points, "--seed", seed, *options, path]).ok()
    return path


def stat(d):
    return d.ctl("cache", "stat", "--json").ok().json()


class Half:
    """A push by hand that has staged one file and does not commit it."""

    def __init__(self, d, dataset, path, durable=False):
        self.c = Client(d.socket)
        self.push = self.c.ask("push_begin", pb.PushBegin(dataset=dataset)).push
        number = self.c.last
        with open(path, "rb") as f:
            self.c.ask("probe", pb.Probe(push=self.push, name=path, path=os.path.abspath(path).encode()), f.fileno())
            self.c.ask("push_plan", pb.PushPlan(push=self.push))
            self.c.ask("file", pb.File(push=self.push, name=path), f.fileno())
        end = time.monotonic() + e2e.PATIENCE
        while durable and not self.c.durable.get(number, 0):
            expect(time.monotonic() < end, "no Durable")
            time.sleep(0.1)
            self.c.ping()

    def abort(self):
        self.c.ask("push_abort", pb.PushAbort(push=self.push))
        self.c.close()


def until(what, seconds=e2e.PATIENCE, step=0.1):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        got = what()
        if got:
            return got
        time.sleep(step)
    return what()


def digests(d, dataset, *view):
    r = d.ctl("submit", dataset, "--wait", "--new", "--json", *view).ok().json()
    return r["digest"], r["vertex_digest"]


def files_below(folder):
    return [os.path.join(at, f) for at, _, names in os.walk(folder) for f in names]


def bytes_below(folder):
    total = 0
    for f in files_below(folder):
        try:
            total += os.path.getsize(f)
        except FileNotFoundError:
            pass  # evicted meanwhile
    return total


def options():
    for bad in ("0", "101%", "x", "-5%", "1.5%", "%"):
        r = e2e.run([e2e.ACUTD, "--no-config", "--disk", bad])
        expect(r.status == 2 and "--disk" in r.err, "--disk %s: %d %s" % (bad, r.status, r.err))
    r = e2e.run([e2e.ACUTD, "--no-config", "--keep-free", "100%"])
    expect(r.status == 2 and "--keep-free" in r.err, r.err)
    with e2e.Folder() as base, e2e.Daemon(base, args=["--disk", "64M", "--keep-free", "1%"]) as d:
        s = d.ctl("status", "--json").ok().json()
        expect(s["disk"] == "64.0 MB" or s["disk"].startswith("64"), s["disk"])
        expect(s["keep_free"] == "1%" and s["state_disk"]["quota"] == 64 * MIB and s["one_file_system"] is True, s)
        text = d.ctl("status").ok().out
        expect("--disk 64" in text and "--keep-free 1%" in text, text)
        st = until(lambda: stat(d)["measured"] and stat(d))
        expect(st["kinds"]["datasets"]["bytes"] == 0 and st["evicted_bytes"] == 0, st)
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        s = d.ctl("status", "--json").ok().json()
        side = s["state_disk"]
        expect(s["disk"] == "80%" and s["keep_free"] == "5%", s)
        expect(abs(side["quota"] - side["total"] * 0.8) < 1000 and abs(side["keep_free"] - side["total"] * 0.05) < 1000, side)


def push_is_refused_beforehand():
    """The refusal names the need, the remaining space and the limit. Existing data stays, and a smaller push succeeds."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M", args=["--disk", "8M"]) as d:
        big = synth(os.path.join(base, "big.las"), 300000)
        small = synth(os.path.join(base, "small.las"), 50000, 2)
        d.ctl("push", "a", small).ok()
        used = stat(d)["kinds"]["datasets"]["bytes"]
        expect(50000 * 16 < used < 50000 * 20, "%d bytes of 50,000 points" % used)
        r = d.ctl("push", "a", big, "--json")
        expect(r.status == 74, "status %d %s" % (r.status, r.err))
        error = json.loads((r.out or r.err).strip().splitlines()[-1])["error"]
        expect(error["code"] == "no-space" and "300000 points" in error["message"] and "--disk" in error["message"] and
               "left" in error["message"], error)
        expect(d.ctl("dataset", "show", "a", "--json").ok().json()["points"] == 50000, "what was there changed")
        r = d.ctl("mesh", big, "--format", "null")
        expect(r.status == 0, "a mesh of 300,000 points takes 5 of 8 MiB: %s" % r.err)
        d.ctl("push", "a", synth(os.path.join(base, "small2.las"), 40000, 3)).ok()
        expect(until(lambda: stat(d)["kinds"]["pending"]["bytes"] == 0), "a push that is over holds space")
        # The first who asks after a start is held against it too.
        more = synth(os.path.join(base, "more.las"), 220000, 4)
        for _ in range(5):
            d.stop()
            d.start()
            r = d.ctl("push", "b", more)
            expect(r.status == 74, "after a start: %d %s" % (r.status, r.err))
    # A header that lies does not come through either.
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M", args=["--keep-free", "99%"]) as d:
        side = d.ctl("status", "--json").ok().json()["state_disk"]
        if side["free"] < side["keep_free"]:
            r = d.ctl("push", "a", synth(os.path.join(base, "small.las"), 1000))
            expect(r.status == 74 and "--keep-free 99%" in r.err, r.err)


def pipes_are_held_against_it():
    """Text from a pipe is kept first, and charged in steps. Beyond the quota it is refused, and its space is free again."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M", args=["--disk", "4M"]) as d:
        line = b"123456.78 654321.98 100.25\n"
        p = subprocess.Popen([e2e.ACUTCTL, "push", "p", "-", "--input-format", "xyz"], stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=dict(os.environ, ACUT_SOCKET=d.socket))
        try:
            for _ in range(64):
                p.stdin.write(line * 10000)
            p.stdin.close()
        except BrokenPipeError:
            pass
        p.stdin = None
        out, err = p.communicate(timeout=e2e.PATIENCE)
        expect(p.returncode == 74 and b"from a pipe" in err and b"--disk" in err, "%d %s" % (p.returncode, err.decode()))
        expect(until(lambda: stat(d)["kinds"]["temporary"]["bytes"] == 0), stat(d))


def derived_goes_first_and_pushed_never():
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M", args=["--disk", "20M"]) as d:
        want = {}
        for name, seed in (("a", 1), ("b", 2), ("c", 3)):
            d.ctl("push", name, synth(os.path.join(base, name + ".las"), 150000, seed)).ok()
        for round_ in range(2):
            for name in ("a", "b", "c"):
                for view in ((), ("--every", "2")):
                    got = digests(d, name, *view)
                    expect(want.setdefault((name, view), got) == got, "%s %s is another mesh now" % (name, view))
        st = until(lambda: stat(d)["measured"] and stat(d))
        expect(st["evicted_entries"] > 0, "nothing was evicted of %s" % st)
        expect(st["state_disk"]["used"] <= 20 * MIB, st)
        for name in ("a", "b", "c"):
            expect(d.ctl("dataset", "show", name, "--json").ok().json()["points"] == 150000, "points of %s" % name)
        # What is counted is what is there, when no eviction is under way.
        counted = lambda: (stat(d)["kinds"]["domains"]["bytes"], bytes_below(os.path.join(d.cache, "domains")))
        e2e.until(lambda: len(set(counted())) == 1, lambda: "%d counted, %d there" % counted())
        # A push takes the place of derived data.
        d.ctl("push", "d", synth(os.path.join(base, "d.las"), 300000, 4)).ok()
        expect(stat(d)["state_disk"]["used"] <= 20 * MIB, stat(d))
        r = d.ctl("cache", "gc", "--all", "--json").ok().json()
        st = stat(d)
        expect(st["kinds"]["domains"]["bytes"] == 0 and st["kinds"]["selections"]["bytes"] == 0, (r, st))
        expect(not files_below(os.path.join(d.cache, "domains")), "gc --all left domains")
        expect(digests(d, "a") == want[("a", ())], "another mesh after gc")


def gc_knows_what_is_gone():
    """gc removes the finished domains of deleted datasets, but not those that they share with others."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M", args=["--keep-removed", "1s"]) as d:
        one, two = synth(os.path.join(base, "1.las"), 50000, 1), synth(os.path.join(base, "2.las"), 50000, 2)
        for name, path in (("a", one), ("b", two), ("same", one)):
            d.ctl("push", name, path).ok()

        def gc():
            return d.ctl("cache", "gc", "--json").ok().json()["freed_bytes"]

        def gone(name):
            d.ctl("dataset", "rm", name).ok()
            expect(until(lambda: not d.ctl("datasets", "--removed", "--json").ok().out), "%s is still kept" % name)

        def stored():
            return sorted(files_below(os.path.join(d.cache, "domains")))

        want = digests(d, "a")
        of_a = stored()
        digests(d, "b")
        both = stored()
        expect(digests(d, "same") == want and stored() == both, "what is the same is stored twice")
        expect(len(both) > len(of_a) > 1 and gc() == 0 and stored() == both, "domains of datasets that are there went")
        gone("b")
        d.stop()
        d.start()
        freed = sum(os.path.getsize(f) for f in both if f not in of_a)
        expect(gc() == freed and stored() == of_a, "domains of b are left")
        # After a start what lies in the cache is counted in the background, of which a stat asks for it first.
        expect(until(lambda: stat(d)["measured"]), "the cache is never measured")
        # Measured beside what goes on, and said when it is.
        expect(until(lambda: stat(d)["kinds"]["domains"]["bytes"] == sum(os.path.getsize(f) for f in of_a)), stat(d))
        gone("a")
        expect(gc() == 0 and stored() == of_a, "domains that another dataset has too went")
        gone("same")
        expect(gc() > 0 and not stored(), "domains of datasets that are gone are left")


def a_job_waits_for_space():
    """A selection does not fit on the disk: the job reports it, others continue, and it ends by itself when there is space. A
    mesh that is bound to its client fails with 74."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M", args=["--disk", "12M", "--space-wait", "2"]) as d:
        d.ctl("push", "a", synth(os.path.join(base, "a.las"), 200000)).ok()
        small = synth(os.path.join(base, "b.las"), 20000, 2)
        want = digests(d, "a", "--every", "2")
        done = d.ctl("submit", "a", "--every", "2", "--json").ok().json()["job"]
        bound = d.ctl("mesh", small, "--every", "2", "--format", "null", "--json").ok().json()["digest"]
        d.ctl("cache", "gc", "--all").ok()
        expect(until(lambda: stat(d)["kinds"]["one_step"]["bytes"] == 0), stat(d))
        # A push that does not end takes the rest, but for what staging the small file takes.
        st = stat(d)["state_disk"]
        fill = (st["quota"] - st["used"] - 550000) // 2 - 65536
        half = Half(d, "filler", synth(os.path.join(base, "fill.las"), fill * 12 // 13 // 16, 5))
        expect(stat(d)["kinds"]["pending"]["bytes"] > 6 * MIB, stat(d))
        job = d.ctl("submit", "a", "--every", "2", "--new", "--json").ok().json()["job"]

        def shown():
            return d.ctl("show", str(job), "--json").ok().json()

        expect(until(lambda: shown()["state"] == "waiting-space"), shown())
        s = shown()
        expect(s["lacks_space"] > 0 and s["waiting"] == "waiting-space: %d" % s["lacks_space"], s)
        expect("disk space" in d.ctl("jobs").ok().out, d.ctl("jobs").out)
        # A waiting client gets the reason why the job waits.
        waiter = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "wait", str(job)], stdout=subprocess.DEVNULL,
                                  stderr=subprocess.PIPE)
        told = waiter.stderr.readline().decode()
        expect("of disk space are lacking" in told, told)
        watcher = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "watch", str(job)], stdout=subprocess.PIPE)
        told = watcher.stdout.readline().decode()
        expect("waiting-space" in told and "of disk space are lacking" in told, told)
        # A stream of a job that is done needs its selection again.
        r = d.ctl("fetch", str(done), "--format", "null")
        expect(r.status == 74 and "of disk space are lacking" in r.err and "--disk" in r.err, "%d %s" % (r.status, r.err))
        # Bound to a client: it waits too, and ends.
        begun = time.monotonic()
        r = d.ctl("mesh", small, "--every", "2", "--format", "null")
        expect(r.status == 74 and "selection" in r.err and "--disk" in r.err, "%d %s" % (r.status, r.err))
        expect(2 <= time.monotonic() - begun, "after %.1f s" % (time.monotonic() - begun))
        # Jobs that need no space go on.
        expect(d.ctl("mesh", small, "--format", "null").status == 0, "a mesh without a selection fails")
        expect(shown()["state"] == "waiting-space", shown())
        # There is room: it goes on by itself.
        half.abort()
        end = d.ctl("wait", str(job), "--timeout", str(e2e.PATIENCE))
        expect(end.status == 0, "%d %s %s" % (end.status, end.err, shown()))
        for p in (waiter, watcher):
            p.communicate()
            expect(p.returncode == 0, "%s ended with %d" % (p.args, p.returncode))
        s = shown()
        expect((s["digest"], s["vertex_digest"]) == want and s["lacks_space"] is None, s)
        expect(d.ctl("mesh", small, "--every", "2", "--format", "null", "--json").ok().json()["digest"] == bound, "another mesh")


def the_cache_is_removed():
    """rm -rf of the whole cache, again and again, during jobs: the digests are the same."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, memory="24M", env=gate.env) as d:
            the_cache_is_removed_of(d, base, gate)


def the_cache_is_removed_of(d, base, gate):
    d.ctl("push", "a", synth(os.path.join(base, "a.las"), 150000)).ok()
    want = [digests(d, "a"), digests(d, "a", "--every", "3")]
    # When they have read nothing of the survey yet, a part, or are about to write what they made into it.
    for call, text, first in (("pread", ".seg", 0), ("pread", ".seg", 5), ("pread", ".seg", 20), ("pwrite", d.cache, 0), ("pwrite", d.cache, 5)):
        d.ctl("cache", "gc", "--all").ok()  # all that the jobs before have kept since is made again
        gate.close(call, text, first)
        jobs = [d.ctl("submit", "a", "--new", "--json").ok().json()["job"],
                d.ctl("submit", "a", "--every", "3", "--new", "--json").ok().json()["job"]]
        gate.wait()
        shutil.rmtree(d.cache, ignore_errors=True)
        gate.open()
        for job, digest in zip(jobs, want):
            r = d.ctl("wait", str(job), "--timeout", str(e2e.PATIENCE))
            expect(r.status == 0, "job %d ended with %d: %s %s" % (job, r.status, r.out, r.err))
            s = d.ctl("show", str(job), "--json").ok().json()
            expect((s["digest"], s["vertex_digest"]) == digest, "another mesh")
    shutil.rmtree(d.cache, ignore_errors=True)
    out = os.path.join(base, "a.ply")
    d.ctl("fetch", str(jobs[0]), "-o", out).ok()
    # Nothing runs, and it is gone again: nothing is counted there, and a mesh of one step begins in the new one.
    shutil.rmtree(d.cache, ignore_errors=True)
    expect(until(lambda: stat(d)["kinds"]["domains"]["bytes"] == 0), stat(d))
    d.ctl("mesh", os.path.join(base, "a.las"), "-o", out).ok()
    expect(digests(d, "a") == want[0] and files_below(os.path.join(d.cache, "domains")), "nothing is kept any more")
    # Its lock is taken again.
    other = e2e.Daemon(base, name="2")
    other.command[other.command.index("--cache") + 1] = d.cache
    try:
        other.start()
        raise e2e.Fault("two daemons have one cache")
    except e2e.Fault as e:
        expect("ended with 75" in str(e), e)
    finally:
        other.stop(signal.SIGKILL)


if __name__ == "__main__":
    e2e.main(options, push_is_refused_beforehand, pipes_are_held_against_it, derived_goes_first_and_pushed_never,
             gc_knows_what_is_gone, a_job_waits_for_space, the_cache_is_removed)
