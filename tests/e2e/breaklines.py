"""Breaklines, lakes, boundaries and holes: the mesh is CGAL's constrained triangulation of what breakline_model makes of points and
lines, triangle by triangle, with any memory, threads and order of files; lines come and go with generations."""
import json
import os
import random

import breakline_model
import e2e
from e2e import expect

ALL = ("--keep-withheld", "--keep-noise")


def points_file(base, points, name="points.xyz"):
    path = os.path.join(base, name)
    with open(path, "w") as f:
        f.writelines("%d %d %d\n" % (x, y, (x * 7 + y * 3) % 50) for x, y in points)
    return path


def lines_file(base, name, parts, z=5):
    """CSV; a ring ends where it begins."""
    path = os.path.join(base, name)
    with open(path, "w") as f:
        f.write("x,y,z,name\n")
        for i, (ring, at) in enumerate(parts):
            f.writelines("%d,%d,%d,%d\n" % (*p, z, i) for p in (at + at[:1] if ring else at))
    return path


def lakes_file(base, name, features, z=3):
    """GeoJSON without a known system, because a polygon has islands."""
    path = os.path.join(base, name)
    rings = lambda f: ", ".join("[%s]" % ", ".join("[%d, %d, %d]" % (*p, z) for p in r + r[:1]) for r in f)
    with open(path, "w") as f:
        f.write('{"type": "FeatureCollection", "crs": null, "features": [%s]}' % ", ".join(
            '{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [%s]}}' % rings(x) for x in features))
    return path


def random_lines(rng, size, n):
    """Short and long lines, stars through one position, lines on lines, T-junctions: all cross each other."""
    some = lambda: (rng.randrange(size), rng.randrange(size))
    parts = []
    for _ in range(n):
        kind = rng.randrange(5)
        a = some()
        if kind == 0:
            parts.append((False, [a, some()]))
        elif kind == 1:
            at = [a]
            for _ in range(rng.randrange(1, 6)):
                at.append((at[-1][0] + rng.randrange(-4, 5), at[-1][1] + rng.randrange(-4, 5)))
            parts.append((False, at))
        elif kind == 2:
            parts.append((True, [a, (a[0] + rng.randrange(1, 9), a[1]), (a[0], a[1] + rng.randrange(1, 9))]))
        elif parts:
            other = rng.choice(parts)[1]
            parts.append((False, [rng.choice(other), a] if kind == 3 else other[:2] + [a]))
    return [p for p in parts if len(set(p[1])) > 1]


def compare(got, model, what):
    want = model.cgal()
    expect(want is None or [got["triangles"], got["digest"]] == want, "%s: %d triangles %s, CGAL has %s" % (
        what, got["triangles"], got["digest"], want))
    removed = got["removed"]
    expect(removed.get("line", 0) == model.on_line and removed.get("area", 0) == model.in_area,
           "%s: %s removed, expected %d on lines and %d in areas" % (what, removed, model.on_line, model.in_area))


