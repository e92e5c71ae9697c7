"""Generations: the mesh of each generation is that of a dataset that never got the later pushes. Reverts and replaced files leave
nothing but their entries in the log. All digests are compared with a build from scratch of the files that are live."""
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import threading
import time

import e2e
from e2e import expect
from survey import las, says, show

try:
    import xxhash
    from acut_wire import Client, Refused, pb
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)

KEYS = ("digest", "vertex_digest", "vertices", "triangles", "points", "used")


def cloud(base, name, seed, x, y, n, side=3000, thick=3000, ties=0):
    """Points in a square; `ties` of them at positions that all clouds of one place share, each with its own height."""
    rng = random.Random(seed)
    points = [(x + rng.randrange(side), y + rng.randrange(side), rng.randrange(thick)) for _ in range(n)]
    shared = random.Random(1)
    points += [(shared.randrange(9000), shared.randrange(9000), rng.randrange(-thick, thick)) for _ in range(ties)]
    return las(os.path.join(base, name), points, scale=(.01, .01, .01))


def mesh(d, name, *options):
    # Made again: the report of an earlier job would be that of an earlier time.
    new = () if "--new" in options else ("--new",)
    job = d.ctl("submit", name, "--wait", *new, *options).ok().out.split()[0]
    got = d.ctl("show", job, "--json").ok().json()
    return {k: got[k] for k in KEYS}


class Fresh:
    """Builds from scratch of some files, on the lattice of the first push."""

    def __init__(self, d, options=((),)):
        self.d, self.n, self.options, self.known = d, 0, options, {}

    def of(self, files):
        key = tuple(sorted(files))
        if key not in self.known:
            self.n += 1
            name = "fresh%d" % self.n
            self.d.ctl("push", name, "--scale", "0.01,0.01", *key).ok()
            self.known[key] = [mesh(self.d, name, *o) for o in self.options]
        return self.known[key]


def log(d, name, *more):
    return [json.loads(line) for line in d.ctl("dataset", "log", name, "--json", *more).ok().out.splitlines()]


VIEWS = ((), ("--surface",), ("--thin", "50"), ("--duplicates", "highest", "--zmin", "-5"))


def state(d, name, options=VIEWS, at=None):
    more = ("--at", str(at)) if at else ()
    return [mesh(d, name, *more, *o) for o in options]


def names(d):
    return [json.loads(line)["name"] for line in d.ctl("datasets", "--json").ok().out.splitlines()]


def revert_and_at():
    """Pushes, reverts, and reverts of reverts: every state is compared at every time, in one daemon and after a restart."""
    with e2e.Folder() as base:
        a = cloud(base, "a.las", 1, 0, 0, 4000, ties=300)
        b = cloud(base, "b.las", 2, 2000, 1000, 3000, ties=300)
        c = cloud(base, "c.las", 3, 9000, 9000, 500, side=60000, ties=300)  # the rim: the root of the plan is larger with it
        d = e2e.Daemon(base, memory="32M")
        with d:
            fresh = Fresh(d, VIEWS)
            then = {}
            for n, (what, live) in enumerate([(("push", "s", a), [a]), (("push", "s", b, c), [a, b, c]),
                                              (("dataset", "revert", "s"), [a]), (("dataset", "revert", "s", "1"), []),
                                              (("dataset", "revert", "s", "3"), [b, c]), (("push", "s", a), [a, b, c]),
                                              (("dataset", "revert", "s", "5"), [a])], 1):
                if what[0] == "push":
                    d.ctl(*what[:2], "--scale", "0.01,0.01", *what[2:]).ok() if n == 1 else d.ctl(*what).ok()
                else:
                    d.ctl(*what).ok()
                expect(show(d, "s")["generation"] == n, "generation %d is %s" % (n, show(d, "s")))
                expect(show(d, "s")["files"] == len(live), "generation %d has %s" % (n, show(d, "s")))
                if live:
                    then[n] = fresh.of(live)
                    expect(state(d, "s") == then[n], "generation %d is not %s" % (n, live))
            for n in then:
                expect(state(d, "s", VIEWS[:2], n) == then[n][:2], "--at %d is not what it was" % n)
            expect(mesh(d, "s", "--at", "4")["triangles"] == 0, "an empty generation has triangles")
            told = d.ctl("dataset", "show", "s", "--at", "2", "--json").ok().json()
            expect((told["generation"], told["files"], told["points"]) == (2, 3, 4000 + 3000 + 500 + 900), "show --at: %s" % told)
            says(d.ctl("submit", "s", "--at", "8"), 4, "no generation 8", "1 to 7")
            says(d.ctl("plan", "s", "--at", "8"), 4, "no generation 8", "1 to 7")
            says(d.ctl("dataset", "show", "s", "--at", "8"), 4, "no generation 8", "1 to 7")
            says(d.ctl("plan", "s", "--at", "4"), 0)
        with e2e.Daemon(base, memory="32M") as d:
            for n in then:
                expect(state(d, "s", VIEWS[:1], n) == then[n][:1], "after a restart --at %d is not what it was" % n)
            expect([(g["kind"], g["undoes"]) for g in log(d, "s")] == [
                ("push", None), ("push", None), ("revert", 2), ("revert", 1), ("revert", 3), ("push", None), ("revert", 5)],
                "the log: %s" % log(d, "s"))


