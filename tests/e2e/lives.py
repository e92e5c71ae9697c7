"""The life of a dataset under all operations at random: those of years.py, and degenerate deliveries, reused names, clients
killed during a push, two clients and a backup at once while the daemon dies, damage in the cache, and a restored backup. CGAL and
a list of points give the expected mesh. Each is checked with windows, tiles, changes, resumed fetches, and old jobs. Usage:
lives.py [STEPS [SEED...]]. With each third seed, the daemon is stopped and continued at random."""
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time

import e2e
import generations_model
import life_shapes as shapes
from e2e import expect
from generations_model import Source

STEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 40
SEEDS = [int(s) for s in sys.argv[2:]] or [1, 2, 3]
VIEWS = generations_model.VIEWS + (("--ground",), ("--class", "1"), ("--every", "7", "--surface"), ("--thin", "0.5", "--thin-pick", "median"),
                                   ("--thin", "3", "--thin-pick", "highest"), ("--crop", "-9,20,90,40", "--thin", "2"))
# Errors that a correct client may get: another client was there, or the daemon ended.
AGAIN = (69, 74, 75)


class Stalls:
    """Stops the process of the daemon now and then, and continues it."""

    def __init__(self, d, rng):
        self.d, self.rng, self.over = d, rng, threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)

    def run(self):
        while not self.over.wait(self.rng.random() * 0.4):
            p = self.d.process
            try:
                p.send_signal(signal.SIGSTOP)
                self.over.wait(self.rng.random() * 0.3)
                p.send_signal(signal.SIGCONT)
            except ProcessLookupError:
                pass

    def __enter__(self):
        self.thread.start()

    def __exit__(self, *exc):
        self.over.set()
        self.thread.join()


