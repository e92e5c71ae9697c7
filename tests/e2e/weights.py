"""Meshes with weights: CGAL's regular triangulation of the same positions, triangle by triangle, with any memory, threads and order
of files, in views that select points, and over generations; what is hidden is counted; windows are parts of
the whole mesh; what cannot be done is refused by its name."""
import os
import random
import re
import struct
import subprocess

import e2e
from e2e import expect

ORACLE = os.environ.get("CGAL_DIGEST")


def points_file(base, points, name="points.csv"):
    path = os.path.join(base, name)
    with open(path, "w") as f:
        f.write("x,y,z,classification\n")
        f.writelines("%d,%d,%d,%d\n" % p for p in points)
    return path


def of_cgal(points, radius):
    """Positions, and [vertices, triangles, digest]; None where CGAL is not there. Of a position the greatest radius counts."""
    best = {}
    for x, y, _, cls in points:
        best[x, y] = max(best.get((x, y), 0), radius.get(cls, 0))
    if not ORACLE:
        return len(best), None
    rows = "\n".join("%d %d %d" % (*p, r * r) for p, r in sorted(best.items()))
    vertices, triangles, digest = subprocess.run([ORACLE, "weights"], input=rows, stdout=subprocess.PIPE, check=True, text=True).stdout.split()
    return len(best), [int(vertices), int(triangles), digest]


def compare(got, points, radius, what):
    positions, want = of_cgal(points, radius)
    mesh = [got["vertices"], got["triangles"], got["digest"]]
    expect(want is None or mesh == want, "%s: %s, CGAL has %s" % (what, mesh, want))
    expect(got["removed"]["weight"] == positions - got["vertices"], "%s: %s of %d positions" % (what, got["removed"], positions))
    return got["removed"]["weight"]


def option(radius):
    return ["--weight", ",".join("%d=%d" % row for row in radius.items())]


def submit(d, name, radius, *options):
    return d.ctl("submit", name, "--wait", "--json", *option(radius), *options).ok().json()


