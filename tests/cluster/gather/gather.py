"""Outputs of a cluster's run: every format and the tiles are those of acutd and acutctl; damaged and missing packs are refused by
name; tasks that are killed, or run twice at once, leave the same outputs and nothing else; finished domains go into a daemon's store."""
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "e2e"))
import e2e  # noqa: E402
from cluster_tasks import stl_triangles  # noqa: E402
from e2e import expect, run  # noqa: E402

PHASES = os.environ["PHASES"]
# What a format cannot do without.
OPTIONS = {"tif": ["--cell", "0.5"], "glb": ["--origin", "auto"], "stl": ["--origin", "auto"],
           "gpkg": ["--interval", "1"], "geojson": ["--interval", "1"], "dxf-contours": ["--interval", "1"]}
ENV = {"ACUT_CLUSTER_PATIENCE": "0.2"}
MEMORY = "64M"


def phases(*words, **kw):
    return run([PHASES, *words], env=ENV, **kw)


def inputs(base, n=3, points=60000):
    """Surveys beside each other that overlap."""
    paths = []
    for i in range(n):
        paths.append(os.path.join(base, "in%d.las" % i))
        run([e2e.SYNTH, "--points", str(points), "--seed", str(i + 1), "--origin", "%d,5400000,0" % (500000 + 35 * i), paths[-1]]).ok()
    return paths


class Work:
    """A run up to the phase mesh, and outputs of it."""

    def __init__(self, base, files, meshes=4, gathers=3, stages=2):
        self.first, self.gathers = os.path.join(base, "first"), gathers
        phases("make", self.first, MEMORY, stages, meshes, gathers, *files).ok()
        self.base, self.n = base, 0

    def fresh(self):
        """A copy: without outputs, and with every task of gather to be done."""
        self.n += 1
        path = os.path.join(self.base, "work%d" % self.n)
        shutil.copytree(self.first, path, symlinks=True)
        return path

    def write(self, *options):
        path = self.fresh()
        for i in range(self.gathers):
            phases("gather", path, i, *options).ok()
        phases("finish", path, *options).ok()
        return path


def hashes(folder):
    """Name -> hash, without what says where a mesh is from."""
    found = {}
    for top, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(top, name)
            with open(path, "rb") as f:
                data = f.read()
            if name == "index.geojson" or name.endswith(".json"):
                data = origin_free(json.loads(data))
            found[os.path.relpath(path, folder)] = hashlib.sha256(data).hexdigest()
    return found


def origin_free(value):
    def walk(v):
        if isinstance(v, dict):
            return {k: walk(w) for k, w in v.items() if k not in ("job", "generation", "dataset")}
        return [walk(w) for w in v] if isinstance(v, list) else v
    return json.dumps(walk(value), sort_keys=True).encode()


def report(path, suffix=".json"):
    names = [n for n in os.listdir(path) if n.startswith("report-") and n.endswith(suffix)]
    expect(len(names) == 1, str(names))
    with open(os.path.join(path, names[0])) as f:
        return f.read()


def formats():
    rows = [json.loads(line) for line in run([e2e.ACUTCTL, "formats", "--json"]).ok().out.splitlines()]
    rows = [r for r in rows if r["direction"] == "out" and r["format"] != "null"]
    expect(len(rows) >= 12, str(rows))
    return [(r["format"], ["--format", r["format"], *OPTIONS.get(r["format"], [])], (r["extensions"] or ".file").split()[0]) for r in rows]


class Both:
    """The same points as a job of a daemon and as a run."""

    def __init__(self, base, d, **kw):
        files = inputs(base)
        self.base, self.d, self.k = base, d, 0
        self.work = Work(base, files, **kw)
        d.ctl("dataset", "import", os.path.join(self.work.first, "dataset"), "s").ok()
        self.job = d.ctl("submit", "s", "--wait").ok().out.split()[0]
        self.shown = d.ctl("show", self.job, "--json").ok().json()

    def folders(self):
        self.k += 1
        pair = [os.path.join(self.base, "%s%d" % (who, self.k)) for who in ("daemon", "run")]
        for p in pair:
            os.mkdir(p)
        return pair

    def compare(self, words, name, exact=True):
        a, b = self.folders()
        self.d.ctl("fetch", self.job, "-o", os.path.join(a, name), *words).ok()
        path = self.work.write("-o", os.path.join(b, name), *words)
        one, other = hashes(a), hashes(b)
        expect(set(one) == set(other), "%s: %s and %s" % (words, sorted(one), sorted(other)))
        if exact:
            differ = [n for n in one if one[n] != other[n]]
            expect(not differ, "%s: %s differ" % (words, differ))
        else:
            for n in one:
                sizes = [os.path.getsize(os.path.join(x, n)) for x in (a, b)]
                expect(sizes[0] == sizes[1], "%s: %s has %s bytes" % (words, n, sizes))
        expect(not [n for n in os.listdir(b) if n.startswith(".")], os.listdir(b))
        for p in (a, b):
            shutil.rmtree(p)
        return path


