"""--metric: CGAL's triangulation of the mapped positions, triangle by triangle, whole, in windows and with lines; the same digest
with any memory, threads, order of files, after kill -9 and from acut-domain; other options of the view beside it; what is
refused."""
import json
import os
import random
import signal
import subprocess

import breakline_model
import e2e
from breaklines import compare, lakes_file, lines_file, points_file, random_lines
from e2e import expect
from windows import ALL, boxes, box_of, corners, decimal, geojson, polygons, synth

ORACLE = os.environ.get("CGAL_DIGEST")


def refused(run, status, *texts):
    expect(run.status == status, "%d, not %d: %s" % (run.status, status, run.err))
    for text in texts:
        expect(text in run.err, "no %r in %s" % (text, run.err))


def against_cgal(distribution, points, metric, *options):
    def run():
        if not ORACLE:
            return
        rng = random.Random(distribution)
        option = "--metric=" + metric
        with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
            path = synth(base, distribution, points, *options)
            box, scale = box_of(path)
            d.ctl("push", "d", path).ok()
            whole = d.ctl("submit", "d", "--wait", "--json", option, *ALL).ok().json()
            windows = [(corners(b), ["--bbox=" + ",".join(decimal(v, scale) for v in b)]) for b in boxes(rng, box)]
            for i, p in enumerate(polygons(rng, box)):
                windows.append((p, ["--polygon", geojson(os.path.join(base, "%d.json" % i), [p], scale)]))
            lines = subprocess.run([ORACLE, path, "metric=" + metric] + [",".join("%d,%d" % c for c in p) for p, _ in windows],
                                   stdout=subprocess.PIPE, check=True).stdout.decode().splitlines()
            expect(lines[0].split() == [str(whole["triangles"]), whole["digest"]], "the whole: %s, not %s" % (whole["digest"], lines[0]))
            pieces = some = 0
            for (p, options_of), line in zip(windows, lines[1:]):
                got = d.ctl("submit", "d", "--wait", "--json", option, *ALL, *options_of).ok().json()
                expect(line.split() == [str(got["triangles"]), got["digest"]],
                       "%s: %d triangles %s, CGAL has %s" % (options_of, got["triangles"], got["digest"], line))
                again = d.ctl("fetch", whole["job"], "--json", "--format", "null", *options_of).ok().json()
                expect(again["digest"] == got["digest"] and again["vertex_digest"] == got["vertex_digest"], "fetched: %s" % again)
                pieces = max(pieces, got["pieces"])
                some += 0 < got["triangles"] < whole["triangles"]
            print("     %d windows, %d of a part, %d pieces at most, %d triangles in %d regions" % (
                len(windows), some, pieces, whole["triangles"], whole["domains"]))
            expect(some > 4 and (points < 80000 or whole["domains"] > 3), "%d windows, %d regions" % (some, whole["domains"]))
            out = os.path.join(base, "m.ply")
            d.ctl("fetch", whole["job"], "-o", out).ok()
            e2e.run([e2e.VERIFY, option, "--keep-withheld", "--keep-noise", out, path]).ok()
            refused(e2e.run([e2e.VERIFY, "--keep-withheld", "--keep-noise", out, path]), 1)
            peak = d.vmhwm()
            expect(e2e.sanitized() or peak <= (24 + 32) << 20, "VmHWM %d with memory=24M" % peak)
    run.__name__ = "cgal_" + distribution.replace("-", "_")
    return run


def same_everywhere():
    """Memory, threads, order of files, files in one push or several, kill -9 in between, and domains made one by one."""
    metric = "--metric=-2,1,9"
    with e2e.Folder() as base:
        files = []
        for i in range(3):
            files.append(os.path.join(base, "%d.las" % i))
            e2e.run([e2e.SYNTH, "--points", 90000, "--seed", i, "--area", "300x300", files[i]]).ok()
        digests = set()
        for n, (memory, threads, order) in enumerate((("24M", 1, 1), ("24M", 3, -1), ("256M", 2, 1))):
            with e2e.Daemon(base, memory=memory, threads=threads, name="-%d" % n) as d:
                for f in files[::order] if n else [files]:
                    d.ctl("push", "d", *(f if isinstance(f, list) else [f])).ok()
                got = d.ctl("submit", "d", "--wait", "--json", metric).ok().json()
                digests.add((got["digest"], got["vertex_digest"], got["triangles"], got["hull"], json.dumps(got["removed"])))
                again = d.ctl("submit", "d", "--wait", "--json", "--metric=4,-2,9").ok().json()
                expect(again["job"] == got["job"], "equal metrics are two views")
                plain = d.ctl("submit", "d", "--wait", "--json").ok().json()
                one = d.ctl("submit", "d", "--wait", "--json", "--metric", "3,4,1").ok().json()
                expect(one["job"] == plain["job"] and plain["digest"] != got["digest"], "K = 1 is the plain mesh")
                whole = os.path.join(base, "m%d.ply" % n)
                d.ctl("fetch", got["job"], "-o", whole).ok()
                e2e.run([e2e.VERIFY, metric, whole, *files]).ok()
                expect(e2e.run([e2e.VERIFY, "--view", "view 1 metric=2,-1,9", whole, *files]).status == 0, "by the view's text")
                if n == 0:
                    by_hand(base, d, got)
        expect(len(digests) == 1, str(digests))
        killed(base, files, metric, digests.pop())