def replaced():
    """A corrected delivery replaces the old one: a file, a folder, another name; unchanged files are skipped."""
    with e2e.Folder() as base:
        new = os.path.join(base, "new")
        os.mkdir(new)
        # The old a.las has the lowest points of many positions, and the rim: all of that must go.
        a = cloud(base, "a.las", 1, -40000, -40000, 3000, side=90000, ties=400)
        b, c = cloud(base, "b.las", 2, 0, 0, 3000, ties=400), cloud(base, "c.las", 3, 4000, 0, 3000, ties=400)
        old = {p: shutil.copy2(p, os.path.join(new, os.path.basename(p))) for p in (a, b, c)}
        with e2e.Daemon(base, memory="32M") as d:
            fresh = Fresh(d, VIEWS)
            d.ctl("push", "s", "--scale", "0.01,0.01", a, b, c).ok()
            cloud(base, "a.las", 11, 0, 0, 3500, ties=350)
            says(d.ctl("push", "s", a), 1, "--replace in its place")
            expect(show(d, "s")["generation"] == 1, "a refused file made a generation")
            got = json.loads(d.ctl("push", "s", "--replace", a, "--json").ok().out)
            expect((got["generation"], got["replaced"], got["points"]) == (2, 1, 3850), "%s" % got)
            expect(state(d, "s") == fresh.of([a, b, c]), "replaced is not what a build from nothing is")
            expect(state(d, "s", VIEWS[:2], 1) == fresh.of(old.values())[:2], "what was there before is gone")
            # All of it again, with new times: nothing is new.
            for p in (a, b, c):
                os.utime(p)
            says(d.ctl("push", "s", "--replace", a, b, c), 0, "there already")
            expect(show(d, "s")["generation"] == 2, "the same content made a generation")
            # Two of three, and one that is new; by the folder.
            cloud(base, "b.las", 12, 9000, 9000, 1000, ties=300)
            cloud(base, "c.las", 13, 100, 100, 2000, ties=100)
            e = cloud(base, "e.las", 14, 500, 500, 600, ties=100)
            os.rename(new, base + ".keep")
            try:
                says(d.ctl("push", "s", "--replace", a, b, c, e), 0, "a.las: there already", "b.las: in place of 1 file")
            finally:
                os.rename(base + ".keep", new)
            expect(state(d, "s") == fresh.of([a, b, c, e]), "two replaced are not what a build from nothing is")
            # Under another name; what there is none of, and two of.
            f = cloud(base, "f.las", 15, 0, 0, 700, ties=100)
            says(d.ctl("push", "s", f, "--replaces", "nothing.las"), 1, "no file nothing.las")
            says(d.ctl("push", "s", f, e, "--replaces", "b.las"), 2, "one input")
            says(d.ctl("push", "s", f, "--replaces", "b.las", "--add"), 2, "--add")
            d.ctl("push", "s", f, "--replaces", "b.las").ok()
            # The answer was lost, and it is said once more: it is done already. Of another file it is not.
            was = len(d.ctl("dataset", "log", "s", "--json").ok().out.splitlines())
            says(d.ctl("push", "s", f, "--replaces", "b.las").ok(), 0)
            expect(len(d.ctl("dataset", "log", "s", "--json").ok().out.splitlines()) == was, "a repeated push made a generation")
            says(d.ctl("push", "s", e, "--replaces", "b.las"), 1, "no file b.las")
            expect(state(d, "s") == fresh.of([a, f, c, e]), "replaced by name")
            d.ctl("push", "s", old[a], "--replaces", a).ok()
            expect(state(d, "s") == fresh.of([old[a], f, c, e]), "replaced by path")
            # A file whose content is in the dataset already cannot replace another one, and the message says so.
            says(d.ctl("push", "s", e, "--replaces", "c.las"), 1, "has this content already, as", "e.las")
            kept = shutil.copy2(c, os.path.join(base, "c.kept"))
            shutil.copy(e, c)
            says(d.ctl("push", "s", c, "--replace", "--checksum"), 1, "has this content already, as", "e.las")
            shutil.copy2(kept, c)
            expect(state(d, "s", VIEWS[:1]) == fresh.of([old[a], f, c, e])[:1], "a file that is there replaced another one")
            rows = log(d, "s", "--files")
            expect([(r["kind"], r["files_added"], r["files_removed"]) for r in rows] == [
                ("push", 3, 0), ("replace", 1, 1), ("replace", 3, 2), ("replace", 1, 1), ("replace", 1, 1)], "%s" % rows)
            # Undone one after the other, the last first.
            says(d.ctl("dataset", "revert", "s", "2"), 1, "cannot be undone")
            for live in ([a, f, c, e], [a, b, c, e]):
                d.ctl("dataset", "revert", "s", str(show(d, "s")["generation"] if live[1] == f else 4)).ok()
                expect(state(d, "s", VIEWS[:2]) == fresh.of(live)[:2], "an undone replacement")
        for folder, _, files in os.walk(os.path.join(base, "state", "datasets", "1")):
            manifests = [f for f in files if f.startswith("manifest-")]
            expect(len(manifests) == 1, "old manifests stay: %s" % manifests)
            dump = e2e.run([os.environ.get("ACUT_GRID_DUMP", "acut-grid-dump"), "--check", os.path.join(folder, manifests[0])])
            expect(dump.status == 0, "acut-grid-dump --check: %s" % dump.err)