def tiny():
    """Random sets in tiny ranges, where everything is degenerate."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        for seed in range(60):
            rng = random.Random(seed)
            size = rng.choice([4, 7, 12, 30, 200])
            points = {(rng.randrange(size), rng.randrange(size)) for _ in range(rng.randrange(4, 120))} | {(0, 0), (size, 0), (0, size)}
            parts = random_lines(rng, size, rng.randrange(1, 14))
            if not parts:
                continue
            path, lines = points_file(base, points), lines_file(base, "lines.csv", parts)
            got = d.ctl("mesh", path, "--breaklines", lines, "--format", "null", "--json", *ALL).ok().json()
            compare(got, breakline_model.Model(points, parts), "seed %d" % seed)


def survey(rng, size, n):
    return {(rng.randrange(size), rng.randrange(size)) for _ in range(n)}


def many_domains():
    """One survey in many regions: the same mesh with other memory, threads and order of files, push by push and from nothing."""
    rng = random.Random(11)
    size = 3000
    points = survey(rng, size, 110000)
    parts = []
    for _ in range(60):
        at = [(rng.randrange(size), rng.randrange(size))]
        for _ in range(40):
            at.append((at[-1][0] + rng.randrange(-30, 31), at[-1][1] + rng.randrange(-30, 31)))
        parts.append((False, at))
    parts += [(False, [(1500, 1500), (1500 + rng.randrange(-400, 400), 1500 + rng.randrange(-400, 400))]) for _ in range(30)]
    model = breakline_model.Model(points, parts)
    with e2e.Folder() as base:
        path = points_file(base, points)
        halves = [lines_file(base, "a.csv", parts[::2]), lines_file(base, "b.csv", parts[1::2])]
        digests = set()
        for memory, threads, order in (("24M", 1, 1), ("24M", 2, -1), ("256M", 2, 1)):
            with e2e.Daemon(base, memory=memory, threads=threads, name=memory + str(threads)) as d:
                for lines in halves[::order]:
                    d.ctl("push", "d", lines, "--lines-as", "hard", "--scale", "1").ok()
                d.ctl("push", "d", path).ok()
                got = d.ctl("submit", "d", "--wait", "--json", *ALL).ok().json()
                compare(got, model, "%s, %d threads" % (memory, threads))
                digests.add((got["digest"], got["vertex_digest"]))
                expect(memory != "24M" or got["domains"] > 4, "%d domains" % got["domains"])
                expect(d.vmhwm() <= (int(memory[:-1]) + 32) << 20, "VmHWM %d" % d.vmhwm())
                if memory == "256M":
                    windows(d, got, size)
                generations(d, got, halves)
        expect(len(digests) == 1, "digests %s" % digests)


def windows(d, whole, size):
    """The triangles of a window are those of the whole mesh that meet it."""
    parts = 0
    for i in range(3):
        box = "%d,0,%d,%d" % (i * size // 3, (i + 1) * size // 3, size)
        direct = d.ctl("submit", "d", "--wait", "--json", "--bbox", box, *ALL).ok().json()
        fetched = d.ctl("fetch", whole["job"], "--json", "--format", "null", "--bbox", box).ok().json()
        expect(direct["digest"] == fetched["digest"] and direct["triangles"] == fetched["triangles"], "window %s: %s %s" % (box, direct, fetched))
        parts += direct["triangles"]
    expect(parts > whole["triangles"], "%d of %d triangles" % (parts, whole["triangles"]))


def generations(d, got, halves):
    """Lines are removed and come back: stored domains are used only where they hold."""
    at = d.ctl("dataset", "show", "d", "--json").ok().json()["generation"]
    plain = d.ctl("submit", "d", "--wait", "--json", "--no-breaklines", *ALL).ok().json()
    expect(plain["digest"] != got["digest"], "the mesh without lines")
    d.ctl("dataset", "revert", "d", "2").ok() # the second file of lines
    other = d.ctl("submit", "d", "--wait", "--json", *ALL).ok().json()
    expect(other["digest"] not in (plain["digest"], got["digest"]), "with one file of lines")
    d.ctl("dataset", "revert", "d", str(at + 1)).ok()
    again = d.ctl("submit", "d", "--wait", "--json", *ALL).ok().json()
    expect(again["digest"] == got["digest"], "after two reverts")
    r = d.ctl("push", "d", halves[0], "--lines-as", "hard", "--json").ok().json()
    expect(r["state"] == "known", str(r))


def areas():
    """Lakes with islands, a boundary and a hole."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        for seed in range(6):
            rng = random.Random(100 + seed)
            points = survey(rng, 400, 4000)
            lakes = [[[(100, 100), (180, 90 + seed), (190, 180), (110, 170)], [(130, 130), (150, 130), (150, 150), (130, 150)]]]
            boundary = [[(20, 20), (380, 30), (390, 370), (200, 395), (10, 380)]]
            holes = [[(250, 250), (300, 260 + seed), (280, 300)]]
            hard = [(False, [(30, 200), (95, 205), (60, 300)])]
            path = points_file(base, points)
            got = d.ctl("mesh", path, "--breaklines", lines_file(base, "h.csv", hard),
                        "--lakes", lines_file(base, "l.csv", [(True, r) for r in lakes[0][:1]]),
                        "--boundary", lines_file(base, "b.csv", [(True, boundary[0])]), "--holes", lines_file(base, "o.csv", [(True, holes[0])]),
                        "--format", "null", "--json", *ALL).ok().json()
            compare(got, breakline_model.Model(points, hard, [lakes[0][:1]], boundary, holes), "seed %d" % seed)