def by_hand(base, d, want):
    """acut-domain makes the same domains: with a selection of its own, and with one that --select has left."""
    folder = [os.path.join(d.state, "datasets", n) for n in os.listdir(os.path.join(d.state, "datasets"))][0]
    manifest = max(os.path.join(folder, n) for n in os.listdir(folder) if n.startswith("manifest"))
    view, out, chosen = "view 1 metric=2,-1,9", os.path.join(base, "out"), os.path.join(base, "chosen")
    os.mkdir(out)
    selected, rest = e2e.run([e2e.DOMAIN, "--select", manifest, view, chosen]).ok().out.rstrip("\n").split("\t")
    regions = [l.split()[0] for l in e2e.run([e2e.DOMAIN, "--memory", "24M", "--plan", selected, rest]).ok().out.splitlines()]
    own = [l.split()[0] for l in e2e.run([e2e.DOMAIN, "--memory", "24M", "--plan", manifest, view]).ok().out.splitlines()]
    expect(regions == own and len(regions) > 1, "%d regions, %d" % (len(regions), len(own)))
    high = low = triangles = 0
    for i, region in enumerate(regions):
        of = (manifest, view) if i == 0 else (selected, rest)
        words = e2e.run([e2e.DOMAIN, "--memory", "24M", *of, region, out]).ok().out.split()
        triangles += int(words[words.index("triangles") + 1])
        digest = words[words.index("digest") + 1]
        high, low = (high + int(digest[:16], 16)) % 2**64, (low + int(digest[16:], 16)) % 2**64
    expect((triangles, "%016x%016x" % (high, low)) == (want["triangles"], want["digest"]), "the domains do not add up")


def killed(base, files, metric, want):
    """Killed while the selection is made, and while domains are."""
    gate = e2e.Gate(base)
    d = e2e.Daemon(base, memory="24M", env=gate.env, name="-killed").start()
    d.ctl("push", "d", *files).ok()
    gate.close("renameat", "tmp-", 1)
    job = d.ctl("submit", "d", metric).ok().out.split()[0]
    gate.wait()
    d.stop(signal.SIGKILL)
    gate.open()
    gate.close("renameat", "/domains/", 3)
    d.start()
    gate.wait()
    d.stop(signal.SIGKILL)
    gate.open()
    d.start()
    got = d.ctl("wait", job, "--json").ok().json()
    d.stop(signal.SIGKILL)
    expect((got["digest"], got["vertex_digest"], got["triangles"]) == want[:3], "after two kills: %s" % got["digest"])


def reused():
    """A push in a corner makes few domains new; the mesh is that from nothing, and what the store has lost is made again."""
    with e2e.Folder() as base:
        files = [os.path.join(base, n) for n in ("a.las", "b.las")]
        e2e.run([e2e.SYNTH, "--points", 300000, "--area", "500x500", files[0]]).ok()
        e2e.run([e2e.SYNTH, "--points", 500, "--area", "20x20", "--seed", 4, files[1]]).ok()
        with e2e.Daemon(base, memory="64M") as d, e2e.Daemon(base, memory="256M", name="-other") as other:
            d.ctl("push", "d", files[0]).ok()
            first = d.ctl("submit", "d", "--wait", "--json", "--metric=1,3,6").ok().json()
            d.ctl("push", "d", files[1]).ok()
            second = d.ctl("submit", "d", "--wait", "--json", "--metric=1,3,6").ok().json()
            other.ctl("push", "d", *files).ok()
            want = other.ctl("submit", "d", "--wait", "--json", "--metric=1,3,6").ok().json()
            expect(second["digest"] == want["digest"] and second["vertex_digest"] == want["vertex_digest"], "not the mesh from nothing")
            expect(second["domains"] > 4 and second["domains_reused"] > 4,
                   "%s of %d domains are reused" % (second["domains_reused"], second["domains"]))
            expect(first["digest"] != second["digest"], "nothing has changed")


