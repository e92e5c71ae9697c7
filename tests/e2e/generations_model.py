"""A dataset as it should be, beside a daemon that has it: which files are live in which generation."""
import collections
import json
import os
import random
import shutil
import signal
import subprocess
import time

import e2e
from e2e import expect
from survey import las

VIEWS = ((), ("--surface",), ("--duplicates", "highest"), ("--thin", "50"), ("--crop", "10,10,60,70"), ("--every", "3"),
         ("--zmin", "-5"))
SIDE = 10000


def cloud(path, seed, n):
    """Points somewhere, of any density; some at positions that all clouds share, each with a height of its own."""
    rng = random.Random(seed)
    side = rng.choice([1, 40, 300, 3000, SIDE])
    x, y = rng.randrange(SIDE - side + 1), rng.randrange(SIDE - side + 1)
    if rng.random() < 0.1:
        x += 20 * SIDE  # beyond all that there is
    points = [(x + rng.randrange(side), y + rng.randrange(side), rng.randrange(3000)) for _ in range(n)]
    shared = random.Random(1)
    if rng.random() < 0.4:
        points += [(shared.randrange(SIDE), shared.randrange(SIDE), rng.randrange(-1000, 3000)) for _ in range(n // 20)]
    return las(path, points, scale=(.01, .01, .01))


class Source:
    """One delivery of one file."""

    def __init__(self, path, kept):
        self.path, self.kept = path, kept


class Life:
    def __init__(self, base, d, oracle, rng):
        self.base, self.d, self.oracle, self.rng = base, d, oracle, rng
        self.name = "s"
        self.live = [frozenset()]      # by generation; 0: nothing
        self.change = [(frozenset(), frozenset())]
        self.oldest = 1
        self.files = self.deliveries = self.fresh = self.made = self.domains = self.restored = 0
        self.known, self.told = {}, []
        self.n = collections.Counter()
        self.push()

    # ---- what is asked of the daemon ----

    def ctl(self, *args):
        r = self.d.ctl(*args)
        self.told.append("%s -> %d %s" % (" ".join(map(str, args)), r.status, (r.out + r.err).strip()[-300:]))
        return r

    def next(self, added=(), removed=()):
        self.live.append(self.live[-1] - frozenset(removed) | frozenset(added))
        self.change.append((frozenset(added), frozenset(removed)))

    def deliver(self, path):
        self.deliveries += 1
        cloud(path, self.rng.random(), self.rng.choice([3, 50, 2000, 6000]))
        os.utime(path, ns=(self.deliveries * 10 ** 9, self.deliveries * 10 ** 9))
        kept = os.path.join(self.base, "kept%d.las" % self.deliveries)
        shutil.copy(path, kept)
        return Source(path, kept)

    def new_files(self):
        out = []
        for _ in range(self.rng.choice([1, 1, 1, 2, 5])):
            self.files += 1
            out.append(self.deliver(os.path.join(self.base, "f%d.las" % self.files)))
        return out

    # ---- what happens ----

    def push(self):
        new = self.new_files()
        self.ctl("push", self.name, "--scale", "0.01,0.01", *[s.path for s in new]).ok()
        self.next(new)

    def replace(self):
        """A corrected delivery, with a new file beside it now and then."""
        if not self.live[-1]:
            return self.push()
        old = self.rng.choice(sorted(self.live[-1], key=lambda s: s.kept))
        new = [self.deliver(old.path)] + (self.new_files() if self.rng.random() < 0.3 else [])
        self.ctl("push", self.name, "--replace", *[s.path for s in new]).ok()
        self.next(new, [s for s in self.live[-1] if s.path == old.path])

    def revert(self):
        g = self.rng.randrange(self.oldest, len(self.live))
        added, removed = self.change[g]
        r = self.ctl("dataset", "revert", self.name, str(g))
        if r.status:
            # Something came later that hangs on it; or what was before it is pruned.
            expect(r.status == 1 or (r.status == 4 and g == self.oldest), "a revert that is refused ends with %d" % r.status)
            self.n["refused reverts"] += 1
            return
        self.next(removed - self.live[-1], added & self.live[-1])

    def prune(self):
        keep = self.rng.randrange(1, 6)
        r = self.ctl("dataset", "prune", self.name, "--keep", str(keep))
        if r.status:
            # A job of one of them is not done.
            expect(r.status in (1, 75), "a prune that is refused ends with %d" % r.status)
            return
        self.oldest = max(self.oldest, len(self.live) - keep)

    def remove(self):
        self.ctl("dataset", "rm", self.name).ok()
        if self.rng.random() < 0.5:
            self.restart()
        self.ctl("dataset", "restore", self.name).ok()

    def lose_cache(self):
        if self.rng.random() < 0.5:
            self.ctl("cache", "gc", "--all").ok()
            return
        shutil.rmtree(self.d.cache, ignore_errors=True)
        if self.rng.random() < 0.5:
            self.restart()

    def restart(self):
        self.d.stop(self.rng.choice([signal.SIGKILL, signal.SIGTERM]))
        self.d.start()

    def kill_in_push(self):
        """The daemon is killed in a push; the same push again."""
        new = self.new_files()
        env = dict(os.environ, ACUT_SOCKET=self.d.socket)
        p = subprocess.Popen([e2e.ACUTCTL, "push", self.name, "--scale", "0.01,0.01"] + [s.path for s in new], env=env,
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(self.rng.random() * 0.08)
        self.d.stop(signal.SIGKILL)
        p.wait(e2e.PATIENCE)
        self.d.start()
        self.ctl("push", self.name, "--scale", "0.01,0.01", *[s.path for s in new]).ok()
        self.next(new)

    def kill_in_job(self):
        r = self.ctl("submit", self.name, "--new", *self.rng.choice(VIEWS)).ok()
        time.sleep(self.rng.random() * 0.1)
        self.d.stop(signal.SIGKILL)
        self.d.start()
        self.ctl("wait", r.out.split()[0]).ok()

    def restore_backup(self):
        """The backup replaces the daemon's state, as after the loss of a disk."""
        to = os.path.join(self.base, "backup%d" % self.restored)
        self.ctl("backup", to).ok()
        if self.rng.random() < 0.5:
            return
        self.restored += 1  # another store from now on, which has a folder of its own
        self.d.stop(signal.SIGKILL)
        shutil.rmtree(self.d.state)
        shutil.copytree(to, self.d.state)
        if self.rng.random() < 0.5:
            shutil.rmtree(self.d.cache, ignore_errors=True)
        self.d.start()

    def export(self):
        to = os.path.join(self.base, "export%d" % self.n["export"])
        self.ctl("dataset", "export", self.name, to).ok()
        name = "s%d" % self.n["export"]
        self.ctl("dataset", "import", to, name).ok()
        # Life goes on with the imported one.
        self.name = name
        shutil.rmtree(to)

    def step(self):
        what = self.rng.choices([self.push, self.replace, self.revert, self.prune, self.remove, self.lose_cache, self.restart,
                                 self.kill_in_push, self.kill_in_job, self.restore_backup, self.export],
                                [10, 8, 8, 2, 1, 2, 2, 3, 2, 2, 1])[0]
        self.n[what.__name__] += 1
        what()
        return what.__name__

    # ---- what must be ----

    def want(self, generation, view):
        key = (tuple(sorted(s.kept for s in self.live[generation])), view)
        if not key[0]:
            return None
        if key not in self.known:
            self.fresh += 1
            name = "fresh%d" % self.fresh
            self.oracle.ctl("push", name, "--scale", "0.01,0.01", *key[0]).ok()
            j = self.oracle.ctl("submit", name, "--wait", "--json", *view).ok().json()
            self.known[key] = j["digest"], j["vertex_digest"], j["points"]
            self.oracle.ctl("dataset", "rm", name).ok()
        return self.known[key]

    def compare(self, generation, view):
        want = self.want(generation, view)
        # New: a job of before has its report still, and would not look at the points again.
        r = self.ctl("submit", self.name, "--new", "--wait", "--json", "--at", str(generation), *view)
        if want is None:
            expect(r.status == 0 and r.json()["triangles"] in (0, None), "generation %d has no files: %s" % (generation, r.err))
            return
        j = r.ok().json()
        got = j["digest"], j["vertex_digest"], j["points"]
        expect(got == want, "generation %d with %s: %s, from nothing %s" % (generation, view, got, want))
        self.made += (j["domains"] or 0) - (j["domains_reused"] or 0)
        self.domains += j["domains"] or 0

    def check(self):
        self.compare(len(self.live) - 1, ())
        if self.rng.random() < 0.7:
            self.compare(self.rng.randrange(self.oldest, len(self.live)), self.rng.choice(VIEWS))

    def check_all(self):
        for g in range(self.oldest, len(self.live)):
            self.compare(g, ())
        lines = [json.loads(x) for x in self.d.ctl("dataset", "log", self.name, "--json").ok().out.splitlines()]
        expect([x["generation"] for x in lines] == list(range(1, len(self.live))), "the log: %s" % lines)
        expect([x["generation"] for x in lines if x["readable"]] == list(range(self.oldest, len(self.live))), "readable ones")

    def counts(self):
        return ", ".join("%d %s" % (n, what.replace("_", " ")) for what, n in sorted(self.n.items()))
