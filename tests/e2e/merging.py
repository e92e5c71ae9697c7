"""Merging and pruning: many pushes leave few segments, and every generation stays what it was, whenever the daemon is killed.
Pruning removes generations, and nothing else. ACUT_MERGING_PUSHES=1000 for figures."""
import os
import random
import signal
import threading
import time

import e2e
from e2e import expect
from survey import las, says, show

PUSHES = int(os.environ.get("ACUT_MERGING_PUSHES", "24"))


def cloud(base, name, seed, n, side=40000):
    rng = random.Random(seed)
    return las(os.path.join(base, name), [(rng.randrange(side), rng.randrange(side), rng.randrange(5000)) for _ in range(n)],
               scale=(.01, .01, .01))


def digests(d, name, at=None):
    args = ["submit", name, "--wait", "--new", "--json"] + (["--at", str(at)] if at else [])
    got = d.ctl(*args).ok().json()
    return got["digest"], got["vertex_digest"], got["points"]


def settled(d, name, seconds=e2e.PATIENCE):
    """Waits until no merge runs any more; returns the number of segments."""
    last, since = None, time.monotonic()
    until = since + seconds
    while time.monotonic() < until:
        s = show(d, name)
        now = (s["segments"], s["merging"])
        if now != last or s["merging"]:
            last, since = now, time.monotonic()
        elif time.monotonic() - since > 1:
            return s["segments"]
        time.sleep(.05)
    raise e2e.Fault("%s does not come to rest: %s" % (name, last))


def tidy(d, name, seconds=e2e.PATIENCE):
    """One manifest, and the expected number of segments."""
    folder = os.path.join(d.state, "datasets", str(show(d, name)["id"]))
    until = time.monotonic() + seconds
    while True:
        want, files = show(d, name), os.listdir(folder)
        segments = [f for f in files if f.endswith(".seg")]
        try:
            size = sum(os.path.getsize(os.path.join(folder, f)) for f in segments)
        except FileNotFoundError:
            continue  # it was removed just now
        if len(files) == len(segments) + 1 and len(segments) == want["segments"] and size == want["bytes"]:
            return
        if time.monotonic() > until:
            raise e2e.Fault("%s: %s, of %d segments and %d bytes" % (name, sorted(files), want["segments"], want["bytes"]))
        time.sleep(.1)