def reports():
    """What is said of crossings, and the places of them; with --strict they are refused where heights differ."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = points_file(base, survey(random.Random(1), 50, 300))
        crossed = os.path.join(base, "crossed.csv")
        with open(crossed, "w") as f:
            f.write("x,y,z,name\n0,10,4,a\n20,10,4,a\n10,0,6,b\n10,20,10,b\n0,10,9,c\n5,30,9,c\n")
        places = os.path.join(base, "places.geojson")
        got = d.ctl("mesh", path, "--breaklines", crossed, "--breakline-report", places, "--format", "null", "--json").ok().json()["line_set"]
        expect(got["crossings"] == 1 and got["uneven"] == 1 and got["lines"] == 3 and got["edges"] == 5, str(got))
        expect(got["widest"] == 5 and got["widest_at"] == [0, 10], str(got))
        with open(places) as f:
            found = sorted((p["properties"]["kind"], p["geometry"]["coordinates"], p["properties"]["lower"], p["properties"]["upper"])
                           for p in json.load(f)["features"])
        expect(found == [("crossing", [10, 10], 4, 8), ("uneven", [0, 10], 4, 9)], str(found))
        for system, name in (((), 'LOCAL_CS["unknown"]'), (("--assume-crs", "EPSG:25832"), "urn:ogc:def:crs:EPSG::25832")):
            hidden = os.path.join(base, "hidden.geojson")
            d.ctl("mesh", path, "--breaklines", crossed, "--breakline-report", places, "--format", "null", *system).ok()
            d.ctl("mesh", path, "--weight", "0=5", "--weight-report", hidden, "--format", "null", *system).ok()
            for report in (places, hidden):
                with open(report) as f:
                    expect(json.load(f)["crs"]["properties"]["name"] == name, "%s: no system %s" % (report, name))
        cropped = d.ctl("mesh", path, "--breaklines", crossed, "--crop", "0,0,15,30", "--format", "null", "--json").ok().json()
        expect(any("1 edge of lines has an end outside" in w for w in cropped["notes"]), str(cropped))
        r = d.ctl("push", "d", crossed, "--lines-as", "hard", "--strict")
        expect(r.status == 1 and "height" in r.err, "%d %s" % (r.status, r.err))
        r = d.ctl("push", "d", crossed, "--lines-as", "soft").ok()
        expect("soft lines" in r.err and "cross each other at 1 place" in r.out + r.err, r.out + r.err)
        expect("by at most 5 in all" in r.out + r.err, r.out + r.err)
        sloping = os.path.join(base, "sloping.csv")
        with open(sloping, "w") as f:
            f.write("x,y,z,name\n0,10,4,a\n20,10,4,a\n10,0,6,b\n10,20,10,b\n")
        r = d.ctl("push", "sloping", sloping, "--lines-as", "hard").ok()
        expect("heights differ there by at most 4, at 10 10" in r.out + r.err, r.out + r.err)
        level = lines_file(base, "level.csv", [(False, [(0, 0), (20, 20)]), (False, [(0, 20), (20, 0)])])
        r = d.ctl("push", "level", level, "--lines-as", "hard").ok()
        expect("cross each other at 1 place" in r.out + r.err and "heights differ" not in r.out + r.err, r.out + r.err)


def taken_for_points():
    """Files of lines among survey files: what cannot be points is refused, and CSV of lines is said to be it; nothing is said of points."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = points_file(base, survey(random.Random(1), 50, 300))
        lines = lines_file(base, "roads.csv", [(False, [(10, 10), (40, 11)]), (False, [(9, 40), (40, 30), (45, 30)])])
        shore = lakes_file(base, "shore.geojson", [[[(10, 10), (20, 10), (20, 20)]]])
        named = os.path.join(base, "named.csv")
        with open(named, "w") as f:
            f.write("name,x,y,z\n" + "".join("P%d,%d,%d,5\n" % (i, i, i * i % 17) for i in range(20)))
        r = d.ctl("mesh", path, lines, "--format", "null").ok()
        expect("roads.csv may be lines" in r.err and "--breaklines" in r.err, r.err)
        r = d.ctl("push", "d", lines).ok()
        expect("roads.csv may be lines" in r.err and "--lines-as" in r.err, r.err)
        expect("acutctl info --lines" in d.ctl("info", lines).ok().err, "info")
        for more in (["mesh", path, named, "--format", "null"], ["mesh", path, lines, "--input-format", "xyz", "--format", "null"],
                     ["mesh", path, "--breaklines", lines, "--format", "null"], ["info", named], ["info", "--lines", lines]):
            r = d.ctl(*more).ok()
            expect("may be lines" not in r.err, "%s: %s" % (more, r.err))
        r = d.ctl("mesh", path, shore, "--format", "null")
        expect(r.status == 2 and "shore.geojson" in r.err and "--lakes" in r.err, "%d %s" % (r.status, r.err))
        r = d.ctl("push", "d", shore)
        expect(r.status == 2 and "shore.geojson" in r.err and "--lines-as" in r.err, "%d %s" % (r.status, r.err))
        r = d.ctl("mesh", path, "--lakes", shore, "--no-breaklines", "--format", "null")
        expect(r.status == 2 and "leaves out all lines" in r.err, "%d %s" % (r.status, r.err))