def every_format():
    with e2e.Folder() as base, e2e.Daemon(base, memory=MEMORY) as d:
        both = Both(base, d)
        for name, words, extension in formats():
            r = d.ctl("fetch", both.job, "-o", os.path.join(base, "try"), *words, "--canonical")
            canonical = ["--canonical"] if not r.status else []
            path = both.compare(words + canonical + ["--sidecar"], "out" + extension)
            got = json.loads(report(path))
            for key in ("digest", "vertex_digest", "triangles", "vertices", "hull", "points", "used", "removed", "lattice", "crs"):
                expect(got[key] == both.shown[key], "%s: %s is %s, not %s" % (name, key, got[key], both.shown[key]))
            expect(both.shown["digest"] in report(path, ".txt"), report(path, ".txt"))
            shutil.rmtree(path)
        both.compare(["--levels"], "page")
        both.compare(["--format", "ply", "-o", os.path.join(base, "both.obj")], "x.ply", exact=False)
        os.unlink(os.path.join(base, "both.obj"))


def by_all_tasks():
    """One PLY and one STL that all tasks write at once have the triangles of acutd's, for several tasks and blocks."""
    with e2e.Folder() as base, e2e.Daemon(base, memory=MEMORY) as d:
        files = inputs(base, 2, 30000)
        first, mesh = os.path.join(base, "d.stl"), os.path.join(base, "d.ply")
        shown = d.ctl("mesh", *files, "-o", mesh, "-o", first, "--origin", "auto", "--json").ok().json()
        want = stl_triangles(first)
        for gathers, block in ((2, 4096), (5, 1 << 16), (7, 1 << 22)):
            folder, out = os.path.join(base, "w%d" % gathers), os.path.join(base, "out%d" % gathers)
            os.mkdir(folder)
            os.mkdir(out)
            work = Work(folder, files, gathers=gathers)
            path, ply, stl = work.fresh(), os.path.join(out, "x.ply"), os.path.join(out, "x.stl")
            words = ["-o", ply, "-o", stl, "--origin", "auto"]
            env = dict(ENV, PHASES_BLOCK=str(block))
            for i in range(gathers):
                run([PHASES, "gather", path, str(i), *words], env=env).ok()
            run([PHASES, "finish", path, *words], env=env).ok()
            got = json.loads(report(path))
            for key in ("digest", "vertex_digest", "triangles", "vertices", "hull"):
                expect(got[key] == shown[key], "%s is %s, not %s" % (key, got[key], shown[key]))
            expect(got["output_bytes"] == os.path.getsize(ply) + os.path.getsize(stl), str(got))
            for key in ("longest", "median", "long_share"):
                expect(abs(got["edges"][key] - shown["edges"][key]) < 1e-9, "%s %s" % (got["edges"], shown["edges"]))
            expect(sorted(os.listdir(out)) == ["x.ply", "x.stl"], str(os.listdir(out)))
            expect([os.path.getsize(x) for x in (ply, stl)] == [os.path.getsize(x) for x in (mesh, first)], "sizes differ")
            expect(stl_triangles(stl) == want, "other triangles with %d tasks" % gathers)
            run([e2e.VERIFY, ply, *files]).ok()
            # what needs the mesh in order is still made by one task
            expect(len([n for n in os.listdir(path) if n.startswith("gather-")]) == gathers, "not every task wrote")
        path = work.write("-o", os.path.join(base, "one.ply"), "--max-edge", "1")
        expect(len([n for n in os.listdir(path) if n.startswith("gather-")]) == 1, str(os.listdir(path)))