def other_options():
    """Beside the other options of a view, and in outputs that need a box of the mesh. acut-verify has its own view of the points."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        path = synth(base, "survey", 60000)
        d.ctl("push", "d", path).ok()
        (x0, y0, x1, y1), scale = box_of(path)
        crop = ",".join(decimal(v, scale) for v in (x0 + (x1 - x0) // 3, y0 + 7, x1 - (x1 - x0) // 4, y1 - 999))
        for options in (["--every", "3"], ["--thin", "2"], ["--thin", "3", "--thin-pick", "median"], ["--zmax", "215"], ["--ground"],
                        ["--surface"], ["--crop", crop], ["--crop", crop, "--every", "2", "--duplicates", "highest"]):
            out = os.path.join(base, "m.ply")
            got = d.ctl("submit", "d", "--wait", "--json", "--metric", "5,2,3", *options).ok().json()
            plain = d.ctl("submit", "d", "--wait", "--json", *options).ok().json()
            expect(got["vertex_digest"] == plain["vertex_digest"] and got["digest"] != plain["digest"], "%s: other points" % options)
            expect(got["removed"] == plain["removed"] and got["box"] == plain["box"] if "box" in got else True, "%s: %s" % (options, got))
            d.ctl("fetch", got["job"], "-o", out).ok()
            e2e.run([e2e.VERIFY, "--view", d.ctl("show", got["job"], "--json").ok().json()["view"], out, path]).ok()
        job = d.ctl("submit", "d", "--wait", "--metric", "5,2,3").ok().out.split()[0]
        tiles = os.path.join(base, "tiles")
        got = d.ctl("fetch", job, "-o", tiles, "--format", "ply", "--tile", "40", "--json").ok().json()
        expect(got["tiles"]["files"] > 4, str(got["tiles"]))
        d.ctl("fetch", job, "-o", os.path.join(base, "m.tif"), "--cell", "5", "--bbox", crop).ok()
        d.ctl("fetch", job, "-o", os.path.join(base, "m.html")).ok()
        d.ctl("fetch", job, "-o", os.path.join(base, "m.png"), "--color", "domain").ok()
        expect(d.ctl("cache", "verify").status == 0, "the cache is damaged")


def lines():
    """Breaklines, lakes, boundaries and holes are mapped, too: CGAL's constrained triangulation of mapped positions."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        for seed in range(50):
            rng = random.Random(seed)
            metric = (rng.randrange(0, 5), rng.randrange(1, 5), rng.randrange(2, 9))
            size = rng.choice([4, 7, 12, 30, 200])
            points = {(rng.randrange(size), rng.randrange(size)) for _ in range(rng.randrange(4, 120))} | {(0, 0), (size, 0), (0, size)}
            parts = random_lines(rng, size, rng.randrange(1, 14))
            if not parts:
                continue
            path, csv, out = points_file(base, points), lines_file(base, "lines.csv", parts), os.path.join(base, "m.ply")
            option = "--metric=%d,%d,%d" % metric
            got = d.ctl("mesh", path, "--breaklines", csv, "-o", out, option, "--json", *ALL).ok().json()
            compare_mapped(got, breakline_model.Model(points, parts), metric, "seed %d" % seed)
            e2e.run([e2e.VERIFY, option, *ALL, "--breaklines", csv, out, path]).ok()


def compare_mapped(got, model, metric, what):
    class Mapped:
        on_line, in_area = model.on_line, model.in_area
        cgal = staticmethod(lambda: model.cgal(metric))
    compare(got, Mapped, what)


