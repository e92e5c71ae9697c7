"""Deliveries of careless surveyors: grids, strips, one position a thousand times, a circle, a distant point; and the expected
meshes, by CGAL and by counting, without any code of acut."""
import json
import os
import random
import struct
import subprocess

import e2e
from survey import las

try:
    import xxhash
except ImportError as e:
    e2e.skip("python3-xxhash is needed: %s" % e)

CGAL = os.environ.get("CGAL_DIGEST")
SIDE = 10000  # in hundredths, as all numbers here
CIRCLE = [(x, y) for x in range(-1105, 1106) for y in range(-1105, 1106) if x * x + y * y == 1105 * 1105]


def shape(rng, n):
    """About n positions, and their box."""
    side = rng.choice([1, 40, 300, 3000, SIDE])
    x, y = rng.randrange(SIDE - side + 1), rng.randrange(SIDE - side + 1)
    if rng.random() < 0.15:
        far = rng.choice([20 * SIDE, 10 ** 8, -10 ** 8])
        x, y = x + far, y + rng.choice([0, far])
    kind = rng.choice(["cloud", "cloud", "cloud", "grid", "row", "column", "diagonal", "strip", "point", "pile", "circle", "cell"])
    some, root = range(n), int(n ** .5)
    if kind == "grid":
        step = rng.choice([1, 7, 64])
        out = [(x + i * step, y + j * step) for i in range(root) for j in range(root)]
    elif kind == "row":
        out = [(x + rng.randrange(side), y) for _ in some]
    elif kind == "column":
        out = [(x, y + i) for i in some]
    elif kind == "diagonal":
        out = [(x + 3 * i, y + 2 * i) for i in some]
    elif kind == "strip":
        out = [(x + rng.randrange(9), y + rng.randrange(SIDE)) for _ in some]
    elif kind == "point":
        out = [(x, y)]
    elif kind == "pile":
        out = [(x, y)] * n
    elif kind == "circle":
        out = [(x + a, y + b) for a, b in CIRCLE]
    elif kind == "cell":  # of a square of the grid no position is left
        out = [(x // 32 * 32 + i % 32, y // 32 * 32 + i // 32) for i in range(1024)]
    else:
        out = [(x + rng.randrange(side), y + rng.randrange(side)) for _ in some]
    if rng.random() < 0.4:  # positions that many files have, each with a height of its own
        shared = random.Random(1)
        out += [(shared.randrange(SIDE), shared.randrange(SIDE)) for _ in range(n // 20)]
    return out


def deliver(path, rng, n):
    """Writes a file; returns its points (x, y, z, class)."""
    points = [(x, y, rng.randrange(-1000, 3000), rng.choice((1, 2, 2, 2, 7))) for x, y in shape(rng, n)]
    write(path, points)
    return points


def deliver_survey(path, rng, n):
    """Writes a file that needs several regions with little memory."""
    points = [(rng.randrange(SIDE), rng.randrange(SIDE), rng.randrange(-1000, 3000), 2) for _ in range(n)]
    write(path, points)
    return points


def write(path, points):
    las(path, [p[:3] for p in points], scale=(.01, .01, .01))
    with open(path, "r+b") as f:
        data = bytearray(f.read())
        for i, p in enumerate(points):
            data[227 + 20 * i + 15] = p[3]
        f.seek(0)
        f.write(data)


def decimal(v):
    return "%s%d.%02d" % ("-" if v < 0 else "", abs(v) // 100, abs(v) % 100)


def select(points, view):
    """{position: height} of the points that a view leaves, by the words of the manual."""
    o = dict(zip(view, view[1:]))
    if "--crop" in o:
        x0, y0, x1, y1 = (int(v) * 100 for v in o["--crop"].split(","))
        points = [p for p in points if x0 <= p[0] <= x1 and y0 <= p[1] <= y1]
    if "--zmin" in o:
        points = [p for p in points if p[2] >= int(o["--zmin"]) * 100]
    classes = {1, 2} if "--class" not in o else {int(o["--class"])}
    if "--ground" in view:
        classes = {2}
    points = [p for p in points if p[3] in classes]
    if "--every" in o:
        points = [p for p in points if xxhash.xxh3_64_intdigest(struct.pack("<qq", *p[:2])) % int(o["--every"]) == 0]
    if "--thin" in o:
        side, pick, cells = round(float(o["--thin"]) * 100), o.get("--thin-pick", "lowest"), {}
        for p in points:
            cells.setdefault((p[0] // side, p[1] // side), []).append((-p[2] if pick == "highest" else p[2], p[3], p))
        points = []
        for rows in cells.values():
            rows.sort()
            points.append(rows[(len(rows) - 1) // 2 if pick == "median" else 0][-1])
    highest = "--surface" in view or o.get("--duplicates") == "highest"
    out = {}
    for x, y, z, _ in points:
        if (x, y) not in out or (z > out[x, y] if highest else z < out[x, y]):
            out[x, y] = z
    return out


def oracle(path, heights, polygons=()):
    """(triangles, digest) of the whole mesh and of those that meet each polygon, by CGAL; leaves a file at path."""
    las(path, [(x, y, 0) for x, y in heights], scale=(.01, .01, .01))
    args = [CGAL, path] + [",".join("%d,%d" % c for c in p) for p in polygons]
    lines = subprocess.run(args, stdout=subprocess.PIPE, check=True).stdout.decode().splitlines()
    return [(int(n), digest) for n, digest in (line.split() for line in lines)]


def vertex_digest(heights):
    high = low = 0
    for (x, y), z in heights.items():
        v = xxhash.xxh3_128_intdigest(struct.pack("<3q", x, y, z))
        high, low = high + (v >> 64), low + (v & (1 << 64) - 1)
    return "%016x%016x" % (high % 2 ** 64, low % 2 ** 64)


def read_obj(path):
    """Triangles of whole hundredths, counter-clockwise from the smallest corner on."""
    vertex, out = [], []
    with open(path) as f:
        for line in f:
            word = line.split()
            if word and word[0] == "v":
                vertex.append(tuple(round(float(w) * 100) for w in word[1:]))
            elif word and word[0] == "f":
                a, b, c = (vertex[int(w) - 1] for w in word[1:])
                out.append(min((a, b, c), (b, c, a), (c, a, b)))
    e2e.expect(len(set(out)) == len(out), "a triangle twice in %s" % path)
    return out


def geojson(path, ring):
    with open(path, "w") as f:
        json.dump({"type": "Polygon", "coordinates": [[[float(decimal(v)) for v in c] for c in ring + ring[:1]]]}, f)
    return path


def higher(t, along):
    """True if t (counter-clockwise), whose circumcentre is on a border, is above a border along axis 0, or right of one along
    axis 1."""
    for p in sorted(range(3), key=lambda i: t[i][:2], reverse=True):
        q, r = (t[(p + n) % 3][along] for n in (1, 2))
        if q != r:
            return q > r if along else q < r


def centre_in(t, regions):
    """True if the circumcentre of t is in one of the regions (x0, y0, x1, y1, doubled; None: unbounded), by the rules of
    stream.md."""
    (ax, ay), (bx, by), (cx, cy) = (p[:2] for p in t)
    bx, by, cx, cy = bx - ax, by - ay, cx - ax, cy - ay
    d = 2 * (bx * cy - by * cx)
    b2, c2 = bx * bx + by * by, cx * cx + cy * cy
    x, y = 2 * (cy * b2 - by * c2) + 2 * ax * d, 2 * (bx * c2 - cx * b2) + 2 * ay * d
    # Whole numbers, doubled once more: a step of one leaves a border and reaches no other.
    x, y, d = 2 * x + (1 if higher(t, 1) else -1), 2 * y + (1 if higher(t, 0) else -1), 2 * d
    return any((r[0] is None or r[0] * d < x) and (r[1] is None or r[1] * d < y) and (r[2] is None or x < r[2] * d) and
               (r[3] is None or y < r[3] * d) for r in regions)