def tiles():
    with e2e.Folder() as base, e2e.Daemon(base, memory=MEMORY) as d:
        both = Both(base, d)
        with open(os.path.join(base, "area.wkt"), "w") as f:
            f.write("POLYGON((500010 5400000,500090 5400010,500050 5400070,500010 5400000))")
        trims = [[], ["--max-edge", "1"], ["--mask", os.path.join(base, "area.wkt")], ["--trim-hull", "2"]]
        for i, (name, words, _) in enumerate(formats()):
            if name == "html":
                continue
            both.compare(words + ["--tile", "20"] + trims[i % len(trims)], "tiles")
        both.compare(["--format", "png", "--cell", "0.5", "--tile", "20"], "tiles")
        path = both.compare(["--tile", "7.5"], "tiles")
        records = [f for f in os.listdir(path) if f.startswith("gather-")]
        expect(len(records) == both.work.gathers, "not every task had tiles: %s" % records)


def damage():
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=1)
        out = os.path.join(base, "out.ply")
        packs = sorted(n for n in os.listdir(os.path.join(work.first, "mesh")) if n.startswith("pack-"))
        expect(len(packs) == 4, str(packs))
        r = random.Random(5)
        for i in range(12):
            path = work.fresh()
            pack = os.path.join(path, "mesh", packs[i % 4])
            size = os.path.getsize(pack)
            with open(pack, "r+b") as f:
                at = r.randrange(size)
                f.seek(at)
                byte = f.read(1)
                f.seek(at)
                f.write(bytes([byte[0] ^ 0x10]))
            got = phases("gather", path, 0, "-o", out)
            # bytes between domains have no meaning
            expect(not got.status or packs[i % 4] in got.err, "byte %d of %s: %d %s" % (at, packs[i % 4], got.status, got.err))
            shutil.rmtree(path)
        path = work.fresh()
        os.unlink(os.path.join(path, "mesh", packs[1]))
        got = phases("gather", path, 0, "-o", out)
        expect(got.status and packs[1] in got.err, got.err)
        path = work.fresh()
        with open(os.path.join(path, "mesh", packs[2]), "r+b") as f:
            f.truncate(1000)
        got = phases("gather", path, 0, "-o", out)
        expect(got.status and packs[2] in got.err, got.err)
        expect(not os.path.exists(out) and not [n for n in os.listdir(base) if n.startswith(".")], os.listdir(base))
        got = phases("finish", path, "-o", out)
        expect(got.status and packs[2] in got.err, got.err)
        path = work.fresh()
        got = phases("finish", path, "-o", out)
        expect(got.status and "gather" in got.err, got.err)
        for words, text in ((["-o", "-"], "standard output"), (["-o", "x.tif"], "--cell")):
            got = phases("gather", path, 0, *words)
            expect(got.status == 2 and text in got.err, "%s: %d %s" % (words, got.status, got.err))


def too_large():
    """One PLY cannot have more than 2^31 vertices: known from the points that inputs claim."""
    most = 1 << 31
    phases("check", most, "-o", "x.ply").ok()
    got = phases("check", most + 1, "-o", "x.ply")
    expect(got.status and "x.ply" in got.err and "--tile" in got.err, got.err)
    for words in (["-o", "x.obj"], ["-o", "x", "--tile", "100"], ["-o", "x.ply", "--format", "obj"]):
        phases("check", most + 1, *words).ok()


def too_many_tiles():
    """Refused when gather begins, by what finish can hold."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=3)
        out = os.path.join(base, "out")
        for i in range(work.gathers):
            got = phases("gather", work.first, i, "-o", out, "--tile", "0.05")
            expect(got.status == 2 and "about" in got.err and "--task-memory" in got.err, "%d %s" % (got.status, got.err))
        expect(not os.path.exists(out), "a folder was made")


def start(*words):
    return subprocess.Popen([PHASES] + [str(w) for w in words], env=dict(os.environ, ACUT_CLUSTER_PATIENCE="60"), stdout=subprocess.DEVNULL,
                            stderr=subprocess.PIPE)


def killed():
    """At any moment; the next attempt makes the same."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=2)
        want = None
        r = random.Random(11)
        for i in range(14):
            out = os.path.join(base, "out%d" % i)
            words = ["-o", out, "--tile", "15"] if i % 2 else ["-o", os.path.join(out, "x.ply"), "--sidecar"]
            os.mkdir(out)
            path = work.fresh()
            for phase in (["gather", path, 0], ["gather", path, 1], ["finish", path]):
                p = start(*phase, *words)
                time.sleep(r.random() * (0.02 if phase[0] == "finish" else 0.15))
                p.send_signal(signal.SIGKILL)
                p.wait()
                p.stderr.close()
                phases(*phase, *words).ok()
            phases("clean", path, *words).ok()
            expect(not [n for n in os.listdir(out) if n.startswith(".")], os.listdir(out))
            got = hashes(out)
            want = want or {}
            expect(want.setdefault(i % 2, got) == got, "another output after attempt %d was killed" % i)
            shutil.rmtree(path)
            shutil.rmtree(out)


