"""Views through daemon and client: each option leaves the points that a filter written here leaves, meshed unfiltered. The filter
shares no code with acut: exact fractions, every edge of every polygon, xxhash from its Python package."""
import os
import random
import struct
from fractions import Fraction as F

import e2e
from e2e import VERIFY, expect

try:
    import xxhash
except ImportError:
    e2e.skip("python3-xxhash is not installed")

SCALE, OFFSET = F(1, 100), (635000, 6853000, 0)
RULES = ("crop", "class", "noise", "returns", "withheld", "overlap", "z", "line", "area", "every", "thin", "duplicate", "error",
         "weight")
WITHHELD, SYNTHETIC, KEY, OVERLAP = 1, 2, 4, 8
CLASSES = (0, 1, 2, 2, 2, 3, 5, 5, 6, 7, 8, 9, 12, 17, 18, 64)


class Point:
    __slots__ = ("x", "y", "z", "cls", "ret", "flags")

    def __init__(self, x, y, z, cls, ret, flags):
        """Absolute lattice numbers; ret as acut keeps it: number | count << 4."""
        self.x, self.y, self.z, self.cls, self.ret, self.flags = x, y, z, cls, ret, flags

    def record(self):
        return (self.z, self.cls, self.ret, self.flags)


def make(n, seed, span=10000, classes=CLASSES):
    """n points on a square of 100 m, with positions, thin cells and heights that repeat."""
    rng, out = random.Random(seed), []
    for _ in range(n):
        count = rng.randrange(1, 5)
        x, y = (63500000 + rng.randrange(span), 685300000 + rng.randrange(span))
        if out and rng.random() < .15:
            x, y = out[rng.randrange(len(out))].x, out[rng.randrange(len(out))].y
        elif rng.random() < .3:
            x, y = x // 250 * 250, y // 250 * 250
        flags = sum(f for f in (WITHHELD, SYNTHETIC, KEY, OVERLAP) if rng.random() < .08)
        out.append(Point(x, y, rng.randrange(-300, 300) * (1 if rng.random() < .5 else 10), rng.choice(classes),
                         rng.randrange(1, count + 1) | count << 4, flags))
    return out


GEOKEYS = {"metre": (1024, 1, 3072, 25832), "us-survey-foot": (1024, 1, 3072, 2263, 3076, 9003), "degree": (1024, 2, 2048, 4326), "unknown": ()}


def geokeys(unit):
    keys = GEOKEYS[unit]
    if not keys:
        return b""
    body = struct.pack("<4H", 1, 1, 0, len(keys) // 2)
    body += b"".join(struct.pack("<4H", keys[i], 0, 1, keys[i + 1]) for i in range(0, len(keys), 2))
    return struct.pack("<H16sHH32s", 0, b"LASF_Projection", 34735, len(body), b"") + body


def las(path, points, unit="metre", legacy=False):
    """LAS 1.4 of format 6, or LAS 1.2 of format 1, where overlap is class 12 and has no flag."""
    vlr = geokeys(unit)
    h = bytearray(227 if legacy else 375)
    h[0:4] = b"LASF"
    h[24], h[25] = 1, 2 if legacy else 4
    struct.pack_into("<HII", h, 94, len(h), len(h) + len(vlr), 1 if vlr else 0)
    struct.pack_into("<BH", h, 104, 1 if legacy else 6, 28 if legacy else 30)
    struct.pack_into("<3d", h, 131, .01, .01, .01)
    struct.pack_into("<3d", h, 155, *OFFSET)
    for k, axis in enumerate("xyz"):
        at = [float(getattr(p, axis) * SCALE) for p in points] or [0]
        struct.pack_into("<2d", h, 179 + 16 * k, max(at), min(at))
    if legacy:
        struct.pack_into("<I", h, 107, len(points))
    else:
        struct.pack_into("<Q", h, 247, len(points))
    with open(path, "wb") as f:
        f.write(bytes(h) + vlr)
        for p in points:
            raw = (p.x - OFFSET[0] * 100, p.y - OFFSET[1] * 100, p.z)
            if legacy:
                cls = p.cls | (32 if p.flags & SYNTHETIC else 0) | (64 if p.flags & KEY else 0) | (128 if p.flags & WITHHELD else 0)
                f.write(struct.pack("<iiiHBBbBHd", *raw, 0, (p.ret & 7) | (p.ret >> 4 & 7) << 3, cls, 0, 0, 0, 0))
            else:
                flags = (1 if p.flags & SYNTHETIC else 0) | (2 if p.flags & KEY else 0) | (4 if p.flags & WITHHELD else 0) \
                    | (8 if p.flags & OVERLAP else 0)
                f.write(struct.pack("<iiiHBBBBhHd", *raw, 0, p.ret, flags, p.cls, 0, 0, 0, 0))
    return path


# ---- the filter ----

def rounded(text, scale=SCALE):
    """floor(v + 1/2) of a typed decimal on the lattice."""
    return (F(text) / scale + F(1, 2)).__floor__()


def ring_side(ring, x, y):
    """-1 outside, 0 on it, 1 inside; a ray to smaller y."""
    inside = False
    for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1]):
        if (bx - ax) * (y - ay) == (by - ay) * (x - ax) and min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by):
            return 0
        if (ax <= x) != (bx <= x) and ay + F((by - ay) * (x - ax), bx - ax) < y:
            inside = not inside
    return 1 if inside else -1


