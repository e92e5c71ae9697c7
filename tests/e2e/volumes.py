"""Volumes: generations, datasets of other lattices, levels and polygons against sums of the triangles' own coordinates in fractions; the
same mesh twice, a lift, exchanged sides; a window against whole streams; CSV and JSON; the pixels of images against those of the two elevation
models; what is refused; Ctrl-C; the memory of acutctl."""
import csv
import io
import json
import os
import random
import resource
import shutil
import signal
import struct
import subprocess
import sys
import time
import zlib
from fractions import Fraction as F

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import e2e
from e2e import ACUTCTL, Daemon, Folder, expect

PEAK = "import resource, subprocess, sys; subprocess.check_call(sys.argv[1:]); print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
SIDE = 100
METRES = ("--assume-crs", "EPSG:2154", "--assume-units", "m,m")


def survey(path, seed, points=800, lift=0, digits=2, side=SIDE, mound=3, at=(600000, 6500000)):
    """Random points of a square with its corners, so that all meshes cover the same; a mound, and a pit."""
    r = random.Random(seed)
    plan = [(0, 0), (side, 0), (0, side), (side, side)] + [(r.random() * side, r.random() * side) for _ in range(points)]
    with open(path, "w") as f:
        for x, y in plan:
            z = 50 + x / 20 + lift
            for cx, cy, h in ((0.3, 0.4, mound), (0.7, 0.6, -mound / 2)):
                d = ((x / side - cx) ** 2 + (y / side - cy) ** 2) / 0.04
                z += h * (1 - d) if d < 1 else 0
            f.write("%.*f %.*f %.*f\n" % (digits, at[0] + x, digits, at[1] + y, digits, z))
    return path


def job(d, name, *words):
    return d.ctl("submit", name, "--wait", *words).ok().out.strip()


def triangles(d, base, number, digits):
    path = os.path.join(base, "m.obj")
    d.ctl("fetch", number, "-o", path).ok()
    v, t = [], []
    with open(path) as f:
        for line in f:
            w = line.split()
            if w and w[0] == "v":
                v.append(tuple(F(c) for c in w[1:4]))
            elif w and w[0] == "f":
                t.append(tuple(v[int(i.split("/")[0]) - 1] for i in w[1:4]))
    return t


def twice(t):
    (a, b, c) = t
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def below(mesh):
    """The volume between it and 0."""
    return sum(twice(t) * (t[0][2] + t[1][2] + t[2][2]) for t in mesh) / 6


def volumes(d, *words):
    return d.ctl("volume", *words, "--json").ok().json()


def one(d, *words):
    got = volumes(d, *words)["volumes"]
    expect(len(got) == 1, "%d rows" % len(got))
    return got[0]


def near(got, want, bound, what):
    expect(abs(F(got) - want) <= F(bound) * 2 + abs(want) * F(1, 1 << 50), "%s: %r, must be %r, bound %r" % (what, got, float(want), bound))


# ---- cases

def generations():
    with Folder() as base, Daemon(base) as d:
        a, b = survey(base + "/a.xyz", 1), survey(base + "/b.xyz", 2, 300, mound=4)
        d.ctl("push", "valley", a, *METRES).ok()
        first = job(d, "valley")
        d.ctl("push", "valley", b, "--override-crs", "EPSG:2154", "--override-units", "m,m").ok()
        second = job(d, "valley")
        expect(first != second, "one job")
        got = one(d, first, second)
        before, after = triangles(d, base, first, 2), triangles(d, base, second, 2)
        near(got["net"], below(after) - below(before), got["error"], "net")
        near(got["area"], SIDE * SIDE, got["area_error"], "area")
        expect(got["fill"] > 1 and got["cut"] > 1 and got["only_first"] == got["only_second"] == 0, "%s" % got)
        expect(0 < got["error"] < 1e-6, "the bound is %r" % got["error"])
        expect(abs(got["fill_area"] + got["cut_area"] + got["same_area"] - got["area"]) < 1e-6, "%s" % got)
        back = one(d, second, first)
        pairs = (("fill", "cut"), ("fill_area", "cut_area"), ("only_first", "only_second"), ("area", "area"), ("error", "error"))
        expect(all(got[x] == back[y] and got[y] == back[x] for x, y in pairs) and got["net"] == -back["net"], "%s %s" % (got, back))
        same = one(d, second, second)
        expect(same["fill"] == same["cut"] == same["fill_area"] == same["cut_area"] == 0 and same["same_area"] == SIDE * SIDE, "%s" % same)
        text = d.ctl("volume", first, second).ok().out
        expect("m3" in text and "m2" in text and "at most" in text, text)
        # The same with another memory of the daemon: other domains, the same numbers.
        with Daemon(base, memory="24M", name="2") as other:
            other.ctl("push", "valley", a, *METRES).ok()
            x = job(other, "valley")
            other.ctl("push", "valley", b, "--override-crs", "EPSG:2154", "--override-units", "m,m").ok()
            expect(one(other, x, job(other, "valley")) == got, "another daemon, another volume")