class Life(generations_model.Life):
    def __init__(self, base, d, rng):
        self.damaged, self.jobs = False, []
        self.large = rng.random() < 0.4  # more than one region, then
        super().__init__(base, d, None, rng)

    def path(self, name):
        return os.path.join(self.base, name)

    # ---- deliveries ----

    def deliver(self, path):
        self.deliveries += 1
        n = self.rng.choice([3, 50, 1000, 3000])
        if self.large and (self.deliveries == 1 or self.rng.random() < 0.05):
            points = shapes.deliver_survey(path, self.rng, 70000)
        else:
            points = shapes.deliver(path, self.rng, n)
        os.utime(path, ns=(self.deliveries * 10 ** 9, self.deliveries * 10 ** 9))
        s = Source(path, self.path("kept%d.las" % self.deliveries))
        shutil.copy2(path, s.kept)
        s.points = points
        return s

    def some(self):
        return self.rng.choice(sorted(self.live[-1], key=lambda s: s.kept))

    def args(self, sources, *options):
        return ["push", self.name, "--scale", "0.01,0.01", *options] + [s.path for s in sources]

    def add(self):
        """Other points under a name that is there."""
        if not self.live[-1]:
            return self.push()
        new = self.deliver(self.some().path)
        self.ctl(*self.args([new], "--add")).ok()
        self.next([new])

    def move(self):
        """A corrected delivery under another name."""
        if not self.live[-1]:
            return self.push()
        old, new = self.some(), self.new_files()[0]
        gone = [s for s in self.live[-1] if s.path == old.path]
        self.ctl(*self.args([new], "--replaces", old.path)).ok()
        self.next([new], gone)

    def back(self):
        """Restores an earlier content in place of the later one."""
        now = {s.path for s in self.live[-1]}
        once = sorted({s for g in self.live for s in g if s.path in now and s not in self.live[-1]}, key=lambda s: s.kept)
        if not once:
            return self.replace()
        s = self.rng.choice(once)
        shutil.copy2(s.kept, s.path)
        self.ctl(*self.args([s], "--replace")).ok()
        self.next([s], [x for x in self.live[-1] if x.path == s.path])

    # ---- names ----

    def number(self):
        return str(self.d.ctl("dataset", "show", self.name, "--json").ok().json()["id"])

    def remove(self):
        number = self.number()
        self.ctl("dataset", "rm", self.name).ok()
        if self.rng.random() < 0.5:
            self.restart()
        self.ctl("dataset", "restore", number).ok()

    def rename(self):
        name, number = "t%d" % self.n["rename"], self.number()
        self.ctl("dataset", "rm", self.name).ok()
        self.ctl("dataset", "restore", number, "--as", name).ok()
        self.name = name

    def name_again(self):
        """The name is used by another dataset for a while."""
        number = self.number()
        self.ctl("dataset", "rm", self.name).ok()
        other = self.deliver(self.path("other.las"))
        self.ctl(*self.args([other])).ok()
        r = self.ctl("dataset", "restore", self.name)
        expect(r.status != 0, "restored over another")
        self.ctl("dataset", "rm", self.name).ok()
        self.ctl("dataset", "restore", number).ok()

    def pin(self):
        self.ctl("dataset", "pin", self.name).ok()
        for args in (["rm", self.name], ["prune", self.name, "--keep", "1"]):
            expect(self.ctl("dataset", *args).status == 1, "pinned, and all the same: %s" % args)
        if self.rng.random() < 0.5:
            self.restart()
        self.ctl("dataset", "unpin", self.name).ok()

    # ---- what dies ----

    def begin(self, *args):
        env = dict(os.environ, ACUT_SOCKET=self.d.socket)
        return subprocess.Popen([e2e.ACUTCTL, *args], env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def end(self, p, what):
        out = p.communicate(timeout=e2e.PATIENCE)[0].decode(errors="replace")
        self.told.append("%s -> %d %s" % (what, p.returncode, out.strip()[-300:]))
        return p.returncode, out

    def until_done(self, *args):
        """Repeats a command until it succeeds, as a script does; returns the last answer."""
        return e2e.until(lambda: [r for r in [self.ctl(*args)] if r.status not in AGAIN], "%s: not now, for ever" % (args,))[0].ok()

    def client_killed(self):
        """Kills the client several times during one push, then pushes some of the files again, then all."""
        new = self.new_files() + self.new_files()
        before = len(self.log())
        for _ in range(self.rng.randrange(1, 4)):
            p = self.begin(*self.args(new))
            time.sleep(self.rng.random() * 0.05)
            p.kill()
            self.end(p, "push, killed")
        if self.rng.random() < 0.3:
            self.restart()
        part = self.rng.sample(new, self.rng.randrange(1, len(new) + 1))
        for sources in (part, new):
            self.until_done(*self.args(sources))
        self.learn(before, new, [])

    def storm(self):
        """Two pushes, a replacement, jobs, a backup and an export at once; the daemon is killed or not."""
        pushes = [(self.new_files(), []), (self.new_files(), [])]
        if self.live[-1] and self.rng.random() < 0.5:
            pushes.append(([self.deliver(self.some().path)], ["--replace"]))
        before = len(self.log())
        others = [["submit", self.name, "--new", *self.rng.choice(VIEWS)], ["backup", self.path("backup-stormed")],
                  ["dataset", "export", self.name, self.path("stormed")], ["cache", "gc", "--all"], ["plan", self.name]]
        started = [(self.begin(*self.args(new, *o)), new, o) for new, o in pushes]
        started += [(self.begin(*o), None, o) for o in self.rng.sample(others, self.rng.randrange(0, 4))]
        if self.rng.random() < 0.6:
            time.sleep(self.rng.random() * 0.15)
            self.d.stop(signal.SIGKILL)
            self.d.start()
        acknowledged = []
        for p, new, what in started:
            status, out = self.end(p, what)
            expect(status in (0, 1) + AGAIN, "%s ended with %d: %s" % (what, status, out))
            acknowledged += new if new and status == 0 else []
        there = {f["path"] for row in self.log()[before:] for f in row["files"] if not f["removed"]}
        expect({s.path for s in acknowledged} <= there, "acknowledged, and lost")
        for new, o in pushes:
            self.until_done(*self.args(new, *o))
        self.learn(before, [s for new, _ in pushes for s in new], [s.path for new, o in pushes for s in new if o])
        for name in ("stormed", "backup-stormed"):
            shutil.rmtree(self.path(name), ignore_errors=True)

    def log(self):
        return [json.loads(x) for x in self.d.ctl("dataset", "log", self.name, "--json", "--files").ok().out.splitlines()]

    def learn(self, before, new, replaced):
        """Finds which generation has brought which of the new files: each once, and no others."""
        left = {s.path: s for s in new}
        for row in self.log()[before:]:
            added = [left.pop(f["path"], None) for f in row["files"] if not f["removed"]]
            gone = {f["path"] for f in row["files"] if f["removed"]}
            expect(None not in added, "a file twice, or not of this push: %s" % row)
            expect(gone == {s.path for s in added if s.path in replaced}, "what is replaced: %s" % row)
            self.next(added, [s for s in self.live[-1] if s.path in gone])
        expect(not left, "not there: %s" % sorted(left))

    def damage(self):
        """Changes, truncates or removes some files of the cache."""
        files = sorted(os.path.join(top, n) for top, _, names in os.walk(self.d.cache) for n in names if n not in ("lock", "acut-cache"))
        for path in self.rng.sample(files, min(len(files), self.rng.choice([1, 3, 30]))):
            how = self.rng.randrange(3)
            try:
                if how == 0:
                    os.unlink(path)
                elif how == 1:
                    os.truncate(path, self.rng.randrange(os.path.getsize(path) + 1))
                else:
                    with open(path, "r+b") as f:
                        f.seek(self.rng.randrange(os.path.getsize(path) or 1))
                        f.write(b"\xee\xee")
            except FileNotFoundError:
                pass
        self.damaged = True

    def restored_beside(self):
        """Another daemon on a backup has the same datasets."""
        to = self.path("beside%d" % self.restored)
        self.ctl("backup", to, *self.rng.choice([[], ["--copy"]])).ok()
        other = e2e.Daemon(self.base, memory="48M", name="-beside")
        shutil.copytree(to, other.state)
        with other:
            g = self.rng.randrange(self.oldest, len(self.live))
            j = other.ctl("submit", self.name, "--new", "--wait", "--json", "--at", str(g)).ok().json()
            want = self.want(g, ())
            expect((j["digest"] or "0" * 32, j["vertex_digest"] or "0" * 32) == want[1:3], "generation %d of a restored backup" % g)
        shutil.rmtree(other.state)
        shutil.rmtree(other.cache)

    def step(self):
        what = self.rng.choices([self.push, self.replace, self.revert, self.prune, self.remove, self.lose_cache, self.restart,
                                 self.kill_in_push, self.kill_in_job, self.restore_backup, self.export, self.add, self.move, self.back,
                                 self.rename, self.name_again, self.pin, self.client_killed, self.storm, self.damage, self.restored_beside],
                                [4, 5, 8, 2, 1, 2, 2, 2, 2, 1, 1, 2, 3, 3, 1, 1, 1, 4, 6, 3, 1])[0]
        self.n[what.__name__] += 1
        self.told.append("# " + what.__name__)
        what()

    # ---- what must be ----

    def heights(self, generation, view):
        return shapes.select([p for s in self.live[generation] for p in s.points], view)

    def want(self, generation, view):
        """Expected triangles, both digests, points and positions, by CGAL and the list."""
        key = (tuple(sorted(s.kept for s in self.live[generation])), view)
        if key not in self.known:
            heights = self.heights(generation, view)
            triangles, digest = shapes.oracle(self.path("oracle.las"), heights)[0]
            self.known[key] = (triangles, digest, shapes.vertex_digest(heights),
                               sum(len(s.points) for s in self.live[generation]), len(heights))
        return self.known[key]

    def asked(self, *args):
        """The answer to a command. Damage is reported once, and repaired then."""
        r = self.ctl(*args)
        for _ in range(40 if self.damaged else 0):
            if r.status != 74:
                break
            self.n["damage seen"] += 1
            r = self.ctl(*args)
        return r

    def compare(self, generation, view):
        want, new = self.want(generation, view), ["--new"] if self.rng.random() < 0.7 else []
        r = self.asked("submit", self.name, *new, "--wait", "--json", "--at", str(generation), *view)
        if view == ("--ground",) and r.status == 1 and not want[4]:
            return None
        j = r.ok().json()
        got = tuple(j[k] for k in ("triangles", "digest", "vertex_digest", "points", "used"))
        if not want[3]:
            expect(got[0] in (0, None), "generation %d has no points: %s" % (generation, j))
            return None
        expect(got == want, "generation %d with %s: %s, by CGAL %s" % (generation, view, got, want))
        self.made += (j["domains"] or 0) - (j["domains_reused"] or 0)
        self.domains += j["domains"] or 0
        self.jobs.append((j["job"], generation, view, self.name))
        return j["job"]

    def windows(self, job, generation, view):
        heights = self.heights(generation, view)
        places = sorted(heights) or [(0, 0)]
        polygons, options = [], []
        for i in range(3):
            (x, y), side = self.rng.choice(places), self.rng.choice([0, 3, 100, 2000, 10 ** 6])
            if i:
                polygons.append([(x, y), (x + side, y), (x + side, y + side), (x, y + side)] if side else [(x, y)])
                options.append("--bbox=" + ",".join(map(shapes.decimal, (x, y, x + side, y + side))))
            else:
                polygons.append([(x - side, y), (x + 2 * side + 1, y - 7), (x + 3, y + side + 2)])
                options.append("--polygon=" + shapes.geojson(self.path("ring.json"), polygons[-1]))
        lines = shapes.oracle(self.path("oracle.las"), heights, polygons)
        for line, o in zip(lines[1:], options):
            j = self.asked("fetch", str(job), "--format", "null", "--json", o).ok().json()
            expect((j["triangles"], j["digest"]) == line, "window %s: %s %s, by CGAL %s" % (o, j["triangles"], j["digest"], line))
        j = self.asked("submit", self.name, "--wait", "--json", "--at", str(generation), *view, options[-1]).ok().json()
        expect((j["triangles"], j["digest"]) == lines[-1], "submitted window %s: %s" % (options[-1], j))

    def fetched(self, job, *options):
        out = self.path("mesh.obj")
        self.asked("fetch", str(job), "-o", out, *options).ok()
        return shapes.read_obj(out)

    def tiles(self, job, generation, view):
        whole, to = self.fetched(job), self.path("tiles")
        at = [c for t in whole for p in t for c in p[:2]] or [0]
        side = shapes.decimal((max(at) - min(at)) // self.rng.randrange(2, 9) + 1)
        self.asked("fetch", str(job), "--tile", side, "--format", "obj", "-o", to).ok()
        parts = [t for n in sorted(os.listdir(to)) if n.endswith(".obj") for t in shapes.read_obj(os.path.join(to, n))]
        shutil.rmtree(to)
        expect(sorted(parts) == sorted(whole), "tiles of %s: %d triangles, not %d" % (side, len(parts), len(whole)))

    def changes(self, job, generation, view):
        since = self.rng.randrange(self.oldest, len(self.live))
        old = self.compare(since, view)
        if old is None:
            return
        was, now = self.fetched(old), self.fetched(job)
        came = self.fetched(job, "--changed-since", str(since))
        with open(self.path("mesh.obj.changes.geojson")) as f:
            rows = [r["properties"] for r in json.load(f)["features"]]
        gone = [[v if v is None else round(v * 200) for v in r["region"]] for r in rows if r["change"] == "gone"]
        if len(gone) * len(was) > 3 * 10 ** 6:  # too many to be looked at one by one; acutctl has compared the digests
            left = len(was) - sum(r["triangles"] for r in rows if r["change"] == "gone")
            expect(left + len(came) == len(now), "changes from %d to %d: %d and %d are not %d" % (since, generation, left, len(came), len(now)))
            return
        kept = [t for t in was if not shapes.centre_in(t, gone)]
        expect(sorted(kept + came) == sorted(now), "changes from %d to %d: %d kept and %d new are not %d" % (since, generation, len(kept), len(came), len(now)))

    def resumed(self, job, generation, view):
        out, again = self.path("resumed.ply"), self.path("again.ply")

        def on():
            return ["--resume"] if os.path.exists(out + ".part.state") and os.path.exists(out + ".part") else []

        for _ in range(self.rng.randrange(3)):
            p = self.begin("fetch", str(job), "-o", out, *on())
            time.sleep(self.rng.random() * 0.05)
            p.kill()
            self.end(p, "fetch, killed")
        self.asked("fetch", str(job), "-o", out, *on()).ok()
        self.asked("fetch", str(job), "-o", again).ok()
        with open(out, "rb") as a, open(again, "rb") as b:
            expect(a.read() == b.read(), "a resumed fetch has other bytes")
        text = self.d.ctl("show", str(job), "--json").ok().json()["view"]
        e2e.run([e2e.VERIFY, "--quiet", "--view", text, out] + sorted(s.kept for s in self.live[generation])).ok()
        os.unlink(out)

    def long_ago(self, *unused):
        """The report and the triangles of an old job. A pruned or renumbered one may be refused."""
        job, generation, view, name = self.rng.choice(self.jobs)
        r = self.d.ctl("show", str(job), "--json")
        if r.status == 4 or (r.status == 0 and (r.json()["dataset"], r.json()["generation"]) != (self.name, generation)):
            return
        want, r = self.want(generation, view), self.asked("fetch", str(job), "--format", "null", "--json")
        if generation < self.oldest and r.status:
            expect(r.status == 4 and "was pruned" in r.out + r.err, "a job of a pruned generation: %d %s" % (r.status, r.out + r.err))
            return
        j = r.ok().json()
        expect((j["triangles"], j["digest"], j["vertex_digest"]) == want[:3], "job %d of long ago: %s" % (job, j))

    def check(self):
        for g, view in ((len(self.live) - 1, ()), (self.rng.randrange(self.oldest, len(self.live)), self.rng.choice(VIEWS))):
            job = self.compare(g, view)
            if job is not None and self.rng.random() < 0.5:
                what = self.rng.choice([self.windows, self.windows, self.tiles, self.changes, self.changes, self.resumed, self.long_ago])
                self.n[what.__name__] += 1
                self.told.append("# %s of %d with %s" % (what.__name__, g, view))
                what(job, g, view)


def life(seed, steps):
    rng = random.Random(seed)
    with e2e.Folder() as base, e2e.Daemon(base, memory=rng.choice(["24M", "32M", "64M"]), threads=rng.choice([1, 2, 3])) as d:
        def live():
            x = Life(base, d, rng)
            for n in range(steps):
                try:
                    x.step()
                    x.check()
                except Exception as e:
                    raise e2e.Fault("seed %d, step %d: %s: %s\n%s" % (seed, n, type(e).__name__, e, "\n".join(x.told[-14:])))
            x.check_all()
            r = x.asked("cache", "verify")
            expect(r.status == 0 or x.damaged, r.out + r.err)
            print("     seed %d: %s; %d of %d domains made" % (seed, x.counts(), x.made, x.domains), flush=True)

        if seed % 3 == 0:
            with Stalls(d, random.Random(seed)):
                live()
        else:
            live()


def lives():
    for seed in SEEDS:
        life(seed, STEPS)


if not shapes.CGAL:
    e2e.skip("CGAL is not there")
e2e.main(lives)
