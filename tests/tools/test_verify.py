"""acut-verify: good meshes pass, with a list of the checks; each kind of damage is named."""
import itertools
import json
import math
import os
import random
import struct
import subprocess
import sys
import tempfile
from fractions import Fraction

VERIFY = os.environ["ACUT_VERIFY"]
W = 6  # a grid of W x W vertices, steps of 0.5 m on a lattice of 0.01 m


def expect(good, text):
    if not good:
        sys.exit("FAILED: %s" % text)


def run(*args, **kw):
    return subprocess.run([VERIFY, *map(str, args)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=60, **kw)


def numbers():
    """Lattice numbers of the vertices, absolute."""
    return [(50000000 + 50 * (i % W), -540000000 + 50 * (i // W), 12345 + 7 * i) for i in range(W * W)]


def faces():
    """Each cell from the upper left to the lower right, as the tie rule has it."""
    for y in range(W - 1):
        for x in range(W - 1):
            a = y * W + x
            yield a, a + 1, a + W
            yield a + 1, a + W + 1, a + W


K = (50000100, -540000000, 12000)
ZERO = "0" * 32


def ply(vertices=None, triangles=None, comments=(), lattice="0.01 0.01 %d %d %d" % K, digest=None, index="int",
        declared=None, tail=b""):
    vertices = [tuple(c / 100 for c in v) for v in numbers()] if vertices is None else vertices
    triangles = list(faces()) if triangles is None else triangles
    head = ["ply", "format binary_little_endian 1.0"]
    head += ["comment acut-lattice " + lattice] if lattice else []
    head += ["comment acut-crs EPSG:32633"] + ["comment " + c for c in comments]
    head += ["comment acut-digest " + digest] if digest else []
    head += ["element vertex %d" % len(vertices), "property double x", "property double y", "property double z",
             "element face %d" % (len(triangles) if declared is None else declared),
             "property list uchar %s vertex_indices" % index, "end_header", ""]
    body = b"".join(struct.pack("<3d", *v) for v in vertices)
    body += b"".join(struct.pack("<B%dI" % len(t), len(t), *t) for t in triangles)
    return "\n".join(head).encode() + body + tail


def verify(data, *args, status):
    got = run(*args, "-", input=data)
    expect(got.returncode == status, "status %d, not %d: %s%s" % (got.returncode, status, got.stdout, got.stderr))
    return got


def report(data, *args, status=0):
    return json.loads(verify(data, "--json", *args, status=status).stdout)


def trimmed(folder):
    """A file that says that it has a part of the mesh: holes and unused vertices are no fault, all else is."""
    part = [t for i, t in enumerate(faces()) if i not in (12, 13, 14, 30)][2:]
    mark = ["acut-trimmed max-edge=2.5"]
    expect(report(ply(triangles=part), status=1)["fault"] in ("boundary", "unused"), "a part that does not say so")
    got = report(ply(triangles=part, comments=mark))
    expect(got["good"] and got["trimmed"] and got["triangles"] == len(part), str(got))
    expect(not report(ply())["trimmed"], "a whole mesh")
    expect(b"a part of a mesh" in verify(ply(triangles=part, comments=mark), status=0).stdout, "as text")
    whole = report(ply())
    wrong = report(ply(triangles=part, comments=mark, digest=whole["digest"] + " " + whole["vertex_digest"]), status=1)
    expect(wrong["fault"] == "digest", "the digest of the whole mesh in a part: %s" % wrong)
    a, b = part[6], part[7]
    flipped = part[:6] + [(a[0], a[1], b[1]), (a[0], b[1], a[2])] + part[8:]
    expect(report(ply(triangles=flipped, comments=mark), status=1)["fault"] == "tie", "another diagonal")
    expect(report(ply(triangles=part + part[:1], comments=mark), status=1)["fault"] == "edge", "a triangle twice")
    expect(report(ply([], [], comments=mark))["good"], "nothing is left")
    points = os.path.join(folder, "points.xyz")
    with open(points, "w") as f:
        f.writelines("%d.%02d -%d.%02d %d.%02d\n" % (x // 100, x % 100, -y // 100, -y % 100, z // 100, z % 100) for x, y, z in numbers() + [(50001000, -540000000, 0)])
    expect(run("-", points, input=ply(triangles=part, comments=mark)).returncode == 0, "a point that no triangle of the part has")
    expect(b"(missing)" in run("-", points, input=ply()).stdout, "a whole mesh lacks a point")


def good(folder):
    got = report(ply())
    expect(got["good"] and got["fault"] is None and got["vertices"] == W * W and got["digest_in_file"] is False, str(got))
    expect(got["triangles"] == 2 * (W - 1) ** 2 and got["hull"] == 4 * (W - 1) and got["ties"] == (W - 1) ** 2, str(got))
    expect(got["edges"] == got["inner_edges"] + got["hull"] and got["points"] is None, str(got))
    digest = got["digest"] + " " + got["vertex_digest"]
    expect(report(ply(digest=digest))["digest_in_file"], "the digest")
    # Another origin K, another order, or uint in place of int: other files of the same mesh.
    moved = report(ply(lattice="0.01 0.01 50000000 -540000050 0", digest=digest, triangles=list(faces())[::-1], index="uint"))
    expect(moved["digest"] == got["digest"] and moved["good"], str(moved))
    shifted = [tuple((c - o) / 1000 for c, o in zip((10 * v[0], 10 * v[1], 10 * v[2]), (500000005, -5400000000, 0)))
               for v in numbers()]
    expect(report(ply(shifted, comments=["acut-origin 500000.005 -5400000 0"], digest=digest))["good"], "acut-origin")
    expect(report(ply([], [], digest=ZERO + " " + ZERO))["good"], "no triangles")
    expect(verify(ply(), "--quiet", status=0).stdout == b"", "--quiet")
    expect(b"good" in verify(ply(), status=0).stdout, "text")


def wrong(folder):
    got = report(ply())
    digest, other = got["digest"], got["vertex_digest"]
    expect(report(ply(digest=other + " " + other), status=1)["fault"] == "digest", "digest")
    expect(report(ply(digest=digest + " " + digest), status=1)["fault"] == "vertex-digest", "vertex digest")
    raised = [tuple(c / 100 for c in v) for v in numbers()]
    raised[7] = raised[7][:2] + (raised[7][2] + 1,)
    expect(report(ply(raised, digest=digest + " " + other), status=1)["fault"] == "vertex-digest", "a height")
    t = list(faces())
    expect(report(ply(triangles=[(0, 1, W * W)] + t[1:]), status=1)["fault"] == "index", "index")
    expect(report(ply(triangles=[t[0][::-1]] + t[1:]), status=1)["fault"] == "orientation", "orientation")
    expect(report(ply(triangles=t + [t[9]]), status=1)["fault"] == "edge", "edge")
    got = report(ply(triangles=[(0, 1, W + 1), (0, W + 1, W)] + t[2:]), status=1)
    expect(got["fault"] == "tie" and len(got["place"]) == 3, str(got))
    expect(abs(got["place"][0] - 500000) < 1 and abs(got["place"][1] + 5400000) < 1, str(got))
    text = verify(ply(triangles=t[1:]), status=1).stdout
    expect(b"wrong (" in text, text)


def broken(folder):
    whole = ply()
    off = [tuple(c / 100 for c in v) for v in numbers()]
    off[3] = (off[3][0] + 1e-6,) + off[3][1:]
    for what, data in (("empty", b""), ("no ply", b"plz\n"), ("cut", whole[:-1]), ("cut head", whole[:60]),
                       ("tail", ply(tail=b"x")), ("more faces", ply(declared=60)), ("no lattice", ply(lattice=None)),
                       ("bad lattice", ply(lattice="0.01 0.01 1 2")), ("off lattice", ply(off)),
                       ("beyond 32 bits", ply(lattice="0.01 0.01 0 0 9999999999")),
                       ("quad", ply(triangles=[(0, 1, 2, 3)])), ("bad digest", ply(digest="12 34")),
                       ("ascii", whole.replace(b"binary_little_endian", b"ascii")),
                       ("float", whole.replace(b"double y", b"float y")),
                       ("too fine", ply(lattice="0.0000000000001 0.01 0 0 0")),
                       ("nan", ply([(float("nan"), 0.0, 0.0)], [])),
                       ("huge", whole.replace(b"vertex 36", b"vertex 99999999999"))):
        got = run("-", input=data)
        expect(got.returncode == 1 and got.stderr.startswith(b"acut-verify: "), "%s: %d %s" % (what, got.returncode, got.stderr))


def points(folder):
    mesh, path, second = (os.path.join(folder, n) for n in ("m.ply", "a.xyz", "b.xyz"))
    with open(mesh, "wb") as f:
        f.write(ply())

    def write(to, rows):
        with open(to, "w") as f:
            f.writelines("%.2f %.2f %.2f\n" % tuple(c / 100 for c in r) for r in rows)

    def fault(*args):
        got = run("--json", *args)
        return json.loads(got.stdout)["fault"]

    rows = numbers()
    write(path, rows)
    expect(fault(mesh, path) is None, "the points")
    write(path, rows[:20])
    write(second, rows[20:] + rows[5:6])
    got = json.loads(run("--json", mesh, path, second).stdout)
    expect(got["good"] and got["points"] == W * W + 1 and got["positions"] == W * W, str(got))
    expect(fault(mesh, path) == "extra", "a vertex that is no point")
    write(second, rows[20:] + [(rows[0][0] + 1, rows[0][1], 0)])
    expect(fault(mesh, path, second) == "missing", "a point that is no vertex")
    write(second, rows[20:] + [(rows[0][0], rows[0][1], rows[0][2] + 5)])
    expect(fault(mesh, path, second) is None, "a duplicate above")
    expect(fault("--duplicates", "highest", mesh, path, second) == "height", "a height")
    expect(fault("--class", "2", mesh, path, second) == "extra", "a class that text has not")
    expect(run(mesh, os.path.join(folder, "none.xyz")).returncode == 74, "no such input")


def errors(folder):
    """--max-error against exact fractions: a surface of some of the points, by the rule of the grid's cells."""
    random.seed(7)
    mesh, path, plain = (os.path.join(folder, n) for n in ("m.ply", "a.xyz", "plain.ply"))
    rows = numbers()
    z = {(x, y): h for x, y, h in rows}
    x0, y0 = rows[0][:2]
    with open(mesh, "wb") as f:
        f.write(ply())

    def error(x, y, h):
        """Steps above or below the cell's triangle, both cut from the upper left to the lower right."""
        i, j = min((x - x0) // 50, W - 2), min((y - y0) // 50, W - 2)
        u, v = Fraction(x - x0 - 50 * i, 50), Fraction(y - y0 - 50 * j, 50)
        a, b, c, d = (z[x0 + 50 * (i + k), y0 + 50 * (j + l)] for k, l in ((0, 0), (1, 0), (0, 1), (1, 1)))
        at = a + u * (b - a) + v * (c - a) if u + v <= 1 else d + (1 - u) * (c - d) + (1 - v) * (b - d)
        return abs(h - at)

    def write(points):
        with open(path, "w") as f:
            f.writelines("%.2f %.2f %.2f\n" % tuple(c / 100 for c in r) for r in points)

    for run_number in range(12):
        more = {}
        for _ in range(40 if run_number else 1):
            x, y = random.randrange(50 * W - 49), random.randrange(50 * W - 49)
            if x % 50 or y % 50:
                more[x + x0, y + y0] = 12345 + random.randrange(300)
        more = [(x, y, h) for (x, y), h in more.items()]
        write(rows + more)
        largest = max(error(*p) for p in more)
        steps = -(-largest.numerator * 1000 // largest.denominator)
        got = json.loads(run("--json", "--max-error", "%.2f" % (int(largest) / 100 + 0.01), mesh, path).stdout)
        expect(got["good"] and got["outside"] == 0 and round(got["largest_error"] * 100000) == steps, "%s %s" % (got, largest))
        got = json.loads(run("--json", "--max-error", "%.2f" % ((math.ceil(largest) - 1) / 100), mesh, path).stdout)
        expect(got["fault"] == "error" and any(error(*p) == largest and abs(got["place"][0] - p[0] / 100) < 1e-6 for p in more),
               "%s %s" % (got, largest))
        view = lambda steps: "view 1 max-error=%d" % steps
        expect(run("--view", view(math.ceil(largest)), mesh, path).returncode == 0, "a bound in the view")
        expect(run("--view", view(math.ceil(largest) - 1), mesh, path).returncode == 1, "a bound in the view, too small")
        expect(run("--view", view(0), "--max-error", "9", mesh, path).returncode == 0, "--max-error in place of it")
        expect(run("--view", "view 1 max-points=36", mesh, path).returncode == 0, "no bound: some of the points")
    expect(run(mesh, path).returncode == 1, "without a bound all points are vertices")
    # A bound is inclusive, and exact: the middle of the diagonal is 24.5 steps high.
    middle = (x0 + 25, y0 + 25, 12345 + 24)
    write(rows + [middle])
    expect(error(*middle) == Fraction(1, 2), error(*middle))
    expect(run("--max-error", "0", mesh, path).returncode == 1 and run("--max-error", "0.01", mesh, path).returncode == 0, "half a step")
    write(rows + [(x0, y0 + 25, 12345 + 21 - 3)])
    expect(run("--max-error", "0.02", mesh, path).returncode == 1 and run("--max-error", "0.03", mesh, path).returncode == 0, "three steps")
    write(rows + [(x0 + 25, y0, 12345)])
    got = json.loads(run("--json", "--max-error", "0.03", mesh, path).stdout)
    expect(got["fault"] == "error" and got["largest_error"] == 0.035, got)
    text = run("--max-error", "0.04", mesh, path)
    expect(text.returncode == 0 and b"0.035 at most, within 0.04; at 500000.25 -5400000 123.45" in text.stdout.replace(b"00 at", b" at"), text.stdout)
    # Points of a mesh; those that no triangle has; vertices that are no points.
    more = rows + [(x0 + 25, y0 + 10, 12400)]
    with open(plain, "wb") as f:
        f.write(ply([tuple(c / 100 for c in v) for v in more], [], lattice="0.01 0.01 50000000 -540000050 0"))
    expect(json.loads(run("--json", "--max-error", "0.6", mesh, plain).stdout)["points"] == W * W + 1, "a PLY for points")
    expect(run("--max-error", "0.1", mesh, plain).returncode == 1, "a PLY for points, beyond the bound")
    with open(plain, "wb") as f:
        f.write(ply([tuple(c / 1000 for c in v) for v in more], [], lattice="0.001 0.01 0 0 0"))
    expect(run("--max-error", "0.1", mesh, plain).returncode == 1, "another scale")
    write(rows + [(x0 - 1, y0, 12345)])
    expect(json.loads(run("--json", "--max-error", "9", mesh, path).stdout)["fault"] == "uncovered", "a point outside")
    with open(mesh, "wb") as f:
        f.write(ply(comments=["acut-trimmed tile"]))
    got = json.loads(run("--json", "--max-error", "9", mesh, path).stdout)
    expect(got["good"] and got["outside"] == 1, got)
    write(rows[1:])
    expect(json.loads(run("--json", "--max-error", "9", mesh, path).stdout)["fault"] == "extra", "a vertex that is no point")
    for bad in ("-1", "x", "1m", "", "1e300", "1 ground"):
        expect(run("--max-error", bad, mesh, path).returncode == 2, bad)
    # The three steps are 0.03 of the unit of the heights, which need not be that of x and y.
    write(rows + [(x0, y0 + 25, 12345 + 21 - 3)])
    for unit, within, beyond in (("metre", "0.03m", "0.0299m"), ("metre", "0.1ft", "0.098ft"), ("foot", "0.03ft", "0.009m"), ("foot", "0.00915m", "0.029")):
        with open(mesh, "wb") as f:
            f.write(ply(comments=["acut-units us-survey-foot " + unit]))
        expect(run("--max-error", within, mesh, path).returncode == 0, "%s in %s" % (within, unit))
        got = json.loads(run("--json", "--max-error", beyond, mesh, path).stdout)
        expect(got["fault"] == "error" and got["max_error"] == 0.02, "%s in %s: %s" % (beyond, unit, got))
        expect(run("--view", "ask 1 max-error=" + within, mesh, path).returncode == 0, "a request")
    with open(mesh, "wb") as f:
        f.write(ply([(x / 100, y0 / 100, 0) for x in (x0, x0 + 9)], []))
    write([(x, y0, 0) for x in (x0, x0 + 9)])
    expect(run("--max-error", "1", mesh, path).returncode == 0, "a line")
    write([(x, y0, 0) for x in (x0, x0 + 9, x0 + 5)])
    expect(run("--max-error", "1", mesh, path).returncode == 1, "a line without one of its points")


def regular(points):
    """The regular triangulation of (x, y, w) by its definition: triangles of numbers. Heights are raised a little, by the rank of
    the position: each by so much more than the one before that no sum of those before it matters."""
    order = sorted(range(len(points)), key=lambda i: points[i][:2])
    lift = [Fraction(x * x + y * y - w) + Fraction(1, 10 ** (12 * (len(points) - order.index(i) + 1))) for i, (x, y, w) in enumerate(points)]
    area = lambda a, b, c: (points[b][0] - points[a][0]) * (points[c][1] - points[a][1]) - (points[b][1] - points[a][1]) * (points[c][0] - points[a][0])
    found = []
    for a, b, c in itertools.permutations(range(len(points)), 3):
        if a > b or a > c or area(a, b, c) <= 0:
            continue
        if all(lift[a] * area(b, c, d) + lift[b] * area(c, a, d) + lift[c] * area(a, b, d) < lift[d] * area(a, b, c)
               for d in range(len(points)) if d not in (a, b, c)):
            found.append((a, b, c))
    return found


def weighted(folder):
    """--weight: the mesh, then one with another radius, another diagonal, without a vertex, with one that is hidden."""
    rng = random.Random(11)
    mesh, path = os.path.join(folder, "m.ply"), os.path.join(folder, "a.csv")
    seen = {}
    for turn in range(40):
        size = rng.choice([4, 6, 40])
        at = sorted({(rng.randrange(size), rng.randrange(size)) for _ in range(12)})
        rng.shuffle(at)
        radius = {2: 1 + rng.randrange(size // 2), 9: 1}
        rows = [(x, y, rng.randrange(9), rng.choice([1, 1, 2, 9])) for x, y in at]
        whole = [(x, y, radius.get(c, 0) ** 2) for x, y, _, c in rows]
        option = ["--weight", "2=%d,9=%d" % (radius[2], radius[9])]

        def write(keep, triangles):
            number = {v: i for i, v in enumerate(keep)}
            with open(mesh, "wb") as f:
                f.write(ply([tuple(map(float, rows[v][:3])) for v in keep], [[number[v] for v in t] for t in triangles], lattice="1 1 0 0 0"))

        def fault(*args):
            got = json.loads(run("--json", *args, mesh, path).stdout)
            seen[got["fault"]] = seen.get(got["fault"], 0) + 1
            return got["fault"]

        with open(path, "w") as f:
            f.writelines(["x,y,z,classification\n"] + ["%d,%d,%d,%d\n" % r for r in rows])
        right = regular(whole)
        if not right:
            continue
        used = sorted({v for t in right for v in t})
        write(used, right)
        got = json.loads(run("--json", *option, mesh, path).stdout)
        expect(got["good"] and got["hidden"] == got["removed"]["weight"] == len(rows) - len(used), "%s of %s, %s" % (got, whole, right))
        expect(run("--view", "view 1 weight=2:%d,9:%d" % (radius[2], radius[9]), mesh, path).returncode == 0, "a view")
        expect(fault("--weight", "2=%d,9=1" % (4 * size)) in (None, "power", "hidden"), "another radius")
        expect(fault() in (None, "delaunay", "tie", "missing"), "no weights")
        # Without a vertex that is not on the hull, and with a hidden one, the rest is regular in itself.
        gone = rng.choice(used)
        rest = [v for v in range(len(rows)) if v != gone]
        part = [tuple(rest[i] for i in t) for t in regular([whole[v] for v in rest])]
        if part:
            write(sorted({v for t in part for v in t}), part)
            expect(fault(*option) in ("hidden", "uncovered"), "a vertex that is left out")
        plain = regular([w[:2] + (0,) for w in whole])
        if len(used) < len(rows):
            write(range(len(rows)), plain)
            expect(fault(*option) in ("power", "tie"), "a vertex that is hidden")
        for t in right:
            for u in right:
                for k in range(9):
                    a, b, c = t[k // 3], t[(k // 3 + 1) % 3], t[(k // 3 + 2) % 3]
                    if (u[k % 3], u[(k + 1) % 3]) == (b, a) and t < u:
                        d = u[(k + 2) % 3]
                        write(used, [v for v in right if v not in (t, u)] + [(c, a, d), (d, b, c)])
                        expect(fault(*option) in ("power", "tie", "orientation"), "another diagonal")
        write(used, right[1:])
        expect(fault(*option) is not None, "a triangle is missing")
    expect(all(seen.get(f, 0) > 5 for f in ("power", "hidden", "tie", "delaunay", "uncovered")), seen)
    write(used, right)
    # Lengths are those of the request: of two units one is unknown here.
    expect(run("--weight", "2=1m", mesh, path).returncode == 1, "the mesh has no unit")
    text = run("--weight", "2=0,9=0", mesh, path)
    expect(b"regular" not in text.stdout, "no radius is none")
    with open(mesh, "wb") as f:
        f.write(ply(comments=["acut-units metre unknown"]))
    with open(path, "w") as f:
        f.writelines(["x,y,z,classification\n"] + ["%.2f,%.2f,%.2f,2\n" % tuple(c / 100 for c in r) for r in numbers()])
    for radius in ("2=0.5m", "2=0.5", "2=1ft"):
        got = run("--weight", radius, mesh, path)
        expect(got.returncode == 0 and b"regular " in got.stdout and b"hidden    0" in got.stdout, got.stdout + got.stderr)
    # The same points without names of columns: nothing says that the fourth is the class.
    bare = os.path.join(folder, "bare.csv")
    with open(path) as f, open(bare, "w") as to:
        to.writelines(f.readlines()[1:])
    got = run("--weight", "2=0.5", mesh, bare)
    expect(got.returncode == 2 and b"--columns" in got.stderr and b"bare.csv" in got.stderr, got)
    for columns, weight, what in (("xyzc", "2=0.5", b"regular "), ("xyz", "0=0.5", b"regular "), ("xyz", "2=0", b"delaunay")):
        got = run("--weight", weight, "--columns", columns, mesh, bare)
        expect(got.returncode == 0 and what in got.stdout, "%s: %s" % (columns, got))
    expect(run("--columns", "xyzc", "--class", "2", mesh, bare).returncode == 0 and run("--class", "2", mesh, bare).returncode == 1, "classes")
    expect(run("--columns", "xyq", mesh, bare).returncode == 2, "columns that are none")
    with open(bare) as f:
        text = f.read().replace(",", ";").replace(".", ",")
    with open(bare, "w") as f:
        f.write(text)
    expect(run("--columns", "xyzc", "--decimal-comma", "--weight", "2=0.5", mesh, bare).returncode == 0, "decimal commas")
    for args, said in (([], "classes"), ([mesh], "classes"), (["--max-error", "1", path], "bound"), (["--metric", "1,1,2", path], "ellipses"),
                       (["--breaklines", path, path], "no lines")):
        got = run("--weight", "2=1", mesh, *args)
        expect(got.returncode == 2 and said in got.stderr.decode(), "%s: %s" % (args, got))
    for bad in ("", "2", "2=", "2=x", "2=1,2=1", "256=1", "2=-1", "2=1,"):
        expect(run("--weight", bad, mesh, path).returncode == 2, bad)


def weighted_files(folder):
    """--weight FILE=RADIUS: three files with radii of their own, which count before those of classes, by each kind of name."""
    rng = random.Random(12)
    mesh = os.path.join(folder, "m.ply")
    names = ["old/a.csv", "new/b.csv", "new/2024/ü, v=1.csv"]
    paths = [os.path.join(folder, n) for n in names]
    os.makedirs(os.path.join(folder, "new/2024"))
    os.makedirs(os.path.join(folder, "old"))
    called = [["a.csv", "old/", "./old/a.csv", "o*/a.csv", paths[0], folder + "/old/", "[a]*", "old/[!b].*"],
              ["b.csv", "new/b.csv", "*/b.???", folder + "/*/b.csv", "./new/?.csv"],
              ["2024/", "new/????/", "?? v=1.csv", "2024/*", "./new/2024/"]]
    wrong, hidden = {}, 0

    def write(path, rows):
        with open(path, "w") as f:
            f.writelines(["x,y,z,classification\n"] + ["%d,%d,%d,%d\n" % r for r in rows])

    def check(*args):
        got = run("--json", *args, mesh, *paths)
        return json.loads(got.stdout) if got.returncode < 2 else got

    for turn in range(60):
        size = rng.choice([4, 6, 40])
        files = [[(rng.randrange(size), rng.randrange(size), rng.randrange(9), rng.choice([1, 2, 9])) for _ in range(5)] for _ in names]
        classes = {2: 1 + rng.randrange(size // 2)} if rng.randrange(2) else {}
        radius = [rng.choice([None, 0, 1 + rng.randrange(size // 2)]) for _ in names]
        best = {}
        for i, rows in enumerate(files):
            write(paths[i], rows)
            for x, y, z, cls in rows:
                row = (-(classes.get(cls, 0) if radius[i] is None else radius[i]), z)
                best[x, y] = min(best.get((x, y), row), row)
        rows = [(*p, r[1], -r[0]) for p, r in sorted(best.items())]
        right = regular([(x, y, w * w) for x, y, _, w in rows])
        if not right:
            continue
        used = sorted({v for t in right for v in t})
        with open(mesh, "wb") as f:
            f.write(ply([tuple(map(float, rows[v][:3])) for v in used], [[used.index(v) for v in t] for t in right], lattice="1 1 0 0 0"))

        def option(radii):
            items = ["%s=%d" % (rng.choice(called[i]), r) for i, r in enumerate(radii) if r is not None]
            items += ["%d=%d" % c for c in classes.items()]
            rng.shuffle(items)
            return ["--weight", ",".join(items or ["3=0"])]

        got = check(*option(radius))
        expect(got["good"] and got["hidden"] in (None, len(rows) - len(used)), "%s of %s: %s" % (radius, files, got))
        # In place of the weights of a view, whose numbers of files mean nothing here.
        got = check("--view", "view 1 weight=99:1,#7:3", *option(radius))
        expect(got["good"], got)
        hidden += got["hidden"] or 0
        for other in itertools.permutations(radius):
            fault = check(*option(other))["fault"]
            wrong[fault] = wrong.get(fault, 0) + (other != tuple(radius))
    expect(hidden > 50 and wrong.get("power", 0) > 100, "%d hidden, faults %s" % (hidden, wrong))
    # The path of a relative name is absolute.
    short = ",".join(["%s=%d" % (n, r) for n, r in zip(("old/a.csv", "new/b.csv", "2024/"), radius) if r is not None] + ["%d=%d" % c for c in classes.items()])
    got = subprocess.run([VERIFY, "--weight", short or "3=0", "../m.ply", "a.csv", ".././/new/b.csv", "../" + names[2]], cwd=os.path.dirname(paths[0]),
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    expect(got.returncode == 0, got)
    for weight, said in (("x.csv=1", "none of the POINTS"), ("old=1", "none of the POINTS"), ("ld/a.csv=1", "none of the POINTS"),
                         ("n*b.csv=1", "none of the POINTS"), ("v=1.csv=1", "none of the POINTS"), ("? v=1.csv=1", "none of the POINTS"),
                         ("old/=1,a.csv=2", "two radii"), ("a.csv=x", "not a length"), ("a.csv=-1", "not a length"), ("a.csv=", "FILE=RADIUS"),
                         ("=1", "FILE=RADIUS"), ("a.csv", "FILE=RADIUS"), ("#1=1", "FILE=RADIUS"), ("a.csv=2000000000", "2^30"), ("a.csv=1,", "FILE=RADIUS")):
        got = check("--weight", weight)
        expect(isinstance(got, subprocess.CompletedProcess) and got.returncode == 2 and said in got.stderr.decode(), "%s: %s" % (weight, got))
    expect(check("--weight", "old/=1,a.csv=1.0,99=1")["fault"] != "x", "one radius by two names")
    got = run("--view", "view 1 weight=#1:3", mesh, *paths)
    expect(got.returncode == 2 and b"--weight beside --view" in got.stderr, got)
    expect(run("--view", "view 1", "--ground", mesh).returncode == 2, "another option beside --view")


def usage(folder):
    for bad in ([], ["--class", "x", "m"], ["--returns", "second", "m"], ["--ground", "--surface", "m"], ["--what"],
                ["--duplicates", "both", "m"]):
        got = run(*bad)
        expect(got.returncode == 2 and got.stderr, "%s: %d" % (bad, got.returncode))
    expect(run(os.path.join(folder, "none.ply")).returncode == 74, "no such mesh")
    with open("/dev/full", "wb") as full:
        got = subprocess.run([VERIFY, "-"], input=ply(), stdout=full, stderr=subprocess.PIPE)
    expect(got.returncode == 74, "/dev/full")
    expect(run("--help").returncode == 0 and run("--version").stdout.startswith(b"acut-verify "), "--help, --version")


for test in (good, trimmed, wrong, broken, points, errors, weighted, weighted_files, usage):
    with tempfile.TemporaryDirectory() as base:
        test(base)
    print("ok  ", test.__name__)