def replace_all_files_of_one_path():
    """--add has brought several files of one path: --replaces by the path means all of them, by their name none."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="32M") as d:
        fresh = Fresh(d)
        a, e = cloud(base, "a.las", 1, 0, 0, 500, ties=50), cloud(base, "e.las", 2, 500, 500, 600, ties=100)
        d.ctl("push", "s", "--scale", "0.01,0.01", a, e).ok()
        kept = shutil.copy2(a, os.path.join(base, "a.kept"))
        cloud(base, "a.las", 3, 200, 0, 300, ties=100)
        d.ctl("push", "s", a, "--add").ok()
        expect([mesh(d, "s")] == fresh.of([kept, a, e]), "added beside")
        g = cloud(base, "g.las", 4, 0, 300, 400, ties=100)
        says(d.ctl("push", "s", g, "--replaces", "a.las"), 1, "2 files a.las", "whole path")
        says(d.ctl("push", "s", e, "--replaces", a), 1, "has this content already, as", "e.las")
        says(d.ctl("push", "s", kept, "--replaces", a), 0, "there already")
        says(d.ctl("push", "s", g, "--replaces", a), 0, "in place of 2 files")
        expect([mesh(d, "s")] == fresh.of([g, e]), "not all of a path are replaced")
        says(d.ctl("push", "s", g, "--replaces", a), 0, "there already")
        expect([(r["kind"], r["files_added"], r["files_removed"]) for r in log(d, "s")] == [
            ("push", 2, 0), ("push", 1, 0), ("replace", 1, 2)], "%s" % log(d, "s"))


def nothing_to_commit():
    """A push that neither adds nor removes points makes no generation and no dataset; an empty file that replaces points does."""
    with e2e.Folder() as base:
        full, empty, gone = (os.path.join(base, n) for n in ("full.xyz", "empty.xyz", "was.xyz"))
        for path, text in ((full, "1.00 2.00 3.00\n2.00 3.00 4.00\n5.00 1.00 1.00\n"), (empty, ""), (gone, "9.00 9.00 9.00\n")):
            with open(path, "w") as f:
                f.write(text)
        with e2e.Daemon(base) as d:
            def push(name, *more):
                r = d.ctl("push", name, "--json", *more).ok()
                return [json.loads(line) for line in r.out.splitlines()]

            r = d.ctl("push", "s", empty).ok()
            expect("nothing to commit" in r.out, r.out)
            got = push("s", empty)[0]
            expect((got["state"], got["generation"], got["points"], got["error"]) == ("empty", None, 0, None), got)
            # It is there as long as a push into it is open, and a push ends behind its client.
            e2e.until(lambda: d.ctl("dataset", "show", "s").status == 4, "a dataset of nothing is gone")
            expect(not d.ctl("datasets").ok().out, "a dataset of nothing")
            expect([f["state"] for f in push("s", full, gone)] == ["staged"] * 2, "the first")
            before = show(d, "s")
            r = d.ctl("push", "s", empty).ok()
            expect("nothing to commit" in r.out and "stays at generation 1" in r.out, r.out)
            # Beside what is there already too; and a restart finds nothing of it.
            expect([(f["state"], f["generation"]) for f in push("s", empty, full)] == [("empty", 1), ("known", 1)], "beside a known one")
            d.stop()
            d.start()
            expect(show(d, "s") == before and len(log(d, "s")) == 1, "%s" % log(d, "s"))
            left = [n for _, _, names in os.walk(os.path.join(d.state, "datasets")) for n in names]
            expect(len(left) == 2 and not [n for n in left if "pending" in n or ".stage" in n or ".run" in n], "it stays behind: %s" % left)
            # If other files have points, it is one of the files.
            with open(os.path.join(base, "more.xyz"), "w") as f:
                f.write("7.00 7.00 7.00\n")
            expect([f["state"] for f in push("s", os.path.join(base, "more.xyz"), empty)] == ["staged"] * 2, "with others")
            expect(show(d, "s")["generation"] == 2 and show(d, "s")["files"] == 4, show(d, "s"))
            # Points that go are a change.
            os.truncate(gone, 0)
            got = push("s", "--replace", gone)[0]
            expect((got["state"], got["generation"], got["replaced"]) == ("staged", 3, 1), got)
            expect(log(d, "s")[-1]["points_removed"] == 1 and show(d, "s")["points"] == 4, log(d, "s")[-1])
            # A mesh of one step has a result all the same.
            expect(d.ctl("mesh", empty, "-o", os.path.join(base, "m.ply"), "--json").ok().json()["triangles"] == 0, "mesh")


def an_interrupted_replacement():
    """An interrupted push replaces nothing. The same push again does, with the files that were read."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        a, b = cloud(base, "a.las", 1, 0, 0, 500, ties=50), cloud(base, "b.las", 2, 0, 0, 400, ties=50)
        fresh = Fresh(d)
        d.ctl("push", "s", "--scale", "0.01,0.01", a, b).ok()
        before = mesh(d, "s")
        cloud(base, "a.las", 11, 0, 0, 450, ties=50)
        cloud(base, "b.las", 12, 0, 0, 470, ties=50)
        with Client(d.socket) as c:
            push = c.ask("push_begin", pb.PushBegin(dataset="s")).push
            for body, m in (("probe", pb.Probe(push=push, name=a, path=a.encode(), replace=True)), ("push_plan", pb.PushPlan(push=push)),
                            ("file", pb.File(push=push, name=a))):
                with open(a, "rb") as f:
                    answer = c.ask(body, m, *([f.fileno()] if body != "push_plan" else []))
            expect(answer.replaced == 1, "%s" % answer)
        e2e.until(lambda: (show(d, "s")["pending"] or "").startswith("1 interrupted"), "no pending push")
        expect(mesh(d, "s", "--new") == before and show(d, "s")["generation"] == 1, "an interrupted push changed something")
        says(d.ctl("push", "s", a), 1, "--replace in its place")
        got = [json.loads(l) for l in d.ctl("push", "s", a, b, "--replace", "--json").ok().out.splitlines()]
        expect([(g["state"], g["replaced"]) for g in got] == [("adopted", 1), ("staged", 1)], "%s" % got)
        expect([mesh(d, "s")] == fresh.of([a, b]), "after an interruption")