def twice():
    """All attempts of a task end well; one of them counts, and the outputs are those of single attempts. Later attempts that would write
    something else change nothing."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=2)
        want = []
        for words in (["-o", os.path.join(base, "want", "x.ply")], ["-o", os.path.join(base, "want"), "--tile", "15"]):
            os.mkdir(os.path.join(base, "want"))
            shutil.rmtree(work.write(*words))
            want.append(hashes(os.path.join(base, "want")))
            shutil.rmtree(os.path.join(base, "want"))
        for i in range(8):
            out = os.path.join(base, "out%d" % i)
            words = ["-o", out, "--tile", "15"] if i % 2 else ["-o", os.path.join(out, "x.ply")]
            words += ["--no-clobber"] if i > 3 else []
            os.mkdir(out)
            path = work.fresh()
            for phase in (["gather", path, 0], ["gather", path, 1], ["finish", path]):
                ps = [start(*phase, *words) for _ in range(3)]
                for p in ps:
                    err = p.communicate()[1].decode()
                    expect(p.returncode == 0, "%s: %d %s" % (phase, p.returncode, err))
                phases(*phase, *words, "--origin", "1000,2000,0").ok()
            expect(hashes(out) == want[i % 2], "other outputs than those of single attempts")
            expect(not [n for n in os.listdir(out) if n.startswith(".")], os.listdir(out))
            expect(len([n for n in os.listdir(path) if n.startswith("report-0-")]) == 2, os.listdir(path))


def manifest_counts():
    """The memory that a task of gather needs grows with the manifest of the dataset."""
    with e2e.Folder() as base:
        [file] = inputs(base, 1)
        deep = base
        for _ in range(12):
            deep = os.path.join(deep, "d" * 200)
            os.mkdir(deep)
        needs, sizes = [], []
        for name in ("near", "far"):
            folder = os.path.join(base, name)
            os.mkdir(folder)
            given = os.path.join(deep if name == "far" else folder, "in.las")
            os.link(file, given)
            work = Work(folder, [given], gathers=1, meshes=1, stages=1)
            got = run([PHASES, "gather", work.first, 0, "-o", os.path.join(base, "x.ply")], env=dict(ENV, PHASES_MEMORY="1000000"))
            expect(got.status and "manifest" in got.err and "--task-memory" in got.err, got.err)
            expect(not os.path.exists(os.path.join(work.first, "done", "sum-0")), "sum did not ask for memory")
            needs.append(int(got.err.split("needs ")[1].split()[0]))
            sizes.append(os.path.getsize(os.path.join(work.first, "dataset", "manifest")))
        expect(sizes[1] > sizes[0] + 2000, str(sizes))
        expect(needs[1] - needs[0] >= sizes[1] - sizes[0], "%s with manifests of %s" % (needs, sizes))


def finished_again():
    """A late attempt at finish never removes an index that is true, neither its own nor that of a later run."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base, 1), gathers=2)
        for i, words in enumerate((["--tile", "15"], ["--levels"])):
            out = os.path.join(base, "out%d" % i)
            words = ["-o", out, *words]
            path = work.write(*words)
            index = os.path.join(out, "index.html" if i else "index.geojson")
            record = os.path.join(path, "done", "finish-0")
            before = os.stat(index)
            os.unlink(record)
            phases("finish", path, *words).ok()
            after = os.stat(index)
            expect(after.st_ino == before.st_ino and after.st_mtime_ns == before.st_mtime_ns, "the index was made again")
            os.unlink(record)
            other = work.write(*words)
            before = os.stat(index)
            got = phases("finish", path, *words)
            expect(got.status and "not there any more" in got.err, "%d %s" % (got.status, got.err))
            after = os.stat(index)
            expect(after.st_ino == before.st_ino, "the index of a later run was replaced")
            shutil.rmtree(other)


def forgotten(path, *words):
    return json.loads(phases("recover", path, *words).ok().out)