def datasets():
    """Other lattices, a lift, feet."""
    with Folder() as base, Daemon(base) as d:
        for k, (lift, scale) in enumerate(((0, "0.01"), (1.25, "0.01"), (0, "0.004"))):
            d.ctl("push", "d%d" % k, survey(base + "/%d.xyz" % k, 3, lift=lift), *METRES, "--scale", scale).ok()
        jobs = [job(d, "d%d" % k) for k in range(3)]
        lifted = one(d, jobs[0], jobs[1])
        near(lifted["fill"], F(5, 4) * SIDE * SIDE, lifted["error"], "lift")
        expect(lifted["cut"] == 0 and lifted["fill_area"] == SIDE * SIDE, "%s" % lifted)
        other = one(d, jobs[0], jobs[2])
        near(other["net"], below(triangles(d, base, jobs[2], 3)) - below(triangles(d, base, jobs[0], 2)), other["error"], "lattices")
        # A half that only one covers.
        d.ctl("push", "half", survey(base + "/h.xyz", 4, side=SIDE // 2), *METRES).ok()
        half = one(d, jobs[0], job(d, "half"))
        near(half["only_first"], F(3, 4) * SIDE * SIDE, half["area_error"] + 1e-9, "only the first")
        expect(half["only_second"] == 0, "%s" % half)
        d.ctl("push", "far", survey(base + "/far.xyz", 4, at=(601000, 6500000)), *METRES).ok()
        apart = volumes(d, jobs[0], job(d, "far"))
        expect(apart["pairs"] == 0 and "no place in common" in apart["warnings"][0] and apart["volumes"][0]["only_second"] == SIDE * SIDE, "%s" % apart)
        for k in (0, 1):
            d.ctl("push", "ft%d" % k, survey(base + "/%d.xyz" % k, 3, lift=k), "--assume-units", "ft,ft").ok()
        feet = [job(d, "ft%d" % k) for k in (0, 1)]
        got = volumes(d, *feet)
        expect(got["unit_volume"] == "ft3" and got["unit_area"] == "ft2" and got["warnings"], "%s" % got)
        near(got["volumes"][0]["fill"], F(SIDE * SIDE), 1e-6, "feet")
        yards = volumes(d, *feet, "--unit", "yd")
        expect(yards["unit_volume"] == "yd3", "%s" % yards)
        near(yards["volumes"][0]["fill"], F(SIDE * SIDE, 27), 1e-6, "yards")
        near(one(d, *feet, "--unit", "m")["fill"], F(SIDE * SIDE) * F(3048, 10000) ** 3, 1e-6, "metres")


def levels():
    with Folder() as base, Daemon(base) as d:
        d.ctl("push", "valley", survey(base + "/a.xyz", 1), *METRES).ok()
        number = job(d, "valley")
        mesh = triangles(d, base, number, 2)
        for level in ("52", "50.123", "-3", "1000.5", "52.1234567890123"):
            got = one(d, number, "--level=" + level)
            near(got["net"], below(mesh) - F(level) * SIDE * SIDE, got["error"], level)
            near(got["fill"], above(mesh, F(level)), got["error"], level)
        expect(one(d, number, "--level", "1000")["fill"] == 0, "a mountain")


def above(mesh, level):
    """Its volume above a level, by prisms."""
    s = F(0)
    for t in mesh:
        h, area = sorted(c[2] - level for c in t), twice(t) / 2
        if h[0] >= 0:
            s += area * sum(h) / 3
        elif h[1] >= 0:  # without the corner that is below
            s += area * (sum(h) / 3 + (-h[0]) ** 3 / (3 * (h[1] - h[0]) * (h[2] - h[0])))
        elif h[2] > 0:
            s += area * h[2] ** 3 / (3 * (h[2] - h[0]) * (h[2] - h[1]))
    return s


def feature(name, *rings, key="name"):
    return {"type": "Feature", "properties": {"a": [1, {"name": 2}], key: name},
            "geometry": {"type": "Polygon", "coordinates": [[[600000 + x, 6500000 + y] for x, y in r + r[:1]] for r in rings]}}


def box(x1, y1, x2, y2):
    return [(x1, y1), (x2, y1), (x2, y2), (x1, y2)]


def write(path, *features):
    with open(path, "w") as f:
        json.dump({"type": "FeatureCollection", "features": features}, f)
    return path


def polygons():
    with Folder() as base, Daemon(base) as d:
        for k in (0, 1):
            d.ctl("push", "d%d" % k, survey(base + "/%d.xyz" % k, 3 + k, mound=3 + k), *METRES).ok()
        jobs = [job(d, "d%d" % k) for k in (0, 1)]
        all_of_it = one(d, *jobs)
        parts = [feature("west, \"old\"", box(-5, -5, 40.5, 105)), feature("ring", box(40.5, -5, 105, 105), box(60, 20, 90.25, 80)), feature(7, box(60, 20, 90.25, 80))]
        path = write(base + "/parts.geojson", *parts)
        rows = volumes(d, *jobs, "--within", path)["volumes"]
        expect([r["name"] for r in rows] == ["west, \"old\"", "ring", "7"], "%s" % rows)
        for key in ("fill", "cut", "net", "area", "fill_area", "cut_area"):
            bound = sum(r["error"] + r["area_error"] for r in rows) + all_of_it["error"] + all_of_it["area_error"]
            bound += 1e-6 if key.endswith("_area") else 0
            near(sum(F(r[key]) for r in rows), F(all_of_it[key]), bound, key)
        near(rows[2]["area"], F(3025, 100) * 60, rows[2]["area_error"], "area of a box")
        expect(all(r["only_first"] == r["only_second"] == 0 for r in rows), "%s" % rows)
        names = volumes(d, *jobs, "--within", write(base + "/id.geojson", feature("x", box(0, 0, 9, 9), key="id")), "--name-field", "id")["volumes"]
        expect(names[0]["name"] == "x", "%s" % names)
        # A field that is long, one that no feature has, one that some have.
        long = "b" * 40
        path2 = write(base + "/id.geojson", feature("x", box(0, 0, 9, 9), key=long), feature("é" * 400, box(9, 0, 19, 9), key="id"))
        names = volumes(d, *jobs, "--within", path2, "--name-field", long)
        expect([r["name"] for r in names["volumes"]] == ["x", None] and "1 of 2" in names["warnings"][0], "%s" % names)
        names = volumes(d, *jobs, "--within", path2, "--name-field", "id")
        expect([r["name"] for r in names["volumes"]] == [None, "é" * 400] and "1 of 2" in names["warnings"][0], "%s" % names)
        table = list(csv.DictReader(io.StringIO(d.ctl("volume", *jobs, "--within", path2, "--csv", "--name-field", "id").ok().out)))
        expect([r["name"] for r in table] == ["1", "é" * 400], "%s" % table)
        for field in (long[:31], "a", "nom"):
            r = d.ctl("volume", *jobs, "--within", path2, "--name-field", field)
            expect(r.status == 2 and '"%s"' % field in r.err and long + ", id" in r.err and "id.geojson" in r.err, "%d %s" % (r.status, r.err))
        with open(base + "/id.wkt", "w") as f:
            f.write("POLYGON ((600000 6500000, 600009 6500000, 600009 6500009, 600000 6500000))")
        r = d.ctl("volume", *jobs, "--within", base + "/id.wkt", "--name-field", "id")
        expect(r.status == 2 and "no such properties" in r.err, "%d %s" % (r.status, r.err))
        # CSV has the same numbers; the table has a row each.
        table = list(csv.DictReader(io.StringIO(d.ctl("volume", *jobs, "--within", path, "--csv").ok().out)))
        expect([float(r["fill"]) for r in table] == [r["fill"] for r in rows] and [r["name"] for r in table] == [r["name"] for r in rows], "%s" % table)
        expect(all(r["unit_volume"] == "m3" and r["unit_area"] == "m2" for r in table), "%s" % table)
        lines = d.ctl("volume", *jobs, "--within", path).ok().out.splitlines()
        expect(len(lines) == 3 and all("m3" in line for line in lines), "%s" % lines)
        # WKT, and many corners on the same edges: no window can have them, so whole meshes come.
        wkt = base + "/parts.wkt"
        with open(wkt, "w") as f:
            f.write("POLYGON ((600060 6500020, 600090.25 6500020, 600090.25 6500080, 600060 6500080, 600060 6500020))")
        alone = volumes(d, *jobs, "--within", wkt)["volumes"][0]
        for key in ("fill", "cut", "net", "area"):
            near(alone[key], F(rows[2][key]), rows[2]["error"] + rows[2]["area_error"], "WKT: " + key)
        n = 40000
        with open(wkt, "w") as f:
            corner = ["%r 6500020" % (600060 + 30.25 * i / n) for i in range(n)] + ["600090.25 6500020", "600090.25 6500080"]
            corner += ["%r 6500080" % (600090.25 - 30.25 * i / n) for i in range(1, n + 1)] + ["600060 6500020"]
            f.write("POLYGON ((%s))" % ", ".join(corner))
        many = volumes(d, *jobs, "--within", wkt)
        near(many["volumes"][0]["fill"], F(rows[2]["fill"]), many["volumes"][0]["error"] + rows[2]["error"], "many corners")
        expect(many["meshes"][0]["triangles"] > volumes(d, *jobs, "--within", path)["meshes"][0]["triangles"] * 0.9, "a window after all")
        nothing = volumes(d, *jobs, "--within", write(base + "/off.geojson", feature("off", box(200, 0, 300, 9))))
        expect(nothing["volumes"][0]["area"] == 0 and "no polygon meets" in nothing["warnings"][0], "%s" % nothing)
        level = volumes(d, jobs[0], "--level", "52", "--within", path)["volumes"]
        whole = one(d, jobs[0], "--level", "52")
        near(sum(F(r["fill"]) for r in level), F(whole["fill"]), sum(r["error"] for r in level) + whole["error"], "level in polygons")
        for name, rings, text in (("bow", [[(0, 0), (9, 9), (9, 0), (0, 9)]], "cross"), ("twice", [box(0, 0, 9, 9), box(5, 5, 15, 15)], "cross"),
                                  ("out", [box(0, 0, 9, 9), box(20, 20, 30, 30)], "cross or overlap")):
            r = d.ctl("volume", *jobs, "--within", write(base + "/bad.geojson", feature(name, *rings)))
            expect(r.status == 1 and text in r.err and "makevalid" in r.err and "bad.geojson" in r.err, "%s: %d %s" % (name, r.status, r.err))
        for ring in ([(0, 0), (9, 9)], [(0, 0), (9, 9), (0, 0)], [(5, 5)]):
            r = d.ctl("volume", *jobs, "--within", write(base + "/bad.geojson", feature("thin", ring)))
            expect(r.status == 1 and "no area" in r.err and "bad.geojson" in r.err, "%s: %d %s" % (ring, r.status, r.err))
        r = d.ctl("volume", *jobs, "-o", base + "/twice.png", "-o", base + "/twice.png")
        expect(r.status == 2 and "given twice" in r.err and not os.path.exists(base + "/twice.png"), "%d %s" % (r.status, r.err))


def bounded():
    """A mesh with a hole: what is in it only the other one covers, also inside of polygons."""
    with Folder() as base, Daemon(base) as d:
        for name in ("d0", "d1"):
            d.ctl("push", name, survey(base + "/0.xyz", 3), *METRES).ok()
        with open(base + "/hole.csv", "w") as f:
            f.write("x,y,z,name\n" + "".join("%d,%d,%d,h\n" % (600000 + x, 6500000 + y, 50) for x, y in box(20, 30, 40, 60) + [(20, 30)]))
        d.ctl("push", "d1", base + "/hole.csv", "--lines-as", "hole", *METRES).ok()
        jobs = [job(d, name) for name in ("d0", "d1")]
        got = one(d, *jobs)
        near(got["only_first"], F(600), got["area_error"] + 1e-9, "the hole")
        expect(got["only_second"] == 0, "%s" % got)
        near(got["area"], F(SIDE * SIDE - 600), got["area_error"], "area")
        part = volumes(d, *jobs, "--within", write(base + "/p.geojson", feature("p", box(30, 0, 100, 50))))["volumes"][0]
        near(part["only_first"], F(200), part["area_error"] + 1e-9, "the hole in a polygon")


# ---- images

def read_png(path):
    with open(path, "rb") as f:
        data = f.read()
    at, raw, size = 8, b"", None
    while at < len(data):
        n, kind = struct.unpack(">I4s", data[at:at + 8])
        if kind == b"IHDR":
            size = struct.unpack(">2I5B", data[at + 8:at + 8 + n])
        if kind == b"IDAT":
            raw += data[at + 8:at + 8 + n]
        at += n + 12
    w, h, depth, color = size[:4]
    expect((depth, color) == (8, 6), "PNG of depth %d, kind %d" % (depth, color))
    raw, rows, last = zlib.decompress(raw), [], bytearray(4 * w)
    for y in range(h):
        kind, line = raw[y * (4 * w + 1)], bytearray(raw[y * (4 * w + 1) + 1:(y + 1) * (4 * w + 1)])
        for i in range(4 * w):
            a, b, c = (line[i - 4] if i >= 4 else 0), last[i], (last[i - 4] if i >= 4 else 0)
            p = a + b - c
            paeth = a if abs(p - a) <= abs(p - b) and abs(p - a) <= abs(p - c) else b if abs(p - b) <= abs(p - c) else c
            line[i] = (line[i] + (0, a, b, (a + b) // 2, paeth)[kind]) & 255
        rows.append([tuple(line[4 * x:4 * x + 4]) for x in range(w)])
        last = line
    return rows


def heights(d, base, mesh, cell):
    """Values of a mesh at pixel centres, by its triangles, where they are not on an edge."""
    out = {}
    for t in mesh:
        xs, ys, dd = [c[0] - 600000 for c in t], [c[1] - 6500000 for c in t], twice(t)
        for i in range(int(min(xs) / cell), int(max(xs) / cell) + 1):
            for k in range(int(min(ys) / cell), int(max(ys) / cell) + 1):
                x, y = (i + F(1, 2)) * cell, (k + F(1, 2)) * cell
                w = [(xs[(j + 2) % 3] - xs[(j + 1) % 3]) * (y - ys[(j + 1) % 3]) - (ys[(j + 2) % 3] - ys[(j + 1) % 3]) * (x - xs[(j + 1) % 3]) for j in range(3)]
                if min(w) > 0:
                    out[i, k] = sum(v * c[2] for v, c in zip(w, t)) / dd
    return out


def images():
    with Folder() as base, Daemon(base) as d:
        d.ctl("push", "d0", survey(base + "/0.xyz", 3), *METRES).ok()
        d.ctl("push", "d1", survey(base + "/1.xyz", 4, mound=6, side=80), *METRES).ok()
        jobs = [job(d, "d0"), job(d, "d1")]
        png, tif = base + "/d.png", base + "/d.tif"
        got = volumes(d, *jobs, "-o", png, "-o", tif, "--cell", "2m")
        expect(got["outputs"] == [png, tif] and got["color_range"] > 0, "%s" % got)
        expect(one(d, *jobs) == got["volumes"][0], "images change the numbers")
        a, b = (heights(d, base, triangles(d, base, n, 2), 2) for n in jobs)
        rows, seen = read_png(png), 0
        expect(len(rows) == 40 and len(rows[0]) == 40, "%d x %d pixels" % (len(rows[0]), len(rows)))
        for (i, k), z in b.items():
            r, g, blue, alpha = rows[39 - k][i]
            diff = z - a.get((i, k), z)
            seen += 1
            expect(alpha == 255, "no pixel at %d %d" % (i, k))
            expect(diff == 0 or abs(diff) < got["color_range"] / 200 or (blue > r) == (diff > 0), "%s is %s" % (float(diff), (r, g, blue)))
        expect(seen > 1500, "%d pixels" % seen)
        with open(base + "/d.pgw") as f:
            world = [float(v) for v in f]
        expect(world == [2, 0, 0, -2, 600001, 6500079], "%s" % world)
        try:
            from osgeo import gdal
        except ImportError:
            e2e.unavailable("python3-gdal is not installed")
        gdal.UseExceptions()
        place, values = values_of(tif)
        expect(place == (600000, 2, 0, 6500080, 0, -2) and len(values) == len(values[0]) == 40, "%s" % (place,))
        for at, z in b.items():
            if at in a:
                v = F(float(values[39 - at[1]][at[0]]))
                expect(abs(v - (z - a[at])) < F(1, 10**6), "pixel %s is %r, must be %r" % (at, float(v), float(z - a[at])))
        level = volumes(d, jobs[0], "--level", "52.5", "-o", tif, "--cell", "2")
        place, values = values_of(tif)
        expect(level["color_range"] is None and len(values) == len(values[0]) == 50, "%s" % level)
        for at, z in a.items():
            expect(abs(F(float(values[49 - at[1]][at[0]])) - (z - F(105, 2))) < F(1, 10**5), "level at %s" % (at,))


def values_of(path):
    from osgeo import gdal
    data = gdal.Open(path)
    w, h = data.RasterXSize, data.RasterYSize
    v = struct.unpack("<%df" % (w * h), data.GetRasterBand(1).ReadRaster(0, 0, w, h, buf_type=gdal.GDT_Float32))
    return data.GetGeoTransform(), [v[y * w:(y + 1) * w] for y in range(h)]


def pixels_of(path):
    """Values by pixel, counted from the corner of the survey, of a GeoTIFF of pixels of 2 m; and its box in pixels."""
    place, values = values_of(path)
    left, top = (F(place[0]) - 600000) / 2, (F(place[3]) - 6500000) / 2
    expect(left.denominator == top.denominator == 1 and place[1:3] == (2, 0) and place[4:] == (0, -2), "%s" % (place,))
    box = (int(left), int(top) - len(values), int(left) + len(values[0]), int(top))
    return {(box[0] + i, box[3] - 1 - k): v for k, row in enumerate(values) for i, v in enumerate(row) if v != -9999}, box


def is_in(rings, i, k):
    """Whether the centre of a pixel of 2 m, moved a little to the east and, much less, to the south, is within the rings."""
    x, y, odd = F(2 * i + 1), F(2 * k + 1), False
    for r in rings:
        for (px, py), (qx, qy) in zip(r, r[1:] + r[:1]):
            px, py, qx, qy = (F(repr(v)) for v in (px, py, qx, qy))
            if (py >= y) != (qy >= y):
                odd ^= px + (y - py) / (qy - py) * (qx - px) > x
    return odd


def images_within():
    """Images show what is within the polygons and nothing else, in the box of these, whatever came; their colours, too."""
    try:
        from osgeo import gdal
    except ImportError:
        e2e.unavailable("python3-gdal is not installed")
    gdal.UseExceptions()
    with Folder() as base, Daemon(base) as d:
        for k in (0, 1):
            d.ctl("push", "d%d" % k, survey(base + "/%d.xyz" % k, 3 + k, mound=3 + 3 * k), *METRES).ok()
        jobs = [job(d, "d%d" % k) for k in (0, 1)]
        png, tif = base + "/d.png", base + "/d.tif"

        def image(*words):
            if os.path.exists(tif):
                os.unlink(tif)
                os.unlink(png)
            said = volumes(d, *words, "-o", tif, "-o", png, "--cell", "2m")
            with open(png[:-4] + ".pgw") as f:
                world = [float(v) for v in f]
            found, box = pixels_of(tif)
            expect(world[4:] == [600000 + 2 * box[0] + 1, 6500000 + 2 * box[3] - 1], "the world file of %s: %s" % (box, world))
            seen = {(box[0] + i, box[3] - 1 - k) for k, row in enumerate(read_png(png)) for i, p in enumerate(row) if p[3]}
            expect(seen == set(found), "the picture has %d pixels, the raster %d" % (len(seen), len(found)))
            return found, box, said

        whole, _, far = image(*jobs)
        # Two with a common border, which is oblique and runs through centres of pixels; a hole; one that reaches out of the meshes.
        west = [(-7.5, 11), (31, 11), (61, 71), (-7.5, 77.03)]
        east = [(31, 11), (108.25, 15), (99, 71), (61, 71)]
        hole, other = box(70.5, 30.25, 80, 50), box(11, 81, 29.004, 95.5)
        shapes = {"west": [west], "east": [east, hole], "other": [other]}
        parts = {}
        for name, rings in shapes.items():
            found, extent, said = image(*jobs, "--within", write(base + "/p.geojson", feature(name, *rings)))
            want = {at: v for at, v in whole.items() if is_in(rings, *at)}
            expect(found == want, "%s: %d pixels, must be %d" % (name, len(found), len(want)))
            xs, ys = ([c[k] for r in rings for c in r] for k in (0, 1))
            grid = [(v - 1) / 2 for v in (min(xs), min(ys), max(xs), max(ys))]
            up, down = (lambda v: -int(-v // 1)), (lambda v: int(v // 1))
            must = (up(grid[0]), down(grid[1]) + 1, up(grid[2]), down(grid[3]) + 1)
            expect(extent == must, "%s: box %s, must be %s" % (name, extent, must))
            parts[name] = found
        expect(not set(parts["west"]) & set(parts["east"]), "a pixel is in both")
        one_of_all = write(base + "/p.geojson", *(feature(n, *r) for n, r in shapes.items()))
        together, extent, said = image(*jobs, "--within", one_of_all)
        expect(together == {at: v for p in parts.values() for at, v in p.items()}, "together they are another image")
        expect(said["color_range"] <= far["color_range"] and said["unit_color_range"] == "m", "%s" % said)
        # Corners beyond count: no window, so all triangles come, and the same image and colours.
        n = 20000
        crowd = [(-7.5 + 38.5 * i / n, 11) for i in range(n)] + west[1:]
        more = write(base + "/m.geojson", feature("west", crowd), feature("east", east, hole), feature("other", other))
        again, box_again, said_again = image(*jobs, "--within", more)
        expect(said_again["meshes"][0]["triangles"] > said["meshes"][0]["triangles"], "a window after all")
        expect((again, box_again) == (together, extent), "other triangles came, and it is another image")
        expect(said_again["color_range"] == said["color_range"], "other triangles came, and other colours")
        # A level; a polygon without a mesh; one without a centre of a pixel.
        level, extent, _ = image(jobs[0], "--level", "52", "--within", one_of_all)
        expect(extent == box_again and set(level) == set(together), "a level has other pixels")
        nothing, extent, _ = image(*jobs, "--within", write(base + "/p.geojson", feature("off", box(200, 0, 240, 10))))
        expect(not nothing and extent == (100, 0, 120, 5), "%s" % (extent,))
        nothing, extent, _ = image(*jobs, "--within", write(base + "/p.geojson", feature("dot", box(20.25, 20, 20.5, 20.5))))
        expect(not nothing and extent[2] - extent[0] == extent[3] - extent[1] == 1, "%s" % (extent,))


def colors_in_units():
    """The range of colours is round in the unit that is printed."""
    with Folder() as base, Daemon(base) as d:
        for k in (0, 1):
            d.ctl("push", "d%d" % k, survey(base + "/%d.xyz" % k, 3, lift=F(7, 4) * k), *METRES).ok()
        jobs = [job(d, "d%d" % k) for k in (0, 1)]
        for unit, want in (("m", 2), ("ft", 10), ("yd", 3)):
            got = volumes(d, *jobs, "-o", base + "/d.png", "--cell", "2m", "--unit", unit)
            expect((got["color_range"], got["unit_color_range"]) == (want, unit), "%s: %s" % (unit, got))
            text = d.ctl("volume", *jobs, "-o", base + "/d.png", "--cell", "2m", "--unit", unit).ok().out
            expect("red to -%d %s" % (want, unit) in text, text)
        level = volumes(d, jobs[0], "--level", "52", "--unit", "ft")
        expect(level["level"] == 52 and level["unit_level"] == "m" and level["unit_volume"] == "ft3" and level["unit_color_range"] is None, "%s" % level)


def early():
    """What is wrong with the options is said before a job is waited for."""
    with Folder() as base:
        gate = e2e.Gate(base)
        with Daemon(base, env=gate.env) as d:
            d.ctl("push", "valley", survey(base + "/a.xyz", 1), *METRES).ok()
            done = job(d, "valley")
            d.ctl("push", "other", survey(base + "/b.xyz", 2), *METRES).ok()
            d.ctl("push", "feet", base + "/b.xyz", "--assume-units", "ft,ft").ok()
            gate.close("renameat", "/domains/")
            waits, feet = (d.ctl("submit", n).ok().out.split()[0] for n in ("other", "feet"))
            gate.wait()
            area = write(base + "/p.geojson", feature("p", box(0, 0, 90, 90)))
            png, tif, mine = base + "/d.png", base + "/d.tif", base + "/mine.png"
            with open(mine, "w") as f:
                f.write("mine")
            for words, status, text in (
                    ((waits, "--level", "52", "-o", png, "--cell", "0.005", "--within", area), 2, "18000 x 18000 pixels"),
                    ((done, waits, "-o", png, "--cell", "0.005", "--within", area), 2, "18000 x 18000 pixels"),
                    ((waits, "--level", "52", "-o", tif, "--cell", "0.0009", "--within", area), 2, "100000 x 100000 pixels"),
                    ((done, waits, "-o", png, "--cell", "1.123456789"), 2, "--cell"),
                    ((done, waits, "-o", png), 2, "--cell"),
                    ((done, waits, "-o", png, "--cell", "0"), 2, "--cell"),
                    ((done, waits, "-o", base + "/none/d.png", "--cell", "1"), 74, "none"),
                    ((done, waits, "-o", mine, "--cell", "1", "--no-clobber"), 2, "mine.png"),
                    ((done, feet), 2, "foot"),
                    ((waits, "99"), 4, "no job 99")):
                r = d.ctl("volume", *words, timeout=e2e.PATIENCE)
                expect(r.status == status and text in r.err, "%s: %d, %s" % (words, r.status, r.err))
            expect(d.ctl("show", waits, "--json").ok().json()["state"] != "done", "the job did not wait")
            gate.open()
            one(d, done, waits)


def between_steps():
    """The image of a level between two steps of z."""
    if not shutil.which("gdalinfo"):
        e2e.unavailable("gdalinfo is not installed")
    with Folder() as base, Daemon(base) as d:
        with open(base + "/flat.xyz", "w") as f:
            f.write("".join("%d %d 0\n" % (600000 + x, 6500000 + y) for x, y in box(0, 0, 4, 4)))
        d.ctl("push", "flat", base + "/flat.xyz", *METRES, "--scale", "1").ok()
        d.ctl("volume", job(d, "flat"), "--level", "0.5", "-o", base + "/l.tif", "--cell", "1").ok()
        out = subprocess.run(["gdalinfo", "-mm", base + "/l.tif"], capture_output=True, text=True, check=True).stdout
        expect("Min/Max=-0.500,-0.500" in out, out)


# ---- refusals, Ctrl-C, memory

def refused():
    with Folder() as base, Daemon(base) as d:
        path = survey(base + "/a.xyz", 1, 50)
        d.ctl("push", "good", path, *METRES).ok()
        d.ctl("push", "none", path).ok()
        d.ctl("push", "mixed", path, "--assume-units", "m,ft").ok()
        d.ctl("push", "feet", path, "--assume-units", "ft,ft", ).ok()
        d.ctl("push", "lambert", path, "--assume-crs", "EPSG:3945", "--assume-units", "m,m").ok()
        jobs = {n: job(d, n) for n in ("good", "none", "mixed", "feet", "lambert")}
        good = jobs["good"]
        area = write(base + "/p.geojson", feature("p", box(0, 0, 9, 9)))
        line = base + "/line.geojson"
        with open(line, "w") as f:
            f.write('{"type":"LineString","coordinates":[[0,0],[1,1]]}')
        other = base + "/other.geojson"
        with open(area) as f, open(other, "w") as g:
            json.dump({**json.load(f), "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::4326"}}}, g)
        for words, status, text in (
                ((jobs["none"], jobs["none"]), 2, "--assume-units"),
                ((good, jobs["none"]), 2, "unknown"),
                ((jobs["mixed"], jobs["mixed"]), 2, "one unit"),
                ((good, jobs["feet"]), 2, "foot"),
                ((good, jobs["lambert"]), 2, "coordinate system"),
                ((good,), 2, "--level Z"),
                ((good, good, "--level", "3"), 2, "--level"),
                ((good, "--level", "high"), 2, "height"),
                ((good, "999"), 4, "no job 999"),
                ((good, "x"), 2, "x"),
                ((good, good, "--csv", "--json"), 2, "--csv"),
                ((good, good, "-o", base + "/d.ply", "--cell", "1"), 2, ".png"),
                ((good, good, "-o", base + "/d.png"), 2, "--cell"),
                ((good, good, "-o", base + "/d.png", "--cell", "0"), 2, "--cell"),
                ((good, good, "-o", base + "/d.png", "--cell", "0.0001"), 2, "--cell"),
                ((good, good, "--cell", "1"), 2, "-o OUT"),
                ((good, good, "-o", base + "/none/d.png", "--cell", "1"), 74, "none"),
                ((good, good, "--unit", "km"), 2, "--unit"),
                ((good, good, "--name-field", "id"), 2, "--within"),
                ((good, good, "--within", base + "/none.geojson"), 74, "none.geojson"),
                ((good, good, "--within", line), 1, "LineString"),
                ((good, good, "--within", other), 2, "EPSG:4326")):
            r = d.ctl("volume", *words)
            expect(r.status == status and text in r.err + r.out, "%s: %d, %s%s" % (words, r.status, r.out, r.err))
        expect(not [n for n in os.listdir(base) if n.startswith(("d.", ".acut"))], "files are left: %s" % os.listdir(base))
        with open(base + "/d.png", "w") as f:
            f.write("mine")
        r = d.ctl("volume", good, good, "-o", base + "/d.png", "--cell", "1", "--no-clobber")
        with open(base + "/d.png") as f:
            expect(r.status == 2 and f.read() == "mine", "%d %s" % (r.status, r.err))


def large(d, base, points):
    for k in (0, 1):
        path = base + "/%d.las" % k
        e2e.run([e2e.SYNTH, "--points", points, "--seed", 5 + k, path]).ok()
        d.ctl("push", "d%d" % k, path, "--override-units", "m,m").ok()
    return [job(d, "d%d" % k) for k in (0, 1)]


def changes():
    """Of two generations only the regions that differ come; all numbers are those of whole streams."""
    with Folder() as base, Daemon(base, memory="48M") as d:
        for path, words in ((base + "/0.las", ("--points", 250000, "--area", "300x300")),
                            (base + "/1.las", ("--points", 2000, "--area", "20x20", "--origin", "500010,5400010,0", "--seed", 9))):
            e2e.run([e2e.SYNTH, *words, path]).ok()
            d.ctl("push", "valley", path, "--override-units", "m,m").ok()
        jobs = [job(d, "valley", "--at", "1"), job(d, "valley")]
        kept = d.ctl("fetch", jobs[1], "--changed-since", "1", "--format", "null", "--json").ok().json()["changes"]["kept_triangles"]
        expect(kept > 100000, "only %d triangles are kept" % kept)
        whole = volumes(d, *jobs, "-o", base + "/d.png", "--cell", "5")  # with an image no changes are taken
        got = volumes(d, *jobs)
        keep = {"outputs": None, "color_range": None, "unit_color_range": None}
        expect({**whole, **keep} == {**got, **keep}, "%s %s" % (whole, got))
        expect(got["volumes"][0]["cut"] + got["volumes"][0]["fill"] > 1 and got["volumes"][0]["same_area"] > 50000, "%s" % got)


def interrupted():
    with Folder() as base, Daemon(base) as d:
        jobs = large(d, base, 400000)
        before = sorted(os.listdir(base))
        for after in (0.2, 0.6, 1.2):
            p = subprocess.Popen([ACUTCTL, "volume", *jobs, "-o", base + "/d.png", "--cell", "1"], env={**os.environ, "ACUT_SOCKET": d.socket},
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            e2e.handles(p, signal.SIGINT)
            time.sleep(after)
            p.send_signal(signal.SIGINT)
            (out, err), took = e2e.worked(lambda: p.communicate(timeout=e2e.PATIENCE), p)
            if p.returncode == 0:
                continue
            expect(p.returncode == 130 and not out, "%d %s %s" % (p.returncode, out, err))
            expect(e2e.sanitized() or took < 2, "it worked for %.1f s after the signal" % took)
            expect(sorted(os.listdir(base)) == before, "%s" % os.listdir(base))


def memory():
    """Of two meshes of 1.6 million triangles, with an image."""
    if e2e.sanitized():
        return
    with Folder() as base, Daemon(base) as d:
        jobs = large(d, base, 800000)
        p = subprocess.run([sys.executable, "-c", PEAK, ACUTCTL, "volume", *jobs, "-o", base + "/d.png", "--cell", "1"],
                           env={**os.environ, "ACUT_SOCKET": d.socket, "TMPDIR": base}, capture_output=True, text=True, check=True)
        peak = int(p.stdout.splitlines()[-1])
        expect(peak < 64 << 10, "acutctl had %d KiB" % peak)
        print("     %d KiB" % peak)


e2e.main(generations, datasets, levels, polygons, bounded, between_steps, images, images_within, colors_in_units, early, refused, changes, interrupted, memory)