def areas():
    rng = random.Random(3)
    size = 900
    points = {(rng.randrange(size), rng.randrange(size)) for _ in range(130000)}
    lake = [[(100, 120), (300, 140), (280, 330), (130, 300)], [(180, 200), (230, 205), (210, 250)]]
    boundary = [(20, 15), (880, 40), (860, 870), (400, 700), (30, 850)]
    hole = [(500, 500), (640, 520), (560, 640)]
    roads = [(False, [(40, 400 + i * 7), (300, 420 + i * 9), (700, 300 + i * 5)]) for i in range(3)]
    metric = (3, -1, 7)
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        d.ctl("push", "d", points_file(base, points)).ok()
        for kind, path in (("hard", lines_file(base, "roads.csv", roads)), ("lake", lakes_file(base, "lake.json", [lake])),
                           ("boundary", lakes_file(base, "boundary.json", [[boundary]])), ("hole", lakes_file(base, "hole.json", [[hole]]))):
            d.ctl("push", "d", path, "--lines-as", kind).ok()
        got = d.ctl("submit", "d", "--wait", "--json", "--metric=%d,%d,%d" % metric, *ALL).ok().json()
        model = breakline_model.Model(points, roads, [lake], [boundary], [hole])
        compare_mapped(got, model, metric, "areas")
        expect(got["domains"] > 2, "%d domains" % got["domains"])
        # A window, and the same from a selection that was evicted.
        window = ["--bbox", "120,150,420,430"]
        one = d.ctl("fetch", got["job"], "--json", "--format", "null", *window).ok().json()
        d.ctl("cache", "gc", "--all").ok()
        two = d.ctl("fetch", got["job"], "--json", "--format", "null", *window).ok().json()
        whole = d.ctl("fetch", got["job"], "--json", "--format", "null").ok().json()
        expect(one["digest"] == two["digest"] and one["triangles"] and whole["digest"] == got["digest"], "%s %s" % (one, two))
        damaged_pieces(d, got)
        plain = d.ctl("submit", "d", "--wait", "--json", "--metric=%d,%d,%d" % metric, "--no-breaklines", *ALL).ok().json()
        expect(plain["digest"] != got["digest"] and plain["vertices"] == len(points), str(plain))
        cropped = d.ctl("submit", "d", "--wait", "--json", "--metric=3,-1,7", "--crop", "50,50,600,600", *ALL).ok().json()
        same = d.ctl("submit", "d", "--wait", "--json", "--crop", "50,50,600,600", *ALL).ok().json()
        expect("cropped" in str(same["notes"]) or any("line" in n for n in same["notes"]), str(same["notes"]))
        expect(cropped["notes"] == same["notes"] and cropped["removed"] == same["removed"] and cropped["digest"] != same["digest"], "%s\n%s" % (cropped, same))


def damaged_pieces(d, got):
    """The mapped pieces are in the folder of the selection: cache verify reads them, and what is damaged is made again."""
    selected = os.path.join(d.cache, "selected")
    expect(d.ctl("cache", "verify").status == 0, "before anything is damaged")
    sets = [os.path.join(f, n) for f, _, names in os.walk(selected) for n in names if n == "lineset-2"]
    expect(sets, "no mapped pieces below %s" % selected)
    for n in sets:
        with open(n, "r+b") as f:
            f.seek(4096 + 100)
            byte = f.read(1)
            f.seek(4096 + 100)
            f.write(bytes([byte[0] ^ 1]))
    found = d.ctl("cache", "verify")
    expect("lineset-2" in found.out and "1 of what is made again" in found.out, "%d: %s%s" % (found.status, found.out, found.err))
    expect(not any(os.path.exists(n) for n in sets), "a damaged selection stays")
    again = d.ctl("fetch", got["job"], "--json", "--format", "null").ok().json()
    expect(again["digest"] == got["digest"], "made again: %s" % again["digest"])


def refusals():
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        path = synth(base, "survey", 5000)
        d.ctl("push", "d", path).ok()
        for text, word in (("1,2", "not P,Q,K"), ("1,2,3,4", "not P,Q,K"), ("a,1,2", "not P,Q,K"), ("1.5,1,2", "not P,Q,K"),
                           ("0,0,3", "no direction"), ("1,0,0", "at least 1"), ("1,0,-2", "at least 1"), ("1,10007,2", "Q is more than 10000"),
                           ("1,0,10001", "K is more than 10000")):
            refused(d.ctl("submit", "d", "--metric=" + text), 2, word)
        refused(d.ctl("submit", "d", "--wait", "--metric=9973,7919,9000"), 1, "the mapped points reach over", "--metric ")
        hint = d.ctl("plan", "d", "--metric=9973,7919,9000")
        refused(hint, 1, "fits")
        fits = hint.err.split("--metric ")[-1].split()[0]
        expect(d.ctl("submit", "d", "--wait", "--metric=" + fits).status == 0, "what fits does not: %s" % fits)
        refused(e2e.run([e2e.VERIFY, "--metric", "1,2", path]), 2, "not P,Q,K")
        expect(d.ctl("plan", "d", "--metric=1,1,4", "--json").ok().json()["points"] > 4000, "a plan")


if __name__ == "__main__":
    e2e.main(against_cgal("swath", 80000, "1,4,6"), against_cgal("grid", 10000, "2,1,3"), against_cgal("corridor-diagonal", 40000, "1,1,10"),
             against_cgal("ring", 10000, "-3,5,2", "--range", 100000), same_everywhere, reused, other_options, lines, areas, refusals)