def recovered():
    """What is gone, and was missed by a task, is made again; nothing else is."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=3)
        for kind, words in (("pack", ["--tile", "15"]), ("pack", []), ("sum", []), ("held", []), ("held", ["--tile", "15"]), ("late", [])):
            out = os.path.join(base, "out")
            os.mkdir(out)
            words = ["-o", out if words else os.path.join(out, "x.ply"), *words]
            path = work.fresh()
            done = os.path.join(path, "done")
            first = ["gather", path, 0, *words]
            phases(*first).ok()
            expect(forgotten(path, *words) == 0, "something was missing")
            if kind == "held":
                phases("gather", path, 1, *words).ok()
                phases("gather", path, 2, *words).ok()
                for name in [n for n in os.listdir(out) if n.startswith(".")]:
                    shutil.rmtree(os.path.join(out, name)) if os.path.isdir(os.path.join(out, name)) else os.unlink(os.path.join(out, name))
                first, want = ["finish", path, *words], {"gather-0", "gather-1", "gather-2"}
            elif kind == "late":
                # A task that began before its file was gone, and ends when others agree upon another one.
                phases("gather", path, 1, *words).ok()
                phases("gather", path, 2, *words).ok()
                other = work.fresh()
                shutil.rmtree(out)
                os.mkdir(out)
                for i in range(3):
                    phases("gather", other, i, *words).ok()
                for name in [n for n in os.listdir(path) if n.startswith("gather-1-")]:
                    shutil.copy(os.path.join(path, name), other)
                shutil.copy(os.path.join(done, "gather-1"), os.path.join(other, "done"))
                shutil.rmtree(path)
                path, done = other, os.path.join(other, "done")
                first, want = ["finish", path, *words], {"gather-1"}
            else:
                os.unlink(os.path.join(done, "gather-0"))
                folder = os.path.join(path, "mesh") if kind == "pack" else path
                lost = sorted(n for n in os.listdir(folder) if n.startswith(kind + "-"))[0]
                os.unlink(os.path.join(folder, lost))
                want = {"mesh-0", "sum-0"} if kind == "pack" else {"sum-0"}
            before = set(os.listdir(done))
            expect(phases(*first).status, "nothing was missed: %s" % kind)
            n = forgotten(path, *words)
            expect(before - set(os.listdir(done)) == want and n == len(want), "%s: %s, not %s" % (kind, before - set(os.listdir(done)), want))
            if kind == "pack":
                phases("mesh", path, 0).ok()
            for i in range(3):
                phases("gather", path, i, *words).ok()
            phases("finish", path, *words).ok()
            expect(forgotten(path, *words) == 0, "a run that is done was changed")
            fresh = os.path.join(base, "want")
            os.mkdir(fresh)
            work.write(*[w.replace(out, fresh) for w in words])
            expect(hashes(out) == hashes(fresh), "%s: another output" % kind)
            for folder in (path, out, fresh):
                shutil.rmtree(folder)


def packs_named_again():
    """The sums never stay with the name of a pack that is made again under another one."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=2)
        for kind in ("between", "interrupted", "late", "truncated"):
            out = os.path.join(base, "out")
            os.mkdir(out)
            words = ["-o", os.path.join(out, "x.ply")]
            path = work.fresh()
            done = os.path.join(path, "done")
            phases("gather", path, 0, *words).ok()
            os.unlink(os.path.join(done, "gather-0"))
            with open(os.path.join(done, "sum-0"), "rb") as f:
                sums = f.read()
            pack = next(os.path.join(path, "mesh", n) for n in os.listdir(os.path.join(path, "mesh")) if n.startswith("pack-1-"))
            if kind == "truncated":
                os.truncate(pack, os.path.getsize(pack) - 1)
            else:
                os.unlink(pack)
            expect(phases("gather", path, 0, *words).status, "nothing was missed")
            if kind == "between":
                # As a resume leaves it that ends early, with sums from before.
                os.unlink(os.path.join(done, "mesh-1"))
                expect(forgotten(path, *words) == 1 and not os.path.exists(os.path.join(done, "sum-0")), "the sums stay without a pack")
            elif kind == "interrupted":
                got = run([PHASES, "recover", path, *words], env=dict(ENV, PHASES_REMOVES="1"))
                expect(got.status and "mesh-1" in got.err, "%d %s" % (got.status, got.err))
                expect(not os.path.exists(os.path.join(done, "sum-0")), "the sums stay")
                expect(forgotten(path, *words) == 1 and not os.path.exists(os.path.join(done, "mesh-1")), "the pack is not made again")
            else:
                expect(forgotten(path, *words) == 2, "the sums and a pack are not made again: %s" % kind)
            phases("mesh", path, 1).ok()
            if kind == "late":
                with open(os.path.join(done, "sum-0"), "wb") as f:
                    f.write(sums)
                got = phases("gather", path, 0, *words)
                expect(got.status and "pack-1-" in got.err, "%d %s" % (got.status, got.err))
                expect(forgotten(path, *words) == 1 and os.path.exists(os.path.join(done, "mesh-1")), "late sums stay")
            phases("gather", path, 0, *words).ok()
            phases("gather", path, 1, *words).ok()
            expect(forgotten(path, *words) == 0, "sums that are good were removed")
            phases("finish", path, *words).ok()
            fresh = os.path.join(base, "want")
            os.mkdir(fresh)
            work.write("-o", os.path.join(fresh, "x.ply"))
            expect(hashes(out) == hashes(fresh), "%s: another output" % kind)
            for folder in (path, out, fresh):
                shutil.rmtree(folder)