def surveys(rng, n):
    """An old survey everywhere, a good one on a strip, a dense one in a corner."""
    size = int(n ** .5 * 10)
    old = [(rng.randrange(size), rng.randrange(size), rng.randrange(90), 1) for _ in range(n)]
    good = [(rng.randrange(size // 3, size // 2), rng.randrange(size), 500 + rng.randrange(9), 2) for _ in range(n // 4)]
    dense = [(rng.randrange(size // 8), rng.randrange(size // 8), 900, 9) for _ in range(n // 8)]
    return old + good + dense


def tiny():
    """Random sets in tiny ranges, where everything is degenerate."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        hidden = 0
        for seed in range(40):
            rng = random.Random(seed)
            size = rng.choice([3, 5, 9, 30])
            points = [(rng.randrange(size), rng.randrange(size), rng.randrange(4), rng.randrange(4)) for _ in range(rng.randrange(4, 90))]
            points += [(0, 0, 0, 1), (size, 0, 0, 1), (0, size, 0, 1)]
            radius = {cls: 1 + rng.randrange(size) for cls in range(1, 4) if rng.randrange(3)} or {2: 1}
            name = "t%d" % seed
            d.ctl("push", name, points_file(base, points)).ok()
            hidden += compare(submit(d, name, radius), points, radius, "%s of %s" % (radius, points))
        expect(hidden > 100, "only %d hidden" % hidden)


def any_memory():
    rng = random.Random(5)
    points, radius = surveys(rng, 60000), {2: 20, 9: 7}
    with e2e.Folder() as base:
        seen = set()
        for memory, threads in (("24M", 1), ("96M", 3)):
            rng.shuffle(points)
            files = [points_file(base, points[i::3], "part%d.csv" % i) for i in range(3)]
            with e2e.Daemon(base, memory=memory, threads=threads, name=memory) as d:
                d.ctl("push", "s", *files).ok()
                got = submit(d, "s", radius)
                seen.add((got["digest"], got["vertex_digest"], got["vertices"], got["removed"]["weight"], got["hull"]))
                if len(seen) == 1 and memory == "24M":
                    expect(got["domains"] >= 3, "only %d domains" % got["domains"])
                    hidden = compare(got, points, radius, "surveys")
                    expect(hidden > 3000, "only %d hidden" % hidden)
                # What is fetched is numbered and checked vertex by vertex; the job above has only sums.
                out = os.path.join(base, memory + ".ply")
                d.ctl("fetch", str(got["job"]), "-o", out).ok()
                expect("element vertex %d\n" % got["vertices"] in open(out, errors="replace").read(2000), "vertices of the file")
                r = e2e.run([e2e.VERIFY, out, "--view", got["view"], "--json", *files]).ok().json()
                expect(r["good"] and r["hidden"] == got["removed"]["weight"], r)
                for args in (["--weight", "2=20,9=8"], []):
                    expect(e2e.run([e2e.VERIFY, out, *args, *files]).status == 1, "other weights: %s" % args)
        expect(len(seen) == 1, seen)


def selected():
    """crop keeps the points of a box, thin those of cells, and the weights apply to what is left."""
    rng = random.Random(6)
    points, radius = surveys(rng, 3000), {2: 25}
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        d.ctl("push", "s", points_file(base, points)).ok()
        box = (50, 60, 400, 500)
        inside = [p for p in points if box[0] <= p[0] <= box[2] and box[1] <= p[1] <= box[3]]
        compare(submit(d, "s", radius, "--crop", "%d,%d,%d,%d" % box), inside, radius, "crop")
        lowest = {}
        for p in points:
            at = p[0] // 9, p[1] // 9
            # The order of view_thin_compare: z, class, position.
            lowest[at] = min(lowest.get(at, p), p, key=lambda q: (q[2], q[3], q[0], q[1]))
        compare(submit(d, "s", radius, "--thin", "9"), list(lowest.values()), radius, "thin")
        # A class that is not there costs nothing, however large its radius is.
        compare(submit(d, "s", {**radius, 77: 10 ** 6}), points, radius, "another class")
        kept = [p for p in points if p[3] != 9]
        compare(submit(d, "s", radius, "--not-class", "9"), kept, radius, "class")


def generations():
    """After a push only domains near it are made again, and a revert finds all."""
    rng = random.Random(7)
    points, radius = surveys(rng, 150000), {2: 15}
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        d.ctl("push", "s", points_file(base, points)).ok()
        first = submit(d, "s", radius)
        more = [(rng.randrange(3500, 3873), rng.randrange(300), 1, 2) for _ in range(2000)]
        d.ctl("push", "s", points_file(base, more, "more.csv")).ok()
        second = submit(d, "s", radius)
        compare(second, points + more, radius, "after a push")
        expect(0 < second["domains_reused"] < second["domains"] and second["digest"] != first["digest"], second)
        d.ctl("dataset", "revert", "s", "2").ok()
        again = submit(d, "s", radius)
        expect(again["digest"] == first["digest"], "%s, not %s" % (again, first))
        # As many as are there: this is the same content, but a later generation.
        expect(again["domains_reused"] == again["domains"] > 1, again)


def triangles_of(path):
    """Of a PLY: the triangles as sets of corners x, y, z."""
    data = open(path, "rb").read()
    head, body = data.split(b"end_header\n", 1)
    nvertex, nface = (int(re.search(rb"element %s (\d+)" % what, head).group(1)) for what in (b"vertex", b"face"))
    vertex = list(struct.iter_unpack("<3d", body[:24 * nvertex]))
    faces = struct.iter_unpack("<B3i", body[24 * nvertex:24 * nvertex + 13 * nface])
    return {frozenset(vertex[v] for v in f[1:]) for f in faces}


def windows():
    """The triangles of an area are those of the whole mesh that meet it: of boxes, of a polygon, of a fetch, in views that select."""
    def meets(t, box):
        """Separating axes of a triangle and a box."""
        p = [v[:2] for v in t]
        corners = [(box[i], box[j]) for i in (0, 2) for j in (1, 3)]
        axes = [(1, 0), (0, 1)] + [(p[i][1] - p[i - 1][1], p[i - 1][0] - p[i][0]) for i in range(3)]
        for x, y in axes:
            a, b = [x * q[0] + y * q[1] for q in p], [x * q[0] + y * q[1] for q in corners]
            if max(a) < min(b) or min(a) > max(b):
                return False
        return True

    rng = random.Random(9)
    points, radius = surveys(rng, 30000), {2: 25, 9: 7}
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M", threads=2) as d:
        files = [points_file(base, points[i::2], "part%d.csv" % i) for i in range(2)]
        d.ctl("push", "s", *files).ok()
        out = os.path.join(base, "out.ply")
        for more in ([], ["--thin", "20"]):
            job = submit(d, "s", radius, *more)
            d.ctl("fetch", str(job["job"]), "-o", out).ok()
            whole = triangles_of(out)
            expect(len(whole) == job["triangles"], "the whole mesh")
            boxes = [(600, 700, 640, 900), (0, 0, 1732, 1732), (570, 300, 580, 302), (-50, -50, 10, 10), (100, 100, 100, 100), (5000, 0, 6000, 9)]
            boxes += [(x, y, x + rng.randrange(400), y + rng.randrange(400)) for x, y in [(rng.randrange(1700), rng.randrange(1700)) for _ in range(12)]]
            for box in boxes:
                want = {t for t in whole if meets(t, box)}
                text = "%d,%d,%d,%d" % box
                d.ctl("fetch", str(job["job"]), "--bbox=" + text, "-o", out).ok()
                expect(triangles_of(out) == want, "fetch of %s: %d, not %d" % (text, len(triangles_of(out)), len(want)))
            part = submit(d, "s", radius, *more, "--bbox=" + text)
            d.ctl("fetch", str(part["job"]), "-o", out).ok()
            expect(triangles_of(out) == want and part["triangles"] == len(want) > 0, "job of %s: %s" % (text, part))
        area = os.path.join(base, "area.wkt")
        with open(area, "w") as f:
            f.write("POLYGON((100 100, 900 100, 900 700, 100 700, 100 100),(200 200, 800 200, 800 600, 200 600, 200 200))")
        job = submit(d, "s", radius)
        d.ctl("fetch", str(job["job"]), "-o", out).ok()
        ring = [(100, 100, 900, 200), (100, 600, 900, 700), (100, 100, 200, 700), (800, 100, 900, 700)]
        want = {t for t in triangles_of(out) if any(meets(t, b) for b in ring)}
        d.ctl("fetch", str(job["job"]), "--polygon", area, "-o", out).ok()
        expect(triangles_of(out) == want, "a polygon: %d, not %d" % (len(triangles_of(out)), len(want)))
        got = e2e.run([e2e.VERIFY, out, "--json", *option(radius), *files]).ok().json()
        expect(got["good"] and got["trimmed"] and got["hidden"] > 0, got)


def refused():
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        points = surveys(random.Random(8), 400)
        d.ctl("push", "s", points_file(base, points)).ok()
        for args, said in ((["submit", "s", "--weight", "2=5", "--max-error", "1"], "bound of errors"),
                           (["submit", "s", "--weight", "2=5,2=6"], "named twice"), (["submit", "s", "--weight", "2"], "--weight")):
            r = d.ctl(*args)
            expect(r.status == 2 and said in r.err, "%s: %d, %s" % (args, r.status, r.err))
        path = os.path.join(base, "lines.csv")
        with open(path, "w") as f:
            f.write("x,y,z,name\n1,1,5,a\n90,80,5,a\n")
        d.ctl("push", "s", "--lines-as", "hard", path).ok()
        r = d.ctl("submit", "s", "--wait", "--weight", "2=5")
        expect(r.status != 0 and "--no-breaklines" in r.err, r.err)
        compare(submit(d, "s", {2: 5}, "--no-breaklines"), points, {2: 5}, "without the lines")


if __name__ == "__main__":
    e2e.main(tiny, any_memory, selected, generations, windows, refused)