def two_replace_one():
    """Two clients replace one file at once: one succeeds, the other gets an error. Of files with one path all are replaced."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        a, other = cloud(base, "a.las", 1, 0, 0, 500), os.path.join(base, "other")
        os.mkdir(other)
        fresh = Fresh(d)
        d.ctl("push", "s", "--scale", "0.01,0.01", a).ok()

        def staged(c, seed):
            cloud(base, "a.las", seed, 0, 0, 400 + seed)
            push = c.ask("push_begin", pb.PushBegin(dataset="s")).push
            with open(a, "rb") as f:
                c.ask("probe", pb.Probe(push=push, name=a, path=a.encode(), replace=True), f.fileno())
                c.ask("push_plan", pb.PushPlan(push=push))
                expect(c.ask("file", pb.File(push=push, name=a), f.fileno()).replaced == 1, "nothing is replaced")
            return push

        with Client(d.socket) as one, Client(d.socket) as two:
            first = staged(one, 11)
            shutil.copy2(a, other)
            second = staged(two, 12)
            one.ask("push_commit", pb.PushCommit(push=first))
            try:
                two.ask("push_commit", pb.PushCommit(push=second))
                expect(False, "both have replaced it")
            except Refused as e:
                expect(e.code == "busy", "%s" % e)
            two.ask("push_abort", pb.PushAbort(push=second))
        expect([mesh(d, "s")] == fresh.of([os.path.join(other, "a.las")]), "the first one did not replace it")
        with Client(d.socket) as c:
            push = staged(c, 13)
            d.ctl("dataset", "revert", "s").ok()
            try:
                c.ask("push_commit", pb.PushCommit(push=push))
                expect(False, "it has replaced what was not there any more")
            except Refused as e:
                expect(e.code == "busy", "%s" % e)
            c.ask("push_abort", pb.PushAbort(push=push))
        cloud(base, "a.las", 14, 0, 0, 300)
        d.ctl("push", "s", a, "--add").ok()
        cloud(base, "a.las", 15, 0, 0, 200)
        expect(json.loads(d.ctl("push", "s", a, "--replace", "--json").ok().out)["replaced"] == 2, "not both of the path")
        expect([mesh(d, "s")] == fresh.of([a]) and show(d, "s")["files"] == 1, "%s" % show(d, "s"))


def live_of(rows):
    """The live files after all generations, by the log of each."""
    live = {}
    for r in rows:
        for f in r["files"]:
            if f["removed"]:
                expect(f["source"] in live, "generation %d removes %s, which is not there" % (r["generation"], f))
                del live[f["source"]]
            else:
                expect(f["source"] not in live, "generation %d adds %s a second time" % (r["generation"], f))
                live[f["source"]] = f["path"]
    expect(len(set(live.values())) == len(live), "a file is there twice: %s" % live)
    return set(live.values())


def many_at_once():
    """Four clients push at once, one of them is killed, others revert: nothing that was acknowledged is lost."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="48M") as d:
        files = {who: [cloud(base, "f%d%d.las" % (who, i), 10 * who + i, 700 * who, 900 * i, 3000, ties=200) for i in range(5)]
                 for who in range(4)}
        d.ctl("push", "s", "--scale", "0.01,0.01", files[0][0]).ok()
        done, failed, env = {files[0][0]}, [], dict(os.environ, ACUT_SOCKET=d.socket)

        def pusher(who):
            for path in files[who]:
                for _ in range(20):
                    r = d.ctl("push", "s", path)
                    if r.status != 75:
                        break
                (failed.append((path, r.err)) if r.status else done.add(path))

        def reverter():
            for _ in range(6):
                r = d.ctl("dataset", "revert", "s")
                # A push that is committed first may have brought again what it would bring back.
                if r.status not in (0, 2) and "pushed again in generation" not in r.err:
                    failed.append(("revert", r.err))
                time.sleep(0.05)

        def killer():
            for i in range(12):
                p = subprocess.Popen([e2e.ACUTCTL, "push", "s", *files[3]], env=env, stdout=subprocess.DEVNULL,
                                     stderr=subprocess.DEVNULL)
                time.sleep(0.004 * i)
                p.send_signal(signal.SIGKILL)
                p.wait()

        threads = [threading.Thread(target=f, args=a) for f, a in
                   [(pusher, (who,)) for who in range(3)] + [(reverter, ()), (killer, ())]]
        for t in threads:
            t.start()
        for t in threads:
            t.join()
        expect(not failed, "%s" % failed)
        pusher(3)
        expect(not failed, "%s" % failed)
        rows = log(d, "s", "--files")
        expect([r["generation"] for r in rows] == list(range(1, len(rows) + 1)), "generations are missing: %s" % rows)
        came = {f["path"] for r in rows for f in r["files"] if not f["removed"]}
        expect(done <= came, "pushed, and not there: %s" % (done - came))
        expect(any(r["kind"] == "revert" for r in rows), "nothing was reverted meanwhile")
        live = live_of(rows)
        expect(show(d, "s")["files"] == len(live), "%s, and live are %s" % (show(d, "s"), live))
        fresh = Fresh(d)
        expect([mesh(d, "s")] == fresh.of(live), "%d generations, %d files live" % (len(rows), len(live)))
        some = sorted(random.Random(5).sample(range(1, len(rows)), 3))
        for n in some:
            then = live_of(rows[:n])
            if then:
                expect([mesh(d, "s", "--at", str(n))] == fresh.of(then), "--at %d" % n)