def parts_of(out):
    return sorted(n for n in os.listdir(out) if n.startswith("."))


def lose_held(out, wanted=""):
    for name in parts_of(out):
        full = os.path.join(out, name)
        if os.path.isdir(full):
            inner = sorted(os.listdir(full))
            expect(len(inner) > 1, "one tile alone")
            os.unlink(os.path.join(full, inner[-1]))
        elif wanted in name:
            os.unlink(full)


def forgotten_once():
    """That an output is gone is mended once, also if resume is called again before finish runs."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=2)
        for words in ([], ["--tile", "15"]):
            out = os.path.join(base, "out%d" % len(words))
            os.mkdir(out)
            words = ["-o", out if words else os.path.join(out, "x.ply"), *words]
            path = work.fresh()
            for i in range(2):
                phases("gather", path, i, *words).ok()
            lose_held(out)
            expect(phases("finish", path, *words).status, "nothing was missed")
            expect(forgotten(path, *words) == 2, "the parts are not made again")
            phases("gather", path, 0, *words).ok()
            expect(forgotten(path, *words) == 0, "what was made again is made once more")
            phases("gather", path, 1, *words).ok()
            expect(forgotten(path, *words) == 0, "what was made again is made once more")
            phases("finish", path, *words).ok()


def some_named():
    """Finish was interrupted, or missed an output, when others had their names; with --no-clobber these are in nobody's way."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=2)
        for k, more in enumerate(([], ["--no-clobber"], ["--no-clobber", "--canonical"], ["--no-clobber", "--tile", "15"])):
            out, fresh = os.path.join(base, "out%d" % k), os.path.join(base, "want%d" % k)
            os.mkdir(out)
            os.mkdir(fresh)
            tiled = "--tile" in more
            words = ["-o", out, *more] if tiled else ["-o", os.path.join(out, "x.ply"), *more, "-o", os.path.join(out, "y.ply")]
            path = work.fresh()
            for i in range(2):
                phases("gather", path, i, *words).ok()
            if tiled:
                # as a finish leaves it that was killed when it had moved one tile
                part = os.path.join(out, parts_of(out)[0])
                os.rename(os.path.join(part, sorted(os.listdir(part))[0]), os.path.join(out, sorted(os.listdir(part))[0]))
            lose_held(out, "y.ply")
            if not tiled:
                p = subprocess.Popen([PHASES, "finish", path, *words], env=dict(ENV, ACUT_CLUSTER_PATIENCE="60"), stderr=subprocess.PIPE)
                while not os.path.exists(os.path.join(out, "x.ply")) and p.poll() is None:
                    time.sleep(0.01)
                p.terminate()
                err = p.communicate()[1].decode()
                expect(p.returncode and "interrupted" in err, "%d %s" % (p.returncode, err))
                expect(not os.path.exists(os.path.join(path, "failed", "finish-0")), "an interruption was recorded as a failure")
            got = phases("finish", path, *words)
            expect(got.status and "not there any more" in got.err, "%d %s" % (got.status, got.err))
            expect(forgotten(path, *words) > 0, "nothing is made again")
            for i in range(2):
                phases("gather", path, i, *words).ok()
            phases("finish", path, *words).ok()
            work.write(*[w.replace(out, fresh) for w in words])
            expect(hashes(out) == hashes(fresh), "%s: other outputs" % more)
            expect(not parts_of(out), str(parts_of(out)))
            got = phases("gather", work.fresh(), 0, *words)
            expect((got.status != 0) == ("--no-clobber" in more), "%d %s" % (got.status, got.err))


