"""Contours: each level's length against the triangles of the PLY of the same mesh, by fractions; the three formats have the same lines;
lines end at the border of the mesh or of the window only, of polygons too; the same bytes whatever the memory, the threads, the pushes and the other
outputs; the memory of acutctl; what is refused. With --simplify, what is left out is near and nothing crosses."""
import json
import math
import os
import re
import resource
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import time
from collections import Counter, defaultdict
from fractions import Fraction

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import e2e
from e2e import expect

MEMORY = 32 << 20
PEAK = "import resource, subprocess, sys; subprocess.check_call(sys.argv[1:]); print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"


def read_ply(path, scale=100):
    """Vertices as lattice numbers, and triangles."""
    data = read(path)
    end = data.index(b"end_header\n") + 11
    n, m = (int(w.split()[2]) for w in data[:end].decode().split("\n") if w.startswith("element"))
    vertices = [tuple(round(c * scale) for c in v) for v in struct.iter_unpack("<3d", data[end:end + 24 * n])]
    return vertices, [f[1:] for f in struct.iter_unpack("<B3I", data[end + 24 * n:end + 24 * n + 13 * m])]


def survey(base, points=6000, name="s.las", *options):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", points, "--density", 1, "--seed", 7, *options, path]).ok()
    return path


class Line:
    def __init__(self, height, index, closed, length, points):
        self.height, self.index, self.closed, self.length, self.points = height, index, closed, length, points

    def key(self):
        return self.height, self.index, self.closed, [p[:2] for p in self.points]


def read_gpkg(path):
    with sqlite3.connect(path) as base:
        expect(base.execute("PRAGMA integrity_check").fetchall() == [("ok",)], "SQLite finds faults")
        expect(not base.execute("PRAGMA foreign_key_check").fetchall(), "foreign keys are wrong")
        expect(base.execute("SELECT rtreecheck('rtree_contours_geom')").fetchall() == [("ok",)], "the index has faults")
        boxes = base.execute("SELECT id, minx, maxx, miny, maxy FROM rtree_contours_geom ORDER BY id").fetchall()
        expect(base.execute("PRAGMA application_id").fetchone() == (1196444487,), "not the number of GeoPackage")
        rows = base.execute('SELECT elevation, "index", closed, length, geom FROM contours ORDER BY fid').fetchall()
        box = base.execute("SELECT min_x, min_y, max_x, max_y FROM gpkg_contents WHERE table_name = 'contours'").fetchone()
    lines = []
    expect(len(boxes) == len(rows), "%d boxes of %d lines" % (len(boxes), len(rows)))
    for (height, index, closed, length, geom), box_of in zip(rows, boxes):
        magic, version, flags, _, x1, x2, y1, y2, order, kind, n = struct.unpack_from("<2sBBi4dBII", geom)
        expect((magic, version, flags, order, kind) == (b"GP", 0, 3, 1, 1002), "a geometry begins with %s" % geom[:49])
        expect(len(geom) == 49 + 24 * n, "%d points in %d bytes" % (n, len(geom)))
        points = list(struct.iter_unpack("<3d", geom[49:]))
        expect(all(p[2] == height for p in points), "a height is not that of the line")
        expect([x1, x2, y1, y2] == [f(p[k] for p in points) for k in (0, 1) for f in (min, max)], "the box of a line")
        expect(box_of[1] <= x1 and x2 <= box_of[2] and box_of[3] <= y1 and y2 <= box_of[4] and box_of[4] - y2 < 2, "a box of the index")
        lines.append(Line(height, index, closed, length, points))
    if lines:
        all_points = [p for line in lines for p in line.points]
        expect(list(box) == [f(p[k] for p in all_points) for f in (min, max) for k in (0, 1)], "the box of the layer is %s" % (box,))
    return lines


def read_geojson(path):
    with open(path) as f:
        features = json.load(f)["features"]
    return [Line(*(f["properties"][k] for k in ("elevation", "index", "closed", "length")), f["geometry"]["coordinates"]) for f in features]


def read_dxf(path):
    """Lines without a length."""
    with open(path) as f:
        text = f.read().split("\n")
    pairs = list(zip(text[::2], text[1::2]))
    layers, lines, now = set(), [], None
    for i, (code, value) in enumerate(pairs):
        if (code, value) == ("0", "LAYER"):
            layers.add(pairs[i + 1][1])
        elif (code, value) == ("0", "POLYLINE"):
            fields = dict(pairs[i + 1:i + 7])
            expect(fields["8"] in layers, "there is no layer " + fields["8"])
            kind, height = fields["8"].split("_", 1)
            now = Line(float(height.replace("_", ".")), int(kind == "INDEX"), int(fields["70"]) & 1, None, [])
            expect(int(fields["70"]) & 8 and float(fields["30"]) == now.height, str(fields))
            lines.append(now)
        elif (code, value) == ("0", "VERTEX"):
            fields = dict(pairs[i + 1:i + 6])
            now.points.append(tuple(float(fields[k]) for k in ("10", "20", "30")))
    for line in lines:
        if line.closed:
            line.points.append(line.points[0])
    return lines