def jobs_keep_their_generation():
    """A job that waits, runs or is fetched later has the points of its submission, also after a restart."""
    with e2e.Folder() as base:
        a, b = cloud(base, "a.las", 1, 0, 0, 250000, side=2000000), cloud(base, "b.las", 2, 5000, 0, 20000, side=500000)
        with e2e.Daemon(base, memory="24M", threads=1) as d:
            d.ctl("push", "s", "--scale", "0.01,0.01", a).ok()
            d.ctl("push", "fresh", "--scale", "0.01,0.01", a).ok()
            d.ctl("push", "both", "--scale", "0.01,0.01", a, b).ok()
            want = mesh(d, "fresh")["digest"]
            jobs = [d.ctl("submit", "s", "--new").ok().out.split()[0] for _ in range(2)]
            d.ctl("push", "s", b).ok()
            d.ctl("dataset", "revert", "s", "1").ok()
            d.ctl("dataset", "revert", "s", "3").ok()
            d.stop(signal.SIGKILL)
        with e2e.Daemon(base, memory="24M", threads=1) as d:
            jobs.append(d.ctl("submit", "s", "--at", "1").ok().out.split()[0])
            d.ctl("dataset", "revert", "s", "2").ok()
            for job in jobs:
                d.ctl("wait", job).ok()
                expect(d.ctl("show", job, "--json").ok().json()["digest"] == want, "job %s has other points" % job)
                got = d.ctl("fetch", job, "--format", "null", "--json").ok().json()
                expect(got["digest"] == want, "job %s gives other triangles later" % job)
            expect(mesh(d, "s", "--at", "4") == mesh(d, "both"), "generation 4")