def dataset_is_gone():
    """A manifest that is gone, and was missed by a task, is made again: its task has no record then."""
    with e2e.Folder() as base:
        work = Work(base, inputs(base), gathers=3)
        path, words = work.fresh(), ["-o", os.path.join(base, "x.ply")]
        phases("gather", path, 0, *words).ok()
        os.unlink(os.path.join(path, "dataset", "manifest"))
        expect(phases("gather", path, 1, *words).status, "no manifest was missed")
        expect(forgotten(path, *words) == 1 and not os.path.exists(os.path.join(path, "done", "commit-0")), os.listdir(os.path.join(path, "done")))


def clobber():
    with e2e.Folder() as base:
        work = Work(base, inputs(base, 1), gathers=1)
        out = os.path.join(base, "x.ply")
        with open(out, "w") as f:
            f.write("mine")
        path = work.fresh()
        got = phases("gather", path, 0, "-o", out, "--no-clobber")
        expect(got.status == 2 and "--no-clobber" in got.err, got.err)
        os.unlink(out)
        phases("gather", path, 0, "-o", out, "--no-clobber").ok()
        with open(out, "w") as f:
            f.write("mine")
        got = phases("finish", path, "-o", out, "--no-clobber")
        expect(got.status == 2 and open(out).read() == "mine", got.err)
        phases("finish", path, "-o", out).ok()
        expect(open(out, "rb").read(3) == b"ply", "it was not replaced")


def without_triangles():
    with e2e.Folder() as base, e2e.Daemon(base, memory=MEMORY) as d:
        line = os.path.join(base, "line.las")
        run([e2e.SYNTH, "--points", "1000", "--distribution", "collinear", line]).ok()
        work = Work(base, [line], gathers=2, stages=1)
        for words in (["-o", os.path.join(base, "l.ply"), "--canonical"], ["-o", os.path.join(base, "t"), "--tile", "10"]):
            path = work.write(*words)
            got = json.loads(report(path))
            want = d.ctl("mesh", line, "-o", os.path.join(base, "w.ply"), "--canonical", "--json").ok().json()
            for key in ("digest", "vertex_digest", "triangles", "vertices"):
                expect(got[key] == want[key], "%s: %s, not %s" % (key, got[key], want[key]))
        for n in (1, 2, 3):
            few = os.path.join(base, "few%d.las" % n)
            run([e2e.SYNTH, "--points", str(n), few]).ok()
            os.mkdir(os.path.join(base, str(n)))
            got = json.loads(report(Work(os.path.join(base, str(n)), [few], gathers=2, stages=1).write("-o", os.path.join(base, "few%d.ply" % n))))
            expect(got["vertices"] == n and got["triangles"] == n // 3, str(got))
        expect(open(os.path.join(base, "l.ply"), "rb").read() == open(os.path.join(base, "w.ply"), "rb").read(), "vertices differ")


def adopted():
    """A dataset and domains of a run in a daemon that made nothing of it."""
    with e2e.Folder() as base, e2e.Daemon(base, memory=MEMORY) as d:
        work = Work(base, inputs(base), gathers=1)
        d.ctl("dataset", "import", os.path.join(work.first, "dataset"), "valley").ok()
        got = d.ctl("cache", "adopt", work.first, "--json").ok().json()
        expect(got["domains"] > 0 and got["there"] == 0 and got["packs"] == 4 and got["unfinished"] == 0, str(got))
        stat = d.ctl("cache", "stat", "--json").ok().json()["kinds"]["domains"]
        expect(stat["entries"] == got["domains"] and stat["bytes"] == got["bytes"], "%s %s" % (stat, got))
        job = d.ctl("submit", "valley", "--wait").ok().out.split()[0]
        shown = d.ctl("show", job, "--json").ok().json()
        expect(shown["domains"] == shown["domains_reused"] == got["domains"], str(shown))
        again = d.ctl("cache", "adopt", work.first, "--json").ok().json()
        expect(again["domains"] == 0 and again["there"] == got["domains"], str(again))
        packs = [os.path.join(work.first, "mesh", n) for n in os.listdir(os.path.join(work.first, "mesh")) if n.startswith("pack-")]
        if not e2e.sanitized():  # a library with a sanitizer cannot be loaded by Python
            import acut
            d.ctl("cache", "gc", "--all").ok()
            with acut.connect(d.socket) as c:
                told = c.cache_adopt(packs)
            expect((told.packs, told.domains, told.bytes) == (4, got["domains"], got["bytes"]), str(told))
        verified = d.ctl("cache", "verify", "--json").ok().json()
        expect(verified["derived_damaged"] == 0, str(verified))
        out = os.path.join(base, "x.ply")
        path = work.write("-o", out)
        expect(json.loads(report(path))["digest"] == shown["digest"], "another mesh")
        # a damaged pack is refused by name, and those before it stay
        d.ctl("cache", "gc", "--all").ok()
        pack = sorted(n for n in os.listdir(os.path.join(path, "mesh")) if n.startswith("pack-2"))[0]
        with open(os.path.join(path, "mesh", pack), "r+b") as f:
            f.seek(3000)
            f.write(b"\xff" * 64)
        r = d.ctl("cache", "adopt", path)
        expect(r.status and pack in r.err, r.err)
        entries = d.ctl("cache", "stat", "--json").ok().json()["kinds"]["domains"]["entries"]
        expect(0 < entries < got["domains"], "%d" % entries)
        r = d.ctl("cache", "adopt", base)
        expect(r.status and "work folder" in r.err, r.err)


def adopted_and_changed():
    """What a domain depends on stands in its pack, also of segments that its task never opened: a change there makes it anew."""
    with e2e.Folder() as base, e2e.Daemon(base, memory=MEMORY) as d:
        wide, small = os.path.join(base, "a.las"), os.path.join(base, "b.las")
        os.mkdir(os.path.join(base, "new"))
        other = os.path.join(base, "new", "b.las")
        for path, points, seed, at in (wide, 400000, 1, 0), (small, 300, 2, 20), (other, 300, 3, 150):
            run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), "--origin", "%d,%d,0" % (500000 + at, 5400000 + at), path]).ok()
        work = Work(base, [wide, small], meshes=2, gathers=1)
        d.ctl("dataset", "import", os.path.join(work.first, "dataset"), "valley").ok()
        d.ctl("cache", "adopt", work.first).ok()
        d.ctl("submit", "valley", "--wait").ok()
        d.ctl("push", "valley", "--replaces", small, other).ok()
        got = d.ctl("submit", "valley", "--wait", "--json").ok().json()
        d.ctl("cache", "gc", "--all").ok()  # what is made now is made from points
        d.ctl("push", "fresh", wide, other).ok()
        want = d.ctl("submit", "fresh", "--wait", "--json").ok().json()
        expect(got["digest"] == want["digest"] and got["vertex_digest"] == want["vertex_digest"], "%s, and not %s" % (got, want))
        expect(0 < got["domains_reused"] < got["domains"], str(got))