def nothing_left():
    """A mesh without triangles says why."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = points_file(base, survey(random.Random(1), 50, 300))
        ring = [(5, 5), (20, 5), (20, 20)]
        a, b = lines_file(base, "a.csv", [(True, ring)]), lines_file(base, "b.csv", [(True, ring)])
        r = d.ctl("mesh", path, "--boundary", a, "--holes", b, "--format", "null", "--json").ok()
        expect(any("outside of the boundary, in holes or in lakes" in n for n in r.json()["notes"]), r.out)
        r = d.ctl("mesh", path, "--boundary", a, "--crop", "30,30,50,50", "--format", "null", "--json").ok()
        expect(any("outside of the boundary, in holes or in lakes" in n for n in r.json()["notes"]), r.out)
        d.ctl("push", "d", a, "--lines-as", "hole", "--scale", "1").ok()
        d.ctl("push", "d", b, "--lines-as", "hard").ok()
        job = d.ctl("submit", "d", "--wait", "--json").ok().json()
        expect(job["triangles"] == 0 and any("all triangles are outside of the boundary or in holes" in n for n in job["notes"]), str(job))
        d.ctl("fetch", job["job"], "--format", "null").ok()


def large_set():
    """A line set that needs more memory than the share of a stage."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        lines = lines_file(base, "many.csv", [(False, [(3 * x, 7 * y) for x in range(1000)]) for y in range(150)])
        got = d.ctl("push", "d", lines, "--lines-as", "hard", "--json").ok().json()["line_set"]
        expect(got["edges"] == 150 * 999, str(got))


def refusals():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = points_file(base, survey(random.Random(1), 50, 300))
        flat = os.path.join(base, "flat.csv")
        with open(flat, "w") as f:
            f.write("x,y,z,name\n1,2,,a\n3,4,,a\n")
        for words, status, text in (
                (["mesh", path, "--breaklines", flat, "--format", "null"], 1, "it has no z"),
                (["mesh", path, "--breaklines", flat + "x", "--format", "null"], 1, "it cannot be opened"),
                (["push", "d", path, "--lines-as", "road"], 2, "hard, soft, lake, boundary or hole"),
                (["push", "d", base, "--lines-as", "hard"], 2, "not from folders"),
                (["mesh", path, "--breaklines", flat, "--lakes", flat, "--format", "null"], 2, "given twice"),
                (["mesh", path, "--densify", "5", "--format", "null"], 2, "there are none")):
            r = d.ctl(*words)
            expect(r.status == status and text in r.err, "%s: %d %s" % (words, r.status, r.err))
        text = os.path.join(base, "text.txt")
        with open(text, "w") as f:
            f.write("acut-lines 1\nfeature 1 hard\nline\n10 10 5\n20 10 5\n")
        r = d.ctl("mesh", path, "--breaklines", text, "--format", "null")
        expect(r.status == 1 and "says itself what its lines are" in r.err and "as an input" in r.err, r.err)
        r = d.ctl("push", "text", text).ok()
        expect("text.txt: 2 vertices of lines" in r.out, r.out)
        expect(d.ctl("mesh", path, text, "--format", "null", "--json").ok().json()["line_set"]["edges"] == 1, "a text of lines as an input")
        sloping = os.path.join(base, "lake.csv")
        with open(sloping, "w") as f:
            f.write("x,y,z,name\n10,10,5,a\n20,10,6,a\n20,20,7,a\n10,10,5,a\n")
        r = d.ctl("mesh", path, "--lakes", sloping, "--format", "null")
        expect(r.status == 1 and "--lake-level" in r.err, r.err)
        d.ctl("mesh", path, "--lakes", sloping, "--lake-level", "min", "--format", "null").ok()


if __name__ == "__main__":
    e2e.main(tiny, many_domains, areas, reports, taken_for_points, nothing_left, large_set, refusals)