def many_pushes():
    """Small pushes, one after the other, while merges run: few segments, the same meshes, no push slower than another."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        was, took, most = {}, [], 0
        for i in range(1, PUSHES + 1):
            path = cloud(base, "p%d.las" % i, i, 100)
            begun = time.monotonic()
            d.ctl("push", "s", path).ok()
            took.append(time.monotonic() - begun)
            most = max(most, show(d, "s")["segments"])
            # A merge may take longer than a push.
            e2e.until(lambda: show(d, "s")["segments"] <= 16, "nothing is merged")
            if i in (3, 10, PUSHES // 2, PUSHES):
                was[i] = digests(d, "s", i)
        segments = settled(d, "s")
        tidy(d, "s")
        tenth = max(1, PUSHES // 10)
        print("     %d pushes of 100 points: %d segments, %d at most; a push %.0f ms at first, %.0f ms at last" %
              (PUSHES, segments, most, 1e3 * sorted(took[:tenth * 2])[tenth], 1e3 * sorted(took[-tenth * 2:])[tenth]))
        expect(show(d, "s")["generation"] == PUSHES, "%s" % show(d, "s"))
        expect(segments <= 12 and most <= 64, "%d segments, %d at most" % (segments, most))
        for g, want in was.items():
            expect(digests(d, "s", g) == want, "generation %d is not what it was" % g)
            expect(want[2] == 100 * g, "generation %d has %d points" % (g, want[2]))
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        d.ctl("push", "s", *[cloud(base, "p%d.las" % i, i, 100) for i in range(1, 11)]).ok()
        expect(digests(d, "s") == was[10], "ten pushes are not one push of ten files")


def killed():
    """kill -9 during merges and prunes: pushed points are there, and a start leaves no leftovers."""
    with e2e.Folder() as base:
        d, rng, pushed, was, pruned = e2e.Daemon(base, memory="64M"), random.Random(5), 0, {}, 0
        for kill in range(6):
            with d:
                if pushed:
                    s = show(d, "s")
                    expect(pushed <= s["generation"] <= pushed + 1, "%d were answered, %d are there" % (pushed, s["generation"]))
                    pushed = s["generation"]
                    for g in [g for g in was if g >= s["oldest"]][-2:]:
                        expect(digests(d, "s", g) == was[g], "generation %d is not what it was after kill %d" % (g, kill))
                for _ in range(3):
                    pushed += 1
                    d.ctl("push", "s", cloud(base, "p%d.las" % pushed, pushed, 30000)).ok()
                was[pushed] = digests(d, "s", pushed)

                def work():
                    nonlocal pruned
                    if not d.ctl("dataset", "revert", "s").status:
                        d.ctl("dataset", "prune", "s", "--keep", "1")
                        pruned += 1
                t = threading.Thread(target=work)
                if kill % 2:
                    t.start()
                time.sleep(rng.uniform(0.01, 0.4))
                d.stop(signal.SIGKILL)
                if kill % 2:
                    t.join()
                    was, pushed = {}, pushed + 1
                    with d:
                        pushed = show(d, "s")["generation"]
        begun = time.monotonic()
        with d:
            print("     %d kills, %d prunes, start in %.2f s" % (kill + 1, pruned, time.monotonic() - begun))
            settled(d, "s")
            tidy(d, "s")
            digests(d, "s")


def prune():
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        a, b, c = (cloud(base, "%s.las" % n, i, 40000) for i, n in enumerate("abc"))
        for path in (a, b, c):
            d.ctl("push", "s", path).ok()
        d.ctl("dataset", "revert", "s", "2").ok()
        was, third = digests(d, "s"), digests(d, "s", 3)
        settled(d, "s")
        before = show(d, "s")
        expect(before["oldest"] == 1 and before["generation"] == 4, "%s" % before)
        for args, status in (((), 2), (("--keep", "1", "--before", "2"), 2), (("--before", "5"), 4), (("--keep", "0"), 2)):
            says(d.ctl("dataset", "prune", "s", *args), status)
        says(d.ctl("dataset", "prune", "none", "--keep", "1"), 4)
        d.ctl("dataset", "pin", "s").ok()
        says(d.ctl("dataset", "prune", "s", "--keep", "1"), 1, "pinned")
        d.ctl("dataset", "unpin", "s").ok()
        got = d.ctl("dataset", "prune", "s", "--before", "3", "--json").ok().json()
        expect((got["oldest"], got["generations"], got["points"]) == (3, 2, 0), "%s" % got)
        expect(digests(d, "s", 3) == third, "generation 3 is not what it was")
        says(d.ctl("submit", "s", "--at", "2"), 4, "pruned")
        got = d.ctl("dataset", "prune", "s", "--keep", "1", "--json").ok().json()
        after = show(d, "s")
        expect((got["oldest"], got["generations"], got["points"], got["files"]) == (4, 1, 40000, 1), "%s" % got)
        expect(got["bytes"] == before["bytes"] - after["bytes"] > 40000 * 16, "%s of %s, %s" % (got, before, after))
        tidy(d, "s")
        says(d.ctl("submit", "s", "--at", "3"), 4, "pruned")
        expect(digests(d, "s") == was, "what stays is not what it was")
        # No finished domain is made again.
        report = d.ctl("submit", "s", "--wait", "--new", "--json").ok().json()
        expect(report["digest"] == was[0], "%s" % report)
        d.ctl("dataset", "prune", "s", "--keep", "1").ok()
        d.ctl("push", "s", b).ok()  # which is not there any more
        expect(show(d, "s")["points"] == 120000, "%s" % show(d, "s"))


def reverted_while_pruned():
    """A revert restores what a prune would remove: one of the two is first, and the answer to the revert is true."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        # The same path, so that the second push takes the place of the first file. The third makes the prune long.
        files = [cloud(base, "%d.las" % i, 70 + i, n) for i, n in enumerate((3000, 4000, 150000))]
        path, reverted, refused = os.path.join(base, "f.las"), 0, 0
        for i in range(8):
            name = "s%d" % i
            for file in files[:2]:
                os.replace(file, path)
                d.ctl("push", name, "--replace", path).ok()
                os.rename(path, file)
            d.ctl("push", name, files[2]).ok()
            prune = threading.Thread(target=lambda: says(d.ctl("dataset", "prune", name, "--before", "2"), 0))
            prune.start()
            time.sleep(0.01 * i)
            r = d.ctl("dataset", "revert", name, "2")
            prune.join()
            expect(r.status in (0, 4), "revert: %s" % r.err)
            reverted, refused = reverted + (not r.status), refused + (r.status == 4)
            want = show(d, name)
            expect(want["points"] == (153000 if not r.status else 154000), "%s" % want)
            expect(digests(d, name)[2] == want["points"], "what was brought back is gone: %s" % (digests(d, name),))
        print("     %d reverts came first, %d were refused" % (reverted, refused))


e2e.main(many_pushes, killed, prune, reverted_while_pruned)