def adopted_by_another():
    """Whoever could add domains could change what others get."""
    if os.getuid():
        return
    with e2e.Folder() as base, e2e.Daemon(base, memory=MEMORY) as d:
        work = Work(base, inputs(base, 1), gathers=1)
        os.chmod(base, 0o755)
        os.chmod(d.socket, 0o666)
        # Reading the folder is not what is refused.
        subprocess.run(["chmod", "-R", "a+rX", work.first], check=True)
        p = subprocess.run([e2e.ACUTCTL, "cache", "adopt", work.first], env=dict(os.environ, ACUT_SOCKET=d.socket), user=65534, group=65534,
                           extra_groups=[], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        expect(p.returncode == 77 and "administrators" in p.stderr, "%d %s" % (p.returncode, p.stderr))
        expect(d.ctl("cache", "stat", "--json").ok().json()["kinds"]["domains"]["entries"] == 0, "some were taken")


def adopted_in_little_space():
    with e2e.Folder() as base, e2e.Daemon(base, memory=MEMORY, args=["--disk", "1M"]) as d:
        work = Work(base, inputs(base, 1), gathers=1)
        r = d.ctl("cache", "adopt", work.first)
        expect(r.status == 74 and "finished domain needs" in r.err, "%d %s" % (r.status, r.err))
        expect(d.ctl("cache", "stat", "--json").ok().json()["kinds"]["domains"]["bytes"] <= 1 << 20, "more than the quota")


GROUPS = {"formats": [every_format, by_all_tasks], "tiles": [tiles],
          "tasks": [damage, too_large, manifest_counts, killed, twice, finished_again, recovered, packs_named_again, forgotten_once, some_named, dataset_is_gone, clobber, too_many_tiles, without_triangles, adopted, adopted_and_changed,
                    adopted_by_another, adopted_in_little_space]}
e2e.main(*(case for name in sys.argv[1:] or GROUPS for case in GROUPS[name]))