def in_area(polygons, x, y):
    return any(ring_side(p[0], x, y) >= 0 and all(ring_side(hole, x, y) <= 0 for hole in p[1:]) for p in polygons)


def every_keeps(n, x, y):
    return xxhash.xxh3_64_intdigest(struct.pack("<qq", x, y)) % n == 0


def removal(p, v):
    """The rule that removes a point by itself, or None."""
    names = v.get("class")
    if "box" in v and not (v["box"][0] <= p.x <= v["box"][2] and v["box"][1] <= p.y <= v["box"][3]):
        return "crop"
    if "area" in v and not in_area(v["area"], p.x, p.y):
        return "crop"
    if (names and p.cls not in names) or p.cls in v.get("not_class", ()):
        return "class"
    if v.get("ground") and p.cls not in (2, 8) and not p.flags & KEY:
        return "class"
    if p.cls in (7, 18) and not v.get("keep_noise") and not (names and p.cls in names):
        return "noise"
    if v.get("first") and p.ret & 15 > 1:
        return "returns"
    if p.flags & WITHHELD and not v.get("keep_withheld"):
        return "withheld"
    if p.flags & OVERLAP and v.get("drop_overlap"):
        return "overlap"
    if not v.get("zmin", p.z) <= p.z <= v.get("zmax", p.z):
        return "z"
    if "every" in v and not every_keeps(v["every"], p.x, p.y):
        return "every"
    return None