def by_triangles(vertices, triangles, step, base=Fraction(0), scale=100):
    """Length by level, from each triangle, in whole numbers; a vertex at the level is above it."""
    whole = math.lcm(step.denominator, base.denominator)
    step, base = int(step * whole), int(base * whole)
    found = defaultdict(float)
    for t in triangles:
        p = [(x, y, z * whole) for x, y, z in (vertices[i] for i in t)]
        heights = [q[2] for q in p]
        for i in range(-((base - min(heights)) // step), (max(heights) - base) // step + 1):
            level, ends = i * step + base, []
            for a, b in ((p[0], p[1]), (p[1], p[2]), (p[2], p[0])):
                if (a[2] >= level) != (b[2] >= level):
                    part, of = level - a[2], b[2] - a[2]
                    ends.append((a[0] * of + (b[0] - a[0]) * part, a[1] * of + (b[1] - a[1]) * part, of))
            if ends:
                (x0, y0, of0), (x1, y1, of1) = ends
                size = of0 * of1 * scale
                found[i] += math.hypot((x0 * of1 - x1 * of0) / size, (y0 * of1 - y1 * of0) / size)
    return found


def near(a, b):
    return abs(a - b) <= 1e-9 * max(abs(a), abs(b)) + 1e-7


def length_of(points):
    return sum(math.hypot(q[0] - p[0], q[1] - p[1]) for p, q in zip(points, points[1:]))


def border(triangles, vertices, scale=100):
    """Edges of one triangle, by the cell of a metre that they touch, as segments."""
    edges = Counter()
    for t in triangles:
        for k in range(3):
            edges[tuple(sorted((t[k], t[(k + 1) % 3])))] += 1
    cells = defaultdict(list)
    for (a, b), n in edges.items():
        if n == 1:
            p, q = vertices[a], vertices[b]
            low = [min(p[k], q[k]) // scale for k in (0, 1)]
            high = [max(p[k], q[k]) // scale for k in (0, 1)]
            for x in range(low[0] - 1, high[0] + 2):
                for y in range(low[1] - 1, high[1] + 2):
                    cells[x, y].append((p, q))
    return cells


def on_border(cells, point, scale=100):
    x, y = point[0] * scale, point[1] * scale
    for p, q in cells.get((int(x // scale), int(y // scale)), ()):
        dx, dy = q[0] - p[0], q[1] - p[1]
        size = math.hypot(dx, dy)
        if abs((x - p[0]) * dy - (y - p[1]) * dx) < 1e-5 * size and -1e-5 < (x - p[0]) * dx + (y - p[1]) * dy < size * size + 1e-5:
            return True
    return False


def compare(lines, found, step, base, count, scale=100):
    """Lengths by level; each attribute."""
    got = defaultdict(float)
    for line in lines:
        number = round((Fraction(line.height).limit_denominator(10 ** 6) * scale - base) / step)
        expect(abs(line.height - float((number * step + base) / scale)) < 1e-12 * max(1, abs(line.height)), "%s is no level" % line.height)
        expect(line.index == int(count and number % count == 0), "level %d has the index %d" % (number, line.index))
        expect(line.closed == (line.points[0] == line.points[-1]), "closed: %s" % line.closed)
        expect(near(line.length, length_of(line.points)), "a length of %s" % line.length)
        got[number] += line.length
    expect(set(got) == {n for n, v in found.items() if v > 0}, "levels %s" % (set(got) ^ set(found)))
    for number, length in found.items():
        expect(near(got[number], length), "level %d: %.9f, not %.9f" % (number, got[number], length))
    expect(lines == sorted(lines, key=lambda line: line.height), "they do not come by height")


def lengths():
    """Between lattice levels and on them, with long triangles left out at the hull and inside, of a flat grid, in other units."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, grid, flat = survey(base), os.path.join(base, "grid.las"), os.path.join(base, "flat.xyz")
        path = {k: os.path.join(base, "m." + k) for k in ("ply", "gpkg", "geojson", "dxf")}
        e2e.run([e2e.SYNTH, "--points", 900, "--distribution", "grid", "--step", 50, "--seed", 3, grid]).ok()
        with open(flat, "w") as f:
            f.writelines("%d %d %d.00\n" % (x, y, (x // 3 + y // 4) % 3) for x in range(30) for y in range(30))
        for source, mesh, words, step, start, count in (
                (las, (), ("1m",), Fraction(100), Fraction(0), 5),
                (las, ("--max-edge", "2"), ("0.503", "--base", "0.0015"), Fraction(503, 10), Fraction(15, 100), 5),
                (las, ("--trim-hull", "2.5"), ("1", "--base", "-0.25", "--index", "4"), Fraction(100), Fraction(-25), 4),
                (las, (), ("3ft", "--index", "0"), Fraction(3 * 3048, 100), Fraction(0), 0),
                (grid, (), ("0.01",), Fraction(1), Fraction(0), 5),
                (grid, (), ("0.25",), Fraction(25), Fraction(0), 5),
                (flat, ("--assume-units", "m,m"), ("1",), Fraction(100), Fraction(0), 5),
                (flat, ("--assume-units", "m,m"), ("0.5",), Fraction(50), Fraction(0), 5)):
            outs = [w for k in ("gpkg", "geojson", "dxf") for w in ("-o", path[k], "--interval", *words)]
            d.ctl("mesh", source, *mesh, "-o", path["ply"], *outs).ok()
            vertices, triangles = read_ply(path["ply"])
            lines = read_gpkg(path["gpkg"])
            expect(len(lines) > 5, "%d lines" % len(lines))
            compare(lines, by_triangles(vertices, triangles, step, start), step, start, count)
            cells = border(triangles, vertices)
            for line in lines:
                expect(line.closed or (on_border(cells, line.points[0]) and on_border(cells, line.points[-1])),
                       "a line ends inside of the mesh, at %s or %s" % (line.points[0], line.points[-1]))
            for other in (read_geojson(path["geojson"]), read_dxf(path["dxf"])):
                expect(len(other) == len(lines), "%d lines, not %d" % (len(other), len(lines)))
                for a, b in zip(lines, other):
                    expect((a.height, a.index, a.closed, len(a.points)) == (b.height, b.index, b.closed, len(b.points)) or
                           abs(a.height - b.height) < 1e-9 and len(a.points) == len(b.points), "%s is %s" % (a.key(), b.key()))
                    expect(all(abs(p[k] - q[k]) < 1e-8 for p, q in zip(a.points, b.points) for k in (0, 1)), "points differ")


def higher_ground_is_on_the_left():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = os.path.join(base, "hill.xyz")
        out = os.path.join(base, "hill.geojson")
        with open(path, "w") as f:
            f.writelines("%d %d %.2f\n" % (x, y, 100 - math.hypot(x - 20, y - 21)) for x in range(41) for y in range(41))
        d.ctl("mesh", path, "--assume-units", "m,m", "-o", out, "--interval", "1.005").ok()
        lines = [line for line in read_geojson(out) if line.closed]
        expect(len(lines) > 15, "%d lines around the summit" % len(lines))
        for line in lines:
            area = sum(p[0] * q[1] - q[0] * p[1] for p, q in zip(line.points, line.points[1:]))
            expect(area > 0, "a line around a summit runs clockwise")


def turn(a, b, c):
    v = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if abs(v) < 1e-9:
        a, b, c = ([Fraction(w) for w in p[:2]] for p in (a, b, c))
        v = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (v > 0) - (v < 0)


def meetings(lines):
    """Pairs of segments, by their places, that have a point in common and are not neighbours."""
    cells, found = defaultdict(list), set()
    for i, line in enumerate(lines):
        last = len(line.points) - 2
        for k, (p, q) in enumerate(zip(line.points, line.points[1:])):
            for x in range(int(min(p[0], q[0])), int(max(p[0], q[0])) + 1):
                for y in range(int(min(p[1], q[1])), int(max(p[1], q[1])) + 1):
                    for j, m, r, s in cells[x, y]:
                        if i == j and (k - m == 1 or (line.closed and k == last and m == 0)):
                            continue
                        if turn(p, q, r) * turn(p, q, s) <= 0 and turn(r, s, p) * turn(r, s, q) <= 0:
                            found.add((i, k, j, m))
                    cells[x, y].append((i, k, p, q))
    return found


def distance(p, q, r):
    dx, dy = q[0] - p[0], q[1] - p[1]
    part = max(0, min(1, ((r[0] - p[0]) * dx + (r[1] - p[1]) * dy) / (dx * dx + dy * dy)))
    return math.hypot(p[0] + part * dx - r[0], p[1] + part * dy - r[1])


def simplified():
    """Vertices that are left out are near; lines do not cross; what the report, the sidecar and the files say of it."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las = survey(base, 4000)
        path = {k: os.path.join(base, "m." + k) for k in ("gpkg", "geojson", "dxf")}
        whole = os.path.join(base, "whole.gpkg")
        for size, word in ((0.05, "0.05"), (0.5, "0.5m"), (3 * 0.3048, "3ft")):
            outs = [w for p in path.values() for w in ("-o", p, "--interval", "1", "--base", "0.0015", "--simplify", word, "--sidecar")]
            said = d.ctl("mesh", las, "-o", whole, "--interval", "1", "--base", "0.0015", *outs, "--json").ok().json()
            lines, before = read_gpkg(path["gpkg"]), read_gpkg(whole)
            expect(len(lines) == len(before) > 20, "%d lines of %d" % (len(lines), len(before)))
            kept, had = (sum(len(line.points) for line in of) for of in (lines, before))
            expect(said["simplified"] == {"vertices": 3 * had, "left_out": 3 * (had - kept)}, "%s, %d of %d" % (said["simplified"], kept, had))
            expect(0.05 * had < had - kept < 0.95 * had, "%d of %d" % (kept, had))
            most = 0
            for line, old in zip(lines, before):
                expect((line.height, line.index, line.closed) == (old.height, old.index, old.closed), str(line.key()))
                expect(near(line.length, length_of(line.points)) and line.length < old.length + 1e-9, "a length of %s" % line.length)
                expect(line.points[0] == old.points[0] and line.points[-1] == old.points[-1], "an end of a line is another one")
                at = 0
                for p, q in zip(line.points, line.points[1:]):
                    to = old.points.index(q, at + 1)
                    most = max([most] + [distance(p, q, r) for r in old.points[at + 1:to]])
                    at = to
                expect(at == len(old.points) - 1, "the end of a line is not its end")
            expect(0.5 * size < most <= size, "%s: one is off by %s" % (word, most))
            expect(not meetings(lines), "lines cross")
            for other in (read_geojson(path["geojson"]), read_dxf(path["dxf"])):
                expect([len(line.points) for line in other] == [len(line.points) for line in lines], "another format has other vertices")
                expect(all(abs(p[k] - q[k]) < 1e-8 for a, b in zip(lines, other) for p, q in zip(a.points, b.points) for k in (0, 1)), "points differ")
            with open(path["gpkg"] + ".json") as f:
                mine = json.load(f)
            expect(mine["simplified"] == {"vertices": had, "left_out": had - kept}, str(mine["simplified"]))
            expect((mine["options"]["simplify"], mine["options"]["simplify_unit"]) ==
                   {"0.05": (0.05, None), "0.5m": (0.5, "metre"), "3ft": (3, "foot")}[word], str(mine["options"]))
            note = "acut-simplified " + {"0.05": "0.05 metre", "0.5m": "0.5 metre", "3ft": "3 foot"}[word]
            with sqlite3.connect(path["gpkg"]) as f:
                expect(note in f.execute("SELECT description FROM gpkg_contents").fetchone()[0].split("\n"), "the database does not say it")
            expect(("999\n%s\n" % note).encode() in read(path["dxf"]), "the DXF does not say it")
            with open(path["geojson"]) as f:
                expect(json.load(f)["acut-simplified"] == note.split(" ", 1)[1], "the GeoJSON does not say it")
        r = d.ctl("mesh", las, "-o", whole, "--interval", "1", "--simplify", "0.5").ok()
        expect(re.search(r"^[\d,]+ of [\d,]+ vertices of contours were left out by --simplify$", r.out, re.M), r.out)
        for words, args in ((("--simplify is not a length above zero", "0.1m"), ("--simplify", "0")), (("--simplify is not a length",), ("--simplify", "1km")),
                            (("--simplify has no meaning for ply",), ("--simplify", "1", "-o", os.path.join(base, "m.ply"), "--simplify", "1"))):
            r = d.ctl("mesh", las, "-o", whole, "--interval", "1", *args)
            expect(r.status == 2 and all(w in r.err for w in words), "%s: %d\n%s" % (args, r.status, r.err))
        low = os.path.join(base, "u.xyz")
        with open(low, "w") as f:
            f.write("0 0 1\n10 0 1\n0 10 2\n")
        r = d.ctl("mesh", low, "-o", whole, "--interval", "1", "--simplify", "1m")
        expect(r.status == 2 and "the unit of x and y is unknown" in r.err and "--assume-units" in r.err, r.err)


def read(path):
    with open(path, "rb") as f:
        return f.read()


def same_bytes():
    """Memory, threads, pushes, other outputs, standard output."""
    kinds = [(kind, name, more) for kind, end in (("gpkg", "gpkg"), ("geojson", "geojson"), ("dxf-contours", "dxf"))
             for name, more in (("l." + end, ()), ("s." + end, ("--simplify", "0.3")))]
    with e2e.Folder() as base:
        one, two = survey(base, 40000, "1.las"), survey(base, 40000, "2.las", "--origin", "500100,5400050,0", "--seed", "9")
        files = []
        for memory, threads, twice in (("24M", 1, False), ("1G", 4, False), ("64M", 2, True)):
            folder = os.path.join(base, memory)
            os.mkdir(folder)
            with e2e.Daemon(folder, memory=memory, threads=threads) as d:
                for inputs in ((one,), (two,)) if twice else ((one, two),):
                    d.ctl("push", "s", *inputs).ok()
                job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
                outs = [w for _, name, more in kinds for w in ("-o", os.path.join(folder, name), "--interval", "2", *more)]
                d.ctl("fetch", job, *outs, "-o", os.path.join(folder, "m.ply"), "-o", os.path.join(folder, "d.tif"), "--cell", "1").ok()
                files.append([read(os.path.join(folder, name)) for _, name, _ in kinds])
                if twice:
                    for (kind, name, more), want in zip(kinds, files[0]):
                        if more and kind != "gpkg":
                            continue
                        path = os.path.join(folder, "alone-" + name)
                        d.ctl("fetch", job, "-o", path, "--interval", "2", *more).ok()
                        expect(read(path) == want, "%s: other outputs change the bytes" % kind)
                        with open(path, "wb") as f:
                            env = dict(os.environ, ACUT_SOCKET=d.socket)
                            p = subprocess.run([e2e.ACUTCTL, "fetch", str(job), "-o", "-", "--format", kind, "--interval", "2", *more], stdout=subprocess.PIPE, env=env, check=True)
                            f.write(p.stdout)
                        expect(read(path) == want, "%s: standard output has other bytes" % kind)
        for got, how in ((files[1], "memory and threads"), (files[2], "two pushes")):
            for (kind, _, _), a, b in zip(kinds, files[0], got):
                expect(a == b, "%s: %s change the bytes" % (kind, how))
        expect(min(len(f) for f in files[0]) > 500000, "they are small")


def windows():
    """Windows side by side have the lines of the whole, cut at their borders."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, out = survey(base, 40000), os.path.join(base, "l.gpkg")
        d.ctl("push", "s", las).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        d.ctl("fetch", job, "-o", out, "--interval", "1").ok()
        whole = read_gpkg(out)
        want, got = defaultdict(float), defaultdict(float)
        for line in whole:
            want[line.height] += line.length
        total = 0
        for i, (x1, x2) in enumerate(((499990, 500060.5), (500060.5, 500120), (500120, 500300))):
            box = "%s,5399990,%s,5400300" % (x1, x2)
            if i == 1:
                d.ctl("mesh", las, "--bbox", box, "-o", out, "--interval", "1").ok()
            else:
                d.ctl("fetch", job, "--bbox", box, "-o", out, "--interval", "1").ok()
            cut = 0
            for line in read_gpkg(out):
                got[line.height] += line.length
                expect(all(x1 <= p[0] <= x2 for p in line.points), "a point outside of the window")
                cut += sum(p[0] in (x1, x2) for p in (line.points[0], line.points[-1]) if not line.closed)
            expect(cut > 20, "%d ends at the border of the window" % cut)
            total += cut
        for height, length in want.items():
            expect(near(length, got[height]), "%s: %.9f in windows, %.9f" % (height, got[height], length))


def memory():
    """All three at once of a mesh of millions of triangles, with several levels an edge."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="256M") as d:
        points = 3000000 if os.environ.get("ACUT_CONTOURS_LONG") else 150000
        d.ctl("push", "s", survey(base, points)).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        outs = [w for name in ("l.gpkg", "l.geojson", "l.dxf") for w in ("-o", os.path.join(base, name), "--interval", "0.5")]
        simple = peak(d, "fetch", job, *[w for i, w in enumerate(outs) for w in ([w, "--simplify", "0.1"] if i % 4 == 3 else [w])])
        most = peak(d, "fetch", job, *outs)
        with sqlite3.connect(os.path.join(base, "l.gpkg")) as lines:
            n, length = lines.execute("SELECT count(*), sum(length) FROM contours").fetchone()
        print("     %d lines, %.0f km, %.1f MiB of memory" % (n, length / 1000, most / (1 << 20)))
        expect(e2e.sanitized() or most < MEMORY, "%d bytes of memory" % most)
        expect(e2e.sanitized() or simple < MEMORY + (10 << 20), "%d bytes of memory with --simplify" % simple)
        expect(not [n for n in os.listdir(base) if "part" in n], "left behind: %s" % os.listdir(base))


AREA = {"type": "MultiPolygon", "coordinates": [
    [[[500010.3, 5400010], [500140, 5400005.5], [500150.25, 5400120], [500060, 5400150], [500010.3, 5400010]],
     [[500050, 5400050], [500070, 5400100.01], [500100, 5400052], [500050, 5400050]]],
    [[[500160, 5399990], [500190, 5399990], [500190, 5400300], [500160, 5400300], [500160, 5399990]]]]}


def is_inside(x, y, rings):
    return sum((p[1] <= y) != (q[1] <= y) and x < p[0] + (y - p[1]) / (q[1] - p[1]) * (q[0] - p[0])
               for ring in rings for p, q in zip(ring, ring[1:])) % 2 == 1


def length_inside(a, b, rings, rough):
    """Of a segment, in the polygons whose rings these are, by the even-odd rule: exact but for the square root, where an edge is near."""
    length, parts, inside = math.hypot(b[0] - a[0], b[1] - a[1]), {Fraction(0), Fraction(1)}, Fraction(0)
    low, high = ([f(a[k], b[k]) for k in (0, 1)] for f in (min, max))
    edges = [e for ring, points in zip(rings, rough) for e, p, q in zip(zip(ring, ring[1:]), points, points[1:])
             if all(min(p[k], q[k]) <= high[k] + 1e-6 and max(p[k], q[k]) >= low[k] - 1e-6 for k in (0, 1))]
    if not edges:
        return length if is_inside(a[0], a[1], rough) else 0
    (x1, y1), (x2, y2) = ((Fraction(p[0]), Fraction(p[1])) for p in (a, b))
    for (px, py), (qx, qy) in edges:
        turn = (x2 - x1) * (qy - py) - (y2 - y1) * (qx - px)
        if turn:
            parts.add(((px - x1) * (qy - py) - (py - y1) * (qx - px)) / turn)
    parts = sorted(t for t in parts if 0 <= t <= 1)
    for t, u in zip(parts, parts[1:]):
        if is_inside(x1 + (x2 - x1) * (t + u) / 2, y1 + (y2 - y1) * (t + u) / 2, rings):
            inside += u - t
    return float(inside) * length


def polygons():
    """Lines are cut at the border of polygons, with holes and several ones: lengths by level, by fractions; where they end; two areas side by side."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, out, area, rest = survey(base, 8000, "s.las", "--density", "0.25"), os.path.join(base, "l.gpkg"), os.path.join(base, "a.geojson"), os.path.join(base, "r.geojson")
        rings = [[(Fraction(str(x)), Fraction(str(y))) for x, y in ring] for polygon in AREA["coordinates"] for ring in polygon]
        rough = [[(float(x), float(y)) for x, y in ring] for ring in rings]
        around = [[499000, 5399000], [501000, 5399000], [501000, 5401000], [499000, 5401000], [499000, 5399000]]
        others = [[around] + [p[0] for p in AREA["coordinates"]]] + [[hole] for p in AREA["coordinates"] for hole in p[1:]]
        for path, shape in ((area, AREA), (rest, {"type": "MultiPolygon", "coordinates": others})):
            with open(path, "w") as f:
                json.dump(shape, f)
        d.ctl("push", "s", las).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        d.ctl("fetch", job, "-o", out, "--interval", "1").ok()
        whole = read_gpkg(out)
        want, all_of, got, got_rest = (defaultdict(float) for _ in range(4))
        for line in whole:
            all_of[line.height] += line.length
            want[line.height] += sum(length_inside(a, b, rings, rough) for a, b in zip(line.points, line.points[1:]))
        d.ctl("mesh", las, "--polygon", area, "-o", out, "--interval", "1").ok()
        made, cut = read_gpkg(out), 0
        for line in made:
            got[line.height] += line.length
            for x, y, _ in () if line.closed else (line.points[0], line.points[-1]):
                away = min(abs((q[0] - p[0]) * (Fraction(y) - p[1]) - (Fraction(x) - p[0]) * (q[1] - p[1])) / Fraction(math.hypot(q[0] - p[0], q[1] - p[1]))
                           for ring in rings for p, q in zip(ring, ring[1:]))
                cut += away < 2e-8
        expect(cut > 50, "%d ends at the border" % cut)
        d.ctl("fetch", job, "--polygon", area, "-o", out, "--interval", "1").ok()
        expect([line.key() for line in read_gpkg(out)] == [line.key() for line in made], "a window of a job has other lines")
        d.ctl("fetch", job, "--polygon", rest, "-o", out, "--interval", "1").ok()
        for line in read_gpkg(out):
            got_rest[line.height] += line.length
        for height, length in all_of.items():
            expect(abs(want[height] - got[height]) <= 1e-9 * want[height] + 1e-9, "%s: %.12f, not %.12f" % (height, got[height], want[height]))
            expect(near(length, got[height] + got_rest[height]), "%s: %.9f inside and %.9f outside of %.9f" % (height, got[height], got_rest[height], length))
        expect(sum(got.values()) > 1000 and sum(got_rest.values()) > 1000, "areas without lines")


def tiles():
    """Tiles have the lines of the whole, cut at their borders, where both have the same points; of a tile that a window can be, the same lines."""
    kinds = {"gpkg": (read_gpkg, ".gpkg"), "geojson": (read_geojson, ".geojson"), "dxf-contours": (read_dxf, ".dxf")}
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out, folder, area = os.path.join(base, "l.gpkg"), os.path.join(base, "t"), os.path.join(base, "a.geojson")
        with open(area, "w") as f:
            json.dump(AREA, f)
        d.ctl("push", "s", survey(base, 8000, "s.las", "--density", "0.25")).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        for size, kind, window in (("50", "gpkg", ()), ("33.333", "geojson", ()), ("50", "dxf-contours", ()), ("7.5", "gpkg", ()),
                                   ("50", "gpkg", ("--bbox", "500000,5400000,500100,5400150")), ("50", "gpkg", ("--polygon", area))):
            d.ctl("fetch", job, *window, "-o", out, "--interval", "1").ok()
            want, got, total = defaultdict(float), defaultdict(float), Fraction(size)
            for line in read_gpkg(out):
                want[line.height] += line.length
            d.ctl("fetch", job, *window, "-o", folder + "/", "--format", kind, "--interval", "1", "--tile", size).ok()
            with open(os.path.join(folder, "index.geojson")) as f:
                index = [f["properties"] for f in json.load(f)["features"]]
            files = {p["file"] for p in index}
            expect(files | {"index.geojson"} == set(os.listdir(folder)) and len(files) > (1 if window else 9), "%s" % sorted(os.listdir(folder)))
            expect("--bbox" not in window or len(files) == 6, "tiles beside the window: %s" % sorted(files))
            sides, most = defaultdict(set), max(len(files) // 8, 1)
            for i, p in enumerate(index):
                read_file, extension = kinds[kind]
                expect(p["file"] == "tile_%d_%d%s" % (p["column"], p["row"], extension), p["file"])
                lines = read_file(os.path.join(folder, p["file"]))
                expect(lines and len(lines) == p["lines"], "%s: %d lines, %s" % (p["file"], len(lines), p))
                low = [float((p[k]) * total) for k in ("column", "row")]
                high = [float((p[k] + 1) * total) for k in ("column", "row")]
                for line in lines:
                    got[line.height] += line.length if line.length is not None else length_of(line.points)
                    for q in line.points:
                        expect(all(low[k] <= q[k] <= high[k] for k in (0, 1)), "%s: a point at %s" % (p["file"], q))
                    for q in () if line.closed else (line.points[0], line.points[-1]):
                        for k in (0, 1):
                            if q[k] in (low[k], high[k]):
                                sides[k, tuple(q)].add(p["file"])
                if total == 50 and not window and i % most == 0:
                    d.ctl("fetch", job, "--bbox", "%r,%r,%r,%r" % (*low, *high), "-o", out, "--interval", "1").ok()
                    same = read_gpkg(out)
                    expect(len(same) == len(lines), "%s: %d lines, in a window %d" % (p["file"], len(lines), len(same)))
                    expect(all(len(a.points) == len(b.points) and a.height == b.height for a, b in zip(same, lines)), "%s: other lines" % p["file"])
            for height, length in want.items():
                expect(near(length, got[height]), "%s: %s: %.9f in tiles, not %.9f" % (size, height, got[height], length))
            both = sum(len(s) == 2 for s in sides.values())
            expect(both > 10 and (window or both > 0.95 * len(sides)), "%d of %d ends on borders are in both tiles" % (both, len(sides)))
            shutil.rmtree(folder)
        r = d.ctl("fetch", job, "-o", folder + "/", "--format", "gpkg", "--interval", "1000", "--tile", "50").ok()
        expect("no line" in r.err + r.out and os.listdir(folder) == ["index.geojson"], r.err + r.out)
        r = d.ctl("fetch", job, "-o", folder + "/", "--format", "gpkg", "--interval", "1", "--tile", "0.1")
        expect(r.status == 2 and "--tile" in r.err, r.err)


def peak(d, *args):
    # A process of its own, which is small: a child begins with the peak of its parent.
    p = e2e.run([sys.executable, "-c", PEAK, e2e.ACUTCTL, *args, "--quiet"], env={"ACUT_SOCKET": d.socket}).ok()
    return int(p.out.split()[-1]) << 10


def memory_of_large_blocks():
    """Three files need no more memory beside one block of all vertices than beside small ones: they take no copy of its positions."""
    if e2e.sanitized():
        return
    points, domains, beside = 230000, [], []
    with e2e.Folder() as base:
        las = survey(base, points, "s.las", "--density", "4")
        outs = [w for name in ("l.gpkg", "l.geojson", "l.dxf") for w in ("-o", os.path.join(base, name), "--interval", "2")]
        for memory in ("24M", "1G"):
            with e2e.Daemon(base, memory=memory, name=memory) as d:
                domains.append(d.ctl("mesh", las, "--format", "null", "--json").ok().json()["domains"])
                alone, three = peak(d, "mesh", las, "--format", "null"), peak(d, "mesh", las, *outs)
            print("     %s: %.1f MiB without contours, %.1f MiB with three files" % (memory, alone / (1 << 20), three / (1 << 20)))
            beside.append(three - alone)
    expect(domains[0] > 10 and domains[1] == 1, "%s domains" % domains)
    expect(beside[1] < beside[0] + 12 * points, "more memory beside large blocks: %s" % beside)


def interrupted():
    """Ctrl-C while blocks come, pieces are joined and files are written: it ends soon, and leaves what --resume needs or nothing."""
    names = ("l.gpkg", "l.geojson", "l.dxf")
    with e2e.Folder() as base, e2e.Daemon(base, memory="256M") as d:
        d.ctl("push", "s", survey(base, 150000)).ok()
        job = str(d.ctl("submit", "s", "--wait", "--json").ok().json()["job"])
        out = os.path.join(base, "out")
        os.mkdir(out)
        args = [job, "--quiet"] + [w for name in names for w in ("-o", os.path.join(out, name), "--interval", "0.25")]
        cancelled = 0
        for delay in (0.1, 0.4, 0.8, 1.2, 1.8, 2.5):
            p = subprocess.Popen([e2e.ACUTCTL, "fetch", *args], env=dict(os.environ, ACUT_SOCKET=d.socket), stderr=subprocess.PIPE)
            e2e.handles(p, signal.SIGINT)
            time.sleep(delay)
            p.send_signal(signal.SIGINT)
            _, took = e2e.worked(lambda: p.communicate(timeout=e2e.PATIENCE), p)
            expect(p.returncode in (0, 130), "status %d" % p.returncode)
            if p.returncode == 0:
                break
            cancelled += 1
            expect(e2e.sanitized() or took < 2, "it worked for %.1f s after the signal" % took)
            left = set(os.listdir(out))
            expect(not left & set(names) and left <= {n + ".part" + s for n in names for s in ("", ".faces", ".state")}, "left: %s" % left)
            expect(not left or "l.gpkg.part.state" in left, "parts without a state: %s" % left)
        expect(cancelled, "every run was over at once")
        d.ctl("fetch", *args, *(["--resume"] if "l.gpkg.part.state" in os.listdir(out) else [])).ok()
        expect(set(os.listdir(out)) == set(names), "left: %s" % os.listdir(out))
        again = [read(os.path.join(out, n)) for n in names]
        d.ctl("fetch", *args).ok()
        expect(again == [read(os.path.join(out, n)) for n in names], "other bytes after --resume")


def no_lines():
    """An interval above the relief, or heights that pass by it: a file without lines, and one note."""
    text = "no line: the mesh has no height of a contour"
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        low, out = os.path.join(base, "low.xyz"), [os.path.join(base, "l." + k) for k in ("gpkg", "geojson", "dxf")]
        with open(low, "w") as f:
            f.writelines("%d %d %.2f\n" % (x, y, 101 + (x * y) % 3 * 0.25) for x in range(9) for y in range(9))
        for words in (("1000",), ("1", "--base", "0.75")):
            outs = [w for path in out for w in ("-o", path, "--interval", *words)]
            r = d.ctl("mesh", low, "--assume-units", "m,m", *outs).ok()
            expect((r.err + r.out).count(text) == 1 and out[0] + " and 2 others have" in r.err + r.out, r.err + r.out)
            expect(not read_gpkg(out[0]) and not read_geojson(out[1]) and not read_dxf(out[2]), "there are lines")
            r = d.ctl("mesh", low, "--assume-units", "m,m", "-o", out[0], "--interval", *words, "--json").ok()
            expect(any(out[0] + " has " + text in n for n in r.json()["notes"]), str(r.json()["notes"]))
        r = d.ctl("mesh", low, "--assume-units", "m,m", "-o", out[0], "--interval", "0.3", "-o", base + "/m.ply").ok()
        expect(text not in r.err + r.out and read_gpkg(out[0]), r.err + r.out)


def database_ends_early():
    """The file size limit, Ctrl-C or kill -9 while a GeoPackage is written: an error that names the file, nothing or the kept part
    beside it, and the same bytes when it goes on."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        folder = os.path.join(base, "out")
        out = os.path.join(folder, "l.gpkg")
        os.mkdir(folder)
        d.ctl("push", "s", survey(base, 20000)).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        words = [e2e.ACUTCTL, "fetch", str(job), "-o", out, "--interval", "0.2"]
        env = dict(os.environ, ACUT_SOCKET=d.socket, ACUT_FETCH_SYNC="1")
        e2e.run(words, env=env).ok()
        want = read(out)
        os.unlink(out)
        # The pieces of lines are smaller than the database.
        for part in (0.6, 0.8, 0.99):
            most = int(len(want) * part)
            p = subprocess.run([*words, "--json"], env=env, stdout=subprocess.PIPE, check=False,
                               preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)))
            error = json.loads(p.stdout)["error"]
            expect(p.returncode == 74 and "l.gpkg" in error["file"] and "too large" in error["message"], "%s: %d %s" % (part, p.returncode, error))
            expect("l.gpkg" not in os.listdir(folder), "there is an output")
        gate = e2e.Gate(base)
        for number, status in ((signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)):
            for name in os.listdir(folder):
                os.unlink(os.path.join(folder, name))
            # Of thousands of pages the first hundred: the file is empty until the lines are joined.
            gate.close("pwrite", "l.gpkg.part/", 100)
            p = subprocess.Popen(words, env=dict(env, **gate.env), stderr=subprocess.PIPE)
            expect(gate.wait(lambda: p.poll() is not None), "no database is begun")
            p.send_signal(number)
            gate.open()
            p.communicate()
            expect(p.returncode == status, "status %d, not %d" % (p.returncode, status))
            expect(sorted(os.listdir(folder)) == ["l.gpkg.part", "l.gpkg.part.faces", "l.gpkg.part.state"], str(os.listdir(folder)))
            expect(os.path.getsize(out + ".part") < len(want), "it was written to its end")
            e2e.run([*words, "--resume"], env=env).ok()
            expect(read(out) == want and os.listdir(folder) == ["l.gpkg"], "it went on to another file")


def systems():
    """What a file says of its system."""
    import crs
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        def files(path, *options):
            gpkg, geojson = os.path.join(base, "s.gpkg"), os.path.join(base, "s.geojson")
            d.ctl("mesh", path, *options, "-o", gpkg, "--interval", "0.1", "-o", geojson, "--interval", "0.1").ok()
            with sqlite3.connect(gpkg) as f:
                row = f.execute("SELECT c.srs_id, organization, organization_coordsys_id, g.z, g.srs_id FROM gpkg_contents c JOIN gpkg_spatial_ref_sys "
                                "USING (srs_id) JOIN gpkg_geometry_columns g USING (table_name)").fetchone()
            with open(geojson) as f:
                return row, json.load(f).get("crs", {}).get("properties", {}).get("name")

        utm = (25832, "EPSG", 25832, 1, 25832)
        both = crs.las(os.path.join(base, "a.las"), crs.compound(crs.UTM32, crs.HEIGHT))
        expect(files(both) == (utm, "urn:ogc:def:crs:EPSG::25832"), str(files(both)))
        plain = crs.las(os.path.join(base, "b.las"), crs.UTM32)
        expect(files(plain)[0] == utm, str(files(plain)))
        # Without a number its definition is there.
        local = re.sub(r',AUTHORITY\["EPSG","\d+"\]', "", crs.UTM32).replace("ETRS89 / UTM zone 32N", "Local grid").replace('"central_meridian",9', '"central_meridian",9.5')
        own = crs.las(os.path.join(base, "o.las"), local)
        unknown = 'LOCAL_CS["unknown"]'
        expect(files(own) == ((100000, "NONE", 100000, 1, 100000), unknown), str(files(own)))
        with sqlite3.connect(os.path.join(base, "s.gpkg")) as f:
            said = f.execute("SELECT definition FROM gpkg_spatial_ref_sys WHERE srs_id = 100000").fetchone()[0]
            expect('"Local grid"' in said and '"central_meridian",9.5' in said, said)
            expect(f.execute("PRAGMA integrity_check").fetchall() == [("ok",)], "SQLite finds faults")
        none = crs.xyz(os.path.join(base, "c.xyz"))
        expect(files(none) == ((-1, "NONE", -1, 1, -1), unknown), str(files(none)))
        degrees = os.path.join(base, "d.xyz")
        with open(degrees, "w") as f:
            for i in range(25):
                f.write("%.7f %.7f %.2f\n" % (8 + i % 5 * 1e-4, 50 + i // 5 * 1e-4, 100 + i * 0.37))
        got = files(degrees, "--planar", "--assume-crs", "EPSG:4326")
        expect(got == ((4326, "EPSG", 4326, 1, 4326), None), str(got))


def refused():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las, out = survey(base), os.path.join(base, "r.gpkg")
        d.ctl("push", "s", las).ok()
        d.ctl("submit", "s", "--wait").ok()
        d.ctl("push", "s", survey(base, 100, "t.las", "--seed", "2")).ok()
        other = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        for words, args in ((("--interval 1m",), ("mesh", las, "-o", out)),
                            (("--interval is not a length",), ("mesh", las, "-o", out, "--interval", "0")),
                            (("--interval is not a length",), ("mesh", las, "-o", out, "--interval", "1x")),
                            (("--base is not a height",), ("mesh", las, "-o", out, "--interval", "1", "--base", "x")),
                            (("--index is not a number",), ("mesh", las, "-o", out, "--interval", "1", "--index", "-1")),
                            (("--interval has no meaning for ply",), ("mesh", las, "-o", out, "--interval", "1", "-o", out + ".ply", "--interval", "1")),
                            (("--interval has no meaning for dxf",), ("mesh", las, "-o", out + ".dxf", "--format", "dxf", "--interval", "1")),
                            (("--polyface has no meaning for dxf-contours",), ("mesh", las, "-o", out + ".dxf", "--interval", "1", "--polyface")),
                            (("--origin has no meaning for gpkg",), ("mesh", las, "-o", out, "--interval", "1", "--origin", "auto")),
                            (("--canonical has no meaning for gpkg",), ("mesh", las, "-o", out, "--interval", "1", "--canonical")),
                            (("--changed-since has no meaning for gpkg",), ("fetch", other, "-o", out, "--interval", "1", "--changed-since", "1")),
                            (("--simplify and --tile",), ("fetch", other, "-o", out + "/", "--format", "gpkg", "--interval", "1", "--simplify", "1", "--tile", "50")),
                            (("too many digits",), ("mesh", las, "-o", out, "--interval", "0.12345678901"))):
            r = d.ctl(*args)
            expect(r.status == 2 and all(w in r.err for w in words), "%s: %d\n%s" % (args, r.status, r.err))
            expect(not os.path.exists(out), "%s: there is an output" % (args,))
        low = os.path.join(base, "u.xyz")
        with open(low, "w") as f:
            f.write("0 0 1\n10 0 1\n0 10 2\n")
        r = d.ctl("mesh", low, "-o", out, "--interval", "1m")
        expect(r.status == 2 and "--assume-units" in r.err and not os.path.exists(out), r.err)
        # An interval behind one output is not that of another one.
        dxf = os.path.join(base, "faces.dxf")
        d.ctl("mesh", las, "-o", out, "--interval", "1", "-o", dxf).ok()
        expect(b"3DFACE" in read(dxf) and b"POLYLINE" not in read(dxf), "the surface has become contours")
        d.ctl("mesh", las, "--interval", "1", "-o", out, "-o", dxf).ok()
        expect(b"3DFACE" not in read(dxf) and b"POLYLINE" in read(dxf), "an interval before all outputs is of all")


if __name__ == "__main__":
    e2e.main(lengths, higher_ground_is_on_the_left, simplified, same_bytes, windows, polygons, tiles, memory, memory_of_large_blocks, interrupted, database_ends_early, no_lines, systems, refused)