def killed_at_any_time():
    """kill -9 at random times during reverts, replacements and removals: acknowledged changes are there, others are complete or
    absent."""
    with e2e.Folder() as base:
        a, b = cloud(base, "a.las", 1, 0, 0, 400, ties=50), cloud(base, "b.las", 2, 0, 0, 300, ties=50)
        d, rng, told, count = e2e.Daemon(base), random.Random(7), {"generation": 0, "there": True}, 0
        with d:
            d.ctl("push", "s", a, b).ok()
            told["generation"] = 1
        for kill in range(15):
            with e2e.Daemon(base) as d:
                if not told["there"] and "s" not in names(d):
                    d.ctl("dataset", "restore", "s").ok()
                got = show(d, "s")["generation"]
                expect(told["generation"] <= got <= told["generation"] + 1, "%d was answered, %d is there" % (told["generation"], got))
                rows = log(d, "s", "--files")
                expect([r["generation"] for r in rows] == list(range(1, got + 1)), "%s" % rows)
                expect(len(live_of(rows)) == show(d, "s")["files"], "%s" % rows)
                told.update(generation=got, there=True)
                answers = threading.Semaphore(0)

                def work():
                    for i in range(1000):
                        what = (kill + i) % 4
                        if what == 1:
                            cloud(base, "a.las", 1000 * kill + i, 0, 0, 400, ties=50)
                            r = d.ctl("push", "s", "--replace", a)
                        elif what == 2:
                            told["there"] = False
                            r = d.ctl("dataset", "rm", "s")
                            r = d.ctl("dataset", "restore", "s") if not r.status else r
                            told["there"] = not r.status
                        else:
                            r = d.ctl("dataset", "revert", "s")
                        if r.status and r.status != 2:
                            return
                        if what != 2 and not r.status:
                            told["generation"] += 1
                        answers.release()
                t = threading.Thread(target=work)
                t.start()
                for _ in range(kill % 4):
                    expect(answers.acquire(timeout=300), "no answer came")
                time.sleep(rng.uniform(0, 0.1))  # at any instant of the next one
                d.stop(signal.SIGKILL)
                t.join()
                count += 1
        with e2e.Daemon(base) as d:
            if "s" not in names(d):
                d.ctl("dataset", "restore", "s").ok()
            rows = log(d, "s", "--files")
            print("     %d kills, %d generations" % (count, len(rows)))
            expect(len(rows) > 10, "the kills left no time for anything: %d generations" % len(rows))
            for g in (1, len(rows) // 2):
                says(d.ctl("submit", "s", "--at", str(g), "--wait"), 0)
            folder = os.path.join(d.state, "datasets", "1")
            d.ctl("dataset", "revert", "s").ok()
            left = [f for f in os.listdir(folder) if f.startswith("manifest-")]
            expect(len(left) == 1, "what crashes have left of manifests stays: %s" % left)
            for f in os.listdir(folder):
                if f.startswith("manifest-"):
                    dump = e2e.run([os.environ.get("ACUT_GRID_DUMP", "acut-grid-dump"), "--check", os.path.join(folder, f)])
                    expect(dump.status == 0, "acut-grid-dump --check: %s" % dump.err)


def pinned_while_pushed():
    """Whatever changes a dataset during a commit, the catalogue never names an older manifest again: the file may be gone."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="48M") as d:
        d.ctl("push", "s", cloud(base, "p.las", 1, 0, 0, 200)).ok()
        over, asked, seen = threading.Event(), [0], []

        def asks():
            with Client(d.socket) as c:
                while not over.is_set():
                    c.ask("dataset_change", pb.DatasetChange(name="s", verb=("pin", "unpin")[asked[0] % 2]))
                    asked[0] += 1

        def looks():
            db = sqlite3.connect("file:%s/catalogue.db?mode=ro" % d.state, uri=True, timeout=5)
            while not over.is_set():
                now = db.execute("SELECT generation FROM dataset").fetchone()[0]
                if not seen or seen[-1] != now:
                    seen.append(now)
            db.close()

        threads = [threading.Thread(target=f) for f in (asks, asks, looks)]
        for t in threads:
            t.start()
        for i in range(12):
            says(d.ctl("push", "s", cloud(base, "p%d.las" % i, 2 + i, 100 * i, 0, 200)), 0)
        over.set()
        for t in threads:
            t.join()
        expect(asked[0] > 12, "%d questions while twelve pushes were made" % asked[0])
        expect(seen == sorted(seen), "the catalogue went back: %s" % seen)
        before = mesh(d, "s")
        d.stop(signal.SIGKILL)
        d.start()
        expect(show(d, "s")["generation"] == 13 and mesh(d, "s") == before, "%s" % show(d, "s"))


def conflicts():
    """A revert that would affect other generations is refused, and changes nothing."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        a, b = cloud(base, "a.las", 1, 0, 0, 50), cloud(base, "b.las", 2, 0, 0, 60)
        says(d.ctl("dataset", "revert", "s"), 4, "there is no dataset")
        d.ctl("push", "s", a).ok()
        d.ctl("push", "s", b).ok()
        d.ctl("dataset", "revert", "s", "1").ok()
        says(d.ctl("dataset", "revert", "s", "1"), 1, "removed in generation 3", "a.las", "revert generation 3 first")
        d.ctl("push", "s", a).ok()
        says(d.ctl("dataset", "revert", "s", "3"), 1, "pushed again in generation 4", "a.las")
        says(d.ctl("dataset", "revert", "s", "9"), 4, "no generation 9")
        says(d.ctl("dataset", "revert", "s", "0"), 2)
        says(d.ctl("dataset", "revert", "s", "x"), 2)
        expect(show(d, "s")["generation"] == 4 and show(d, "s")["files"] == 2, "a refused revert did something")
        d.ctl("dataset", "revert", "s", "4").ok()
        d.ctl("dataset", "revert", "s", "3").ok()
        says(d.ctl("dataset", "revert", "s", "3"), 1, "brought back in generation 6")
        expect(show(d, "s")["points"] == 110, "%s" % show(d, "s"))
        # Not at all, and not on the disk either.
        expect(len(log(d, "s")) == 6, "the log: %s" % log(d, "s"))


if __name__ == "__main__":
    e2e.main(revert_and_at, replaced, replace_all_files_of_one_path, nothing_to_commit, an_interrupted_replacement, two_replace_one, many_at_once, killed_at_any_time, jobs_keep_their_generation,
             pinned_while_pushed, conflicts)