def thinned(points, cell, pick):
    cells = {}
    for p in points:
        cells.setdefault((p.x // cell, p.y // cell), []).append(p)
    out = []
    for group in cells.values():
        group.sort(key=lambda p: (-p.z if pick == "highest" else p.z, p.cls, p.ret, p.flags, p.x, p.y))
        out.append(group[(len(group) - 1) // 2 if pick == "median" else 0])
    return out


def select(points, v):
    """(kept, removed by rule)."""
    removed, kept = dict.fromkeys(RULES, 0), []
    for p in points:
        rule = removal(p, v)
        if rule:
            removed[rule] += 1
        else:
            kept.append(p)
    if "thin" in v:
        left = thinned(kept, *v["thin"])
        removed["thin"] = len(kept) - len(left)
        kept = left
    best = {}
    for p in kept:
        q = best.get((p.x, p.y))
        key = (-p.z if v.get("highest") else p.z,) + p.record()[1:]
        if q is None or key < q[0]:
            best[p.x, p.y] = (key, p)
    removed["duplicate"] = len(kept) - len(best)
    return [p for _, p in best.values()], removed


# ---- cases ----

POLYGON = [[("635010.005", "6853010"), ("635080", "6853012.5"), ("635090.004", "6853085.555"), ("635050", "6853040"),
            ("635020", "6853095"), ("635010.005", "6853010")],
           [("635030", "6853025"), ("635050", "6853025"), ("635050", "6853035"), ("635030", "6853035"), ("635030", "6853025")]]
SECOND = [[("635060", "6853060"), ("635099", "6853060"), ("635099.995", "6853099")]]


def numbers(polygon):
    """Rings of lattice numbers; a repeated first corner makes no difference."""
    return [[(rounded(x), rounded(y)) for x, y in ring] for ring in polygon]


def wkt(polygons):
    """As WKT with heights, which are ignored."""
    form = "%s %s 7.5" if len(polygons) == 1 else "%s %s"
    texts = ["(" + ", ".join("(" + ", ".join(form % c for c in ring) + ")" for ring in p) + ")" for p in polygons]
    return "POLYGON Z " + texts[0] if len(texts) == 1 else "MULTIPOLYGON (%s)" % ",\n ".join(texts)


def geojson(polygons):
    rings = [[[("[%s,%s]" % c) for c in ring] for ring in p] for p in polygons]
    text = ["[" + ",".join("[" + ",".join(ring) + "]" for ring in p) + "]" for p in rings]
    return '{"type":"FeatureCollection","features":[' + ",".join(
        '{"type":"Feature","properties":{"a":[1,{"b":null}]},"geometry":{"type":"Polygon","coordinates":%s}}' % t for t in text) \
        + ',{"type":"Feature","properties":null,"geometry":null}]}'


def cases(base):
    def write(name, text):
        with open(os.path.join(base, name), "w") as f:
            f.write(text)
        return os.path.join(base, name)

    box = ["635020.005,6853030,635070,6853079.994"]
    corners = [rounded(t) for t in box[0].split(",")]
    one, two = [numbers(POLYGON)], [numbers(POLYGON), numbers(SECOND)]
    return [
        ("not-class", ["--not-class", "5-7,64"], {"not_class": (5, 6, 7, 64)}),
        ("class and not-class", ["--class", "2-9", "--not-class", "5"], {"class": (2, 3, 4, 6, 7, 8, 9)}),
        ("not-class with noise", ["--not-class", "2,18", "--keep-noise"], {"not_class": (2, 18), "keep_noise": True}),
        ("drop-overlap", ["--drop-overlap", "--keep-withheld"], {"drop_overlap": True, "keep_withheld": True}),
        ("zmin", ["--zmin", "-0.505"], {"zmin": -50}),
        ("zmax", ["--zmax", "1.2349"], {"zmax": 123}),
        ("heights", ["--zmin", "0", "--zmax", "0.5", "--ground"], {"zmin": 0, "zmax": 50, "ground": True}),
        ("box", ["--crop"] + box, {"box": corners}),
        ("polygon, WKT", ["--crop", write("one.wkt", wkt([POLYGON]))], {"area": one}),
        ("polygons, WKT", ["--crop", write("two.wkt", wkt([POLYGON, SECOND]))], {"area": two}),
        ("polygons, GeoJSON", ["--crop", write("two.json", geojson([POLYGON, SECOND])), "--surface"],
         {"area": two, "first": True, "highest": True}),
        ("every", ["--every", "3"], {"every": 3}),
        ("thin", ["--thin", "7.5"], {"thin": (750, "lowest")}),
        ("thin, highest", ["--thin", "10m", "--thin-pick", "highest"], {"thin": (1000, "highest")}),
        ("thin of the surface", ["--thin", "4", "--surface"], {"thin": (400, "highest"), "first": True, "highest": True}),
        ("thin, median", ["--thin", "30ft", "--thin-pick", "median", "--keep-noise"],
         {"thin": (914, "median"), "keep_noise": True}),
        ("thin in survey feet", ["--thin", "3937ftUS", "--thin-pick", "highest"], {"thin": (120000, "highest")}),
        ("all", ["--not-class", "9", "--returns", "first", "--drop-overlap", "--zmin", "-20", "--zmax", "20", "--crop"] + box +
         ["--every", "2", "--thin", "2.5", "--thin-pick", "median", "--duplicates", "highest"],
         {"not_class": (9,), "first": True, "drop_overlap": True, "zmin": -2000, "zmax": 2000, "box": corners, "every": 2,
          "thin": (250, "median"), "highest": True}),
    ]


def mesh_of(d, base, points):
    """Digests of points as they are."""
    path = las(os.path.join(base, "kept.las"), points)
    return d.ctl("mesh", path, "-o", base + "/kept.ply", "--keep-withheld", "--keep-noise", "--json").ok().json()


def each_option():
    """The file is pushed once, and removed before any view is requested."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        points = make(9000, 1)
        path = las(base + "/survey.las", points)
        d.ctl("push", "s", path).ok()
        os.rename(path, base + "/away.las")
        for name, options, view in cases(base):
            kept, removed = select(points, view)
            expect(len(kept) > 2 or "survey feet" in name, "%s leaves too few points to tell" % name)
            got = d.ctl("submit", "s", "--wait", "--json", *options).ok().json()
            want = mesh_of(d, base, kept)
            expect(got["removed"] == removed, "%s: removed %s, not %s" % (name, got["removed"], removed))
            expect(got["used"] == len(kept) and got["points"] == len(points), "%s: %d used of %d, not %d" %
                   (name, got["used"], got["points"], len(kept)))
            for key in ("digest", "vertex_digest", "triangles"):
                expect(got[key] == want[key], "%s: %s is %s, not %s" % (name, key, got[key], want[key]))
            d.ctl("fetch", got["job"], "-o", base + "/m.ply", "--quiet").ok()
            checked = e2e.run([VERIFY, "--json", "--view", got["view"], base + "/m.ply", base + "/away.las"]).ok().json()
            expect({r: n for r, n in removed.items() if r != "duplicate"} == checked["removed"], "%s: acut-verify: %s" %
                   (name, checked["removed"]))
            expect(checked["positions"] == len(kept), "%s: acut-verify counts %d" % (name, checked["positions"]))
            # A plan takes the view too.
            expect(d.ctl("plan", "s", "--json", *options).ok().json()["domains"] >= 0, "plan")
        # An accepted view is a request too, and is the same job.
        again = d.ctl("submit", "s", "--wait", "--json", *options).ok().json()
        expect(again["job"] == got["job"], "the same view is another job")


def mesh_in_one_step():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        points = make(3000, 2)
        las(base + "/a.las", points[:1000])
        las(base + "/b.las", points[1000:])
        chosen = {"polygon, WKT", "polygons, GeoJSON", "all", "thin, median"}
        for name, options, view in [c for c in cases(base) if c[0] in chosen]:
            kept, removed = select(points, view)
            want = mesh_of(d, base, kept)
            for order in ("ab", "ba"):
                got = d.ctl("mesh", *["%s/%s.las" % (base, f) for f in order], "-o", base + "/m.ply", "--json", *options).ok().json()
                expect(got["removed"] == removed and got["digest"] == want["digest"] and
                       got["vertex_digest"] == want["vertex_digest"], "%s, files %s: %s" % (name, order, got))


def one_view_said_twice():
    """Different texts of one view give one job; views that leave the same points give the same digests."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "s", las(base + "/s.las", make(3000, 3))).ok()
        turned = [POLYGON[0][2:-1] + POLYGON[0][:3], POLYGON[1][::-1]]
        for name, text in (("a.wkt", wkt([POLYGON, SECOND])), ("b.wkt", wkt([turned, SECOND])),
                           ("box.json", '{"type":"Polygon","coordinates":[[[635010,6853090.5],[635010,6853020],[635090,6853020],'
                                        '[635090,6853090.5],[635010,6853090.5]]]}')):
            with open(os.path.join(base, name), "w") as f:
                f.write(text)

        def job(*options):
            return d.ctl("submit", "s", "--wait", "--json", *options).ok().json()

        for a, b in ((["--thin", "10"], ["--thin", "10.001m", "--thin-pick", "lowest"]), (["--zmin", "1.23"], ["--zmin", "123e-2"]),
                     (["--crop", base + "/a.wkt"], ["--crop", base + "/b.wkt"]), ([], ["--every", "1", "--returns", "all"]),
                     (["--crop", "635010,6853020,635090,6853090.5"], ["--crop", base + "/box.json"]),
                     (["--class", "2-4", "--not-class", "3"], ["--class", "4,2"])):
            expect(job(*a)["job"] == job(*b)["job"], "%s and %s are two jobs" % (a, b))
        others = ",".join(str(c) for c in range(256) if c != 2)
        for a, b in ((["--class", "2"], ["--not-class", others]), ([], ["--crop", "0,0,1e9,1e9"]),
                     ([], ["--zmin", "-1e300", "--zmax", "1e300"]), (["--surface"], ["--surface", "--thin", "0.01"])):
            one, two = job(*a), job(*b)
            expect(one["job"] != two["job"] and one["digest"] == two["digest"] and one["vertex_digest"] == two["vertex_digest"] and
                   one["used"] == two["used"], "%s and %s: %s %s" % (a[:2], b[:2], one["digest"], two["digest"]))


def old_overlap():
    """Class 12 of old formats is overlap; of new ones it is a class."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        points = make(2000, 4)
        for p in points:
            p.flags &= ~OVERLAP
            p.ret = (p.ret & 7) | (p.ret >> 4 & 7) << 4
            p.cls &= 31
        old = las(base + "/old.las", points, legacy=True)
        kept, removed = select([p for p in points if p.cls != 12], {})
        want = mesh_of(d, base, kept)
        got = d.ctl("mesh", old, "-o", base + "/m.ply", "--drop-overlap", "--json").ok().json()
        expect(got["digest"] == want["digest"] and got["vertex_digest"] == want["vertex_digest"], "old class 12: %s" % got["removed"])
        expect(got["removed"]["overlap"] == sum(p.cls == 12 and not p.flags & WITHHELD for p in points), str(got["removed"]))
        got = d.ctl("mesh", las(base + "/new.las", points), "-o", base + "/m.ply", "--drop-overlap", "--json").ok().json()
        expect(got["removed"]["overlap"] == 0, "class 12 of format 6 is no overlap: %s" % got["removed"])


def units():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        points = make(500, 5)
        las(base + "/unknown.las", points, unit="unknown")
        las(base + "/feet.las", points, unit="us-survey-foot")
        run = d.ctl("mesh", base + "/unknown.las", "-o", base + "/m.ply", "--thin", "10m")
        expect(run.status == 1 and "unit of the dataset is unknown" in run.err and "bare number" in run.err, run.err)
        d.ctl("mesh", base + "/unknown.las", "-o", base + "/m.ply", "--thin", "10").ok()
        a = d.ctl("mesh", base + "/feet.las", "-o", base + "/m.ply", "--thin", "12m", "--json").ok().json()
        b = d.ctl("mesh", base + "/feet.las", "-o", base + "/m.ply", "--thin", "39.37", "--json").ok().json()
        expect(a["digest"] == b["digest"] and a["units"]["xy"] == "us-survey-foot", "12 m are 39.37 survey feet: %s" % a)
        with open(base + "/small.wkt", "w") as f:
            f.write("POLYGON ((5 5, 5.001 5, 5 5.001, 5 5))")
        run = d.ctl("mesh", base + "/feet.las", "-o", base + "/m.ply", "--crop", base + "/small.wkt", "--json").ok()
        got = run.json()
        expect(got["triangles"] == 0 and "area of crop" in got["notes"][0] and got["used"] == 0, str(got))
        run = d.ctl("mesh", base + "/feet.las", "-o", base + "/m.ply", "--thin", "0.001")
        expect(run.status == 2 and "half a step of the lattice" in run.err, run.err)


def notes():
    """A note if vegetation is meshed, too. The ground of a file without ground points fails, with a hint at programs that
    classify."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        las(base + "/classified.las", make(400, 6))
        raw = make(400, 6, classes=(0, 1))
        for p in raw:
            p.flags &= ~KEY
        las(base + "/raw.las", raw)
        run = d.ctl("mesh", base + "/classified.las", "-o", base + "/m.ply").ok()
        expect(run.err.count("note: points of all classes are meshed") == 1 and "--ground" in run.err, run.err)
        got = d.ctl("mesh", base + "/classified.las", "-o", base + "/m.ply", "--json").ok()
        expect(len(got.json()["notes"]) == 1 and "all classes" in got.json()["notes"][0], got.out)
        for options in (["--ground"], ["--class", "2,5"], ["--not-class", "5"], ["--surface"]):
            got = d.ctl("mesh", base + "/classified.las", "-o", base + "/m.ply", "--json", *options).ok().json()
            expect(got["notes"] == [], "%s: %s" % (options, got["notes"]))
        expect(d.ctl("mesh", base + "/raw.las", "-o", base + "/m.ply", "--json").ok().json()["notes"] == [], "raw")
        os.unlink(base + "/m.ply")
        run = d.ctl("mesh", base + "/raw.las", "-o", base + "/m.ply", "--ground")
        expect(run.status == 1 and not os.path.exists(base + "/m.ply"), "%d %s" % (run.status, run.err))
        for word in ("no ground points", "filters.smrf", "lasground", "CSF"):
            expect(word in run.err, run.err)
        run = d.ctl("mesh", base + "/classified.las", "-o", base + "/m.ply", "--ground", "--zmin", "500")
        expect(run.status == 1 and "leaves no ground points" in run.err, run.err)


def large_areas():
    """The largest areas that fit the text of a view work, also after a restart and in streams; larger ones are refused, with the
    number."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        points = make(4000, 7)
        d.ctl("push", "s", las(base + "/s.las", points)).ok()
        rng, ring = random.Random(8), []
        for i in range(3500):
            ring.append(("%.2f" % (635050 + (20 + 25 * rng.random()) * (1 - 4 * abs(i / 3500 - .5))), "%.2f" % (6853000 + i / 35)))
        with open(base + "/large.wkt", "w") as f:
            f.write(wkt([[ring], SECOND]))
        got = d.ctl("submit", "s", "--wait", "--json", "--crop", base + "/large.wkt").ok().json()
        expect(len(got["view"]) > 10000, "the text has %d bytes" % len(got["view"]))
        kept, removed = select(points, {"area": [numbers([ring]), numbers(SECOND)]})
        want = mesh_of(d, base, kept)
        expect(got["removed"] == removed and got["digest"] == want["digest"], "large area: %s" % got["removed"])
        expect(len(d.ctl("jobs", "--json").ok().out.splitlines()) >= 1, "jobs")
        d.stop()
        d.start()
        d.ctl("fetch", got["job"], "-o", base + "/m.ply").ok()
        expect(d.ctl("submit", "s", "--json", "--crop", base + "/large.wkt").ok().json()["job"] == got["job"], "after a restart")
        with open(base + "/large.wkt", "w") as f:
            f.write(wkt([[ring * 5], SECOND]))
        run = d.ctl("submit", "s", "--crop", base + "/large.wkt")
        expect(run.status == 1 and "corners" in run.err and "simplify" in run.err, run.err)


if __name__ == "__main__":
    e2e.main(each_option, mesh_in_one_step, one_view_said_twice, old_overlap, units, notes, large_areas)
